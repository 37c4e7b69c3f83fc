//! Verdict tables read as any user's tool would: by the contract's columns.

use crate::recorded::{batches, cells, texts};
use arrow_array::RecordBatch;
use arrow_array::types::{Float32Type, TimestampNanosecondType, UInt32Type};
use clap::ValueEnum;
use std::path::Path;

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
#[value(rename_all = "snake_case")]
pub enum Outcome {
    Healthy,
    Faulty,
    Undecided,
    Rejected,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
#[value(rename_all = "snake_case")]
pub enum Reason {
    Uncertain,
    UnknownFault,
    NoRing,
    /// Of a rejected signal.
    Rejected,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
#[value(rename_all = "snake_case")]
pub enum Test {
    Ring,
    Misfit,
    Energy,
}

#[derive(Clone, Debug)]
pub struct Verdict {
    pub t_ns: i64,
    pub printhead: String,
    pub channel: u32,
    pub outcome: Outcome,
    pub category: Option<String>,
    pub fault: Option<String>,
    pub candidate: Option<String>,
    pub certainty: f32,
    pub reason: Option<Reason>,
    /// Where the table has it.
    pub test: Option<Test>,
    pub misfit: Option<f32>,
}

/// What a name must be worth to count as one.
pub const CERTAIN: f32 = 0.8;

impl Verdict {
    pub fn is_flagged(&self) -> bool {
        matches!(self.outcome, Outcome::Faulty | Outcome::Undecided)
    }

    pub fn certain_class(&self) -> Option<&str> {
        self.fault.as_deref().filter(|_| self.certainty >= CERTAIN)
    }

    /// A category that is certain where the class is not.
    pub fn certain_category(&self) -> Option<&str> {
        self.category.as_deref().filter(|_| self.fault.is_none() && self.certainty >= CERTAIN)
    }

    pub fn is_foreign(&self) -> bool {
        matches!(self.reason, Some(Reason::UnknownFault | Reason::NoRing))
    }
}

/// One row of an episode table.
#[derive(Clone, Debug)]
pub struct Episode {
    pub channel: u32,
    pub category: Option<String>,
    pub fault: Option<String>,
    pub explanation: String,
}

pub fn read_episodes(path: &Path) -> Vec<Episode> {
    batches(path).iter().flat_map(episodes_of_batch).collect()
}

fn episodes_of_batch(batch: &RecordBatch) -> Vec<Episode> {
    let (category, fault) = (texts(batch, "category"), texts(batch, "fault"));
    let explanation = texts(batch, "explanation");
    let channel = cells::<UInt32Type>(batch, "channel");
    (0..batch.num_rows())
        .map(|i| Episode {
            channel: channel[i].expect("the contract's column"),
            category: category[i].clone(),
            fault: fault[i].clone(),
            explanation: explanation[i].clone().unwrap_or_default(),
        })
        .collect()
}

/// In the recording's order.
pub fn read(path: &Path) -> Vec<Verdict> {
    batches(path).iter().flat_map(of_batch).collect()
}

/// What one of the contract's words says.
fn word<W: ValueEnum>(of: &str) -> Result<W, String> {
    W::from_str(of, false)
}

fn of_batch(batch: &RecordBatch) -> Vec<Verdict> {
    const REQUIRED: &str = "the contract's column";
    let texts = |name: &str| texts(batch, name);
    let numbers = |name: &str| cells::<Float32Type>(batch, name);
    let (outcome, category, fault) = (texts("outcome"), texts("category"), texts("fault"));
    let (candidate, reason, test) = (texts("candidate"), texts("reason"), texts("test"));
    let (certainty, misfit) = (numbers("certainty"), numbers("misfit"));
    let t_ns = cells::<TimestampNanosecondType>(batch, "acquired_at");
    let (channel, printhead) = (cells::<UInt32Type>(batch, "channel"), texts("printhead"));
    (0..batch.num_rows())
        .map(|i| Verdict {
            t_ns: t_ns[i].expect(REQUIRED),
            printhead: printhead[i].clone().expect(REQUIRED),
            channel: channel[i].expect(REQUIRED),
            outcome: word(outcome[i].as_deref().expect(REQUIRED)).expect("an outcome"),
            category: category[i].clone(),
            fault: fault[i].clone(),
            candidate: candidate[i].clone(),
            certainty: certainty[i].unwrap_or(0.0),
            reason: reason[i].as_deref().map(|of| word(of).unwrap_or(Reason::Rejected)),
            test: test[i].as_deref().map(|of| word(of).expect("a test")),
            misfit: misfit[i],
        })
        .collect()
}
