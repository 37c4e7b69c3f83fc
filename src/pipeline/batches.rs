//! What passes from stage to stage: one batch, with more known of it after each.

use crate::burst::{Place, SignalBatch};
use crate::design::{Detection, Judge, OwnChannels};
use crate::io::block::Block;
use crate::io::block_reader::Definitions;
use crate::io::damage::Damage;
use crate::verdict::{Appearance, Reason, Tests, Verdicts};
use std::sync::Arc;

/// Rows of a batch: enough to make a channel's cost vanish, few enough to bound memory.
pub(super) const MOST_ROWS: usize = 32_768;

/// A block's batch on its way, with what it takes up in flight and what was lost in it.
#[derive(Debug)]
pub struct Read {
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

/// Who judges a burst, and about what.
#[derive(Clone, Debug)]
pub struct Given {
    pub judge: Result<Arc<Judge>, Reason>,
    pub own: Option<Arc<OwnChannels>>,
}

impl Given {
    pub fn by(judge: Result<Arc<Judge>, Reason>) -> Given {
        Given { judge, own: None }
    }
}

/// Bursts of a sweep that is over.
pub type GivenTo = Vec<(Slot, Given)>;

/// With the judge of every acquisition.
#[derive(Debug)]
pub struct Assigned {
    pub read: Read,
    pub judges: Vec<Result<Arc<Judge>, Reason>>,
    /// What their channels are judged about; `None`: about what all of the printhead's are.
    pub own: Vec<Option<Arc<OwnChannels>>>,
}

/// With every signal's statistics, or why it has none.
#[derive(Debug)]
pub struct Filtered {
    pub assigned: Assigned,
    pub statistic: Vec<Result<Detection, Reason>>,
}

/// With every signal's test, and whether it is healthy.
#[derive(Debug)]
pub struct Gated {
    pub filtered: Filtered,
    pub tests: Tests,
}

/// Rows, ready to be written.
#[derive(Debug)]
pub struct Judged {
    pub place: Place,
    pub leaves: Option<u64>,
    pub damage: Vec<Damage>,
    pub verdicts: Verdicts,
    /// Who judged some of it.
    pub judges: Vec<Arc<Judge>>,
    /// About which levels of channels the bursts of a moment and printhead (its place among the batch's) were judged.
    pub own: Vec<(i64, u32, Arc<OwnChannels>)>,
    /// Of its flagged rows, ascending: what one row of a table has no room for.
    pub flagged: Vec<Flagged>,
    pub bursts: u64,
}

/// What isolation says of a flagged signal, for the evidence over time.
#[derive(Debug)]
pub struct Flagged {
    /// Among the verdicts' rows.
    pub row: u32,
    /// Per class; what they lack to 1 is the weight of no class. Empty: nothing was said.
    pub weights: Vec<f32>,
    /// [`crate::design::Workspace::ring`]
    pub ring: Option<[f64; 2]>,
    /// Of what belongs to no class, or may well belong to none.
    pub appearance: Option<Appearance>,
}
