//! Pools of buffers, so that a long recording allocates little: one stage takes a buffer and fills it, a later stage
//! gives it back.

use inkling_core::design::Detection;
use inkling_core::verdict::{Reason, Tests, VerdictColumns};
use std::sync::{Mutex, PoisonError};

/// Buffers of one kind that nobody uses at the moment.
#[derive(Debug, Default)]
pub struct BufferPool<T>(Mutex<Vec<T>>);

impl<T: Default> BufferPool<T> {
    /// Only machines with many cores have more in flight at a time.
    const KEPT: usize = 32;

    /// A buffer with any content: a used one, or else a new one.
    pub fn take(&self) -> T {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default()
    }

    /// Keeps a buffer for the next one who takes; beyond the most that are kept it is freed.
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
