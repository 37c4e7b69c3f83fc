//! Columns that are used again, so that a long recording allocates little: what one stage makes another
//! gives back.

use crate::design::Detection;
use crate::verdict::{Reason, Tests, VerdictColumns};
use std::sync::{Mutex, PoisonError};

/// Of one kind.
#[derive(Debug, Default)]
pub struct Spare<T>(Mutex<Vec<T>>);

impl<T: Default> Spare<T> {
    /// More are not in flight at a time but on machines with many cores.
    const KEPT: usize = 32;

    /// Of any content.
    pub fn take(&self) -> T {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default()
    }

    pub fn give(&self, of: T) {
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if kept.len() < Self::KEPT {
            kept.push(of);
        }
    }
}

/// Of all stages.
#[derive(Debug, Default)]
pub struct Spares {
    pub statistic: Spare<Vec<Result<Detection, Reason>>>,
    pub tests: Spare<Tests>,
    pub rows: Spare<VerdictColumns>,
}
