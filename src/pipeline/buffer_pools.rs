//! Pools of buffers, so that a long recording allocates little: one stage takes a buffer and fills it, and a
//! later stage gives it back.

use inkling_core::design::Detection;
use inkling_core::verdict::{Reason, Tests, VerdictColumns};
use std::sync::{Mutex, PoisonError};

/// Buffers of one kind that no stage uses at the moment.
#[derive(Debug, Default)]
pub struct BufferPool<T>(Mutex<Vec<T>>);

impl<T: Default> BufferPool<T> {
    /// Maximum number of buffers kept; only machines with many cores have more in flight at a time.
    const KEPT: usize = 32;

    /// Takes a used buffer, which may have any content, or a new one.
    pub fn take(&self) -> T {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default()
    }

    /// Gives a buffer back for the next taker; it is freed if enough are kept already.
    pub fn give(&self, buffer: T) {
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if kept.len() < Self::KEPT {
            kept.push(buffer);
        }
    }
}

/// The pools that all stages share.
#[derive(Debug, Default)]
pub struct BufferPools {
    pub statistic: BufferPool<Vec<Result<Detection, Reason>>>,
    pub tests: BufferPool<Tests>,
    pub rows: BufferPool<VerdictColumns>,
}
