//! The critique itself, from observations to findings.

use super::adequacy;
use super::candidates::{Kind, Scored};
use super::catalogue::{CATALOGUE, Needs, entry_of, experiment, lacking};
use super::codes;
use super::covariates::Covariates;
use super::decay;
use super::ensemble;
use super::evidence;
use super::extended::{self, LeftOut};
pub use super::extended::{Extended, NotExtended};
use super::figures;
use super::finding::{
    Cause, Critique, Detection, Evidence, Misfit, NotTestable, Signals, VERSION, Verdict,
};
use super::gain;
use super::jitter;
use super::leftovers::{
    LEFT_OF_NOISE, RANDOM_TONE, accepted, at_the_ring, at_the_ring_beside, beside_codes_and_noise,
    beyond_growing_noise, beyond_others, largest, leave_out, still_there,
};
use super::model::{Model, Unfit};
use super::observations::Observations;
use super::outliers::outliers;
use super::refit::Setting;
use super::selection::{self, Chosen, DETECTION_LIMIT};
use super::words::{cause_sentence, equation, sentence};
use thiserror::Error;

/// Signals that a critique needs at least, and samples of each.
const FEWEST_SIGNALS: usize = 8;
const FEWEST_SAMPLES: usize = 16;
/// Times that the correlation of the noise is estimated anew.
const MOST_WHITENINGS: usize = 10;
/// Correlation that may be left.
const NEARLY_WHITE: f64 = 0.003;
/// Longer signals are judged by their first samples.
pub const MOST_SAMPLES: usize = 512;

#[derive(Debug, Error)]
pub enum CritiqueError {
    #[error(
        "{found} usable signals of an ink channel: a critique needs {FEWEST_SIGNALS} at least (few, long decays \
         of something else: --plant oscillator)"
    )]
    TooFew { found: usize },
    #[error("signals of {samples} samples: a critique needs {FEWEST_SAMPLES} at least")]
    TooShort { samples: usize },
    #[error("nothing rings in these signals: one damped oscillation explains less than a tenth")]
    NoRing,
}

/// A critique, and the model that it ended with.
pub struct Outcome {
    pub critique: Critique,
    /// Rows that were left out as unlike the others.
    pub outlier: Vec<bool>,
    /// Of an ink channel: the causes' part of it makes a design's extension.
    pub extended: Result<Extended, NotExtended>,
}

/// What rings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rings {
    /// Thesis (2-2): a damped pair and a real pole.
    InkChannel,
    /// A damped oscillator seen through its displacement: one damped pair; few, long decays.
    Oscillator,
}

