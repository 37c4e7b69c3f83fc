//! Samples of decays that say nothing of what rings, and where what is left of the others lies.
//!
//! In: decays, or what a fit leaves. Out: how many samples come before the decay is free ([`onset`]), samples at a rail
//! ([`clipped`]), single ones far off what all causes leave ([`strays`]), and where the misfit is not spread evenly
//! ([`uneven`]).
//!
//! Of two models, one oscillator that bends and rubs and a sum of modes, the one that foresees the later part better
//! is fitted from ever earlier samples k on. What came before is no decay, and is taken for noise as large as it is:
//! -2 ln likelihood is k ln(mean square of the first k) + (n - k) ln(mean square of the misfit from k on), summed over
//! outputs. The least of these is the onset, if the share of the movement that is misfit from there on is far smaller
//! than from the first sample on.

use super::children::{baseline, child};
use super::decays::Decays;
use super::motion::Form;
use super::noise::{Colour, Noise};
use super::plant::Fit;
use super::selection::gain_in_bic;
use super::structure::foreseen;
use super::terms::{Line, Term};
use crate::critique::chance::{ONCE_IN_100, surprise_of_count, without_a_name};
use crate::critique::tuned::{DRIVEN, ODD_IN_A_ROW, OUTLYING};
use inkling_core::model::median::{median, robust_sd};
use inkling_core::numbers::LITTLE;
use std::f64::consts::SQRT_2;

/// The onset lies in the first one of so many parts of the record, and is looked for in so many steps.
const FIRST: usize = 4;
const STEPS: usize = 32;

#[derive(Clone, Copy)]
struct Tried {
    at: usize,
    deviance: f64,
    /// ln of the misfit's mean square over that of the movement of the same samples, the mean over outputs.
    ln_share: f64,
}

pub fn onset(decays: &Decays) -> usize {
    let last = decays.samples / FIRST;
    let late = decays.from(last);
    let (bends, rings) = (bent(&late), modes(&late));
    // a sum of many modes fits a pendulum, too, and better than one oscillator does: so it must be needed
    let is_bent = bends.left() < LITTLE || foreseen(&bends) < foreseen(&rings);
    let mut tried = backwards(decays, if is_bent { &bends } else { &rings }, last);
    // the whole record has its own chance, from its own start
    let whole = if is_bent { bent(decays) } else { modes(decays) };
    tried.extend(judged(decays, &whole, 0));
    let least = |of: &mut dyn Iterator<Item = &Tried>| {
        of.min_by(|p, q| p.deviance.total_cmp(&q.deviance)).copied()
    };
    let best = least(&mut tried.iter());
    let whole = least(&mut tried.iter().filter(|t| t.at == 0));
    match (best, whole) {
        (Some(best), Some(whole)) if (best.ln_share - whole.ln_share).exp() < DRIVEN => best.at,
        _ => 0,
    }
}

/// The model of the decays from `last` on, fitted from ever earlier samples on.
fn backwards(decays: &Decays, late: &Fit, last: usize) -> Vec<Tried> {
    let mut tried: Vec<Tried> = judged(decays, late, last).into_iter().collect();
    let mut p = late.p.clone();
    let mut at = last;
    while at > 0 {
        let next = at.saturating_sub((last / STEPS).max(1));
        let longer = decays.from(next);
        let mut fit = Fit { decays: &longer, p, upto: longer.samples, ..late.clone() };
        fit.turn_back(at - next);
        let one = Noise::white(&vec![1.0; decays.outputs]);
        let fit = fit.descend(&Noise::white(&fit.solved(&one).sizes()));
        let Some(of_fit) = judged(decays, &fit, next) else { break };
        tried.push(of_fit);
        (p, at) = (fit.p, next);
    }
    tried
}

/// `fit`: of the samples from `at` on. Its numbers cost as in BIC. `None`: its motion is lost.
fn judged(decays: &Decays, fit: &Fit, at: usize) -> Option<Tried> {
    if !fit.cost.is_finite() {
        return None;
    }
    let before = (at * decays.bursts) as f64;
    let centred = decays.centred(&decays.y);
    let moved = |o: usize| {
        let each = decays.of_output(&centred, o).flat_map(|y| &y[..at]);
        each.map(|v| v * v).sum::<f64>() / before
    };
    let of_start = |o: usize| if at == 0 { 0.0 } else { before * moved(o).max(1e-300).ln() };
    let start: f64 = (0..decays.outputs).map(of_start).sum();
    let after = ((decays.samples - at) * decays.bursts) as f64;
    let ln_squares: f64 = fit.sizes().iter().map(|s| 2.0 * s.ln()).sum();
    let price = fit.parameters() as f64 * decays.ln_samples();
    let deviance = start + after * ln_squares + price;
    // what decays leaves a smaller misfit later on, however badly it is fitted
    let ln_moved: f64 = fit.decays.movement().iter().map(|moved| 2.0 * moved.ln()).sum();
    Some(Tried { at, deviance, ln_share: (ln_squares - ln_moved) / decays.outputs as f64 })
}

