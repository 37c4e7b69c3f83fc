//! Objections to fitted terms of decays: signs and sizes that no such cause can have.
//!
//! In: a fit, the index of one of its terms, and the covariance of its numbers. Out: why the term cannot be
//! the cause although it fits. What else could explain as much is no objection: it competes (`selection`).

use super::decays::Decays;
use super::plant::{Fit, OMEGA, SIGMA, Wave, waves_of};
use super::terms::{Line, Term};
use crate::critique::candidate::Objection;
use crate::critique::candidates::LEAST_PERIODS;
use nalgebra::DMatrix;
use std::f64::consts::{PI, TAU};

pub fn lowest_line(decays: &Decays) -> f64 {
    TAU * LEAST_PERIODS / decays.samples as f64
}

/// Why a fitted term cannot be what it is called. `index`: the term's among the fit's terms.
pub fn objection(fit: &Fit, index: usize, covariance: &DMatrix<f64>) -> Option<Objection> {
    let (term, at) = fit.placed().nth(index)?;
    if matches!(term, Term::Drag | Term::Friction) && fit.p[at] <= 0.0 {
        return Some(Objection::UnphysicalSign);
    }
    // a ring that grows by itself, with certainty, is not damped by whatever term was added
    let sd = covariance[(SIGMA, SIGMA)].max(0.0).sqrt();
    if fit.p[SIGMA] < -3.0 * sd && term != Term::Offset {
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
        omega > lowest_line(fit.decays) && omega < PI - resolution && wave.sigma * 0.5 < omega;
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