/// `labelled`: labels said that all are healthy. `stages`: told what is being done.
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
    let real = rings == Rings::InkChannel;
    let fewest = if real { FEWEST_SIGNALS } else { 1 };
    if all.len() < fewest {
        return Err(CritiqueError::TooFew { found: all.len() });
    }
    if all.samples < FEWEST_SAMPLES {
        return Err(CritiqueError::TooShort { samples: all.samples });
    }
    stages("fitting the baseline");
    let beside = Covariates::of(all);
    let start = Model::start(all, &beside, real).map_err(|Unfit::NoRing| CritiqueError::NoRing)?;
    let outlier = match labelled || !real {
        true => vec![false; all.len()],
        false => outliers(all, &beside, &start),
    };
    let data = all.select(|i| !outlier[i]);
    if data.len() < fewest {
        return Err(CritiqueError::TooFew { found: data.len() });
    }
    let beside = Covariates::of(&data);
    let mut baseline =
        Model::start(&data, &beside, real).map_err(|Unfit::NoRing| CritiqueError::NoRing)?;
    baseline.fit(&data, &beside, 2);

    stages("looking at codes and noise");
    let mut of_codes = codes::test(&data, &beside, &mut baseline);
    if !of_codes.is_empty() {
        baseline.fit(&data, &beside, 2);
    }
    let mut of_noise = ensemble::test(&data, &beside, &baseline);
    beyond_growing_noise(&mut of_noise);
    let deferred = at_the_ring(&mut of_noise, &baseline, data.dt_s * data.samples as f64);
    let (mut data, mut coloured) = (data, None);
    if let Some(rho) = accepted(&of_noise, "correlated_noise") {
        let as_it_came = data;
        let mut total = rho;
        let mut round = 0;
        let mut last = f64::INFINITY;
        // what is white again can be judged by the same tests; what is left of rho tells how far off it was
        let again = loop {
            total = total.clamp(-0.97, 0.97);
            data = as_it_came.whitened(total);
            baseline = Model::start(&data, &beside, real)
                .map_err(|Unfit::NoRing| CritiqueError::NoRing)?;
            baseline.fit(&data, &beside, 2);
            let again = ensemble::test(&data, &beside, &baseline);
            round += 1;
            let more = again.iter().find(|f| f.evidence.id == "correlated_noise");
            let more = more.map_or(0.0, |f| f.evidence.value);
            if round >= MOST_WHITENINGS || more.is_nan() || more.abs() <= NEARLY_WHITE {
                break again;
            }
            // fits swallow slow noise, so each step falls short by the same share: to where they lead
            let share = (more / last).clamp(0.0, 0.8);
            total += more / (1.0 - share);
            last = more;
        };
        of_noise.retain(|f| f.evidence.id == "correlated_noise");
        let step = accepted(&of_codes, "coarse_lsb").unwrap_or(1.0);
        let rounding = if as_it_came.integer { step * step / 12.0 } else { 0.0 };
        for f in &mut of_noise {
            f.evidence.value = ensemble::beneath_rounding(total, baseline.noise_var, rounding);
        }
        // strongly correlated noise is never made quite white: what is found in the rest must be large
        let least = if total.abs() > 0.5 {
            LEFT_OF_NOISE * of_noise.iter().fold(0.0, |m: f64, f| m.max(f.evidence.statistic))
        } else {
            0.0
        };
        let others = again.into_iter().filter(|f| f.evidence.id != "correlated_noise");
        of_noise.extend(others.map(|mut f| {
            if f.evidence.accepted && f.evidence.statistic < least {
                leave_out(&mut f, "what correlated noise leaves");
            }
            f
        }));
        coloured = Some(as_it_came);
    }
    let length_s = data.dt_s * data.samples as f64;
    let taken = |of_noise: &[Found]| -> Vec<f64> {
        let hz = accepted(of_noise, RANDOM_TONE);
        hz.map(|hz| hz * length_s * std::f64::consts::TAU).into_iter().collect()
    };
    let mut avoid = taken(&of_noise);

    let before = baseline.clone();
    let setting = Setting { data: &data, beside: &beside, avoid: &avoid };
    let least = beside_codes_and_noise(&of_codes, &of_noise);
    let mut selected = selection::select(baseline, setting, least, stages);
    if deferred {
        let again = ensemble::test(&data, &beside, &selected.model);
        of_noise.retain(|f| f.evidence.id != RANDOM_TONE);
        of_noise.extend(again.into_iter().filter(|f| f.evidence.id == RANDOM_TONE));
        at_the_ring_beside(&mut of_noise, largest(&selected));
        if accepted(&of_noise, RANDOM_TONE).is_some() {
            avoid = taken(&of_noise);
            let least = beside_codes_and_noise(&of_codes, &of_noise);
            let setting = Setting { data: &data, beside: &beside, avoid: &avoid };
            selected = selection::select(before.clone(), setting, least, stages);
        }
    }
    let setting = Setting { data: &data, beside: &beside, avoid: &avoid };

    if accepted(&of_codes, "clipping").is_none() {
        // what follows a covariate may have hidden it
        let mut last = selected.model.clone();
        let again = codes::test(&data, &beside, &mut last);
        of_codes.extend(
            again.into_iter().filter(|f| f.evidence.id == "clipping" && f.evidence.accepted),
        );
    }
    // a shift in time is told from drifts once these are in the model
    of_noise.push(jitter::jitter(&selected.model, &data, &beside));
    beyond_growing_noise(&mut of_noise);
    let noisy = of_noise.iter().any(|f| f.evidence.accepted);
    if noisy && !selected.causes.is_empty() {
        still_there(&mut of_noise, &ensemble::test(&data, &beside, &selected.model));
    }
    beyond_others(&mut of_noise, &of_codes, largest(&selected));

    stages("checking what is left");
    let left = adequacy::check(&selected, &data, &beside, (&of_codes, &of_noise), &avoid);
    stages("measuring the gain");
    let applied: Vec<_> = selected.causes.iter().map(|c| c.scored.applied.clone()).collect();
    let gain = gain::measure(&before, &applied, setting);
    let figures = figures::draw(&before, &selected.model, &data, &beside, &gain.energies);
    let detection = gain.gain.detection();
    let matters = detection == Detection::Better;

    let mut causes = Vec::new();
    let mut evidence: Vec<Evidence> = Vec::new();
    let by_chance = of_codes.len() + of_noise.len();
    for found in of_codes.iter().chain(&of_noise) {
        evidence.push(found.evidence.clone());
        if found.evidence.accepted {
            causes.push(found.cause(false));
        }
    }
    evidence.extend(selected.evidence.iter().cloned());
    evidence::tidy(&mut evidence, by_chance);
    causes.extend(selected.causes.iter().map(|c| cause_of(c, matters && is_covariate(c))));
    let (verdict, mut remarks) = verdict(&mut causes, &selected.unnamed, &left);
    let left_out = outlier.iter().filter(|o| **o).count();
    let of_outliers = LeftOut { signals: left_out, all: all.len() };
    if left_out > 0 {
        remarks.push(format!(
            "{left_out} of {} signals ring unlike the others, or are of channels that at times do, and were left \
             out: faulty channels, it seems",
            all.len()
        ));
    }
    if of_outliers.is_mixture() {
        remarks.push(
            "so many are a mixture of healthy and faulty channels, and what is said of the rest may be said of faults: \
             tell which are healthy (--labels)"
                .into(),
        );
    }
    let allowed = if real {
        extended::check(of_outliers, &gain.gain)
    } else {
        Err(NotExtended::NoInkChannel)
    };
    if let (Err(why), false, true) = (&allowed, causes.is_empty(), real) {
        remarks.push(format!("no extended design is written: {why}"));
    }
    if (all.len() as u64) < all.found {
        remarks.push(format!("{} signals were drawn from {}", all.len(), all.found));
    }
    for cause in &causes {
        for tied in &cause.tied_with {
            remarks.push(format!(
                "{} and {tied} cannot be told apart here: {}",
                cause.id,
                experiment(&cause.id, tied)
            ));
        }
    }
    let not_testable = CATALOGUE
        .iter()
        .filter_map(|e| {
            if !real && e.needs == Needs::DriveScan {
                return None; // a long decay goes through all amplitudes by itself
            }
            let needs = lacking(e.needs, &beside, data.integer, data.units)?;
            Some(NotTestable { id: e.id.into(), needs: needs.into() })
        })
        .collect();

    let critique = Critique {
        version: VERSION,
        verdict,
        sentence: sentence(verdict, &causes, &left, detection),
        equation: equation(&causes),
        causes,
        not_testable,
        misfit: Misfit { ..gain.misfit },
        gain: gain.gain,
        extended_model: None,
        remarks,
        signals: Signals {
            found: all.found,
            used: data.len(),
            outliers: left_out,
            channels: data.units,
            rejected: 0,
        },
        evidence,
        figures,
    };
    let extended = allowed.and_then(|()| match coloured {
        None => Ok((selected.model, applied)),
        Some(coloured) => {
            let setting = Setting { data: &coloured, beside: &beside, avoid: &avoid };
            extended::in_colour(applied, setting)
        }
    });
    let extended = extended.map(|(model, causes)| {
        let causes = causes.iter().map(|cause| cause.id).collect();
        Extended { causes, model, beside }
    });
    Ok(Outcome { critique, outlier, extended })
}

