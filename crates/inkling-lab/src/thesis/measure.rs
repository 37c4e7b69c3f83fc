//! Chapter 4 on one part of one data set: every method is trained and tested, and its figures are
//! taken. thesis §4-2 and §4-3.
//!
//! In: a `Part`, signals to learn from and to test on. Out: `Figures`, numbers by name (`figure`),
//! and for each method that failed the reason. `figures` is the entry point.
//!
//! For each method `train` makes a `Design` of the product from the training signals; `test` judges
//! each test signal with that design and counts the verdicts in a `Score`. What is tried: detection
//! with each row of `tables.toml`; isolation by linear regression and by the nearest neighbour, on r
//! and on y, learned from all, half and a tenth of the faulty signals; model matching; the current
//! practice; the product's default.

use super::datasets::{Part, faulty, healthy, with_faulty};
use super::methods::{
    COMPARED, Compared, Detection, ROWS, Size, figure, isolation, own_isolation, thesis_detect,
};
use super::outcome::{Confusion, Figures, ThesisError};
use super::practice::{KeyNumbers, Thresholds, key_numbers};
use crate::score::{Prediction, Report, Score};
use inkling_core::design::{
    Design, DetectSettings, IsolateSettings, Judge, TrainingSet, Workspace,
};
use inkling_core::detect::DetectMethod;
use inkling_core::fault::HEALTHY;
use inkling_core::identify::GreyBoxSettings;
use inkling_core::isolate::{IsolateMethod, IsolateSignal};
use std::collections::BTreeSet;

/// Classes that the manufacturer's own method can name, thesis §4-3.
const KNOWN_TO_PRACTICE: [&str; 4] = ["EC", "AB3", "BN", "PBN"];

/// Trains a design on a set, with these settings.
pub fn train(
    set: &TrainingSet,
    detect: &DetectSettings,
    isolate: &IsolateSettings,
) -> Result<Design, ThesisError> {
    // The thesis identifies its model on the plain mean of healthy signals (Fig. 3-2); the product's own method
    // corrects it for what averaging does.
    let plain_mean = detect.method != DetectMethod::Sensitivity;
    let grey_box = GreyBoxSettings { plain_mean, ..GreyBoxSettings::default() };
    Ok(Design::train(set, &grey_box, detect, isolate)?.0)
}

/// One signal as the design's judge meets it.
struct TestSignal<'a> {
    judge: &'a Judge,
    /// The signal minus what the design expects of its printhead at its drive, N samples, counts.
    deviation: &'a [f64],
    /// Drive voltage over the reference voltage.
    drive: f64,
    /// The true state, `healthy` or a fault class.
    state: &'a str,
}

/// Calls `look` for every signal of a set, with a judge by the model of the signal's printhead.
fn each_signal(
    design: &Design,
    isolate: &IsolateSettings,
    set: &TrainingSet,
    mut look: impl FnMut(TestSignal, &mut Workspace),
) -> Result<(), ThesisError> {
    let printheads: BTreeSet<&str> = set.sets().map(|(_, printhead, _)| printhead).collect();
    let mut work = Workspace::default();
    for printhead in printheads {
        let model = design.reference_of(printhead).clone();
        let judge = Judge::new(0, model.into(), design.drive_voltage_v, Some(design), isolate)?;
        for (state, _, signals) in set.sets().filter(|of| of.1 == printhead) {
            judge.model.each_deviation(signals, |i, deviation, drive| {
                work.warmer = judge.model.warmer(signals.temperature_c[i]);
                look(TestSignal { judge: &judge, deviation, drive, state }, &mut work);
            });
        }
    }
    Ok(())
}

/// How a design performed on test signals. Faulty signals are isolated whether they were flagged or not, as in
/// thesis Table 4-3.
pub struct TestResult {
    all: Report,
    /// Isolation of only those that reached the certainty bound: thesis Table 4-4.
    certain: Report,
    /// Share of the faulty signals for which a class was named.
    named: f64,
}

impl TestResult {
    /// The share of all faulty signals whose class is right; a signal for which none was named is wrong.
    fn right_of_all(&self) -> f64 {
        self.all.isolation.accuracy * self.named
    }
}

/// Judges every test signal: detects all, and isolates all that are faulty in truth.
fn test(
    design: &Design,
    isolate: &IsolateSettings,
    set: &TrainingSet,
) -> Result<TestResult, ThesisError> {
    let names = design.class_names();
    let [mut all, mut certain] = [(); 2].map(|()| {
        let mut score = Score::default();
        score.add_classes(&names);
        score.bound = Some(isolate.certainty);
        score
    });
    let (mut named, mut weights) = (0, Vec::<f32>::new());

    // `certain` hides the name where the weight is below the bound
    each_signal(design, isolate, set, |met, work| {
        let TestSignal { judge, deviation, drive, state } = met;
        let flagged = judge.test(judge.detect(deviation, drive, work)).is_flagged();
        let class = match state {
            HEALTHY => None,
            _ => judge.isolate(deviation, drive, work).and_then(|decision| decision.candidate),
        };
        let class = class.map(usize::from);
        named += usize::from(class.is_some());
        // that of the class itself; the `certainty` of a decision may be that of its category
        let certainty = class.and_then(|class| work.weights.get(class).copied());
        weights.clear();
        weights.extend(class.iter().flat_map(|_| work.weights.iter().map(|&w| w as f32)));
        let candidate = class.map(|class| names[class].as_str());
        let weights = Some(&weights[..]).filter(|weights| !weights.is_empty());
        let of = |candidate| Prediction { flagged, candidate, certainty, weights };
        all.add(of(candidate), Some(state));
        let reached = certainty.is_some_and(|c| c >= isolate.certainty);
        certain.add(of(candidate.filter(|_| reached)), Some(state));
    })?;
    let named = named as f64 / faulty(set).max(1) as f64;
    Ok(TestResult { all: all.report(), certain: certain.report(), named })
}

