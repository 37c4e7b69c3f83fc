//! The critique of ink channels, each signal of which is one ring, from observations to findings; and the
//! choice between it and the critique of an oscillator's decays (`decay`).
//!
//! In: [`Observations`] of healthy signals, counts. Out: an [`Outcome`]: the findings (`Critique`), which
//! signals were left out, and the model that a design's extension is made from.
//!
//! This file only puts the steps in order; each is the work of another file:
//!
//! 1. outliers are left out, unless labels say that all signals are healthy (`outliers`);
//! 2. the baseline is fitted (`start`, `scatter`), and codes and noise are tested (`codes`, `ensemble`);
//! 3. if the noise is correlated, the signals are made white, and their baseline and noise tested anew;
//! 4. causes that move the expected signal are selected (`selection`);
//! 5. clipping is tested again beside these causes, and the trigger for the first time (`jitter`);
//! 6. what is left is judged without the catalogue (`adequacy`);
//! 7. the gain is measured on held-out signals (`gain`, `worth`);
//! 8. verdict, remarks and sentences are written.
//!
//! Codes and noise come before the causes, because the tests of causes assume white noise.

use super::autoregression::Autoregression;
use super::candidate::{Candidate, Objection};
use super::candidates::Setting;
use super::catalogue::{Acts, CauseId};
use super::chance::without_a_name;
use super::finding::{
    Cause, Critique, Detection, Evidence, NotTestable, Signals, VERSION, Verdict,
};
use super::leftovers::{Artefacts, accepted, leave_out};
use super::model::Model;
use super::observations::Observations;
use super::outcome::{self, FEWEST_SAMPLES, FEWEST_SIGNALS, OutlierCount};
pub use super::outcome::{CritiqueError, Extended, NotExtended, Outcome};
use super::outliers::{Outliers, outliers};
use super::selection::{self, Selected};
use super::words::{cause_sentence, equation, not_worth, ties};
use super::{adequacy, codes, decay, ensemble, figures, gain, jitter, work, worth};
use inkling_core::numbers::LITTLE;
use std::f64::consts::TAU;

/// Largest number of times that the signals are made white, each time by a better estimate.
const MOST_WHITENINGS: usize = 10;
/// Correlation at lag 1 that may be left after whitening: about a tenth of the detection limit of a
/// correlation in 200 signals of 128 samples (√20.9 standard errors of 1/√25 600).
const NEARLY_WHITE: f64 = 0.003;
/// Longer signals of ink channels are cut to so many samples, by whoever reads them.
pub const MOST_SAMPLES: usize = 512;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rings {
    /// Thesis (2-2): a damped pair and a real pole.
    InkChannel,
    /// A damped oscillator whose displacement is measured: one damped pair, no real pole; few, long decays.
    Oscillator,
}

/// Criticises the model of signals; the entry point of the whole room. `labelled`: labels said that all of
/// them are healthy, so none is left out as an outlier. Errors: too few or too short signals, or none that rings; of an oscillator also those of `decay`.
pub fn critique(
    all: &Observations,
    rings: Rings,
    labelled: bool,
) -> Result<Outcome, CritiqueError> {
    check_enough(all.len(), rings)?;
    if all.samples < FEWEST_SAMPLES {
        return Err(CritiqueError::TooShort { samples: all.samples });
    }
    match rings {
        Rings::InkChannel => of_ink_channels(all, labelled),
        Rings::Oscillator => decay::critique(all),
    }
}

