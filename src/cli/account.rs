//! The account of a run: every recording that it was given, and what became of it. In: from `teller`, a [`Row`]
//! for each recording, in the order in which recordings are done, and messages. Out: the file `run.json`
//! (`schemas/journal.md`), the closing table, and the exit status.
//!
//! The exit status counts only what is new: a damaged recording that is skipped was told when it
//! was judged. With `--strict` skipped recordings count like others.

use super::exit::Exit;
use super::notes::{Note, Notes};
use super::progress::{counted, first_few, thousands};
use super::report::printable_path;
use crate::report::Acknowledged;
use inkling_core::verdict::Reason;
use inkling_io::job::Job;
use inkling_io::journal::{self, Entry, Means, Outcome};
use inkling_io::{part_file, printable};
use serde::{Deserialize, Serialize};
use std::io::{self, Write};
use std::path::Path;
use std::time::Instant;

pub const RUN_NAME: &str = "run.json";
/// Most bytes of that file that are read: enough for a million recordings, of some 300 bytes each.
pub const MOST_RUN_BYTES: u64 = 1 << 30;
/// Most recordings that the closing table names.
const MOST_NAMED: usize = 20;
/// Most characters of a reason in a row.
const MOST_OF_A_REASON: usize = 300;

/// What became of one recording.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct Row {
    /// Path of the recording, relative to what the user named.
    pub recording: String,
    pub outcome: Outcome,
    /// Whether an earlier run finished the recording, or found that nothing is to be done with its content, and
    /// this run left it as it is.
    pub skipped: bool,
    /// Why the recording was judged, failed or was not looked at, or what of it is damaged.
    pub why: String,
    /// Path of the verdict table in the directory of results, also of one that was not reached: there it will
    /// be; `None` if the recording failed.
    pub verdicts: Option<String>,
    /// When the verdicts were made, as the journal says; `None` if there are none.
    pub judged_at: Option<String>,
    /// Digest of the recording that the verdicts were made from; `None` if there are none.
    pub digest: Option<String>,
    /// Number of signals found in the recording, judged or rejected; 0 if it has no verdicts.
    pub signals: u64,
    /// Whether it is not whole, and somebody has acknowledged that: then whatever is wrong with it is no news.
    pub acknowledged: bool,
}

impl Row {
    /// The row of a recording, by its entry in the journal, or by the one that would stand there of a recording
    /// that was not reached. As the reason it has its error or what is not whole of its verdicts, if anything is
    /// not; else why this run judged or skipped the recording.
    pub fn of(job: &Job, entry: &Entry) -> Row {
        let is_judged = entry.outcome.is_judged();
        let path = format!("{}: ", job.input.path.display());
        let error = entry.error.as_deref().map(|e| e.strip_prefix(&path).unwrap_or(e).to_owned());
        let why = error.or_else(|| not_whole(entry)).unwrap_or_else(|| job.words().1);
        let results = entry.results.as_ref().filter(|_| entry.outcome != Outcome::Failed);
        Row {
            recording: job.label(),
            outcome: entry.outcome,
            skipped: (is_judged || entry.by_content) && !job.is_to_be_judged(),
            why: printable::line(&why, MOST_OF_A_REASON),
            verdicts: results.map(|results| results.verdicts.clone()),
            judged_at: is_judged.then(|| entry.at.clone()),
            digest: entry.recording.digest.clone().filter(|_| is_judged),
            signals: entry.counts["signals"].as_u64().unwrap_or_default(),
            acknowledged: false,
        }
    }
}

/// What of a recording was not judged, or not judged as asked: the first sentence about it in its
/// entry. `None` if it is whole.
fn not_whole(entry: &Entry) -> Option<String> {
    let refused = || entry.warnings.first().map(|told| told.what.clone());
    let rejected = || {
        let by_reason = entry.counts["rejected"].as_object()?.iter();
        let by_reason = by_reason.filter_map(|(why, n)| Some((Reason::of(why)?, n.as_u64()?)));
        let each: Vec<String> = by_reason
            .map(|(why, n)| format!("{} rejected: {}", counted(n, "signal"), why.in_words()))
            .collect();
        (!each.is_empty()).then(|| each.join("; "))
    };
    match entry.outcome {
        Outcome::NotJudged => entry.not_judged.first().cloned(),
        Outcome::Damaged => {
            let damage = entry.damage.first().map(|damage| damage.what.clone());
            Some(damage.or_else(rejected).or_else(refused).unwrap_or_default())
        }
        Outcome::WindowRefused => refused(),
        _ => None,
    }
}

