//! The causes of a decay in the catalogue's parameters, remarks on them, and the extended equation.
//!
//! In: [`Selected`], whose numbers are in samples and in the scale of the decays. Out: causes in
//! the unit of the catalogue, and texts in seconds and in the unit of the recording, which says of it no
//! more than that it has one: [`UNIT`].

use super::children::{Added, amplitudes};
use super::motion::Form;
use super::plant::{Fit, OMEGA, SIGMA, waves_of};
use super::selection::Selected;
use super::terms::Term;
use crate::critique::candidate::Chosen;
use crate::critique::catalogue::InDecays;
use crate::critique::finding::{Cause, UNIT};
use crate::critique::words::cause_sentence;
use crate::plot::digits;
use nalgebra::DVector;
use std::f64::consts::TAU;
use std::fmt::Write;

/// Value of a cause in the catalogue's parameter, with its standard error by linear propagation.
/// `index` counts causes and terms alike. An offset has been measured already.
fn value(selected: &Selected, index: usize) -> (f64, f64) {
    let dt = selected.fit.decays.dt_s;
    let (largest, smallest) = amplitudes(&selected.fit);
    let of = |fit: &Fit| -> f64 {
        let motion = fit.motion();
        let Some((term, at)) = fit.placed().nth(index) else { return f64::NAN };
        match term {
            Term::Stiffness(_) => motion.frequency_ratio(largest) - 1.0,
            // the damping at the largest amplitude relative to that at the smallest, less 1; the
            // latter may vanish, so it is taken for 1e-4 of the former at least
            Term::Drag | Term::Friction => {
                let small = motion.damping_at(smallest);
                motion.damping_at(largest)
                    / small.abs().max(1e-4 * motion.damping_at(largest).abs())
                    - 1.0
            }
            Term::Line(_) => {
                let waves = waves_of(term, at, &fit.p);
                waves.first().map_or(f64::NAN, |w| w.omega) / (TAU * dt)
            }
            Term::Offset | Term::Unnamed(_) => f64::NAN,
        }
    };

    propagated(selected, of)
}

/// A number that follows from those of the fit, with its standard error by linear propagation: by central
/// differences of a hundredth of the numbers' errors, where the amplitudes are held.
fn propagated(selected: &Selected, of: impl Fn(&Fit) -> f64) -> (f64, f64) {
    let fit = &selected.fit;
    let gradient = DVector::from_fn(fit.p.len(), |j, _| {
        let h = 0.01 * selected.covariance[(j, j)].max(0.0).sqrt();
        let moved = |by: f64| {
            let mut moved = fit.clone();
            moved.p[j] += by;
            of(&moved)
        };
        if h > 0.0 && h.is_finite() { (moved(h) - moved(-h)) / (2.0 * h) } else { 0.0 }
    });
    let variance = gradient.dot(&(&selected.covariance * &gradient));
    (of(fit), variance.max(0.0).sqrt())
}

/// The named causes, the strongest first, and remarks: on further lines of one kind, rivals in the
/// model, and causes that are too weak to keep their name.
pub fn causes(selected: &Selected) -> (Vec<Cause>, Vec<String>) {
    let decays = selected.fit.decays;
    let mut found: Vec<Cause> = Vec::new();
    let mut remarks = Vec::new();
    let mut order: Vec<(usize, &Chosen<Added>)> = selected.causes.iter().enumerate().collect();
    order.sort_by(|(_, p), (_, q)| q.candidate.statistic.total_cmp(&p.candidate.statistic));
    let named: Vec<usize> = selected.named().map(|(index, _)| index).collect();
    for (index, chosen) in order {
        let (id, term) = (chosen.candidate.id, chosen.candidate.form.term);
        if term == Term::Offset && !chosen.candidate.accepted() {
            continue; // every series has one; none that all share was found
        }
        // what has no name, or not enough to keep it, becomes a remark
        if !id.has_name() {
            remarks.push(format!(
                "the misfit is like {}, which the catalogue has no name for ({} DL)",
                term.words(),
                digits::significant(chosen.candidate.strength_dl(), 2)
            ));
            continue;
        }
        if !named.contains(&index) {
            remarks.push(format!(
                "{id} explains less than what has no name, or than one detection limit beside others: it is not named"
            ));
            continue;
        }
        let mut chosen = chosen.clone();
        if term != Term::Offset {
            (chosen.candidate.value, chosen.candidate.sd) = value(selected, index);
        }
        chosen.delta_bic = chosen.candidate.delta_bic(decays.ln_samples());
        let mut cause = chosen.cause();
        cause.sentence = sentence(&cause);
        if term == Term::Offset && decays.outputs > 1 {
            let offsets = selected.fit.offsets();
            let line = |(offset, channel): (f64, &u32)| {
                format!("{} on channel {channel}", digits::short(offset))
            };
            let each: Vec<String> = offsets.into_iter().zip(&decays.channels).map(line).collect();
            remarks.push(format!("offsets, {UNIT}: {}", each.join(", ")));
        }
        if let Term::Stiffness(form) = term {
            let what = match form {
                _ if !selected.form_is_known => {
                    "x + k x^3 and a pendulum's sine fit the spring alike"
                }
                Form::Cubic => "x + k x^3 fits the spring better than a pendulum's sine",
                Form::Sine => "a sine (a pendulum's torque) fits the spring better than x + k x^3",
            };
            remarks.push(what.into());
        }
        found.push(cause);
    }
    (found, remarks)
}

