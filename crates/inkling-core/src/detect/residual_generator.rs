//! The fault detection filter, ready to run: the residual r of a signal's deviation, and its energy.
//!
//! In: the polynomials N(z)L(z) ([`super::null_space`], [`super::numerator`]) and alpha(z)
//! ([`super::poles`]); then per signal the deviation y - C e^{At} x_a_hat from what the healthy
//! model expects, N, counts. Out: r, N, counts, its energy, counts²·s, or its largest sample. thesis
//! r(y), e(r) (before (3-4)).
//!
//! r_k = sum of b_j d_(k-j) - sum of a_j r_(k-j), with b and a the coefficients of numerator and
//! denominator. Over N samples it is r = F d with a lower triangular Toeplitz matrix F of the impulse
//! response. The default statistic is another energy of it: [`super::sensitivity`].
//!
//! Departs: the thesis filters y and x_a_hat; from zero state one filter of y - y_hat does the same.

use super::DetectError;
use crate::processor::for_processor;
use serde::{Deserialize, Serialize};

/// The filter r = (numerator / denominator) (y - y_hat): finite coefficients in descending powers of
/// z, equal lengths, the denominator monic. Stability is not checked: method I's pair is marginal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ResidualGenerator {
    pub numerator: Vec<f64>,
    pub denominator: Vec<f64>,
    pub dt_s: f64,
}

/// Number of signals that are filtered side by side: one signal alone would wait for each sample.
pub const TOGETHER: usize = 8;

impl ResidualGenerator {
    pub fn new(
        numerator: Vec<f64>,
        denominator: Vec<f64>,
        dt_s: f64,
    ) -> Result<ResidualGenerator, DetectError> {
        let generator = ResidualGenerator { numerator, denominator, dt_s };
        generator.check()?;
        Ok(generator)
    }

    /// Whether the filter is what the type promises, as one that another process sent may not be.
    pub fn check(&self) -> Result<(), DetectError> {
        let ResidualGenerator { numerator, denominator, dt_s } = self;
        if !(*dt_s > 0.0 && dt_s.is_finite()) {
            let (what, must) = ("sample period, s,", "positive and finite");
            return Err(DetectError::BadNumber { what, value: *dt_s, must });
        }
        if numerator.len() != denominator.len() || numerator.is_empty() {
            let (numerator, denominator) = (numerator.len(), denominator.len());
            return Err(DetectError::UnequalDegrees { numerator, denominator });
        }
        for (what, p) in [("numerator", numerator), ("denominator", denominator)] {
            if let Some(index) = p.iter().position(|v| !v.is_finite()) {
                return Err(DetectError::NotFinite { what, index });
            }
        }
        match denominator[0] == 1.0 {
            true => Ok(()),
            false => Err(DetectError::NotMonic { value: denominator[0] }),
        }
    }

    pub fn degree(&self) -> usize {
        self.denominator.len() - 1
    }

    /// Writes the residual of a deviation, thesis r(y), from zero state, counts, into `residual`.
    pub fn filter(&self, deviation: &[f64], residual: &mut [f64]) {
        let mut out = residual.iter_mut();
        self.run(deviation, |r| out.next().into_iter().for_each(|place| *place = r));
    }

    pub fn residual(&self, deviation: &[f64]) -> Vec<f64> {
        let mut residual = vec![0.0; deviation.len()];
        self.filter(deviation, &mut residual);
        residual
    }

    /// Thesis e(r) before (3-4), counts²·s: dt sum r², where the text has the integral.
    pub fn energy(&self, deviation: &[f64]) -> f64 {
        let mut sum = 0.0;
        self.run(deviation, |r| sum += r * r);
        self.dt_s * sum
    }

    /// The energies of many signals, each with the bits of [`ResidualGenerator::energy`].
    /// `deviations`: `samples` counts of each signal, one signal after the other.
    pub fn energies(&self, deviations: &[f64], samples: usize) -> Vec<f64> {
        let rows: Vec<&[f64]> = deviations.chunks_exact(samples.max(1)).collect();
        let mut energies = Vec::with_capacity(rows.len());
        for rows in rows.chunks(TOGETHER) {
            // places without a signal repeat the last one
            let each = std::array::from_fn(|l| rows[l.min(rows.len() - 1)]);
            let mut state = vec![[0.0; TOGETHER]; self.degree() + 1];
            let sums = square_sums(&self.numerator, &self.denominator, &each, &mut state);
            energies.extend(sums[..rows.len()].iter().map(|sum| self.dt_s * sum));
        }
        energies
    }

