//! Where a ring fit starts: a coarse search over damping and frequency.
//!
//! In: a signal (N samples, counts). Out: ln damping and ln frequency, relative to the healthy
//! ring, of the grid point whose rings explain most of the signal's square norm, for `ring_fit` to
//! start from.
//!
//! At each of the 2 x 16 points amplitude and phase are fitted: with the point's two columns P, Q
//! and their Gram matrix G, the products u = P'y, v = Q'y explain the square norm (u, v) G^-1 (u,
//! v)'. Columns and G^-1 are computed once ([`Grid::new`]). The best point's frequency is then
//! refined by a parabola through its neighbours. This is a start only, so groups of neighbouring
//! samples are summed before (decimation), and the rest is computed in f32. All sums are made in a
//! fixed order and nothing is fused, so the start is the same whatever the processor.

use crate::processor::for_processor;

/// Number of grid points whose sums are computed together: with two columns each that makes 64 sums
/// in f32, four AVX-512 vectors.
const POINTS: usize = 32;
type OfPoints = [f32; POINTS];

/// Both columns of a block's points at one decimated sample; aligned to cache lines.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
struct Row([OfPoints; 2]);

/// The dampings of the grid, over the healthy one. The grid is for rings with a damping from a
/// twentieth to four times and a frequency from 0.4 to 1.5 times the healthy one. Steps of 9 % in
/// frequency and of a factor 6.5 in damping are close enough for Gauss-Newton: of 20,000 rings over
/// that range, with ten times the usual noise variance, .30 % end in another minimum than when
/// started from the truth (.24 % with 4 x 22 points); at the usual noise none.
const DAMPINGS: [f64; 2] = [0.2, 1.3];
/// Number of frequencies of the grid, and their range over the healthy frequency, in equal ratios.
const FREQUENCIES: usize = 16;
const FREQUENCY_RANGE: (f64, f64) = (0.40, 1.55);
/// Samples are summed in groups over which the grid's highest frequency advances by no more than
/// this phase, rad, so that little of any ring is lost.
const COARSE_RAD: f64 = 2.0;

/// The grid, prepared for signals of one length.
#[derive(Clone, Debug)]
pub struct Grid {
    /// ln damping and ln frequency of every point, the frequencies innermost.
    points: Vec<[f64; 2]>,
    blocks: Vec<Block>,
    /// Number of samples that are summed to one.
    group: usize,
}

/// Up to [`POINTS`] points of the grid; beyond the last there are zeros.
#[derive(Clone, Debug)]
struct Block {
    /// In-phase and quadrature columns of the points, decimated sample by decimated sample.
    columns: Vec<Row>,
    /// Upper triangles of the inverses of the columns' Gram matrices, the off-diagonal element
    /// doubled.
    inverses: [OfPoints; 3],
}

/// Both columns of a point, and the upper triangle of the inverse of their Gram matrix, the
/// off-diagonal element doubled.
type OfPoint = ([Vec<f64>; 2], [f32; 3]);

/// Buffers of a search, one set per thread: the decimated signal, and what each point explains of
/// it.
#[derive(Clone, Debug, Default)]
pub struct Sums {
    of_signal: Vec<f32>,
    explained: Vec<OfPoints>,
}

impl Grid {
    /// Prepares the grid. `omega_dt`: the healthy ring's phase advance, rad per sample. `columns`:
    /// in-phase and quadrature columns, `samples` each, of a ring with these multiples of the
    /// healthy damping and frequency.
    pub fn new(omega_dt: f64, samples: usize, columns: impl Fn(f64, f64) -> [Vec<f64>; 2]) -> Grid {
        // How many samples are summed to one: as few as keep the phase within COARSE_RAD, at least
        // 16 groups per signal, and a power of two.
        let (low, high) = FREQUENCY_RANGE;
        let group = ((COARSE_RAD / (omega_dt * high)) as usize).clamp(1, (samples / 16).max(1));
        let group = 1 << group.ilog2();

        // each point's decimated columns, and the inverse of their Gram matrix
        let mut points = Vec::new();
        let mut of_points = Vec::new();
        for damping in DAMPINGS {
            for i in 0..FREQUENCIES {
                let share = i as f64 / (FREQUENCIES - 1) as f64;
                let frequency = low * (high / low).powf(share);
                let [p, q] = columns(damping, frequency).map(|column| {
                    let sums = column.chunks_exact(group).map(|c| c.iter().sum::<f64>());
                    sums.collect::<Vec<f64>>()
                });
                let product =
                    |p: &[f64], q: &[f64]| p.iter().zip(q).map(|(p, q)| p * q).sum::<f64>();
                let [pp, pq, qq] = [product(&p, &p), product(&p, &q), product(&q, &q)];
                let determinant = pp * qq - pq * pq;
                // columns that are nearly parallel (decimated away) explain nothing
                let there = determinant > 1e-9 * pp * qq;
                let inverse =
                    [qq, -2.0 * pq, pp].map(|g| if there { (g / determinant) as f32 } else { 0.0 });
                points.push([damping.ln(), frequency.ln()]);
                of_points.push(([p, q], inverse));
            }
        }

        // the points side by side in blocks, one in each lane
        let sums = samples / group;
        let blocks = of_points
            .chunks(POINTS)
            .map(|of| {
                let lanes = |value: &dyn Fn(&OfPoint) -> f32| -> OfPoints {
                    std::array::from_fn(|l| of.get(l).map_or(0.0, value))
                };
                let column = |k: usize, j: usize| lanes(&|(columns, _)| columns[j][k] as f32);
                Block {
                    columns: (0..sums).map(|k| Row([column(k, 0), column(k, 1)])).collect(),
                    inverses: std::array::from_fn(|j| lanes(&|(_, inverse)| inverse[j])),
                }
            })
            .collect();
        Grid { points, blocks, group }
    }

