//! The outcome of chapter 4: the figures of each round, their means over rounds, and the errors that may
//! prevent them.
//!
//! A round is one seed of simulated data, or one part (fold) of recordings. In: the `Figures` of each
//! round. Out: `Measured`, the rounds of one data set, and `Chapter`, all data sets. A figure is a number
//! with a name such as `LR on r, half/accuracy`; shares are from 0 to 1.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use thiserror::Error;

/// Why chapter 4 could not be done. `Data`: the signals do not suffice, in words for the user.
#[derive(Debug, Error)]
pub enum ThesisError {
    #[error("{0}")]
    Data(String),
    #[error(transparent)]
    Design(#[from] inkling_core::design::DesignError),
    #[error(transparent)]
    Detect(#[from] inkling_core::detect::DetectError),
    #[error("{path}: {source}")]
    Write { path: String, source: std::io::Error },
}

/// The kinds of data that chapter 4 is run on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DataSet {
    /// Rings whose amplitude, damping and frequency are drawn from one box per class, as in thesis §4-1.
    ThesisForm,
    /// The drying experiment of thesis §4-1, simulated.
    Drying,
    /// Faults that change the rates of (2-2), on channels that differ.
    ByModel,
    /// A user's own labelled recordings.
    Recordings,
}

impl DataSet {
    /// The data sets that need no recordings, in the order of the page.
    pub const SIMULATED: [DataSet; 3] = [DataSet::ThesisForm, DataSet::Drying, DataSet::ByModel];

    pub fn title(self) -> &'static str {
        match self {
            DataSet::ThesisForm => "Signals of the thesis's form",
            DataSet::Drying => "The drying experiment, simulated",
            DataSet::ByModel => "Faults by the thesis's model (2-2)",
            DataSet::Recordings => "Your recordings",
        }
    }
}

/// How many signals of a class (row: truth) were given a name (column), both in the order of
/// `classes`. Of ours the counts are means over rounds, so they are no whole numbers.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Confusion {
    pub classes: Vec<String>,
    pub counts: Vec<Vec<f64>>,
}

impl Confusion {
    /// `count(truth, name)`: the number of signals of the class `truth` that were given the name `name`.
    fn of(classes: Vec<String>, count: impl Fn(&str, &str) -> f64) -> Confusion {
        let row = |truth| classes.iter().map(|name| count(truth, name)).collect();
        Confusion { counts: classes.iter().map(|truth| row(truth)).collect(), classes }
    }

    /// The cell of two classes; 0 if the matrix lacks one of them.
    pub fn count(&self, truth: &str, name: &str) -> f64 {
        let place = |class: &str| self.classes.iter().position(|c| c == class);
        place(truth).zip(place(name)).map_or(0.0, |(i, j)| self.counts[i][j])
    }

    /// Adds `share` times another confusion; new classes are appended.
    fn add(&mut self, other: &Confusion, share: f64) {
        let new = other.classes.iter().filter(|c| !self.classes.contains(c));
        let all = self.classes.iter().chain(new).cloned().collect();
        *self = Confusion::of(all, |truth, name| {
            self.count(truth, name) + share * other.count(truth, name)
        });
    }
}

/// The figures of one round, `method/figure`, or `method, size/figure` for isolation.
#[derive(Clone, Debug, Default)]
pub struct Figures {
    pub values: BTreeMap<String, f64>,
    pub confusions: BTreeMap<String, Confusion>,
    /// Methods that could not be tried, with the reason.
    pub failed: BTreeMap<String, String>,
}

impl Figures {
    /// Sets a figure, in place of an earlier one of the same name.
    pub fn put(&mut self, key: &str, value: f64) {
        self.values.insert(key.into(), value);
    }
}

/// Mean and scatter of a figure over the rounds that have it.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Spread {
    pub mean: f64,
    /// Standard deviation from round to round, with n - 1; 0 of a single round.
    pub sd: f64,
}

