//! A limit on how many clients are served at once.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// One of a limited number of seats, which is given back when it is dropped.
pub struct Seat(Arc<AtomicUsize>);

impl Seat {
    /// Takes a seat; `None` if `most` are taken.
    pub fn take(taken: &Arc<AtomicUsize>, most: usize) -> Option<Seat> {
        let seat = Seat(taken.clone());
        // if there was no room, the seat is dropped here, which takes its count back
        (taken.fetch_add(1, Ordering::Relaxed) < most).then_some(seat)
    }
}

impl Drop for Seat {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::Relaxed);
    }
}
