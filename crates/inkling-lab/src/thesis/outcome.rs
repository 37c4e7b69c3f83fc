//! The outcome of chapter 4: the figures of each round, their means and differences over rounds,
//! and the errors that may prevent them.
//!
//! A round is one seed of simulated data, or one part (fold) of recordings. In: the `Figures` of each
//! round. Out: `Measured`, the rounds of one data set, and differences of its shares with intervals
//! (`Measured::difference`). A figure is a number with a name such as `LR on r, half/accuracy`;
//! shares are from 0 to 1.

use inkling_core::model::student::student_quantile;
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
    #[error(transparent)]
    Plot(#[from] crate::plot::PlotError),
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

    /// The confusion with the two classes as one, which is called `into`.
    pub fn merged(&self, into: &str, class: &str) -> Confusion {
        let kept = self.classes.iter().filter(|c| *c != class).cloned();
        Confusion::of(kept.collect(), |truth, name| {
            let both = |c| if c == into { vec![c, class] } else { vec![c] };
            let names = both(name);
            let of_names = |truth| names.iter().map(|name| self.count(truth, name)).sum::<f64>();
            both(truth).into_iter().map(of_names).sum()
        })
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
    pub least: f64,
    pub most: f64,
}

impl Spread {
    /// The spread of these values, of which there must be at least one.
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

/// The 95 % interval of a mean difference of two shares, within -1 to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Difference {
    pub low: f64,
    pub high: f64,
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

    /// By how much the share `a` exceeds the share `b`, on average over the rounds that have both.
    /// `a`, `b`: names of figures; `signals`: the number of signals that each share of one round is
    /// of, the smaller number if the two differ. `None`: no round has both, or there is no signal.
    ///
    /// The interval is mean +- max(scatter, sampling):
    /// * scatter = t sd / sqrt(n), Student's interval of the paired differences of n rounds. The
    ///   scatter of a few rounds may be small by chance, so it alone would say too much.
    /// * sampling = 1.96 sqrt(v / (n signals)), where v is the variance of the difference per
    ///   signal. With fewer than five rounds v is that of two independent shares,
    ///   a (1 - a) + b (1 - b), which is cautious, since both methods judge the same signals. With
    ///   five or more v is |mean|, the least possible: as few signals as the mean difference allows
    ///   are right in only one of the two.
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
        // at least that of one signal among all, so that equal shares get an interval
        let all = signals * n;
        let sampling = match pairs.len() < ENOUGH_ROUNDS {
            true => pairs.iter().map(|(a, b)| a * (1.0 - a) + b * (1.0 - b)).sum::<f64>() / n,
            false => mean.abs(),
        };
        let sampling = 1.96 * (sampling.max(1.0 / all) / all).sqrt();

        // The scatter from round to round; of one round it is not known, and sampling alone counts.
        let scatter = match pairs.len() {
            1 => 0.0,
            _ => student_quantile(0.975, n - 1.0) * sd / n.sqrt(),
        };
        let half = scatter.max(sampling);
        Some(Difference { low: (mean - half).max(-1.0), high: (mean + half).min(1.0) })
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
