//! Puts batches back into the recording's order.

use inkling_core::burst::Place;
use std::collections::BTreeMap;

/// What waits is bounded by what is in flight ([`super::in_flight`]).
#[derive(Debug)]
pub struct InOrder<T> {
    waiting: BTreeMap<Place, T>,
    next: Place,
}

impl<T> InOrder<T> {
    pub fn new() -> InOrder<T> {
        InOrder { waiting: BTreeMap::new(), next: Place::default() }
    }

    pub fn put(&mut self, place: Place, of: T) {
        self.waiting.insert(place, of);
    }

    /// The next, if it is there. `ends`: whether its block has no further piece.
    pub fn take(&mut self, ends: impl Fn(&T) -> bool) -> Option<T> {
        let next = self.waiting.remove(&self.next)?;
        self.next = self.next.following(ends(&next));
        Some(next)
    }
}
