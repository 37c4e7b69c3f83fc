//! Rivals without a name: what a ring may do that the catalogue does not hold, but would wrongly give a name
//! to. Terms of the equation of motion and free shapes are in `shapes.rs`; here are the others, each as what
//! it adds to the mean ring:
//!
//! - `bent`: the ring seen through a curve, or with rates that follow time; the strength e is searched;
//! - `sways`: the ring, or its slope, times a cosine and a sine of a slow frequency, which is searched.
//!
//! In: a [`ScoreTests`]. Out: [`Scored`]. Time is in signal lengths, frequencies in rad per signal length.
//! `searched`, the search for the parameter of a family, also serves `shapes` and `lines`.

use super::{Asked, LEAST_PERIODS, ScoreTests, Scored};
use crate::critique::catalogue::{CauseId, RIVALS};
use crate::critique::chance::{maximum, width};
use crate::critique::space::Direction;
use crate::critique::unmodelled::{ObservedDecay, lagging, sensed};
use inkling_core::model::waves::waves;
use nalgebra::Complex;
use std::f64::consts::{PI, TAU};

/// Strength at which the search for a bend begins, and the largest one.
const STRENGTHS: [f64; 2] = [0.01, 1.0];
/// Distance of the frequencies that are tried.
const STEP: f64 = 0.5 * PI;

/// The mean ring at unit drive, counts: its damped pair as the real part of a turning number, whose size is the
/// envelope, and the real pole's part.
struct Ring {
    pair: Vec<Complex<f64>>,
    slow: Vec<f64>,
}

/// Integral over time of a change that begins with slope 1 and settles `rate` times over in a signal length.
fn settling(t: f64, rate: f64) -> f64 {
    match rate > 0.0 {
        true => (t + (-rate * t).exp_m1() / rate) / rate,
        false => 0.5 * t * t,
    }
}

