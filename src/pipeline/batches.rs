//! What passes from stage to stage: one batch, with more known of it after each.

use inkling_core::burst::{Place, SignalBatch};
use inkling_core::design::{Detection, Judge, OwnChannels};
use inkling_core::verdict::{Appearance, Reason, Tests, Verdicts};
use inkling_io::block::Block;
use inkling_io::block_reader::Definitions;
use inkling_io::damage::Damage;
use std::sync::Arc;

/// Rows of a batch: enough to make a channel's cost vanish, few enough to bound memory.
pub(super) const MOST_ROWS: usize = 32_768;

/// A batch as it was read from a block, with what it takes up in flight and what was lost in it.
#[derive(Debug)]
pub struct ReadBatch {
    pub batch: SignalBatch,
    pub block: Block,
    /// What the blocks up to here define, where the summary does not say it.
    pub definitions: Option<Definitions>,
    /// The last batch of a block: these bytes leave the house with it.
    pub leaves: Option<u64>,
    pub damage: Vec<Damage>,
}

/// A burst that waits: its batch, counted from the recording's first, and its place there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Slot {
    pub batch: u64,
    pub place: usize,
}

/// The judge of a burst, and its channels' own baselines, about which they are judged.
#[derive(Clone, Debug)]
pub struct AssignedJudge {
    pub judge: Result<Arc<Judge>, Reason>,
    pub own: Option<Arc<OwnChannels>>,
}

impl AssignedJudge {
    pub fn by(judge: Result<Arc<Judge>, Reason>) -> AssignedJudge {
        AssignedJudge { judge, own: None }
    }
}

/// The bursts of a sweep that is over, each with its judge.
pub type AssignedJudges = Vec<(Slot, AssignedJudge)>;

/// A batch for whose acquisitions the identify stage has found judges.
#[derive(Debug)]
pub struct AssignedBatch {
    pub read: ReadBatch,
    pub judges: Vec<Result<Arc<Judge>, Reason>>,
    /// By acquisition, the channels' own baselines; `None`: they are judged about what all of the printhead's are.
    pub own: Vec<Option<Arc<OwnChannels>>>,
}

/// A batch whose signals have their detection statistics, or reasons why they have none.
#[derive(Debug)]
pub struct FilteredBatch {
    pub assigned: AssignedBatch,
    pub statistic: Vec<Result<Detection, Reason>>,
}

/// A batch that went through the gate: every signal is tested, and found healthy or not.
#[derive(Debug)]
pub struct GatedBatch {
    pub filtered: FilteredBatch,
    pub tests: Tests,
}

/// The verdicts of a batch, ready to be written.
#[derive(Debug)]
pub struct JudgedBatch {
    pub place: Place,
    pub leaves: Option<u64>,
    pub damage: Vec<Damage>,
    pub verdicts: Verdicts,
    /// Who judged some of it.
    pub judges: Vec<Arc<Judge>>,
    /// About which levels of channels the bursts of a moment and printhead (its place among the batch's) were judged.
    pub own: Vec<(i64, u32, Arc<OwnChannels>)>,
    /// Of its flagged rows, ascending: what one row of a table has no room for.
    pub flagged: Vec<FlaggedSignal>,
    pub bursts: u64,
}

/// What isolation says of a flagged signal, for the evidence over time.
#[derive(Debug)]
pub struct FlaggedSignal {
    /// Among the verdicts' rows.
    pub row: u32,
    /// Per class; what they lack to 1 is the weight of no class. Empty: nothing was said.
    pub weights: Vec<f32>,
    /// [`inkling_core::design::Workspace::ring`]
    pub ring: Option<[f64; 2]>,
    /// Of what belongs to no class, or may well belong to none.
    pub appearance: Option<Appearance>,
}
