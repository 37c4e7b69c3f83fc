//! Batches that wait until it is known who judges their bursts, in the recording's order.

use super::batches::{Assigned, Given, GivenTo, Read};
use super::in_flight::InFlight;
use std::collections::VecDeque;

#[derive(Debug)]
struct Waiting {
    read: Read,
    given: Vec<Option<Given>>,
    missing: usize,
}

/// What waits takes no room in flight: the reader must be able to read on until a sweep is over.
#[derive(Debug)]
pub(super) struct Parked<'a> {
    in_flight: &'a InFlight,
    first: u64,
    waiting: VecDeque<Waiting>,
}

impl<'a> Parked<'a> {
    pub fn new(in_flight: &'a InFlight) -> Parked<'a> {
        Parked { in_flight, first: 0, waiting: VecDeque::new() }
    }

    /// The number of the next batch.
    pub fn next(&self) -> u64 {
        self.first + self.waiting.len() as u64
    }

    pub fn park(&mut self, read: Read) {
        let bursts = read.batch.acquisitions.len();
        if let Some(bytes) = read.leaves {
            self.in_flight.lend(bytes);
        }
        self.waiting.push_back(Waiting { read, given: vec![None; bursts], missing: bursts });
    }

    pub fn give(&mut self, given: &mut GivenTo) {
        for (slot, given) in given.drain(..) {
            let Some(of) = self.waiting.get_mut((slot.batch - self.first) as usize) else {
                continue;
            };
            if of.given[slot.place].replace(given).is_none() {
                of.missing -= 1;
            }
        }
    }

    /// The next batch of which all is known.
    pub fn leave(&mut self) -> Option<Assigned> {
        self.waiting.front().filter(|of| of.missing == 0)?;
        let Waiting { read, given, .. } = self.waiting.pop_front()?;
        self.first += 1;
        if let Some(bytes) = read.leaves {
            self.in_flight.take_back(bytes);
        }
        let (judges, own) = given.into_iter().flatten().map(|of| (of.judge, of.own)).unzip();
        Some(Assigned { read, judges, own })
    }
}
