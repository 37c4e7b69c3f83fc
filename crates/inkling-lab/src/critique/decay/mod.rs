//! The critique of few, long decays of one oscillator (a pendulum, a beam, a circuit).
//!
//! In: decays of one system, in bursts of one or more outputs, in any unit; a few of many are looked at. Out:
//! the same [`Outcome`] as for a printhead, without an extended design. The trajectory itself is fitted
//! (`fit`, `motion`): a damped oscillation for all outputs, then whatever terms the decays ask for
//! (`selection`). There is no drive scan, but a long decay goes through all amplitudes.
//!
//! In this folder *numbers* are the fitted parameters, a *series* is one output in one burst, a *line* is an
//! added oscillation, and the *misfit* is measured minus simulated.

mod children;
mod decays;
mod elimination;
mod fit;
mod gain;
mod lost;
mod motion;
mod noise;
mod onset;
mod plant;
mod rest;
mod selection;
#[cfg(test)]
mod slow_tests;
mod structure;
mod terms;
#[cfg(test)]
mod tests;
mod words;

use super::catalogue::InDecays;
use super::chance::{THRESHOLD, surprise};
use super::finding::{
    Cause, Critique, GainFigures, NotTestable, Signals, Structure, VERSION, Verdict,
};
use super::observations::Observations;
use super::outcome::{CritiqueError, NotExtended, Outcome};
use super::tuned::MOSTLY;
use super::words::{Unexplained, not_worth, ties};
use super::work;
use crate::plot::digits;
use children::misfit_power;
use decays::Decays;
use inkling_core::model::inner_product::dot;
use inkling_core::model::spectrum;
use inkling_core::numbers::FEW;
use noise::{ROUNDED, sizes};
use selection::Selected;
use std::collections::BTreeMap;
use std::f64::consts::TAU;

pub use decays::MOST_SAMPLES;

/// How often decays are looked at, each time without the samples that were far off before.
const MOST_LOOKS: usize = 3;

/// What is left of the misfit. `named`: some cause has a name.
///
/// The part of the misfit that follows from the samples before, by the autoregression of `selected.noise`, is
/// taken for the model's own error, the rest for noise. The share that is left is that part over the same
/// part of the plain oscillation's misfit, each summed over outputs. Significant is: a rival in the model
/// where nothing has a name; a misfit that is not white, if something has a name or more than half of some
/// output's misfit is predictable; and, where nothing has a name, a misfit that is spread unevenly.
fn left(selected: &Selected, named: bool, gain: &GainFigures) -> Unexplained {
    let decays = selected.fit.decays;
    let misfit = selected.fit.misfit();
    let (before, after) = (selected.baseline.sizes(), sizes(&misfit, decays));
    if after.iter().all(|size| *size <= ROUNDED) {
        return Unexplained { share_allowed: 1.0, ..Default::default() };
    }

    // In squares of what is left of each output: `floor` is the part that nothing predicts; `missed` and
    // `rest` sum what the plain oscillation and the final model leave beyond it.
    let (mut missed, mut rest, mut predictable) = (0.0, 0.0, 0.0_f64);
    for (o, colour) in selected.noise.colours.iter().enumerate() {
        let floor = (colour.sds[colour.order()] / after[o]).powi(2).min(1.0);
        missed += ((before[o] / after[o]).powi(2) - floor).max(0.0);
        rest += 1.0 - floor;
        predictable = predictable.max(1.0 - floor);
    }

    let mut significant = Vec::new();
    if let Some(like) = selected.strongest_rival().filter(|_| !named) {
        significant.push(format!("something like {}", like.form.term.words()));
    }
    significant.extend(words::drift(&selected.fit).filter(|_| !named));
    let mut noted = Vec::new();
    let p = gain::whiteness(&misfit, decays, std::slice::from_ref(&(0..decays.samples)));
    let p = p.min(if named { 1.0 } else { gain.whiteness_p });
    if p < 1e-4 {
        let is_model = named || predictable > MOSTLY;
        let to = if is_model { &mut significant } else { &mut noted };
        to.push(not_white(p, predictable, &misfit, decays));
    }
    if let Some(at) = lost::uneven(&misfit, decays).filter(|_| !named) {
        let at = digits::short(decays.time_s(at));
        significant.push(format!(
            "the misfit that is left is not spread evenly: much of it lies about {at} s"
        ));
    }
    // misfit that may be the noise's own colour takes no name away
    let share_allowed = if predictable > MOSTLY { MOSTLY } else { 1.0 };
    let share = (rest / missed.max(1e-12)).min(1.0);
    Unexplained { significant, noted, share, share_allowed }
}

