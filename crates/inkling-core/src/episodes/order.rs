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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn earliest_leaves_first_and_signals_are_counted() {
        let mut waiting = WaitingBursts::default();
        for (t_ns, rows) in [(5, 2), (1, 3), (5, 1), (3, 4)] {
            waiting.push(Looks { t_ns, ratios: vec![0.0; rows], ..Looks::default() });
        }
        assert_eq!(waiting.signals, 10);
        let left: Vec<(i64, usize)> =
            std::iter::from_fn(|| waiting.pop()).map(|l| (l.t_ns, l.ratios.len())).collect();
        assert_eq!(left, [(1, 3), (3, 4), (5, 2), (5, 1)]);
        assert_eq!(waiting.signals, 0);
    }
}
