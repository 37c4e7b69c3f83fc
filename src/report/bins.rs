//! Bins over time, where the time span is not known beforehand: for severities (`trend`) and for
//! maps (`map`).
//!
//! In: times in any order, ns. Out: the occupied bins in the order of time, all of one width, at
//! most a given number of them. The width is a power of two of the finest one and doubles whenever
//! there would be more bins. Empty time takes no bin, so a single wrong time costs one bin, and a
//! week without recordings none. The result depends on what was added, not on its order.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The contents of a bin; the order in which bins are merged must not matter.
pub trait Pooled: Default {
    /// Most bins, at least 8: with the greatest width the whole range of i64 takes no more, so that doubling always
    /// ends.
    const MOST_BINS: usize;
    /// Initial width of a bin, ns.
    const FINEST_NS: i64;

    /// Adds the contents of another bin.
    fn pool(&mut self, other: Self);
}

/// The occupied bins.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TimeBins<T> {
    /// Width of each bin, ns.
    pub width_ns: i64,
    /// The largest number of bins that is allowed.
    most: usize,
    /// Contents by key, the time over the width, rounded down.
    bins: BTreeMap<i64, T>,
}

impl<T: Pooled> Default for TimeBins<T> {
    /// No bins yet.
    fn default() -> TimeBins<T> {
        TimeBins { width_ns: T::FINEST_NS, most: T::MOST_BINS, bins: BTreeMap::new() }
    }
}

impl<T: Pooled> TimeBins<T> {
    /// The bin that holds a time, which is added if it is new; then others may be merged to make room.
    pub fn at(&mut self, t_ns: i64) -> &mut T {
        while self.bins.len() >= self.most && !self.bins.contains_key(&self.key(t_ns)) {
            self.coarsen();
        }
        self.bins.entry(self.key(t_ns)).or_default()
    }

    /// Lowers or raises the number of bins (8 or more); existing ones are merged until they are no more than that.
    pub fn limit(&mut self, most: usize) {
        self.most = most;
        while self.bins.len() > self.most {
            self.coarsen();
        }
    }

    /// The key of the bin that holds a time.
    fn key(&self, t_ns: i64) -> i64 {
        t_ns.div_euclid(self.width_ns)
    }

    /// Doubles the width, and merges every two bins that become one.
    fn coarsen(&mut self) {
        self.width_ns = self.width_ns.saturating_mul(2);
        let mut wider: BTreeMap<i64, T> = BTreeMap::new();
        for (key, bin) in std::mem::take(&mut self.bins) {
            wider.entry(key.div_euclid(2)).or_default().pool(bin);
        }
        self.bins = wider;
    }

    /// Adds all that is in another one, as if it had been added here. `as_here`: makes a bin's contents those that
    /// they are here.
    pub fn absorb(&mut self, other: TimeBins<T>, as_here: impl Fn(T) -> T) {
        while self.width_ns < other.width_ns {
            self.coarsen();
        }
        for (key, bin) in other.bins {
            self.at(key.saturating_mul(other.width_ns)).pool(as_here(bin));
        }
    }

    /// The bins' contents in the order of time.
    pub fn values(&self) -> impl Iterator<Item = &T> {
        self.bins.values()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Clone, Debug, Default, PartialEq)]
    struct Sum(u64);

    impl Pooled for Sum {
        const MOST_BINS: usize = 64;
        const FINEST_NS: i64 = 1_000_000;

        fn pool(&mut self, other: Sum) {
            self.0 += other.0;
        }
    }

    #[test]
    fn nothing_is_lost_whatever_the_order_and_strays_cost_a_row() {
        let mut times: Vec<i64> = (0..5000).map(|k| k * 777_777_777).collect();
        times.extend([i64::MIN, i64::MAX, 0]);
        let fill = |times: &[i64]| {
            let mut bins = TimeBins::<Sum>::default();
            times.iter().for_each(|t| bins.at(*t).0 += 1);
            bins
        };
        let there = fill(&times);
        times.reverse();
        let back = fill(&times);
        assert_eq!(there.bins, back.bins);
        // what two parts of the times give, put together, is the same
        let [mut first, second] = [&times[..700], &times[700..]].map(fill);
        first.absorb(second, |bin| bin);
        assert_eq!(there, first);
        assert_eq!(there.values().map(|s| s.0).sum::<u64>(), 5003);
        assert!((32..=64).contains(&there.bins.len()), "{}", there.bins.len());
    }
}