fn grown<'a>(fit: &Fit<'a>, term: Term) -> Option<Fit<'a>> {
    child(fit, term, &Noise::white(&fit.sizes()))
}

/// One oscillator whose spring bends, and whose damping changes with the amplitude.
fn bent(decays: &Decays) -> Fit<'_> {
    let terms = [Term::Stiffness(Form::Sine), Term::Friction, Term::Drag];
    terms.into_iter().fold(baseline(decays), |fit, term| grown(&fit, term).unwrap_or(fit))
}

/// A sum of modes, as many as BIC asks for.
fn modes(decays: &Decays) -> Fit<'_> {
    let mode = Term::Line(Line::Mode);
    let mut modes = baseline(decays);
    while mode.may_join(&modes.terms) {
        match grown(&modes, mode).filter(|more| gain_in_bic(&modes, more) > 0.0) {
            Some(more) => modes = more,
            None => break,
        }
    }
    modes
}

/// A series is compared in so many parts; one with a scale of its own has as many samples at least.
const PARTS: usize = 32;

/// A change that is smaller, relative to the root mean square of all, is that of numbers that are cut in files.
const CUT: f64 = 0.01;

fn common_divisor(p: usize, q: usize) -> usize {
    if q == 0 { p } else { common_divisor(q, p % q) }
}

/// Why samples are no measured ones, in words: each stands several times in a row, or lies on a straight line between
/// measured ones, so that values, or slopes, change at whole multiples of so many samples alone.
pub fn held(decays: &Decays) -> Option<String> {
    let differences = |y: &[f64]| y.windows(2).map(|pair| pair[1] - pair[0]).collect::<Vec<f64>>();
    let times = |series: &[f64]| {
        let rms = (series.iter().map(|v| v * v).sum::<f64>() / series.len() as f64).sqrt();
        let changed = series.iter().enumerate().filter(|(_, v)| v.abs() > CUT * rms);
        let places: Vec<usize> = changed.map(|(place, _)| place).collect();
        let gaps = || places.windows(2).map(|pair| pair[1] - pair[0]);
        let every = gaps().fold(0, common_divisor);
        let chance = (every.max(1) as f64).ln() * gaps().count() as f64;
        (chance > without_a_name(2.0 * decays.outputs as f64)).then_some(every)
    };
    decays.y.chunks(decays.samples).find_map(|series| {
        let slopes = differences(series);
        let stands = times(&slopes).map(|k| format!("each value stands {k} times in a row"));
        let lies = || {
            let every = times(&differences(&slopes))?;
            Some(format!("between every {every} samples all others lie on a straight line"))
        };
        let why = stands.or_else(lies)?;
        Some(format!("{why}: they are not measured; keep one of each"))
    })
}

/// The samples at the largest or the smallest value of an output, if these are more than chance puts there: of a
/// steady sine in whole counts the last count holds 1 + sqrt 2 times the one before it, at most. The longest visit
/// does not count, nor one in which a series begins: there, it may be held. But where hardly any other value is met
/// again, noise makes each differ, also of what is held.
pub fn clipped(decays: &Decays) -> Vec<usize> {
    let at_rail = |(output, side): (usize, f64)| {
        let all = || decays.of_output(&decays.y, output).flatten().map(|y| side * y);
        let rail = all().fold(f64::NEG_INFINITY, f64::max);
        let next = all().filter(|y| *y < rail).fold(f64::NEG_INFINITY, f64::max);
        let beside = all().filter(|y| *y == next).count() as f64;
        let series = decays.of_output(&decays.y, output);
        let runs = series.flat_map(|series| series.chunk_by(|p, q| p == q).skip(1));
        let visits = runs.filter(|run| side * run[0] == rail).map(<[f64]>::len);
        let (mut times, mut again, mut longest) = (0, 0, 0);
        for run in visits {
            (times, again, longest) = (times + 1, again + run, longest.max(run));
        }
        let among_counts = surprise_of_count((again - longest) as f64, (1.0 + SQRT_2) * beside);
        // how many of the other values are met again
        let mut others: Vec<f64> = all().filter(|y| *y < rail).collect();
        others.sort_by(f64::total_cmp);
        let repeats = others.windows(2).filter(|pair| pair[0] == pair[1]).count();
        let expected = (again * (1 + repeats)) as f64 / all().count() as f64;
        let among_noise = surprise_of_count((again - times) as f64, expected);
        let is_clipped =
            among_counts.max(among_noise) > without_a_name(2.0 * decays.outputs as f64);
        let is_at = move |(i, y): &(usize, &f64)| {
            is_clipped && side * **y == rail && i / decays.samples % decays.outputs == output
        };
        decays.y.iter().enumerate().filter(is_at).map(|(i, _)| i)
    };
    (0..decays.outputs)
        .flat_map(|output| [(output, 1.0), (output, -1.0)])
        .flat_map(at_rail)
        .collect()
}

