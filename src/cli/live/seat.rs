//! Room for so many and no more.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// One of those that there is room for; gives its place back.
pub struct Seat(Arc<AtomicUsize>);

impl Seat {
    pub fn take(taken: &Arc<AtomicUsize>, most: usize) -> Option<Seat> {
        let seat = Seat(taken.clone());
        // dropped, it is given back
        (taken.fetch_add(1, Ordering::Relaxed) < most).then_some(seat)
    }
}

impl Drop for Seat {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::Relaxed);
    }
}
