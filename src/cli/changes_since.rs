//! `inkling report --changes-since RUN`: the changes since an earlier run, short enough for a mail: faults
//! that are new, worse or cured, and what was not judged. In: the earlier `run.json` and a report. Out: text
//! or JSON.

use super::account::{RUN_NAME, Row};
use super::exit::Failure;
use super::lost;
use super::progress::thousands;
use super::report::printable;
use crate::pipeline::rfc3339;
use crate::report::{Changes, Fault, Report, clock};
use inkling_io::file_error::FileError;
use inkling_io::inputs::Input;
use inkling_io::journal::{Entry, Means};
use inkling_io::{printable, regular_file, result_file};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Most bytes of a `run.json` that are read: one of a hundred thousand recordings takes some 30 MB.
const MOST_BYTES: u64 = 256 << 20;
/// Most lines of each kind of change.
const MOST_LISTED: usize = 20;

/// An earlier run, as its `run.json` describes it.
#[derive(Debug, Deserialize)]
pub struct EarlierRun {
    #[serde(flatten)]
    by: Option<Means>,
    recordings: Vec<Row>,
    /// The present entries of the journal for the report's tables, by name ([`lost::entries`]).
    #[serde(skip)]
    now: BTreeMap<String, Arc<Entry>>,
}

/// Whether a row is of the recording that a report calls `name`. Both are relative paths, perhaps from
/// different directories, so that one has to end with the other.
fn is_of(row: &Row, name: &str) -> bool {
    let place = |place: &str| {
        let place = place.strip_suffix(".verdicts.parquet").unwrap_or(place);
        let (place, name) = (Path::new(place), Path::new(name));
        place.ends_with(name) || name.ends_with(place)
    };
    row.verdicts.as_deref().is_some_and(place)
}

impl EarlierRun {
    /// Reads the `run.json` at `run`, or in that directory. `tables`: the verdict tables of the report.
    pub fn read(run: &Path, tables: &[Input]) -> Result<EarlierRun, Failure> {
        let path = if run.is_dir() { run.join(RUN_NAME) } else { run.to_path_buf() };
        let failed = |what: String| Failure::usage(format!("{}: {what}", path.display()));
        let text = regular_file::read(&path, MOST_BYTES).map_err(FileError::unread(&path))?;
        let earlier = serde_json::from_slice::<EarlierRun>(&text).map_err(|e| {
            let what = match result_file::instead(&path) {
                instead if instead.is_empty() => format!(": {}", printable::of_parser(&e)),
                instead => instead,
            };
            failed(format!("not the {RUN_NAME} of a replay{what}"))
        })?;
        Ok(EarlierRun { now: lost::entries(tables), ..earlier })
    }

    /// Whether the earlier run has a row for the recording of that name.
    fn named(&self, name: &str) -> bool {
        self.recordings.iter().any(|row| is_of(row, name))
    }

    /// Whether the results of that name are those of the earlier run: judged by then, and not judged again
    /// since.
    fn has_results(&self, name: &str) -> bool {
        let had = |row: &&Row| is_of(row, name) && row.outcome.is_judged();
        let Some(then) = self.recordings.iter().find(had) else { return false };
        match (self.now.get(name), &then.judged_at) {
            (Some(now), Some(at)) => {
                *at == now.at
                    && then.digest == now.recording.digest
                    && self.by.as_ref().is_none_or(|by| *by == now.by)
            }
            // a `run.json` of an earlier version, or no journal: taken for the same results
            _ => true,
        }
    }

    /// Whether the earlier run was given a recording of that file name.
    fn was_given(&self, name: &str) -> bool {
        self.recordings.iter().any(|row| Path::new(&row.recording).ends_with(name))
    }
}

/// What has changed since an earlier run, according to later runs.
pub struct ChangesSince<'a> {
    run: PathBuf,
    changes: Changes<'a>,
    /// Recordings and printheads that were not judged since then, and why.
    unjudged: Vec<Unjudged>,
}

#[derive(Serialize)]
struct Unjudged {
    what: String,
    why: String,
}

impl Unjudged {
    fn new(what: &str, why: &str) -> Unjudged {
        Unjudged { what: what.into(), why: why.into() }
    }
}

