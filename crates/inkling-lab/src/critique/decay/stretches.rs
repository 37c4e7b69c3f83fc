//! Stretches of time that models of decays are not fitted to, but judged on: every third of some twenty, so
//! that both parts hold large and small amplitudes.
//!
//! In: the length of decays. Out: which samples of every series are held out, as a predicate, as ranges, and
//! as a [`Noise`] in which they count for nothing, so that a fit in that noise does not see them.

use super::decays::Decays;
use super::fit::Noise;
use std::ops::Range;

/// A series is cut into so many stretches, and one of so many is held out.
const STRETCHES: usize = 20;
const EVERY: usize = 3;

#[derive(Clone, Copy, Debug)]
pub struct Stretches {
    /// Number of samples of a series, and of a stretch.
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

    /// White noise in which held-out samples count for nothing.
    pub fn noise(self, sds: &[f64]) -> Noise {
        let held_out = (0..self.samples).map(|k| self.is_held_out(k)).collect();
        Noise { held_out, ..Noise::white(sds) }
    }
}
