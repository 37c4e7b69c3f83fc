//! How far a recording that is still being written has come.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

#[derive(Debug)]
pub struct Growth {
    pub(super) enough: Arc<AtomicBool>,
    /// It does not grow any more, for us. Locked while it may.
    pub(super) over: Mutex<bool>,
    /// It is taken as a whole.
    pub(super) closed: bool,
}

impl Growth {
    pub(super) fn over(&self) -> std::sync::MutexGuard<'_, bool> {
        self.over.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn is_enough(&self) -> bool {
        self.enough.load(Ordering::Relaxed)
    }
}
