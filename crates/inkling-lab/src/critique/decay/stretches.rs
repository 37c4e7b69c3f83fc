//! Stretches of time that models of decays are not fitted to, and judged on: every third of some twenty.

use super::decays::Decays;
use super::fit::Noise;
use std::ops::Range;

const STRETCHES: usize = 20;
/// Of so many stretches one is held out.
const EVERY: usize = 3;

/// Samples of each series, in stretches of one length.
#[derive(Clone, Copy, Debug)]
pub struct Stretches {
    samples: usize,
    pub length: usize,
}

impl Stretches {
    pub fn of(decays: &Decays) -> Stretches {
        Stretches { samples: decays.samples, length: decays.samples.div_ceil(STRETCHES).max(2) }
    }

    pub fn is_held_out(self, sample: usize) -> bool {
        (sample / self.length) % EVERY == EVERY - 1
    }

    /// The samples of each stretch that is held out.
    pub fn held_out(self) -> impl Iterator<Item = Range<usize>> {
        self.parts(EVERY - 1, EVERY)
    }

    /// The samples between them.
    pub fn fitted(self) -> impl Iterator<Item = Range<usize>> {
        self.parts(0, EVERY - 1)
    }

    fn parts(self, first: usize, end: usize) -> impl Iterator<Item = Range<usize>> {
        let Stretches { samples, length } = self;
        let rounds = (0..samples).step_by(EVERY * length);
        let range = move |at: usize| at + first * length..(at + end * length).min(samples);
        rounds.map(range).filter(|range| !range.is_empty())
    }

    /// White noise of so many counts in each output, in which what is held out counts for nothing.
    pub fn noise(self, sds: &[f64]) -> Noise {
        let held_out = (0..self.samples).map(|k| self.is_held_out(k)).collect();
        Noise { held_out, ..Noise::white(sds) }
    }
}