/// All figures of one part. A method that cannot be tried on it leaves the reason instead, but for the thesis's
/// own.
pub fn figures(part: &Part) -> Result<Figures, ThesisError> {
    let mut out = Figures::default();
    let Part { learn, test, mu, .. } = part;
    out.put("mu", *mu);
    for (what, set) in [("learned", learn), ("tested", test)] {
        out.put(&format!("{what}/healthy"), healthy(set) as f64);
        out.put(&format!("{what}/faulty"), faulty(set) as f64);
    }
    // The thesis's own method, which also tells the class that methods II and III are made for.
    let isolate = own_isolation();
    let first = train(learn, &thesis_detect(*mu), &isolate)?;
    out.put("model/fit", first.pooled.identification.fit_percent);
    let fault = hardest(&first, &isolate, learn)?;

    detection(part, &fault, &mut out);

    // Isolation by every method, learned from fewer and fewer faulty signals.
    for size in Size::EACH {
        out.put(&format!("learned/{}", size.name), size.of(faulty(learn)) as f64);
        let few = with_faulty(learn, size.of(faulty(learn)));
        regression_and_neighbours(&few, part, size, &mut out)
            .unwrap_or_else(|e| out.cannot(&format!("LR and 1-NN, {}", size.name), &e));
        by_default(&few, part, size, &mut out)
            .unwrap_or_else(|e| out.cannot(&format!("default, {}", size.name), &e));
    }
    model_matching(part, &mut out).unwrap_or_else(|e| out.cannot("model matching", &e));
    practice(part, &mut out);
    Ok(out)
}

/// The class of which the thesis's detection misses the largest share of training signals, for which
/// methods II and III are made. Empty if there is no fault.
fn hardest(
    design: &Design,
    isolate: &IsolateSettings,
    learn: &TrainingSet,
) -> Result<String, ThesisError> {
    let by_state = test(design, isolate, learn)?.all.by_state;
    let missed = |(state, of): (&String, &crate::score::ByState)| {
        let share = (of.signals - of.flagged) as f64 / of.signals.max(1) as f64;
        (state != HEALTHY).then(|| (share, state.clone()))
    };
    let hardest = by_state.iter().filter_map(missed).max_by(|a, b| a.0.total_cmp(&b.0));
    Ok(hardest.map(|(_, state)| state).unwrap_or_default())
}

/// Detection by every row. `fault`: the class that methods II and III are made for.
fn detection(part: &Part, fault: &str, out: &mut Figures) {
    let isolate = own_isolation();
    for Detection { name, settings, .. } in &ROWS.detections {
        let detect = DetectSettings { mu: part.mu, fault: fault.into(), ..settings.clone() };
        let design = train(&part.learn, &detect, &isolate);
        let tested = design.and_then(|design| test(&design, &isolate, &part.test));
        match tested {
            Ok(tested) => out.detection(name, &tested.all),
            Err(e) => out.cannot(name, &e),
        }
    }
}

/// Isolation by linear regression and by the nearest neighbour, on r and on y, learned from `few`. One design
/// serves all four: the settings of the test choose the method.
fn regression_and_neighbours(
    few: &TrainingSet,
    part: &Part,
    size: Size,
    out: &mut Figures,
) -> Result<(), ThesisError> {
    let remember = isolation(IsolateMethod::Neighbours, IsolateSignal::Residual);
    let design = train(few, &thesis_detect(part.mu), &remember)?;
    for Compared { name, method, signal } in COMPARED {
        let tested = test(&design, &isolation(method, signal), &part.test)?;
        out.isolation(name, size, &tested);
    }
    Ok(())
}

/// Isolation by model matching, thesis §3-3-1, which may fit no class at all. `of all` is the share
/// of all faulty signals that is named rightly, where no name counts as wrong.
fn model_matching(part: &Part, out: &mut Figures) -> Result<(), ThesisError> {
    let matching = isolation(IsolateMethod::ModelMatching, IsolateSignal::Residual);
    let design = train(&part.learn, &thesis_detect(part.mu), &matching)?;
    let models = design.classes.iter().filter(|class| class.model.is_some()).count();
    out.put("model matching/models", models as f64);
    let tested = test(&design, &matching, &part.test)?;
    out.isolation("model matching", Size::ALL, &tested);
    out.put("model matching/of all", tested.right_of_all());
    out.put("model matching/rejected", 1.0 - tested.named);
    Ok(())
}

