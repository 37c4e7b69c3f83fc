//! Log predictive densities: how probable a model makes each signal, its parameters being unknown.
//!
//! In: a [`Signal`] about a fitted model, in the population that its parameters are drawn from, and the [`Noise`]. Out:
//! the logarithm of each signal's density (nats), y ~ N(f, D + J S J^T). f: the model's output at the
//! population's mean; D: variances of the noise, one per sample; J: the Jacobian of the output by the decay's
//! parameters; S: their covariance in the population. J is taken at the signal's most probable parameters,
//! and f is extrapolated from there along J, since the output is not linear over per cents of frequency.
//!
//! `worth.rs` compares the densities of held-out signals with and without a cause. A line of random phase
//! becomes two more columns beside J, noise that grows with the signal changes D, and a jitter of the trigger
//! couples the signals of a burst ([`ln_densities_with_jitter`]). The sizes of these three are fitted by the
//! densities of training signals.

use super::held_out::Signal;
use super::matrices::{Matrix5, Vector5, floored};
use super::model::Model;
use inkling_core::model::free_decay::FREE;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use std::collections::BTreeMap;
use std::f64::consts::TAU;

#[derive(Clone, Copy, Debug, Default)]
pub struct Noise {
    /// How the variance grows with the signal; `None`: one variance for all samples.
    pub growth: Option<Growth>,
    /// `[omega, var]`: a spectral line of random phase at omega rad per signal length; var is the variance of
    /// the amplitude of its cosine, and also that of its sine, counts². `None`: no line.
    pub tone: Option<[f64; 2]>,
}

/// A variance that grows with the expected sample f as 1 + h f² / top, and whose mean over the training
/// signals is the model's.
#[derive(Clone, Copy, Debug)]
pub struct Growth {
    pub h: f64,
    /// Square of the largest expected sample of all training signals, and the mean square, counts².
    pub top: f64,
    pub mean: f64,
}

impl Growth {
    /// Variance at an expected sample, over the variance in the mean.
    fn at(self, expected: f64) -> f64 {
        let of = |square: f64| 1.0 + self.h * square / self.top;
        of(expected * expected) / of(self.mean)
    }
}

/// A Gaussian density of mean 0 and covariance V = D + A A^T, D diagonal, A of few columns.
struct Density {
    /// Diagonal of D^-1; 0 for a sample that does not count.
    weights: DVector<f64>,
    /// A, N x (FREE or FREE + 2).
    a: DMatrix<f64>,
    /// Cholesky factor of 1 + A^T D^-1 A.
    inner: Cholesky<f64, Dyn>,
}

impl Density {
    /// V^-1 x = D^-1 x - D^-1 A (1 + A^T D^-1 A)^-1 A^T D^-1 x, by Woodbury's identity.
    fn solve(&self, x: &DVector<f64>) -> DVector<f64> {
        let weighed = x.component_mul(&self.weights);
        let along = self.inner.solve(&self.a.tr_mul(&weighed));
        &weighed - (&self.a * along).component_mul(&self.weights)
    }

    /// ln density at x, over the samples that count. ln |V| = ln |D| + ln |1 + A^T D^-1 A|.
    fn ln(&self, x: &DVector<f64>) -> f64 {
        let counted = self.weights.iter().filter(|w| **w > 0.0);
        let ln_diagonal: f64 = counted.map(|w| (TAU / w).ln()).sum();
        let ln_inner: f64 =
            2.0 * self.inner.l_dirty().diagonal().iter().map(|l| l.ln()).sum::<f64>();
        -0.5 * (ln_diagonal + ln_inner + x.dot(&self.solve(x)))
    }
}

/// Derivative of the parameters by a shift in time, per signal length, of the model's mean decay: that is a decay of
/// the same rates with other amplitudes (a, b, c), so a small shift moves only these.
pub fn by_shift(model: &Model) -> Vector5 {
    let [sigma, omega, lambda] = [0, 1, 5].map(|j| model.decay()[j].exp());
    let (a, b, c) = (model.mean[2], model.mean[3], model.mean[4]);
    let moved = [0.0, 0.0, omega * b - sigma * a, -omega * a - sigma * b, -lambda * c];
    Vector5::from(moved).component_div(&model.scale())
}

impl Signal {
    /// The measured samples less what the model expects at the population's mean.
    fn off(&self) -> DVector<f64> {
        &self.residual + &self.tangent * self.about
    }

    /// Density of `off`, over those of the first `first` samples that count. `spread`: covariance of the
    /// parameters. `None`: a covariance is not positive definite.
    fn density(&self, noise: &Noise, spread: &Matrix5, first: usize) -> Option<Density> {
        let n = self.residual.len();
        let of = |k: usize, _| {
            let counts = if k < first { self.counts[k] } else { 0.0 };
            counts / (self.noise_var * noise.growth.map_or(1.0, |of| of.at(self.expected[k])))
        };
        let weights = DVector::from_fn(n, of);
        // A A^T = J S J^T with A = J times the Cholesky factor of S
        let root = floored(spread).cholesky()?.l();
        let columns = if noise.tone.is_some() { FREE + 2 } else { FREE };
        let mut a = (&self.tangent * root).resize_horizontally(columns, 0.0);
        // independent random amplitudes of the line's cosine and sine
        if let Some([omega, var]) = noise.tone {
            for k in 0..n {
                let (sin, cos) = (omega * k as f64 / n as f64).sin_cos();
                (a[(k, FREE)], a[(k, FREE + 1)]) = (cos * var.sqrt(), sin * var.sqrt());
            }
        }
        let weighed = DMatrix::from_fn(n, a.ncols(), |k, j| a[(k, j)] * weights[k]);
        let inner = DMatrix::identity(a.ncols(), a.ncols()) + a.tr_mul(&weighed);
        Some(Density { weights, inner: inner.cholesky()?, a })
    }

