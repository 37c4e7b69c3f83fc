//! Scores verdicts against the truth: the numbers of thesis chapter 4, and further ones.
//!
//! In: one `Prediction` after another with the state that its label gives (`Score::add`), from
//! `inkling score` and from `thesis::measure`. Out: a `Report`: counts of detection, the confusion
//! of isolation, accuracy, coverage at the certainty bound, and calibration. All shares are from 0
//! to 1. Only sums are kept, so memory does not grow with signals.
//!
//! Isolation and calibration count faulty signals that have a candidate, whether they were flagged
//! or not; whoever wants gated figures leaves the candidate out. The thesis's "HMA" (§4-3) is trace
//! over total: plain accuracy.
//!
//! Scores of other things are in the modules: `severity` (sizes), `episodes` (faults over several
//! bursts), `blind` (critiques).

pub mod blind;
pub mod episodes;
pub mod severity;
mod sums;
pub mod truth;

pub use inkling_core::promise;

use episodes::EpisodesReport;
use inkling_core::fault::Categories;
use serde::Serialize;
use severity::SeverityReport;
use std::collections::BTreeMap;
use sums::{named, share};

/// What inkling says of one signal, to be compared with the signal's label.
#[derive(Clone, Copy, Debug)]
pub struct Prediction<'a> {
    /// Whether the signal was flagged (faulty or undecided).
    pub flagged: bool,
    /// The class with the largest weight, whether it is certain or not; `None`: the signal was not
    /// isolated.
    pub candidate: Option<&'a str>,
    /// The weight of the candidate, from 0 to 1.
    pub certainty: Option<f64>,
    /// The phi or the posterior of each class, in the order of the classes given to [`Score::add_classes`].
    pub weights: Option<&'a [f32]>,
}

/// Numbers of signals by truth and by whether they were flagged: `tp` faulty and flagged, `fp`
/// healthy and flagged, `tn` healthy and passed, `fn_` faulty and passed.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Detection {
    pub tp: u64,
    pub fp: u64,
    pub tn: u64,
    #[serde(rename = "fn")]
    pub fn_: u64,
}

impl Detection {
    /// Share of all signals that are flagged if faulty and passed if healthy.
    pub fn accuracy(&self) -> f64 {
        share(self.tp + self.tn, self.tp + self.tn + self.fp + self.fn_)
    }

    /// Share of the faulty signals that is flagged.
    pub fn recall(&self) -> f64 {
        share(self.tp, self.tp + self.fn_)
    }

    /// Share of the healthy signals that is flagged.
    pub fn false_alarm_rate(&self) -> f64 {
        share(self.fp, self.fp + self.tn)
    }
}

/// Confusion of the candidates of faulty signals. Rows are the truth, columns the candidates, both
/// in the order of `classes`.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Isolation {
    pub classes: Vec<String>,
    pub confusion: Vec<Vec<u64>>,
    pub accuracy: f64,
    /// Share of these signals whose candidate is of the right category.
    pub category_accuracy: f64,
}

/// Those candidates whose certainty reaches `bound`: the share of them that is right (`accuracy`),
/// and their share among all candidates of faulty signals (`coverage`).
#[derive(Clone, Debug, Default, Serialize)]
pub struct Certain {
    pub bound: f64,
    pub accuracy: f64,
    pub coverage: f64,
}

/// How well stated certainties agree with how often the candidates are right, over faulty signals.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Calibration {
    /// Expected calibration error of the candidate's certainty, 15 equal-width bins.
    pub ece: f64,
    /// The same error of each class's weight, over all signals whether the class is the candidate
    /// or not; the mean over the classes. Null without weights.
    pub classwise_ece: Option<f64>,
    /// Per bin: mean of the certainty, share that is right, count.
    pub bins: Vec<(f64, f64, u64)>,
}

/// Detection of signals with one labelled state.
#[derive(Clone, Debug, Default, Serialize)]
pub struct ByState {
    pub signals: u64,
    pub flagged: u64,
}

/// The certainty from which on the thesis takes a name for certain.
const THESIS_BOUND: f64 = 0.8;
/// Number of bins of the certainty.
const BINS: usize = 15;

/// Sums of one bin: of the certainties, of how often the class was right, and of the signals.
#[derive(Clone, Copy, Debug, Default)]
struct Bin {
    certainty: f64,
    right: u64,
    n: u64,
}

