//! `inkling report --changes-since RUN`: the changes since an earlier run, short enough for a mail: faults
//! that are new, that came back, that got worse or were cured, and what was not judged. In: the earlier
//! `run.json` and a report, from `report_page`. Out: text or JSON.
//!
//! The report is of the results as they lie now. Recordings that the earlier run had judged are what was
//! known then, also where they were judged again since; all others are what came since, even if they are of
//! an earlier time. This file decides which recordings are which (`has_results`) and, for nights, which
//! faults were told (`was_told`), adds what was not judged since, and prints; `Changes::since` divides the
//! faults.

use super::account::{MOST_RUN_BYTES, RUN_NAME, Row};
use super::exit::Failure;
use super::lost;
use super::progress::{counted, first_few, thousands};
use super::report::printable;
use crate::pipeline::rfc3339;
use crate::report::{Changes, Fault, HeadChange, Note, Report, Story, alike, channels, clock};
use inkling_io::file_error::FileError;
use inkling_io::inputs::Input;
use inkling_io::journal::Entry;
use inkling_io::{printable, regular_file, result_file};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Most lines of the text under each heading (`new`, `came back` and so on); JSON holds all.
const MOST_LISTED: usize = 20;

/// An earlier run, as its `run.json` describes it.
#[derive(Debug, Deserialize)]
pub struct EarlierRun {
    /// A row for each recording that it was given.
    recordings: Vec<Row>,
    /// The faults that nights have told; `None`: it is a run, which notes none.
    #[serde(skip)]
    faults: Option<Vec<ToldFault>>,
    /// The path by which the run was given.
    #[serde(skip)]
    run: PathBuf,
    /// What it is called: "that run" or "the last night".
    #[serde(skip)]
    called: &'static str,
    /// Not of the earlier run: what the journals say now of the report's tables, by the names that the report
    /// gives to recordings ([`lost::entries`]).
    #[serde(skip)]
    now: BTreeMap<String, Arc<Entry>>,
}

/// A fault that was told, from its onset to its last look, ns since 1970.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ToldFault {
    printhead: String,
    channel: u32,
    from_ns: i64,
    to_ns: i64,
}

impl ToldFault {
    pub fn of(story: &Story) -> ToldFault {
        ToldFault {
            printhead: story.printhead.to_string(),
            channel: story.channel,
            from_ns: story.began_at_ns,
            to_ns: story.last_look_ns(),
        }
    }

    /// Whether it is the fault that is told now. Where its recordings were judged again, by other settings
    /// say, it may begin and end a little elsewhere.
    fn is(&self, story: &Story) -> bool {
        (&*self.printhead, self.channel) == (&*story.printhead, story.channel)
            && self.from_ns <= story.last_look_ns()
            && self.to_ns >= story.began_at_ns
    }
}

/// Whether a row is of the recording that a report calls `name`. The row has the path of the
/// verdict table from the directory of results; `name` is the table's path from the directory that
/// the report was asked for, without the ending. One directory may lie within the other, so that
/// one path has to end with the other.
fn is_of(row: &Row, name: &str) -> bool {
    row.verdicts.as_ref().is_some_and(|table| {
        let stem = table.strip_suffix(".verdicts.parquet").unwrap_or(table);
        let (stem, name) = (Path::new(stem), Path::new(name));
        stem.ends_with(name) || name.ends_with(stem)
    })
}

impl EarlierRun {
    /// Reads the `run.json` at `run`, or in the directory `run`. `tables`: the verdict tables of
    /// the report. Another file is a usage failure.
    pub fn read(run: &Path, tables: &[Input]) -> Result<EarlierRun, Failure> {
        let path = if run.is_dir() { run.join(RUN_NAME) } else { run.to_path_buf() };
        let text = regular_file::read(&path, MOST_RUN_BYTES).map_err(FileError::unread(&path))?;
        let earlier = serde_json::from_slice::<EarlierRun>(&text).map_err(|e| {
            let mut what = result_file::instead(&path);
            if what.is_empty() {
                what = format!(": {}", printable::of_parser(&e));
            }
            let path = path.display();
            Failure::usage(format!("{path}: not the {RUN_NAME} of a replay{what}"))
        })?;
        Ok(EarlierRun {
            run: run.into(),
            called: "that run",
            now: lost::entries(tables),
            ..earlier
        })
    }

    /// What nights have told of recordings and of faults, as `path` keeps it, in the place of an earlier run.
    pub fn told(
        path: &Path,
        recordings: Vec<Row>,
        faults: Vec<ToldFault>,
        tables: &[Input],
    ) -> EarlierRun {
        let (run, now) = (path.into(), lost::entries(tables));
        EarlierRun { recordings, faults: Some(faults), run, called: "the last night", now }
    }