fn of_ink_channels(all: &Observations, labelled: bool) -> Result<Outcome, CritiqueError> {
    all.work.begins(work::BASELINE);
    let first = Model::start(all).ok_or(CritiqueError::NoRing)?;
    let Outliers { out: mut outlier, shape_surprise } = outliers(all, &first);
    if labelled {
        // they stay in, but `shape_surprise` still says whether a few of them have a misfit with a shape
        outlier.fill(false);
    }
    let data = all.select(|i| !outlier[i]).standardised();
    check_enough(data.len(), Rings::InkChannel)?;

    // `data` are now the white signals, `unwhitened` the original ones if their noise was correlated
    let prepared = Prepared::of(data)?;
    let selected = prepared.select();
    let avoid = prepared.random_tone();
    let Prepared { data, unwhitened, coloured, baseline, mut artefacts } = prepared;
    let setting = Setting { data: &data, avoid: &avoid };
    look_again(&mut artefacts, &selected, coloured, setting);
    artefacts.odd_signals = shape_surprise;

    all.work.begins(work::WHAT_IS_LEFT);
    let left = adequacy::check(&selected, &artefacts, setting);

    // Measure what the causes are worth on signals that nothing was fitted to: detection and misfit for the
    // causes of the selection, the likelihood also for those of codes, noise and trigger.
    all.work.begins(work::GAIN);
    let applied: Vec<_> = selected.causes.iter().map(|c| c.candidate.form.clone()).collect();
    let (misfit, mut gain) = gain::measure(&baseline, &applied, setting);
    gain.log_likelihood_per_signal =
        worth::measure(&baseline, &applied, &artefacts, unwhitened.as_ref(), setting);
    let detection = gain.detection();
    let figures = figures::draw(&baseline, &selected.fitted.model, &data);

    let ln_samples = data.ln_samples();
    let mut causes = causes(&artefacts, &selected, detection == Detection::Better, ln_samples);
    let count = outlier.iter().filter(|o| **o).count();
    let outliers = OutlierCount { signals: count, all: all.len() };
    let verdict = Verdict::of(&mut causes, &left);
    let allowed = outcome::check(&applied, outliers, &gain, verdict);
    let mut remarks = left.remarks();
    remarks.extend(not_worth(&causes, &gain));
    remarks.extend(caveats(all, outliers, &allowed, causes.is_empty()));
    remarks.extend(ties(&causes));

    let critique = Critique {
        version: VERSION,
        verdict,
        sentence: verdict.sentence(&causes, &left, detection),
        equation: equation(&causes),
        // what is named all the same was tested: one of two converters may give what the other lacks
        not_testable: NotTestable::all(|e| {
            let is_named = causes.iter().any(|cause| cause.id == e.id);
            e.needs.lacking(&data).filter(|_| !is_named)
        }),
        causes,
        misfit,
        gain,
        extended_model: None,
        plant: None,
        remarks,
        signals: Signals {
            found: all.found,
            used: data.len(),
            outliers: outliers.signals,
            channels: data.units,
            rejected: 0,
        },
        evidence: all_evidence(&artefacts, &selected, ln_samples),
        figures,
    };

    // An extended design has to expect signals as they come. So where the noise was made white, the causes
    // are fitted once more to the original signals.
    let extended = allowed.and_then(|()| match unwhitened {
        None => Ok(Extended::new(selected.fitted.model, &applied, &data.beside)),
        Some(coloured) => {
            let setting = Setting { data: &coloured, avoid: &avoid };
            outcome::in_colour(applied, setting)
        }
    });
    Ok(Outcome { critique, outlier, extended })
}

fn check_enough(found: usize, rings: Rings) -> Result<(), CritiqueError> {
    let fewest = if rings == Rings::InkChannel { FEWEST_SIGNALS } else { 1 };
    (found >= fewest).then_some(()).ok_or(CritiqueError::TooFew { found })
}

/// What steps 2 and 3 give to the selection.
struct Prepared {
    /// The signals with white noise; one sample shorter than they came if they had to be whitened.
    data: Observations,
    /// The signals before correlated noise was made white; `None` if it was white.
    unwhitened: Option<Observations>,
    /// What that noise was taken for.
    coloured: Option<Autoregression>,
    baseline: Model,
    artefacts: Artefacts,
}

impl Prepared {
    fn of(data: Observations) -> Result<Prepared, CritiqueError> {
        let rings = |model: &Model| model.explained(&data) > LITTLE;
        let mut baseline = Model::fitted(&data, 2).filter(rings).ok_or(CritiqueError::NoRing)?;

        // codes first: what is accepted of them becomes part of the baseline (rails, lattice)
        data.work.begins(work::CODES);
        let codes = codes::test(&data, &mut baseline);
        baseline.fit(&data, 2);
        let noise = ensemble::test(&data, &baseline);
        let mut artefacts = Artefacts { codes, noise, odd_signals: 0.0 };

        leave_out(&mut artefacts, Vec::new());
        let (unwhitened, coloured) = (None, None);
        let prepared = Prepared { data, unwhitened, coloured, baseline, artefacts };
        match accepted(&prepared.artefacts.noise, CauseId::CorrelatedNoise) {
            Some(rho) => prepared.whitened(rho),
            None => Ok(prepared),
        }
    }

    /// Takes the correlation of the noise out of the signals, and tests the noise anew. `rho`: first estimate
    /// of the correlation at lag 1.
    ///
    /// The noise is taken for an AR(1) process, so the signals y_k - rho y_{k-1} have white noise. Each round
    /// whitens the original signals by the estimate so far, fits a baseline, and adds the correlation that is
    /// left to the estimate.
    fn whitened(self, rho: f64) -> Result<Prepared, CritiqueError> {
        let Prepared { data, artefacts, baseline, .. } = self;
        // Whitened samples are no codes of the converter any more, so samples that may be clipped are marked
        // as lost before.
        let unwhitened = codes::unclipped(data, &baseline);
        let Artefacts { codes, mut noise, .. } = artefacts;
        let mut total = rho;
        let mut round = 0;
        let (data, baseline, again) = loop {
            total = total.clamp(-0.97, 0.97);
            let data = unwhitened.whitened(total);
            let baseline = Model::fitted(&data, 2).ok_or(CritiqueError::NoRing)?;
            let again = ensemble::test(&data, &baseline);
            round += 1;
            let more = again.iter().find(|f| f.id == CauseId::CorrelatedNoise);
            let more = more.map_or(0.0, |f| f.value);
            if round >= MOST_WHITENINGS || more.is_nan() || more.abs() <= NEARLY_WHITE {
                break (data, baseline, again);
            }
            total += more;
        };

        // The finding of correlated noise stays that of the first test. Its value becomes the correlation
        // that the noise had before the converter's rounding, which adds white noise of variance step²/12.
        noise.retain(|f| f.id == CauseId::CorrelatedNoise);
        let step = accepted(&codes, CauseId::CoarseLsb).unwrap_or(1.0);
        let rounding = if unwhitened.integer { step * step / 12.0 } else { 0.0 };
        let rho = ensemble::beneath_rounding(total, baseline.noise_var, rounding);
        noise.iter_mut().for_each(|f| f.value = rho);
        let rounding = rounding / baseline.noise_var;
        let coloured = Some(Autoregression { rho, whitened_by: total, rounding });
        noise.extend(again.into_iter().filter(|f| f.id != CauseId::CorrelatedNoise));
        let artefacts = Artefacts { codes, noise, odd_signals: 0.0 };
        let unwhitened = Some(unwhitened);
        Ok(Prepared { data, unwhitened, coloured, baseline, artefacts })
    }

