//! Answers the identify stage's question which model judges a burst.
//!
//! Either all models were made before the stages started, or they are learned as the bursts come. What judges
//! the bursts of a printhead's first window is known only after that window. Then the recording is read on
//! ahead until it is known, and the stages read those blocks a second time when their turn comes; so nothing
//! waits in memory.

use super::batches::ReadBatch;
use super::learning::{Judgement, Learning};
use super::read_ahead::{ReadAhead, ReadPosition};
use super::schedule::{Assignment, Schedule};
use super::{Control, PipelineError};
use inkling_core::burst::{Acquisition, Burst};
use inkling_core::design::Judge;
use inkling_core::verdict::Reason;
use inkling_io::recording::Recording;
use std::sync::Arc;

#[derive(Debug)]
pub enum Models<'a> {
    /// All models were made before the stages started.
    Made(Schedule<'a>),
    /// Models are learned while the signals flow.
    InStream(Box<InStream<'a>>),
}

/// Learns from what the stages read, and reads ahead of them where it must.
#[derive(Debug)]
pub struct InStream<'a> {
    learning: Learning<'a>,
    recording: &'a Recording,
    control: &'a Control,
    /// Up to this position everything is learned.
    position: ReadPosition,
    /// Reads on from `position`, while that lies beyond what the stages have read.
    ahead: Option<ReadAhead>,
}

impl<'a> Models<'a> {
    /// Models that are learned while the signals flow.
    pub fn learned(
        learning: Learning<'a>,
        recording: &'a Recording,
        control: &'a Control,
    ) -> Models<'a> {
        let (position, ahead) = (ReadPosition::default(), None);
        Models::InStream(Box::new(InStream { learning, recording, control, position, ahead }))
    }

    /// Takes the next batch of the recording, in its order.
    pub fn see(&mut self, read: &ReadBatch) -> Result<(), PipelineError> {
        match self {
            Models::Made(_) => Ok(()),
            Models::InStream(learner) => learner.see(read),
        }
    }

    /// The judge of a burst whose batch was seen, or the reason why it is rejected. The sampling of bursts
    /// that do not fit the design is noted, for the report.
    pub fn judge_of(&mut self, burst: &Burst) -> Result<Result<Arc<Judge>, Reason>, PipelineError> {
        let judge = self.find(burst)?;
        if let Err(Reason::DesignMismatch) = judge {
            match self {
                Models::Made(schedule) => schedule.note_sampling(burst),
                Models::InStream(learner) => learner.learning.schedule_mut().note_sampling(burst),
            }
        }
        Ok(judge)
    }

    /// Finds the judge, reading ahead for as long as windows have not decided yet.
    fn find(&mut self, burst: &Burst) -> Result<Result<Arc<Judge>, Reason>, PipelineError> {
        match self {
            Models::Made(schedule) => match schedule.assign(burst) {
                Assignment::Model(number) => Ok(Ok(schedule.judge(number)?)),
                Assignment::Reject(reason) => Ok(Err(reason)),
                Assignment::Survey => Err(PipelineError::NeedsSurvey),
            },
            Models::InStream(learner) => loop {
                match learner.learning.judgement(burst)? {
                    Judgement::By(judge) => return Ok(Ok(judge)),
                    Judgement::Reject(reason) => return Ok(Err(reason)),
                    Judgement::NotYet => learner.look_ahead()?,
                }
            },
        }
    }

    pub fn into_schedule(self) -> Schedule<'a> {
        match self {
            Models::Made(schedule) => schedule,
            Models::InStream(learner) => learner.learning.into_schedule(),
        }
    }

    /// Ends the recording: windows that were still open give models, too.
    pub fn end(&mut self) -> Result<(), PipelineError> {
        match self {
            Models::Made(_) => Ok(()),
            Models::InStream(learner) => learner.learning.end(),
        }
    }
}

impl InStream<'_> {
    fn see(&mut self, read: &ReadBatch) -> Result<(), PipelineError> {
        if read.batch.place < self.position.next {
            return Ok(()); // it was read ahead
        }
        let (next, block) = (read.batch.place.following(read.leaves.is_some()), Some(read.block));
        self.position = ReadPosition { next, block, definitions: read.definitions.clone() };
        // a reader that was ahead has been caught up with
        self.ahead = None;
        take(&mut self.learning, &read.batch.acquisitions)
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
}

/// Learns from the usable bursts of a piece, in the order of their times.
fn take(learning: &mut Learning, of: &[Acquisition]) -> Result<(), PipelineError> {
    let usable = of.iter().filter_map(|acquisition| match acquisition {
        Acquisition::Usable(burst) => Some(burst),
        Acquisition::Unusable(_) => None,
    });
    let mut bursts: Vec<&Burst> = usable.collect();
    if !bursts.is_sorted_by_key(|burst| burst.t_acq_ns) {
        bursts.sort_by_key(|burst| burst.t_acq_ns);
    }
    bursts.into_iter().try_for_each(|burst| learning.take(burst))
}
