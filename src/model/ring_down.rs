//! Free decays y_k = C A_d^k x_a, exactly discretised: A_d = e^{A dt}.

use super::Plant;
use nalgebra::{Complex, DMatrix, DVector};

/// Poles of a third-order ring-down: one damped pair and one real pole.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Poles {
    /// Damping of the pair, 1/s (positive: decays).
    pub damping_per_s: f64,
    /// Damped frequency of the pair, Hz.
    pub frequency_hz: f64,
    /// Decay rate of the real pole, 1/s (positive: decays).
    pub lambda_per_s: f64,
}

/// A_d = e^{A dt}. In SI units the entries of A differ by 12 decades, so the states are scaled to
/// microseconds first: x' = S x with volumes in units of one microsecond's flow.
/// `a`: n x n, 1/s. `dt_s`: s.
pub fn discretise(a: &DMatrix<f64>, dt_s: f64) -> DMatrix<f64> {
    (balance(a) * (dt_s * 1e6)).exp()
}

/// A in microseconds with its states balanced: the same poles (per µs) and well-scaled entries.
/// For thesis (2-2): volumes count in units of (flow x 1 µs).
pub fn balance(a: &DMatrix<f64>) -> DMatrix<f64> {
    // Volume states come first and feed on flows by 1; only that block needs scaling.
    let n = a.nrows();
    let volumes = (0..n).take_while(|&i| a[(i, i)] == 0.0).count();
    let scale = DVector::from_fn(n, |i, _| if i < volumes && volumes < n { 1e6 } else { 1.0 });
    DMatrix::from_fn(n, n, |i, j| a[(i, j)] * scale[i] / scale[j] * 1e-6)
}

/// Eigenvalues of A, 1/s.
pub fn eigenvalues(plant: &impl Plant) -> Vec<Complex<f64>> {
    balance(&plant.a())
        .complex_eigenvalues()
        .iter()
        .map(|z| z * 1e6)
        .collect()
}
