//! A batch's verdicts on their way to the table: healthy signals as runs, all others as rows.
//!
//! Of a healthy signal only the statistic, the misfit and which test they are of differ from its neighbour's.

use super::{Test, VerdictColumns};
use std::ops::Range;

/// What the tests found, signal by signal.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tests {
    /// Of the test that is nearer to its threshold, or further beyond it; NaN: not judged.
    pub statistic: Vec<f32>,
    /// Unexplained mean square over the healthy one's; NaN: not known.
    pub misfit: Vec<f32>,
    /// Whether the statistic is of the second test.
    pub beside: Vec<bool>,
    /// Judged, and not flagged.
    pub healthy: Vec<bool>,
}

impl Tests {
    /// No signals, the room kept.
    pub fn clear(&mut self) {
        let Tests { statistic, misfit, beside, healthy } = self;
        statistic.clear();
        misfit.clear();
        beside.clear();
        healthy.clear();
    }

    pub fn push_not_judged(&mut self, signals: usize) {
        let Tests { statistic, misfit, beside, healthy } = self;
        let all = healthy.len() + signals;
        statistic.resize(all, f32::NAN);
        misfit.resize(all, f32::NAN);
        beside.resize(all, false);
        healthy.resize(all, false);
    }

    pub fn reserve(&mut self, signals: usize) {
        let Tests { statistic, misfit, beside, healthy } = self;
        statistic.reserve(signals);
        misfit.reserve(signals);
        beside.reserve(signals);
        healthy.reserve(signals);
    }
}

/// Neighbouring healthy signals of one burst.
#[derive(Clone, Debug, PartialEq)]
pub struct HealthyRun {
    /// t_a
    pub t_ns: i64,
    /// Index into the batch's printheads.
    pub printhead: u32,
    pub first_channel: u32,
    /// Their places among the batch's [`Tests`].
    pub signals: Range<usize>,
    pub model: u16,
    /// The first test, its threshold and that of the second.
    pub along: Test,
    pub threshold: f32,
    pub beside: f32,
}

/// Rows that follow each other.
#[derive(Clone, Debug, PartialEq)]
pub enum Part {
    Healthy(HealthyRun),
    /// Of [`Verdicts::rows`].
    Rows(Range<usize>),
}

/// Neighbouring rows of one printhead and time: a burst's, or some of them.
#[derive(Clone, Debug, PartialEq)]
pub struct OfBurst {
    /// t_a
    pub t_ns: i64,
    /// Index into the batch's printheads.
    pub printhead: u32,
    pub part: Part,
}

/// The verdicts of one batch, in the recording's order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Verdicts {
    pub parts: Vec<Part>,
    pub tests: Tests,
    /// What is not in a run, and the batch's printheads.
    pub rows: VerdictColumns,
}

impl Verdicts {
    /// How many signals.
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

    /// The parts again, none of more than one burst.
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

    /// Takes in the rows that were pushed last.
    pub fn close_rows(&mut self) {
        let to = self.rows.len();
        match self.parts.last_mut() {
            Some(Part::Rows(rows)) => rows.end = to,
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

/// Rows alone.
impl From<VerdictColumns> for Verdicts {
    fn from(rows: VerdictColumns) -> Verdicts {
        let mut verdicts = Verdicts { rows, ..Verdicts::default() };
        verdicts.close_rows();
        verdicts
    }
}
