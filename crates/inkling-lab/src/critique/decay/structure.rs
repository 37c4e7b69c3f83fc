//! What the plant of the decays is: its modes, and whether they are a free decay of so few modes.
//!
//! In: [`Selected`]. Out: [`Structure`]. The interval of a mode's frequency is by its spread over cuts of the
//! record's beginning, where that is more than its error in the noise: what the model lacks moves a mode by
//! more than noise does. The forecast is that of the last two fifths of the record by the model fitted to the
//! rest; its control is the same of decays of the fitted model itself with as much noise as it leaves.

use super::decays::Decays;
use super::noise::{Noise, sizes};
use super::plant::{Fit, OMEGA, SIGMA};
use super::selection::Selected;
use super::terms::{Line, Term};
use crate::critique::finding::{Forecast, Mode, Structure};
use crate::critique::tuned::{FORESEEN, MOSTLY};
use inkling_core::side_by_side::{cores, side_by_side};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;

/// Cuts of the record's beginning, each by another one of so many parts of the record.
const CUTS: usize = 6;
const PARTS: usize = 30;

/// Share of the record that is not foreseen.
const KNOWN: f64 = 0.6;

impl Forecast {
    /// Whether the record is no free decay of so few modes: foreseen badly, where it could be foreseen. Where most
    /// of the misfit follows from the samples before (`predictable`: its share), it is the model's own error, and
    /// the control, which takes all of it for noise, says nothing.
    pub fn fails(&self, predictable: f64) -> bool {
        let could_be = self.control_percent < 0.5 * self.record_percent || predictable > MOSTLY;
        self.record_percent > 100.0 * FORESEEN && could_be
    }
}

pub fn of(selected: &Selected) -> Structure {
    Structure {
        modes: modes(selected),
        onset_s: selected.fit.decays.time_s(0),
        forecast: forecast(&selected.fit),
    }
}

/// Damping and damped frequency of the ring and of all modes, per sample, each with the index of the number
/// that its frequency is.
fn poles(fit: &Fit) -> Vec<([f64; 2], usize)> {
    let (sigma, omega) = (fit.p[SIGMA], fit.p[OMEGA]);
    let ring = [sigma, (omega * omega - sigma * sigma).max(0.0).sqrt()];
    let modes = fit.placed().filter(|(term, _)| *term == Term::Line(Line::Mode));
    let modes = modes.map(|(_, at)| ([fit.p[at], fit.p[at + 1]], at + 1));
    std::iter::once((ring, OMEGA)).chain(modes).collect()
}

fn modes(selected: &Selected) -> Vec<Mode> {
    let fit = &selected.fit;
    let decays = fit.decays;
    let hertz = 1.0 / (TAU * decays.dt_s);
    let cut = |j: usize| {
        let skipped = j * decays.samples / PARTS;
        let shorter = decays.from(skipped);
        poles(&fit.later(&shorter, skipped).few_steps(&Noise::white(&fit.sizes())))
    };
    let cuts = side_by_side(cores(), (1..=CUTS).collect(), cut);
    let powers = powers(fit);
    let all: f64 = powers.iter().sum();
    let mode = |(i, ([sigma, omega], at)): (usize, ([f64; 2], usize))| {
        let variance = selected.covariance[(at, at)].max(0.0);
        let moved = cuts.iter().map(|poles| (poles[i].0[1] - omega).powi(2)).sum::<f64>();
        let half = 1.96 * variance.max(moved / CUTS as f64).sqrt() * hertz;
        let frequency_hz = omega * hertz;
        Mode {
            frequency_hz,
            ci95: [frequency_hz - half, frequency_hz + half],
            damping_per_s: sigma / decays.dt_s,
            share: powers[i] / all,
        }
    };
    let mut modes: Vec<Mode> = poles(fit).into_iter().enumerate().map(mode).collect();
    modes.sort_by(|p, q| q.share.total_cmp(&p.share));
    modes
}

/// Sum of squares of what the ring and each mode alone show, in the order of `poles`.
fn powers(fit: &Fit) -> Vec<f64> {
    let square = |y: &[f64]| y.iter().map(|y| y * y).sum::<f64>();
    let ring = fit.moved().concat();
    let misfit = fit.misfit();
    let mode = |(i, _): (usize, &Term)| {
        let without = fit.without(|k| k == i).misfit();
        square(&without.iter().zip(&misfit).map(|(all, left)| all - left).collect::<Vec<f64>>())
    };
    let terms = fit.terms.iter().enumerate();
    let modes = terms.filter(|(_, term)| **term == Term::Line(Line::Mode)).map(mode);
    std::iter::once(square(&ring)).chain(modes).collect()
}

fn forecast(fit: &Fit) -> Forecast {
    let record_percent = foreseen(fit);
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut simulated = fit.decays.clone();
    // noise as large as the misfit, wherever it is large: each sample's with a sign of its own
    for (y, r) in simulated.y.iter_mut().zip(&fit.misfit()) {
        *y -= if rng.random::<bool>() { 2.0 * r } else { 0.0 };
    }
    let control = Fit { decays: &simulated, ..fit.clone() };
    Forecast { record_percent, control_percent: foreseen(&control) }
}

/// Misfit, in percent of the movement, in the end of the decays, by the fit to what comes before.
pub fn foreseen(fit: &Fit) -> f64 {
    let Decays { samples, .. } = *fit.decays;
    let known = (KNOWN * samples as f64) as usize;
    let held_out = (0..samples).map(|k| k >= known).collect();
    let noise = Noise { held_out, ..Noise::white(&fit.sizes()) };
    let misfit = fit.descend(&noise).misfit();
    let end = fit.decays.from(known);
    let missed: Vec<f64> = misfit.chunks(samples).flat_map(|r| &r[known..]).copied().collect();
    // of each output relative to its own movement, so that none counts by its unit
    let shares = sizes(&missed, &end).into_iter().zip(end.movement()).map(|(r, y)| (r / y).powi(2));
    100.0 * (shares.sum::<f64>() / end.outputs as f64).sqrt()
}
