//! `inkling report --changes-since RUN`: what a mail says of a night: what is new, worse, cured, and of what nothing is
//! known since an earlier run.

use super::account::RUN_NAME;
use super::exit::Failure;
use super::lost;
use super::progress::thousands;
use super::report::printable;
use crate::pipeline::rfc3339;
use crate::report::{Changes, Fault, Report, clock};
use chrono::DateTime;
use inkling_io::inputs::Input;
use inkling_io::journal::{Entry, Means, Outcome};
use inkling_io::{printable, regular_file, result_file};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A `run.json` of a hundred thousand recordings takes some 30 MB.
const MOST_BYTES: u64 = 256 << 20;
/// Lines of each kind.
const MOST_LISTED: usize = 20;

/// An earlier run, as its `run.json` describes it.
#[derive(Debug, Deserialize)]
pub struct EarlierRun {
    #[serde(flatten)]
    by: Option<Means>,
    recordings: Vec<Row>,
    /// The journal's entries for these tables as they are now ([`lost::entries`]).
    #[serde(skip)]
    now: BTreeMap<String, Arc<Entry>>,
}

#[derive(Debug, Deserialize)]
struct Row {
    recording: String,
    outcome: Option<Outcome>,
    verdicts: Option<String>,
    judged_at: Option<String>,
    digest: Option<String>,
}

impl Row {
    /// Whether it is of the results of that name, below what a report was asked for.
    fn names(&self, name: &str) -> bool {
        let place = |place: &str| {
            let place = place.strip_suffix(".verdicts.parquet").unwrap_or(place);
            let (place, name) = (Path::new(place), Path::new(name));
            place.ends_with(name) || name.ends_with(place)
        };
        self.verdicts.as_deref().is_some_and(place)
    }
}

impl EarlierRun {
    /// Reads the `run.json` at `run`, or in that directory. `tables`: those that the report is of.
    pub fn read(run: &Path, tables: &[Input]) -> Result<EarlierRun, Failure> {
        let path = if run.is_dir() { run.join(RUN_NAME) } else { run.to_path_buf() };
        let failed = |what: String| Failure::usage(format!("{}: {what}", path.display()));
        let text = regular_file::read(&path, MOST_BYTES)
            .map_err(|e| failed(format!("cannot be read: {e}")))?;
        let earlier = serde_json::from_slice::<EarlierRun>(&text).map_err(|e| {
            let what = match result_file::instead(&path) {
                instead if instead.is_empty() => format!(": {}", printable::of_parser(&e)),
                instead => instead,
            };
            failed(format!("not the {RUN_NAME} of a replay{what}"))
        })?;
        Ok(EarlierRun { now: lost::entries(tables), ..earlier })
    }

    /// Whether it was asked for the results of that name.
    fn named(&self, name: &str) -> bool {
        self.recordings.iter().any(|row| row.names(name))
    }

    /// Whether the results of that name are those that it had: judged then, and not judged again since.
    fn has_results(&self, name: &str) -> bool {
        let had = |row: &&Row| row.names(name) && row.outcome.is_none_or(Outcome::is_judged);
        let Some(then) = self.recordings.iter().find(had) else { return false };
        match (self.now.get(name), &then.judged_at) {
            (Some(now), Some(at)) => {
                *at == now.at
                    && then.digest == now.recording.digest
                    && self.by.as_ref().is_none_or(|by| *by == now.by)
            }
            // a file of an earlier version, or no journal
            _ => true,
        }
    }

    /// Whether it was given a recording of that file name.
    fn was_given(&self, name: &str) -> bool {
        self.recordings.iter().any(|row| Path::new(&row.recording).ends_with(name))
    }
}

/// What has changed since an earlier run, by what later runs found.
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

    /// In the order in which a person wants to know.
    fn faults(&self) -> [(&'static str, &'static str, &[&'a Fault]); 4] {
        let Changes { new, back, worse, healthy, .. } = &self.changes;
        [
            ("new", "new", new),
            ("back", "came back", back),
            ("worse", "getting worse", worse),
            ("cured", "healthy again", healthy),
        ]
    }

    pub fn as_json(&self) -> Value {
        let Changes { from_ns, to_ns, recordings, still, .. } = &self.changes;
        let mut told = json!({
            "since": self.run,
            "from": (*recordings > 0).then(|| rfc3339(*from_ns)),
            "to": (*recordings > 0).then(|| rfc3339(*to_ns)),
            "recordings": recordings,
            "still": still,
        });
        for (key, _, faults) in self.faults() {
            told[key] = faults.iter().map(|fault| as_json(fault)).collect();
        }
        told["unjudged"] = json!(self.unjudged);
        told
    }

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
        for (_, words, faults) in self.faults() {
            let told = |fault: &&Fault| {
                let channel = fault.story.channel;
                let head = printable(&fault.story.printhead);
                // the sentence of a fault that is over begins with its channel
                let sentence = fault.sentence.replacen(&format!("channel {channel}: "), "", 1);
                format!("{head} channel {channel}: {}", printable::line(&sentence, 600))
            };
            list(out, words, faults.iter().map(told))?;
        }
        let told = |Unjudged { what, why }: &Unjudged| {
            format!("{}: {}", printable::line(what, 200), printable::line(why, 600))
        };
        list(out, "not judged", self.unjudged.iter().map(told))?;
        if *recordings > 0 && self.faults().iter().all(|(.., faults)| faults.is_empty()) {
            writeln!(out, "no change, of what was judged")?;
        }
        match *still {
            0 => Ok(()),
            1 => writeln!(out, "1 channel to clean as before"),
            n => writeln!(out, "{} channels to clean as before", thousands(n as u64)),
        }
    }
}

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

/// A row of the cleaning list, as `report.faults.parquet` has it.
pub fn as_json(fault: &Fault) -> serde_json::Value {
    let story = &fault.story;
    let time = |ns: i64| DateTime::from_timestamp_nanos(ns).to_rfc3339();
    json!({
        "printhead": story.printhead.to_string(),
        "channel": story.channel,
        "category": story.category,
        "fault": story.fault,
        "began_at": time(story.began_at_ns),
        "ended_at": story.ended_at_ns.map(time),
        "severity_last": story.severity_last,
        "certainty": story.certainty,
        "urgency": fault.urgency,
        "action": fault.action,
        "sentence": fault.sentence,
    })
}
