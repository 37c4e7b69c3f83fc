//! Keeps batches until it is known what judges their bursts, in the recording's order.

use super::batches::{AssignedBatch, AssignedJudge, AssignedJudges, ReadBatch};
use super::in_flight::InFlight;
use std::collections::VecDeque;

/// A batch of which some bursts still wait for their judges.
#[derive(Debug)]
struct ParkedBatch {
    read: ReadBatch,
    /// By burst, what judges it; `None`: not known yet.
    given: Vec<Option<AssignedJudge>>,
    /// Number of bursts of which that is not known yet.
    missing: usize,
}

/// The batches that wait. They do not count as in flight: the reader must be able to
/// read on until a sweep is over.
#[derive(Debug)]
pub(super) struct ParkedBatches<'a> {
    in_flight: &'a InFlight,
    /// Number of the first waiting batch, counted from the recording's first.
    first: u64,
    waiting: VecDeque<ParkedBatch>,
}

impl<'a> ParkedBatches<'a> {
    pub fn new(in_flight: &'a InFlight) -> ParkedBatches<'a> {
        ParkedBatches { in_flight, first: 0, waiting: VecDeque::new() }
    }

    /// The number that the next parked batch will get.
    pub fn next(&self) -> u64 {
        self.first + self.waiting.len() as u64
    }

    /// Lets a batch wait for its judges.
    pub fn park(&mut self, read: ReadBatch) {
        let bursts = read.batch.acquisitions.len();
        if let Some(bytes) = read.leaves {
            self.in_flight.leave(bytes); // for as long as it waits
        }
        self.waiting.push_back(ParkedBatch { read, given: vec![None; bursts], missing: bursts });
    }

    /// Takes in what judges bursts that wait; drains `given`. Hands out the batches of which it is now known
    /// what judges all their bursts.
    pub fn give(&mut self, given: &mut AssignedJudges) -> impl Iterator<Item = AssignedBatch> {
        for (slot, given) in given.drain(..) {
            let Some(of) = self.waiting.get_mut((slot.batch - self.first) as usize) else {
                continue;
            };
            if of.given[slot.place].replace(given).is_none() {
                of.missing -= 1;
            }
        }
        std::iter::from_fn(|| self.leave())
    }

    /// Takes the first waiting batch, if it is known what judges all its bursts.
    fn leave(&mut self) -> Option<AssignedBatch> {
        self.waiting.front().filter(|of| of.missing == 0)?;
        let ParkedBatch { read, given, .. } = self.waiting.pop_front()?;
        self.first += 1;
        if let Some(bytes) = read.leaves {
            self.in_flight.take_back(bytes);
        }
        Some(AssignedBatch { read, judges: given.into_iter().flatten().collect() })
    }
}