impl Spread {
    /// The spread of these values, of which there must be at least one.
    pub fn of(v: &[f64]) -> Spread {
        let n = v.len() as f64;
        let mean = v.iter().sum::<f64>() / n;
        let square: f64 = v.iter().map(|x| (x - mean).powi(2)).sum();
        Spread { mean, sd: (square / (n - 1.0).max(1.0)).sqrt() }
    }
}

/// The figures of one data set over its rounds.
#[derive(Clone, Debug)]
pub struct Measured {
    pub set: DataSet,
    /// Values by name, one for each round; NaN where a round has none.
    pub rounds: BTreeMap<String, Vec<f64>>,
    pub confusions: BTreeMap<String, Confusion>,
    /// Methods that could not be tried in some round, each with the reason of the last such round.
    pub failed: BTreeMap<String, String>,
}

impl Measured {
    /// Gathers the figures of all rounds. A confusion becomes the mean over the rounds that have it.
    pub fn of(set: DataSet, each: &[Figures]) -> Measured {
        let mut all = Measured {
            set,
            rounds: BTreeMap::new(),
            confusions: BTreeMap::new(),
            failed: BTreeMap::new(),
        };
        for (round, figures) in each.iter().enumerate() {
            for (key, v) in &figures.values {
                all.rounds.entry(key.clone()).or_insert_with(|| vec![f64::NAN; each.len()])
                    [round] = *v;
            }
            for (key, confusion) in &figures.confusions {
                let rounds = each.iter().filter(|of| of.confusions.contains_key(key)).count();
                let sum = all.confusions.entry(key.clone()).or_default();
                sum.add(confusion, 1.0 / rounds as f64);
            }
            all.failed.extend(figures.failed.clone());
        }
        all
    }

    /// The values of a figure, in the rounds that have one.
    pub fn values(&self, key: &str) -> Vec<f64> {
        let all = self.rounds.get(key).into_iter().flatten();
        all.copied().filter(|v| v.is_finite()).collect()
    }

    /// Mean and scatter over rounds; `None` if no round has the figure.
    pub fn spread(&self, key: &str) -> Option<Spread> {
        let values = self.values(key);
        (!values.is_empty()).then(|| Spread::of(&values))
    }

    /// Mean over rounds; NaN where no round has the figure.
    pub fn mean(&self, key: &str) -> f64 {
        self.spread(key).map_or(f64::NAN, |spread| spread.mean)
    }

    /// The part of `tables.json` about this data set.
    pub fn json(&self) -> Value {
        let values: BTreeMap<&String, Option<Spread>> =
            self.rounds.keys().map(|key| (key, self.spread(key))).collect();
        json!({
            "data": self.set, "values": values, "confusions": self.confusions, "not_possible": self.failed,
        })
    }
}

/// What a round is in which figures are measured: a seed, or a part of recordings.
#[derive(Clone, Debug, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Rounds {
    Seeds(Vec<u64>),
    /// Recordings: the labelled channels in `number` parts, each of which is tested on once by what
    /// was learned on the others. `left_out`: in sentences, the classes and signals that were not
    /// used.
    Folds {
        number: usize,
        left_out: Vec<String>,
    },
}

/// All that one run of `inkling thesis` found.
#[derive(Clone, Debug)]
pub struct Chapter {
    pub rounds: Rounds,
    pub sets: Vec<Measured>,
}

impl Chapter {
    /// The figures of one data set; `None` if chapter 4 was not run on it.
    pub fn set(&self, set: DataSet) -> Option<&Measured> {
        self.sets.iter().find(|measured| measured.set == set)
    }

    /// The contents of `tables.json`.
    pub fn json(&self) -> Value {
        let sets: Vec<Value> = self.sets.iter().map(Measured::json).collect();
        json!({"version": 3, "rounds": self.rounds, "sets": sets})
    }
}
