//! The critique of ink channels, from observations to findings, and the choice between it and the critique of
//! decays.
//!
//! The steps, in this order: outliers are left out; codes and noise are tested, and correlated noise is made
//! white; causes are selected; codes, noise and trigger are tested again beside the causes; the remaining
//! misfit is judged; the gain is measured; and all of it is put into words.

use super::adequacy::{self, Adequacy};
use super::candidate::Candidate;
use super::candidates::{Scored, Setting};
use super::catalogue::{CATALOGUE, CauseId, Needs};
use super::extended::{self, LeftOut};
pub use super::extended::{Extended, NotExtended};
use super::finding::{
    Cause, Critique, Detection, Evidence, NotTestable, Signals, VERSION, Verdict,
};
use super::found::{Aside, accepted};
use super::leftovers::{at_the_ring, at_the_ring_beside, leave_out, still_there, weighed};
use super::model::Model;
use super::observations::Observations;
pub use super::outcome::{CritiqueError, Outcome};
use super::outcome::{FEWEST_SAMPLES, FEWEST_SIGNALS};
use super::outliers::{Outliers, outliers};
use super::selection::{self, Selected};
use super::words::{cause_sentence, equation, not_worth, ties};
use super::{codes, decay, ensemble, evidence, figures, gain, jitter, worth};
use std::f64::consts::TAU;

/// Largest number of times that the correlation of the noise is estimated anew.
const MOST_WHITENINGS: usize = 10;
/// Correlation at lag 1 that may be left after whitening: a tenth of what can be told in 200 signals of 128
/// samples.
const NEARLY_WHITE: f64 = 0.003;
/// Largest number of samples of a signal; longer signals are cut to their first ones.
pub const MOST_SAMPLES: usize = 512;

/// The plant that the signals come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rings {
    /// Thesis (2-2): a damped pair and a real pole.
    InkChannel,
    /// A damped oscillator seen through its displacement: one damped pair; few, long decays.
    Oscillator,
}

/// Criticises the model of signals. `labelled`: labels said that all of them are healthy. `stages` is told
/// what is being done. An oscillator's recording goes to the critique of decays if that can use it.
pub fn critique(
    all: &Observations,
    rings: Rings,
    labelled: bool,
    stages: &mut dyn FnMut(&str),
) -> Result<Outcome, CritiqueError> {
    if rings == Rings::Oscillator && !all.is_empty() && all.samples >= FEWEST_SAMPLES {
        if decay::can(all) {
            return decay::critique(all, stages);
        }
        if all.samples > MOST_SAMPLES {
            return critique(&all.first(MOST_SAMPLES), rings, labelled, stages);
        }
    }
    of_signals(all, rings == Rings::InkChannel, labelled, stages)
}