fn sentence(cause: &Cause) -> String {
    let entry = cause.id.row();
    let words = match entry.in_decays {
        InDecays::Fitted(Some(words)) => words,
        InDecays::Fitted(None) | InDecays::Needs(_) => entry.words,
    };
    cause_sentence(&Cause { unit: cause.unit.replace("counts", UNIT), ..cause.clone() }, words)
}

/// The fitted equation: the equation of motion, what an output shows, and lines of a name; then a line for each
/// number but the amplitudes of lines and the shares of outputs, with its 95 % interval.
pub fn equation(selected: &Selected) -> String {
    let fit = &selected.fit;
    let decays = fit.decays;
    let (dt, scale) = (decays.dt_s, decays.scale[0]);
    let mut text = String::from("x'' = -2 s x' - w^2 ");
    let mut numbers: Vec<String> = Vec::new();
    let mut number = |name: &str, unit: &str, of: &dyn Fn(&Fit) -> f64| {
        let (value, sd) = propagated(selected, of);
        let interval = [value - 1.96 * sd, value + 1.96 * sd];
        numbers.push(format!("{name} = {}", digits::measured(value, interval, unit)));
    };
    number("s", "1/s", &|fit| fit.p[SIGMA] / dt);
    number("w", "rad/s", &|fit| fit.p[OMEGA] / dt);

    // In the equation x is in units of the recording and t in s; in the fit x is in `scale` units, the largest
    // deviation of the first output from its mean, and t in samples.
    let k = |fit: &Fit| fit.motion().stiffness / (scale * scale);
    let c = |fit: &Fit| (6.0 * k(fit).abs()).sqrt();
    match fit.motion().form {
        _ if !fit.terms.iter().any(|term| matches!(term, Term::Stiffness(_))) => text += "x",
        Form::Sine => {
            text += if k(fit) < 0.0 { "sin(c x)/c" } else { "sinh(c x)/c" };
            number("c", "1/unit", &c);
        }
        Form::Cubic => {
            text += "(x + k x^3)";
            number("k", "1/unit^2", &k);
        }
    }
    if fit.terms.contains(&Term::Drag) {
        text += " - d |x'| x'";
        number("d", "1/unit", &|fit| fit.motion().drag / scale);
    }
    if fit.terms.contains(&Term::Friction) {
        text += " - m sign(x')";
        let of = |fit: &Fit| fit.motion().stick * fit.p[OMEGA].powi(2) * scale / (dt * dt);
        number("m", "units/s^2", &of);
    }
    text += if decays.outputs > 1 { "\ny_j = g_j x + h_j x'" } else { "\ny = x" };
    text += if decays.outputs > 1 { " + b_j" } else { " + b" };
    let mut offsets: Vec<String> = Vec::new();
    for (offset, channel) in fit.offsets().into_iter().zip(&decays.channels) {
        let name = match decays.outputs {
            1 => "b".to_owned(),
            _ => format!("b_{channel}"),
        };
        offsets.push(format!("{name} = {} {UNIT}", digits::significant(offset, 5)));
    }

    // lines are numbered from 2 on, after the ring
    let named = |term: Term| matches!(term, Term::Line(_)) && term.id().has_name();
    let lines = fit.placed().filter(|(term, _)| named(*term));
    for (n, (term, at)) in (2..).zip(lines) {
        let _ = write!(text, " + e^(-s{n} t) (p{n} cos w{n} t + q{n} sin w{n} t)");
        for i in 0..waves_of(term, at, &fit.p).len() {
            let wave = |fit: &Fit| waves_of(term, at, &fit.p).swap_remove(i);
            number(&format!("s{n}"), "1/s", &|fit| wave(fit).sigma / dt);
            number(&format!("w{n}"), "rad/s", &|fit| wave(fit).omega / dt);
        }
    }
    numbers.append(&mut offsets);
    format!("{text} + e\n{}", numbers.join("\n"))
}