    /// The largest |r|, counts: the other metric that thesis §3-2 names beside the energy.
    pub fn maximum(&self, deviation: &[f64]) -> f64 {
        let mut most = 0.0_f64;
        self.run(deviation, |r| most = most.max(r.abs()));
        most
    }

    pub fn impulse_response(&self, n: usize) -> Vec<f64> {
        let mut impulse = vec![0.0; n];
        impulse.iter_mut().take(1).for_each(|first| *first = 1.0);
        self.residual(&impulse)
    }

    /// F^T x for a column x of N numbers, by which residuals r = F d are projected on columns R:
    /// R^T r = (F^T R)^T d. F is Toeplitz: its transpose is F between two reversals.
    pub fn adjoint(&self, column: &[f64]) -> Vec<f64> {
        let reversed: Vec<f64> = column.iter().rev().copied().collect();
        let mut out = self.residual(&reversed);
        out.reverse();
        out
    }

    /// Runs the filter in direct form II transposed; `emit` gets every sample of the residual.
    fn run(&self, deviation: &[f64], mut emit: impl FnMut(f64)) {
        let (b, a) = (&self.numerator, &self.denominator);
        // state k holds what the samples so far add to the residual k + 1 samples ahead; the last one is 0
        let mut state = vec![0.0; a.len()];
        for &d in deviation {
            let r = b[0] * d + state[0];
            for k in 1..a.len() {
                state[k - 1] = state[k] + b[k] * d - a[k] * r;
            }
            emit(r);
        }
    }
}

for_processor! {
    /// The square sums of residuals, by the operations of [`ResidualGenerator::run`] in their order.
    /// `b`, `a`: numerator and denominator; `rows`: N counts each; `state`: 0, one for each of `a`.
    fn square_sums(
        b: &[f64],
        a: &[f64],
        rows: &[&[f64]; TOGETHER],
        state: &mut [[f64; TOGETHER]],
    ) -> [f64; TOGETHER] {
        let mut sums = [0.0; TOGETHER];
        let of_states = b[1..].iter().zip(&a[1..]);
        #[expect(clippy::needless_range_loop, reason = "sample k of each row")]
        for k in 0..rows[0].len() {
            let (mut d, mut r) = ([0.0; TOGETHER], [0.0; TOGETHER]);
            for l in 0..TOGETHER {
                d[l] = rows[l][k];
                r[l] = b[0] * d[l] + state[0][l];
                sums[l] += r[l] * r[l];
            }
            for (j, (b, a)) in of_states.clone().enumerate() {
                let next = state[j + 1];
                for l in 0..TOGETHER {
                    state[j][l] = next[l] + b * d[l] - a * r[l];
                }
            }
        }
        sums
    }
}

#[cfg(test)]
impl ResidualGenerator {
    /// Of the nominal ink channel, sampled every .78125 µs: degree 4, a resonance and two poles at 2e5 /s.
    pub(super) fn of_nominal(omega: f64) -> ResidualGenerator {
        use crate::detect::{null_space, poles};
        let (ink, dt_s) = (crate::model::InkChannel::NOMINAL, 0.78125e-6);
        let numerator = null_space::numerator_of(&ink, dt_s, 4).unwrap();
        let alpha = poles::resonance(omega, &[2e5, 2e5], dt_s).unwrap();
        ResidualGenerator::new(numerator, alpha, dt_s).unwrap()
    }

