//! A batch's verdicts on their way from the isolate stage to the verdict table: neighbouring
//! healthy signals of a burst as one run, all other signals as rows.
//!
//! In, from `pipeline/isolator.rs`: runs, rows, and the tests' outcomes of all signals. Out, to the
//! table's writer and to whatever counts verdicts: [`Verdicts`], whose `parts` say in the
//! recording's order what comes next: a run, or a range of rows.
//!
//! Nearly all signals of a stream are healthy. Neighbouring healthy signals of a burst differ in
//! their channel number, which counts up by one, and in statistic, misfit and deciding test. These
//! stand in [`Tests`]; all else is the same and stands once in the [`HealthyRun`].

use super::{Test, VerdictColumns};
use std::ops::Range;

/// What the tests found, one entry per signal of the batch, in the batch's order; also of signals
/// that are rows, or that were rejected.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tests {
    /// Statistic of the test that decided: the test that is nearer to its threshold, or further
    /// beyond it. NaN: the signal was not judged.
    pub statistic: Vec<f32>,
    /// Misfit beside the ring over the mean misfit of healthy signals; NaN: not known.
    pub misfit: Vec<f32>,
    /// Whether the second test decided (the misfit beside the ring), so that the statistic is of
    /// that test.
    pub beside: Vec<bool>,
    /// Whether the signal was judged and not flagged.
    pub healthy: Vec<bool>,
}

impl Tests {
    /// Removes all signals, and keeps the memory for the next batch.
    pub fn clear(&mut self) {
        let Tests { statistic, misfit, beside, healthy } = self;
        statistic.clear();
        misfit.clear();
        beside.clear();
        healthy.clear();
    }

    /// Adds so many signals that were not judged.
    pub fn push_not_judged(&mut self, signals: usize) {
        let Tests { statistic, misfit, beside, healthy } = self;
        let all = healthy.len() + signals;
        statistic.resize(all, f32::NAN);
        misfit.resize(all, f32::NAN);
        beside.resize(all, false);
        healthy.resize(all, false);
    }

    /// Makes room for so many more signals.
    pub fn reserve(&mut self, signals: usize) {
        let Tests { statistic, misfit, beside, healthy } = self;
        statistic.reserve(signals);
        misfit.reserve(signals);
        beside.reserve(signals);
        healthy.reserve(signals);
    }
}

/// Neighbouring healthy signals of one burst: each stands for one row of the table.
#[derive(Clone, Debug, PartialEq)]
pub struct HealthyRun {
    /// Time t_a of the burst, ns since the epoch.
    pub t_ns: i64,
    /// Index into the batch's printheads, `VerdictColumns::printheads`.
    pub printhead: u32,
    /// Channel of the first signal; the next ones have the next channel numbers.
    pub first_channel: u32,
    /// Indices of the signals in the batch's [`Tests`].
    pub signals: Range<usize>,
    /// Index of the model in the metadata's `models`.
    pub model: u16,
    /// The first test, its threshold, and the threshold of the second test (NaN: there is none).
    pub along: Test,
    pub threshold: f32,
    pub beside: f32,
}

/// Consecutive rows of the table, in one of two forms.
#[derive(Clone, Debug, PartialEq)]
pub enum Part {
    Healthy(HealthyRun),
    /// Indices in the columns of [`Verdicts::rows`].
    Rows(Range<usize>),
}

/// Consecutive rows of one printhead and time: those of a burst, or some of these.
#[derive(Clone, Debug, PartialEq)]
pub struct OfBurst {
    /// Time t_a of the burst, ns since the epoch.
    pub t_ns: i64,
    /// Index into the batch's printheads.
    pub printhead: u32,
    pub part: Part,
}

/// The verdicts of one batch, in the recording's order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Verdicts {
    /// All signals of the batch, in order.
    pub parts: Vec<Part>,
    pub tests: Tests,
    /// The rows of all signals that are in no run, and the batch's printheads.
    pub rows: VerdictColumns,
}

impl Verdicts {
    /// Number of signals, that is, of rows of the table.
    pub fn len(&self) -> usize {
        let of = |part: &Part| match part {
            Part::Healthy(run) => run.signals.len(),
            Part::Rows(rows) => rows.len(),
        };
        self.parts.iter().map(of).sum()
    }

    pub fn is_empty(&self) -> bool {
        self.parts.is_empty()
    }

    /// The same parts in the same order, divided so that none is of more than one burst. A run is
    /// of one burst already; rows are divided where time or printhead changes.
    pub fn by_burst(&self) -> Vec<OfBurst> {
        let c = &self.rows;
        let burst = |row: &usize| (c.acquired_at_ns[*row], c.printhead[*row]);
        let mut all = Vec::with_capacity(self.parts.len());
        for part in &self.parts {
            match part {
                Part::Healthy(HealthyRun { t_ns, printhead, .. }) => {
                    let (t_ns, printhead) = (*t_ns, *printhead);
                    all.push(OfBurst { t_ns, printhead, part: part.clone() });
                }
                Part::Rows(rows) => {
                    let rows: Vec<usize> = rows.clone().collect();
                    all.extend(rows.chunk_by(|a, b| burst(a) == burst(b)).map(|rows| {
                        let (t_ns, printhead) = burst(&rows[0]);
                        let part = Part::Rows(rows[0]..rows[0] + rows.len());
                        OfBurst { t_ns, printhead, part }
                    }));
                }
            }
        }
        all
    }

    /// Adds the rows that were pushed to `rows` since the last call to the parts. To be called
    /// after rows were pushed and before the next run; without new rows nothing happens.
    pub fn close_rows(&mut self) {
        let to = self.rows.len();
        match self.parts.last_mut() {
            // the last part is of rows: it goes on
            Some(Part::Rows(rows)) => rows.end = to,
            // the last part is a run, or there is none: a new part begins where the last rows ended
            _ => {
                let of = |part: &Part| match part {
                    Part::Rows(rows) => Some(rows.end),
                    Part::Healthy(_) => None,
                };
                let from = self.parts.iter().rev().find_map(of).unwrap_or_default();
                if from < to {
                    self.parts.push(Part::Rows(from..to));
                }
            }
        }
    }
}

/// Verdicts of rows alone, without runs; `tests` stays empty.
impl From<VerdictColumns> for Verdicts {
    fn from(rows: VerdictColumns) -> Verdicts {
        let mut verdicts = Verdicts { rows, ..Verdicts::default() };
        verdicts.close_rows();
        verdicts
    }
}