    /// ln damping and ln frequency of the point that explains most; the frequency is refined by a
    /// parabola through the square norms that the point and its two neighbours in frequency
    /// explain. `y`: N, counts. `None`: the signal contains a NaN.
    pub fn search(&self, y: &[f64], sums: &mut Sums) -> Option<[f64; 2]> {
        // the point that explains most; of a NaN no comparison holds
        let most = explain(self, y, sums);
        let explained = sums.explained.as_flattened();
        let best = explained.iter().position(|e| *e == most)?;
        let at = |i: usize| (self.points[i], f64::from(explained[i]));
        let here = *self.points.get(best)?;

        // the parabola; a frequency at either end of the grid stays as it is
        let most = f64::from(most);
        let mut place = here;
        if (1..FREQUENCIES - 1).contains(&(best % FREQUENCIES)) {
            let (below, above) = (at(best - 1), at(best + 1));
            let x = [below.0[1], here[1], above.0[1]];
            place[1] = peak(x, [below.1, most, above.1]);
        }
        Some(place)
    }
}

for_processor! {
    /// The square norm that each point explains of a signal; returns the largest.
    fn explain(of: &Grid, y: &[f64], sums: &mut Sums) -> f32 { portable }
}

#[inline(always)] // compiled once per instruction set
fn portable(of: &Grid, y: &[f64], Sums { of_signal, explained }: &mut Sums) -> f32 {
    // the signal, decimated as the columns are (the usual group of four by itself, because that is
    // faster)
    of_signal.clear();
    match of.group {
        4 => of_signal
            .extend(y.as_chunks::<4>().0.iter().map(|y| ((y[0] + y[1]) + (y[2] + y[3])) as f32)),
        group => of_signal.extend(y.chunks_exact(group).map(|y| y.iter().sum::<f64>() as f32)),
    }

    explained.clear();
    let mut most = [f32::NEG_INFINITY; POINTS];
    for Block { columns, inverses } in &of.blocks {
        // u and v: the inner products of the signal with both columns of every point
        let [mut u, mut v] = [[0.0; POINTS]; 2];
        for (y, Row([p, q])) in of_signal.iter().zip(columns) {
            for l in 0..POINTS {
                u[l] += y * p[l];
            }
            for l in 0..POINTS {
                v[l] += y * q[l];
            }
        }

        // (u, v) G^-1 (u, v)': the square norm that amplitude and phase together explain
        let [uu, uv, vv] = inverses;
        let mut of_points = [0.0; POINTS];
        for l in 0..POINTS {
            of_points[l] = uu[l] * u[l] * u[l] + uv[l] * u[l] * v[l] + vv[l] * v[l] * v[l];
            most[l] = if of_points[l] > most[l] { of_points[l] } else { most[l] };
        }
        explained.push(of_points);
    }
    most.iter().fold(f32::NEG_INFINITY, |m, e| if *e > m { *e } else { m })
}

/// The abscissa of the vertex of a parabola through three points, no further than half way to the
/// outer ones; the middle one if the parabola has no maximum.
fn peak(x: [f64; 3], y: [f64; 3]) -> f64 {
    let (left, right) = (x[1] - x[0], x[2] - x[1]);
    let (rise, fall) = ((y[1] - y[0]) / left, (y[2] - y[1]) / right);
    // the parabola's slope at the middle point, and its curvature
    let slope = (rise * right + fall * left) / (left + right);
    let curvature = 2.0 * (fall - rise) / (left + right);
    let shift = if curvature < 0.0 { -slope / curvature } else { 0.0 };
    x[1] + shift.clamp(-0.5 * left, 0.5 * right)
}
