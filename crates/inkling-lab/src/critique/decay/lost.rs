//! Samples of decays that say nothing of what rings, and where what is left of the others lies.
//!
//! In: decays, or what a fit leaves. Out: samples at a rail ([`clipped`]), single ones far off what all causes leave
//! ([`strays`]), whether samples are repeated or interpolated ([`held`]), and where the misfit is not spread evenly
//! ([`uneven`]).

use super::decays::Decays;
use super::noise::Colour;
use super::plant::Fit;
use crate::critique::chance::{ONCE_IN_100, surprise_of_count, without_a_name};
use crate::critique::tuned::{LEAST_CHANGE, ODD_IN_A_ROW, OUTLYING};
use inkling_core::model::median::{median, robust_sd};
use std::f64::consts::SQRT_2;

/// A series is compared in so many parts; one with a scale of its own has as many samples at least.
const PARTS: usize = 32;

fn common_divisor(p: usize, q: usize) -> usize {
    if q == 0 { p } else { common_divisor(q, p % q) }
}

/// Why samples are no measured ones, in words: each stands several times in a row, or lies on a straight line between
/// measured ones, so that values, or slopes, change at whole multiples of so many samples alone.
pub fn held(decays: &Decays) -> Option<String> {
    let differences = |y: &[f64]| y.windows(2).map(|pair| pair[1] - pair[0]).collect::<Vec<f64>>();
    let times = |series: &[f64]| {
        let rms = (series.iter().map(|v| v * v).sum::<f64>() / series.len() as f64).sqrt();
        let changed = series.iter().enumerate().filter(|(_, v)| v.abs() > LEAST_CHANGE * rms);
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