/// Sums that grow while rows come in; [`Score::report`] computes the figures from them.
#[derive(Clone, Debug, Default)]
pub struct Score {
    classes: Vec<String>,
    /// Categories of a user's own classes.
    pub categories: Categories,
    /// The certainty bound of `certain`; `None`: .8, that of the thesis.
    pub bound: Option<f64>,
    detection: Detection,
    by_state: BTreeMap<String, ByState>,
    /// Number of signals by (truth, candidate).
    confusion: BTreeMap<(String, String), u64>,
    /// Faulty signals with a candidate, and those among them whose category, or class, is right.
    isolated: u64,
    category_right: u64,
    right: u64,
    /// Candidates whose certainty reaches the bound, and those of them whose class is right.
    certain: u64,
    certain_right: u64,
    /// Bins of the candidate's certainty, and of each class's weight in the order of `classes`.
    bins: [Bin; BINS],
    class_bins: Vec<[Bin; BINS]>,
    unlabelled: u64,
    /// Number of rejected signals, which are not scored.
    pub rejected: u64,
}

/// What `inkling score` prints; with `--json`, this.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Report {
    pub detection: Detection,
    pub isolation: Isolation,
    pub certain: Certain,
    pub calibration: Calibration,
    /// By class; empty where nothing was sized, or where no label has a size.
    pub severity: BTreeMap<String, SeverityReport>,
    /// The same for categories whose classes are sized by one quantity.
    pub severity_by_category: BTreeMap<String, SeverityReport>,
    /// Absent without an episode table beside the verdicts.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub episodes: Option<EpisodesReport>,
    pub by_state: BTreeMap<String, ByState>,
    pub unlabelled: u64,
    pub rejected: u64,
}

impl Score {
    /// Makes known the classes in whose order weights come. It may be called again with a list that
    /// begins with the known classes: only those beyond them are appended.
    pub fn add_classes(&mut self, classes: &[String]) {
        for class in classes.iter().skip(self.classes.len()) {
            self.classes.push(class.clone());
            self.class_bins.push([Bin::default(); BINS]);
        }
    }

    /// Counts one prediction against the state that its label gives. `None`: there is no label, so
    /// nothing is scored. Without a candidate, or of a healthy signal, only detection is counted.
    pub fn add(&mut self, prediction: Prediction, truth: Option<&str>) {
        let Some(truth) = truth else {
            self.unlabelled += 1;
            return;
        };
        let state = named(&mut self.by_state, truth);
        state.signals += 1;
        state.flagged += u64::from(prediction.flagged);
        match (truth == inkling_core::fault::HEALTHY, prediction.flagged) {
            (true, true) => self.detection.fp += 1,
            (true, false) => self.detection.tn += 1,
            (false, true) => self.detection.tp += 1,
            (false, false) => self.detection.fn_ += 1,
        }
        if truth == inkling_core::fault::HEALTHY {
            return;
        }

        // Isolation: faulty signals with a candidate.
        let Some(candidate) = prediction.candidate else { return };
        self.isolated += 1;
        let right = candidate == truth;
        self.right += u64::from(right);
        let category = self.categories.of(candidate);
        self.category_right += u64::from(self.categories.is_of(truth, category));
        *self.confusion.entry((truth.to_owned(), candidate.to_owned())).or_default() += 1;

        // Calibration: how certain the candidate was, and how often it was right.
        if let Some(certainty) = prediction.certainty.filter(|c| c.is_finite()) {
            if certainty >= self.bound.unwrap_or(THESIS_BOUND) {
                self.certain += 1;
                self.certain_right += u64::from(right);
            }
            fill(&mut self.bins, certainty, right);
        }

        // The same of every class's weight: the class is right where it is the truth.
        if let Some(weights) = prediction.weights {
            for ((bins, class), &w) in self.class_bins.iter_mut().zip(&self.classes).zip(weights) {
                if w.is_finite() {
                    fill(bins, f64::from(w), class == truth);
                }
            }
        }
    }

