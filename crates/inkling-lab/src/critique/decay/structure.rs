//! What the plant of the decays is: its modes, and whether they are a free decay of so few modes.
//!
//! In: [`Selected`]. Out: [`Structure`]. The interval of a mode's frequency is by its spread over cuts of the
//! record's beginning, where that is more than its error in the noise: what the model lacks moves a mode by
//! more than noise does. The forecast is that of the last two fifths of the record by the model fitted to the
//! rest; its control is the same of decays of the fitted model itself with as much noise as it leaves.

use super::decays::Decays;
use super::noise::{Noise, sizes};
use super::plant::{Fit, OMEGA, SIGMA, waves_of};
use super::selection::Selected;
use super::terms::{Line, Term};
use crate::critique::chance::without_a_name;
use crate::critique::finding::{Forecast, Mode, Structure};
use crate::critique::tuned::{FORESEEN, MOST_MULTIPLE, MOSTLY};
use crate::plot::digits::{measured, short};
use inkling_core::model::inner_product::dot;
use inkling_core::numbers::LITTLE;
use inkling_core::side_by_side::{cores, side_by_side};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::BTreeSet;
use std::f64::consts::{PI, TAU};

/// Cuts of the record's beginning, each by another one of so many parts of the record.
const CUTS: usize = 6;
const PARTS: usize = 30;

/// Share of the record that is not foreseen.
const KNOWN: f64 = 0.6;

pub fn of(selected: &Selected) -> Structure {
    Structure {
        modes: modes(selected),
        onset_s: selected.fit.decays.time_s(0),
        forecast: forecast(&selected.fit),
    }
}

/// Why this is no free decay of few modes, in words: it is foreseen badly, where it could be foreseen; it grows; or
/// its lines are those of one wave. Where most of the misfit follows from the samples before, it is the model's own
/// error, and the control, which takes all of it for noise, says nothing.
pub fn why_no_decay(selected: &Selected, structure: &Structure) -> Option<String> {
    let Forecast { record_percent, control_percent } = structure.forecast;
    let could_be = control_percent < 0.5 * record_percent || selected.noise.predictable() > MOSTLY;
    let missed = short(record_percent);
    let fails = (record_percent > 100.0 * FORESEEN && could_be).then(|| {
        format!("this is no free decay of so few modes: a forecast of its end misses {missed} % of the movement")
    });
    fails.or_else(|| grows(selected)).or_else(|| multiples(&selected.fit))
}

/// What is said where neither the ring nor a mode decays: none falls with certainty, and each by less than a tenth.
fn grows(selected: &Selected) -> Option<String> {
    let Selected { fit, covariance, .. } = selected;
    let is_bent = |term: &Term| matches!(term, Term::Drag | Term::Friction | Term::Unnamed(_));
    // ln of the amplitude at the end over that at the beginning, and its standard deviation
    let growth = |at: usize| {
        [-fit.p[at], covariance[(at, at)].max(0.0).sqrt()].map(|x| x * fit.decays.samples as f64)
    };
    let modes = fit.placed().filter(|(term, _)| *term == Term::Line(Line::Mode)).map(|(_, at)| at);
    let stays = |[grown, sd]: [f64; 2]| grown + 3.0 * sd >= 0.0 && grown - 3.0 * sd > -LITTLE;
    let no_decay = !fit.terms.iter().any(is_bent) && modes.chain([SIGMA]).map(growth).all(stays);
    no_decay.then(|| {
        let [grown, sd] = growth(SIGMA);
        let interval = [grown - 1.96 * sd, grown + 1.96 * sd].map(f64::exp);
        format!(
            "this does not decay: at the end, what rings at {} Hz has {} times its first amplitude",
            short(fit.p[OMEGA] / (TAU * fit.decays.dt_s)),
            measured(grown.exp(), interval, "")
        )
    })
}

/// What is said where all lines are whole multiples of one, three different ones at least, nearer than chance puts
/// them. Multiples may lie above half the sampling rate, where they are seen at their mirror image.
fn multiples(fit: &Fit) -> Option<String> {
    let tones = fit.placed().filter(|(term, _)| *term == Term::Line(Line::Tone));
    let tones = tones.map(|(_, at)| fit.p[at]);
    let all: Vec<f64> = poles(fit).iter().map(|(pole, _)| pole[1]).chain(tones).collect();
    let seen = |omega: f64| omega.rem_euclid(TAU).min(TAU - omega.rem_euclid(TAU));
    let surprise = |first: &&f64| {
        let nearest = |omega: &f64| {
            let off = |k: &i32| (seen(f64::from(*k) * **first) - seen(*omega)).abs();
            let k = (0..=MOST_MULTIPLE).min_by(|p, q| off(p).total_cmp(&off(q))).unwrap_or(0);
            (k, off(&k))
        };
        let (times, off): (BTreeSet<i32>, Vec<f64>) = all.iter().map(nearest).unzip();
        let farthest = off.into_iter().fold(0.0, f64::max);
        let share = 2.0 * farthest * (1.0 / **first).max(f64::from(MOST_MULTIPLE) / PI);
        if times.range(2..).count() < 3 { 0.0 } else { (1.0 - all.len() as f64) * share.ln() }
    };
    let swings = all.iter().filter(|omega| **omega > fit.decays.lowest_line());
    let first = swings.max_by(|p, q| surprise(p).total_cmp(&surprise(q)))?;
    let hertz = short(first / (TAU * fit.decays.dt_s));
    let is_sure = surprise(&first) > without_a_name(all.len() as f64);
    is_sure.then(|| {
        format!("lines at multiples of {hertz} Hz: it is rectified, or not linear, or a string")
    })
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
    let (fit, covariance) = selected.told();
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
        let variance = covariance[(at, at)].max(0.0);
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
    let columns = fit.columns();
    let ring = fit.moved().concat();
    let mut powers = vec![dot(&ring, &ring)];
    let mut next = fit.at_rest.columns();
    for (term, at) in fit.placed() {
        let own = next..next + 2 * waves_of(term, at, &fit.p).len();
        next = own.end;
        if term == Term::Line(Line::Mode) {
            let shown = |free: &[f64], k: usize| -> f64 {
                own.clone().map(|c| free[c] * columns[c][k]).sum()
            };
            let square =
                |free: &Vec<f64>| (0..fit.upto).map(|k| shown(free, k).powi(2)).sum::<f64>();
            powers.push(fit.free.iter().map(square).sum());
        }
    }
    powers
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
