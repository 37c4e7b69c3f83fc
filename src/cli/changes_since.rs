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
use super::report_page::as_json;
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
const MOST_OF_A_LINE: usize = 600;

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
    /// What is listed, in the order in which it is told.
    sections: Vec<Section>,
    /// Whether nothing happened to a printhead as a whole.
    are_heads_as_before: bool,
}

/// What is told under one heading.
struct Section {
    /// Its key in JSON, and its words in text.
    key: &'static str,
    heading: &'static str,
    /// Number of what is told; a line may tell of several, or several of one.
    count: usize,
    lines: Vec<String>,
    document: Value,
}

impl Section {
    /// A line of each item.
    fn of<T>(
        [key, heading]: [&'static str; 2],
        items: Vec<T>,
        line: impl Fn(&T) -> String,
        document: impl Fn(&T) -> Value,
    ) -> Section {
        let lines: Vec<String> = items.iter().map(line).collect();
        let document = items.iter().map(document).collect();
        Section { key, heading, count: lines.len(), lines, document }
    }

    /// Changed faults of one kind; those of which the same is said are one line.
    fn of_faults(key: &'static str, heading: &'static str, faults: &[&Fault]) -> Section {
        let line = |fault: &&Fault| {
            let channel = fault.story.channel;
            let head = printable(&fault.story.printhead);
            // the sentence begins with the channel, which this line has named already
            let sentence = fault.sentence.replacen(&format!("channel {channel}: "), "", 1);
            (channel, (head, printable::line(&sentence, MOST_OF_A_LINE)))
        };
        let lines = alike(faults.iter().map(line)).into_iter();
        let lines = lines.map(|(of, (head, said))| format!("{head} {}: {said}", channels(&of)));
        let document = faults.iter().map(|fault| as_json(fault)).collect();
        Section { key, heading, count: faults.len(), lines: lines.collect(), document }
    }

    /// Its heading with how much there is, the first lines, and how many more. Without lines nothing is printed.
    fn print(&self, out: &mut impl Write) -> std::io::Result<()> {
        if self.count > 0 {
            writeln!(out, "{}: {}", self.heading, thousands(self.count as u64))?;
        }
        let more = |more| format!("and {} more", thousands(more as u64));
        first_few(self.lines.iter().cloned(), MOST_LISTED, more)
            .try_for_each(|line| writeln!(out, "  {line}"))
    }
}

/// Something that was not judged since the earlier run, or not whole: a printhead or a recording, and why.
#[derive(Serialize)]
struct Unjudged<'a> {
    what: &'a str,
    why: &'a str,
}

