//! The state of a recording that is still being written, shared by all its readers (`followed.rs`).
//!
//! Its main job is to make all readers count the same blocks. Messages outside chunks are gathered
//! to runs ([`super::scan`]), and each run is a block. In a growing file a run ends early where the
//! next message is not whole yet, and where that is depends on when somebody looks. One reader
//! reads ahead and another one judges, so the first who meets such an end remembers it here
//! ([`EarlyEnds`]), and the others end their run at the same byte.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// At most so many early ends are remembered: at one look each 20 ms, those of some six hours.
const MOST_ENDS: usize = 1 << 20;

/// The bytes (offsets in the file, ascending) at which runs of messages ended early.
pub type EarlyEnds = Mutex<VecDeque<u64>>;

/// Locks, also after a thread panicked while it held the lock: what is locked here is always whole.
pub(super) fn locked<T>(of: &Mutex<T>) -> MutexGuard<'_, T> {
    of.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Whether a run ends at byte `at`: because somebody ended it there before, or because what follows
/// is not whole (`is_whole` is false). In the second case the end is remembered for all readers.
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

#[derive(Debug)]
pub struct Growth {
    /// Set by the caller: the recording is to end where it is.
    pub(super) enough: Arc<AtomicBool>,
    /// Whether the recording has ended, so that the file is not looked at any more.
    pub(super) over: Mutex<bool>,
    pub(super) ends: Arc<EarlyEnds>,
    /// Whether this is the recording opened again as a whole.
    pub(super) closed: bool,
}

impl Growth {
    pub(super) fn is_enough(&self) -> bool {
        self.enough.load(Ordering::Relaxed)
    }
}