    /// Whether the earlier run has a row, with a verdict table, for the recording that the report calls
    /// `name`.
    fn named(&self, name: &str) -> bool {
        self.recordings.iter().any(|row| is_of(row, name))
    }

    /// The row of the recording that the report calls `name`, if the earlier run had judged it with the content
    /// that it has now. When and by which design it was judged says nothing: a recording that was judged again is
    /// no newer.
    fn row(&self, name: &str) -> Option<&Row> {
        // a recording that lies elsewhere now is the same; without a journal, what has the same name is
        let now = self.now.get(name).and_then(|now| now.recording.digest.as_ref());
        let is_it = |row: &&Row| match now {
            Some(digest) => row.digest.as_ref() == Some(digest),
            None => is_of(row, name),
        };
        self.recordings.iter().filter(|row| row.outcome.is_judged()).find(is_it)
    }

    fn has_results(&self, name: &str) -> bool {
        self.row(name).is_some()
    }

    /// Whether the recording was judged again since.
    fn is_again(&self, name: &str) -> bool {
        let then = self.row(name).and_then(|row| row.judged_at.as_ref());
        then.zip(self.now.get(name)).is_some_and(|(then, now)| *then != now.at)
    }

    /// Whether nights have told of a fault; `None`: it is a run.
    fn was_told(&self, story: &Story) -> Option<bool> {
        self.faults.as_ref().map(|told| told.iter().any(|of| of.is(story)))
    }

    /// Whether the earlier run has told that there are no verdicts of the recording whose path ends with
    /// `name`. Where several paths end so, the run must have told that of each.
    fn reported_lost(&self, name: &str) -> bool {
        let rows = self.recordings.iter();
        let mut rows = rows.filter(|row| Path::new(&row.recording).ends_with(name)).peekable();
        rows.peek().is_some() && rows.all(|row| !row.outcome.is_judged())
    }
}

/// What has changed since an earlier run, according to the results that it did not have.
pub struct ChangesSince<'a> {
    earlier: &'a EarlierRun,
    changes: Changes<'a>,
    /// Number of recordings that were judged again since.
    again: usize,
    /// Number of faults that are on and that somebody has acknowledged.
    known: usize,
    /// What happened to whole printheads in the recordings since then.
    heads: Vec<&'a HeadChange>,
    /// Of printheads with so many new faults that the nozzles are hardly their cause.
    notes: Vec<&'a str>,
    /// Printheads, recordings and parts of recordings that were not judged since then, and why.
    unjudged: Vec<Unjudged>,
    /// Recordings whose results came since and that are damaged, and how.
    damaged: Vec<Unjudged>,
    /// Faults that were told and that the results do not show any more.
    gone: Vec<&'a ToldFault>,
    /// Pairs of recordings, one of them since then, that hold the same channels at the same times.
    overlapping: Vec<&'a [String; 2]>,
}

/// Something that was not judged since the earlier run, or not whole.
#[derive(Serialize)]
struct Unjudged {
    /// Name of a printhead or of a recording.
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
    pub fn of(earlier: &'a EarlierRun, report: &'a Report) -> Result<ChangesSince<'a>, Failure> {
        let has_results = |name: &str| earlier.has_results(name);
        let (lines, faults) = (&report.recordings, &report.faults);
        if !lines.iter().any(|line| earlier.named(&line.name)) {
            let run = earlier.run.display();
            return Err(Failure::usage(format!(
                "{run}: none of that run's recordings is among these results: give the {RUN_NAME} of an earlier \
                 run that wrote some of them"
            )));
        }
        let changes = Changes::since(lines, faults, has_results, |of| earlier.was_told(of));

        // What was not judged since, in three parts. First printheads that were judged before and
        // in no recording since; if there is no recording since, that says nothing, and none is
        // told.
        let silent = changes.silent.iter().filter(|_| changes.recordings > 0);
        let silent = silent.map(|name| Unjudged::new(name, "not judged in any recording since"));

        // then gaps (printheads, channels or topics that could not be judged) in recordings whose
        // results came since
        let gaps = report.coverage.gaps.iter().filter(|gap| !has_results(&gap.recording));
        let gaps = gaps.map(|gap| Unjudged::new(&gap.recording, &gap.what));