/// Whether a cause moves single signals, rather than all of them alike.
fn is_covariate(chosen: &Chosen) -> bool {
    !matches!(chosen.scored.applied.kind, Kind::Shapes)
}

fn cause_of(chosen: &Chosen, matters: bool) -> Cause {
    let s = &chosen.scored;
    let entry = entry_of(s.applied.id);
    let half = 1.96 * s.sd;
    let mut cause = Cause {
        id: entry.id.into(),
        parameter: entry.parameter.into(),
        unit: entry.unit.into(),
        value: s.value,
        ci95: [s.value - half, s.value + half],
        strength_dl: (chosen.statistic / DETECTION_LIMIT).sqrt(),
        delta_bic: chosen.delta_bic,
        tied_with: chosen.tied_with.clone(),
        matters_for_detection: matters,
        explains: None,
        sentence: String::new(),
    };
    cause.sentence = cause_sentence(&cause);
    cause
}

fn verdict(
    causes: &mut Vec<Cause>,
    unnamed: &[Scored],
    left: &adequacy::Left,
) -> (Verdict, Vec<String>) {
    let mut remarks = Vec::new();
    for what in &left.significant {
        remarks.push(format!("still unexplained: {what}"));
    }
    if let Some(s) = unnamed.first().filter(|s| !left.told.contains(&s.applied.id)) {
        remarks.push(format!("{} fits best but {}: it is not named", s.applied.id, s.disqualified));
    }
    let unexplained = !left.significant.is_empty();
    if causes.is_empty() {
        if unexplained {
            causes.extend(left.nearest.clone());
            return (Verdict::Unknown, remarks);
        }
        return (Verdict::None, remarks);
    }
    if unexplained && left.share > left.share_allowed {
        for cause in causes.iter_mut() {
            cause.explains = Some(1.0 - left.share);
        }
        return (Verdict::Unknown, remarks);
    }
    match &causes[..] {
        [one] if !one.tied_with.is_empty() => (Verdict::Tie, remarks),
        _ => (Verdict::Named, remarks),
    }
}

