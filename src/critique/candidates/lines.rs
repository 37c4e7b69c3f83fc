//! Causes whose spectrum is a line: a tone, a second mode.
//!
//! In: a [`Bench`]. Out: [`Scored`]; disqualified where the line is the ring's own doing.

use super::chance::{maximum, width};
use super::{Applied, Bench, Scored};
use std::f64::consts::{PI, TAU};

/// A line below this share of the model's own frequency is no mode, and below so many periods of the
/// signal it is no line.
const LEAST_MODE: f64 = 0.3;
pub const LEAST_PERIODS: f64 = 2.0;
/// A line so near a multiple of the ring's frequency is no line of its own, relative to that frequency.
const NEAR: f64 = 0.1;

impl Bench<'_> {
    /// A line: cos and sin at the frequency that explains most, over some dampings.
    pub(super) fn line(
        &self,
        id: &'static str,
        pattern: usize,
        dampings: &[f64],
        near: Option<&Applied>,
    ) -> Option<Scored> {
        let n = self.samples;
        let columns = |omega: f64, gamma: f64| {
            let column = |phase: f64| {
                let y = (0..n).map(|k| {
                    let t = k as f64 / n as f64;
                    (-gamma * t).exp() * (omega * t + phase).cos()
                });
                self.pattern(pattern, y.collect())
            };
            [column(0.0), column(-PI / 2.0)]
        };
        let test = |omega: f64, gamma: f64| {
            self.shapes.test(&columns(omega, gamma)).map_or(0.0, |t| t.statistic)
        };
        let (own, resolution) = (self.seen.omega, TAU);
        // near its own frequency a second mode is no second mode: the pair splits
        let banned = |omega: f64, gamma: f64| {
            let near = 1.2 * resolution + 1.5 * (self.seen.sigma + gamma);
            let mode = pattern == 1
                && (omega < LEAST_MODE * own
                    || (omega - own).abs() < near
                    || (2..=4).any(|m| (omega - f64::from(m) * own).abs() < 0.6 * resolution));
            // nor is every second sample's own gain, which mirrors the ring at half the sampling rate
            let mirror = PI * n as f64 - own;
            // what is at a multiple of its own frequency, or at its mirror, is the ring's own doing
            let order = (omega / own).round().max(1.0);
            let multiple = (omega - order * own).abs() < NEAR * own;
            let mirrored = (omega - mirror).abs() < near.min(NEAR * own).max(resolution);
            // so is a tone at its own frequency: anything that changes the ring looks like one
            let own = (omega - own).abs() < 1.2 * resolution;
            mode || own
                || multiple
                || mirrored
                || self.avoid.iter().any(|w| (omega - w).abs() < 1.5 * resolution)
        };
        let most = PI * n as f64 * 0.97;
        let (mut best, mut best_banned) = ((0.0, 0.0, 0.0), 0.0_f64);
        if let Some(near) = near {
            best = (0.0, near.shape, near.damping);
        }
        let slow = |omega: f64| omega < LEAST_PERIODS * TAU;
        for &gamma in dampings.iter().filter(|_| near.is_none()) {
            // below, a wave is any slow shape; where one fits better, a line is none
            let mut omega = 0.4 * LEAST_PERIODS * TAU;
            while omega < most {
                let statistic = test(omega, gamma);
                if banned(omega, gamma) || slow(omega) {
                    best_banned = best_banned.max(statistic);
                } else if statistic > best.0 {
                    best = (statistic, omega, gamma);
                }
                omega += 0.5 * PI;
            }
        }
        let (_, mut omega, mut gamma) = best;
        if omega == 0.0 {
            return None;
        }
        for _ in 0..2 {
            omega = maximum(|x| test(x, gamma), omega, 0.5);
            if gamma > 0.0 {
                gamma = maximum(|x| test(omega, x.exp()), gamma.ln(), 0.4)
                    .exp()
                    .max(0.1 * self.seen.sigma)
                    .min(6.0 * self.seen.sigma);
            }
        }
        let directions = columns(omega, gamma);
        let tested = self.shapes.test(&directions)?;
        let sd = width(|x| test(x, gamma), omega, 0.02);
        let value = omega / TAU / self.length_s;
        let tried = n as f64 * dampings.len() as f64;
        let mut scored = self.shaped(
            id,
            tested,
            directions.to_vec(),
            omega,
            tried,
            value,
            sd / TAU / self.length_s,
        );
        scored.applied.damping = gamma;
        // so near to the ring a mode cannot be told from it; what fits as well as one is no tone
        let close = 1.2 * resolution + 3.0 * self.seen.sigma;
        if pattern == 0 && near.is_none() && (omega - own).abs() < close && self.beside.drive_scan {
            let as_mode = [0.4, 1.0, 2.0].map(|share| {
                let column = |phase: f64| {
                    let y = (0..n).map(|k| {
                        let t = k as f64 / n as f64;
                        (-share * self.seen.sigma * t).exp() * (omega * t + phase).cos()
                    });
                    self.pattern(1, y.collect())
                };
                let columns = [column(0.0), column(-PI / 2.0)];
                self.shapes.test(&columns).map_or(0.0, |t| t.statistic)
            });
            if as_mode.iter().any(|s| *s > scored.statistic - 3.0) {
                scored.disqualified = "it may be a mode near the ring's own".into();
            }
        }
        if near.is_none() && banned(omega, gamma) || best_banned > scored.statistic + 10.0 {
            scored.disqualified =
                "its line lies at the model's own frequency or a multiple of it".into();
        }
        if near.is_none() && slow(omega) {
            scored.disqualified = "it is so slow that it may be no line".into();
        }
        Some(scored)
    }
}
