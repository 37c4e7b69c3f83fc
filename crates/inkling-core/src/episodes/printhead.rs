//! Follows the channels of one printhead, burst by burst.
//!
//! In: the bursts of one printhead in the order of time. Out: episodes that have ended, and, for who asks,
//! those that were raised. Most looks are at channels in which nothing is going on: these are updated eight
//! at a time, and only the others one by one.

use super::channel::Channel;
use super::evidence::{Evidence, TOGETHER};
use super::intermittent::Flags;
use super::order::WaitingBursts;
use super::rules::Rules;
use super::{Counts, Episode, IsolatedSignal, Looks, Untimely};
use std::collections::HashMap;
use std::sync::Arc;

/// At most so many channels are remembered, over all printheads.
const MOST_CHANNELS: usize = 1 << 20;

/// The states of a printhead's channels, and its bursts that wait for earlier ones.
#[derive(Debug)]
pub struct Printhead {
    pub name: Arc<str>,
    pub waiting: WaitingBursts,
    /// The channels in the order in which they were met, which is mostly that of their numbers.
    pub states: Vec<Channel>,
    /// Index in `states` of each channel, by its number.
    place: HashMap<u32, usize>,
    /// Looks and flagged looks at all channels, without those at a channel whose episode was on.
    flags: Flags,
    pub untimely: Untimely,
}

/// What the printheads of a tracker have in common. It hands out episodes that have ended, episodes that were
/// raised, and what was left out.
#[derive(Debug, Default)]
pub struct TrackerOutput {
    pub counts: Counts,
    pub ended: Vec<Episode>,
    /// Raised episodes as they were when the evidence sufficed, or when their name changed; `None`: nobody
    /// asks for them.
    pub raised: Option<Vec<Episode>>,
    /// Number of channels remembered, over all printheads.
    pub channels: usize,
}

impl Printhead {
    pub fn new(name: Arc<str>) -> Printhead {
        let untimely = Untimely { printhead: name.clone(), ..Untimely::default() };
        Printhead {
            name,
            waiting: WaitingBursts::default(),
            states: Vec::new(),
            place: HashMap::new(),
            flags: Flags::default(),
            untimely,
        }
    }

    /// Index of a channel's state; a new channel gets one while there is room (`None`: there is none).
    /// `near`: where the state probably is; `channels`: number of channels remembered so far, over all
    /// printheads.
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
        Some(self.states.len() - 1)
    }

    /// Takes looks at `TOGETHER` channels from `row` on at once, whose states begin at index `near`. Only
    /// channels are updated of which nothing is named and that are raised neither before nor after this look;
    /// for them the effect is that of [`Channel::look`]. Returns which channels were updated. `None`: the
    /// states are not theirs, and nothing was done.
    fn look_at_quiet(
        &mut self,
        looks: &Looks,
        row: u32,
        near: usize,
        named: &[IsolatedSignal],
        bound: f32,
    ) -> Option<[bool; TOGETHER]> {
        let ratios = looks.ratios.get(row as usize..)?.first_chunk::<TOGETHER>()?;
        let states = self.states.get_mut(near..)?.first_chunk_mut::<TOGETHER>()?;
        let first = looks.first_channel.saturating_add(row);

        // Which of the channels the fast path serves: the next look in time, by the same model and baseline
        // as before, judged, not raised, and not named.
        let mut among = [true; TOGETHER];
        for (((i, state), ratio), among) in (0u32..).zip(&*states).zip(ratios).zip(&mut among) {
            if state.number != first.saturating_add(i) {
                return None;
            }
            *among = (state.last_ns < looks.t_ns)
                & (state.model == Some(looks.model))
                & (state.own == looks.judged_by_own(row + i))
                & !state.evidence.is_raised()
                & !ratio.is_nan();
        }
        // Every flagged look is named, so it is left to `look_alone`, which counts flagged looks.
        for named in named.iter().take_while(|named| named.row < row + TOGETHER as u32) {
            among[(named.row - row) as usize] = false;
        }

        let evidence = states.each_mut().map(|state| &mut state.evidence);
        let (done, begin) = Evidence::look_at_quiet(evidence, among, ratios, bound);

        // the same as `Channel::look` does for `Step::Quiet` and `Step::Suspect`
        for (((state, ratio), done), begins) in states.iter_mut().zip(ratios).zip(done).zip(begin) {
            if !done {
                continue;
            }
            (state.last_ns, state.last_ratio) = (looks.t_ns, *ratio);
            (state.looks, state.heard) = (state.looks + 1, state.heard + 1);
            self.flags.looks += 1;
            if begins {
                (state.onset_ns, state.looks) = (looks.t_ns, 1);
            }
            if state.draft.is_some() && (begins || state.evidence.is_quiet()) {
                state.draft = None;
            }
        }
        Some(done)
    }

    /// Takes the looks of one burst, which must be the next in time.
    pub fn look(&mut self, looks: &Looks, rules: &Rules, output: &mut TrackerOutput) {
        let rows = looks.ratios.len() as u32; // a burst has few
        self.untimely.signals += looks.ratios.iter().filter(|ratio| !ratio.is_nan()).count() as u64;
        let mut named = looks.named.as_slice();
        // `near` follows the states along with the rows, so that channels of a burst are found without a
        // search
        let (mut row, mut near) = (0, 0);
        while row < rows {
            // eight rows at once as far as possible, those left one by one
            let done = self.look_at_quiet(looks, row, near, named, rules.bound).unwrap_or_default();
            let next = row.saturating_add(TOGETHER as u32).min(rows);
            for (row, done) in (row..next).zip(done) {
                if done {
                    near += 1;
                    continue;
                }
                let here = named.first().filter(|first| first.row == row);
                named = &named[usize::from(here.is_some())..];
                near = self.look_alone((looks, rules), row, here, near, output);
            }
            row = next;
        }
    }

    /// Takes the look at one channel. `near`: index at which its state probably is. Returns the index at
    /// which the next channel's state probably is.
    fn look_alone(
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
        // too late, or a second look at the same time: it is counted, and is no evidence
        if !channel.is_next(looks.t_ns, ratio, counts, &mut self.untimely) {
            return place + 1;
        }
        channel.judge_by(looks, looks.judged_by_own(row));
        // The rate of flagged looks is that of channels without a known fault.
        if !channel.evidence.is_raised() {
            self.flags.looks += 1;
            self.flags.flagged += u64::from(ratio > 1.0);
        }
        if let Some(over) = channel.look(looks.t_ns, ratio, named, self.flags, rules) {
            counts.episodes += 1;
            let end = over.fading.map(|(t_ns, _)| t_ns);
            output.ended.push(channel.episode(&self.name, &over, rules, end));
        }
        if let Some(raised) = &mut output.raised {
            raised.extend(channel.news(&self.name, looks.t_ns, named.is_some(), rules));
        }
        place + 1
    }
}
