//! Where fits of decays begin: the plain oscillation, and each candidate beside what a model has
//! already.
//!
//! In: decays, or a fitted model (the parent) and a term. Out: [`Fit`]s. Least squares finds the
//! nearest minimum only, so good starts matter: the highest peaks of the spectrum for the ring and
//! for lines, several values for the second numbers of rivals, and the parent's optimum for all
//! else (`starts`). A term that moves the phase is also fitted from the first swings on
//! (`Fit::follow`), and the better of both fits stays.
//!
//! Some fitted terms cannot be what they are called, although they fit: they have signs and sizes that no such cause
//! can have ([`objection`]). What else could explain as much is no objection: it competes (`selection`).

use super::decays::Decays;
use super::noise::{Noise, sizes};
use super::plant::{Fit, OMEGA, SIGMA, Wave, waves_of};
use super::terms::{Line, Term, second_numbers};
use crate::critique::candidate::Objection;
use inkling_core::model::spectrum;
use nalgebra::DMatrix;
use std::f64::consts::{PI, TAU};

/// The form of a candidate for decays.
#[derive(Clone, Debug)]
pub struct Added<'a> {
    pub term: Term,
    pub fit: Fit<'a>,
    /// Share of the parent's misfit (its squares) that the term takes away.
    pub share: f64,
    /// By how much it lowers BIC in white noise.
    pub bic: f64,
}

/// Number of peaks of the misfit's spectrum at which a line is tried, and by how many powers of e it falls in
/// the record where its search begins.
const PEAKS: usize = 3;
const FALLS: [f64; 3] = [1.0, 4.0, 12.0];

/// Number of samples in the first three swings.
fn first_swings(omega: f64) -> usize {
    (3.0 * TAU / omega.max(1e-6)).ceil().min(1e7) as usize
}

/// Sum of the periodograms of the misfits of all bursts and outputs, each without its mean, over the
/// root mean square of what its output then has.
pub fn misfit_power(misfit: &[f64], decays: &Decays) -> Vec<f64> {
    let centred = decays.centred(misfit);
    let sizes = sizes(&centred, decays);
    let scaled = |(i, series): (usize, &[f64])| -> Vec<f64> {
        series.iter().map(|r| r / sizes[i % decays.outputs]).collect()
    };
    spectrum::total(centred.chunks(decays.samples).enumerate().map(scaled), 1.0)
}

/// The damped oscillation that explains most, in white noise, beside an offset of each series.
pub fn baseline(decays: &Decays) -> Fit<'_> {
    ring(&Fit::zero(decays))
}

/// The damped oscillation that explains most, in white noise, beside a model that does not ring.
pub fn ring<'a>(plain: &Fit<'a>) -> Fit<'a> {
    let decays = plain.decays;
    let white = Noise::white(&vec![1.0; decays.outputs]);
    let resolution = TAU / decays.samples as f64;
    let power = misfit_power(&plain.misfit(), decays);
    // starts: the two highest peaks of the spectrum, each with little and much damping: over the
    // record the amplitude falls by e^0.5 or by e^4
    let peaks = spectrum::peaks(&power, decays.lowest_line(), 2.0 * resolution, 2);
    let starts = peaks.iter().flat_map(|omega| [0.5, 4.0].map(|falls| (*omega, falls)));
    let fits = starts.flat_map(|(omega, falls)| {
        let mut start = plain.clone();
        (start.p[OMEGA], start.p[SIGMA]) = (omega, falls / decays.samples as f64);
        [start.follow(&white, first_swings(omega)), start.descend(&white)]
    });
    fits.min_by(|p, q| p.cost.total_cmp(&q.cost)).unwrap_or_else(|| plain.descend(&white))
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

/// Starting points of a line, one for each of the `PEAKS` highest peaks of the misfit's spectrum, with the
/// damping that leaves least.
fn line_starts<'a>(parent: &Fit<'a>, line: Line) -> Vec<Fit<'a>> {
    let decays = parent.decays;
    let length = decays.samples as f64;
    let resolution = TAU / length;
    let power = misfit_power(&parent.misfit(), decays);
    let tops = spectrum::peaks(&power, decays.lowest_line(), resolution, PEAKS);
    let white = Noise::white(&parent.sizes());
    let (own, at) = (parent.p[OMEGA], parent.p.len());
    let numbers: Vec<Vec<f64>> = match line {
        Line::Harmonic(_) => vec![Vec::new()],
        Line::Tone => tops.iter().map(|omega| vec![*omega]).collect(),
        Line::Mode | Line::SideBands => {
            let distance = if line == Line::SideBands { own } else { 0.0 };
            let of =
                |omega: &f64| FALLS.map(|falls| vec![falls / length, (omega - distance).abs()]);
            tops.iter().flat_map(of).collect()
        }
    };
    let start = |numbers: Vec<f64>| {
        let mut start = parent.with(Term::Line(line));
        start.p[at..].copy_from_slice(&numbers);
        start.solved(&white)
    };
    let starts: Vec<Fit> = numbers.into_iter().map(start).collect();
    let each = starts.chunks(if line.is_damped() { FALLS.len() } else { 1 });
    each.filter_map(|of| of.iter().min_by(|p, q| p.cost.total_cmp(&q.cost)).cloned()).collect()
}

