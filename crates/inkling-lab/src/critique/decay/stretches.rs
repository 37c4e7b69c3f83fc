//! Stretches of time that models of decays are not fitted to, but judged on: every third of some twenty, so
//! that both parts hold large and small amplitudes.
//!
//! Samples held out count for nothing in the [`Noise`] that `noise` makes, so a fit does not see them.

use super::decays::Decays;
use super::noise::Noise;
use std::ops::Range;

/// A series is cut into so many stretches, and one of so many is held out.
const STRETCHES: usize = 20;
const EVERY: usize = 3;

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

    /// The ranges of samples that are held out, or those between them.
    pub fn ranges(self, held_out: bool) -> Vec<Range<usize>> {
        let all: Vec<usize> = (0..self.samples).collect();
        let alike = |p: &usize, q: &usize| self.is_held_out(*p) == self.is_held_out(*q);
        let parts = all.chunk_by(alike).filter(|part| self.is_held_out(part[0]) == held_out);
        parts.map(|part| part[0]..part[0] + part.len()).collect()
    }

    pub fn noise(self, sds: &[f64]) -> Noise {
        let held_out = (0..self.samples).map(|k| self.is_held_out(k)).collect();
        Noise { held_out, ..Noise::white(sds) }
    }
}