/// Rows of the catalogue that are tested on codes or on the ensemble.
pub fn found(
    id: &str,
    surprise: f64,
    statistic: f64,
    value: f64,
    sd: f64,
    lack: Option<&str>,
) -> Found {
    let accepted = surprise > selection::THRESHOLD && lack.is_none();
    Found {
        evidence: Evidence {
            step: 0,
            id: id.into(),
            statistic,
            threshold: DETECTION_LIMIT,
            p: (-surprise).exp(),
            delta_bic: statistic - (statistic.max(3.0)).ln(),
            strength_dl: (statistic.max(0.0) / DETECTION_LIMIT).sqrt(),
            value,
            sd,
            tested: lack.is_none(),
            accepted,
            why_not: match (accepted, lack) {
                (true, _) => String::new(),
                (false, Some(lack)) => lack.into(),
                (false, None) => "not significant".into(),
            },
        },
        unlike: None,
    }
}

#[derive(Clone, Debug)]
pub struct Found {
    pub evidence: Evidence,
    /// What is there for sure and is none of the catalogue, in words.
    pub unlike: Option<&'static str>,
}

impl Found {
    fn cause(&self, matters: bool) -> Cause {
        let e = &self.evidence;
        let entry = entry_of(&e.id);
        let mut cause = Cause {
            id: entry.id.into(),
            parameter: entry.parameter.into(),
            unit: entry.unit.into(),
            value: e.value,
            ci95: [e.value - 1.96 * e.sd, e.value + 1.96 * e.sd],
            strength_dl: e.strength_dl,
            delta_bic: e.delta_bic,
            tied_with: Vec::new(),
            matters_for_detection: matters,
            explains: None,
            sentence: String::new(),
        };
        cause.sentence = cause_sentence(&cause);
        cause
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cause(id: &str, tied_with: &[&str]) -> Cause {
        let mut f = found(id, 50.0, 100.0, 1.0, 0.1, None).cause(false);
        f.tied_with = tied_with.iter().map(|t| (*t).to_owned()).collect();
        f
    }

    fn judged(mut causes: Vec<Cause>, left: &adequacy::Left) -> (Verdict, Vec<Cause>) {
        let verdict = verdict(&mut causes, &[], left).0;
        (verdict, causes)
    }

    #[test]
    fn a_verdict_is_named_only_where_little_is_left() {
        let nothing = adequacy::Left { share_allowed: 0.05, ..Default::default() };
        let much = adequacy::Left { significant: vec!["x".into()], share: 0.3, ..nothing.clone() };
        let little = adequacy::Left { share: 0.01, ..much.clone() };
        let one = || vec![cause("tone", &[])];
        assert_eq!(judged(vec![], &nothing).0, Verdict::None);
        assert_eq!(judged(vec![], &much).0, Verdict::Unknown);
        assert_eq!(judged(one(), &little).0, Verdict::Named);
        let (verdict, causes) = judged(one(), &much);
        assert_eq!((verdict, causes[0].explains), (Verdict::Unknown, Some(0.7)));
        let tied = || cause("offset", &["droop"]);
        assert_eq!(judged(vec![tied()], &nothing).0, Verdict::Tie);
        assert_eq!(judged(vec![tied(), cause("ageing", &[])], &nothing).0, Verdict::Named);
    }
}
