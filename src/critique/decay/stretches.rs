//! Stretches of time that models of decays are not fitted to, and judged on: every third of some twenty.

use super::fit::Noise;
use super::plant::Decays;
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
        (sample / self.length) % EVERY == 2
    }

    /// The samples of each stretch, held out or not.
    pub fn ranges(self, held_out: bool) -> impl Iterator<Item = Range<usize>> {
        let starts = (0..self.samples).step_by(self.length);
        starts
            .filter(move |start| self.is_held_out(*start) == held_out)
            .map(move |start| start..(start + self.length).min(self.samples))
    }

    /// White noise of so many counts in each output, in which what is held out counts for nothing.
    pub fn noise(self, sds: &[f64]) -> Noise {
        let held_out = (0..self.samples).map(|k| self.is_held_out(k)).collect();
        Noise { held_out, ..Noise::white(sds) }
    }
}
