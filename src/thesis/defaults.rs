//! The project's default methods on the thesis-form data set, with the figures that the thesis has
//! no table for: calibration of the stated certainty, and what the most certain signals are worth.
//!
//! In: training and test signals of a seed, and a larger test set of faulty ones. Out: figures.

use super::data::Signals;
use super::{Figures, ThesisError};
use crate::design::{Design, DetectSettings, IsolateSettings, Judge, Workspace};
use crate::fault::HEALTHY;
use crate::identify::GreyBoxSettings;
use crate::labels::Labels;
use crate::score::{Said, Score};
use crate::simulate::Scenario;
use crate::simulate::scenario::{Classes, Kind};
use std::sync::Arc;

/// Faulty test signals for the calibration error: on 2025 even a perfect posterior averages .013.
const CALIBRATION_SIGNALS: usize = 20_000;
/// Its draws are none of the seed's own.
const CALIBRATION_SEEDS: u64 = 1_000_000;
/// The share that the thesis keeps in Table 4-4.
const SHARE_KEPT: f64 = 0.532;

pub fn figures(
    scenario: &Scenario,
    seed: u64,
    learn: &Signals,
    test: &Signals,
    out: &mut Figures,
) -> Result<(), ThesisError> {
    let calibration = calibration_signals(scenario, seed)?;
    let detect = DetectSettings::default();
    let isolate = IsolateSettings { gate: false, ..IsolateSettings::default() };
    let all = learn.faulty();
    for size in [all, all.div_ceil(2), all / 10 + 1] {
        let set = learn.training(size);
        let (design, _) = Design::train(&set, &GreyBoxSettings::default(), &detect, &isolate)?;
        if size == all {
            detection(&design, &isolate, test, out)?;
        }
        let mut put = |key: &str, v: f64| out.put(&format!("posterior, {size}/{key}"), v);
        let mut said = isolated(&design, &isolate, test)?;
        put("accuracy", share_right(&said));
        let bound = isolate.certainty;
        let certain: Vec<(f64, bool)> = said.iter().copied().filter(|s| s.0 >= bound).collect();
        put("certain", share_right(&certain));
        put("coverage", certain.len() as f64 / said.len().max(1) as f64);
        said.sort_by(|a, b| b.0.total_cmp(&a.0));
        said.truncate((SHARE_KEPT * said.len() as f64) as usize);
        put("best 53.2 %", share_right(&said));
        let (ece, classwise) = calibration_errors(&design, &isolate, &calibration)?;
        put("ECE", ece);
        put("class-wise ECE", classwise);
    }
    Ok(())
}

/// Faulty signals of the same classes, more of them.
fn calibration_signals(scenario: &Scenario, seed: u64) -> Result<Signals, ThesisError> {
    let needs = |what: &str| ThesisError::Scenario(what.into());
    let Kind::Classes(classes) = &scenario.kind else {
        return Err(needs("chapter 4 needs a classes scenario"));
    };
    let n_per_fault = CALIBRATION_SIGNALS.div_ceil(classes.fault_classes().len().max(1));
    let mut more = Classes::clone(classes);
    (more.n_healthy, more.n_per_fault) = (1, n_per_fault);
    let more = Scenario { kind: Kind::Classes(Arc::new(more)), ..scenario.clone() };
    let seed = seed.wrapping_add(CALIBRATION_SEEDS);
    let labels = Labels::new(more.labels(seed));
    let test = more.recordings(seed).into_iter().nth(1);
    Ok(Signals::of(test.ok_or_else(|| needs("a test set is needed"))?, &labels))
}

fn judge_of(design: &Design, isolate: &IsolateSettings) -> Result<Judge, ThesisError> {
    Ok(Judge::new(0, design.pooled.clone().into(), None, Some(design), isolate)?)
}

fn detection(
    design: &Design,
    isolate: &IsolateSettings,
    test: &Signals,
    out: &mut Figures,
) -> Result<(), ThesisError> {
    let judge = judge_of(design, isolate)?;
    let (mut score, mut work) = (Score::default(), Workspace::default());
    each_deviation(&judge, test, |deviation, state| {
        let flagged = judge.test(judge.detect(deviation, 1.0, &mut work)).is_flagged();
        score.add(Said { flagged, candidate: None, certainty: None, weights: None }, Some(state));
    });
    out.detection("default", &score.report());
    Ok(())
}

/// Of every faulty signal that a class was said of: its posterior, and whether it was right.
fn isolated(
    design: &Design,
    isolate: &IsolateSettings,
    test: &Signals,
) -> Result<Vec<(f64, bool)>, ThesisError> {
    let judge = judge_of(design, isolate)?;
    let names = design.class_names();
    let (mut said, mut work) = (Vec::new(), Workspace::default());
    each_deviation(&judge, test, |deviation, state| {
        if state == HEALTHY {
            return;
        }
        let decision = judge.isolate(deviation, 1.0, &mut work);
        // what nothing was said of is wrong, and certain of nothing
        said.push(match decision.and_then(|d| d.candidate).map(usize::from) {
            Some(class) => (work.weights[class], names[class] == state),
            None => (0.0, false),
        });
    });
    Ok(said)
}

/// Top-label and class-wise.
fn calibration_errors(
    design: &Design,
    isolate: &IsolateSettings,
    test: &Signals,
) -> Result<(f64, f64), ThesisError> {
    let judge = judge_of(design, isolate)?;
    let names = design.class_names();
    let (mut score, mut work) = (Score::default(), Workspace::default());
    score.add_classes(&names);
    let mut weights: Vec<f32> = Vec::new();
    each_deviation(&judge, test, |deviation, state| {
        let Some(class) = judge.isolate(deviation, 1.0, &mut work).and_then(|d| d.candidate) else {
            return;
        };
        weights.clear();
        weights.extend(work.weights.iter().map(|&w| w as f32));
        let said = Said {
            flagged: true,
            candidate: Some(&names[usize::from(class)]),
            certainty: Some(work.weights[usize::from(class)]),
            weights: Some(&weights),
        };
        score.add(said, Some(state));
    });
    let calibration = score.report().calibration;
    Ok((calibration.ece, calibration.classwise_ece.unwrap_or(f64::NAN)))
}

fn each_deviation(judge: &Judge, signals: &Signals, mut look: impl FnMut(&[f64], &str)) {
    let mut deviation = vec![0.0; signals.samples];
    for (y, state) in signals.each() {
        for ((d, y), e) in deviation.iter_mut().zip(y).zip(&judge.model.expected) {
            *d = y - e;
        }
        look(&deviation, state);
    }
}

fn share_right(said: &[(f64, bool)]) -> f64 {
    said.iter().filter(|(_, right)| *right).count() as f64 / said.len().max(1) as f64
}
