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

pub struct Stretches {
    samples: usize,
    pub length: usize,
    /// The ranges of samples that models are fitted to, and those between them.
    pub fitted: Vec<Range<usize>>,
    pub held_out: Vec<Range<usize>>,
}

impl Stretches {
    pub fn of(decays: &Decays) -> Stretches {
        let samples = decays.samples;
        let length = samples.div_ceil(STRETCHES).max(2);
        // from and to are counted in stretches
        let ranges = |from: usize, to: usize| -> Vec<Range<usize>> {
            let all = (0..samples).step_by(EVERY * length);
            let part = |at| samples.min(at + from * length)..samples.min(at + to * length);
            all.map(part).filter(|range| !range.is_empty()).collect()
        };
        let (fitted, held_out) = (ranges(0, EVERY - 1), ranges(EVERY - 1, EVERY));
        Stretches { samples, length, fitted, held_out }
    }

    pub fn noise(&self, sds: &[f64]) -> Noise {
        let mut held_out = vec![false; self.samples];
        self.held_out.iter().for_each(|range| held_out[range.clone()].fill(true));
        Noise { held_out, ..Noise::white(sds) }
    }
}
