//! Counts of signals: of a printhead in one recording ([`Tally`]), and of a channel over all of them
//! ([`ChannelCount`]), with what can be told from them: whether the channel is known, measured or
//! doubtful now.
//!
//! In: the rows of the verdicts, which `recording_counts` counts, and `survey` adds up over recordings. Out: numbers,
//! to most files of the report.

use super::night::{Span, whole};
use super::watch::BurstCounts;
use inkling_core::verdict::Reason;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, HashMap};
use std::hash::Hash;

/// Least number of signals of a channel from which it can be told that the channel fell silent. With fewer,
/// the channel may have been measured once in a scan over all channels, and an early time says nothing.
const SEVERAL: u64 = 4;
/// From this many flagged signals on they are no false alarms if they are most of a channel's signals.
const AGAIN: u64 = 3;
/// So many of a channel's latest recordings are kept: where each holds one signal, together they show a fault.
const RECENT: usize = 3;

/// Most channels of a printhead that are counted one by one.
pub const MOST_CHANNELS: usize = 1 << 16;

/// The places of printheads in a list, by name, or of a printhead's channels, by number, in the order in which they
/// were met.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Places<K: Eq + Hash>(HashMap<K, usize>);

impl<K: Clone + Eq + Hash> Places<K> {
    pub fn get(&self, key: &K) -> Option<usize> {
        self.0.get(key).copied()
    }

    /// The place of a key; `add` is called with the place of one that is new. `None`: it is new, and there are `most`
    /// already.
    pub fn of(&mut self, key: &K, most: usize, add: impl FnOnce(usize)) -> Option<usize> {
        let new = self.0.len();
        self.get(key).or_else(|| {
            (new < most).then(|| {
                self.0.insert(key.clone(), new);
                add(new);
                new
            })
        })
    }
}

/// Counts of the signals of one printhead in one recording.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Tally {
    pub judged: u64,
    pub flagged: u64,
    /// Signals that count as not judged: those that were rejected, and those whose reason concerns
    /// the whole printhead ([`Reason::is_of_head`]) and so says nothing about a nozzle.
    pub rejected: u64,
    /// Signals that were not judged, by reason.
    pub reasons: BTreeMap<Reason, u64>,
    /// The lowest and the highest channel that was judged.
    pub channels: Option<[u32; 2]>,
    /// From the first to the last signal, judged or not.
    pub span: Option<Span>,
}

impl Tally {
    /// Number of all signals.
    pub fn signals(&self) -> u64 {
        self.judged + self.rejected
    }

    /// The most frequent of the reasons for which signals were not judged.
    pub fn commonest_reason(&self) -> Option<Reason> {
        self.reasons.iter().max_by_key(|(_, n)| **n).map(|(reason, _)| *reason)
    }
}

/// Counts of the signals of one channel over all recordings.
#[derive(Clone, Debug, Default)]
pub struct ChannelCount {
    pub channel: u32,
    pub judged: u64,
    pub flagged: u64,
    /// The latest recordings that hold the channel, the last one first, and its counts there.
    recent: Vec<(usize, InRecording)>,
    /// Index into the watches of its printhead; `None` if the channel had no episode.
    pub watch: Option<usize>,
}

/// Counts of one channel in one recording.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct InRecording {
    pub channel: u32,
    /// From the channel's first to its last signal in the recording; `None`: its bursts have no time.
    pub span: Option<Span>,
    /// Of its signals that were judged.
    pub bursts: BurstCounts,
    /// Number of the others that have a time.
    pub rejected: u64,
}

impl InRecording {
    /// Counts one signal. `has_time`: whether `t_ns` is its time; an unusable burst may have any.
    pub fn add(&mut self, t_ns: i64, has_time: bool, flagged: Option<bool>) {
        if has_time {
            self.span = whole(self.span.into_iter().chain([(t_ns, t_ns)]));
            self.rejected += u64::from(flagged.is_none());
        }
        flagged.into_iter().for_each(|flagged| self.bursts.add(t_ns, flagged));
    }
}

impl ChannelCount {
    /// A channel of which no signal was counted yet.
    pub fn new(channel: u32) -> ChannelCount {
        ChannelCount { channel, ..ChannelCount::default() }
    }

    /// Index of the latest recording that holds the channel.
    pub fn latest(&self) -> usize {
        self.recent.first().map_or(0, |(recording, _)| *recording)
    }

    fn last(&self) -> Option<&InRecording> {
        self.recent.first().map(|(_, counts)| counts)
    }

    /// Whether at least half of the channel's signals were judged in the latest recording that holds it.
    pub fn is_known_now(&self) -> bool {
        self.last().is_none_or(|last| last.bursts.judged >= last.rejected)
    }

    /// Whether the channel is flagged again and again, but in no recording often enough for an episode.
    pub fn is_doubtful(&self) -> bool {
        // most of all its signals and of those in the latest recording, or all of at least two there; where a recording
        // holds one burst, in the latest ones together
        let last = self.last().map(|last| &last.bursts);
        let most_now = last.is_none_or(|last| 2 * last.flagged > last.judged);
        let often = self.flagged >= AGAIN && 2 * self.flagged > self.judged && most_now;
        let (mut judged, mut flagged) = (0, 0);
        for (_, InRecording { bursts, .. }) in &self.recent {
            (judged, flagged) = (judged + bursts.judged, flagged + bursts.flagged);
            if judged >= 2 {
                break;
            }
        }
        let now = flagged >= 2 && flagged == judged;
        !self.is_watched() && (often || now)
    }

    /// Whether the channel was measured in the last night, which began at `from_ns`, and did not
    /// fall silent in the first half of its latest recording. `of_head`: counts of its printhead by
    /// recording, of whose span in that recording the half is meant.
    pub fn is_measured(&self, from_ns: i64, of_head: &BTreeMap<usize, Tally>) -> bool {
        let Some((recording, last)) = self.recent.first() else { return false };
        let Some((_, to_ns)) = last.span else { return false };
        let span = of_head.get(recording).and_then(|of| of.span);
        let fell_silent = span.is_some_and(|(from, to)| to_ns - from < (to - from) / 2);
        to_ns >= from_ns && !(fell_silent && last.bursts.judged + last.rejected >= SEVERAL)
    }

    /// Adds what the recording with this index holds of the channel. Recordings may come in any order.
    pub fn absorb(&mut self, recording: usize, counts: InRecording) {
        self.judged += counts.bursts.judged;
        self.flagged += counts.bursts.flagged;
        let began_ns = |of: &InRecording| of.span.map(|(from_ns, _)| from_ns);
        if let Some(from_ns) = began_ns(&counts) {
            let later = |(_, of): &(usize, InRecording)| began_ns(of) > Some(from_ns);
            self.recent.insert(self.recent.partition_point(later), (recording, counts));
            self.recent.truncate(RECENT);
        }
    }

    /// Whether the channel had an episode.
    pub fn is_watched(&self) -> bool {
        self.watch.is_some()
    }
}
