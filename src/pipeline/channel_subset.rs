//! Sets of channel numbers, and the choice of the channels of a printhead that stand for all of them, where
//! it has many.
//!
//! In: the channels of the printhead's bursts, from `heads`. Out: whether a channel is one of the about
//! [`MOST`] that are looked at in a turn ([`ChannelSubset::holds`]). A *turn* is a sweep; a *round* is as
//! many turns as each channel needs to be looked at exactly once.
//!
//! The rule, with C channels and a = C / `MOST`, rounded up: channels are counted from the nearer end of the
//! printhead, a that follow each other form a group, and of each group one channel is looked at in a turn, the next one
//! in the next turn. So a round has a turns, and neither the numbers of channels nor their direction matter.
//! * One channel of each group, since faults come in blocks, which are no majority of the subset then.
//! * Its place in the group begins anywhere (by hashes of groups and round), since rows of nozzles,
//!   multiplexers and supplies fail by every k-th channel.
//! * Which channels go together changes from round to round. If they always went together, those of each
//!   turn would have a level of their own, and the head's level would change with each sweep.

use std::ops::Range;

/// A set of channels as half-open stretches, mostly few, in any order, of which no two overlap or touch.
#[derive(Clone, Debug, Default)]
pub(super) struct ChannelStretches(pub Vec<Range<u32>>);

impl ChannelStretches {
    pub fn add(&mut self, channels: Range<u32>) {
        if self.hold(&channels) {
            return;
        }
        let joins = |s: &Range<u32>| s.start <= channels.end && channels.start <= s.end;
        let joined = self.0.iter().filter(|s| joins(s)).fold(channels.clone(), join);
        self.0.retain(|s| !joins(s));
        self.0.push(joined);
    }

    pub fn hold(&self, channels: &Range<u32>) -> bool {
        self.0.iter().any(|s| s.start <= channels.start && channels.end <= s.end)
    }

    pub fn overlap(&self, channels: &Range<u32>) -> bool {
        self.shared(channels).is_some()
    }

    /// The first part of a stretch whose channels are all in the set; `None`: none is.
    pub fn shared(&self, channels: &Range<u32>) -> Option<Range<u32>> {
        let within = |s: &Range<u32>| s.start.max(channels.start)..s.end.min(channels.end);
        self.0.iter().map(within).find(|shared| !shared.is_empty())
    }

    /// How many channels of the set have lower numbers; `None`: the channel is not in the set.
    fn index(&self, channel: u32) -> Option<u32> {
        let within = self.0.iter().find(|s| s.contains(&channel))?;
        let below = self.0.iter().filter(|s| s.end <= within.start).map(|s| s.end - s.start);
        Some(below.sum::<u32>() + (channel - within.start))
    }

    pub fn channels(&self) -> u32 {
        self.0.iter().fold(0, |sum, s| sum.saturating_add(s.end - s.start))
    }

    /// Makes one stretch of all stretches: the channels that lie between them are added, too.
    pub fn fill_holes(&mut self) {
        self.0 = self.0.drain(..).reduce(|a, b| join(a, &b)).into_iter().collect();
    }
}

fn join(a: Range<u32>, b: &Range<u32>) -> Range<u32> {
    a.start.min(b.start)..a.end.max(b.end)
}

/// Number of channels that are looked at in a turn, at most (two more where the groups do not fill the printhead).
const MOST: u32 = 48;
/// Maximum number of stretches that are kept apart; beyond, the holes between them count as channels.
const MOST_STRETCHES: usize = 64;

#[derive(Clone, Debug, Default)]
pub(super) struct ChannelSubset {
    pub(super) met: ChannelStretches,
}

impl ChannelSubset {
    pub(super) fn meet(&mut self, channels: Range<u32>) {
        self.met.add(channels);
        if self.met.0.len() > MOST_STRETCHES {
            self.met.fill_holes();
        }
    }

    /// Whether a channel was met and is in the subset of a turn. `turn`: counts the sweeps.
    pub(super) fn holds(&self, channel: u32, turn: u32) -> bool {
        let Some(index) = self.met.index(channel) else { return false };
        let channels = self.met.channels();
        let from_end = index.min(channels - 1 - index);
        // `apart` is a in the text above; the place in the group advances by one per turn, around it
        let apart = channels.div_ceil(MOST).max(1);
        if apart == 1 {
            return true;
        }
        // each place is the chosen one in as many groups: groups take places in the order of their hashes
        let (round, groups) = (mixed(turn / apart), channels.div_ceil(2).div_ceil(apart));
        let own = mixed((from_end / apart) ^ round);
        let before = (0..groups).filter(|group| mixed(group ^ round) < own).count() as u32;
        from_end % apart == (before % apart + turn % apart) % apart
    }
}