impl Unjudged<'_> {
    fn line(&self) -> String {
        let (what, why) =
            (printable::line(self.what, 200), printable::line(self.why, MOST_OF_A_LINE));
        format!("{what}: {why}")
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

        // 1. what happened to whole printheads, and where the nozzles are hardly the cause of so many new faults
        let heads = report.head_changes.iter().filter(|of| !has_results(&of.recording));
        let heads: Vec<&HeadChange> = heads.collect();
        let line = |of: &&HeadChange| {
            format!("{}: {}", printable(&of.printhead), printable::line(&of.what, MOST_OF_A_LINE))
        };
        let changed: BTreeSet<&str> = heads.iter().map(|of| &*of.printhead).collect();
        let are_heads_as_before = heads.is_empty();
        let of_heads = Section {
            count: changed.len(),
            ..Section::of(["heads", "printheads"], heads, line, |of| head_as_json(of))
        };
        let new = || changes.kinds.iter().filter(|of| of.0 == "new").flat_map(|of| &of.2);
        let is_of_new = |note: &&Note| {
            new().any(|fault| note.printhead.as_ref() == Some(&fault.story.printhead))
        };
        let notes: Vec<&Note> = report.notes.iter().filter(is_of_new).collect();
        let line = |note: &&Note| printable::line(&note.what, MOST_OF_A_LINE);
        let of_notes = Section::of(["notes", "notes"], notes, line, |note| json!(note.what));
        let mut sections = vec![of_heads, of_notes];

        // 2. the changed faults
        let kinds = changes.kinds.iter();
        sections.extend(kinds.map(|(key, words, of)| Section::of_faults(key, words, of)));

        // 3. What was not judged: first printheads that were judged before and in no recording since; if there is no
        // recording since, that says nothing, and none is told.
        let silent = changes.silent.iter().filter(|_| changes.recordings > 0);
        let silent = silent.map(|what| Unjudged { what, why: "not judged in any recording since" });
        // then gaps (printheads, channels or topics that could not be judged) in recordings whose
        // results came since
        let gaps = report.coverage.gaps.iter().filter(|gap| !has_results(&gap.recording));
        let gaps = gaps.map(|gap| Unjudged { what: &gap.recording, why: &gap.what });
        // last, recordings without verdicts, but for those of which the earlier run has told that
        // and those that are known
        let lost = report.coverage.lost.iter().filter(|lost| !lost.known);
        let lost =
            lost.filter(|lost| !earlier.reported_lost(&lost.name) && !has_results(&lost.name));
        let lost = lost.map(|lost| Unjudged { what: &lost.name, why: &lost.why });
        let unjudged = silent.chain(gaps).chain(lost).collect();
        // and what of the recordings since is damaged
        let damaged = lines.iter().filter(|of| of.is_damaged && !of.is_known);
        let damaged = damaged.filter(|line| !has_results(&line.name));
        let damaged = damaged.map(|line| Unjudged { what: &line.name, why: &line.flaws }).collect();
        for (words, of) in [(["unjudged", "not judged"], unjudged), (["damaged"; 2], damaged)] {
            sections.push(Section::of(words, of, Unjudged::line, |of| json!(of)));
        }

        // 4. faults that were told and that the results do not show any more, and recordings of the same times
        let is_gone = |told: &&ToldFault| !faults.iter().any(|fault| told.is(&fault.story));
        let gone = earlier.faults.iter().flatten().filter(is_gone).collect();
        let line = |ToldFault { printhead, channel, from_ns, to_ns }: &&ToldFault| {
            let (head, from, to) = (printable(printhead), clock(*from_ns), clock(*to_ns));
            format!(
                "{head} channel {channel}: its fault from {from} to {to} stands in no results any more"
            )
        };
        sections
            .push(Section::of(["no_longer_told", "no longer told"], gone, line, |of| json!(of)));
        let is_since = |of: &&[String; 2]| !of.iter().all(|name| has_results(name));
        let overlapping = report.overlapping.iter().filter(is_since).collect();
        let line = |of: &&[String; 2]| {
            let [a, b] = of.each_ref().map(|name| printable::line(name, 200));
            format!(
                "{a} and {b}: the same channels at the same times count twice, or a clock was wrong"
            )
        };
        sections.push(Section::of(["overlapping"; 2], overlapping, line, |of| json!(of)));

        let known = report.open().filter(|fault| fault.story.known.is_some()).count();
        let again = lines.iter().filter(|line| earlier.is_again(&line.name)).count();
        Ok(ChangesSince { earlier, changes, again, known, sections, are_heads_as_before })
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
        });
        for section in &self.sections {
            document[section.key] = section.document.clone();
        }
        document
    }

    pub fn print(&self, out: &mut impl Write) -> std::io::Result<()> {
        let Changes { from_ns, to_ns, recordings, still, may_return, kinds, .. } = &self.changes;
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
        self.sections.iter().try_for_each(|section| section.print(out))?;
        let no_fault = kinds.iter().all(|(.., faults)| faults.is_empty());
        if *recordings > 0 && no_fault && self.are_heads_as_before {
            writeln!(out, "no change, of what was judged")?;
        }
        for (n, what, words) in [
            (*still, "channel", "to clean as before"),
            (*may_return, "channel", "healthy as before, whose fault came back before"),
            (self.known, "fault", "acknowledged as known"),
        ] {
            if n > 0 {
                writeln!(out, "{} {words}", counted(n as u64, what))?;
            }
        }
        Ok(())
    }
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
