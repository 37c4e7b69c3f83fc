//! Bounds what is in flight between reader and writer, in blocks and bytes.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

#[derive(Debug, Default)]
struct State {
    blocks: usize,
    bytes: u64,
    closed: bool,
}

/// The reader enters blocks in file order, and waits while there is no room; the writer takes them out. The
/// oldest block is always in flight, so its turn always comes: there is no deadlock.
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
        let mut state = self.lock();
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

    /// Takes a block out, because it is written, or while it waits for later ones, so that these can be read.
    pub fn leave(&self, bytes: u64) {
        let mut state = self.lock();
        state.blocks -= 1;
        state.bytes -= bytes;
        self.changed.notify_all();
    }

    /// Counts a block again that has waited for later ones, without waiting for room.
    pub fn take_back(&self, bytes: u64) {
        let mut state = self.lock();
        state.blocks += 1;
        state.bytes += bytes;
    }

    /// Ends all waiting for room: no block will be taken out any more.
    pub fn close(&self) {
        self.lock().closed = true;
        self.changed.notify_all();
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
