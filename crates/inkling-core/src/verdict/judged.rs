//! A batch's verdicts on their way from the isolate stage to the verdict table: neighbouring
//! healthy signals of a burst as one run, all other signals as rows.
//!
//! In: runs, rows, and the tests' outcomes of all signals. Out: [`Verdicts`], whose `parts` are runs
//! and ranges of rows in the recording's order. The signals of a run differ in their channel number,
//! which counts up by one, and in what stands in [`Tests`]; all else stands once.

use super::{Cells, Outcome, Test, VerdictColumns};
use std::ops::Range;

/// What the tests found, one entry per signal of the batch, whatever became of it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tests {
    /// Statistic of the test that decided; NaN: the signal was not judged.
    pub statistic: Vec<f32>,
    /// Misfit beside the ring over the mean misfit of healthy signals; NaN: not known.
    pub misfit: Vec<f32>,
    /// Whether the second test decided (the misfit beside the ring).
    pub beside: Vec<bool>,
    pub healthy: Vec<bool>,
}

impl Tests {
    pub fn clear(&mut self) {
        self.resize(0);
    }

    pub fn push_not_judged(&mut self, signals: usize) {
        self.resize(self.healthy.len() + signals);
    }

    fn resize(&mut self, signals: usize) {
        let Tests { statistic, misfit, beside, healthy } = self;
        statistic.resize(signals, f32::NAN);
        misfit.resize(signals, f32::NAN);
        beside.resize(signals, false);
        healthy.resize(signals, false);
    }
}

/// Neighbouring healthy signals of one burst: each stands for one row of the table.
#[derive(Clone, Debug, PartialEq)]
pub struct HealthyRun {
    /// Time t_a of the burst, ns since the epoch.
    pub t_ns: i64,
    /// Index into the batch's printheads.
    pub printhead: u32,
    pub first_channel: u32,
    pub signals: Range<usize>,
    pub model: u16,
    /// The first test, its threshold, and the threshold of the second test (NaN: there is none).
    pub along: Test,
    pub threshold: f32,
    pub beside: f32,
    /// As recorded with the burst.
    pub temperature_c: Option<f32>,
    pub drive_voltage_v: Option<f32>,
}

impl HealthyRun {
    /// The keys of its signals in a column ([`Cells::key`]): of those that the first test decided,
    /// and of those that the second did.
    pub fn keys(&self, cells: &Cells) -> [Option<u32>; 2] {
        match cells {
            Cells::Recording => [Some(0); 2],
            Cells::Printhead(_) => [Some(self.printhead); 2],
            Cells::Outcome(_) => [Some(Outcome::Healthy as u32); 2],
            Cells::Model(_) => [Some(self.model.into()); 2],
            Cells::Test(_) => [self.along, Test::Misfit].map(|test| Some(test as u32)),
            Cells::Threshold(_) => [self.threshold, self.beside].map(|value| Some(value.to_bits())),
            Cells::Temperature(_) => [self.temperature_c.map(f32::to_bits); 2],
            Cells::Drive(_) => [self.drive_voltage_v.map(f32::to_bits); 2],
            _ => [None; 2],
        }
    }

    fn spell_out(&self, tests: &Tests, to: &mut VerdictColumns) {
        for (k, signal) in (0u32..).zip(self.signals.clone()) {
            let (beside, misfit) = (tests.beside[signal], tests.misfit[signal]);
            to.acquired_at_ns.push(self.t_ns);
            to.printhead.push(self.printhead);
            to.channel.push(self.first_channel + k);
            to.outcome.push(Outcome::Healthy);
            to.statistic.push(Some(tests.statistic[signal]));
            to.threshold.push(Some(if beside { self.beside } else { self.threshold }));
            to.test.push(Some(if beside { Test::Misfit } else { self.along }));
            to.misfit.push(Some(misfit).filter(|misfit| !misfit.is_nan()));
            to.model.push(Some(self.model));
            to.temperature_c.push(self.temperature_c);
            to.drive_voltage_v.push(self.drive_voltage_v);
            to.fill_up();
        }
        to.weights_start.resize(to.len(), None);
    }
}

#[derive(Clone, Debug, PartialEq)]
pub enum Part {
    Healthy(HealthyRun),
    /// Indices in the columns of [`Verdicts::rows`].
    Rows(Range<usize>),
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct Verdicts {
    pub parts: Vec<Part>,
    pub tests: Tests,
    /// The rows of all signals that are in no run, and the batch's printheads.
    pub rows: VerdictColumns,
}

impl Verdicts {
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

    /// All rows in their order, the signals of a run each as a row of its own.
    pub fn spelled_out(&self) -> VerdictColumns {
        let (rows, printheads) = (&self.rows, self.rows.printheads.clone());
        let weights = rows.weights.clone();
        let mut all = VerdictColumns { printheads, weights, ..VerdictColumns::default() };
        for part in &self.parts {
            match part {
                Part::Healthy(run) => run.spell_out(&self.tests, &mut all),
                Part::Rows(range) => {
                    all.extend(rows, range.clone());
                    let start = |row: usize| rows.weights_start.get(row).copied().flatten();
                    all.weights_start.extend(range.clone().map(start));
                }
            }
        }
        all
    }

    /// Adds the rows that were pushed to `rows` since the last call to the parts.
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

/// Verdicts of rows alone, without runs; `tests` stays empty.
impl From<VerdictColumns> for Verdicts {
    fn from(rows: VerdictColumns) -> Verdicts {
        let mut verdicts = Verdicts { rows, ..Verdicts::default() };
        verdicts.close_rows();
        verdicts
    }
}