        // last, recordings without verdicts, but for those of which the earlier run has told that
        // and those that are known
        let lost = report.coverage.lost.iter().filter(|lost| !lost.known);
        let lost =
            lost.filter(|lost| !earlier.reported_lost(&lost.name) && !has_results(&lost.name));
        let lost = lost.map(|lost| Unjudged::new(&lost.name, &lost.why));
        let unjudged = silent.chain(gaps).chain(lost).collect();

        // and what of the recordings since is damaged
        let damaged = lines.iter().filter(|of| of.is_damaged && !of.is_known);
        let damaged = damaged.filter(|line| !has_results(&line.name));
        let damaged = damaged.map(|line| Unjudged::new(&line.name, &line.flaws)).collect();
        let heads = report.head_changes.iter().filter(|of| !has_results(&of.recording)).collect();
        let new = || changes.kinds.iter().filter(|of| of.0 == "new").flat_map(|of| &of.2);
        let is_of_new = |note: &&Note| {
            new().any(|fault| note.printhead.as_ref() == Some(&fault.story.printhead))
        };
        let notes = report.notes.iter().filter(is_of_new).map(|note| &*note.what).collect();
        let is_since = |of: &&[String; 2]| !of.iter().all(|name| has_results(name));
        let overlapping = report.overlapping.iter().filter(is_since).collect();
        let is_gone = |told: &&ToldFault| !faults.iter().any(|fault| told.is(&fault.story));
        let gone = earlier.faults.iter().flatten().filter(is_gone).collect();
        let known = report.open().filter(|fault| fault.story.known.is_some()).count();
        let again = lines.iter().filter(|line| earlier.is_again(&line.name)).count();
        Ok(ChangesSince {
            earlier,
            changes,
            again,
            known,
            heads,
            notes,
            unjudged,
            damaged,
            gone,
            overlapping,
        })
    }

    /// The changes as JSON. `still` is the number of faults that are on as before, `may_return` of those that are over
    /// and came back before, `known` of those that are acknowledged, `judged_again` of recordings.
    pub fn as_json(&self) -> Value {
        let Changes { from_ns, to_ns, recordings, still, may_return, .. } = &self.changes;
        let mut document = json!({
            "since": self.earlier.run,
            "from": (*recordings > 0).then(|| rfc3339(*from_ns)),
            "to": (*recordings > 0).then(|| rfc3339(*to_ns)),
            "recordings": recordings,
            "judged_again": self.again,
            "still": still,
            "may_return": may_return,
            "known": self.known,
            "unjudged": self.unjudged,
            "heads": self.heads.iter().map(|of| head_as_json(of)).collect::<Value>(),
            "damaged": self.damaged,
            "no_longer_told": self.gone,
            "overlapping": self.overlapping,
        });
        for (key, _, faults) in &self.changes.kinds {
            document[key] = faults.iter().map(|fault| as_json(fault)).collect();
        }
        document
    }

    pub fn print(&self, out: &mut impl Write) -> std::io::Result<()> {
        let Changes { from_ns, to_ns, recordings, still, may_return, .. } = &self.changes;
        let then = self.earlier.called;
        if *recordings > 0 {
            let (from, to) = (clock(*from_ns), clock(*to_ns));
            let count = counted(*recordings as u64, "recording");
            writeln!(out, "{count} since {then}, from {from} to {to} UTC")?;
        } else {
            writeln!(out, "nothing new was judged since {then}")?;
        }
        if self.again > 0 {
            let count = counted(self.again as u64, "earlier recording");
            writeln!(out, "{count} judged again: names and sizes may be others than {then} told")?;
        }
        let line = |of: &&HeadChange| {
            format!("{}: {}", printable(&of.printhead), printable::line(&of.what, 600))
        };
        let heads: BTreeSet<&str> = self.heads.iter().map(|of| &*of.printhead).collect();
        list_of(out, "printheads", heads.len(), self.heads.iter().map(line))?;
        list(out, "notes", self.notes.iter().map(|note| printable::line(note, 600)))?;
        for (_, kind, faults) in &self.changes.kinds {
            let line = |fault: &&Fault| {
                let channel = fault.story.channel;
                let head = printable(&fault.story.printhead);
                // the sentence begins with the channel, which this line has named already
                let sentence = fault.sentence.replacen(&format!("channel {channel}: "), "", 1);
                (channel, (head, printable::line(&sentence, 600)))
            };
            let lines = alike(faults.iter().map(line))
                .into_iter()
                .map(|(of, (head, said))| format!("{head} {}: {said}", channels(&of)));
            list_of(out, kind, faults.len(), lines)?;
        }
        let line = |Unjudged { what, why }: &Unjudged| {
            format!("{}: {}", printable::line(what, 200), printable::line(why, 600))
        };
        list(out, "not judged", self.unjudged.iter().map(line))?;
        list(out, "damaged", self.damaged.iter().map(line))?;
        let line = |ToldFault { printhead, channel, from_ns, to_ns }: &&ToldFault| {
            let (head, from, to) = (printable(printhead), clock(*from_ns), clock(*to_ns));
            format!(
                "{head} channel {channel}: its fault from {from} to {to} stands in no results any more"
            )
        };
        list(out, "no longer told", self.gone.iter().map(line))?;
        let line = |[a, b]: &&[String; 2]| {
            let [a, b] = [a, b].map(|name| printable::line(name, 200));
            format!(
                "{a} and {b}: the same channels at the same times count twice, or a clock was wrong"
            )
        };
        list(out, "overlapping", self.overlapping.iter().map(line))?;
        let no_fault = self.changes.kinds.iter().all(|(.., faults)| faults.is_empty());
        if *recordings > 0 && no_fault && self.heads.is_empty() {
            writeln!(out, "no change, of what was judged")?;
        }
        if *still > 0 {
            writeln!(out, "{} to clean as before", counted(*still as u64, "channel"))?;
        }
        if *may_return > 0 {
            let count = counted(*may_return as u64, "channel");
            writeln!(out, "{count} healthy as before, whose fault came back before")?;
        }
        if self.known > 0 {
            writeln!(out, "{} acknowledged as known", counted(self.known as u64, "fault"))?;
        }
        Ok(())
    }
}