/// A file beside the recordings that looks like one and is not read.
#[derive(Clone, Debug, Serialize)]
pub struct UnreadFile {
    pub recording: String,
    pub why: String,
}

/// How the run as a whole ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum End {
    /// Every recording had its turn, whether or not it could be judged.
    Finished,
    /// Ctrl-C, or a request to terminate.
    Interrupted,
    /// No room was left to write results.
    NoRoom,
    /// The run stopped at another error that concerns all recordings.
    Broken,
}

/// What a run has done so far.
#[derive(Debug)]
pub struct Account {
    /// When the run began, RFC 3339, and the same on the clock by which durations are measured.
    began: String,
    started: Instant,
    /// A row for each recording, and for each name that was given and not found.
    pub rows: Vec<Row>,
    /// Files beside the recordings that look like such and are not read.
    pub unread: Vec<UnreadFile>,
    /// What is acknowledged beside the results.
    pub acknowledged: Acknowledged,
    /// Warnings and notes about recordings, counted by kind.
    pub warnings: Notes,
    pub notes: Notes,
    /// Number of recordings whose annotations this run wrote, also of those that were finished
    /// before.
    pub annotated: usize,
    /// Number of recordings whose annotations were asked for and whose tables cannot be read.
    pub not_annotated: usize,
    /// Whether recordings that are skipped count for the exit status as in the run that judged them
    /// (`--strict`).
    strict: bool,
}

/// Numbers of recordings by what became of them.
#[derive(Debug, Default, Serialize)]
pub struct Totals {
    pub recordings: usize,
    /// Recordings that this run judged, including damaged ones.
    pub judged: usize,
    pub skipped: usize,
    /// Recordings that this run or an earlier one judged, but that are not whole.
    pub damaged: usize,
    /// Recordings of which a whole printhead, or more than half of the signals, could not be judged.
    pub not_judged: usize,
    /// Recordings with a healthy window that gave no model.
    pub window_refused: usize,
    /// Recordings without verdicts: because they failed, were refused or do not exist; or because
    /// the run stopped before them.
    pub failed: usize,
    pub not_reached: usize,
    pub not_annotated: usize,
    /// Signals of the recordings that this run did not skip.
    pub signals: u64,
    pub seconds: f64,
    pub signals_per_s: f64,
}

/// The document of `run.json`; `schemas/journal.md` explains its keys.
#[derive(Serialize)]
struct Run<'a> {
    version: u32,
    inkling: &'static str,
    began: &'a str,
    ended: String,
    end: End,
    exit: u8,
    #[serde(flatten)]
    by: &'a Means,
    totals: &'a Totals,
    warnings: &'a [Note],
    notes: &'a [Note],
    unread: &'a [UnreadFile],
    recordings: &'a [Row],
}

impl Account {
    pub fn new(strict: bool) -> Account {
        Account {
            began: journal::now(),
            started: Instant::now(),
            rows: Vec::new(),
            unread: Vec::new(),
            acknowledged: Acknowledged::default(),
            warnings: Notes::default(),
            notes: Notes::default(),
            annotated: 0,
            not_annotated: 0,
            strict,
        }
    }

    pub fn totals(&self) -> Totals {
        let new = || self.rows.iter().filter(|row| !row.skipped);
        let number = |of| self.rows.iter().filter(|row| row.outcome == of).count();
        let signals = new().map(|row| row.signals).sum();
        let seconds = self.started.elapsed().as_secs_f64();
        Totals {
            recordings: self.rows.len(),
            judged: new().filter(|row| row.outcome.is_judged()).count(),
            skipped: self.rows.len() - new().count(),
            damaged: number(Outcome::Damaged),
            not_judged: number(Outcome::NotJudged),
            window_refused: number(Outcome::WindowRefused),
            failed: number(Outcome::Failed),
            not_reached: number(Outcome::NotReached),
            not_annotated: self.not_annotated,
            signals,
            seconds,
            signals_per_s: signals as f64 / seconds.max(1e-9),
        }
    }

