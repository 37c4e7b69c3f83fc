//! The expected signal in f32, and a bound on the rounding error of deviations from it. Both
//! streaming kernels share it.
//!
//! In: a model's expected signal and its response to temperature (f64), once; then tiles of signals
//! ([`super::kernel`]), or conditions, that is drive and temperature ([`super::lane_sensitivity`]).
//! Out: the signals' deviations d^ = y - drive (expected + warmer response), in place, or the
//! expected signal at a condition; and the parts of the bound of [`super::kernel`] that come from
//! it:
//!
//! * |d^ - d| <= u |d^| + error, with error = 6 u drive (|y_hat| + warmer |response|);
//! * a proof that no sample is saturated: a sample at a rail deviates by at least `room`, and no
//!   sample deviates by more than the norm of the whole deviation.

use super::row_projection::{Phases, in_phases};
use super::tile::{Tile, subtract};

/// Unit roundoff of f32.
pub(super) const U: f64 = 1.0 / (1u64 << 24) as f64;
/// Factor on bounds for what they neglect: terms of second order, and the reference's own rounding.
pub(super) const SLACK: f64 = 1.01;
/// Sums of squares below this may have lost digits to underflow, and are not trusted.
pub(super) const LEAST: f32 = 1e-28;

/// The same numbers rounded to f32.
pub(super) fn twin(of: &[f64]) -> Vec<f32> {
    of.iter().map(|&x| x as f32).collect()
}

/// Whether f32 holds all of these numbers with full relative precision, and products of two of them
/// nearly so: each is 0 or of a size from 1e-25 to 1e25.
pub(super) fn fits(of: &[f64]) -> bool {
    of.iter().all(|&x| x == 0.0 || (1e-25..1e25).contains(&x.abs()))
}

/// The Euclidean norm of a vector.
pub(super) fn norm(of: &[f64]) -> f64 {
    of.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// The expected signal at any drive and temperature, in f32.
#[derive(Clone, Debug)]
pub struct LaneExpectation {
    /// y_hat at the reference drive and temperature, counts, and its derivative by temperature,
    /// counts/K; N samples each.
    expected: Vec<f32>,
    response: Vec<f32>,
    /// Norms and largest magnitudes of `expected` and `response`, in this order, counts and
    /// counts/K.
    norms: [f64; 2],
    largest: [f64; 2],
}

/// The norm |d^| of a lane's deviation, and that part of the bound on |d^ - d| which is due to the
/// rounding of the expected signal; both in counts.
#[derive(Clone, Copy, Debug)]
pub struct Deviation {
    pub norm: f64,
    pub error: f64,
}

impl LaneExpectation {
    /// The f32 form of an expected signal and its response to temperature (absent: 0). `None`: f32 cannot
    /// serve, because a number is out of its range or the lengths differ.
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

    /// Number of samples of a signal.
    pub fn samples(&self) -> usize {
        self.expected.len()
    }

    /// Turns the signals of `tile` into deviations, and stores the deviations' square norms in the
    /// tile.
    pub fn subtract(&self, tile: &mut Tile) {
        subtract(tile, &self.expected, &self.response);
    }

    /// The expected signal at a relative drive and `warmer` K above the reference, rounded in the same way as
    /// by `subtract`.
    pub fn at(&self, drive: f32, warmer: f32) -> Vec<Phases> {
        let each = self.expected.iter().zip(&self.response);
        in_phases(each.map(|(e, slope)| drive * (e + warmer * slope)))
    }

    /// The norm and error of a lane's deviation, after `subtract` was called with the tile. `None`:
    /// f32 cannot settle the signal, because its square norm is out of f32's range or NaN, or
    /// because a sample may lie at one of the `rails` (least and greatest count).
    pub fn deviation(&self, tile: &Tile, lane: usize, rails: [f64; 2]) -> Option<Deviation> {
        let square = tile.square_sum[lane];
        // a NaN is not trusted, since both comparisons are false for it
        let trusted = square > LEAST && square < f32::INFINITY;
        let norm = f64::from(square).sqrt();
        let (drive, warmer) = (tile.drive[lane], tile.warmer[lane]);
        // No sample deviates by more than the norm, so with a norm below the room none can lie at a
        // rail. One count and the slack are added for rounding.
        let inside = SLACK * norm + 1.0 < self.room(drive, warmer, rails);
        let error = self.error_at(drive, warmer);
        (trusted && inside).then_some(Deviation { norm, error })
    }

    /// The smallest deviation, counts, that a sample at one of the `rails` can have: the distance
    /// from 0 to the nearer rail, less the largest sample that can be expected. Negative: every
    /// sample may lie at a rail. `rails`: the first is negative.
    pub fn room(&self, drive: f32, warmer: f32, rails: [f64; 2]) -> f64 {
        let (drive, warmer) = (f64::from(drive.abs()), f64::from(warmer.abs()));
        rails[1].min(-rails[0]) - drive * (self.largest[0] + warmer * self.largest[1])
    }

    /// [`Deviation::error`] at a relative drive and `warmer` K above the reference. On its way into
    /// the deviation the response is rounded six times: drive, warmer and response themselves, two
    /// products and a sum.
    pub fn error_at(&self, drive: f32, warmer: f32) -> f64 {
        let (drive, warmer) = (f64::from(drive.abs()), f64::from(warmer.abs()));
        6.0 * U * drive * (self.norms[0] + warmer * self.norms[1])
    }

    /// [`Deviation::error`] at the reference drive and temperature.
    #[cfg(test)]
    pub(super) fn error(&self) -> f64 {
        6.0 * U * self.norms[0]
    }
}
