//! Sets of channel numbers, which mostly are a few stretches of consecutive numbers.

use std::ops::Range;

/// A set of channels as half-open stretches, in any order, of which no two overlap or touch.
#[derive(Clone, Debug, Default)]
pub(super) struct ChannelStretches(Vec<Range<u32>>);

impl ChannelStretches {
    /// Adds a stretch of channels, joined with all those that it overlaps or touches.
    pub fn add(&mut self, channels: Range<u32>) {
        if self.hold(&channels) {
            return;
        }
        let joins = |s: &Range<u32>| s.start <= channels.end && channels.start <= s.end;
        let joined = self.0.iter().filter(|s| joins(s)).fold(channels.clone(), join);
        self.0.retain(|s| !joins(s));
        self.0.push(joined);
    }

    /// Whether all of `channels` are in the set.
    pub fn hold(&self, channels: &Range<u32>) -> bool {
        self.0.iter().any(|s| s.start <= channels.start && channels.end <= s.end)
    }

    /// Whether at least one of `channels` is in the set.
    pub fn overlap(&self, channels: &Range<u32>) -> bool {
        self.0.iter().any(|s| s.start < channels.end && channels.start < s.end)
    }

    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Number of stretches.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Number of channels.
    pub fn channels(&self) -> u32 {
        self.0.iter().fold(0, |sum, s| sum.saturating_add(s.end - s.start))
    }

    /// Makes one stretch of all: the channels that lie between stretches are added, too.
    pub fn fill_holes(&mut self) {
        self.0 = self.0.drain(..).reduce(|a, b| join(a, &b)).into_iter().collect();
    }

    pub fn iter(&self) -> impl Iterator<Item = &Range<u32>> {
        self.0.iter()
    }
}

impl IntoIterator for ChannelStretches {
    type Item = Range<u32>;
    type IntoIter = std::vec::IntoIter<Range<u32>>;

    fn into_iter(self) -> Self::IntoIter {
        self.0.into_iter()
    }
}

/// The shortest stretch that holds both.
fn join(a: Range<u32>, b: &Range<u32>) -> Range<u32> {
    a.start.min(b.start)..a.end.max(b.end)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stretches_that_touch_are_one_in_whatever_order_they_come() {
        for order in [[0, 1, 2, 3], [3, 1, 0, 2], [2, 0, 3, 1]] {
            let mut of = ChannelStretches::default();
            order.iter().for_each(|i| of.add(10 * i..10 * i + 10));
            assert_eq!((of.len(), of.channels()), (1, 40));
            assert!(of.hold(&(0..40)) && !of.hold(&(0..41)) && of.overlap(&(39..50)));
            of.add(50..60);
            assert!((of.len(), of.channels()) == (2, 50) && !of.overlap(&(40..50)));
            of.fill_holes();
            assert!((of.len(), of.channels()) == (1, 60) && of.hold(&(0..60)));
        }
    }
}