    /// The exit status of a run that came to its end. The most serious outcome of a recording
    /// decides: that something was not judged counts more than that something was lost. A run
    /// without any verdicts, new or of earlier runs, has failed.
    pub fn exit(&self) -> Exit {
        let is_news = |outcome| self.news().any(|row| row.outcome == outcome);
        if !self.rows.iter().any(|row| row.outcome.is_judged()) {
            Exit::Failed
        } else if is_news(Outcome::NotJudged) {
            Exit::NotJudged
        } else if is_news(Outcome::Failed) || is_news(Outcome::Damaged) || self.not_annotated > 0 {
            Exit::Incomplete
        } else {
            Exit::Done
        }
    }

    /// Adds the row of a recording.
    pub fn enter(&mut self, job: &Job, entry: &Entry) -> Row {
        let row = Row::of(job, entry);
        // of one that is whole by now nothing has to be known
        let is_known = self.acknowledged.knows_recording(&job.source.path).is_some();
        let row = Row { acknowledged: is_known && row.outcome != Outcome::Judged, ..row };
        self.rows.push(row.clone());
        row
    }

    /// Whether a row counts for the exit status: not where an earlier run told it, but with `--strict`; and never
    /// where somebody has acknowledged it.
    pub fn is_news(&self, row: &Row) -> bool {
        (self.strict || !row.skipped) && !row.acknowledged
    }

    /// The rows that count for the exit status.
    fn news(&self) -> impl Iterator<Item = &Row> {
        self.rows.iter().filter(|row| self.is_news(row))
    }

    /// Writes `run.json` into the directory `out`. `by`: the means of judging; `end`, `exit`: how
    /// the run ends.
    pub fn write(&self, out: &Path, by: &Means, end: End, exit: Exit) -> io::Result<()> {
        let run = Run {
            version: journal::VERSION,
            inkling: env!("CARGO_PKG_VERSION"),
            began: &self.began,
            ended: journal::now(),
            end,
            exit: exit as u8,
            by,
            totals: &self.totals(),
            warnings: &self.warnings.list,
            notes: &self.notes.list,
            unread: &self.unread,
            recordings: &self.rows,
        };
        let text = serde_json::to_string_pretty(&run)? + "\n";
        part_file::write(&out.join(RUN_NAME), text.as_bytes())
    }

    /// Prints the closing table: the totals, repeated warnings, and the names of the worst recordings.
    pub fn print(&self, out: &mut impl Write) -> io::Result<()> {
        let totals = self.totals();
        let mut parts = vec![format!("{} judged", thousands(totals.judged as u64))];
        for (n, what) in [
            (totals.skipped, "skipped (finished before; --force judges again)"),
            (self.annotated, "annotated"),
            (totals.not_annotated, "not annotated"),
            (totals.not_judged, "not judged"),
            (totals.damaged, "damaged"),
            (totals.window_refused, "with a refused window"),
            (totals.failed, "failed"),
            (totals.not_reached, "not reached"),
        ] {
            if n > 0 {
                parts.push(format!("{} {what}", thousands(n as u64)));
            }
        }
        let (all, parts) = (counted(totals.recordings as u64, "recording"), parts.join(", "));
        let [n, rate] = [totals.signals, totals.signals_per_s as u64].map(thousands);
        writeln!(out, "{all}: {parts}; {n} signals in {:.1} s, {rate} signals/s", totals.seconds)?;

        // each warning was told once, when it first came; here is how often it came in all
        for Note { what, times, recordings, .. } in &self.warnings.list {
            if *times > 1 {
                let (times, all) = (thousands(*times), counted(*recordings, "recording"));
                writeln!(out, "  {times} times in {all}: {what}")?;
            }
        }

        // outcomes are ordered from the worst on; all before `Judged` are not as they should be
        let mut worst: Vec<_> = self.news().filter(|row| row.outcome < Outcome::Judged).collect();
        worst.sort_by_key(|row| row.outcome);
        let lines = worst.iter().map(|row| {
            let word = match row.outcome {
                Outcome::Failed => "failed",
                Outcome::NotReached => "not reached",
                Outcome::NotJudged => "not judged",
                Outcome::WindowRefused => "refused a window",
                _ => "damaged",
            };
            format!("{word:<11}  {}  {}", printable_path(&row.recording), row.why)
        });
        first_few(lines, MOST_NAMED, |more| format!("and {more} more: see {RUN_NAME}"))
            .try_for_each(|line| writeln!(out, "  {line}"))
    }
}
