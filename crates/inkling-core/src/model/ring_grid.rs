//! Where a ring fit starts: a coarse search over damping and frequency.
//!
//! In: a signal (N samples, counts). Out: ln damping and ln frequency, relative to the healthy
//! ring, of the grid point whose rings explain most of the signal's square norm: with the point's
//! two columns P, Q and their Gram matrix G, the products u = P'y, v = Q'y explain (u, v) G^-1 (u,
//! v)'. The best point's frequency is refined by a parabola through its neighbours. This is a start
//! only, so groups of neighbouring samples are summed before (decimation), and the rest is computed
//! in f32. All sums are made in a fixed order and nothing is fused, so the start is the same
//! whatever vector instructions are used.

use crate::processor::for_processor;

/// The dampings of the grid, over the healthy one. For rings with a damping from a twentieth to
/// four times and a frequency from 0.4 to 1.5 times the healthy one, steps of a factor 6.5 and of 9
/// % are close enough for Gauss-Newton: with ten times the usual noise variance .30 % of rings end
/// in another minimum than when started from the truth, at the usual noise none.
const DAMPINGS: [f64; 2] = [0.2, 1.3];
/// Number of frequencies of the grid, and their range over the healthy frequency, in equal ratios.
const FREQUENCIES: usize = 16;
const FREQUENCY_RANGE: (f64, f64) = (0.40, 1.55);
/// Samples are summed in groups over which the highest frequency advances by this at most, rad.
const COARSE_RAD: f64 = 2.0;

/// Number of points; their 64 sums (two columns each) in f32 fill four AVX-512 vectors.
const POINTS: usize = DAMPINGS.len() * FREQUENCIES;
type OfPoints = [f32; POINTS];

/// Both columns of all points at one decimated sample; aligned to cache lines.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
struct Row([OfPoints; 2]);

#[derive(Clone, Debug)]
pub struct Grid {
    /// ln damping and ln frequency of every point, the frequencies innermost.
    points: [[f64; 2]; POINTS],
    columns: Vec<Row>,
    /// Upper triangles of the columns' inverse Gram matrices, the off-diagonal element doubled.
    inverses: [OfPoints; 3],
    group: usize,
}

impl Grid {
    /// `omega_dt`: the healthy ring's phase advance, rad per sample. `columns`: P and Q, `samples`
    /// each, of a ring with these multiples of the healthy damping and frequency.
    pub fn new(omega_dt: f64, samples: usize, columns: impl Fn(f64, f64) -> [Vec<f64>; 2]) -> Grid {
        // at least 16 groups per signal that has as many samples, and a power of two
        let (low, high) = FREQUENCY_RANGE;
        let group = ((COARSE_RAD / (omega_dt * high)) as usize).clamp(1, (samples / 16).max(1));
        let group = 1 << group.ilog2();

        let none = [0.0; POINTS];
        let mut grid = Grid {
            points: [[0.0; 2]; POINTS],
            columns: vec![Row([none; 2]); samples / group],
            inverses: [none; 3],
            group,
        };
        for l in 0..POINTS {
            let damping = DAMPINGS[l / FREQUENCIES];
            let share = (l % FREQUENCIES) as f64 / (FREQUENCIES - 1) as f64;
            let frequency = low * (high / low).powf(share);
            grid.points[l] = [damping.ln(), frequency.ln()];
            let [p, q] = columns(damping, frequency).map(|column| {
                let sums = column.chunks_exact(group).map(|c| c.iter().sum::<f64>());
                sums.collect::<Vec<f64>>()
            });
            for (Row([of_p, of_q]), (p, q)) in grid.columns.iter_mut().zip(p.iter().zip(&q)) {
                (of_p[l], of_q[l]) = (*p as f32, *q as f32);
            }
            let product = |p: &[f64], q: &[f64]| p.iter().zip(q).map(|(p, q)| p * q).sum::<f64>();
            let [pp, pq, qq] = [product(&p, &p), product(&p, &q), product(&q, &q)];
            let determinant = pp * qq - pq * pq;
            // columns that are nearly parallel (decimated away) explain nothing
            if determinant > 1e-9 * pp * qq {
                for (inverse, g) in grid.inverses.iter_mut().zip([qq, -2.0 * pq, pp]) {
                    inverse[l] = (g / determinant) as f32;
                }
            }
        }
        grid
    }

    /// ln damping and ln frequency of the point that explains most. `None`: no point's share is a
    /// number, as with a NaN in `y`. Samples after the last whole group are not looked at.
    pub fn search(&self, y: &[f64], decimated: &mut Vec<f32>) -> Option<[f64; 2]> {
        let explained = explain(self, y, decimated);
        let most = explained.into_iter().fold(f32::NEG_INFINITY, f32::max);
        let best = explained.iter().position(|e| *e == most)?;

        // the parabola; a frequency at either end of the grid stays as it is
        let mut place = self.points[best];
        if (1..FREQUENCIES - 1).contains(&(best % FREQUENCIES)) {
            let near = [best - 1, best, best + 1];
            place[1] = peak(near.map(|l| self.points[l][1]), near.map(|l| explained[l].into()));
        }
        Some(place)
    }
}

for_processor! {
    fn explain(of: &Grid, y: &[f64], decimated: &mut Vec<f32>) -> OfPoints { portable }
}

#[inline(always)] // compiled once per instruction set
fn portable(of: &Grid, y: &[f64], decimated: &mut Vec<f32>) -> OfPoints {
    // the usual group of four by itself, because that is faster
    decimated.clear();
    match of.group {
        4 => decimated
            .extend(y.as_chunks::<4>().0.iter().map(|y| ((y[0] + y[1]) + (y[2] + y[3])) as f32)),
        group => decimated.extend(y.chunks_exact(group).map(|y| y.iter().sum::<f64>() as f32)),
    }

    let [mut u, mut v] = [[0.0; POINTS]; 2];
    for (y, Row([p, q])) in decimated.iter().zip(&of.columns) {
        for l in 0..POINTS {
            u[l] += y * p[l];
        }
        for l in 0..POINTS {
            v[l] += y * q[l];
        }
    }

    let [uu, uv, vv] = &of.inverses;
    let mut explained = [0.0; POINTS];
    for l in 0..POINTS {
        explained[l] = uu[l] * u[l] * u[l] + uv[l] * u[l] * v[l] + vv[l] * v[l] * v[l];
    }
    explained
}

/// The abscissa of the vertex of a parabola through three points, no further than half way to the
/// outer ones; the middle one if the parabola has no maximum.
fn peak(x: [f64; 3], y: [f64; 3]) -> f64 {
    let (left, right) = (x[1] - x[0], x[2] - x[1]);
    let (rise, fall) = ((y[1] - y[0]) / left, (y[2] - y[1]) / right);
    let slope = (rise * right + fall * left) / (left + right);
    let curvature = 2.0 * (fall - rise) / (left + right);
    let shift = if curvature < 0.0 { -slope / curvature } else { 0.0 };
    x[1] + shift.clamp(-0.5 * left, 0.5 * right)
}