impl<'a> ChangesSince<'a> {
    /// The changes since the earlier run. It is a mistake of usage if that run has no recording in common
    /// with the report.
    pub fn of(
        run: &Path,
        earlier: &EarlierRun,
        report: &'a Report,
    ) -> Result<ChangesSince<'a>, Failure> {
        let has_results = |name: &str| earlier.has_results(name);
        let (lines, faults) = (&report.recordings, &report.faults);
        if !lines.iter().any(|line| earlier.named(&line.name)) {
            return Err(Failure::usage(format!(
                "{}: none of that run's recordings is among these results: give the {RUN_NAME} of an earlier run that \
                 wrote some of them",
                run.display()
            )));
        }
        // what was not judged since: printheads, parts of recordings, and recordings that the earlier run did
        // not have
        let changes = Changes::since(lines, faults, has_results);
        let silent = changes.silent.iter().filter(|_| changes.recordings > 0);
        let silent = silent.map(|name| Unjudged::new(name, "not judged in any recording since"));
        let gaps = report.coverage.gaps.iter().filter(|gap| !has_results(&gap.recording));
        let gaps = gaps.map(|gap| Unjudged::new(&gap.recording, &gap.what));
        let lost = report.coverage.lost.iter().filter(|lost| !earlier.was_given(&lost.name));
        let lost = lost.map(|lost| Unjudged::new(&lost.name, &lost.why));
        let unjudged = silent.chain(gaps).chain(lost).collect();
        Ok(ChangesSince { run: run.to_path_buf(), changes, unjudged })
    }

    /// The changes as JSON.
    pub fn as_json(&self) -> Value {
        let Changes { from_ns, to_ns, recordings, still, .. } = &self.changes;
        let mut told = json!({
            "since": self.run,
            "from": (*recordings > 0).then(|| rfc3339(*from_ns)),
            "to": (*recordings > 0).then(|| rfc3339(*to_ns)),
            "recordings": recordings,
            "still": still,
        });
        for (key, _, faults) in self.changes.kinds() {
            told[key] = faults.iter().map(|fault| as_json(fault)).collect();
        }
        told["unjudged"] = json!(self.unjudged);
        told
    }

    /// Prints the changes as text.
    pub fn print(&self, out: &mut impl Write) -> std::io::Result<()> {
        let Changes { from_ns, to_ns, recordings, still, .. } = &self.changes;
        let plural = if *recordings == 1 { "" } else { "s" };
        let (count, from, to) = (thousands(*recordings as u64), clock(*from_ns), clock(*to_ns));
        match recordings {
            0 => writeln!(out, "no recording has verdicts that it had not at that run")?,
            _ => {
                writeln!(out, "{count} recording{plural} since that run, from {from} to {to} UTC")?
            }
        }
        for (_, words, faults) in self.changes.kinds() {
            let told = |fault: &&Fault| {
                let channel = fault.story.channel;
                let head = printable(&fault.story.printhead);
                // the line names the channel already
                let sentence = fault.sentence.replacen(&format!("channel {channel}: "), "", 1);
                format!("{head} channel {channel}: {}", printable::line(&sentence, 600))
            };
            list(out, words, faults.iter().map(told))?;
        }
        let told = |Unjudged { what, why }: &Unjudged| {
            format!("{}: {}", printable::line(what, 200), printable::line(why, 600))
        };
        list(out, "not judged", self.unjudged.iter().map(told))?;
        if *recordings > 0 && self.changes.kinds().iter().all(|(.., faults)| faults.is_empty()) {
            writeln!(out, "no change, of what was judged")?;
        }
        match *still {
            0 => Ok(()),
            1 => writeln!(out, "1 channel to clean as before"),
            n => writeln!(out, "{} channels to clean as before", thousands(n as u64)),
        }
    }
}

/// Prints a kind of change: its number, its first lines, and how many more there are.
fn list(
    out: &mut impl Write,
    words: &str,
    lines: impl ExactSizeIterator<Item = String>,
) -> std::io::Result<()> {
    let all = lines.len();
    if all > 0 {
        writeln!(out, "{words}: {}", thousands(all as u64))?;
    }
    for line in lines.take(MOST_LISTED) {
        writeln!(out, "  {line}")?;
    }
    match all.saturating_sub(MOST_LISTED) {
        0 => Ok(()),
        more => writeln!(out, "  and {} more", thousands(more as u64)),
    }
}

/// A fault as JSON, with the names of the columns of `report.faults.parquet`.
pub fn as_json(fault: &Fault) -> serde_json::Value {
    let story = &fault.story;
    json!({
        "printhead": story.printhead.to_string(),
        "channel": story.channel,
        "category": story.category,
        "fault": story.fault,
        "began_at": rfc3339(story.began_at_ns),
        "ended_at": story.ended_at_ns.map(rfc3339),
        "severity_last": story.severity_last,
        "certainty": story.certainty,
        "urgency": fault.urgency,
        "action": fault.action,
        "sentence": fault.sentence,
    })
}
