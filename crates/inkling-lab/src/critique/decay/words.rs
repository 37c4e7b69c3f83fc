//! The causes of a decay in the catalogue's parameters, remarks on them, and the extended equation.
//!
//! In: [`Selected`], whose numbers are in samples and in the scale of the decays. Out: causes in
//! the unit of the catalogue, and texts in seconds and in the unit of the recording, which says of it no
//! more than that it has one: [`UNIT`].

use super::children::amplitudes;
use super::motion::Form;
use super::plant::{Fit, OMEGA, SIGMA, waves_of};
use super::selection::{Selected, Tried};
use super::terms::Term;
use crate::critique::catalogue::{CauseId, InDecays};
use crate::critique::finding::{Cause, UNIT};
use crate::critique::words::cause_sentence;
use crate::plot::digits;
use nalgebra::{DMatrix, DVector};
use std::f64::consts::TAU;
use std::fmt::Write;

/// Value of a cause in the catalogue's parameter, with its 95 % interval. `index` counts causes and terms alike.
fn value(selected: &Selected, index: usize) -> (f64, [f64; 2]) {
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
            Term::Unnamed(_) => f64::NAN,
        }
    };

    propagated((&selected.fit, &selected.covariance), of)
}

/// A number that follows from those of the fit, with its 95 % interval by linear propagation: by central
/// differences of a hundredth of the numbers' errors, where the amplitudes are held.
fn propagated(
    (fit, covariance): (&Fit, &DMatrix<f64>),
    of: impl Fn(&Fit) -> f64,
) -> (f64, [f64; 2]) {
    let gradient = DVector::from_fn(fit.p.len(), |j, _| {
        let h = 0.01 * covariance[(j, j)].max(0.0).sqrt();
        let moved = |by: f64| {
            let mut moved = fit.clone();
            moved.p[j] += by;
            of(&moved)
        };
        if h > 0.0 && h.is_finite() { (moved(h) - moved(-h)) / (2.0 * h) } else { 0.0 }
    });
    let variance = gradient.dot(&(covariance * &gradient));
    let (value, half) = (of(fit), 1.96 * variance.max(0.0).sqrt());
    (value, [value - half, value + half])
}

/// The named causes, the strongest first, and remarks: on the form of the spring, the offsets, a drift, rivals in the
/// model, and causes that are too weak to keep their name.
pub fn causes(selected: &Selected) -> (Vec<Cause>, Vec<String>) {
    let ln_samples = selected.fit.decays.ln_samples();
    let (mut found, mut remarks) = (Vec::new(), Vec::new());
    for (index, chosen) in selected.causes.iter().enumerate() {
        let candidate = &chosen.candidate;
        if !selected.is_named(candidate) {
            remarks.push(unnamed(candidate));
            continue;
        }
        let mut cause = chosen.cause();
        (cause.value, cause.ci95) = value(selected, index);
        cause.delta_bic = candidate.delta_bic(ln_samples);
        found.push(cause);
        remarks.extend(spring(selected, candidate.form.term));
    }
    let offset = &selected.offset;
    if selected.is_named(offset) {
        found.push(offset.cause(offset.delta_bic(ln_samples)));
        remarks.extend(offsets(&selected.fit));
    } else if offset.accepted() {
        remarks.push(too_weak(offset.id));
    }
    found.iter_mut().for_each(|cause| cause.sentence = sentence(cause));
    found.sort_by(|p, q| q.strength_dl.total_cmp(&p.strength_dl));
    remarks.extend(drift(&selected.fit));
    remarks.extend(selected.told.as_ref().map(|(told, _)| {
        format!(
            "modes and equation are those without what has no name: alone, they miss {} % of the movement",
            digits::short(100.0 * told.left())
        )
    }));
    (found, remarks)
}

/// The remark on what is in the model and has no name, or not enough to keep it.
fn unnamed(candidate: &Tried) -> String {
    match candidate.has_name() {
        true => too_weak(candidate.id),
        false => format!(
            "the misfit is like {}, which the catalogue has no name for ({} DL)",
            candidate.form.term.words(),
            digits::significant(candidate.strength_dl(), 2)
        ),
    }
}

fn too_weak(id: CauseId) -> String {
    format!(
        "{id} explains less than what has no name, or than one detection limit beside others: it is not named"
    )
}

/// The remark on the form of a spring, if the term is one.
fn spring(selected: &Selected, term: Term) -> Option<String> {
    let Term::Stiffness(form) = term else { return None };
    let what = match form {
        _ if !selected.form_is_known => "x + k x^3 and a pendulum's sine fit the spring alike",
        Form::Cubic => "x + k x^3 fits the spring better than a pendulum's sine",
        Form::Sine => "a sine (a pendulum's torque) fits the spring better than x + k x^3",
    };
    Some(what.into())
}

/// The remark on the offset of each of several outputs.
fn offsets(fit: &Fit) -> Option<String> {
    let line =
        |(offset, channel): (f64, &u32)| format!("{} on channel {channel}", digits::short(offset));
    let each: Vec<String> =
        fit.offsets(0).into_iter().zip(&fit.decays.channels).map(line).collect();
    (each.len() > 1).then(|| format!("offsets, {UNIT}: {}", each.join(", ")))
}

/// What is said of a zero that drifts, of the output in which it drifts farthest.
pub fn drift(fit: &Fit) -> Option<String> {
    fit.drift()?;
    let decays = fit.decays;
    let [first, last] = [0, decays.samples - 1].map(|k| fit.offsets(k));
    let farthest = (0..decays.outputs).max_by(|p, q| {
        let size = |o: usize| (last[o] - first[o]).abs() / decays.scale[o];
        size(*p).total_cmp(&size(*q))
    })?;
    let channel = match decays.outputs {
        1 => String::new(),
        _ => format!(" on channel {}", decays.channels[farthest]),
    };
    Some(format!(
        "what the sensor shows at rest drifts{channel}, from {} {UNIT} at t = {} s to {} at the end",
        digits::significant(first[farthest], 3),
        digits::short(decays.time_s(0)),
        digits::significant(last[farthest], 3)
    ))
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
    let (fit, covariance) = selected.told();
    let decays = fit.decays;
    let (dt, scale) = (decays.dt_s, decays.scale[0]);
    let mut text = String::from("x'' = -2 s x' - w^2 ");
    let mut numbers: Vec<String> = Vec::new();
    let mut number = |name: &str, unit: &str, of: &dyn Fn(&Fit) -> f64| {
        let (value, interval) = propagated((fit, covariance), of);
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
    let mut of_outputs = |name: &str, unit: &str, values: &[f64]| {
        for (value, channel) in values.iter().zip(&decays.channels) {
            let name = match decays.outputs {
                1 => name.to_owned(),
                _ => format!("{name}_{channel}"),
            };
            offsets.push(format!("{name} = {} {unit}", digits::significant(*value, 5)));
        }
    };
    let first = fit.offsets(0);
    of_outputs("b", UNIT, &first);
    if let Some(at) = fit.drift() {
        text += if decays.outputs > 1 { " + v_j" } else { " + v" };
        text += " (1 - e^(-r t))/r";
        let per_s = fit.p[at] / dt / (-fit.p[at]).exp_m1();
        let slopes = first.iter().zip(fit.offsets(1)).map(|(b, next)| (b - next) * per_s);
        of_outputs("v", "units/s", &slopes.collect::<Vec<f64>>());
        number("r", "1/s", &|fit| fit.p[at] / dt);
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