/// Criticises many signals, each of which is one ring. `real`: the ring has a real pole (ink channel).
fn of_signals(
    all: &Observations,
    real: bool,
    labelled: bool,
    stages: &mut dyn FnMut(&str),
) -> Result<Outcome, CritiqueError> {
    check_enough(all.len(), real)?;
    if all.samples < FEWEST_SAMPLES {
        return Err(CritiqueError::TooShort { samples: all.samples });
    }
    stages("fitting the baseline");
    // outliers are looked for among an ink channel's signals alone; what labels call healthy stays in
    let Outliers { out: mut outlier, shaped } = match real {
        true => outliers(all, &Model::start(all, true).ok_or(CritiqueError::NoRing)?),
        false => Outliers { out: vec![false; all.len()], shaped: 0.0 },
    };
    if labelled {
        outlier.fill(false);
    }
    let data = all.select(|i| !outlier[i]).standardised();
    check_enough(data.len(), real)?;

    // test codes and noise, select causes, then test codes and noise again beside the causes
    let mut prepared = Prepared::of(data, real, stages)?;
    let Picked { selected, avoid } = prepared.pick(stages);
    let Prepared { data, as_it_came, baseline, mut aside, .. } = prepared;
    let setting = Setting { data: &data, avoid: &avoid };
    look_again(&mut aside, &selected, setting);
    aside.odd_signals = shaped;

    // judge what is left, and measure what the causes are worth on signals that nothing was fitted to
    stages("checking what is left");
    let left = adequacy::check(&selected, &aside, setting);
    stages("measuring the gain");
    let applied: Vec<_> = selected.causes.iter().map(|c| c.candidate.form.clone()).collect();
    let mut measured = gain::measure(&baseline, &applied, setting);
    let (before, as_it_was) = (&baseline, as_it_came.as_ref());
    let extension =
        worth::Extension { before, causes: &applied, aside: &aside, as_it_came: as_it_was };
    measured.gain.log_likelihood_per_signal = worth::measure(extension, setting);
    let detection = measured.gain.detection();
    let figures = figures::draw(&baseline, &selected.fitted.model, &data, &measured.energies);

    // decide the verdict, and whether a design may be extended
    let ln_samples = data.ln_samples();
    let mut causes = causes(&aside, &selected, detection == Detection::Better, ln_samples);
    let of_outliers = LeftOut { signals: outlier.iter().filter(|o| **o).count(), all: all.len() };
    let allowed = match real {
        true => extended::check(&applied, of_outliers, &measured.gain),
        false => Err(NotExtended::NoInkChannel),
    };
    let verdict = Verdict::of(&mut causes, &left.unexplained);
    let mut remarks = unexplained(&selected.unnamed, &left);
    let has_no_name = verdict == Verdict::Unknown && allowed.is_ok();
    let allowed = if has_no_name { Err(NotExtended::NoName) } else { allowed };
    remarks.extend(not_worth(&causes, &measured.gain));
    remarks.extend(caveats(all, of_outliers, &allowed, causes.is_empty()));
    remarks.extend(ties(&causes));

    let critique = Critique {
        version: VERSION,
        verdict,
        sentence: verdict.sentence(&causes, &left.unexplained, detection),
        equation: equation(&causes),
        causes,
        not_testable: not_testable(&data, real),
        misfit: measured.misfit,
        gain: measured.gain,
        extended_model: None,
        remarks,
        signals: Signals {
            found: all.found,
            used: data.len(),
            outliers: of_outliers.signals,
            channels: data.units,
            rejected: 0,
        },
        evidence: all_evidence(&aside, &selected, ln_samples),
        figures,
    };
    // An extended design has to expect signals as they come. So where the noise was made white for the
    // critique, the causes are fitted once more to the original signals.
    let extended = allowed.and_then(|()| match as_it_came {
        None => Ok(Extended::new(selected.fitted.model, &applied, &data.beside)),
        Some(coloured) => {
            let setting = Setting { data: &coloured, avoid: &avoid };
            extended::in_colour(applied, setting)
        }
    });
    Ok(Outcome { critique, outlier, extended })
}

/// An error if there are too few signals.
fn check_enough(found: usize, real: bool) -> Result<(), CritiqueError> {
    match found < if real { FEWEST_SIGNALS } else { 1 } {
        true => Err(CritiqueError::TooFew { found }),
        false => Ok(()),
    }
}

/// Signals with white noise, the baseline fitted to them, and what was found in codes and noise.
struct Prepared {
    data: Observations,
    /// The signals before correlated noise was made white; `None` if it was white.
    as_it_came: Option<Observations>,
    baseline: Model,
    aside: Aside,
    /// Whether a random tone at the ring's frequency was found and is to be tested again beside the causes.
    deferred: bool,
}

/// The causes that were selected, and the frequencies that random tones have taken.
struct Picked {
    selected: Selected,
    avoid: Vec<f64>,
}

