//! One seed of chapter 4 on the thesis-form data set. In: a scenario, a seed. Out: its figures.
//! thesis Tables 4-1, 4-3, 4-4, 4-6, and the methods that the thesis describes without a table.

use super::data::Signals;
use super::practice::{Thresholds, key_numbers};
use super::{Confusion, Figures, ThesisError};
use crate::design::{Design, DetectSettings, IsolateSettings, Judge, TrainingSet, Workspace};
use crate::detect::{Denominator, DetectMethod, ThresholdMethod, denominator_search, null_space};
use crate::fault::{CLASSES, HEALTHY};
use crate::identify::GreyBoxSettings;
use crate::isolate::{IsolateMethod, IsolateSignal};
use crate::labels::Labels;
use crate::score::{Report, Said, Score};
use crate::simulate::Scenario;

/// The denominator that reproduces the thesis's figures.
pub fn thesis_detect(mu: f64) -> DetectSettings {
    DetectSettings {
        method: DetectMethod::ResidualEnergy,
        threshold: ThresholdMethod::Max,
        mu,
        oscillations: Some(7.25),
        other_poles_per_s: vec![5e5, 5e5],
        ..DetectSettings::default()
    }
}

/// Training and test signals of one seed.
pub fn signals(scenario: &Scenario, seed: u64) -> Result<(Signals, Signals), ThesisError> {
    let labels = Labels::new(scenario.labels(seed));
    let mut sets = scenario.recordings(seed).into_iter().map(|r| Signals::of(r, &labels));
    match (sets.next(), sets.next()) {
        (Some(train), Some(test)) => Ok((train, test)),
        _ => Err(ThesisError::Scenario("a training and a test set are needed".into())),
    }
}

/// How one isolation method does on test signals.
pub struct Isolated {
    pub ungated: Report,
    pub gated: Report,
    /// Only what reached the certainty bound, ungated: thesis Table 4-4.
    pub certain: Report,
    /// Faulty signals that no class was said of.
    pub nothing_said: u64,
}

pub fn train(
    set: &TrainingSet,
    detect: &DetectSettings,
    isolate: &IsolateSettings,
) -> Result<Design, ThesisError> {
    // the thesis's chain begins with its own average
    let plain_mean = detect.method != DetectMethod::Sensitivity;
    let grey_box = GreyBoxSettings { plain_mean, ..GreyBoxSettings::default() };
    let (design, _) = Design::train(set, &grey_box, detect, isolate)?;
    Ok(design)
}

pub fn settings(method: IsolateMethod, signal: IsolateSignal) -> IsolateSettings {
    IsolateSettings { method, signal, gate: false, ..IsolateSettings::default() }
}

/// Judges every test signal: detection, and isolation of all that are faulty in truth.
pub fn judge(
    design: &Design,
    isolate: &IsolateSettings,
    test: &Signals,
) -> Result<Isolated, ThesisError> {
    let judge = Judge::new(0, design.pooled.clone().into(), None, Some(design), isolate)?;
    let names = design.class_names();
    let [mut ungated, mut gated, mut certain] =
        [Score::default(), Score::default(), Score::default()];
    for score in [&mut ungated, &mut gated, &mut certain] {
        score.add_classes(&names);
        score.set_bound(isolate.certainty);
    }
    let (mut work, mut nothing_said) = (Workspace::default(), 0);
    let mut deviation = vec![0.0; test.samples];
    for (y, state) in test.each() {
        for ((d, y), e) in deviation.iter_mut().zip(y).zip(&judge.model.expected) {
            *d = y - e;
        }
        let flagged = judge.test(judge.detect(&deviation, 1.0, &mut work)).is_flagged();
        let isolation = if state == HEALTHY {
            None
        } else {
            judge.isolate(&deviation, 1.0, &mut work).filter(|d| d.candidate.is_some())
        };
        nothing_said += u64::from(state != HEALTHY && isolation.is_none());
        let candidate = isolation.and_then(|d| d.candidate).map(|k| names[usize::from(k)].as_str());
        // the class's own weight: `certainty` may be its category's
        let certainty =
            isolation.and_then(|d| work.weights.get(usize::from(d.candidate?)).copied());
        let said = |candidate| Said { flagged, candidate, certainty, weights: None };
        ungated.add(said(candidate), Some(state));
        gated.add(said(candidate.filter(|_| flagged)), Some(state));
        let reached = certainty.is_some_and(|c| c >= isolate.certainty);
        certain.add(said(candidate.filter(|_| reached)), Some(state));
    }
    Ok(Isolated {
        ungated: ungated.report(),
        gated: gated.report(),
        certain: certain.report(),
        nothing_said,
    })
}