impl ScoreTests<'_> {
    pub fn likest_rival(&self) -> Option<Scored> {
        let bent = RIVALS.iter().filter(|rival| rival.id != CauseId::OwnShape);
        let all = bent.filter_map(|rival| self.score_one(Asked::anew(rival.id)));
        all.max_by(|p, q| p.surprise.total_cmp(&q.surprise))
    }

    fn parts(&self) -> Ring {
        let ObservedDecay { sigma, omega, lambda, a, b, c } = self.decay;
        let time = |k: usize| k as f64 / self.samples as f64;
        let turned = |t: f64| Complex::new(a, -b) * Complex::new(-sigma * t, omega * t).exp();
        Ring {
            pair: (0..self.samples).map(|k| turned(time(k))).collect(),
            slow: (0..self.samples).map(|k| c * (-lambda * time(k)).exp()).collect(),
        }
    }

    /// The most significant test over a rival's second number (kept as the form's `damping`): over all
    /// `seconds` of the catalogue, which are paid for as tries, or with `near` at the value that it had.
    pub(super) fn best_of(
        &self,
        Asked { id, near }: Asked,
        score: impl Fn(f64) -> Option<Scored>,
    ) -> Option<Scored> {
        let seconds = id.row().seconds;
        let known = near.map(|near| near.damping);
        let tried = known.as_ref().map_or(seconds, std::slice::from_ref);
        let all = tried.iter().filter_map(|second| {
            let mut scored = score(*second)?;
            scored.form.damping = *second;
            Some(scored)
        });
        let mut best = all.max_by(|p, q| p.statistic.total_cmp(&q.statistic))?;
        best.tried *= seconds.len() as f64;
        best.surprise = (best.surprise - (seconds.len() as f64).ln()).max(0.0);
        Some(best)
    }

    /// `power`: as of `by_drive`; `second`: lag of the gain in signal lengths, or how often a frequency
    /// settles within one. The value is the strength e, the relative change at the first amplitude at unit
    /// drive (`whole`), or per signal length for rates.
    pub(super) fn bent(&self, asked: Asked, power: i32, second: f64) -> Option<Scored> {
        let ring = self.parts();
        let (n, whole) = (self.samples as f64, ring.pair[0].norm());
        let level = lagging(ring.pair.iter().map(|pair| pair.norm()), second * n);
        // added at strength e and relative drive s, per unit of e
        let added = |e: f64, s: f64| -> Vec<f64> {
            let of = |k: usize| {
                let t = k as f64 / n;
                let (pair, y) = (s * ring.pair[k].re, s * (ring.pair[k].re + ring.slow[k]));
                let changed = match asked.id {
                    // sigma becomes sigma (1 + e t), omega becomes omega (1 + e t) or settles
                    CauseId::LossFollowsTime => {
                        pair * (-0.5 * e * self.decay.sigma * t * t).exp_m1()
                    }
                    CauseId::FrequencyFollowsTime => {
                        let turned = e * self.decay.omega * settling(t, second);
                        pair * (turned.cos() - 1.0) - s * ring.pair[k].im * turned.sin()
                    }
                    // the level lags behind the envelope
                    sensor => whole * sensed(sensor, e, y / whole, s * level[k] / whole),
                };
                changed / e
            };
            (0..self.samples).map(of).collect()
        };
        let shape = |e: f64| self.by_drive(power, |_, s| added(e, s));
        self.grown(asked, STRENGTHS, shape, |e| e)
    }

    /// Tests a gain, or a time base, that sways with some frequency, of the same phase in all signals. The
    /// value is that frequency in Hz; its standard error is left in rad per signal length.
    pub(super) fn sways(&self, Asked { id, near }: Asked) -> Option<Scored> {
        let ring = self.parts();
        let n = self.samples as f64;
        let added = |k: usize| match id == CauseId::GainSways {
            true => ring.pair[k].re + ring.slow[k],
            false => {
                -self.decay.omega * ring.pair[k].im
                    - self.decay.sigma * ring.pair[k].re
                    - self.decay.lambda * ring.slow[k]
            }
        };
        let y: Vec<f64> = (0..self.samples).map(added).collect();
        let shape = |wave: Vec<f64>| {
            Direction::shape(1, y.iter().zip(wave).map(|(y, wave)| y * wave).collect())
        };
        let shapes = |omega: f64| waves(0.0, omega / n, self.samples).map(shape).into();
        // slower swaying is a damping or a frequency that changes with time
        let (low, high) = (LEAST_PERIODS * TAU, self.decay.omega.min(0.5 * PI * n));
        let grid = (0..).map(|k| low + STEP * f64::from(k)).take_while(|omega| *omega < high);
        let near = near.map(|near| near.shape);
        let scored = self.searched(id, n, near, (grid, STEP, [low, high]), shapes)?;
        Some(Scored { value: self.hz(scored.value), ..scored })
    }

    /// Finds the parameter of a family that makes the likeliest shapes: the best of a grid, or where it was
    /// before (`near`), refined within `reach` and clamped to `low` and `high`. It becomes both the shape and
    /// the value of the result. `tried`: number of independent shapes in the family, which is paid for.
    pub(super) fn searched(
        &self,
        id: CauseId,
        tried: f64,
        near: Option<f64>,
        (grid, reach, [low, high]): (impl Iterator<Item = f64>, f64, [f64; 2]),
        shapes: impl Fn(f64) -> Vec<Direction>,
    ) -> Option<Scored> {
        let statistic = |x: f64| self.nuisances.shapes.statistic(&shapes(x));
        let best = match near {
            Some(near) => near,
            None => {
                let all = grid.map(|x| (statistic(x), x));
                all.max_by(|p, q| p.0.total_cmp(&q.0))?.1
            }
        };
        let at = maximum(statistic, best, reach).min(high).max(low);
        let directions = shapes(at);
        let tested = self.nuisances.shapes.test(&directions)?;
        let sd = width(statistic, at, 0.02);
        let mut scored = Scored { value: at, sd, ..Scored::of(id, tested, directions, tried) };
        scored.form.shape = at;
        Some(scored)
    }
}