    /// Frequency of the random tone that is accepted so far, rad per signal length; empty if there is none.
    /// No line there is taken for a cause.
    fn random_tone(&self) -> Vec<f64> {
        let hz = accepted(&self.artefacts.noise, CauseId::RandomTone);
        hz.map(|hz| hz * self.data.length_s() * TAU).into_iter().collect()
    }

    fn select(&self) -> Selected {
        let setting = Setting { data: &self.data, avoid: &self.random_tone() };
        selection::select(self.baseline.clone(), setting, self.artefacts.findings())
    }
}

/// Step 5. Withdraws noise that is not what it is named, and noise or trigger that is no more than what a stronger
/// finding leaves. `coloured`: the signals were whitened, so they have no
/// codes to be tested.
fn look_again(
    artefacts: &mut Artefacts,
    selected: &Selected,
    coloured: Option<Autoregression>,
    setting: Setting,
) {
    let Setting { data, avoid } = setting;
    if coloured.is_none() && accepted(&artefacts.codes, CauseId::Clipping).is_none() {
        // Clipping shows where samples are missing that the model expects beyond the last code; without the
        // causes that follow a covariate it may expect none there.
        let again = codes::test(data, &mut selected.fitted.model.clone());
        let clipped = again.into_iter().filter(|f| f.id == CauseId::Clipping && f.accepted());
        artefacts.codes.extend(clipped);
    }
    artefacts.noise.push(jitter::jitter(&selected.fitted.model, data));
    leave_out(artefacts, selected.findings());
    let of_noise = |noise| ensemble::surprise_of(noise, data, &selected.fitted.model, avoid);
    if coloured.as_ref().map_or(0.0, of_noise) > without_a_name(1.0) {
        let correlated = artefacts.noise.iter_mut().find(|f| f.id == CauseId::CorrelatedNoise);
        let correlated = correlated.filter(|f| f.accepted());
        correlated.into_iter().for_each(|f| f.objection = Some(Objection::NoAutoregression));
    }
}

/// All causes that get a name, with their sentences: those in codes, noise and trigger first. `better`:
/// whether faults are detected better with the selected causes.
fn causes(artefacts: &Artefacts, selected: &Selected, better: bool, ln_samples: f64) -> Vec<Cause> {
    let of_artefacts = artefacts.accepted().map(|found| found.cause(found.delta_bic(ln_samples)));
    let with_sentence =
        |cause: Cause| Cause { sentence: cause_sentence(&cause, cause.id.row().words), ..cause };
    let of_selection = selected.causes.iter().map(|chosen| {
        let mut cause = with_sentence(Cause {
            // only a cause that follows a covariate moves signals by different amounts
            matters_for_detection: better && chosen.candidate.id.follows().is_some(),
            ..chosen.cause()
        });
        if matches!(cause.id.row().acts, Acts::Ring { .. }) {
            let behind = chosen.candidate.form.shape.rem_euclid(TAU).to_degrees();
            cause.sentence += &format!(", {behind:.0}° behind the own ring");
        }
        cause
    });
    of_artefacts.map(with_sentence).chain(of_selection).collect()
}

/// Remarks on signals that were left out or not drawn, and on why no extended design is written.
/// `nothing_found`: no cause was found, so that no such design is missed.
fn caveats(
    all: &Observations,
    left_out: OutlierCount,
    allowed: &Result<(), NotExtended>,
    nothing_found: bool,
) -> Vec<String> {
    let mut remarks = left_out.remarks();
    if let Err(why) = allowed
        && !nothing_found
    {
        remarks.push(format!("no extended design is written: {why}"));
    }
    if (all.len() as u64) < all.found {
        remarks.push(format!("{} signals were drawn from {}", all.len(), all.found));
    }
    remarks
}

/// Rows of evidence of all tests: codes, noise and trigger first, then the selection's.
fn all_evidence(artefacts: &Artefacts, selected: &Selected, ln_samples: f64) -> Vec<Evidence> {
    let row = |found: &Candidate| Evidence {
        why_not: (!found.accepted()).then(|| found.why_not()),
        ..found.evidence(0, ln_samples)
    };
    artefacts.all().map(row).chain(selected.evidence.iter().cloned()).collect()
}

#[cfg(test)]
#[path = "engine_tests.rs"]
mod tests;
