//! Output of results: to stdout, as text or as one JSON line per event, or to nowhere with
//! `--quiet`. All verbs write by these functions, so that `--quiet` and `--json` mean the same
//! everywhere. What is *told* beside the result (warnings, progress) goes to stderr, by `progress`.
//!
//! The JSON of an event has the keys that `schemas/journal.md` lists.

use crate::pipeline::{EpisodeEvent, rfc3339};
use serde_json::{Value, json};
use std::io::{self, StdoutLock, Write};
use std::sync::atomic::{AtomicBool, Ordering};

/// Whether `--quiet` is given; of the whole process.
static QUIET: AtomicBool = AtomicBool::new(false);

/// From now on only failures are told, on stderr.
pub fn be_quiet() {
    QUIET.store(true, Ordering::Relaxed);
}

/// Whether only failures are to be told.
pub fn is_quiet() -> bool {
    QUIET.load(Ordering::Relaxed)
}

/// Stdout, or nowhere with `--quiet`, for verbs whose result is a file. If stdout is the result itself, this
/// is not used.
pub fn report() -> Report {
    Report((!is_quiet()).then(|| io::stdout().lock()))
}

/// The same as [`report`] for a verb that writes its result to a file (`is_file`) or else to stdout, which
/// `--quiet` does not silence.
pub fn result(is_file: bool) -> Report {
    if is_file { report() } else { Report(Some(io::stdout().lock())) }
}

/// A writer to stdout, or to nowhere.
pub struct Report(Option<StdoutLock<'static>>);

impl Write for Report {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.as_mut().map_or(Ok(bytes.len()), |out| out.write(bytes))
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.as_mut().map_or(Ok(()), Write::flush)
    }
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

/// The event of an episode as JSON. A revised or withdrawn episode has the earlier one under `revises`.
pub fn episode_event(recording: &str, happened: EpisodeEvent) -> Value {
    // a withdrawn episode is both the one that is told and the one that it revises
    let (episode, before) = match happened {
        EpisodeEvent::Raised(now) | EpisodeEvent::Ended(now) => (now, None),
        EpisodeEvent::Revised { now, before } => (now, Some(before)),
        EpisodeEvent::Withdrawn(before) => (before, Some(before)),
    };
    // the keys of the table of episodes, without those that are only known when the episode has
    // ended
    let mut event = json!(episode);
    let untold = ["ended_at", "severity_first", "severity_max"];
    if let Some(keys) = event.as_object_mut() {
        keys.retain(|key, _| !untold.contains(&key.as_str()));
    }
    event["event"] = json!("episode");
    event["recording"] = json!(recording);
    event["raised_at"] = json!(rfc3339(episode.raised_at_ns));
    event["began_at"] = json!(rfc3339(episode.began_at_ns));
    if let Some(before) = before {
        let (raised_at, explanation) = (rfc3339(before.raised_at_ns), &before.explanation);
        event["revises"] = json!({
            "raised_at": raised_at,
            "category": before.category,
            "fault": before.fault,
            "explanation": explanation,
        });
    }
    if let EpisodeEvent::Withdrawn(_) = happened {
        event["event"] = json!("withdrawn");
    }
    event
}
