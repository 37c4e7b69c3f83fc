//! A tile: [`LANES`] signals transposed to sample-major order, one signal in each *lane*, so that a
//! SIMD vector holds one sample of many signals: a filter is a recursion over samples.
//!
//! In: signals of one or several bursts, in any layout and sample format. Out, for
//! [`super::kernel`]: their deviations from the expected signal, sample by sample, lane by lane,
//! with their square norms, and the square sums of a filter's residuals.

use super::row_projection::{LANES, PHASES, Sample, tree};
use crate::burst::{Burst, Layout};
use crate::processor::for_processor;
use std::ops::Range;

/// Up to [`LANES`] signals, sample by sample. The values of lanes without a signal are unspecified.
#[derive(Debug, Default)]
pub struct Tile {
    /// Per sample that sample of every lane: counts, after `subtract` deviations.
    pub(super) values: Vec<Sample>,
    pub(super) lanes: usize,
    /// Per lane the relative drive, and K above the reference temperature.
    pub(super) drive: Sample,
    pub(super) warmer: Sample,
    /// Per lane the square norm of the deviation, counts²; set by `subtract`.
    pub(super) square_sum: Sample,
    signal: Vec<f64>,
}

impl Tile {
    /// Adds as many of a burst's rows as there is room for, and returns how many. `drive`, `warmer`:
    /// the burst's relative drive, and K above the reference temperature.
    pub fn push(&mut self, burst: &Burst, rows: Range<usize>, drive: f64, warmer: f64) -> usize {
        let n = burst.samples_per_channel as usize;
        if self.lanes == 0 {
            self.values.resize(n, [0.0; LANES]);
        }
        let lanes = self.lanes..LANES.min(self.lanes + rows.len());
        let rows = rows.start..rows.start + lanes.len();
        match burst.layout {
            Layout::SampleMajor => {
                for (k, sample) in self.values.iter_mut().enumerate() {
                    burst.copy_sample(k, rows.clone(), &mut sample[lanes.clone()]);
                }
            }
            Layout::ChannelMajor => {
                self.signal.resize(n, 0.0);
                for (row, lane) in rows.zip(lanes.clone()) {
                    burst.copy_signal(row, &mut self.signal);
                    for (sample, y) in self.values.iter_mut().zip(&self.signal) {
                        sample[lane] = *y as f32;
                    }
                }
            }
        }
        self.drive[lanes.clone()].fill(drive as f32);
        self.warmer[lanes.clone()].fill(warmer as f32);
        self.lanes = lanes.end;
        lanes.len()
    }

    pub fn is_full(&self) -> bool {
        self.lanes == LANES
    }

    pub fn empty(&mut self) {
        self.lanes = 0;
    }
}

for_processor! {
    /// Turns a tile's counts into deviations from drive times (expected + warmer times response), and
    /// stores their square norms. `expected`: N, counts; `response`: N, counts/K.
    pub(super) fn subtract(tile: &mut Tile, expected: &[f32], response: &[f32]) {
        let mut squares = [[0.0; LANES]; PHASES];
        let samples = tile.values.iter_mut().zip(expected.iter().zip(response));
        for (k, (sample, (e, slope))) in samples.enumerate() {
            let sum = &mut squares[k % PHASES];
            for l in 0..LANES {
                let d = sample[l] - tile.drive[l] * (e + tile.warmer[l] * slope);
                sum[l] += d * d;
                sample[l] = d;
            }
        }
        for l in 0..LANES {
            tile.square_sum[l] = tree(&squares.each_ref().map(|of| of[l]));
        }
    }
}

/// Number of lanes that are filtered together: as many as keep a filter's state in registers.
const TOGETHER: usize = 16;

/// Per lane the square sum of the deviation filtered by b/a from zero state, for filters of 1 to 8
/// poles. `b`: order + 1 coefficients, `a`: a_1 .. a_order.
pub fn energies(b: &[f32], a: &[f32], deviations: &[Sample], out: &mut Sample) {
    fn of<const ORDER: usize>(b: &[f32], a: &[f32], deviations: &[Sample], out: &mut Sample) {
        let fixed = |p: &[f32]| <[f32; ORDER]>::try_from(p).expect("as many as there are poles");
        energies_of(b[0], fixed(&b[1..]), fixed(a), deviations, out);
    }
    let orders = [of::<1>, of::<2>, of::<3>, of::<4>, of::<5>, of::<6>, of::<7>, of::<8>];
    orders[a.len() - 1](b, a, deviations, out);
}

for_processor! {
    /// Per lane the square sum of the filtered deviation, in direct form II transposed, in the same
    /// order of operations as `ResidualGenerator::run`. `fed_by`: b_1 .. b_order; `back`: a_1 ..
    /// a_order.
    fn energies_of<const ORDER: usize>(
        b_0: f32,
        fed_by: [f32; ORDER],
        back: [f32; ORDER],
        deviations: &[Sample],
        out: &mut Sample,
    ) {
        for (part, out) in out.as_chunks_mut::<TOGETHER>().0.iter_mut().enumerate() {
            let (mut state, mut sum) = ([[0.0; TOGETHER]; ORDER], [0.0; TOGETHER]);
            for sample in deviations {
                let d = &sample.as_chunks::<TOGETHER>().0[part];
                let r: [f32; TOGETHER] = std::array::from_fn(|l| b_0 * d[l] + state[0][l]);
                for k in 0..ORDER {
                    for l in 0..TOGETHER {
                        let fed = fed_by[k] * d[l];
                        let moved = if k + 1 < ORDER { state[k + 1][l] + fed } else { fed };
                        state[k][l] = moved - back[k] * r[l];
                    }
                }
                for l in 0..TOGETHER {
                    sum[l] += r[l] * r[l];
                }
            }
            *out = sum;
        }
    }
}
