//! The expected signal in f32, and a bound on the rounding error of deviations from it, for
//! [`super::lane_sensitivity`].
//!
//! In: a model's expected signal y_hat and its response to temperature (f64), once; then conditions:
//! the relative drive, and `warmer` K above the reference. Out, with u = 2^-24, a deviation d and
//! the d^ that f32 computes:
//!
//! * |d^ - d| <= u |d^| + error, with error = 6 u drive (|y_hat| + warmer |response|);
//! * a proof that no sample is saturated: a sample at a rail deviates by at least `room`, and no
//!   sample deviates by more than the norm of the whole deviation.

use super::row_projection::{Phases, in_phases};

pub(super) const U: f64 = 1.0 / (1u64 << 24) as f64;
/// Factor on bounds for what they neglect: terms of second order, and the reference's own rounding.
pub(super) const SLACK: f64 = 1.01;
/// Sums of squares below this may have lost digits to underflow, and are not trusted.
pub(super) const LEAST: f32 = 1e-28;

fn twin(of: &[f64]) -> Vec<f32> {
    of.iter().map(|&x| x as f32).collect()
}

/// Whether f32 holds these numbers, and products of two of them, with full relative precision.
pub(super) fn fits(of: &[f64]) -> bool {
    of.iter().all(|&x| x == 0.0 || (1e-25..1e25).contains(&x.abs()))
}

pub(super) fn norm(of: &[f64]) -> f64 {
    of.iter().map(|x| x * x).sum::<f64>().sqrt()
}

#[derive(Clone, Debug)]
pub struct LaneExpectation {
    /// y_hat at the reference, N, counts, and its derivative by temperature, N, counts/K.
    expected: Vec<f32>,
    response: Vec<f32>,
    norms: [f64; 2],
    largest: [f64; 2],
}

impl LaneExpectation {
    /// `response`: absent: 0. `None`: a number is out of f32's range or the lengths differ.
    pub fn new(expected: &[f64], response: Option<&[f64]>) -> Option<LaneExpectation> {
        let zeros = vec![0.0; expected.len()];
        let response = response.unwrap_or(&zeros);
        let usable = !expected.is_empty()
            && response.len() == expected.len()
            && expected.iter().chain(response).all(|x| x.abs() < 1e25);
        let largest = |v: &[f64]| v.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
        usable.then(|| LaneExpectation {
            expected: twin(expected),
            response: twin(response),
            norms: [norm(expected), norm(response)],
            largest: [largest(expected), largest(response)],
        })
    }

    pub fn samples(&self) -> usize {
        self.expected.len()
    }

    pub fn at(&self, drive: f32, warmer: f32) -> Vec<Phases> {
        let each = self.expected.iter().zip(&self.response);
        in_phases(each.map(|(e, slope)| drive * (e + warmer * slope)))
    }

    /// The smallest deviation, counts, of a sample at one of the `rails`.
    pub fn room(&self, drive: f32, warmer: f32, rails: [f64; 2]) -> f64 {
        let (drive, warmer) = (f64::from(drive.abs()), f64::from(warmer.abs()));
        rails[1].min(-rails[0]) - drive * (self.largest[0] + warmer * self.largest[1])
    }

    /// The `error` of the header, counts: six roundings.
    pub fn error_at(&self, drive: f32, warmer: f32) -> f64 {
        let (drive, warmer) = (f64::from(drive.abs()), f64::from(warmer.abs()));
        6.0 * U * drive * (self.norms[0] + warmer * self.norms[1])
    }
}
