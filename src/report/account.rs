//! The account of all recordings: everything that is told of them, as one document, `account.json`
//! (`schemas/account.md`). Page, terminal and mail put the same [`Report`] into words.
//!
//! In: a [`Report`]. Out: an [`Account`], which serialises to JSON. Each statement says, where that is known, as of
//! when it holds, on how many signals it rests, and in which rows these stand. Only words and names are chosen here: no
//! figure is computed but sums.

use super::coverage::Gap;
use super::fault::{Fault, instead_in_words, is_named_now};
use super::head_changes::HeadChange;
use super::source::LostRecording;
use super::watch::Spell;
use super::words::rfc3339;
use super::{RecordingLine, Report, certain_trend, hours_to_visible};
use serde::ser::SerializeMap;
use serde::{Serialize, Serializer};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Version of the document.
pub const VERSION: u32 = 1;

/// The document.
#[derive(Debug, Serialize)]
pub struct Account<'a> {
    version: u32,
    inkling: &'static str,
    /// The time of the latest signal, RFC 3339; `None`: there is none.
    as_of: Option<String>,
    /// Whether everything in the recordings was judged, and no recording is damaged or incomplete.
    complete: bool,
    signals: Signals,
    recordings: Vec<Recording<'a>>,
    printheads: Vec<Printhead<'a>>,
    /// What is told, in the order in which it is told: what was not judged, what happened to printheads, notes, and faults,
    /// the most urgent first, as the report has them.
    statements: Vec<Statement<'a>>,
}

#[derive(Debug, Serialize)]
struct Signals {
    judged: u64,
    not_judged: u64,
}

#[derive(Debug)]
struct Recording<'a>(&'a RecordingLine);

impl Serialize for Recording<'_> {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        let Recording(line) = self;
        let mut of = to.serialize_map(None)?;
        of.serialize_entry("recording", &line.name)?;
        of.serialize_entry("from", &line.span.map(|span| rfc3339(span.0)))?;
        of.serialize_entry("to", &line.span.map(|span| rfc3339(span.1)))?;
        of.serialize_entry("judged", &line.judged)?;
        of.serialize_entry("not_judged", &line.rejected())?;
        // what is wrong with its data; empty: nothing
        of.serialize_entry("flaws", &line.flaws)?;
        of.end()
    }
}

/// A printhead over all recordings.
#[derive(Debug, Serialize)]
struct Printhead<'a> {
    printhead: &'a str,
    /// Number of channels that have signals.
    channels: usize,
    judged: u64,
    not_judged: u64,
}

/// What a statement is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
enum Kind {
    /// Something of which nothing, or too little, was judged.
    NotJudged,
    /// A recording without verdicts.
    Lost,
    /// All channels of a printhead moved together, it is another one, or one of its channels was replaced.
    HeadChange,
    /// What the reader should know before anything is cleaned.
    Note,
    /// A fault that is to be seen to.
    Fault,
    /// A fault that is over, or that another one of the channel followed.
    PastFault,
}

#[derive(Debug, Serialize)]
struct Statement<'a> {
    kind: Kind,
    sentence: &'a str,
    /// The time as of which it holds, RFC 3339.
    as_of: Option<String>,
    /// Number of signals that it rests on.
    signals: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    printhead: Option<&'a str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    channel: Option<u32>,
    /// Where the signals stand that it rests on.
    rows: Rows<'a>,
    #[serde(skip_serializing_if = "Option::is_none")]
    fault: Option<FaultNow<'a>>,
}

/// Rows of the verdict tables: those of the statement's printhead and channel in these recordings, from and to
/// these times.
#[derive(Debug, Default, Serialize)]
struct Rows<'a> {
    recordings: Vec<&'a str>,
    from: Option<String>,
    to: Option<String>,
}

/// What is known of a fault. The sizes are in the unit of its class (`schemas/verdicts.md`).
#[derive(Debug)]
struct FaultNow<'a>(&'a Fault);

impl Serialize for FaultNow<'_> {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        let FaultNow(Fault { story, urgency, action, .. }) = self;
        let (trend, is_named) =
            (certain_trend(story).map(|trend| trend.per_day), is_named_now(story));
        let is_sized = story.severity_last.is_some();
        let mut of = to.serialize_map(None)?;
        of.serialize_entry("category", &story.category)?;
        of.serialize_entry("fault", &story.fault)?;
        // whether present signals carry that name
        of.serialize_entry("is_named_now", &is_named)?;
        of.serialize_entry("certainty", &story.certainty)?;
        of.serialize_entry("severity", &story.severity_last)?;
        of.serialize_entry("severity_sd", &story.severity_sd)?;
        of.serialize_entry("severity_per_day", &trend.filter(|_| is_sized))?;
        // the size that it had at `as_of`, where present signals carry no name
        of.serialize_entry("last_known_severity", &story.lost.and_then(|of| of.severity))?;
        // what is known instead of a name, in words
        of.serialize_entry("instead", &instead_in_words(story))?;
        // from healthy, in distances of the threshold
        of.serialize_entry("distance", &story.distance)?;
        of.serialize_entry("distance_per_day", &trend.filter(|_| !is_named))?;
        of.serialize_entry("hours_to_visible", &hours_to_visible(story).map(|(hours, _)| hours))?;
        of.serialize_entry("began_at", &rfc3339(story.began_at_ns))?;
        of.serialize_entry("ended_at", &story.ended_at_ns.map(rfc3339))?;
        // from 0 to 1, by the formula in `fault.rs`
        of.serialize_entry("urgency", urgency)?;
        of.serialize_entry("action", action)?;
        // the note of whoever acknowledged that the fault is known
        of.serialize_entry("acknowledged", &story.known)?;
        of.end()
    }
}