    /// The figures so far. In the confusion, classes that only labels or candidates name follow
    /// those of `add_classes`. Severities and episodes are left empty; `inkling score` fills them
    /// in.
    pub fn report(&self) -> Report {
        let mut classes = self.classes.clone();
        for (truth, candidate) in self.confusion.keys() {
            for name in [truth, candidate] {
                if !classes.contains(name) {
                    classes.push(name.clone());
                }
            }
        }
        let count = |t: &String, c: &String| {
            self.confusion.get(&(t.clone(), c.clone())).copied().unwrap_or(0)
        };
        let confusion =
            classes.iter().map(|t| classes.iter().map(|c| count(t, c)).collect()).collect();
        let with_weights = self.class_bins.iter().flatten().any(|b| b.n > 0);
        let classwise_ece = with_weights.then(|| {
            self.class_bins.iter().map(calibration_error).sum::<f64>()
                / self.class_bins.len() as f64
        });
        Report {
            detection: self.detection.clone(),
            isolation: Isolation {
                classes,
                confusion,
                accuracy: share(self.right, self.isolated),
                category_accuracy: share(self.category_right, self.isolated),
            },
            certain: Certain {
                bound: self.bound.unwrap_or(THESIS_BOUND),
                accuracy: share(self.certain_right, self.certain),
                coverage: share(self.certain, self.isolated),
            },
            calibration: Calibration {
                ece: calibration_error(&self.bins),
                classwise_ece,
                bins: self
                    .bins
                    .iter()
                    .map(|b| (b.certainty / (b.n.max(1)) as f64, share(b.right, b.n), b.n))
                    .collect(),
            },
            by_state: self.by_state.clone(),
            unlabelled: self.unlabelled,
            rejected: self.rejected,
            ..Report::default()
        }
    }
}

/// Adds one certainty (0 to 1) to its bin, one of `BINS` of equal width.
fn fill(bins: &mut [Bin; BINS], certainty: f64, right: bool) {
    let i = ((certainty * BINS as f64) as usize).min(BINS - 1);
    bins[i].certainty += certainty;
    bins[i].right += u64::from(right);
    bins[i].n += 1;
}

/// Expected calibration error: sum over bins of n/N |mean certainty - share right|. With the bin's
/// sums this is |sum of certainties - number right| / N.
fn calibration_error(bins: &[Bin; BINS]) -> f64 {
    let total: u64 = bins.iter().map(|b| b.n).sum();
    bins.iter().map(|b| (b.certainty - b.right as f64).abs()).sum::<f64>() / total.max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn predicted(flagged: bool, candidate: &str, certainty: f64) -> Prediction<'_> {
        Prediction {
            flagged,
            candidate: Some(candidate),
            certainty: Some(certainty),
            weights: None,
        }
    }

    #[test]
    fn thesis_table_4_3_gives_its_accuracy() {
        let classes: Vec<String> =
            inkling_core::fault::CLASSES.iter().map(|c| c.to_string()).collect();
        let table = [
            [154, 0, 0, 0, 0, 0, 27, 0, 44],
            [0, 173, 0, 0, 6, 0, 46, 0, 0],
            [0, 0, 222, 2, 1, 0, 0, 0, 0],
            [0, 0, 0, 225, 0, 0, 0, 0, 0],
            [0, 0, 0, 0, 225, 0, 0, 0, 0],
            [0, 1, 0, 0, 0, 172, 52, 0, 0],
            [0, 0, 0, 0, 0, 0, 225, 0, 0],
            [0, 0, 0, 0, 0, 99, 117, 9, 0],
            [0, 0, 0, 0, 0, 0, 0, 8, 217],
        ];
        let mut score = Score::default();
        score.add_classes(&classes);
        for (t, row) in table.iter().enumerate() {
            for (c, &n) in row.iter().enumerate() {
                for _ in 0..n {
                    score.add(predicted(true, &classes[c], 1.0), Some(&classes[t]));
                }
            }
        }
        assert!((score.report().isolation.accuracy - 0.801).abs() < 5e-4);
        // right but for EC as SDN or DDN, AB1 as BN or SDN, AB2 as BN, PBN as AB1 or SDN, IDN as PBN
        let wrong = 27 + 44 + 6 + 46 + 1 + 1 + 52 + 99;
        let by_hand = 1.0 - f64::from(wrong) / 2025.0;
        assert!((score.report().isolation.category_accuracy - by_hand).abs() < 1e-12);
    }

    #[test]
    fn perfectly_calibrated_certainty_has_no_calibration_error() {
        let mut score = Score::default();
        score.add_classes(&["EC".into(), "BN".into()]);
        score.bound = Some(0.8);
        for i in 0..1000 {
            score.add(predicted(true, if i % 4 == 0 { "BN" } else { "EC" }, 0.75), Some("EC"));
        }
        assert!(score.report().calibration.ece < 1e-12);
        assert_eq!(score.report().certain.coverage, 0.0);
    }
}
