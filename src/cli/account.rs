//! The account of a run: every recording it was given, and what became of it. `run.json`
//! (`schemas/journal.md`), the closing table, the exit status.

use super::exit::{Exit, Failure};
use super::notes::{Note, Notes};
use super::progress::thousands;
use super::report::printable_path;
use inkling_io::journal::{self, Means, Outcome};
use inkling_io::part_file;
use serde::Serialize;
use std::io::{self, Write};
use std::path::Path;
use std::time::Instant;

pub const RUN_NAME: &str = "run.json";
/// Recordings that the closing table names.
const MOST_NAMED: usize = 20;

/// What became of one recording.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Its path below what was named.
    pub recording: String,
    pub outcome: Outcome,
    /// Finished by an earlier run, and left as it is.
    pub skipped: bool,
    /// Why it was judged, failed, or was not looked at; what is damaged.
    pub why: String,
    /// Below the directory of results.
    pub verdicts: Option<String>,
    /// When they were made, as the journal says, and of what content; `None`: there are none.
    pub judged_at: Option<String>,
    pub digest: Option<String>,
    pub signals: u64,
}

impl Row {
    /// Of what has no verdicts.
    pub fn without(recording: String, outcome: Outcome, why: String) -> Row {
        Row {
            recording,
            outcome,
            skipped: false,
            why,
            verdicts: None,
            judged_at: None,
            digest: None,
            signals: 0,
        }
    }
}

/// How the run as a whole ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum End {
    Finished,
    Interrupted,
    /// Nothing more could be written.
    NoRoom,
    Broken,
}

#[derive(Debug)]
pub struct Account {
    began: String,
    started: Instant,
    /// Of what was named and is not there, too.
    pub rows: Vec<Row>,
    pub warnings: Notes,
    pub notes: Notes,
    /// Annotations that this run wrote, also of recordings that were finished before.
    pub annotated: usize,
    /// What an earlier run told of a recording that is skipped counts again.
    strict: bool,
}

#[derive(Debug, Default, Serialize)]
pub struct Totals {
    pub recordings: usize,
    /// By this run, damaged ones too.
    pub judged: usize,
    pub skipped: usize,
    /// Judged by this run or an earlier one, but not whole.
    pub damaged: usize,
    /// Of these a printhead as a whole, or more than half of the signals, could not be judged.
    pub not_judged: usize,
    pub window_refused: usize,
    pub failed: usize,
    pub not_reached: usize,
    /// Of this run.
    pub signals: u64,
    pub seconds: f64,
    pub signals_per_s: f64,
}

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
    recordings: &'a [Row],
}

pub fn unwritable(path: &Path, e: io::Error) -> Failure {
    Failure::new(format!("{}: cannot be written: {e}", path.display()))
}

/// 1 recording, 2 recordings.
fn counted(n: u64, what: &str) -> String {
    format!("{} {what}{}", thousands(n), if n == 1 { "" } else { "s" })
}

impl Account {
    /// Of a run that begins now.
    pub fn new(strict: bool) -> Account {
        Account {
            began: journal::now(),
            started: Instant::now(),
            rows: Vec::new(),
            warnings: Notes::default(),
            notes: Notes::default(),
            annotated: 0,
            strict,
        }
    }

    pub fn totals(&self) -> Totals {
        let count = |of: &dyn Fn(&Row) -> bool| self.rows.iter().filter(|row| of(row)).count();
        let judged = |row: &Row| row.outcome.is_judged();
        let of_this = self.rows.iter().filter(|row| !row.skipped);
        let signals = of_this.map(|row| row.signals).sum();
        let seconds = self.started.elapsed().as_secs_f64();
        Totals {
            recordings: self.rows.len(),
            judged: count(&|row| judged(row) && !row.skipped),
            skipped: count(&|row| row.skipped),
            damaged: count(&|row| row.outcome == Outcome::Damaged),
            not_judged: count(&|row| row.outcome == Outcome::NotJudged),
            window_refused: count(&|row| row.outcome == Outcome::WindowRefused),
            failed: count(&|row| row.outcome == Outcome::Failed),
            not_reached: count(&|row| row.outcome == Outcome::NotReached),
            signals,
            seconds,
            signals_per_s: signals as f64 / seconds.max(1e-9),
        }
    }

    /// By the contract, of a run that came to its end.
    pub fn exit(&self) -> Exit {
        let totals = self.totals();
        let news = |outcome| self.news().any(|row| row.outcome == outcome);
        match totals.judged + totals.skipped {
            0 => Exit::Failed,
            _ if news(Outcome::NotJudged) => Exit::NotJudged,
            _ if news(Outcome::Failed) || news(Outcome::Damaged) => Exit::Incomplete,
            _ => Exit::Done,
        }
    }

    /// What this run is the first to tell, or with `--strict` everything.
    fn news(&self) -> impl Iterator<Item = &Row> {
        self.rows.iter().filter(|row| self.strict || !row.skipped)
    }

    /// `run.json`, which says that the run is over.
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
            recordings: &self.rows,
        };
        let mut text = serde_json::to_string_pretty(&run)?;
        text.push('\n');
        part_file::write(&out.join(RUN_NAME), text.as_bytes())
    }

    /// The closing table: how many of what, and the worst by name.
    pub fn print(&self, out: &mut impl Write) -> io::Result<()> {
        let totals = self.totals();
        let mut parts = vec![format!("{} judged", thousands(totals.judged as u64))];
        for (n, what) in [
            (totals.skipped, "skipped (finished before; --force judges again)"),
            (self.annotated, "annotated"),
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
        writeln!(
            out,
            "{}: {}; {} signals in {:.1} s, {} signals/s",
            counted(totals.recordings as u64, "recording"),
            parts.join(", "),
            thousands(totals.signals),
            totals.seconds,
            thousands(totals.signals_per_s as u64)
        )?;
        for note in self.warnings.list.iter().filter(|note| note.times > 1) {
            writeln!(
                out,
                "  {} times in {}: {}",
                thousands(note.times),
                counted(note.recordings, "recording"),
                note.what
            )?;
        }
        let mut worst: Vec<&Row> =
            self.news().filter(|row| row.outcome < Outcome::Judged).collect();
        worst.sort_by_key(|row| row.outcome);
        for row in worst.iter().take(MOST_NAMED) {
            let word = match row.outcome {
                Outcome::Failed => "failed",
                Outcome::NotReached => "not reached",
                Outcome::NotJudged => "not judged",
                Outcome::WindowRefused => "refused a window",
                _ => "damaged",
            };
            writeln!(out, "  {word:<11}  {}  {}", printable_path(&row.recording), row.why)?;
        }
        if worst.len() > MOST_NAMED {
            writeln!(out, "  and {} more: see {RUN_NAME}", worst.len() - MOST_NAMED)?;
        }
        Ok(())
    }
}
