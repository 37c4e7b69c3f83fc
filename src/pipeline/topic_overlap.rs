//! Finds printheads of which the same channels come by two topics in turn: two devices of one name, or signals beside
//! what somebody made of them. Nobody can tell their faults apart.
//!
//! In: bursts by the number of their group, in the order of the file ([`TopicOverlap::hear`]). Out: a sentence for each
//! such printhead ([`TopicOverlap::told`]). Nothing here changes a verdict. A recorder that goes on under another topic
//! does not take turns, and one that has a topic for each part of a printhead shares no channel.

use super::channel_subset::ChannelStretches;
use super::not_judged::NotJudged;
use super::numbers::STEADY;
use super::sweep::channels;
use crate::report::numbered;
use inkling_core::burst::Burst;
use inkling_io::recording::Recording;
use std::ops::Range;
use std::sync::Arc;

/// Topics of a group that are watched: whoever has a topic for each channel has no two devices.
const MOST_TOPICS: usize = 8;
/// Channels that are listed.
const MOST_LISTED: u32 = 1 << 12;

#[derive(Debug, Default)]
pub struct TopicOverlap {
    /// By the number of the group.
    groups: Vec<GroupTopics>,
}

#[derive(Debug, Default)]
struct GroupTopics {
    printhead: Arc<str>,
    /// Each with the channels that came by it, in the order in which they were met.
    topics: Vec<(u16, ChannelStretches)>,
    last: Option<u16>,
    /// How often a channel came by another topic than the one before that shares it, and the two, the last time.
    turns: u32,
    two: [u16; 2],
    shared: Range<u32>,
}

impl TopicOverlap {
    pub fn hear(&mut self, group: usize, burst: &Burst) {
        if group >= self.groups.len() {
            self.groups.resize_with(group + 1, GroupTopics::default);
        }
        self.groups[group].hear(burst);
    }

    pub fn told(&self, recording: &Recording) -> Vec<NotJudged> {
        self.groups.iter().filter_map(|of| of.told(recording)).collect()
    }
}

impl GroupTopics {
    fn hear(&mut self, burst: &Burst) {
        let (topic, of) = (burst.topic, channels(burst));
        if self.topics.len() > MOST_TOPICS {
            return;
        }
        let known = self.topics.iter().position(|(number, _)| *number == topic);
        let place = known.unwrap_or_else(|| {
            self.printhead = burst.printhead.clone();
            self.topics.push((topic, ChannelStretches::default()));
            self.topics.len() - 1
        });
        self.topics[place].1.add(of.clone());
        if self.last.replace(topic).is_some_and(|last| last != topic) {
            let others = self.topics.iter().filter(|(number, _)| *number != topic);
            let mut shared = others.filter_map(|(other, met)| Some((*other, met.shared(&of)?)));
            if let Some((other, channels)) = shared.next() {
                self.turns = self.turns.saturating_add(1);
                (self.two, self.shared) = ([other, topic], channels);
            }
        }
    }

    /// The sentence, where the topics took turns too often for an accident.
    fn told(&self, recording: &Recording) -> Option<NotJudged> {
        let [one, other] = self.two.map(|number| recording.topic(number));
        // a program that begins anew writes on a channel of its own, of the same topic
        if self.turns < STEADY || self.topics.len() > MOST_TOPICS || one.is_some() && one == other {
            return None;
        }
        let names = one.zip(other).map(|(one, other)| format!(", {one} and {other}"));
        let Range { start, end } = self.shared;
        let listed: Vec<u32> = (start..end.min(start.saturating_add(MOST_LISTED))).collect();
        let name = inkling_io::printable::line(&self.printhead, 64);
        let what = format!(
            "{name}: its {} come in turn by two topics{}: two printheads of one name, or one recorded twice? What is said \
             of a channel is of both. Give each a name of its own where they are recorded, or record one of them",
            numbered(&listed),
            names.unwrap_or_default()
        );
        Some(NotJudged::of_printhead(&self.printhead, what))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use inkling_core::burst::{Format, Layout};

    /// How often channels come by topics in turn, of bursts given by topic and first channel.
    fn turns(bursts: impl IntoIterator<Item = (u16, u32)>) -> u32 {
        let signals = vec![vec![0.0, 1.0]; 4];
        let of = Burst::of(&signals, 1e-6, Format::S16Le, Layout::ChannelMajor);
        let mut overlap = TopicOverlap::default();
        for (topic, first_channel) in bursts {
            overlap.hear(0, &Burst { topic, first_channel, ..of.clone() });
        }
        overlap.groups[0].turns
    }

    #[test]
    fn channels_that_come_by_two_topics_in_turn_are_noted_and_parts_of_a_printhead_are_not() {
        assert_eq!(turns((0..20).map(|i| (i % 2, 0))), 19);
        assert_eq!(turns((0..20).map(|i| (i % 2, 4 * u32::from(i % 2)))), 0);
        // another topic from some burst on
        assert_eq!(turns((0..20).map(|i| (i / 10, 0))), 1);
        // a topic for each part, of many
        assert_eq!(turns((0..200).map(|i| (i % 20, 4 * u32::from(i % 20)))), 0);
    }
}