/// The remark on a misfit that is not white. `p`: probability by chance; `predictable`: share of the misfit.
fn not_white(p: f64, predictable: f64, misfit: &[f64], decays: &Decays) -> String {
    let power = misfit_power(misfit, decays);
    let peak = spectrum::peaks(&power, 0.0, 1e9, 1).first().copied().unwrap_or(0.0);
    format!(
        "the misfit that is left is not white ({}; {:.0} % of it follows from the samples before; its spectrum \
         peaks at {} Hz)",
        digits::p_is(p),
        100.0 * predictable,
        digits::short(peak / (TAU * decays.dt_s))
    )
}

fn unexplained(selected: &Selected, left: &Unexplained) -> Vec<String> {
    let unnamed = selected.unnamed.iter().map(|t| {
        format!(
            "{} would take {:.0} % of what is left, but {}: it is not named",
            t.form.term.words(),
            100.0 * t.form.share.max(0.0),
            t.why_not()
        )
    });
    left.remarks().into_iter().chain(unnamed).collect()
}

/// Criticises the model of decays, and again with what the model simulates in the place of single samples far off it,
/// until no further ones are. Error: nothing rings, or the bursts are no decays of one system.
pub fn critique(data: &Observations) -> Result<Outcome, CritiqueError> {
    let mut all = Decays::of(data)?;
    let clipped = lost::clipped(&all);
    let held = lost::held(&all);
    let mut strays = BTreeMap::new();
    let mut left = MOST_LOOKS;
    loop {
        left -= 1;
        all.work.begins(work::ONSET);
        let decays = all.from(onset::onset(&all));
        let selected = selection::select(&decays);
        let (misfit, known) = (selected.fit.misfit(), strays.len());
        for (i, far) in lost::strays(&selected.fit) {
            let place = i + (i / decays.samples + 1) * decays.skipped;
            strays.entry(place).or_insert(far);
            all.y[place] -= misfit[i];
        }
        if strays.len() == known || left == 0 {
            let clips = clipped.iter().any(|i| i % all.samples >= decays.skipped);
            let mut lost = lost_in_words(&all, clipped.len(), &strays);
            let why_none = clips.then(|| lost.remove(0)).or(held);
            return judged(data, &selected, lost, why_none);
        }
    }
}

/// What is said of samples that are clipped; then of stray ones, each with how far off it is.
fn lost_in_words(all: &Decays, clipped: usize, strays: &BTreeMap<usize, f64>) -> Vec<String> {
    let clips = format!("{clipped} samples stand at the largest or smallest value: clipping");
    let times = strays.keys().take(FEW).map(|i| digits::short(all.time_s(*i)));
    let far = format!(
        "samples far off ({}, by up to {} standard deviations, at t = {}{} s) do not count",
        strays.len(),
        digits::short(strays.values().copied().fold(0.0, f64::max)),
        times.collect::<Vec<String>>().join(", "),
        if strays.len() > FEW { " ..." } else { "" }
    );
    let said = [(clipped, clips), (strays.len(), far)].into_iter();
    said.filter(|(count, _)| *count > 0).map(|(_, words)| words).collect()
}