/// Fits a candidate from its parent's optimum on. Of several starts the likeliest after a few steps is
/// followed, of those that nothing speaks against if there are any. `None`: the motion is lost in all of them.
pub fn child<'a>(parent: &Fit<'a>, term: Term, noise: &Noise) -> Option<Fit<'a>> {
    let starts = starts(parent, term);
    let start = match &starts[..] {
        [only] => only.clone(),
        several => {
            let tried = several.iter().map(|start| start.few_steps(noise));
            let judged = tried.map(|fit| {
                let against = objection(&fit, parent.terms.len(), &fit.covariance(noise));
                (against.is_some(), fit)
            });
            judged.min_by(|(p, a), (q, b)| p.cmp(q).then(a.cost.total_cmp(&b.cost)))?.1
        }
    };
    let best = Some(start.descend(noise)).filter(|fit| fit.cost.is_finite());
    // beside further modes, the phase of one is no longer in sight in the first swings
    if !term.moves_phase() || parent.lines() > 0 {
        return best;
    }
    let followed = start.follow(noise, first_swings(parent.p[OMEGA]));
    let is_better = followed.cost < best.as_ref().map_or(f64::INFINITY, |best| best.cost);
    if is_better { Some(followed) } else { best }
}

/// Why a fitted term cannot be what it is called. `index`: the term's among the fit's terms.
pub fn objection(fit: &Fit, index: usize, covariance: &DMatrix<f64>) -> Option<Objection> {
    let (term, at) = fit.placed().nth(index)?;
    if matches!(term, Term::Drag | Term::Friction) && fit.p[at] <= 0.0 {
        return Some(Objection::UnphysicalSign);
    }
    // a ring that grows by itself, with certainty, is not damped by whatever term was added
    let sd = covariance[(SIGMA, SIGMA)].max(0.0).sqrt();
    if fit.p[SIGMA] < -3.0 * sd {
        return Some(Objection::NegativeDamping);
    }
    match term {
        Term::Stiffness(_) => {
            let largest = amplitudes(fit).0;
            let pull = largest + fit.motion().beyond(largest);
            (pull <= 0.0).then_some(Objection::PushesAway)
        }
        // two modes near one frequency, one of them growing, can mimic a change of frequency or damping
        Term::Line(Line::Mode) if fit.p[at] <= 0.0 || fit.p[SIGMA] <= 0.0 => Some(Objection::Alias),
        Term::Line(Line::Harmonic(_)) => None,
        Term::Line(_) => waves_of(term, at, &fit.p).iter().find_map(|wave| no_line(fit, wave)),
        _ => None,
    }
}

/// A line must swing often in the record, and before it has died away, and not so fast as the samples come;
/// and where it is within its own and the ring's width of the ring, it cannot be told from a ring that changes.
fn no_line(fit: &Fit, wave: &Wave) -> Option<Objection> {
    let resolution = TAU / fit.decays.samples as f64;
    let omega = wave.omega;
    let swings =
        omega > fit.decays.lowest_line() && omega < PI - resolution && wave.sigma * 0.5 < omega;
    let own = fit.p[OMEGA];
    // a frequency that changes with amplitude sweeps this share of itself during a decay
    let swept = (fit.motion().frequency_ratio(amplitudes(fit).0) - 1.0).abs();
    let width = resolution.max(wave.sigma.abs() + fit.p[SIGMA].abs()).max(swept * own);
    match swings {
        false => Some(Objection::NoLine),
        true => ((omega - own).abs() < width).then_some(Objection::OwnLine),
    }
}

/// Largest and smallest amplitude of the ring in these decays, in the scale of the first output. The smallest
/// is not below the root mean square of that output's misfit.
pub fn amplitudes(fit: &Fit) -> (f64, f64) {
    let (mut largest, mut smallest) = (0.0_f64, f64::INFINITY);
    for burst in 0..fit.decays.bursts {
        for [x, u] in fit.path(burst, fit.decays.samples) {
            let size = x.hypot(u);
            largest = largest.max(size);
            smallest = smallest.min(size);
        }
    }
    let noise = fit.sizes()[0];
    (largest.max(1e-12), smallest.max(noise).max(1e-9).min(largest.max(1e-12)))
}