/// Prints a heading and what belongs under it: how many lines there are, the first of them, and how many
/// more. Without lines nothing is printed.
fn list(
    out: &mut impl Write,
    words: &str,
    lines: impl ExactSizeIterator<Item = String>,
) -> std::io::Result<()> {
    let all = lines.len();
    list_of(out, words, all, lines)
}

/// The same of lines that tell of `all`, some of several.
fn list_of(
    out: &mut impl Write,
    words: &str,
    all: usize,
    lines: impl ExactSizeIterator<Item = String>,
) -> std::io::Result<()> {
    if all > 0 {
        writeln!(out, "{words}: {}", thousands(all as u64))?;
    }
    first_few(lines, MOST_LISTED, |more| format!("and {} more", thousands(more as u64)))
        .try_for_each(|line| writeln!(out, "  {line}"))
}

/// What happened to a printhead, as JSON.
pub fn head_as_json(of: &HeadChange) -> Value {
    json!({
        "printhead": of.printhead.to_string(),
        "what": of.what,
        "recording": of.recording,
        "as_of": of.as_of_ns.map(rfc3339),
    })
}

/// A fault as JSON. The keys are names of columns of `report.faults.parquet`, though not of all; times are
/// text here. `acknowledged`: the note of whoever knows the fault; null: nobody does.
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
        "acknowledged": story.known,
        "sentence": fault.sentence,
        "known_at": rfc3339(story.known_at_ns),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_recordings_with_one_name_each_has_its_own_results() {
        let row = |dir: &str, digest: &str| {
            json!({
                "recording": format!("{dir}/run.mcap"),
                "verdicts": format!("{dir}/run.verdicts.parquet"),
                "judged_at": "2026-11-01T08:00:00Z",
                "digest": digest,
            })
        };
        let rows = json!({ "recordings": [row("a", "xxh3:a"), row("b", "xxh3:b")] });
        let mut earlier: EarlierRun = serde_json::from_value(rows).unwrap();
        let mut has_results = |digest: &str| {
            let at = "2026-11-01T08:00:00Z".to_owned();
            let mut now = Entry { at, ..Entry::default() };
            now.recording.digest = Some(digest.to_owned());
            earlier.now.insert("run".into(), Arc::new(now));
            earlier.has_results("run")
        };
        assert!(has_results("xxh3:a") && has_results("xxh3:b") && !has_results("xxh3:c"));
    }

    #[test]
    fn what_was_judged_then_and_is_lost_now_is_told() {
        let row = |name: &str, outcome: &str| json!({ "recording": name, "outcome": outcome });
        let rows =
            [row("day/a.mcap", "failed"), row("b.mcap", "judged"), row("c.mcap", "not_reached")];
        let earlier: EarlierRun = serde_json::from_value(json!({ "recordings": rows })).unwrap();
        let told = ["a.mcap", "b.mcap", "c.mcap", "d.mcap"].map(|name| earlier.reported_lost(name));
        assert_eq!(told, [true, false, true, false]);
    }
}
