//! The outcome of chapter 4, round by round, and the errors that may prevent it.

use inkling_core::model::student::student_quantile;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use thiserror::Error;

#[derive(Debug, Error)]
pub enum ThesisError {
    #[error("{0}")]
    Data(String),
    #[error(transparent)]
    Design(#[from] inkling_core::design::DesignError),
    #[error(transparent)]
    Detect(#[from] inkling_core::detect::DetectError),
    #[error(transparent)]
    Plot(#[from] crate::plot::PlotError),
    #[error("{path}: {source}")]
    Write { path: String, source: std::io::Error },
}

/// The data that chapter 4 is run on.
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

/// Number of signals of a class (row) that were given a name (column); a mean over rounds.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Confusion {
    pub classes: Vec<String>,
    pub counts: Vec<Vec<f64>>,
}

impl Confusion {
    /// The confusion of these classes. `count`: number of signals of a class that were given a name.
    fn of(classes: Vec<String>, count: impl Fn(&str, &str) -> f64) -> Confusion {
        let row = |truth| classes.iter().map(|name| count(truth, name)).collect();
        Confusion { counts: classes.iter().map(|truth| row(truth)).collect(), classes }
    }

    /// Number of signals of a class that were given a name; 0 of a class that is not there.
    pub fn count(&self, truth: &str, name: &str) -> f64 {
        let place = |class: &str| self.classes.iter().position(|c| c == class);
        place(truth).zip(place(name)).map_or(0.0, |(i, j)| self.counts[i][j])
    }

    /// HMA of thesis §4-3, trace over sum: plain accuracy. NaN where nothing was counted.
    pub fn hma(&self) -> f64 {
        let right: f64 = (0..self.classes.len()).map(|i| self.counts[i][i]).sum();
        right / self.counts.iter().flatten().sum::<f64>()
    }

    /// The confusion without one class, as truth and as answer.
    pub fn without(&self, class: &str) -> Confusion {
        let kept = self.classes.iter().filter(|c| *c != class).cloned();
        Confusion::of(kept.collect(), |truth, name| self.count(truth, name))
    }

    /// The confusion with `class` counted as `into`.
    pub fn merged(&self, into: &str, class: &str) -> Confusion {
        let kept = self.classes.iter().filter(|c| *c != class).cloned();
        Confusion::of(kept.collect(), |truth, name| {
            let both = |c| if c == into { vec![c, class] } else { vec![c] };
            let names = both(name);
            let of_names = |truth| names.iter().map(|name| self.count(truth, name)).sum::<f64>();
            both(truth).into_iter().map(of_names).sum()
        })
    }

    /// Adds a multiple of another confusion, class by class.
    fn add(&mut self, other: &Confusion, share: f64) {
        let new = other.classes.iter().filter(|c| !self.classes.contains(c));
        let all = self.classes.iter().chain(new).cloned().collect();
        *self = Confusion::of(all, |truth, name| {
            self.count(truth, name) + share * other.count(truth, name)
        });
    }
}

/// The figures of one round, by name: `method/figure`.
#[derive(Clone, Debug, Default)]
pub struct Figures {
    pub values: BTreeMap<String, f64>,
    pub confusions: BTreeMap<String, Confusion>,
    /// Methods that could not be tried, with the reason.
    pub failed: BTreeMap<String, String>,
}

impl Figures {
    pub fn put(&mut self, key: &str, value: f64) {
        self.values.insert(key.into(), value);
    }
}

/// Mean and scatter of a figure over rounds.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Spread {
    pub mean: f64,
    /// Standard deviation from round to round.
    pub sd: f64,
    pub least: f64,
    pub most: f64,
}

impl Spread {
    pub fn of(v: &[f64]) -> Spread {
        let n = v.len() as f64;
        let mean = v.iter().sum::<f64>() / n;
        let square: f64 = v.iter().map(|x| (x - mean).powi(2)).sum();
        Spread {
            mean,
            sd: (square / (n - 1.0).max(1.0)).sqrt(),
            least: v.iter().copied().fold(f64::INFINITY, f64::min),
            most: v.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        }
    }
}

/// Number of rounds from which on their scatter tells how well their mean is known.
const ENOUGH_ROUNDS: usize = 5;

/// A mean difference with its 95 % interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Difference {
    pub mean: f64,
    pub low: f64,
    pub high: f64,
}

/// The figures of one data set over rounds.
#[derive(Clone, Debug)]
pub struct Measured {
    pub set: DataSet,
    /// Values by name, one for each round; NaN where a round has none.
    pub rounds: BTreeMap<String, Vec<f64>>,
    pub confusions: BTreeMap<String, Confusion>,
    pub failed: BTreeMap<String, String>,
}

impl Measured {
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
                let sum = all.confusions.entry(key.clone()).or_default();
                sum.add(confusion, 1.0 / each.len() as f64);
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

    pub fn spread(&self, key: &str) -> Option<Spread> {
        let values = self.values(key);
        (!values.is_empty()).then(|| Spread::of(&values))
    }

    /// Mean over rounds; NaN where no round has the figure.
    pub fn mean(&self, key: &str) -> f64 {
        self.spread(key).map_or(f64::NAN, |spread| spread.mean)
    }

    /// By how much the share `a` exceeds the share `b`, paired by round, with `signals` signals in each
    /// round. The scatter of a few rounds says little. With fewer than five rounds, the interval is therefore
    /// no narrower than the sampling error of both shares; with more, no narrower than the sampling error if
    /// as few signals as possible are right in only one of the two.
    pub fn difference(&self, a: &str, b: &str, signals: f64) -> Option<Difference> {
        let (a, b) = (self.rounds.get(a)?, self.rounds.get(b)?);
        let pairs: Vec<(f64, f64)> =
            a.iter().copied().zip(b.iter().copied()).filter(|(a, b)| (a - b).is_finite()).collect();
        let each: Vec<f64> = pairs.iter().map(|(a, b)| a - b).collect();
        let n = each.len() as f64;
        if pairs.is_empty() || signals < 1.0 {
            return None;
        }
        let Spread { mean, sd, .. } = Spread::of(&each);
        // variance of the difference per signal: of two independent shares, or the least that the mean
        // difference allows
        let all = signals * n;
        let sampling = match pairs.len() < ENOUGH_ROUNDS {
            true => pairs.iter().map(|(a, b)| a * (1.0 - a) + b * (1.0 - b)).sum::<f64>() / n,
            false => mean.abs(),
        };
        let sampling = 1.96 * (sampling.max(1.0 / all) / all).sqrt();
        let scatter = match pairs.len() {
            1 => 0.0,
            _ => student_quantile(0.975, n - 1.0) * sd / n.sqrt(),
        };
        let half = scatter.max(sampling);
        Some(Difference { mean, low: (mean - half).max(-1.0), high: (mean + half).min(1.0) })
    }

    pub fn json(&self) -> Value {
        let values: BTreeMap<&String, Option<Spread>> =
            self.rounds.keys().map(|key| (key, self.spread(key))).collect();
        json!({
            "data": self.set, "values": values, "confusions": self.confusions, "not_possible": self.failed,
        })
    }
}
