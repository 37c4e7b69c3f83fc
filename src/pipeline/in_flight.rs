//! Batches on their way through the stages. [`InFlight`] bounds what is between reader and writer, in blocks
//! and in the bytes of memory that they take (`Block::held_bytes`). [`InOrder`] puts batches back into the
//! recording's order. `ParkedBatches` keeps batches in the identify stage until it is known what judges their
//! bursts.

use super::batches::{AssignedBatch, AssignedJudge, AssignedJudges, ReadBatch};
use super::locked;
use inkling_core::burst::Place;
use std::collections::{BTreeMap, VecDeque};
use std::sync::{Condvar, Mutex, PoisonError};

#[derive(Debug, Default)]
struct State {
    blocks: usize,
    bytes: u64,
    closed: bool,
}

/// Bounds the blocks between reader and writer. The workers of the reader stage, one at a time, enter
/// blocks in file order, and wait while there is no room; the writer takes them out in the same order. The
/// oldest block that is not parked has entered already, so its turn comes. Blocks whose batches are parked do
/// not count: what they wait for may stand in later blocks.
#[derive(Debug)]
pub struct InFlight {
    most_blocks: usize,
    most_bytes: u64,
    state: Mutex<State>,
    changed: Condvar,
}

impl InFlight {
    pub fn new(most_blocks: usize, most_bytes: u64) -> InFlight {
        InFlight { most_blocks, most_bytes, state: Mutex::default(), changed: Condvar::new() }
    }

    /// Waits until there is room for a block, and enters it. False once closed: the caller should end.
    pub fn enter(&self, bytes: u64) -> bool {
        let mut state = locked(&self.state);
        loop {
            if state.closed {
                return false;
            }
            // a block larger than the bound goes alone
            let room = state.blocks < self.most_blocks
                && (state.blocks == 0 || state.bytes.saturating_add(bytes) <= self.most_bytes);
            if room {
                state.blocks += 1;
                state.bytes += bytes;
                return true;
            }
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }

    pub fn leave(&self, bytes: u64) {
        let mut state = locked(&self.state);
        state.blocks -= 1;
        state.bytes -= bytes;
        self.changed.notify_all();
    }

    /// Counts a block again that has waited for later ones; so the bounds may be exceeded for a while.
    pub fn take_back(&self, bytes: u64) {
        let mut state = locked(&self.state);
        state.blocks += 1;
        state.bytes += bytes;
    }

    pub fn close(&self) {
        locked(&self.state).closed = true;
        self.changed.notify_all();
    }
}

/// Batches that arrived before their turn; what is in flight bounds their number.
#[derive(Debug)]
pub struct InOrder<T> {
    waiting: BTreeMap<Place, T>,
    next: Place,
}

impl<T> InOrder<T> {
    pub fn new() -> InOrder<T> {
        InOrder { waiting: BTreeMap::new(), next: Place::default() }
    }

    pub fn put(&mut self, place: Place, of: T) {
        self.waiting.insert(place, of);
    }

    /// Takes the batch whose turn it is, if it has arrived. `ends`: whether it is its block's last piece.
    pub fn take(&mut self, ends: impl Fn(&T) -> bool) -> Option<T> {
        let next = self.waiting.remove(&self.next)?;
        self.next = self.next.following(ends(&next));
        Some(next)
    }
}

#[derive(Debug)]
struct ParkedBatch {
    read: ReadBatch,
    given: Vec<Option<AssignedJudge>>,
}

/// The batches that wait in the identify stage, in the recording's order. They do not count as in flight: the
/// reader must be able to read on until a sweep is over. How much may wait is bounded by `sweep`.
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
        let given = vec![None; read.batch.acquisitions.len()];
        if let Some(bytes) = read.leaves {
            self.in_flight.leave(bytes); // for as long as it waits
        }
        self.waiting.push_back(ParkedBatch { read, given });
    }

    /// Drains `given`. Hands out the batches of which it is now known what judges all their bursts.
    pub fn give(&mut self, given: &mut AssignedJudges) -> impl Iterator<Item = AssignedBatch> {
        for (slot, given) in given.drain(..) {
            let given = AssignedJudge { standing: slot.standing, ..given };
            // the batch still waits, since it needed this burst's judge
            self.waiting[(slot.batch - self.first) as usize].given[slot.place] = Some(given);
        }
        std::iter::from_fn(|| self.leave())
    }

    /// Takes the first waiting batch, if it is known what judges all its bursts.
    fn leave(&mut self) -> Option<AssignedBatch> {
        self.waiting.front().filter(|of| of.given.iter().all(Option::is_some))?;
        let ParkedBatch { read, given } = self.waiting.pop_front()?;
        self.first += 1;
        if let Some(bytes) = read.leaves {
            self.in_flight.take_back(bytes);
        }
        Some(AssignedBatch { read, judges: given.into_iter().flatten().collect() })
    }
}
