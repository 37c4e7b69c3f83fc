//! How far a recording that is still being written has come.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Runs that ended early are remembered so many times: at a look each 20 ms, for some six hours. Who reads ahead is not
/// further ahead than the first windows are long.
const MOST_ENDS: usize = 1 << 20;

/// Where runs of messages ended because no further one was whole yet, bytes. Whoever comes by later ends them there, too:
/// who reads ahead and who judges count the same blocks, whenever each of them looks.
#[derive(Debug, Default)]
pub struct EarlyEnds(Mutex<VecDeque<u64>>);

impl EarlyEnds {
    /// Nobody else looks at the end of the file meanwhile.
    pub(super) fn lock(&self) -> MutexGuard<'_, VecDeque<u64>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Whether a run ends at a byte; if it does now, it does for all.
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
    pub(super) enough: Arc<AtomicBool>,
    /// It does not grow any more, for us. Locked while it may.
    pub(super) over: Mutex<bool>,
    pub(super) ends: Arc<EarlyEnds>,
    /// It is taken as a whole.
    pub(super) closed: bool,
}

impl Growth {
    pub(super) fn over(&self) -> MutexGuard<'_, bool> {
        self.over.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn is_enough(&self) -> bool {
        self.enough.load(Ordering::Relaxed)
    }
}
