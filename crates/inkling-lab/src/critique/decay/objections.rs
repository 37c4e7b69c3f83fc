//! Objections to fitted terms of decays: unphysical signs, and lines that are something else.
//!
//! In: a fit, the index of one of its terms, and the covariance of its numbers. Out: why the term cannot be
//! the cause although it fits. A line is compared with all that could make one: the ring and its multiples up
//! to the eighth (as wide as the ring's frequency sweeps with the amplitude), their mirror images at half the
//! sampling rate, and lines found before. Widths and factors are rules of thumb.

use super::decays::Decays;
use super::fit::Fit;
use super::plant::{OMEGA, SIGMA, path};
use super::terms::{Line, Term};
use crate::critique::candidates::LEAST_PERIODS;
use crate::critique::objection::Objection;
use crate::critique::tuned::HARMONIC;
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
        Term::Line(line) => line_objection(fit, line, at, covariance),
        _ => None,
    }
}

/// Why a line cannot be what it is called. `at`: the index at which its numbers begin.
fn line_objection(
    fit: &Fit,
    line: Line,
    at: usize,
    covariance: &DMatrix<f64>,
) -> Option<Objection> {
    let lines: Vec<(usize, Vec<f64>)> = fit.lines().take_while(|(place, _)| *place <= at).collect();
    let ((_, frequencies), before) = lines.split_last()?;
    let sigma = fit.p[at];
    let sd = covariance[(at, at)].max(0.0).sqrt();

    // two modes near one frequency, one of them growing, can mimic a change of frequency or damping
    if line == Line::Mode && (sigma <= 0.0 || fit.p[SIGMA] <= 0.0) {
        return Some(Objection::Alias);
    }
    if line == Line::Mode && sigma < 2.0 * sd {
        return Some(Objection::Undamped);
    }

    let width = if line == Line::Mode { sigma } else { 0.0 };
    if let Some(objection) =
        frequencies.iter().find_map(|omega| place_objection(fit, *omega, sigma, width))
    {
        return Some(objection);
    }
    let resolution = TAU / fit.decays.samples as f64;
    for (other, known) in before {
        let reach = resolution.max(0.5 * (sigma.abs() + fit.p[*other].abs()));
        if frequencies.iter().any(|omega| known.iter().any(|k| (omega - k).abs() < reach)) {
            return Some(Objection::KnownLine);
        }
    }
    (sigma * 0.5 > frequencies[0]).then_some(Objection::NoLine)
}

/// What else may ring at a line's frequency `omega`, rad per sample. `sigma`: the line's damping per sample;
/// `width`: the same of a mode, 0 of any other line.
fn place_objection(fit: &Fit, omega: f64, sigma: f64, width: f64) -> Option<Objection> {
    let own = fit.p[OMEGA];
    let resolution = TAU / fit.decays.samples as f64;
    if omega < lowest_line(fit.decays) || omega > PI - resolution {
        return Some(Objection::NoLine);
    }
    // a frequency that changes with amplitude sweeps this share of itself during a decay
    let largest = amplitudes(fit).0;
    let swept = (fit.motion().frequency_ratio(largest) - 1.0).abs();
    let near_ring = resolution.max(sigma.abs() + fit.p[SIGMA].abs()).max(swept * own);
    if (omega - own).abs() < near_ring {
        return Some(Objection::OwnLine);
    }
    for multiple in 2..=8 {
        let m = f64::from(multiple);
        // a harmonic is as wide as a line: a line that is no farther off than its own width may be either
        let near = (0.35 * resolution).max(HARMONIC * m * own).max(swept * m * own).max(width);
        // the multiple may lie above half the sampling rate, and be seen at its mirror image
        if (omega - m * own).abs().min((TAU - omega - m * own).abs()) < near {
            return Some(Objection::Multiple(multiple));
        }
    }
    None
}

/// Largest and smallest amplitude of the ring in these decays, in the scale of the first output. The smallest
/// is not below the root mean square of that output's misfit.
pub fn amplitudes(fit: &Fit) -> (f64, f64) {
    let motion = fit.motion();
    let (mut largest, mut smallest) = (0.0_f64, f64::INFINITY);
    let mut path_of = Vec::new();
    for burst in 0..fit.decays.bursts {
        path(&motion, &fit.p, burst, fit.decays.samples, &mut path_of);
        for [x, u] in &path_of {
            let size = x.hypot(*u);
            largest = largest.max(size);
            smallest = smallest.min(size);
        }
    }
    let noise = fit.sizes()[0];
    (largest.max(1e-12), smallest.max(noise).max(1e-9).min(largest.max(1e-12)))
}
