//! Counts of signals: of a printhead in one recording ([`Tally`]), and of a channel over all of them
//! ([`ChannelCount`]), with what can be told from them: whether the channel is known, measured or
//! doubtful now.
//!
//! In: the rows of the verdicts, which `survey` counts. Out: numbers, to most files of the report.

use super::night::Span;
use inkling_core::verdict::Reason;
use std::collections::BTreeMap;

/// Least number of signals of a channel from which it can be told that the channel fell silent. With fewer,
/// the channel may have been measured once in a scan over all channels, and an early time says nothing.
const SEVERAL: u64 = 4;
/// From this many flagged signals on they are no false alarms if they are most of a channel's signals.
const AGAIN: u64 = 3;

/// Counts of the signals of one printhead in one recording.
#[derive(Clone, Debug, Default, PartialEq)]
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
#[derive(Clone, Copy, Debug, Default)]
pub struct ChannelCount {
    pub channel: u32,
    pub judged: u64,
    pub flagged: u64,
    /// The channel's counts in the latest recording that holds it.
    last: InRecording,
    /// Index into the watches of its printhead; `None` if the channel had no episode.
    pub watch: Option<usize>,
}

/// Counts of one channel in one recording.
#[derive(Clone, Copy, Debug, Default)]
struct InRecording {
    recording: usize,
    /// Times of the channel's first and last signal in the recording.
    from_ns: i64,
    to_ns: i64,
    judged: u64,
    flagged: u64,
    rejected: u64,
}

impl ChannelCount {
    /// A channel of which no signal was counted yet.
    pub fn new(channel: u32) -> ChannelCount {
        let last = InRecording { from_ns: i64::MIN, ..InRecording::default() };
        ChannelCount { channel, last, ..ChannelCount::default() }
    }

    /// Index of the latest recording that holds the channel.
    pub fn latest(&self) -> usize {
        self.last.recording
    }

    /// Whether at least half of the channel's signals were judged in the latest recording that holds it.
    pub fn is_known_now(&self) -> bool {
        self.last.judged >= self.last.rejected
    }

    /// Whether the channel is flagged again and again, but in no recording often enough for an episode.
    pub fn is_doubtful(&self) -> bool {
        // most of all its signals, or all of at least two in the latest recording
        let often = self.flagged >= AGAIN && 2 * self.flagged > self.judged;
        let now = self.last.flagged >= 2 && self.last.flagged == self.last.judged;
        !self.is_watched() && (often || now)
    }

    /// Whether the channel was measured in the last night, which began at `from_ns`, and did not
    /// fall silent in the first half of its latest recording. `of_head`: counts of its printhead by
    /// recording, of whose span in that recording the half is meant.
    pub fn is_measured(&self, from_ns: i64, of_head: &BTreeMap<usize, Tally>) -> bool {
        let InRecording { recording, to_ns, judged, rejected, .. } = self.last;
        let span = of_head.get(&recording).and_then(|of| of.span);
        let fell_silent = span.is_some_and(|(from, to)| to_ns - from < (to - from) / 2);
        to_ns >= from_ns && !(fell_silent && judged + rejected >= SEVERAL)
    }

    /// Counts one signal for the latest recording. Recordings may come in any order: a recording
    /// that begins later replaces what was counted, and the signals of an earlier one are ignored.
    pub fn count_last(&mut self, recording: usize, t_ns: i64, is_judged: bool, flagged: bool) {
        let is_new = recording != self.last.recording || self.last.judged + self.last.rejected == 0;
        if is_new && t_ns >= self.last.from_ns {
            self.last =
                InRecording { recording, from_ns: t_ns, to_ns: t_ns, ..InRecording::default() };
        }
        if recording == self.last.recording {
            self.last.to_ns = self.last.to_ns.max(t_ns);
            self.last.judged += u64::from(is_judged);
            self.last.flagged += u64::from(flagged);
            self.last.rejected += u64::from(!is_judged);
        }
    }

    /// Whether the channel had an episode.
    pub fn is_watched(&self) -> bool {
        self.watch.is_some()
    }
}
