//! Stretches of time that models of decays are not fitted to, but judged on: every third of some twenty.

use super::decays::Decays;
use super::fit::Noise;
use std::ops::Range;

/// Number of stretches that a series is cut into.
const STRETCHES: usize = 20;
/// One of so many stretches is held out.
const EVERY: usize = 3;

/// The samples of each series, cut into stretches of one length.
#[derive(Clone, Copy, Debug)]
pub struct Stretches {
    samples: usize,
    pub length: usize,
}

impl Stretches {
    pub fn of(decays: &Decays) -> Stretches {
        Stretches { samples: decays.samples, length: decays.samples.div_ceil(STRETCHES).max(2) }
    }

    /// Whether models are not fitted to a sample.
    pub fn is_held_out(self, sample: usize) -> bool {
        (sample / self.length) % EVERY == EVERY - 1
    }

    /// The range of samples of each stretch that is held out.
    pub fn held_out(self) -> impl Iterator<Item = Range<usize>> {
        self.parts(EVERY - 1, EVERY)
    }

    /// The ranges of samples between these.
    pub fn fitted(self) -> impl Iterator<Item = Range<usize>> {
        self.parts(0, EVERY - 1)
    }

    /// The stretches `first` to `end` (excluded) of every round of [`EVERY`].
    fn parts(self, first: usize, end: usize) -> impl Iterator<Item = Range<usize>> {
        let Stretches { samples, length } = self;
        let rounds = (0..samples).step_by(EVERY * length);
        let range = move |at: usize| at + first * length..(at + end * length).min(samples);
        rounds.map(range).filter(|range| !range.is_empty())
    }

    /// White noise with the given standard deviation in each output, in which held-out samples count for
    /// nothing.
    pub fn noise(self, sds: &[f64]) -> Noise {
        let held_out = (0..self.samples).map(|k| self.is_held_out(k)).collect();
        Noise { held_out, ..Noise::white(sds) }
    }
}