/// Isolation by the product's default settings, with calibration.
fn by_default(
    few: &TrainingSet,
    part: &Part,
    size: Size,
    out: &mut Figures,
) -> Result<(), ThesisError> {
    const NAME: &str = "default";
    let isolate = IsolateSettings { gate: false, ..IsolateSettings::default() };
    let design = train(few, &DetectSettings::default(), &isolate)?;
    let tested = test(&design, &isolate, &part.test)?;
    out.isolation(NAME, size, &tested);
    // here a signal for which nothing was named counts as wrong
    out.put(&figure(NAME, size, "accuracy"), tested.right_of_all());

    // Calibration errors, on the larger set where there is one.
    let calibration = match &part.calibration {
        Some(more) => test(&design, &isolate, more)?.all.calibration,
        None => tested.all.calibration,
    };
    out.put(&figure(NAME, size, "ECE"), calibration.ece);
    let classwise = calibration.classwise_ece.unwrap_or(f64::NAN);
    out.put(&figure(NAME, size, "class-wise ECE"), classwise);
    Ok(())
}

/// Detection and isolation by the current practice. Shares are of all faulty test signals, but for
/// `of the four`, which is of those in the classes that the manufacturer's method knows.
fn practice(part: &Part, out: &mut Figures) {
    let learned = key_numbers(&part.learn);
    let thresholds = Thresholds::learn(&learned);
    let is_known = |name: &str| KNOWN_TO_PRACTICE.contains(&name);
    let is_named = |state: &str, k: &KeyNumbers| thresholds.name(k, |_| true) == Some(state);
    let (healthy, faulty): (Vec<_>, Vec<_>) =
        key_numbers(&part.test).into_iter().partition(|(state, _)| *state == HEALTHY);
    let count = |is: &dyn Fn(&str, &KeyNumbers) -> bool| {
        faulty.iter().filter(|(state, k)| is(state, k)).count() as f64
    };
    let misses = count(&|_, k| !thresholds.is_faulty(k));
    let false_alarms = healthy.iter().filter(|(_, k)| thresholds.is_faulty(k)).count() as f64;
    let named = count(&|state, k| thresholds.name(k, is_known) == Some(state));
    // the practice detects and isolates in one step: what looks healthy to it gets no name
    let one_step = count(&|state, k| is_named(state, k) && thresholds.is_faulty(k));
    let (known, extended) = (count(&|state, _| is_known(state)), count(&is_named));
    let (faulty, signals) = (faulty.len() as f64, (healthy.len() + faulty.len()) as f64);
    out.put("practice/right", (signals - (misses + false_alarms)) / signals);
    out.put("practice/misses", misses);
    out.put("practice/detected", 1.0 - misses / faulty);
    out.put("practice/false alarms", false_alarms);
    out.put("practice/four classes", named / faulty);
    out.put("practice/of the four", named / known);
    out.put("practice/all classes", extended / faulty);
    out.put("practice/in one step", one_step / faulty);
}

impl Figures {
    /// Notes that a method could not be tried, and why.
    fn cannot(&mut self, name: &str, why: &ThesisError) {
        self.failed.insert(name.into(), why.to_string());
    }

    /// Puts the figures of a method of detection, and its confusion.
    fn detection(&mut self, name: &str, report: &Report) {
        let d = &report.detection;
        self.put(&format!("{name}/misses"), d.fn_ as f64);
        self.put(&format!("{name}/detected"), d.recall());
        self.put(&format!("{name}/false alarms"), d.fp as f64);
        self.put(&format!("{name}/right"), d.accuracy());
        let counts = [[d.tn, d.fp], [d.fn_, d.tp]];
        let counts = counts.map(|row| row.map(|n| n as f64).to_vec()).to_vec();
        let classes = vec![HEALTHY.into(), "faulty".into()];
        self.confusions.insert(name.into(), Confusion { classes, counts });
    }

    /// Puts the figures of a method of isolation; with all training signals also its confusions.
    fn isolation(&mut self, name: &str, size: Size, tested: &TestResult) {
        let report = &tested.all;
        let mut put = |what: &str, v| self.put(&figure(name, size, what), v);
        // where nothing was isolated, no share is right or wrong
        let isolated: u64 = report.isolation.confusion.iter().flatten().sum();
        let of_some = |v: f64, is_any: bool| if is_any { v } else { f64::NAN };
        put("accuracy", of_some(report.isolation.accuracy, isolated > 0));
        put("category", of_some(report.isolation.category_accuracy, isolated > 0));
        put("certain", of_some(report.certain.accuracy, report.certain.coverage > 0.0));
        put("coverage", report.certain.coverage);
        if size != Size::ALL {
            return;
        }
        for (mode, report) in [("", report), (" certain", &tested.certain)] {
            let classes = report.isolation.classes.clone();
            let counts = report.isolation.confusion.iter();
            let counts = counts.map(|row| row.iter().map(|&n| n as f64).collect()).collect();
            self.confusions.insert(format!("{name}{mode}"), Confusion { classes, counts });
        }
    }
}