/// A number that looks random, for each `x` another one (the finaliser of MurmurHash3, a bijection).
fn mixed(x: u32) -> u32 {
    let mut x = (x ^ (x >> 16)).wrapping_mul(0x85eb_ca6b);
    x = (x ^ (x >> 13)).wrapping_mul(0xc2b2_ae35);
    x ^ (x >> 16)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_of_few_channels_and_some_of_many_wherever_their_numbers_lie() {
        for from in [0, 1000, 4_000_000_000] {
            for channels in [8, 33, 48, 49, 64, 100, 128, 256, 500, 1024, 3000] {
                let mut of = ChannelSubset::default();
                // in bursts of 8 channels
                for b in 0..channels / 8 {
                    of.meet(from + 8 * b..from + 8 * b + 8);
                }
                of.meet(from + 8 * (channels / 8)..from + channels);
                let count = (from..from + channels).filter(|&c| of.holds(c, 5)).count();
                match channels {
                    ..=48 => assert_eq!(count, channels as usize),
                    _ => assert!((22..=49).contains(&count), "{count} of {channels} from {from}"),
                }
            }
        }
        let mut apart = ChannelSubset::default();
        (0..16).for_each(|b| apart.meet(1000 * b..1000 * b + 2));
        assert_eq!((0..16_000).filter(|&c| apart.holds(c, 5) && c % 1000 < 2).count(), 32);
        (0..4000).for_each(|b| apart.meet(1000 * b..1000 * b + 2));
        assert!(apart.met.0.len() <= MOST_STRETCHES);
    }

    #[test]
    fn each_round_looks_at_every_channel_once_and_others_go_together_in_the_next() {
        let mut of = ChannelSubset::default();
        of.meet(0..60);
        let subset = |turn: u32| (0..60).filter(|&c| of.holds(c, turn)).collect::<Vec<_>>();
        for round in 0..50 {
            let [first, second] = [subset(2 * round), subset(2 * round + 1)];
            assert_eq!(first.len() + second.len(), 60);
            assert!(first.iter().all(|c| !second.contains(c)));
            let next = subset(2 * round + 2);
            let again = next.iter().filter(|c| first.contains(c)).count();
            assert!((4..=26).contains(&again), "{again} of {} in round {round}", next.len());
        }
    }

    #[test]
    fn what_fails_by_every_kth_channel_or_in_a_block_is_no_majority() {
        let turns =
            [64_u32, 128, 256, 500, 1024].map(|channels| (0..6).map(move |turn| (channels, turn)));
        for (channels, turn) in turns.into_iter().flatten() {
            let mut of = ChannelSubset::default();
            of.meet(0..channels);
            for k in 3..=64_u32.min(channels / 4) {
                for residue in 0..k {
                    let looked = (0..channels).filter(|&c| of.holds(c, turn));
                    let (all, faulty) = looked.fold((0, 0), |(all, faulty), c| {
                        (all + 1, faulty + usize::from(c % k == residue))
                    });
                    assert!(2 * faulty <= all, "every {k}th of {channels}: {faulty} of {all}");
                }
            }
            // a block of three tenths of all channels is less than two fifths of each subset
            let block = 3 * channels / 10;
            for from in 0..channels - block {
                let looked = (0..channels).filter(|&c| of.holds(c, turn));
                let (all, faulty) = looked.fold((0, 0), |(all, faulty), c| {
                    (all + 1, faulty + usize::from((from..from + block).contains(&c)))
                });
                assert!(5 * faulty < 2 * all, "from {from} of {channels}: {faulty} of {all}");
            }
        }
    }

    #[test]
    fn stretches_that_touch_are_one_in_whatever_order_they_come() {
        for order in [[0, 1, 2, 3], [3, 1, 0, 2], [2, 0, 3, 1]] {
            let mut of = ChannelStretches::default();
            order.iter().for_each(|i| of.add(10 * i..10 * i + 10));
            assert_eq!((of.0.len(), of.channels()), (1, 40));
            assert!(of.hold(&(0..40)) && !of.hold(&(0..41)) && of.overlap(&(39..50)));
            of.add(50..60);
            assert!((of.0.len(), of.channels()) == (2, 50) && !of.overlap(&(40..50)));
            of.fill_holes();
            assert!((of.0.len(), of.channels()) == (1, 60) && of.hold(&(0..60)));
        }
    }
}