    /// The matrix F of r = F d, n x n, lower triangular Toeplitz.
    pub(super) fn matrix(&self, n: usize) -> nalgebra::DMatrix<f64> {
        let h = self.impulse_response(n);
        nalgebra::DMatrix::from_fn(n, n, |i, j| if i >= j { h[i - j] } else { 0.0 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::detect::null_space::tests::{DT_S, INK, decay};
    use crate::detect::poles;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    fn method_one(oscillations: f64) -> ResidualGenerator {
        ResidualGenerator::of_nominal(poles::resonance_of_oscillations(oscillations, 128, DT_S))
    }

    fn random_signal(seed: u64) -> Vec<f64> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        (0..128).map(|_| rng.random_range(-1000.0..1000.0)).collect()
    }

    /// The sum of |p - q|² relative to that of |q|².
    fn relative(p: &[f64], q: &[f64]) -> f64 {
        let difference: f64 = p.iter().zip(q).map(|(x, y)| (x - y) * (x - y)).sum();
        difference / q.iter().map(|y| y * y).sum::<f64>()
    }

    #[test]
    fn recursion_toeplitz_product_and_polynomial_division_agree() {
        let g = method_one(6.47);
        let d = random_signal(1);
        let r = g.residual(&d);
        let product = g.matrix(128) * nalgebra::DVector::from_column_slice(&d);
        assert!(relative(&r, product.as_slice()) < 1e-24);
        // Independent: impulse response by long division N / alpha, and a plain convolution.
        let mut rest = g.numerator.clone();
        rest.resize(128 + g.denominator.len(), 0.0);
        let mut h = vec![0.0; 128];
        for k in 0..128 {
            h[k] = rest[k];
            for (j, a) in g.denominator.iter().enumerate() {
                rest[k + j] -= h[k] * a;
            }
        }
        let convolved: Vec<f64> =
            (0..128).map(|k| (0..=k).map(|j| h[j] * d[k - j]).sum()).collect();
        assert!(relative(&r, &convolved) < 1e-22);
    }

    #[test]
    fn energy_and_maximum_are_those_of_the_residual() {
        let g = method_one(6.47);
        let d = random_signal(2);
        let r = g.residual(&d);
        let e = DT_S * r.iter().map(|x| x * x).sum::<f64>();
        assert!((g.energy(&d) - e).abs() <= 1e-15 * e);
        let most = g.maximum(&d);
        assert!(r.contains(&most) || r.contains(&-most), "one of the samples");
        assert!(r.iter().all(|x| x.abs() <= most));
    }

    #[test]
    fn energies_side_by_side_have_the_bits_of_each_alone_whatever_the_instructions() {
        let g = method_one(6.47);
        let signals: Vec<Vec<f64>> = (0..19).map(random_signal).collect();
        crate::processor::with_each_set(|| {
            for n in [0, 1, 8, 19] {
                let alone: Vec<f64> = signals[..n].iter().map(|d| g.energy(d)).collect();
                assert_eq!(g.energies(&signals[..n].concat(), 128), alone);
            }
        });
        assert!(g.energies(&[], 0).is_empty());
    }

    #[test]
    fn adjoint_is_the_transpose() {
        let g = method_one(6.47);
        let (d, x) = (random_signal(3), random_signal(4));
        let r = g.residual(&d);
        let dot = |p: &[f64], q: &[f64]| p.iter().zip(q).map(|(x, y)| x * y).sum::<f64>();
        let (left, right) = (dot(&x, &r), dot(&g.adjoint(&x), &d));
        assert!((left - right).abs() <= 1e-11 * (dot(&x, &x) * dot(&r, &r)).sqrt());
    }

    /// thesis (3-3a), on y itself: without y_hat the numerator alone has to remove the ring-down. From rest
    /// the first `degree` samples start the filter, so the test starts it from them instead: the numerator's
    /// output from its order on goes into 1 / alpha.
    #[test]
    fn a_healthy_ring_down_leaves_no_residual_energy_from_the_order_on() {
        for oscillations in [3.0, 6.47] {
            let g = method_one(oscillations);
            let y = decay(&INK);
            let n = g.degree();
            let annihilated: Vec<f64> =
                (n..y.len()).map(|k| (0..=n).map(|j| g.numerator[j] * y[k - j]).sum()).collect();
            let mut rings = g.clone();
            rings.numerator.fill(0.0);
            rings.numerator[0] = 1.0;
            let share = rings.energy(&annihilated) / (DT_S * y.iter().map(|v| v * v).sum::<f64>());
            assert!(share <= 1e-20, "n_o {oscillations}: {share:e}");
        }
    }
}
