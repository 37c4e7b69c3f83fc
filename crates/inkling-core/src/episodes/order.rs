//! Puts the bursts of a printhead in time order over a bounded window: a priority queue by time.
//!
//! In: bursts as the recording has them. Out: the earliest of those that wait, whenever the caller,
//! who bounds how many signals wait, asks.

use super::Looks;
use std::collections::BTreeMap;

#[derive(Debug, Default)]
pub struct WaitingBursts {
    /// The bursts by time of acquisition, first channel and order of arrival.
    bursts: BTreeMap<(i64, u32, u64), Looks>,
    arrived: u64,
    pub signals: usize,
}

impl WaitingBursts {
    pub fn push(&mut self, looks: Looks) {
        self.signals += looks.ratios.len();
        self.arrived += 1;
        self.bursts.insert((looks.t_ns, looks.first_channel, self.arrived), looks);
    }

    pub fn pop(&mut self) -> Option<Looks> {
        let (_, looks) = self.bursts.pop_first()?;
        self.signals -= looks.ratios.len();
        Some(looks)
    }
}
