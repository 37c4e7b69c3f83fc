//! Inner products of many signals' deviations with a few columns, in f32, taken from the signals as
//! they lie in their bursts: one signal in each of 32 *lanes*.
//!
//! In: rows of a burst (one row is one channel's signal, N samples), the expected signal y_hat that
//! all of them share, and M columns p_j of N numbers. Out: per row the products p_j . (y - y_hat),
//! and the square norm |y - y_hat|², counts².
//!
//! # One number, whatever the machine
//!
//! Every lane and instruction set runs the same sequence of IEEE f32 operations: nothing is fused,
//! sample k is added to partial sum k mod 16, and the sixteen sums are added in a fixed order
//! (`tree`). So a number depends on no neighbour, number of workers or processor. Three loops do
//! the same sums in the order in which the memory lies.

use crate::burst::{Burst, Layout};
use crate::processor::for_processor;
use std::ops::Range;

pub const LANES: usize = 32;
pub type Sample = [f32; LANES];

pub const PHASES: usize = 16;
pub type Phases = [f32; PHASES];

/// Splits numbers into groups of sixteen, the last of which is padded with zeros.
pub fn in_phases(of: impl ExactSizeIterator<Item = f32>) -> Vec<Phases> {
    let mut phases = vec![[0.0; PHASES]; of.len().div_ceil(PHASES)];
    for (k, v) in of.enumerate() {
        phases[k / PHASES][k % PHASES] = v;
    }
    phases
}

#[inline(always)]
fn tree(of: &Phases) -> f32 {
    let eight: [f32; 8] = std::array::from_fn(|l| of[l] + of[l + 8]);
    let four: [f32; 4] = std::array::from_fn(|l| eight[l] + eight[l + 4]);
    (four[0] + four[2]) + (four[1] + four[3])
}

#[derive(Clone, Debug)]
pub struct Columns<const M: usize> {
    n: usize,
    /// Per group of sixteen samples the part of each column.
    groups: Vec<[Phases; M]>,
}

impl<const M: usize> Columns<M> {
    pub fn new(of: &[Vec<f64>; M]) -> Columns<M> {
        let columns = of.each_ref().map(|column| in_phases(column.iter().map(|&p| p as f32)));
        let group = |i: usize| columns.each_ref().map(|column| column[i]);
        Columns { n: of[0].len(), groups: (0..columns[0].len()).map(group).collect() }
    }

    /// Projects at most [`LANES`] rows of a burst on the columns, into the first lanes of `out`.
    /// `expected`: the expected signal that all rows share, counts; `room`: buffers.
    pub fn project(
        &self,
        (burst, rows): (&Burst, Range<usize>),
        expected: &[Phases],
        out: &mut Projections<M>,
        room: &mut Room,
    ) {
        let groups = (expected, self.groups.as_slice());
        if let Some(samples) = burst.int16_rows(rows.start, rows.len()) {
            project_int16(samples, self.n, groups, out);
            return;
        }
        match burst.layout {
            Layout::SampleMajor => {
                room.samples.resize(self.n, [0.0; LANES]);
                for (k, sample) in room.samples.iter_mut().enumerate() {
                    burst.copy_sample(k, rows.clone(), &mut sample[..rows.len()]);
                }
                project_samples(&room.samples, groups, rows.len(), out);
            }
            Layout::ChannelMajor => {
                room.signal.resize(self.n, 0.0);
                for (lane, row) in rows.enumerate() {
                    burst.copy_signal(row, &mut room.signal);
                    project_f64(&room.signal, groups, lane, out);
                }
            }
        }
    }
}

#[derive(Clone, Debug)]
pub struct Projections<const M: usize> {
    pub products: [Sample; M],
    pub squares: Sample,
}

impl<const M: usize> Default for Projections<M> {
    fn default() -> Projections<M> {
        Projections { products: [[0.0; LANES]; M], squares: [0.0; LANES] }
    }
}

#[derive(Default)]
pub struct Room {
    signal: Vec<f64>,
    samples: Vec<Sample>,
}

/// The expected signal and the columns, both in groups of sixteen samples.
type Groups<'a, const M: usize> = (&'a [Phases], &'a [[Phases; M]]);

for_processor! {
    /// `samples`: rows of `n` little-endian int16.
    fn project_int16<const M: usize>(
        samples: &[u8],
        n: usize,
        groups: Groups<'_, M>,
        out: &mut Projections<M>,
    ) {
        let (expected, columns) = groups;
        let counts = |of: &[u8; 2 * PHASES]| -> Phases {
            std::array::from_fn(|l| f32::from(i16::from_le_bytes([of[2 * l], of[2 * l + 1]])))
        };
        for (lane, row) in samples.chunks_exact(2 * n).enumerate() {
            let (wholes, rest) = row.as_chunks();
            let mut sums = Sums::default();
            for ((whole, y_hat), p) in wholes.iter().zip(expected).zip(columns) {
                sums.add(&counts(whole), y_hat, p);
            }
            if let ([.., y_hat], [.., p], false) = (expected, columns, rest.is_empty()) {
                // the zeros that pad the last group meet zeros of the expected signal and the columns
                let mut last = [0; 2 * PHASES];
                last[..rest.len()].copy_from_slice(rest);
                sums.add(&counts(&last), y_hat, p);
            }
            sums.end(lane, out);
        }
    }
}

