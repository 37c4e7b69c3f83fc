//! What passes from stage to stage: a batch, of which each stage knows more than the one before; and pools of
//! buffers, which one stage takes and fills and a later stage gives back.
//!
//! ```text
//! reader      ReadBatch       acquisitions (usable bursts, and unusable ones with the reason)
//! identify    AssignedBatch   and for each acquisition its judge
//! FD filter   FilteredBatch   and for each signal its detection statistics
//! gate        GatedBatch      and for each signal whether it is healthy
//! isolate     JudgedBatch     rows of the table, runs of healthy signals, and what episodes need
//! ```
//!
//! The *signals of a batch* are numbered through all its acquisitions; an unusable burst counts as one.

use super::head_clock::Standing;
use super::locked;
use inkling_core::burst::{Acquisition, Burst, Place, SignalBatch};
use inkling_core::design::{Detection, Judge, OwnChannels};
use inkling_core::episodes::Rings;
use inkling_core::verdict::{Appearance, Reason, Tests, VerdictColumns, Verdicts};
use inkling_io::block::Block;
use inkling_io::block_reader::Definitions;
use inkling_io::damage::Damage;
use std::collections::HashMap;
use std::ops::Range;
use std::sync::{Arc, Mutex};

/// Maximum number of rows in a batch: enough to make the cost of a queue negligible, few enough for memory.
pub(super) const MOST_ROWS: usize = 32_768;

pub(super) fn usable(acquisition: &Acquisition) -> Option<&Burst> {
    match acquisition {
        Acquisition::Usable(burst) => Some(burst),
        Acquisition::Unusable(_) => None,
    }
}

#[derive(Debug)]
pub struct ReadBatch {
    pub batch: SignalBatch,
    pub block: Block,
    /// What the blocks up to here define, where the file's summary does not say it.
    pub definitions: Option<Definitions>,
    /// For the last batch of a block: its `held_bytes`, which leave flight when the batch is written.
    pub leaves: Option<u64>,
    pub damage: Vec<Damage>,
}

/// Where a waiting burst belongs: the number of its batch, counted from the recording's first, and its index
/// among that batch's acquisitions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Slot {
    pub batch: u64,
    pub place: usize,
    /// Whether the burst stands in the order of time.
    pub standing: Standing,
}

#[derive(Clone, Debug)]
pub struct AssignedJudge {
    /// The judge of the burst, or why nobody judges it.
    pub judge: Result<Arc<Judge>, Reason>,
    /// Its channels' own levels, and its frozen channels. `None`: all are judged about the common level.
    pub own: Option<Arc<OwnChannels>>,
    pub standing: Standing,
}

impl AssignedJudge {
    /// Of a burst in the order of time, about the common level.
    pub fn new(judge: Result<Arc<Judge>, Reason>) -> AssignedJudge {
        AssignedJudge { judge, own: None, standing: Standing::InOrder }
    }
}

pub type AssignedJudges = Vec<(Slot, AssignedJudge)>;

#[derive(Debug)]
pub struct AssignedBatch {
    pub read: ReadBatch,
    /// By acquisition.
    pub judges: Vec<AssignedJudge>,
}

impl AssignedBatch {
    /// The acquisitions, each with the indices of its signals in the batch and what judges it.
    pub fn placed(&self) -> impl Iterator<Item = (Range<usize>, &Acquisition, &AssignedJudge)> {
        let mut to = 0;
        self.read.batch.acquisitions.iter().zip(&self.judges).map(move |(acquisition, judge)| {
            let from = to;
            to += acquisition.rows();
            (from..to, acquisition, judge)
        })
    }
}

pub type Detected = Result<Detection, Reason>;

/// A batch whose signals have their detection statistics.
#[derive(Debug)]
pub struct FilteredBatch {
    pub assigned: AssignedBatch,
    pub statistic: Vec<Detected>,
}

#[derive(Debug)]
pub struct GatedBatch {
    pub filtered: FilteredBatch,
    pub tests: Tests,
}

#[derive(Debug, Default)]
pub struct JudgedBatch {
    pub place: Place,
    pub leaves: Option<u64>,
    pub damage: Vec<Damage>,
    /// One entry per signal: runs of healthy signals, and rows.
    pub verdicts: Verdicts,
    /// Judges of at least one of its bursts, each model once, by number.
    pub judges: Vec<Arc<Judge>>,
    /// The channels' own levels by which bursts were judged: (t_a in ns, the printhead's index in this batch,
    /// levels), once for neighbouring bursts of the same moment and printhead.
    pub own: Vec<(i64, u32, Arc<OwnChannels>)>,
    /// The moments that do not stand in the order of time, or begin a new stretch of it, by t_a, ns, and the
    /// printhead's index in this batch.
    pub out_of_order: HashMap<(i64, u32), Standing>,
    /// For its flagged rows, ascending, what a row of a table has no room for.
    pub flagged: Vec<FlaggedSignal>,
    pub bursts: u64,
}

impl JudgedBatch {
    /// Whether the bursts of a moment stand in the order of time. `printhead`: its index in this batch.
    pub fn standing(&self, t_ns: i64, printhead: u32) -> Standing {
        if self.out_of_order.is_empty() {
            return Standing::InOrder;
        }
        self.out_of_order.get(&(t_ns, printhead)).copied().unwrap_or_default()
    }
}

/// What isolation says of a flagged signal, for the evidence over time.
#[derive(Debug)]
pub struct FlaggedSignal {
    pub row: u32,
    /// Weight of each class; what their sum lacks to 1 is the weight of no class.
    /// Empty: isolation said nothing.
    pub weights: Vec<f32>,
    /// `None`: it does not ring.
    pub rings: Option<Rings>,
    pub appearance: Option<Appearance>,
}

#[derive(Debug, Default)]
pub struct BufferPool<T>(Mutex<Vec<T>>);

impl<T: Default> BufferPool<T> {
    /// Maximum number of buffers kept; only machines with many cores have more in flight at a time.
    const KEPT: usize = 32;

    /// Takes a used buffer, which may have any content, or a new one.
    pub fn take(&self) -> T {
        locked(&self.0).pop().unwrap_or_default()
    }

    pub fn give(&self, buffer: T) {
        let mut kept = locked(&self.0);
        if kept.len() < Self::KEPT {
            kept.push(buffer);
        }
    }
}

#[derive(Debug, Default)]
pub struct BufferPools {
    pub statistic: BufferPool<Vec<Detected>>,
    pub tests: BufferPool<Tests>,
    pub rows: BufferPool<VerdictColumns>,
}
