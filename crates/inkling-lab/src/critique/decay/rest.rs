//! What the sensor shows at rest: whether its zero drifts, and the offset that all decays share, as a cause.
//!
//! In: a model of decays. Out: the same with or without a drift ([`compared`]), and the offset as a [`Candidate`]
//! ([`offset`]). Each series has an offset of its own from the start, and a drift of its own beside it where decays with
//! one are explained better than without. As neither rings, they compete with no cause: a drift is compared anew
//! whenever the model has changed.

use super::children::ring;
use super::decays::Decays;
use super::noise::Noise;
use super::plant::{AtRest, Fit, OMEGA};
use super::selection::{fall, gain_in_bic};
use crate::critique::candidate::Candidate;
use crate::critique::catalogue::CauseId;
use crate::critique::chance::{THRESHOLD, maximum, surprise};
use crate::critique::ensemble::mean_of;
use inkling_core::side_by_side::{cores, side_by_side};
use std::f64::consts::TAU;

/// By how many powers of e a drift falls in the record where its search begins: their logarithms.
const DRIFTS: [f64; 2] = [-1.0, 1.5];

/// The model with a drift if that explains more than chance would, else without one.
pub fn compared(now: Fit<'_>) -> Fit<'_> {
    let white = Noise::white(&now.sizes());
    let without = match now.at_rest {
        AtRest::Drift => now.resting(AtRest::Offset).descend(&white),
        _ => now.clone(),
    };
    let with = if now.drift().is_some() { Some(now) } else { drifting(&without, &white) };
    match with {
        Some(with) if !without.cost.is_finite() || drifts(&without, &with) => with,
        _ => without,
    }
}

fn drifts(without: &Fit, with: &Fit) -> bool {
    let degrees = with.parameters() - without.parameters();
    let statistic = fall(without, with, &with.noise());
    let surprise = surprise(statistic, degrees, 1.0, with.degrees_of_freedom());
    is_slow(with) && gain_in_bic(without, with) > 0.0 && surprise > THRESHOLD
}

/// A drift takes longer than a swing.
fn is_slow(fit: &Fit) -> bool {
    fit.drift().is_some_and(|at| TAU * fit.p[at] < fit.p[OMEGA])
}

/// The likeliest model with a drift. `None`: there is none that is slow.
fn drifting<'a>(without: &Fit<'a>, white: &Noise) -> Option<Fit<'a>> {
    let tried = side_by_side(cores(), starts(without), |start| start.few_steps(white));
    let able = tried.into_iter().filter(|fit| is_slow(fit) && fit.cost.is_finite());
    able.min_by(|p, q| p.cost.total_cmp(&q.cost)).map(|fit| fit.descend(white))
}

/// Starting points with a drift. The first ring, which may have followed the drift, is also looked for beside that
/// which explains most alone.
fn starts<'a>(without: &Fit<'a>) -> Vec<Fit<'a>> {
    let beside = |model: &Fit<'a>, ln_falls: f64| {
        let mut drift = model.resting(AtRest::Drift);
        if let Some(at) = drift.drift() {
            drift.p[at] = ln_falls.exp() / model.decays.samples as f64;
        }
        drift
    };
    let mut starts: Vec<Fit> = DRIFTS.map(|ln_falls| beside(without, ln_falls)).into();
    if without.terms.is_empty() {
        let (zero, white) = (Fit::zero(without.decays), Noise::white(&without.sizes()));
        let still = |ln_falls: f64| beside(&zero, ln_falls).solved(&white);
        let [slow, fast] = DRIFTS;
        let best = maximum(|ln_falls| -still(ln_falls).cost, 0.5 * (slow + fast), fast - slow);
        starts.push(ring(&still(best)));
    }
    starts
}

/// The offset that all decays share. One that differs between decays is no cause: what its differences explain is
/// taken off its statistic, and where they are more than chance, the mean must stand out of the decays' spread.
pub fn offset(fit: &Fit, noise: &Noise) -> Candidate {
    let Decays { bursts, outputs, .. } = *fit.decays;
    let count = bursts as f64;
    let explained = fall(&fit.resting(AtRest::Zero).descend(noise), fit, noise);

    // mean over the decays of each output's offset, and its error by their spread, in the fit's scale
    let of_output = |o: usize| {
        let each = fit.free.iter().skip(o).step_by(outputs);
        mean_of(&each.map(|of| of[0]).collect::<Vec<f64>>())
    };
    let sd = fit.sd_of_offset(noise);
    let largest = (0..outputs).max_by(|p, q| {
        let size = |o: usize| (of_output(o).0 * fit.decays.scale[o]).abs();
        size(*p).total_cmp(&size(*q))
    });
    let output = largest.unwrap_or(0);
    let (mean, by_spread) = of_output(output);
    let differs = |o: usize| count * (count - 1.0) * (of_output(o).1 / sd[o]).powi(2);
    let differ: f64 = (0..outputs).map(differs).sum();
    let price = (count - 1.0) * outputs as f64 * fit.decays.ln_samples();
    let is_shared = differ <= price;
    let (statistic, degrees, dof) = match is_shared {
        true => ((explained - differ).max(0.0), outputs, fit.degrees_of_freedom()),
        false => ((mean / by_spread).powi(2), 1, count - 1.0),
    };
    let error = if is_shared { sd[output] / count.sqrt() } else { by_spread };
    let scale = fit.decays.scale[output];
    let looks = if is_shared { 1.0 } else { outputs as f64 };
    // what drifts is no offset, nor what no sample comes near
    let seen = || fit.decays.of_output(&fit.decays.y, output).flatten();
    let stays = fit.drift().is_none() && seen().any(|y| *y > mean) && seen().any(|y| *y < mean);
    Candidate {
        degrees,
        surprise: if stays { surprise(statistic, degrees, looks, dof) } else { 0.0 },
        value: mean * scale,
        sd: error * scale,
        ..Candidate::plain(CauseId::Offset, statistic, ())
    }
}
