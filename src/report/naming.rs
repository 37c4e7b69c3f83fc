//! Until when the signals of a channel carry the name of its fault. What is told of a fault is of now: a name
//! and a size that signals carried weeks ago are told as last known then.
//!
//! In: from `watch`, each flagged signal of an episode, named by the category in question or not. Out: to
//! `story`, when the last named one was, and whether those after it still go with the name ([`Calls::last`]).
//!
//! Signals of a named fault may be without a name now and then, a share 1 - p of them. If n signals in a row
//! come without the name, either they still carry it by that share, which happens with (1 - p)^n, or they carry
//! it no longer. Below 1 in 20 the name is of the past.

use super::bins::{Pooled, TimeBins};
use serde::{Deserialize, Serialize};

/// ln of the likelihood ratio beyond which signals carry the name no longer: 20 to 1, as for a cure.
const GONE: f64 = 3.0;
/// Largest share of named signals: a single one without a name never takes it away.
const MOST_NAMED: f64 = 0.9;

/// Flagged signals of some time.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Called {
    named: u64,
    others: u64,
    /// t_a of the first one, ns; `None`: there is none.
    first_ns: Option<i64>,
    /// t_a of the last named one, ns; `None`: there is none.
    last_named_ns: Option<i64>,
}

impl Pooled for Called {
    /// Most bins that a channel's signals are pooled in.
    const MOST_BINS: usize = 96;
    const FINEST_NS: i64 = 1_000_000;

    fn pool(&mut self, other: Called) {
        self.named += other.named;
        self.others += other.others;
        self.first_ns = self.first_ns.into_iter().chain(other.first_ns).min();
        self.last_named_ns = self.last_named_ns.max(other.last_named_ns);
    }
}

/// The flagged signals of a channel over time.
pub type Calls = TimeBins<Called>;

/// The last signal that carried a name.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LastNamed {
    pub at_ns: i64,
    /// Whether the signals after it go with the name, which some of them lack by chance.
    pub is_of_now: bool,
}

impl Calls {
    /// Adds a flagged signal.
    pub fn add(&mut self, t_ns: i64, is_named: bool) {
        self.at(t_ns).pool(Called {
            named: u64::from(is_named),
            others: u64::from(!is_named),
            first_ns: Some(t_ns),
            last_named_ns: is_named.then_some(t_ns),
        });
    }

    /// The last named signal of a fault that was on from `from_ns` to `to_ns`; `None`: no signal carries the name
    /// by itself.
    pub fn last(&self, from_ns: i64, to_ns: i64) -> Option<LastNamed> {
        let is_within =
            |bin: &&Called| bin.first_ns.is_some_and(|t| (from_ns..=to_ns).contains(&t));
        let bins: Vec<&Called> = self.values().filter(is_within).collect();
        let last = bins.iter().rposition(|bin| bin.named > 0)?;
        let (until, after) = bins.split_at(last + 1);
        let named: u64 = until.iter().map(|bin| bin.named).sum();
        let others: u64 = until.iter().map(|bin| bin.others).sum();
        let share = (named as f64 / (named + others) as f64).min(MOST_NAMED);
        let missing: u64 = after.iter().map(|bin| bin.others).sum();
        let gone = -(missing as f64) * (1.0 - share).ln();
        let at_ns = bins[last].last_named_ns?.min(to_ns);
        Some(LastNamed { at_ns, is_of_now: gone <= GONE })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Nights of 50 signals, of which `share` of the first ten nights' are named, and none of the later ones'.
    fn nights(share: usize, without: i64) -> Option<LastNamed> {
        let mut calls = Calls::default();
        for night in 0..10 + without {
            for k in 0..50 {
                let is_named = night < 10 && k % 10 < share as i64;
                calls.add(night * 86_400_000_000_000 + k * 1_000_000_000, is_named);
            }
        }
        calls.last(i64::MIN, i64::MAX)
    }

    #[test]
    fn a_name_is_of_now_until_too_many_signals_in_a_row_lack_it() {
        for share in [1, 5, 10] {
            assert!(nights(share, 0).is_some_and(|of| of.is_of_now));
            let gone = nights(share, 1).expect("some are named");
            assert!(!gone.is_of_now && gone.at_ns < 9 * 86_400_000_000_000 + 50_000_000_000);
        }
        assert_eq!(nights(0, 4), None);
    }

    #[test]
    fn a_few_signals_without_a_name_take_nothing_back() {
        let mut calls = Calls::default();
        (0..100).for_each(|t| calls.add(t * 1_000_000_000, t % 4 == 0));
        (100..104).for_each(|t| calls.add(t * 1_000_000_000, false));
        let last = |calls: &Calls| calls.last(i64::MIN, i64::MAX);
        assert!(last(&calls).is_some_and(|of| of.is_of_now), "three in four lack it as a rule");
        (104..120).for_each(|t| calls.add(t * 1_000_000_000, false));
        assert!(last(&calls).is_some_and(|of| !of.is_of_now));
        // a later fault of the same name says nothing of one that ended before
        calls.add(900_000_000_000, true);
        let ended = calls.last(0, 50_000_000_000).map(|of| of.at_ns);
        assert_eq!(ended, Some(48_000_000_000));
    }
}
