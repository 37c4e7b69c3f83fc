//! The model of a printhead from the signals of its window: averaging and identification, thesis §3-1.
//!
//! In: a window's signals, from `windows`. Out: the model ([`Accepted`]), or why the window gives none.
//!
//! The signals are averaged and a model fitted (`HealthyModel::learn`). The model is refused if it does not describe
//! the signals, or if these differ too much from each other. With a design it is refused, too, if its resonance,
//! damping or typical distance lie too far from the design's model of the printhead, or else its pooled one: a fault
//! that grows slowly must not be learned as healthy.

use super::super::run::Replay;
use super::sample::Sample;
use inkling_core::design::{Design, HealthyModel, LearnSettings};

/// Least share of the average signal's size that the model must explain, per cent. The three are heuristic.
const LEAST_FIT_PERCENT: f64 = 50.0;
/// Signals that differ by more than this share of the expected signal have no healthy signal in common.
const MOST_SCATTER: f64 = 0.5;
/// The threshold follows a window's median statistic up to this factor from the reference's; with more, nothing
/// would be found.
const MOST_RATIO: f64 = 4.0;

/// Why a window gives no model, and whether that is a drift beyond the bounds of the settings.
type NoModel = (String, bool);

#[derive(Debug)]
pub struct Accepted {
    pub model: HealthyModel,
    /// Drive voltage at which it expects its signals, V: the design's, or the mean of the window.
    pub reference_v: Option<f64>,
}

pub fn learn(
    replay: &Replay,
    printhead: &str,
    sample_period_s: f64,
    sample: &Sample,
) -> Result<Accepted, NoModel> {
    let (design, identify) = (replay.design.as_ref(), &replay.settings.identify);
    let reference = design.map(|design| design.reference_of(printhead));
    let reference_v = match design {
        Some(design) => design.drive_voltage_v,
        None => sample.mean_voltage(),
    };

    // average and fit; labels say which signals are healthy, else enough of them must agree
    let settings = LearnSettings {
        grey_box: &identify.grey_box,
        detect: &replay.settings.detect,
        least_agreeing: replay.labels.is_none().then_some(identify.least_agreeing),
        sample_period_s,
        filter: design.and_then(|design| design.filter.as_ref()),
    };
    let set = sample.to_set(reference_v);
    let model = HealthyModel::learn(&set, Some(printhead), reference, settings)
        .map_err(|e| (sample.advice(&e, replay.labels.is_some()), false))?;
    if replay.labels.is_none() {
        agree_with(&model).map_err(|why| (why, false))?;
    }
    if let Some(design) = design {
        is_like(design.reference_of(printhead), &model, replay)
            .map_err(|(why, is_other)| (why + &unknown_name(design, printhead), is_other))?;
    }
    Ok(Accepted { model, reference_v })
}

/// Noise, or a mixture of healthy and faulty channels, does not agree. The error says why in words.
fn agree_with(model: &HealthyModel) -> Result<(), String> {
    let fit = model.identification.fit_percent;
    // a fit that is no number is refused too
    if !matches!(fit.partial_cmp(&LEAST_FIT_PERCENT), Some(o) if o.is_ge()) {
        return Err(format!(
            "the model explains {fit:.0} % of the average signal, {LEAST_FIT_PERCENT} % are needed: \
             nothing rings in this window"
        ));
    }
    // mean squares: of the expected signal, and of what signals differ by beyond noise
    let expected = model.expected.iter().map(|y| y * y).sum::<f64>() / model.expected.len() as f64;
    let scatter = (model.scatter.powi(2) - model.noise.powi(2)).max(0.0);
    if scatter > MOST_SCATTER.powi(2) * expected {
        return Err(format!(
            "the signals differ from each other by {:.0} % of the expected signal: no healthy signal \
             that most of them have in common; choose another window or give labels",
            100.0 * (scatter / expected).sqrt()
        ));
    }
    Ok(())
}

/// Most printheads of a design that are named.
const MOST_NAMED: usize = 4;

/// What to look at first where a design has no model of this name; empty if it has one, or none at all.
fn unknown_name(design: &Design, printhead: &str) -> String {
    let known: Vec<&str> = design.models.iter().filter_map(|of| of.printhead.as_deref()).collect();
    if known.is_empty() || known.contains(&printhead) {
        return String::new();
    }
    let more = if known.len() > MOST_NAMED { " and others" } else { "" };
    let some = known[..known.len().min(MOST_NAMED)].join(", ");
    format!("; or another name, as the design knows {some}{more}, and not {printhead}")
}

/// Compares a window's model with the design's: a fault that grows slowly must not be learned as healthy.
fn is_like(reference: &HealthyModel, model: &HealthyModel, replay: &Replay) -> Result<(), NoModel> {
    let identify = &replay.settings.identify;
    let (frequency, damping) = reference.drift_to(model);
    for (what, drift, most) in [
        ("frequency", frequency, identify.max_frequency_drift),
        ("damping", damping, identify.max_damping_drift),
    ] {
        // a drift that is no number is refused too
        if !matches!(drift.abs().partial_cmp(&most), Some(o) if o.is_le()) {
            let why = format!(
                "{what} {:+.2} % from the reference model, beyond \
                 identify.max_{what}_drift = {:.2} %: a slow fault or another ink",
                100.0 * drift,
                100.0 * most
            );
            return Err((why, true));
        }
    }

    // how far healthy signals typically lie from their model, relative to what its metric predicts
    let ratio = model.typical_distance() / reference.typical_distance();
    if !(1.0 / MOST_RATIO..=MOST_RATIO).contains(&ratio) {
        let why = format!(
            "healthy signals lie {ratio:.3} times as far from the model as in the \
             reference: another amplitude or another noise"
        );
        return Err((why, false));
    }
    Ok(())
}