/// `lost`: what is said of samples that count for nothing; `why_none`: why samples that were fitted give no name.
fn judged(
    data: &Observations,
    selected: &Selected,
    lost: Vec<String>,
    why_none: Option<String>,
) -> Result<Outcome, CritiqueError> {
    let decays = selected.fit.decays;
    // an offset may be the larger part of the signals, or a drift: the ring is judged by the movement that it explains
    let still = selected.fit.drift().map(|_| selected.fit.still().misfit());
    let (misfit, moved) = (selected.fit.misfit(), still.as_ref().unwrap_or(&decays.y));
    let explained = 1.0 - dot(&misfit, &misfit) / dot(moved, moved);
    if explained.is_nan() || !rings(selected, explained) {
        return Err(CritiqueError::NoRing);
    }

    decays.work.begins(work::GAIN);
    let (mut causes, mut remarks) = words::causes(selected);
    let (misfit, gain) = gain::measure(selected);
    let structure = structure::of(selected);
    let mut left = left(selected, !causes.is_empty(), &gain.after);
    let why_none = why_none.or_else(|| structure::why_no_decay(selected, &structure));
    let is_decay = why_none.is_none();
    if let Some(why) = why_none {
        causes.clear();
        remarks.clear();
        left.significant.insert(0, why);
    }
    left.noted.splice(0..0, lost);
    let verdict = Verdict::of(&mut causes, &left);
    let is_plain = selected.causes.is_empty() && selected.fit.drift().is_none();
    if verdict == Verdict::Unknown && is_decay && causes.is_empty() && is_plain {
        causes.extend(nearest(selected));
    }
    remarks.extend(not_worth(&causes, &gain));
    // the sentence of `None` tells it
    remarks.extend(left.noted.iter().filter(|_| verdict != Verdict::None).cloned());
    remarks.extend(unexplained(selected, &left));
    remarks.extend(ties(&causes));
    remarks.extend(of_the_record(data, decays, &structure));
    let critique = Critique {
        version: VERSION,
        verdict,
        sentence: verdict.sentence(&causes, &left, gain.detection()),
        equation: words::equation(selected),
        causes,
        not_testable: NotTestable::all(|e| match e.in_decays {
            InDecays::Fitted(_) => None,
            InDecays::Needs(needs) => Some(needs),
        }),
        misfit,
        gain,
        extended_model: None,
        plant: Some(structure),
        remarks,
        signals: Signals {
            found: data.found,
            used: decays.bursts * decays.outputs,
            outliers: 0,
            channels: decays.outputs,
            rejected: 0,
        },
        figures: gain::draw(selected),
        evidence: selected.evidence.clone(),
    };
    Ok(Outcome {
        critique,
        outlier: vec![false; data.len()],
        extended: Err(NotExtended::NoInkChannel),
    })
}

/// Remarks on how well the record's end is foreseen, and on what of it was not looked at.
fn of_the_record(data: &Observations, decays: &Decays, structure: &Structure) -> Vec<String> {
    let Decays { bursts, samples, incomplete, .. } = *decays;
    let mut remarks = vec![format!(
        "a forecast of the last 40 % of the record misses {} % of the movement, and {} % where the fitted model with noise is forecast",
        digits::short(structure.forecast.record_percent),
        digits::short(structure.forecast.control_percent)
    )];
    if decays.skipped > 0 {
        remarks.push(format!(
            "the decay is free from {} s after the first sample on: what comes before is driven or clipped, and was left out",
            digits::short(structure.onset_s)
        ));
    }
    if incomplete > 0 {
        remarks.push(format!("{incomplete} bursts were left out: not all outputs are in them"));
    }
    if !decays.whole || data.found > data.len() as u64 {
        remarks.push(format!(
            "{samples} samples of each of {} signals were looked at, in {bursts} bursts spread over the recording of {} signals",
            bursts * decays.outputs,
            data.found
        ));
    }
    remarks
}

/// Whether the model explains more than chance finds in as much noise. `explained`: share of the decays'
/// squares. The statistic -n ln(1 - explained) of n samples is compared with chi-squared of as many degrees
/// as there are numbers but for what is shown at rest, which is no movement, and one of n/2 frequencies was chosen.
fn rings(selected: &Selected, explained: f64) -> bool {
    let decays = selected.fit.decays;
    let samples = decays.y.len() as f64;
    let statistic = -samples * (1.0 - explained).max(1e-12).ln();
    let places = decays.samples as f64 / 2.0;
    let at_rest = selected.fit.at_rest.columns() * decays.bursts * decays.outputs;
    let degrees = selected.fit.parameters() - at_rest;
    surprise(statistic, degrees, places, f64::INFINITY) > THRESHOLD
}

/// The named candidate that takes most of the misfit away, though it cannot be the cause.
fn nearest(selected: &Selected) -> Option<Cause> {
    let named = selected.unnamed.iter().filter(|t| t.has_name());
    let t = named.max_by(|p, q| p.form.share.total_cmp(&q.form.share))?;
    Some(Cause {
        explains: Some(t.form.share.clamp(0.0, 1.0)),
        sentence: format!("nearest is {}, but {}", t.id, t.why_not()),
        ..t.cause(t.statistic)
    })
}