impl Prepared {
    /// Fits the baseline, tests codes and noise, and whitens the signals if their noise is correlated.
    fn of(
        data: Observations,
        real: bool,
        stages: &mut dyn FnMut(&str),
    ) -> Result<Prepared, CritiqueError> {
        let mut baseline = Model::start(&data, real).ok_or(CritiqueError::NoRing)?;
        baseline.fit(&data, 2);
        stages("looking at codes and noise");
        let codes = codes::test(&data, &mut baseline);
        if !codes.is_empty() {
            baseline.fit(&data, 2);
        }
        // the codes that were found are in the baseline now, and change what is left for the noise
        let noise = ensemble::test(&data, &baseline);
        let mut aside = Aside { codes, noise, odd_signals: 0.0 };
        leave_out(&mut aside, Vec::new());
        let deferred = at_the_ring(&mut aside.noise, &baseline, data.length_s());
        let rho = accepted(&aside.noise, CauseId::CorrelatedNoise);
        let prepared = Prepared { data, as_it_came: None, baseline, aside, deferred };
        match rho {
            Some(rho) => prepared.whitened(rho),
            None => Ok(prepared),
        }
    }

    /// Takes the correlation of the noise out of the signals, and tests the noise anew.
    fn whitened(self, rho: f64) -> Result<Prepared, CritiqueError> {
        let Prepared { data: as_it_came, aside: Aside { codes, mut noise, .. }, deferred, .. } =
            self;
        let mut total = rho;
        let mut round = 0;
        let mut last = f64::INFINITY;
        // Whitened signals can be judged by the same tests; the correlation that these still find tells how
        // far off rho was.
        let (data, baseline, again) = loop {
            total = total.clamp(-0.97, 0.97);
            let data = as_it_came.whitened(total);
            let mut baseline =
                Model::start(&data, self.baseline.real).ok_or(CritiqueError::NoRing)?;
            baseline.fit(&data, 2);
            let again = ensemble::test(&data, &baseline);
            round += 1;
            let more = again.iter().find(|f| f.id == CauseId::CorrelatedNoise);
            let more = more.map_or(0.0, |f| f.value);
            if round >= MOST_WHITENINGS || more.is_nan() || more.abs() <= NEARLY_WHITE {
                break (data, baseline, again);
            }
            // A fit to a signal swallows slow noise, so each estimate falls short by about the same share:
            // extrapolate the geometric series of the steps to its limit.
            let share = (more / last).clamp(0.0, 0.8);
            total += more / (1.0 - share);
            last = more;
        };
        // keep the row of the correlation from the first test, with the total as its value; take all other
        // rows from the last
        noise.retain(|f| f.id == CauseId::CorrelatedNoise);
        let step = accepted(&codes, CauseId::CoarseLsb).unwrap_or(1.0);
        let rounding = if as_it_came.integer { step * step / 12.0 } else { 0.0 };
        for f in &mut noise {
            f.value = ensemble::beneath_rounding(total, baseline.noise_var, rounding);
        }
        noise.extend(again.into_iter().filter(|f| f.id != CauseId::CorrelatedNoise));
        let aside = Aside { codes, noise, odd_signals: 0.0 };
        Ok(Prepared { data, as_it_came: Some(as_it_came), baseline, aside, deferred })
    }

    /// Frequency of the random tone that was found, rad per signal length; empty if there is none.
    fn random_tone(&self) -> Vec<f64> {
        let hz = accepted(&self.aside.noise, CauseId::RandomTone);
        hz.map(|hz| hz * self.data.length_s() * TAU).into_iter().collect()
    }

    /// Selects causes. A random tone at the ring's frequency is tested beside them; if it stands, causes are
    /// selected again beside it.
    fn pick(&mut self, stages: &mut dyn FnMut(&str)) -> Picked {
        let picked = self.select(stages);
        if !self.deferred {
            return picked;
        }
        let again = ensemble::test(&self.data, &picked.selected.fitted.model);
        let noise = &mut self.aside.noise;
        noise.retain(|f| f.id != CauseId::RandomTone);
        noise.extend(again.into_iter().filter(|f| f.id == CauseId::RandomTone));
        at_the_ring_beside(noise, &picked.selected.weighed());
        match accepted(noise, CauseId::RandomTone) {
            Some(_) => self.select(stages),
            None => picked,
        }
    }

    /// Selects causes beside the random tone that is known so far.
    fn select(&self, stages: &mut dyn FnMut(&str)) -> Picked {
        let avoid = self.random_tone();
        let setting = Setting { data: &self.data, avoid: &avoid };
        let selected =
            selection::select(self.baseline.clone(), setting, weighed(&self.aside), stages);
        Picked { selected, avoid }
    }
}

