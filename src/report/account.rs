//! The account of all recordings: everything that is told of them, as one document, `account.json`
//! (`schemas/account.md` explains its keys). Page, terminal and mail put the same [`Report`] into words.
//!
//! In: a [`Report`]. Out: the document. Each statement says, where that is known, as of when it holds, on how many
//! signals it rests, and in which rows these stand. Only words and names are chosen here: no figure is computed but sums.

use super::coverage::Gap;
use super::fault::{Fault, instead_in_words, is_named_now};
use super::head_changes::HeadChange;
use super::night::Span;
use super::source::LostRecording;
use super::survey::Head;
use super::watch::Spell;
use super::words::rfc3339;
use super::{RecordingLine, Report, certain_trend, hours_to_visible};
use serde::Serialize;
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// Version of the document.
pub const VERSION: u32 = 1;

/// The recordings by their indices among the sources.
type Lines<'a> = BTreeMap<usize, &'a RecordingLine>;

#[derive(Debug, Default, Serialize)]
struct Statement<'a> {
    /// `not_judged`, `lost`, `head_change`, `note`, `fault` or `past_fault`.
    kind: &'static str,
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
    fault: Option<Value>,
}

/// Rows of the verdict tables: those of the statement's printhead and channel in these recordings, from and to
/// these times.
#[derive(Debug, Default, Serialize)]
struct Rows<'a> {
    recordings: Vec<&'a str>,
    from: Option<String>,
    to: Option<String>,
}

impl Report {
    /// What is told stands in the order in which it is told: what was not judged, what happened to printheads,
    /// notes, and faults, the most urgent first, as the report has them.
    pub fn account(&self) -> Value {
        let lines: Lines = self.recordings.iter().map(|line| (line.source, line)).collect();
        let gaps = self.coverage.gaps.iter().map(|gap| of_gap(gap, &lines));
        let lost = self.coverage.lost.iter().map(of_lost);
        let heads = self.head_changes.iter().map(of_head);
        let notes = self.notes.iter().map(|note| Statement {
            kind: "note",
            sentence: &note.what,
            printhead: note.printhead.as_deref(),
            ..Statement::default()
        });
        let faults = self.faults.iter().map(|fault| of_fault(fault, &lines));
        let statements = gaps.chain(lost).chain(heads).chain(notes).chain(faults);
        let to_ns = self.recordings.iter().filter_map(|line| line.span).map(|span| span.1).max();
        json!({
            "version": VERSION,
            "inkling": env!("CARGO_PKG_VERSION"),
            // of the latest signal
            "as_of": to_ns.map(rfc3339),
            "complete": self.coverage.is_complete(),
            "signals": { "judged": self.coverage.judged, "not_judged": self.coverage.not_judged },
            "recordings": self.recordings.iter().map(recording).collect::<Value>(),
            "printheads": self.survey.heads_with_signals().map(printhead).collect::<Value>(),
            "statements": statements.collect::<Vec<_>>(),
        })
    }
}

fn recording(line: &RecordingLine) -> Value {
    json!({
        "recording": line.name,
        "from": line.span.map(begin),
        "to": line.span.map(end),
        "judged": line.judged,
        "not_judged": line.rejected(),
        "flaws": line.flaws,
    })
}

/// A printhead over all recordings.
fn printhead(head: &Head) -> Value {
    let tallies = head.tallies.values();
    let (judged, not_judged) = tallies.fold((0, 0), |(n, m), of| (n + of.judged, m + of.rejected));
    json!({
        "printhead": &*head.name,
        "channels": head.channels.len(),
        "judged": judged,
        "not_judged": not_judged,
    })
}

fn begin(span: Span) -> String {
    rfc3339(span.0)
}

fn end(span: Span) -> String {
    rfc3339(span.1)
}

fn of_gap<'a>(gap: &'a Gap, lines: &Lines) -> Statement<'a> {
    let line = lines.get(&gap.source);
    let span = line.and_then(|line| line.span);
    let of_head = line.zip(gap.printhead.as_ref()).and_then(|(line, of)| line.heads.get(of));
    Statement {
        kind: "not_judged",
        sentence: &gap.what,
        as_of: span.map(end),
        signals: of_head.map(|of| of.tally.signals()),
        printhead: gap.printhead.as_deref(),
        rows: Rows { recordings: vec![&gap.recording], from: span.map(begin), to: span.map(end) },
        ..Statement::default()
    }
}

fn of_lost(lost: &LostRecording) -> Statement<'_> {
    Statement {
        kind: "lost",
        sentence: &lost.why,
        signals: Some(0),
        rows: Rows { recordings: vec![&lost.name], ..Rows::default() },
        ..Statement::default()
    }
}

fn of_head(of: &HeadChange) -> Statement<'_> {
    Statement {
        kind: "head_change",
        sentence: &of.what,
        as_of: of.as_of_ns.map(rfc3339),
        printhead: Some(&of.printhead),
        rows: Rows { recordings: vec![&of.recording], ..Rows::default() },
        ..Statement::default()
    }
}

fn of_fault<'a>(of: &'a Fault, lines: &Lines<'a>) -> Statement<'a> {
    let story = &of.story;
    let name = |Spell { recording, .. }: &Spell| Some(lines.get(recording)?.name.as_str());
    let mut recordings: Vec<&str> = story.spells.iter().filter_map(name).collect();
    recordings.dedup();
    let last_ns = story.spells.iter().filter_map(|spell| spell.counts.last_flagged_ns).max();
    Statement {
        kind: if of.is_open() { "fault" } else { "past_fault" },
        sentence: &of.sentence,
        as_of: Some(rfc3339(story.known_at_ns)),
        signals: Some(story.spells.iter().map(|spell| spell.counts.flagged).sum()),
        printhead: Some(&story.printhead),
        channel: Some(story.channel),
        rows: Rows { recordings, from: Some(rfc3339(story.began_at_ns)), to: last_ns.map(rfc3339) },
        fault: Some(known(of)),
    }
}

/// What is known of a fault. The sizes are in the unit of its class (`schemas/verdicts.md`).
fn known(Fault { story, urgency, action, .. }: &Fault) -> Value {
    let trend = certain_trend(story).map(|trend| trend.per_day);
    let (is_named, is_sized) = (is_named_now(story), story.severity_last.is_some());
    json!({
        "category": story.category,
        "fault": story.fault,
        "is_named_now": is_named,
        "certainty": story.certainty,
        "severity": story.severity_last,
        "severity_sd": story.severity_sd,
        "severity_per_day": trend.filter(|_| is_sized),
        "last_known_severity": story.lost.and_then(|of| of.severity),
        "instead": instead_in_words(story),
        "distance": story.distance,
        "distance_per_day": trend.filter(|_| !is_named),
        "hours_to_visible": hours_to_visible(story).map(|(hours, _)| hours),
        "began_at": rfc3339(story.began_at_ns),
        "ended_at": story.ended_at_ns.map(rfc3339),
        "urgency": urgency,
        "action": action,
        "acknowledged": story.known,
    })
}
