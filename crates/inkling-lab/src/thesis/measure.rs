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
use super::key_numbers::KeyNumbers;
use super::methods::{
    COMPARED, Compared, Detection, ROWS, Size, figure, isolation, own_isolation, thesis_detect,
};
use super::outcome::{Confusion, Figures, ThesisError};
use super::practice::{Thresholds, key_numbers};
use crate::score::{Prediction, Report, Score};
use inkling_core::design::{
    Design, DetectSettings, IsolateSettings, Judge, TrainingSet, Workspace,
};
use inkling_core::detect::DetectMethod;
use inkling_core::fault::HEALTHY;
use inkling_core::identify::GreyBoxSettings;
use inkling_core::isolate::{IsolateMethod, IsolateSignal};
use std::collections::BTreeSet;

/// Share of the faulty signals whose phi reaches .8 in thesis Table 4-4.
const SHARE_KEPT: f64 = 0.532;
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
pub struct TestSignal<'a> {
    pub judge: &'a Judge,
    /// The signal minus what the design expects of its printhead at its drive, N samples, counts.
    pub deviation: &'a [f64],
    /// Drive voltage over the reference voltage.
    pub drive: f64,
    /// The true state, `healthy` or a fault class.
    pub state: &'a str,
}

/// Calls `look` for every signal of a set, with a judge by the model of the signal's printhead.
pub fn each_signal(
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

/// How a design performed on test signals.
pub struct TestResult {
    /// Isolation of all faulty signals, whether flagged or not: thesis Table 4-3, which is ungated.
    pub ungated: Report,
    /// Isolation of only those faulty signals that were flagged, as in the product.
    gated: Report,
    /// Isolation, ungated, of only those that reached the certainty bound: thesis Table 4-4.
    certain: Report,
    /// The weight of the named class of every faulty signal (0: none), and whether that class is right.
    named: Vec<(f64, bool)>,
    /// Number of faulty signals for which no class was named.
    unnamed: usize,
}

/// Judges every test signal: detects all, and isolates all that are faulty in truth.
pub fn test(
    design: &Design,
    isolate: &IsolateSettings,
    set: &TrainingSet,
) -> Result<TestResult, ThesisError> {
    let names = design.class_names();
    let [mut ungated, mut gated, mut certain] = [(); 3].map(|()| {
        let mut score = Score::default();
        score.add_classes(&names);
        score.bound = Some(isolate.certainty);
        score
    });
    let (mut named, mut unnamed, mut weights) = (Vec::new(), 0, Vec::<f32>::new());

    // `gated` hides the name where the signal was not flagged, `certain` where the weight is below the bound.
    each_signal(design, isolate, set, |met, work| {
        let TestSignal { judge, deviation, drive, state } = met;
        let flagged = judge.test(judge.detect(deviation, drive, work)).is_flagged();
        let class = match state {
            HEALTHY => None,
            _ => judge.isolate(deviation, drive, work).and_then(|decision| decision.candidate),
        };
        let class = class.map(usize::from);
        // that of the class itself; the `certainty` of a decision may be that of its category
        let certainty = class.and_then(|class| work.weights.get(class).copied());
        weights.clear();
        weights.extend(class.iter().flat_map(|_| work.weights.iter().map(|&w| w as f32)));
        let candidate = class.map(|class| names[class].as_str());
        if state != HEALTHY {
            named.push((certainty.unwrap_or(0.0), candidate == Some(state)));
            unnamed += usize::from(class.is_none());
        }
        let weights = Some(&weights[..]).filter(|weights| !weights.is_empty());
        let of = |candidate| Prediction { flagged, candidate, certainty, weights };
        ungated.add(of(candidate), Some(state));
        gated.add(of(candidate.filter(|_| flagged)), Some(state));
        let reached = certainty.is_some_and(|c| c >= isolate.certainty);
        certain.add(of(candidate.filter(|_| reached)), Some(state));
    })?;
    Ok(TestResult {
        ungated: ungated.report(),
        gated: gated.report(),
        certain: certain.report(),
        named,
        unnamed,
    })
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
    let by_state = test(design, isolate, learn)?.ungated.by_state;
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
            Ok(tested) => out.detection(name, &tested.ungated),
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
    let named = 1.0 - tested.unnamed as f64 / tested.named.len().max(1) as f64;
    out.put("model matching/of all", tested.ungated.isolation.accuracy * named);
    out.put("model matching/rejected", 1.0 - named);
    Ok(())
}

/// Isolation by the product's default settings, with calibration and the most certain signals.
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
    let mut named = tested.named;
    let right = |named: &[(f64, bool)]| {
        named.iter().filter(|(_, right)| *right).count() as f64 / named.len().max(1) as f64
    };
    // Here a signal for which nothing was named counts as wrong.
    out.put(&figure(NAME, size, "accuracy"), right(&named));

    // The accuracy of the most certain 53.2 %.
    named.sort_by(|a, b| b.0.total_cmp(&a.0));
    named.truncate((SHARE_KEPT * named.len() as f64) as usize);
    out.put(&figure(NAME, size, "best 53.2 %"), right(&named));

    // Calibration errors, on the larger set where there is one.
    let calibration = match &part.calibration {
        Some(more) => test(&design, &isolate, more)?.ungated.calibration,
        None => tested.ungated.calibration,
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

    /// Puts the figures of a method of detection, its confusion, and the misses of each class.
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
        for (state, by) in report.by_state.iter().filter(|(state, _)| *state != HEALTHY) {
            self.put(&format!("{name}/misses of {state}"), (by.signals - by.flagged) as f64);
        }
    }

    /// Puts the figures of a method of isolation; with all training signals also its confusions, and two
    /// variants in which the text of §4-3 sets aside or merges dried nozzles.
    fn isolation(&mut self, name: &str, size: Size, tested: &TestResult) {
        let modes = [("", &tested.ungated), ("gated ", &tested.gated)];
        for (mode, report) in modes {
            let mut put =
                |what: &str, v| self.put(&figure(name, size, &format!("{mode}{what}")), v);
            // where nothing was isolated, no share is right or wrong
            let isolated: u64 = report.isolation.confusion.iter().flatten().sum();
            let of_some = |v: f64, is_any: bool| if is_any { v } else { f64::NAN };
            put("accuracy", of_some(report.isolation.accuracy, isolated > 0));
            put("category", of_some(report.isolation.category_accuracy, isolated > 0));
            put("certain", of_some(report.certain.accuracy, report.certain.coverage > 0.0));
            put("coverage", report.certain.coverage);
        }
        if size != Size::ALL {
            return;
        }
        // confusions, and the thesis's variants of them, with all training signals only
        for (mode, report) in [("", &tested.ungated), (" certain", &tested.certain)] {
            let classes = report.isolation.classes.clone();
            let counts = report.isolation.confusion.iter();
            let counts = counts.map(|row| row.iter().map(|&n| n as f64).collect()).collect();
            let confusion = Confusion { classes, counts };
            if ["SDN", "IDN"].iter().all(|class| confusion.classes.iter().any(|c| c == class)) {
                let without = confusion.without("IDN").hma();
                self.put(&format!("{name}{mode}/HMA without IDN"), without);
                let merged = confusion.merged("SDN", "IDN").hma();
                self.put(&format!("{name}{mode}/HMA, SDN and IDN as one"), merged);
            }
            self.confusions.insert(format!("{name}{mode}"), confusion);
        }
    }
}
