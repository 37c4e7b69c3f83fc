//! Free decays of a channel from its acquisition state, sample by sample: y_k = C A_d^k x_a.
//!
//! In: matrices or rates of a channel, x_a, the sample period. Out: samples in the unit of x_a
//! (counts). A_d = e^{A dt} is the exact discretisation. [`ring_down_into`] is for simulation, with
//! millions of signals; [`discretise`] is for the design of filters, and serves any plant.

use super::InkChannel;
use nalgebra::{DMatrix, DVector, Vector4};

/// One damped pair and one real pole of rate lambda; all of them decay where these are positive.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Poles {
    pub damping_per_s: f64,
    /// Damped frequency of the pair, Hz.
    pub frequency_hz: f64,
    pub lambda_per_s: f64,
}

/// Scales that bring A's entries, which differ by 12 decades in SI units, to a similar size in
/// microseconds: a volume, told by a 0 on A's diagonal, is counted in flow x 1 µs. `a`: n x n, 1/s.
fn microsecond_scales(a: &DMatrix<f64>) -> DVector<f64> {
    DVector::from_fn(a.nrows(), |i, _| if a[(i, i)] == 0.0 { 1e6 } else { 1.0 })
}

/// (A, C) in microseconds, with states of similar size. `a`: n x n, 1/s; `c`: m x n.
pub fn in_microseconds(a: &DMatrix<f64>, c: &DMatrix<f64>) -> (DMatrix<f64>, DMatrix<f64>) {
    let s = microsecond_scales(a);
    let a_us = DMatrix::from_fn(a.nrows(), a.ncols(), |i, j| a[(i, j)] * s[i] / s[j] * 1e-6);
    let c_us = DMatrix::from_fn(c.nrows(), c.ncols(), |i, j| c[(i, j)] / s[j]);
    (a_us, c_us)
}

/// A_d = e^{A dt}, in the coordinates of A. `a`: n x n, 1/s.
pub fn discretise(a: &DMatrix<f64>, dt_s: f64) -> DMatrix<f64> {
    let s = microsecond_scales(a);
    let (a_us, _) = in_microseconds(a, &DMatrix::zeros(0, a.ncols()));
    let a_d = (a_us * (dt_s * 1e6)).exp();
    DMatrix::from_fn(a.nrows(), a.ncols(), |i, j| a_d[(i, j)] * s[j] / s[i])
}

#[cfg(test)]
pub fn eigenvalues(plant: &InkChannel) -> Vec<nalgebra::Complex<f64>> {
    let (a_us, _) = in_microseconds(&plant.a(), &plant.c());
    a_us.complex_eigenvalues().iter().map(|z| z * 1e6).collect()
}

/// The free decay y_k = C A_d^k x_a for k = 0..samples.
#[cfg(test)]
pub fn ring_down(plant: &InkChannel, x_a: &DVector<f64>, dt_s: f64, samples: usize) -> Vec<f64> {
    let (a_d, c) = (discretise(&plant.a(), dt_s), plant.c());
    let mut x = x_a.clone();
    let mut y = Vec::with_capacity(samples);
    for _ in 0..samples {
        y.push((&c * &x)[0]);
        x = &a_d * x;
    }
    y
}

/// Writes the free decay y_k = V_r' + V_n' at the time k dt_s to `out`, without allocation. `x_a`:
/// V_r, V_n, V_r', V_n', times whatever gain y shall have.
pub fn ring_down_into(channel: &InkChannel, x_a: &Vector4<f64>, dt_s: f64, out: &mut [f64]) {
    let a_d = channel.transition(dt_s);
    let mut x = *x_a;
    for y in out {
        *y = x[2] + x[3];
        x = a_d * x;
    }
}

#[cfg(test)]
impl InkChannel {
    /// y, y', y'' of a state, from thesis (2-2).
    pub fn output_state(&self, x: [f64; 4]) -> [f64; 3] {
        let InkChannel { a_per_s2: a, b_per_s2: b, g_per_s: g, d_per_s: d } = *self;
        let volume = x[0] + x[1];
        let flows = [-a * volume - g * x[2], -b * volume - d * x[3]];
        let y = x[2] + x[3];
        [y, flows[0] + flows[1], -(a + b) * y - g * flows[0] - d * flows[1]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_path_for_millions_equals_ring_down() {
        let nominal = InkChannel::NOMINAL;
        let blocked = InkChannel { b_per_s2: 5.5e8, d_per_s: 1.6e7, ..nominal };
        for channel in [nominal, blocked] {
            let x_a = Vector4::new(2e-4, -7e-4, 130.0, 270.0);
            let slow =
                ring_down(&channel, &DVector::from_column_slice(x_a.as_slice()), 0.78125e-6, 128);
            let mut fast = vec![0.0; 128];
            ring_down_into(&channel, &x_a, 0.78125e-6, &mut fast);
            let peak = slow.iter().fold(0.0_f64, |m, y| m.max(y.abs()));
            for (y, expected) in fast.iter().zip(&slow) {
                assert!((y - expected).abs() < 1e-9 * peak);
            }
        }
    }
}