    /// ln p of all samples that count; NaN if there is no density.
    pub fn ln_density(&self, noise: &Noise) -> f64 {
        self.density(noise, &self.spread, usize::MAX).map_or(f64::NAN, |d| d.ln(&self.off()))
    }

    /// ln p of all samples but the first, given the first one, in white noise. This can be compared with the
    /// density of the same signal after whitening, which loses the first sample.
    pub fn ln_density_after_first(&self) -> f64 {
        let plain = Noise::default();
        let first = self.density(&plain, &self.spread, 1).map_or(f64::NAN, |d| d.ln(&self.off()));
        self.ln_density(&plain) - first
    }
}

/// ln p of each signal where the trigger shifts all signals of a burst by the same random time of the given
/// `variance`, in squared signal lengths. The signals of a burst then have one joint density, the product of
/// their densities integrated over the shift; each signal gets an equal share of its logarithm. `noise`: as
/// found before the jitter; `shift`: as of [`by_shift`].
///
/// To second order in the shift d, ln of the product is `sum` + d score - d² information / 2. The integral
/// over d ~ N(0, variance) adds (variance score² / grown - ln grown) / 2.
pub fn ln_densities_with_jitter(
    all: &[Signal],
    noise: &Noise,
    shift: &Vector5,
    variance: f64,
) -> Vec<f64> {
    let mut bursts: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    all.iter().enumerate().for_each(|(i, s)| bursts.entry(s.burst).or_default().push(i));
    let mut ln = vec![f64::NAN; all.len()];
    for members in bursts.values() {
        // sum of the signals' ln densities without a shift; derivative of that sum by the shift at 0; and the
        // Fisher information of the shift
        let (mut sum, mut score, mut information) = (0.0, 0.0, 0.0);
        for signal in members.iter().map(|i| &all[*i]) {
            // The fitted covariance also holds what the common shift does to single signals. Subtract that
            // part here, since the shift is accounted for below.
            let own = signal.spread - shift * shift.transpose() * variance;
            let Some(density) = signal.density(noise, &own, usize::MAX) else { continue };
            let (off, along) = (signal.off(), &signal.tangent * shift);
            let solved = density.solve(&along);
            sum += density.ln(&off);
            score += solved.dot(&off);
            information += solved.dot(&along);
        }
        let grown = 1.0 + variance * information;
        sum += 0.5 * (variance * score * score / grown - grown.ln());
        members.iter().for_each(|i| ln[*i] = sum / members.len() as f64);
    }
    ln
}

#[cfg(test)]
mod tests {
    use super::super::generator::{Run, draw};
    use super::super::held_out::{population, signals};
    use super::*;

    /// Some signals, and the derivative by a shift.
    fn some() -> (Vec<Signal>, Vector5) {
        let data = draw(&Run { channels: 8, bursts: 6, ..Run::default() }, 5);
        let model = Model::fitted(&data, 2).unwrap();
        let all = signals(&model, &data, vec![population(&model, None); data.units]);
        (all, by_shift(&model))
    }

    /// Compares with the determinant and the inverse of the whole covariance.
    #[test]
    fn the_density_is_that_of_its_whole_covariance() {
        let signal = &some().0[3];
        let growth = Growth { h: 0.7, top: 9000.0, mean: 2000.0 };
        let noise = Noise { growth: Some(growth), tone: Some([60.0, 1.5]) };
        let n = signal.residual.len();
        let s = DMatrix::from_fn(FREE, FREE, |i, j| signal.spread[(i, j)]);
        let grown = |square: f64| 1.0 + 0.7 * square / 9000.0;
        let wave = |k: usize, l: usize| 1.5 * (60.0 * (k as f64 - l as f64) / n as f64).cos();
        let mut v = &signal.tangent * s * signal.tangent.transpose();
        v += DMatrix::from_fn(n, n, |k, l| {
            wave(k, l)
                + if k == l {
                    signal.noise_var * grown(signal.expected[k].powi(2)) / grown(2000.0)
                } else {
                    0.0
                }
        });
        let whole = v.cholesky().unwrap();
        let ln_det: f64 = 2.0 * whole.l().diagonal().iter().map(|l| l.ln()).sum::<f64>();
        let square = signal.off().dot(&whole.solve(&signal.off()));
        let right = -0.5 * (n as f64 * TAU.ln() + ln_det + square);
        let found = signal.ln_density(&noise);
        assert!((found - right).abs() < 1e-6 * right.abs(), "{found} {right}");
    }

    #[test]
    fn a_jitter_of_none_changes_nothing_and_one_signal_a_burst_hardly() {
        let (mut all, shift) = some();
        let noise = Noise::default();
        let sum = |ln: &[f64]| ln.iter().sum::<f64>();
        let plain: Vec<f64> = all.iter().map(|s| s.ln_density(&noise)).collect();
        let none = ln_densities_with_jitter(&all, &noise, &shift, 0.0);
        assert!((sum(&none) - sum(&plain)).abs() < 1e-6);
        // a shift that only one signal has in common is its own: it is taken from its scatter and given back
        all.iter_mut().enumerate().for_each(|(i, s)| s.burst = i);
        let ln = ln_densities_with_jitter(&all, &noise, &shift, 1e-9);
        for (one, plain) in ln.iter().zip(&plain) {
            assert!((one - plain).abs() < 1e-3, "{one} {plain}");
        }
    }
}
