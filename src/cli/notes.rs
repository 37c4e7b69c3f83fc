//! Messages about the recordings of a run. The first message of each kind is told, the others are
//! only counted. Two messages are of one kind if their texts differ in numbers alone; the place
//! that a message is about (a window, a printhead, bytes) is no part of the text.
//!
//! In: from the pipeline, the report of each recording, whose sentences are counted by kind
//! ([`warnings`], [`notes`], [`damage`]) and go to the journal. Out: over all recordings of a run,
//! the kinds and their numbers ([`Notes`]), which `account` writes to `run.json`.

use crate::pipeline::RecordingReport;
use crate::report::clock;
use inkling_io::damage::Damage;
use inkling_io::journal::CountedMessage;
use inkling_io::printable;
use std::collections::HashMap;

/// Most kinds of messages that are distinguished; all further ones count as one kind.
const MOST_KINDS: usize = 64;
const MOST_OF_A_NOTE: usize = 1000;

/// A kind of message over a run, or within one recording.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Note {
    /// Text of the first message of the kind.
    pub what: String,
    /// The recording that the first message is about.
    pub first: String,
    /// How often such a message came, and in how many recordings.
    pub times: u64,
    pub recordings: u64,
}

/// The messages of a run by kind, in the order in which kinds were met.
#[derive(Debug, Default)]
pub struct Notes {
    /// Index in `list` by kind.
    places: HashMap<String, usize>,
    pub list: Vec<Note>,
}

impl Notes {
    /// Counts a message about a recording; returns whether it is the first of its kind in this run.
    pub fn add(&mut self, recording: &str, message: &CountedMessage) -> bool {
        self.count(&message.what, message.times, || [message.what.clone(), recording.into()])
    }

    /// Counts messages of the kind of `what`; returns whether the kind is new. `first`: text and recording
    /// of a new kind. Beyond [`MOST_KINDS`] all new kinds are one.
    fn count(&mut self, what: &str, times: u64, first: impl FnOnce() -> [String; 2]) -> bool {
        // the empty kind takes everything beyond the limit
        let (mut kind, met) = (kind(what), self.list.len());
        if met >= MOST_KINDS && !self.places.contains_key(&kind) {
            kind.clear();
        }
        let place = *self.places.entry(kind).or_insert(met);
        if place == met {
            let [what, first] = first();
            self.list.push(Note { what, first, times: 0, recordings: 0 });
        }
        self.list[place].times += times;
        self.list[place].recordings += 1;
        place == met
    }
}

/// The kind of a message: its text with each number (digits, and points between or after them)
/// replaced by `#`.
fn kind(what: &str) -> String {
    let mut kind = String::new();
    let mut in_number = false;
    for c in what.chars() {
        let was_in_number = in_number;
        in_number = c.is_ascii_digit() || (in_number && c == '.');
        if !(in_number && was_in_number) {
            kind.push(if in_number { '#' } else { c });
        }
    }
    kind
}

/// Counts messages by kind, which the text alone decides. Each message is a place and a text; for
/// each kind the place and the text of its first message are told.
fn counted(all: impl Iterator<Item = (String, String)>) -> Vec<CountedMessage> {
    let mut kinds = Notes::default();
    for (place, what) in all {
        let first = || printable::line(&format!("{place}{what}"), MOST_OF_A_NOTE);
        kinds.count(&what, 1, || [first(), String::new()]);
    }
    let message = |Note { what, times, .. }| CountedMessage { what, times };
    kinds.list.into_iter().map(message).collect()
}

/// Messages about what makes a recording's verdicts less certain or fewer.
pub fn warnings(report: &RecordingReport) -> Vec<CountedMessage> {
    let of = |printhead: &str| printable::cell(printhead);
    // a window that was refused because all channels drifted is left out, if the drift itself is
    // told of its printhead
    let refusals =
        report.refusals.iter().filter(|r| !(r.drifted && report.has_moved(&r.printhead)));
    let refused = refusals.map(|refusal| {
        let (head, from) = (of(&refusal.printhead), clock(refusal.from_ns));
        (format!("window of {head} at {from}: "), refusal.why.clone())
    });
    let warned = report.warnings.iter().map(|(p, what)| (format!("{}: ", of(p)), what.clone()));
    counted(refused.chain(warned))
}

/// Sentences that whoever asked for quiet is told, too: about clocks that were set and bursts that are dated apart, for
/// times decide what the verdicts are about; and about what nothing reads though it looks like bursts, for silence
/// about that would be taken for health.
pub fn always(report: &RecordingReport) -> Vec<CountedMessage> {
    let all = report.odd_times.iter().chain(&report.unread);
    counted(all.map(|of| (String::new(), of.what.clone())))
}

/// Messages about what does not affect the verdicts that there are: a recording that was judged before it was
/// closed.
pub fn notes(report: &RecordingReport) -> Vec<CountedMessage> {
    let cut_off = report.cut_off.then(|| {
        "the recording was not closed: it is judged as far as it was complete; replay it when its recorder has \
         closed it"
            .to_owned()
    });
    counted(cut_off.into_iter().map(|what| (String::new(), what)))
}

/// Sentences about parts of which nothing, or less than half, could be judged.
pub fn not_judged(report: &RecordingReport) -> Vec<String> {
    report.not_judged.iter().map(|of| printable::line(&of.what, MOST_OF_A_NOTE)).collect()
}

pub fn damage(report: &RecordingReport) -> Vec<CountedMessage> {
    let message = |damage: &Damage| (format!("{}: ", damage.place()), damage.what.clone());
    counted(report.damage.iter().map(message))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_kind_is_told_once_and_counted() {
        let all = ["12.5 K off", "3 K off", "lost"].map(|what| ("at 7: ".into(), what.to_owned()));
        let messages = counted(all.into_iter());
        assert_eq!(messages.iter().map(|t| t.times).collect::<Vec<_>>(), [2, 1]);
        assert_eq!(messages[0].what, "at 7: 12.5 K off");
        let mut notes = Notes::default();
        assert!(
            notes.add("a", &messages[0])
                && !notes.add("b", &messages[0])
                && notes.add("b", &messages[1])
        );
        let note = &notes.list[0];
        assert_eq!((note.times, note.recordings, note.first.as_str()), (4, 2, "a"));
        for i in 0..10_000u32 {
            let letters: String = i.to_string().bytes().map(|b| char::from(b + 49)).collect();
            notes.add("c", &CountedMessage { what: letters, times: 1 });
        }
        assert!(notes.list.len() <= MOST_KINDS + 1);
    }
}