/// Everything of one seed.
pub fn figures(scenario: &Scenario, seed: u64) -> Result<Figures, ThesisError> {
    let (learn, test) = signals(scenario, seed)?;
    let mut figures = Figures::default();
    detection(&learn, &test, &mut figures)?;
    isolation(&learn, &test, &mut figures)?;
    practice(&learn, &test, &mut figures);
    super::defaults::figures(scenario, seed, &learn, &test, &mut figures)?;
    Ok(figures)
}

fn detection(learn: &Signals, test: &Signals, out: &mut Figures) -> Result<(), ThesisError> {
    let isolate = settings(IsolateMethod::ResidualMatching, IsolateSignal::Residual);
    let set = learn.training(learn.faulty());
    let energy =
        DetectSettings { method: DetectMethod::ResidualEnergy, ..DetectSettings::default() };
    let max = DetectSettings { threshold: ThresholdMethod::Max, ..energy.clone() };
    let with = |denominator, poles: &[f64]| DetectSettings {
        denominator,
        other_poles_per_s: poles.to_vec(),
        ..max.clone()
    };
    let variants = [
        ("n_o = 7.25", thesis_detect(1.0)),
        ("maximum", DetectSettings { method: DetectMethod::ResidualMaximum, ..thesis_detect(1.0) }),
        ("n_o = f0 T", max.clone()),
        ("n_o = f0 T, degree 3", with(Denominator::Resonance, &[2e5])),
        ("II", with(Denominator::Eigenvalues, &[2e5, 2e5])),
        ("III", with(Denominator::Enhanced, &[2e5; 4])),
        ("(3-3b)", with(Denominator::Enhanced, &[2e5; 2])),
        ("quantile", energy),
    ];
    for (name, detect) in variants {
        let design = train(&set, &detect, &isolate)?;
        let report = judge(&design, &isolate, test)?.ungated;
        out.detection(name, &report);
        if name == "n_o = f0 T" {
            tuned(&design, learn, test, out)?;
        }
    }
    Ok(())
}

/// The search for a denominator, and what it brings on the test signals.
fn tuned(
    design: &Design,
    learn: &Signals,
    test: &Signals,
    out: &mut Figures,
) -> Result<(), ThesisError> {
    let model = &design.pooled;
    let (a, c) = (model.identification.channel.a(), model.identification.channel.c());
    let numerator = null_space::numerator(&a, &c, learn.dt_s, 4)?;
    let frequency_hz = model.identification.poles.frequency_hz;
    let of = |signals: &Signals, faulty: bool| -> Vec<Vec<f64>> {
        let deviation = |y: &Vec<f64>| y.iter().zip(&model.expected).map(|(y, e)| y - e).collect();
        (0..signals.len())
            .filter(|&i| signals.is_faulty(i) == faulty)
            .map(|i| deviation(&signals.y[i]))
            .collect()
    };
    let (healthy, faulty) = (of(learn, false), of(learn, true));
    let found =
        denominator_search::search(&numerator, frequency_hz, &healthy, &faulty, learn.dt_s)?;
    let generator = found.choice.generator(&numerator, learn.dt_s)?;
    let threshold = healthy.iter().map(|d| generator.energy(d)).fold(0.0, f64::max);
    let passed = |d: &[Vec<f64>]| d.iter().filter(|d| generator.energy(d) > threshold).count();
    let (healthy, faulty) = (of(test, false), of(test, true));
    let put = &mut |key: &str, v: f64| out.put(&format!("search/{key}"), v);
    put("misses", (faulty.len() - passed(&faulty)) as f64);
    put("false alarms", passed(&healthy) as f64);
    put("cross-validated misses", found.cross_validated);
    put("cross-validated misses of method I", found.method_one);
    put("frequency over f0", found.choice.frequency_hz / frequency_hz);
    put("damping, 1/s", found.choice.damping_per_s);
    put("other poles, 1/s", found.choice.other_per_s);
    Ok(())
}

/// A method on what it looks at, by the name that figures have.
pub struct Compared {
    pub name: &'static str,
    pub method: IsolateMethod,
    pub signal: IsolateSignal,
}

/// The thesis's own first: linear regression, and the nearest neighbour.
pub const COMPARED: [Compared; 4] = {
    use IsolateMethod::{Neighbours, ResidualMatching};
    use IsolateSignal::{Deviation, Residual};
    [
        Compared { name: "LR on r", method: ResidualMatching, signal: Residual },
        Compared { name: "LR on y", method: ResidualMatching, signal: Deviation },
        Compared { name: "1-NN on r", method: Neighbours, signal: Residual },
        Compared { name: "1-NN on y", method: Neighbours, signal: Deviation },
    ]
};

