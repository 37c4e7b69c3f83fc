//! Where a ring fit starts: a coarse search over damping and frequency.
//!
//! In: a signal, the columns of rings at the places of a grid. Out: ln damping and ln frequency where
//! the rings explain most of it. Samples are added up in groups, in f32: only the start is chosen by
//! them. Sums are made in one order, so the start is the same whatever the processor; nothing fuses.

use crate::processor::for_processor;

/// Places side by side: with both columns of each 64 sums, four AVX-512 vectors.
const PLACES: usize = 32;
type OfPlaces = [f32; PLACES];

/// Both columns at one sum of samples; in whole cache lines.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
struct Row([OfPlaces; 2]);

/// Coarse grid, relative to the healthy ring: damping from a twentieth to four times, frequency from
/// 0.4 to 1.5 times. Steps of 9 % in frequency, and of 6 in damping, lie within reach of Gauss-Newton:
/// of 20,000 rings of that range at ten times the usual noise's square .30 % end elsewhere than from
/// the truth, with 4 x 22 places .24 %; at the usual noise none.
const DAMPINGS: [f64; 2] = [0.2, 1.3];
const FREQUENCIES: usize = 16;
const FREQUENCY_RANGE: (f64, f64) = (0.40, 1.55);
/// Phase of the grid's highest frequency from one sum of samples to the next, rad: their products are
/// then as good as those of the samples.
const COARSE_RAD: f64 = 2.0;

#[derive(Clone, Debug)]
pub struct Grid {
    /// ln damping and ln frequency of its places, of each damping all frequencies.
    places: Vec<[f64; 2]>,
    panels: Vec<Panel>,
    /// Samples that are added up.
    group: usize,
}

/// Some places. Where there is none, all is zero.
#[derive(Clone, Debug)]
struct Panel {
    /// In-phase and quadrature columns, sum by sum.
    columns: Vec<Row>,
    /// Upper triangles of the inverses of their Gram matrices.
    inverses: [OfPlaces; 3],
}

/// Both columns of a place, and the upper triangle of the inverse of their Gram matrix.
type OfPlace = ([Vec<f64>; 2], [f32; 3]);

/// Scratch of one worker.
#[derive(Clone, Debug, Default)]
pub struct Sums {
    of_signal: Vec<f32>,
    explained: Vec<OfPlaces>,
}

impl Grid {
    /// `omega_dt`: of frequency ratio 1, rad a sample. `columns`: of a ring with ratios of damping
    /// and frequency, `samples` each.
    pub fn new(omega_dt: f64, samples: usize, columns: impl Fn(f64, f64) -> [Vec<f64>; 2]) -> Grid {
        let (low, high) = FREQUENCY_RANGE;
        let group = ((COARSE_RAD / (omega_dt * high)) as usize).clamp(1, (samples / 16).max(1));
        let group = 1 << group.ilog2();
        let mut places = Vec::new();
        let mut of_places = Vec::new();
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
                let there = determinant > 1e-9 * pp * qq;
                let inverse =
                    [qq, -2.0 * pq, pp].map(|g| if there { (g / determinant) as f32 } else { 0.0 });
                places.push([damping.ln(), frequency.ln()]);
                of_places.push(([p, q], inverse));
            }
        }
        let sums = samples / group;
        let panels = of_places
            .chunks(PLACES)
            .map(|of| {
                let lanes = |value: &dyn Fn(&OfPlace) -> f32| -> OfPlaces {
                    std::array::from_fn(|l| of.get(l).map_or(0.0, value))
                };
                let column = |k: usize, j: usize| lanes(&|(columns, _)| columns[j][k] as f32);
                Panel {
                    columns: (0..sums).map(|k| Row([column(k, 0), column(k, 1)])).collect(),
                    inverses: std::array::from_fn(|j| lanes(&|(_, inverse)| inverse[j])),
                }
            })
            .collect();
        Grid { places, panels, group }
    }

    /// ln damping and ln frequency where the grid explains most, between its frequencies by a parabola. `y`:
    /// counts. `None`: nothing explains anything.
    pub fn search(&self, y: &[f64], sums: &mut Sums) -> Option<[f64; 2]> {
        let most = explain(self, y, sums);
        let explained = sums.explained.as_flattened();
        let best = explained.iter().position(|e| *e == most)?;
        let at = |i: usize| (self.places[i], f64::from(explained[i]));
        let here = *self.places.get(best)?;
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
    /// What each place explains of a signal; returns the most.
    fn explain(of: &Grid, y: &[f64], sums: &mut Sums) -> f32 { portable }
}

#[inline(always)] // compiled once per instruction set
fn portable(of: &Grid, y: &[f64], Sums { of_signal, explained }: &mut Sums) -> f32 {
    of_signal.clear();
    match of.group {
        4 => of_signal
            .extend(y.as_chunks::<4>().0.iter().map(|y| ((y[0] + y[1]) + (y[2] + y[3])) as f32)),
        group => of_signal.extend(y.chunks_exact(group).map(|y| y.iter().sum::<f64>() as f32)),
    }
    explained.clear();
    let mut most = [f32::NEG_INFINITY; PLACES];
    for Panel { columns, inverses } in &of.panels {
        let [mut u, mut v] = [[0.0; PLACES]; 2];
        for (y, Row([p, q])) in of_signal.iter().zip(columns) {
            for l in 0..PLACES {
                u[l] += y * p[l];
            }
            for l in 0..PLACES {
                v[l] += y * q[l];
            }
        }
        let [uu, uv, vv] = inverses;
        let mut of_places = [0.0; PLACES];
        for l in 0..PLACES {
            of_places[l] = uu[l] * u[l] * u[l] + uv[l] * u[l] * v[l] + vv[l] * v[l] * v[l];
            most[l] = if of_places[l] > most[l] { of_places[l] } else { most[l] };
        }
        explained.push(of_places);
    }
    most.iter().fold(f32::NEG_INFINITY, |m, e| if *e > m { *e } else { m })
}

/// Where a parabola through three points is highest, no further than half way to the outer ones.
fn peak(x: [f64; 3], y: [f64; 3]) -> f64 {
    let (left, right) = (x[1] - x[0], x[2] - x[1]);
    let (rise, fall) = ((y[1] - y[0]) / left, (y[2] - y[1]) / right);
    // slope at the middle and curvature
    let slope = (rise * right + fall * left) / (left + right);
    let curvature = 2.0 * (fall - rise) / (left + right);
    let shift = if curvature < 0.0 { -slope / curvature } else { 0.0 };
    x[1] + shift.clamp(-0.5 * left, 0.5 * right)
}
