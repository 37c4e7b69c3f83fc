//! Puts batches, which several workers finish in any order, back into the recording's order.

use inkling_core::burst::Place;
use std::collections::BTreeMap;

/// Batches that arrived before their turn. Their number is bounded by what is in flight
/// ([`super::in_flight`]).
#[derive(Debug)]
pub struct InOrder<T> {
    waiting: BTreeMap<Place, T>,
    /// The place whose turn it is.
    next: Place,
}

impl<T> InOrder<T> {
    pub fn new() -> InOrder<T> {
        InOrder { waiting: BTreeMap::new(), next: Place::default() }
    }

    /// Adds a batch that belongs at `place`.
    pub fn put(&mut self, place: Place, of: T) {
        self.waiting.insert(place, of);
    }

    /// Takes the batch whose turn it is, if it has arrived. `ends`: whether it
    /// is the last piece of its block.
    pub fn take(&mut self, ends: impl Fn(&T) -> bool) -> Option<T> {
        let next = self.waiting.remove(&self.next)?;
        self.next = self.next.following(ends(&next));
        Some(next)
    }
}
