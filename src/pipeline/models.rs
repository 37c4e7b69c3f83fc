//! Answers the identify stage's question which model judges a burst.
//!
//! Either all models were learned before the stages started, or they are as the bursts come. What judges
//! the bursts of a printhead's first window is known only after that window. Then the recording is read on
//! ahead until it is known, and the stages read those blocks a second time when their turn comes; so nothing
//! waits in memory.

use super::batches::{ReadBatch, usable};
use super::learning::Learning;
use super::read_ahead::{ReadAhead, ReadPosition};
use super::schedule::Schedule;
use super::{Control, PipelineError};
use inkling_core::burst::{Acquisition, Burst};
use inkling_core::design::Judge;
use inkling_core::verdict::Reason;
use inkling_io::recording::Recording;
use std::sync::Arc;

/// Learns from what the stages read, where windows are not learned yet, and reads ahead of them where it must.
#[derive(Debug)]
pub struct Models<'a> {
    learning: Learning<'a>,
    recording: &'a Recording,
    control: &'a Control,
    /// Up to this position everything is learned.
    position: ReadPosition,
    /// Reads on from `position`, while that lies beyond what the stages have read.
    ahead: Option<ReadAhead>,
}

impl<'a> Models<'a> {
    pub fn new(
        learning: Learning<'a>,
        recording: &'a Recording,
        control: &'a Control,
    ) -> Models<'a> {
        let (position, ahead) = (ReadPosition::default(), None);
        Models { learning, recording, control, position, ahead }
    }

    /// Takes the next batch of the recording, in its order.
    pub fn see(&mut self, read: &ReadBatch) -> Result<(), PipelineError> {
        if self.learning.over || read.batch.place < self.position.next {
            return Ok(()); // everything was learned before, or this was read ahead
        }
        let (next, block) = (read.batch.place.following(read.leaves.is_some()), Some(read.block));
        self.position = ReadPosition { next, block, definitions: read.definitions.clone() };
        // a reader that was ahead has been caught up with
        self.ahead = None;
        take(&mut self.learning, &read.batch.acquisitions)
    }

    /// The judge of a burst whose batch was seen, or the reason why it is rejected. Reads ahead for as long as
    /// windows have not decided yet.
    pub fn judge_of(&mut self, burst: &Burst) -> Result<Result<Arc<Judge>, Reason>, PipelineError> {
        loop {
            match self.learning.judge_of(burst)? {
                Some(judge) => return Ok(judge),
                None => self.look_ahead()?,
            }
        }
    }

    /// Learns from one more piece beyond what the stages read; at the end of the recording ends the learning.
    fn look_ahead(&mut self) -> Result<(), PipelineError> {
        let workers = self.learning.workers;
        let ahead = self
            .ahead
            .get_or_insert_with(|| ReadAhead::of(self.recording, &self.position, workers));
        match ahead.piece(self.recording, self.control)? {
            None => self.learning.end(),
            Some((acquisitions, position)) => {
                self.position = position;
                take(&mut self.learning, &acquisitions)
            }
        }
    }

    /// Ends the recording: windows that were still open give models, too.
    pub fn end(&mut self) -> Result<(), PipelineError> {
        self.learning.end()
    }

    pub fn into_schedule(self) -> Schedule<'a> {
        self.learning.schedule
    }
}

/// Learns from the usable bursts of a piece, in the order of their times.
fn take(learning: &mut Learning, of: &[Acquisition]) -> Result<(), PipelineError> {
    let mut bursts: Vec<&Burst> = of.iter().filter_map(usable).collect();
    if !bursts.is_sorted_by_key(|burst| burst.t_acq_ns) {
        bursts.sort_by_key(|burst| burst.t_acq_ns);
    }
    bursts.into_iter().try_for_each(|burst| learning.take(burst))
}