/// Tests codes, trigger and noise again, now that the causes are in the model.
fn look_again(aside: &mut Aside, selected: &Selected, setting: Setting) {
    let Setting { data, .. } = setting;
    if accepted(&aside.codes, CauseId::Clipping).is_none() {
        // what follows a covariate may have hidden the clipping
        let again = codes::test(data, &mut selected.fitted.model.clone());
        let clipped = again.into_iter().filter(|f| f.id == CauseId::Clipping && f.accepted());
        aside.codes.extend(clipped);
    }
    // a shift in time can be told from drifts only once these are in the model
    aside.noise.push(jitter::jitter(&selected.fitted.model, data));
    let noisy = aside.noise.iter().any(|f| f.accepted());
    if noisy && !selected.causes.is_empty() {
        still_there(&mut aside.noise, &ensemble::test(data, &selected.fitted.model));
    }
    leave_out(aside, selected.weighed());
}

/// All causes that get a name, with their sentences: those of codes and noise first. `better`: whether faults
/// are detected better with the selected causes.
fn causes(aside: &Aside, selected: &Selected, better: bool, ln_samples: f64) -> Vec<Cause> {
    let by_chance = aside.accepted().map(|found| found.cause(found.delta_bic(ln_samples)));
    let of_signals = selected.causes.iter().map(|chosen| Cause {
        // true of what moves signals differently, rather than all of them alike
        matters_for_detection: better && chosen.candidate.id.follows().is_some(),
        ..chosen.cause()
    });
    let told =
        |cause: Cause| Cause { sentence: cause_sentence(&cause, cause.id.row().words), ..cause };
    by_chance.chain(of_signals).map(told).collect()
}

/// Remarks that a reader must know about the signals and about the design.
fn caveats(
    all: &Observations,
    left_out: LeftOut,
    allowed: &Result<(), NotExtended>,
    nothing_found: bool,
) -> Vec<String> {
    let mut remarks = left_out.remarks();
    match allowed {
        Ok(()) | Err(NotExtended::NoInkChannel) => {}
        Err(_) if nothing_found => {}
        Err(why) => remarks.push(format!("no extended design is written: {why}")),
    }
    if (all.len() as u64) < all.found {
        remarks.push(format!("{} signals were drawn from {}", all.len(), all.found));
    }
    remarks
}

/// Rows of evidence of all tests: codes, noise and trigger first, then the selection's.
fn all_evidence(aside: &Aside, selected: &Selected, ln_samples: f64) -> Vec<Evidence> {
    let row = |found: &Candidate| {
        let row = found.evidence(0, ln_samples);
        match found.accepted() {
            true => Evidence { accepted: true, why_not: String::new(), ..row },
            false => row,
        }
    };
    let mut evidence: Vec<Evidence> = aside.all().map(row).collect();
    let by_chance = evidence.len();
    evidence.extend(selected.evidence.iter().cloned());
    evidence::tidy(&mut evidence, by_chance);
    evidence
}

/// Causes of the catalogue that these data cannot test, with what they need.
fn not_testable(data: &Observations, real: bool) -> Vec<NotTestable> {
    // a long decay goes through all amplitudes by itself
    let asked = CATALOGUE.iter().filter(|e| real || e.needs != Needs::DriveScan);
    asked
        .filter_map(|e| {
            let needs = e.needs.lacking(data)?;
            Some(NotTestable { id: e.id, needs: needs.into() })
        })
        .collect()
}

/// Remarks on the misfit that is left, and on a candidate that fits best but cannot be named.
fn unexplained(unnamed: &[Scored], left: &Adequacy) -> Vec<String> {
    let mut remarks = left.unexplained.remarks();
    if let Some(s) = unnamed.first().filter(|s| !left.told.contains(&s.id)) {
        remarks.push(format!("{} fits best but {}: it is not named", s.id, s.why_not()));
    }
    remarks
}