impl Report {
    pub fn account(&self) -> Account<'_> {
        let lines: BTreeMap<usize, &RecordingLine> =
            self.recordings.iter().map(|line| (line.source, line)).collect();
        let gaps = self.coverage.gaps.iter().map(|gap| of_gap(gap, &lines));
        let lost = self.coverage.lost.iter().map(of_lost);
        let heads = self.head_changes.iter().map(of_head);
        let notes = self.notes.iter().map(|note| Statement {
            printhead: note.printhead.as_deref(),
            ..Statement::new(Kind::Note, &note.what)
        });
        let faults = self.faults.iter().map(|fault| of_fault(fault, &lines));
        let statements = gaps.chain(lost).chain(heads).chain(notes).chain(faults).collect();
        let printheads = self.survey.heads_with_signals().map(|head| {
            let (judged, not_judged) =
                head.tallies.values().fold((0, 0), |(n, m), of| (n + of.judged, m + of.rejected));
            Printhead { printhead: &head.name, channels: head.channels.len(), judged, not_judged }
        });
        let to_ns = self.recordings.iter().filter_map(|line| line.span).map(|span| span.1).max();
        Account {
            version: VERSION,
            inkling: env!("CARGO_PKG_VERSION"),
            as_of: to_ns.map(rfc3339),
            complete: self.coverage.is_complete(),
            signals: Signals { judged: self.coverage.judged, not_judged: self.coverage.not_judged },
            recordings: self.recordings.iter().map(Recording).collect(),
            printheads: printheads.collect(),
            statements,
        }
    }
}

impl<'a> Statement<'a> {
    fn new(kind: Kind, sentence: &'a str) -> Statement<'a> {
        let rows = Rows::default();
        let (as_of, signals, printhead, channel, fault) = (None, None, None, None, None);
        Statement { kind, sentence, as_of, signals, printhead, channel, rows, fault }
    }
}

fn of_gap<'a>(gap: &'a Gap, lines: &BTreeMap<usize, &'a RecordingLine>) -> Statement<'a> {
    let line = lines.get(&gap.source);
    let span = line.and_then(|line| line.span);
    let head = gap.printhead.as_deref();
    let of_head = line.zip(gap.printhead.as_ref()).and_then(|(line, of)| line.heads.get(of));
    Statement {
        as_of: span.map(|span| rfc3339(span.1)),
        signals: of_head.map(|of| of.tally.signals()),
        printhead: head,
        rows: Rows {
            recordings: vec![&gap.recording],
            from: span.map(|span| rfc3339(span.0)),
            to: span.map(|span| rfc3339(span.1)),
        },
        ..Statement::new(Kind::NotJudged, &gap.what)
    }
}

fn of_lost(lost: &LostRecording) -> Statement<'_> {
    let rows = Rows { recordings: vec![&lost.name], ..Rows::default() };
    Statement { rows, signals: Some(0), ..Statement::new(Kind::Lost, &lost.why) }
}

fn of_head(of: &HeadChange) -> Statement<'_> {
    Statement {
        as_of: of.as_of_ns.map(rfc3339),
        printhead: Some(&of.printhead),
        rows: Rows { recordings: vec![&of.recording], ..Rows::default() },
        ..Statement::new(Kind::HeadChange, &of.what)
    }
}

fn of_fault<'a>(of: &'a Fault, lines: &BTreeMap<usize, &'a RecordingLine>) -> Statement<'a> {
    let story = &of.story;
    let mut recordings: Vec<&str> = story
        .spells
        .iter()
        .filter_map(|Spell { recording, .. }| Some(lines.get(recording)?.name.as_str()))
        .collect();
    recordings.dedup();
    let last_ns = story.spells.iter().filter_map(|spell| spell.counts.last_flagged_ns).max();
    let printhead: &Arc<str> = &story.printhead;
    Statement {
        as_of: Some(rfc3339(story.known_at_ns)),
        signals: Some(story.spells.iter().map(|spell| spell.counts.flagged).sum()),
        printhead: Some(printhead),
        channel: Some(story.channel),
        rows: Rows { recordings, from: Some(rfc3339(story.began_at_ns)), to: last_ns.map(rfc3339) },
        fault: Some(FaultNow(of)),
        ..Statement::new(if of.is_open() { Kind::Fault } else { Kind::PastFault }, &of.sentence)
    }
}
