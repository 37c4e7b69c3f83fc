//! The damped cosine that is nearest to an average signal: it tells the signal's own time scale.
//! In: the average (N counts). Out: frequency and misfit of the best damped cosine plus constant, and the constant.
//! For `grey_box` the frequency sets the scale at which the search of thesis (3-1) starts, and the
//! misfit is the yardstick that the identified model must at least match. Of the guessed rates only
//! the ratios then matter, as a prior for what one decay does not determine.
//!
//! At each frequency and damping of a grid, cosine, sine and constant are fitted by least squares.
//! Dampings are computed side by side, one in each SIMD lane.

use super::GreyBoxSettings;
use super::cubic::poles_of;
use crate::model::inner_product::dot;
use crate::processor::for_processor;
use nalgebra::{Matrix3, Vector3};

#[derive(Clone, Copy, Debug)]
pub struct DampedCosine {
    pub frequency_hz: f64,
    /// The constant beside it, counts.
    pub constant: f64,
    /// Counts.
    pub misfit_rms: f64,
}

/// The lowest frequency of the grid, in cycles per signal, and the highest, in cycles per sample.
const FEWEST_CYCLES: f64 = 1.5;
const MOST_PER_SAMPLE: f64 = 0.3;
/// Dampings of the grid, per signal length, and the step of its frequencies, in cycles per signal.
const DAMPINGS: [f64; 4] = [0.5, 1.5, 3.0, 6.0];
const STEP: f64 = 0.2;
const MOST_STEPS: usize = 2000;

/// `y`: N, counts. `None`: the signal is too short, or not finite.
pub fn damped_cosine(y: &[f64], dt_s: f64) -> Option<DampedCosine> {
    // in cycles per signal; of long signals the steps are wider than STEP
    let n = y.len();
    let most = MOST_PER_SAMPLE * n as f64;
    let step = STEP.max((most - FEWEST_CYCLES) / MOST_STEPS as f64);
    let (square, sum) = (dot(y, y), y.iter().sum::<f64>());
    let decays = DAMPINGS.map(|damping| (-damping / n as f64).exp());

    let mut best: Option<(f64, f64, f64)> = None;
    let mut cycles = FEWEST_CYCLES;
    while cycles < most {
        let (sin, cos) = (std::f64::consts::TAU * cycles / n as f64).sin_cos();
        let sums = sums(y, decays.map(|d| sin * d), decays.map(|d| cos * d));
        for lane in 0..DAMPINGS.len() {
            let [rr, ri, ii, r, i, ry, iy] = sums.map(|sum| sum[lane]);
            let gram = Matrix3::new(rr, ri, r, ri, ii, i, r, i, n as f64);
            let product = Vector3::new(ry, iy, sum);
            let Some(inverse) = gram.try_inverse() else { continue };
            let fitted = inverse * product;
            let left = square - product.dot(&fitted);
            if left.is_finite() && best.is_none_or(|(least, ..)| left < least) {
                best = Some((left, cycles, fitted[2]));
            }
        }
        cycles += step;
    }
    let (left, cycles, constant) = best?;
    Some(DampedCosine {
        frequency_hz: cycles / (n as f64 * dt_s),
        constant,
        misfit_rms: (left.max(0.0) / n as f64).sqrt(),
    })
}

type Lanes = [f64; DAMPINGS.len()];

for_processor! {
    /// For each damping the sums over a signal of re re, re im, im im, re, im, re y, im y. The
    /// phasor (re, im) starts at (1, 0) and is multiplied by (cos, sin), which hold the decay.
    fn sums(y: &[f64], sin: Lanes, cos: Lanes) -> [Lanes; 7] { sums_of }
}

#[inline(always)] // compiled once per instruction set
fn sums_of(y: &[f64], sin: Lanes, cos: Lanes) -> [Lanes; 7] {
    let (mut re, mut im) = ([1.0; DAMPINGS.len()], [0.0; DAMPINGS.len()]);
    let mut sums = [[0.0; DAMPINGS.len()]; 7];
    for y in y {
        for l in 0..DAMPINGS.len() {
            let (r, i) = (re[l], im[l]);
            let terms = [r * r, r * i, i * i, r, i, r * y, i * y];
            for (sum, term) in sums.iter_mut().zip(terms) {
                sum[l] += term;
            }
            (re[l], im[l]) = (r * cos[l] - i * sin[l], r * sin[l] + i * cos[l]);
        }
    }
    sums
}

impl GreyBoxSettings {
    /// These settings with the guessed rates scaled in time such that the guessed channel rings at
    /// that frequency (if it rings at all); bounds of single rates stay.
    pub fn at_frequency(&self, frequency_hz: f64) -> GreyBoxSettings {
        let Some(poles) = poles_of(self.channel().cubic()) else { return self.clone() };
        let faster = frequency_hz / poles.frequency_hz;
        GreyBoxSettings {
            a_per_s2: self.a_per_s2 * faster * faster,
            b_per_s2: self.b_per_s2 * faster * faster,
            g_per_s: self.g_per_s * faster,
            d_per_s: self.d_per_s * faster,
            ..self.clone()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ring_of_any_rate_is_found() {
        for samples in [64, 128, 500] {
            for cycles in [3.1, 6.5, 12.0] {
                let dt_s = 3e-6;
                let y: Vec<f64> = (0..samples)
                    .map(|k| {
                        let t = k as f64 / samples as f64;
                        let angle = std::f64::consts::TAU * cycles * t + 0.7;
                        300.0 * (-2.9 * t).exp() * angle.cos() + 20.0 * (-3.7 * t).exp()
                    })
                    .collect();
                let found = damped_cosine(&y, dt_s).unwrap().frequency_hz;
                let truth = cycles / (samples as f64 * dt_s);
                assert!((found / truth - 1.0).abs() < 0.05, "{samples} {cycles}: {found} {truth}");
            }
        }
    }

    #[test]
    fn a_faster_channel_rings_faster_and_keeps_its_ratios() {
        let nominal = GreyBoxSettings::default();
        let faster = nominal.at_frequency(1e6);
        let ratio = |s: &GreyBoxSettings| [s.a_per_s2 / s.b_per_s2, s.g_per_s / s.d_per_s];
        assert!((ratio(&faster)[0] / ratio(&nominal)[0] - 1.0).abs() < 1e-12);
        assert!((ratio(&faster)[1] / ratio(&nominal)[1] - 1.0).abs() < 1e-12);
        let poles = poles_of(faster.channel().cubic()).unwrap();
        assert!((poles.frequency_hz / 1e6 - 1.0).abs() < 1e-9);
    }
}
