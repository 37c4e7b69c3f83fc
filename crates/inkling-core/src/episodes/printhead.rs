//! Follows the channels of one printhead, burst by burst.
//!
//! In: the bursts of one printhead in the order of time. Out, into [`TrackerOutput`]: episodes that
//! have ended, and, if the tracker works at once, those that were raised.

use super::channel::Channel;
use super::intermittent::QuietLooks;
use super::order::WaitingBursts;
use super::rules::Rules;
use super::{Counts, Episode, IsolatedSignal, Looks, Untimely};
use std::collections::HashMap;
use std::sync::Arc;

/// At most so many channels are remembered, over all printheads of a tracker.
const MOST_CHANNELS: usize = 1 << 20;

/// The states of a printhead's channels, and its bursts that wait for earlier ones.
#[derive(Debug, Default)]
pub struct Printhead {
    pub name: Arc<str>,
    pub waiting: WaitingBursts,
    /// The channels in the order in which they were met, which is mostly that of their numbers.
    pub states: Vec<Channel>,
    place: HashMap<u32, usize>,
    quiet: QuietLooks,
    pub untimely: Untimely,
}

#[derive(Debug, Default)]
pub struct TrackerOutput {
    pub counts: Counts,
    pub ended: Vec<Episode>,
    /// Episodes at the looks that raised or renamed them ([`Channel::news`]); `None`: nobody asks.
    pub raised: Option<Vec<Episode>>,
    pub channels: usize,
}

impl Printhead {
    pub fn new(name: Arc<str>) -> Printhead {
        let untimely = Untimely { printhead: name.clone(), ..Untimely::default() };
        Printhead { name, untimely, ..Printhead::default() }
    }

    /// Index of a channel's state; a new channel gets one. `near`: where it probably is; `channels`:
    /// number remembered so far. `None`: there is no room.
    fn place_of(&mut self, number: u32, near: usize, channels: &mut usize) -> Option<usize> {
        if self.states.get(near).is_some_and(|state| state.number == number) {
            return Some(near);
        }
        if let Some(&place) = self.place.get(&number) {
            return Some(place);
        }
        if *channels >= MOST_CHANNELS {
            return None;
        }
        *channels += 1;
        self.place.insert(number, self.states.len());
        self.states.push(Channel::new(number));
        self.quiet.add_channel();
        Some(self.states.len() - 1)
    }

    /// Ends all episodes with the last look at their channels, and forgets what was seen of these.
    pub fn begin_anew(&mut self, rules: &Rules, output: &mut TrackerOutput) {
        for channel in &mut self.states {
            let draft = channel.draft.take().filter(|_| channel.evidence.raised);
            if let Some(draft) = draft {
                output.counts.episodes += 1;
                let end = Some(channel.last_ns);
                output.ended.push(channel.episode(&self.name, &draft, rules, end));
            }
            *channel = Channel::new(channel.number);
        }
        self.quiet.begin_anew();
    }

    pub fn look(&mut self, looks: &Looks, rules: &Rules, output: &mut TrackerOutput) {
        let rows = looks.ratios.len() as u32; // a burst has far fewer than 2^32 rows
        self.untimely.signals += looks.ratios.iter().filter(|ratio| !ratio.is_nan()).count() as u64;
        let mut named = looks.named.as_slice();
        let mut near = 0;
        for row in 0..rows {
            let here = named.first().filter(|first| first.row == row);
            named = &named[usize::from(here.is_some())..];
            near = self.look_at((looks, rules), row, here, near, output);
        }
    }

    /// Takes the look at one channel. `near`: index at which its state probably is. Returns that of
    /// the next channel.
    fn look_at(
        &mut self,
        (looks, rules): (&Looks, &Rules),
        row: u32,
        named: Option<&IsolatedSignal>,
        near: usize,
        output: &mut TrackerOutput,
    ) -> usize {
        let (ratio, counts) = (looks.ratios[row as usize], &mut output.counts);
        let number = looks.first_channel.saturating_add(row);
        if ratio.is_nan() {
            // not judged: no look, but the state at `near` may be this channel's
            let is_its = self.states.get(near).is_some_and(|state| state.number == number);
            return near + usize::from(is_its);
        }
        let Some(place) = self.place_of(number, near, &mut output.channels) else {
            counts.signals_beyond_limit += 1;
            return near;
        };
        let channel = &mut self.states[place];

        if !channel.is_next(looks.t_ns, ratio, counts, &mut self.untimely) {
            return place + 1;
        }
        channel.judge_by(looks, looks.judged_by_own(row));

        // looks while an episode is on are no false alarms
        if !channel.evidence.raised {
            self.quiet.add(place, ratio > 1.0);
        }

        let quiet = (&mut self.quiet, place);
        if let Some(over) = channel.look(looks.t_ns, ratio, named, quiet, rules) {
            counts.episodes += 1;
            // the fault ended with the first of the looks that fit the return to healthy
            let end = over.fading.map(|(t_ns, _)| t_ns);
            output.ended.push(channel.episode(&self.name, &over, rules, end));
        }
        if let Some(raised) = &mut output.raised {
            raised.extend(channel.news(&self.name, looks.t_ns, named.is_some(), rules));
        }
        place + 1
    }
}