fn isolation(learn: &Signals, test: &Signals, out: &mut Figures) -> Result<(), ThesisError> {
    let all = learn.faulty();
    let detect = thesis_detect(1.0);
    for size in [all, all.div_ceil(2), all / 10 + 1] {
        let set = learn.training(size);
        let remember = settings(IsolateMethod::Neighbours, IsolateSignal::Residual);
        let design = train(&set, &detect, &remember)?;
        for (at, Compared { name, method, signal }) in COMPARED.into_iter().enumerate() {
            let isolated = judge(&design, &settings(method, signal), test)?;
            out.isolation(&format!("{name}, {size}"), &isolated, size == all && at == 0);
        }
    }
    let set = learn.training(all);
    let matching = settings(IsolateMethod::ModelMatching, IsolateSignal::Residual);
    let design = train(&set, &detect, &matching)?;
    out.put("models of faults", design.classes.iter().filter(|c| c.model.is_some()).count() as f64);
    let isolated = judge(&design, &matching, test)?;
    out.isolation("model matching", &isolated, true);
    let faulty = test.faulty() as f64;
    let isolated_share = 1.0 - isolated.nothing_said as f64 / faulty;
    out.put("model matching/of all", isolated.ungated.isolation.accuracy * isolated_share);
    out.put("model matching/rejected", 1.0 - isolated_share);
    Ok(())
}

/// The classes that the maker's own method can name, thesis §4-3.
const KNOWN_TO_PRACTICE: [&str; 4] = ["EC", "AB3", "BN", "PBN"];

fn practice(learn: &Signals, test: &Signals, out: &mut Figures) {
    let thresholds = Thresholds::learn(learn, &key_numbers(learn));
    let (mut right, mut four, mut nine, mut known, mut false_alarms, mut misses) =
        (0, 0, 0, 0, 0, 0);
    for (k, state) in key_numbers(test).iter().zip(&test.state) {
        let faulty = state != HEALTHY;
        let flagged = thresholds.is_faulty(k);
        right += usize::from(flagged == faulty);
        false_alarms += usize::from(flagged && !faulty);
        misses += usize::from(!flagged && faulty);
        if faulty {
            four += usize::from(thresholds.name(k, &KNOWN_TO_PRACTICE) == Some(state));
            nine += usize::from(thresholds.name(k, &CLASSES) == Some(state));
            known += usize::from(KNOWN_TO_PRACTICE.contains(&state.as_str()));
        }
    }
    let (n, faulty) = (test.len() as f64, test.faulty() as f64);
    out.put("practice/detection", right as f64 / n);
    out.put("practice/misses", misses as f64);
    out.put("practice/false alarms", false_alarms as f64);
    out.put("practice/four classes", four as f64 / faulty);
    out.put("practice/of the four", four as f64 / f64::from(known.max(1) as u32));
    out.put("practice/nine classes", nine as f64 / faulty);
}

impl Figures {
    pub fn put(&mut self, key: &str, value: f64) {
        self.values.insert(key.into(), value);
    }

    pub fn detection(&mut self, name: &str, report: &Report) {
        let d = &report.detection;
        let cells = [("tn", d.tn), ("false alarms", d.fp), ("misses", d.fn_), ("tp", d.tp)];
        for (what, n) in cells {
            self.put(&format!("FD {name}/{what}"), n as f64);
        }
        self.put(&format!("FD {name}/accuracy"), d.accuracy());
        let counts = [[d.tn, d.fp], [d.fn_, d.tp]];
        let counts = counts.map(|row| row.map(|n| n as f64).to_vec()).to_vec();
        let classes = vec!["healthy".into(), "faulty".into()];
        self.confusions.insert(format!("FD {name}"), Confusion { classes, counts });
        for (state, by) in &report.by_state {
            if state != HEALTHY {
                let missed = (by.signals - by.flagged) as f64;
                self.put(&format!("FD {name}/misses of {state}"), missed);
            }
        }
    }

    /// `tables`: keep the confusion matrices, too.
    pub fn isolation(&mut self, name: &str, isolated: &Isolated, tables: bool) {
        for (mode, report) in [("", &isolated.ungated), (" gated", &isolated.gated)] {
            self.put(&format!("{name}{mode}/accuracy"), report.isolation.accuracy);
            self.put(&format!("{name}{mode}/certain"), report.certain.accuracy);
            self.put(&format!("{name}{mode}/coverage"), report.certain.coverage);
        }
        if !tables {
            return;
        }
        for (mode, report) in [("", &isolated.ungated), (" certain", &isolated.certain)] {
            let classes = report.isolation.classes.clone();
            let counts = report.isolation.confusion.iter();
            let counts = counts.map(|row| row.iter().map(|&n| n as f64).collect()).collect();
            let confusion = Confusion { classes, counts };
            if confusion.classes.iter().any(|c| c == "SDN") {
                let without = confusion.without("IDN").hma();
                self.put(&format!("{name}{mode}/HMA without IDN"), without);
                let merged = confusion.merged("SDN", "IDN").hma();
                self.put(&format!("{name}{mode}/HMA, SDN and IDN as one"), merged);
            }
            self.confusions.insert(format!("{name}{mode}"), confusion);
        }
    }
}