/// A misfit less what the samples before predict, over the noise of the quieter half of all parts of its output: the
/// loud parts would know themselves.
fn whitened(misfit: &[f64], decays: &Decays) -> Vec<f64> {
    let length = decays.samples.div_ceil(PARTS);
    let power = |y: &[f64]| y.iter().map(|v| v * v).sum::<f64>() / y.len() as f64;
    let mut white = misfit.to_vec();
    for output in 0..decays.outputs {
        let parts = || decays.of_output(misfit, output).flat_map(|series| series.chunks(length));
        let typical = median(&mut parts().map(power).collect::<Vec<f64>>());
        let quiet: Vec<&[f64]> = parts().filter(|y| power(y) <= typical).collect();
        let colour = Colour::of(&quiet, 0.0);
        let of_output = white.chunks_mut(decays.samples).skip(output).step_by(decays.outputs);
        of_output.for_each(|series| colour.whiten(series));
    }
    white
}

/// Samples of which the misfit, and what of it does not follow from the samples before, lie beyond `OUTLYING` robust
/// standard deviations, the larger of those of the series and of the part about them; no more than two in a row on one
/// side. Each with how far off it is.
pub fn strays(fit: &Fit) -> Vec<(usize, f64)> {
    let misfit = fit.misfit();
    let in_sds = |values: &[f64]| -> Vec<f64> {
        let of_series = |series: &[f64]| {
            let all = robust_sd(series, 0.0).max(f64::MIN_POSITIVE);
            let sd = |part: &[f64]| robust_sd(part, 0.0).max(all);
            let parts = series.chunks((fit.upto / PARTS).max(PARTS)).map(|part| (part, sd(part)));
            parts.flat_map(|(part, sd)| part.iter().map(move |v| v / sd)).collect::<Vec<f64>>()
        };
        values.chunks(fit.upto).flat_map(of_series).collect()
    };
    let white = in_sds(&whitened(&misfit, fit.decays));
    let both = in_sds(&misfit).into_iter().zip(white);
    let off: Vec<f64> = both.map(|(r, w)| if r.abs() < w.abs() { r } else { w }).collect();
    let side = |far: &f64| if far.abs() > OUTLYING { far.signum() } else { 0.0 };
    let (mut found, mut at) = (Vec::new(), 0);
    for run in off.chunk_by(|p, q| side(p) == side(q)) {
        if side(&run[0]) != 0.0 && run.len() < ODD_IN_A_ROW {
            found.extend(run.iter().enumerate().map(|(k, far)| (at + k, far.abs())));
        }
        at += run.len();
    }
    found
}

/// Where what is left lies, if it is not spread evenly: the first sample of that part of a series (one of `PARTS`)
/// in which, beyond what the samples before predict, more samples are large than chance puts there. `None`: chance
/// explains every part.
pub fn uneven(misfit: &[f64], decays: &Decays) -> Option<usize> {
    let length = decays.samples.div_ceil(PARTS);
    let white = whitened(misfit, decays);
    let large = |y: &[f64]| y.iter().filter(|w| w.abs() > ONCE_IN_100).count() as f64;
    let share = large(&white) / white.len() as f64;
    let parts = white.chunks(decays.samples).flat_map(|series| series.chunks(length).enumerate());
    let surprises =
        parts.map(|(part, y)| (part * length, surprise_of_count(large(y), share * y.len() as f64)));
    let (at, most) = surprises.max_by(|(_, p), (_, q)| p.total_cmp(q))?;
    let looks = (white.len() / length) as f64;
    (most > without_a_name(looks)).then_some(at)
}
