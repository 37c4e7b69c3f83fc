//! Follows the channels of one printhead, burst by burst.
//!
//! In: the bursts of one printhead in the order of time, from `tracker`. Out, into
//! [`TrackerOutput`]: episodes that have ended, and, if the tracker works at once
//! (`Tracker::at_once`), those that were raised: the evidence for their fault has reached its
//! bound. For each row of a burst the state of its channel is found, and takes the look.
//!
//! Most looks are at channels without an episode whose signal was not flagged. These are updated
//! eight (`TOGETHER`) at a time, in SIMD lanes (`look_at_quiet`), and only the others one by one
//! (`look_alone`). Both ways have the same effect; a test in `tracker/tests.rs` compares them.

use super::channel::Channel;
use super::evidence::{Evidence, TOGETHER};
use super::intermittent::Flags;
use super::order::WaitingBursts;
use super::rules::Rules;
use super::{Counts, Episode, IsolatedSignal, Looks, Untimely};
use std::collections::HashMap;
use std::sync::Arc;

/// At most so many channels are remembered, over all printheads of a tracker, so that memory is
/// bounded whatever a recording claims. The signals of further channels are only counted.
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
    /// Looks, and flagged looks, at all channels while no episode was on in them: the rate of false
    /// alarms that one channel's flagged looks are compared with, for a fault that comes and goes.
    flags: Flags,
    /// The number of all judged signals, and of those among them that came too late or at the time
    /// of another.
    pub untimely: Untimely,
}

/// What the printheads of a tracker have in common: episodes that have ended or were raised, and
/// the numbers of signals left out.
#[derive(Debug, Default)]
pub struct TrackerOutput {
    pub counts: Counts,
    pub ended: Vec<Episode>,
    /// Episodes as they were at the look that raised them, and once more at each look that gave
    /// them another name ([`Channel::news`]); `None`: nobody asks for them.
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

    /// Index of a channel's state; a channel that was never met gets one. `near`: index where the
    /// state probably is; `channels`: number of channels remembered so far, over all printheads,
    /// which a new one adds to. `None`: the channel is new, and `MOST_CHANNELS` are remembered
    /// already.
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

    /// Takes the looks at `TOGETHER` channels, those of the rows from `row` on, at once. A channel
    /// is left out if its look is flagged, not judged or not the next in time, if another model or
    /// baseline judges it than before, or if its episode is on or would be raised by this look. For
    /// the channels that are not left out the effect is that of [`Printhead::look_alone`].
    ///
    /// `near`: index of the state of the first of these channels; `named`: the burst's flagged
    /// signals from `row` on. Returns which channels were updated. `None`: fewer than `TOGETHER`
    /// rows or states are left, or the states from `near` on are not those of these channels; then
    /// nothing was done.
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

        // Which channels are updated here: the look is the next in time, by the same model as
        // before, and as before by the channel's own baseline or not; no episode is on; and the
        // look was judged.
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
        // `named` has an entry for every flagged signal, even if isolation said nothing of it.
        // Flagged looks are left to `look_alone`, which counts them.
        for named in named.iter().take_while(|named| named.row < row + TOGETHER as u32) {
            among[(named.row - row) as usize] = false;
        }

        // the sequential test of all of them
        let evidence = states.each_mut().map(|state| &mut state.evidence);
        let (done, begin) = Evidence::look_at_quiet(evidence, among, ratios, bound);

        // The rest of what `look_alone` and, for `Step::Quiet` and `Step::Suspect`, `Channel::look`
        // do. At a look that may be the onset (`begins`) the draft starts anew; once no evidence is
        // left what was suspected was chance.
        for (((state, ratio), done), begins) in states.iter_mut().zip(ratios).zip(done).zip(begin) {
            if !done {
                continue;
            }
            (state.last_ns, state.last_ratio) = (looks.t_ns, *ratio);
            state.looks += 1;
            state.quiet.add(false);
            self.flags.add(false);
            if begins {
                (state.onset_ns, state.looks) = (looks.t_ns, 1);
            }
            if state.draft.is_some() && (begins || state.evidence.is_quiet()) {
                state.draft = None;
            }
        }
        Some(done)
    }

    /// Takes the looks of one burst, the next in the order of time; looks that come too late are
    /// counted only. `output`: gets what the burst ends and raises.
    pub fn look(&mut self, looks: &Looks, rules: &Rules, output: &mut TrackerOutput) {
        let rows = looks.ratios.len() as u32; // a burst has far fewer than 2^32 rows
        self.untimely.signals += looks.ratios.iter().filter(|ratio| !ratio.is_nan()).count() as u64;
        let mut named = looks.named.as_slice();
        // `near`, the index where the next row's state probably is, advances along with the rows,
        // so that the channels of a burst are found without a search
        let (mut row, mut near) = (0, 0);
        while row < rows {
            // of eight rows as many as possible at once, then those of them that are left one by
            // one
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

    /// Takes the look at one channel, whatever it is. `row`: its row in the burst; `named`: what
    /// isolation says of the look, if it was flagged; `near`: index at which the channel's state
    /// probably is. Returns the index at which the next channel's state probably is.
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

        // The printhead's flags. Looks while an episode is on do not count, since the rate that is
        // wanted is that of false alarms.
        if !channel.evidence.is_raised() {
            self.flags.add(ratio > 1.0);
        }

        // the look itself, and what it ends or raises
        if let Some(over) = channel.look(looks.t_ns, ratio, named, self.flags, rules) {
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
