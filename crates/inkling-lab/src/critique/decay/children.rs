//! Where fits of decays begin: the plain oscillation, and each candidate beside what a model has
//! already.
//!
//! In: decays, or a fitted model (the parent) and a term. Out: [`Fit`]s. Least squares finds the
//! nearest minimum only, so good starts matter: the highest peaks of the spectrum for the ring and
//! for lines, several values for the second numbers of rivals, and the parent's optimum for all
//! else (`starts`). A term that moves the phase is also fitted from the first swings on
//! (`Fit::follow`), and the better of both fits stays.

use super::decays::Decays;
use super::fit::{Fit, Noise, sizes};
use super::objections::lowest_line;
use super::plant::{OMEGA, SIGMA};
use super::spectrum;
use super::terms::{Line, Term};
use super::unnamed::second_numbers;
use std::f64::consts::TAU;

/// The form of a candidate for decays.
#[derive(Clone, Debug)]
pub struct Added<'a> {
    pub term: Term,
    pub fit: Fit<'a>,
    /// Share of the parent's misfit (its squares) that the term takes away.
    pub share: f64,
}

/// Number of peaks of the misfit's spectrum at which a line is tried.
const PEAKS: usize = 3;

/// Number of samples in the first three swings.
fn first_swings(omega: f64) -> usize {
    (3.0 * TAU / omega.max(1e-6)).ceil().min(1e7) as usize
}

/// Sum of the periodograms of the misfits of all bursts and outputs, each without its mean, over the
/// root mean square of what its output then has.
pub fn misfit_power(misfit: &[f64], decays: &Decays) -> Vec<f64> {
    let mut centred = misfit.to_vec();
    for series in centred.chunks_mut(decays.samples) {
        let mean = series.iter().sum::<f64>() / series.len() as f64;
        series.iter_mut().for_each(|r| *r -= mean);
    }
    let sizes = sizes(&centred, decays);
    let scaled = |(i, series): (usize, &[f64])| -> Vec<f64> {
        series.iter().map(|r| r / sizes[i % decays.outputs]).collect()
    };
    spectrum::total(centred.chunks(decays.samples).enumerate().map(scaled), 1.0)
}

/// The damped oscillation that explains most, in white noise. It is searched beside an offset, so
/// that it does not slow down to stand in for one, and then fitted without.
pub fn baseline(decays: &Decays) -> Fit<'_> {
    let plain = Fit::zero(decays);
    let white = Noise::white(&vec![1.0; decays.outputs]);
    let resolution = TAU / decays.samples as f64;
    let power = misfit_power(&decays.y, decays);
    // starts: the two highest peaks of the spectrum, each with little and much damping: over the
    // record the amplitude falls by e^0.5 or by e^4
    let peaks = spectrum::peaks(&power, lowest_line(decays), 2.0 * resolution, 2);
    let starts = peaks.iter().flat_map(|omega| [0.5, 4.0].map(|falls| (*omega, falls)));
    let fits = starts.flat_map(|(omega, falls)| {
        let mut start = plain.with(Term::Offset);
        (start.p[OMEGA], start.p[SIGMA]) = (omega, falls / decays.samples as f64);
        [start.follow(&white, first_swings(omega)), start.descend(&white)]
    });
    let start = match fits.min_by(|p, q| p.cost.total_cmp(&q.cost)) {
        Some(fit) => fit.without(|_| true),
        None => {
            let mut slowest = plain.clone();
            slowest.p[OMEGA] = lowest_line(decays);
            slowest
        }
    };
    start.descend(&white)
}

/// Starting points of a candidate, each at its parent's optimum, with strength 0.
fn starts<'a>(parent: &Fit<'a>, term: Term) -> Vec<Fit<'a>> {
    let warm = parent.with(term);
    let at = parent.p.len();
    match term {
        Term::Line(line) => line_starts(parent, line),
        Term::Unnamed(rival) => second_numbers(rival, parent.decays.samples)
            .into_iter()
            .map(|second| {
                let mut start = warm.clone();
                start.p[at + 1..].fill(second); // it has one such number, or none
                start
            })
            .collect(),
        _ => vec![warm],
    }
}

/// Starting points of a line, with amplitude 0: one for each of the `PEAKS` highest peaks of the
/// misfit's spectrum, leaving out peaks, but for the first, that lie near frequencies of the model.
fn line_starts<'a>(parent: &Fit<'a>, line: Line) -> Vec<Fit<'a>> {
    let decays = parent.decays;
    let resolution = TAU / decays.samples as f64;
    let power = misfit_power(&parent.misfit(), decays);
    let tops = spectrum::peaks(&power, lowest_line(decays), 2.0 * resolution, 40);
    let own = parent.p[OMEGA];
    let known: Vec<f64> = parent.lines().flat_map(|(_, omegas)| omegas).chain([own]).collect();
    let elsewhere = |w: &&f64| known.iter().all(|k| (k - *w).abs() > 0.05 * k + 2.0 * resolution);
    let others = tops.iter().skip(1).filter(elsewhere).take(PEAKS - 1);

    let rate = parent.p[SIGMA].abs().max(1.0 / decays.samples as f64);
    let at = parent.p.len();
    let start = |omega: &f64| {
        let mut start = parent.with(Term::Line(line));
        start.p[at] = if line.is_damped() { rate } else { 0.0 };
        start.p[at + 1] = if line == Line::SideBands { (omega - own).abs() } else { *omega };
        start
    };
    tops.iter().take(1).chain(others).map(start).collect()
}

/// Fits a candidate from its parent's optimum on. A line gives one fit for each place, after a few
/// steps only, any other term one fit: of several second numbers the likeliest after a few steps is
/// followed.
pub fn children<'a>(parent: &Fit<'a>, term: Term, noise: &Noise) -> Vec<Fit<'a>> {
    let starts = starts(parent, term);
    let tries = || starts.iter().map(|start| start.few_steps(noise));
    if term.is_line() {
        return tries().collect();
    }
    let best_start = (starts.len() > 1)
        .then(tries)
        .and_then(|all| all.min_by(|p: &Fit, q: &Fit| p.cost.total_cmp(&q.cost)));
    let start = best_start.as_ref().unwrap_or(&starts[0]);
    let best = start.descend(noise);
    if !term.moves_phase() {
        return vec![best];
    }
    let followed = start.follow(noise, first_swings(parent.p[OMEGA]));
    vec![if followed.cost < best.cost { followed } else { best }]
}