for_processor! {
    fn project_f64<const M: usize>(
        signal: &[f64],
        groups: Groups<'_, M>,
        lane: usize,
        out: &mut Projections<M>,
    ) {
        let (expected, columns) = groups;
        let mut sums = Sums::default();
        for ((some, y_hat), p) in signal.chunks(PHASES).zip(expected).zip(columns) {
            let counts = std::array::from_fn(|l| some.get(l).map_or(0.0, |y| *y as f32));
            sums.add(&counts, y_hat, p);
        }
        sums.end(lane, out);
    }
}

for_processor! {
    /// `samples[k]` holds sample k of all signals; `lanes`: how many there are.
    fn project_samples<const M: usize>(
        samples: &[Sample],
        groups: Groups<'_, M>,
        lanes: usize,
        out: &mut Projections<M>,
    ) {
        let (expected, columns) = groups;
        let mut squares = [[0.0; LANES]; PHASES];
        let mut products = [[[0.0; LANES]; PHASES]; M];
        for phase in 0..PHASES {
            let (mut square, mut product) = ([0.0; LANES], [[0.0; LANES]; M]);
            let samples = samples.iter().skip(phase).step_by(PHASES);
            for (counts, (y_hat, p)) in samples.zip(expected.iter().zip(columns)) {
                for l in 0..LANES {
                    let d = counts[l] - y_hat[phase];
                    square[l] += d * d;
                    for j in 0..M {
                        product[j][l] += p[j][phase] * d;
                    }
                }
            }
            squares[phase] = square;
            (0..M).for_each(|j| products[j][phase] = product[j]);
        }
        for lane in 0..lanes {
            out.squares[lane] = tree(&squares.each_ref().map(|of| of[lane]));
            for (out, of_column) in out.products.iter_mut().zip(&products) {
                out[lane] = tree(&of_column.each_ref().map(|of| of[lane]));
            }
        }
    }
}

struct Sums<const M: usize> {
    products: [Phases; M],
    squares: Phases,
}

impl<const M: usize> Default for Sums<M> {
    #[inline(always)]
    fn default() -> Sums<M> {
        Sums { products: [[0.0; PHASES]; M], squares: [0.0; PHASES] }
    }
}

impl<const M: usize> Sums<M> {
    #[inline(always)] // compiled once per instruction set
    fn add(&mut self, counts: &Phases, expected: &Phases, p: &[Phases; M]) {
        let d: Phases = std::array::from_fn(|l| counts[l] - expected[l]);
        for (square, d) in self.squares.iter_mut().zip(&d) {
            *square += d * d;
        }
        for (product, p) in self.products.iter_mut().zip(p) {
            for l in 0..PHASES {
                product[l] += p[l] * d[l];
            }
        }
    }

    #[inline(always)] // compiled once per instruction set
    fn end(&self, lane: usize, out: &mut Projections<M>) {
        out.squares[lane] = tree(&self.squares);
        for j in 0..M {
            out.products[j][lane] = tree(&self.products[j]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::burst::FORMS;
    use crate::processor::with_each_set;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn products_are_inner_products_whatever_layout_format_neighbours_and_instructions() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(12);
        for n in [128, 77, 16, 5] {
            let mut numbers = |by: f64| -> Vec<f64> {
                (0..n).map(|_| by * rng.random_range(-1.0..1.0)).collect()
            };
            let columns: [Vec<f64>; 4] = std::array::from_fn(|_| numbers(1e-3));
            let expected = numbers(900.0);
            let signals: Vec<Vec<f32>> = (0..LANES)
                .map(|_| numbers(2000.0).into_iter().map(|y| y.round() as f32).collect())
                .collect();
            let of = Columns::new(&columns);
            let y_hat = in_phases(expected.iter().map(|&y| y as f32));
            let mut same = Vec::new();
            with_each_set(|| {
                for &(format, layout) in FORMS {
                    let burst = Burst::of(&signals, 1e-6, format, layout);
                    for step in [1, 3, LANES] {
                        let (mut found, mut room) = (Projections::default(), Room::default());
                        let (mut products, mut squares) = ([[0; LANES]; 4], [0; LANES]);
                        for row in (0..LANES).step_by(step) {
                            let rows = row..(row + step).min(LANES);
                            of.project((&burst, rows.clone()), &y_hat, &mut found, &mut room);
                            for (lane, row) in rows.enumerate() {
                                squares[row] = found.squares[lane].to_bits();
                                for (all, found) in products.iter_mut().zip(&found.products) {
                                    all[row] = found[lane].to_bits();
                                }
                            }
                        }
                        same.push((products, squares));
                    }
                }
            });
            assert!(same.windows(2).all(|w| w[0] == w[1]), "bits depend on more than the signal");
            let (products, squares) = same[0];
            for (lane, y) in signals.iter().enumerate() {
                let d = || y.iter().zip(&expected).map(|(&y, e)| f64::from(y) - e);
                for (column, found) in columns.iter().zip(products) {
                    let want = d().zip(column).map(|(d, p)| d * p).sum::<f64>();
                    assert!((f64::from(f32::from_bits(found[lane])) - want).abs() < 1e-4, "{want}");
                }
                let want = d().map(|d| d * d).sum::<f64>();
                let found = f64::from(f32::from_bits(squares[lane]));
                assert!((found / want - 1.0).abs() < 1e-5, "{found} {want}");
            }
        }
    }
}
