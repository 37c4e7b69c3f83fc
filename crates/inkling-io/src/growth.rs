//! How far a recording that is still being written has come, as all its readers agree on it.
//!
//! Messages outside chunks are gathered to runs ([`super::scan`]). In a growing file a run ends early where
//! no further message is whole yet, and where that is depends on when somebody looks. Several readers go over
//! the same recording, and all must count the same blocks, so the first who meets such an end remembers it
//! for the others.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// At most so many early ends are remembered: at one look each 20 ms, those of some six hours. A reader that
/// is ahead of another one is never that far ahead.
const MOST_ENDS: usize = 1 << 20;

/// The bytes at which runs of messages ended because no further one was whole yet, in order. Whoever comes by
/// later ends the run there, too: the one who reads ahead and the one who judges count the same blocks,
/// whenever each of them looks.
#[derive(Debug, Default)]
pub struct EarlyEnds(Mutex<VecDeque<u64>>);

impl EarlyEnds {
    /// While it is locked, nobody else decides where a run ends.
    pub(super) fn lock(&self) -> MutexGuard<'_, VecDeque<u64>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Whether a run ends at byte `at`. It does if somebody ended it there before, or if what follows is not
/// whole; then it does so for everybody from now on.
pub(super) fn ends_early(ends: &mut VecDeque<u64>, at: u64, is_whole: bool) -> bool {
    match ends.binary_search(&at) {
        Ok(_) => true,
        Err(_) if is_whole => false,
        Err(place) => {
            ends.insert(place, at);
            if ends.len() > MOST_ENDS {
                ends.pop_front();
            }
            true
        }
    }
}

/// The state of a followed recording.
#[derive(Debug)]
pub struct Growth {
    /// Set by the caller: the recording is to end where it is.
    pub(super) enough: Arc<AtomicBool>,
    /// Whether the recording has ended, so that it is not looked at any more. Locked during a look.
    pub(super) over: Mutex<bool>,
    pub(super) ends: Arc<EarlyEnds>,
    /// Whether it has been opened again as a whole ([`super::recording::Recording`]'s `closed`).
    pub(super) closed: bool,
}

impl Growth {
    /// Locks and gives whether it has ended.
    pub(super) fn over(&self) -> MutexGuard<'_, bool> {
        self.over.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether the caller wants it to end.
    pub(super) fn is_enough(&self) -> bool {
        self.enough.load(Ordering::Relaxed)
    }
}
