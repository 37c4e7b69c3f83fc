//! Output of results: to stdout, as text or as one JSON line per event, or to nowhere with
//! `--quiet`. All verbs write by these functions, so that `--quiet` and `--json` mean the same
//! everywhere. What is *told* beside the result (warnings, progress) goes to stderr, by `progress`.
//!
//! The JSON of an event has the keys that `schemas/journal.md` lists.

use crate::pipeline::{EpisodeEvent, rfc3339};
use serde_json::{Value, json};
use std::io::{self, Write};
use std::sync::atomic::{AtomicBool, Ordering};

/// Whether `--quiet` is given; of the whole process.
static QUIET: AtomicBool = AtomicBool::new(false);

/// From now on only failures are told, on stderr.
pub fn be_quiet() {
    QUIET.store(true, Ordering::Relaxed);
}

pub fn is_quiet() -> bool {
    QUIET.load(Ordering::Relaxed)
}

/// Stdout, or nowhere with `--quiet`, for verbs whose result is a file.
pub fn report() -> Box<dyn Write> {
    result(true)
}

/// The same as [`report`] for a verb that writes its result to a file (`is_file`) or else to stdout, which
/// `--quiet` does not silence.
pub fn result(is_file: bool) -> Box<dyn Write> {
    if is_file && is_quiet() { Box::new(io::sink()) } else { Box::new(io::stdout().lock()) }
}

/// Writes what has just happened to stdout, for whoever reads along: as a line of JSON, also with
/// `--quiet`, or as a line of text.
pub fn tell(
    json: bool,
    document: impl FnOnce() -> Value,
    text: impl FnOnce() -> String,
) -> io::Result<()> {
    if json {
        return event(&document());
    }
    let mut out = report();
    writeln!(out, "{}", text())?;
    out.flush()
}

/// Writes an event as one line of JSON to stdout, also with `--quiet`.
pub fn event(of: &impl serde::Serialize) -> io::Result<()> {
    let mut line = serde_json::to_string(of)?;
    line.push('\n');
    let mut out = io::stdout().lock();
    out.write_all(line.as_bytes())?;
    out.flush() // whoever reads along waits for lines
}

/// Columns of the table of episodes that are only known when an episode has ended.
const UNKNOWN_AT_FIRST: [&str; 3] = ["ended_at", "severity_first", "severity_max"];

/// The event of an episode as JSON, with the columns of the table of episodes as keys. A revised or
/// withdrawn episode has the earlier one under `revises`.
pub fn episode_event(recording: &str, happened: EpisodeEvent) -> Value {
    // a withdrawn episode is both the one that is told and the one that it revises
    let (episode, before) = match happened {
        EpisodeEvent::Raised(now) | EpisodeEvent::Ended(now) => (now, None),
        EpisodeEvent::Revised { now, before } => (now, Some(before)),
        EpisodeEvent::Withdrawn(before) => (before, Some(before)),
    };
    let mut event = json!(episode);
    if let Some(keys) = event.as_object_mut() {
        keys.retain(|key, _| !UNKNOWN_AT_FIRST.contains(&key.as_str()));
    }
    let is_withdrawn = matches!(happened, EpisodeEvent::Withdrawn(_));
    event["event"] = json!(if is_withdrawn { "withdrawn" } else { "episode" });
    event["recording"] = json!(recording);
    event["raised_at"] = json!(rfc3339(episode.raised_at_ns));
    event["began_at"] = json!(rfc3339(episode.began_at_ns));
    if let Some(before) = before {
        event["revises"] = json!({
            "raised_at": rfc3339(before.raised_at_ns),
            "category": before.category,
            "fault": before.fault,
            "explanation": before.explanation,
        });
    }
    event
}
