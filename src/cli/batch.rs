//! Takes the recordings of a run in their order. Each one is skipped, refused or judged, noted in the journal,
//! and reported. A recording that fails does not stop the others, unless nothing more can be written.
//!
//! In: the planned recordings (`plan`) and a `Judge`, from `replay`. Out: results and their lines in
//! `journal.jsonl`, `run.json`, what is printed, and the exit status.
//!
//! The order of writing makes a killed run safe to repeat: first a recording's results, then its
//! line in the journal, which makes it finished, and then the baselines that learned from it
//! (`keep`). Results that are out of date, because the recording changed or failed, are renamed to
//! `<file>.stale`, so that nobody takes them for current; the next success removes them.

use super::account::{Account, End, RUN_NAME, Row};
use super::annotate::{self, NotAnnotated};
use super::exit::{Exit, Failure, in_words, no_room, unless_reader_gone};
use super::judge::{Detail, Judge, Judged, NotJudged, Run};
use super::notes::Notes;
use super::output;
use super::plan::{self, PlannedRecording};
use super::report::printable_path;
use super::results::{self, ReadReport};
use crate::pipeline::PipelineError;
use crate::pipeline::resume::{self, Decision, JudgeReason};
use crate::report::print as print_report;
use inkling_io::baseline_file::BaselineFile;
use inkling_io::file_error::FileError;
use inkling_io::inputs::Input;
use inkling_io::journal::{self, CountedMessage, Entry, JournalWriter, Link, Outcome, Source};
use inkling_io::layout::PlacedRecording;
use inkling_io::{annotation_writer, printable, stored};
use serde_json::{Value, json};
use std::error::Error;
use std::io::Write;
use std::path::{Path, PathBuf};

const MOST_OF_AN_ERROR: usize = 2000;

/// Most complaints told one by one; lost names and annotations are extra.
const MOST_FAILURES: usize = 10;

/// A run over planned recordings, and what it needs.
pub struct Batch<'a> {
    pub judge: &'a mut dyn Judge,
    pub run: Run<'a>,
    /// The file of `--baseline`; `None`: there are no baselines.
    pub baseline_file: Option<BaselineFile>,
    pub journal: JournalWriter,
    /// At first its only rows are of names that were given and not found.
    pub account: Account,
    /// Whether to print one JSON line per recording and one for the run, instead of text.
    pub json: bool,
    pub timings: bool,
    pub annotate: bool,
    /// Number of calls of `complain` so far.
    pub failures: usize,
}

/// Why the run ends early, or how the single recording of a run of one failed.
#[derive(Debug)]
pub struct Stop {
    /// How the run ended, for `run.json`.
    pub end: End,
    pub failure: Failure,
}

/// A failure that would meet all other recordings, too.
impl From<Failure> for Stop {
    fn from(failure: Failure) -> Stop {
        Stop { end: End::Broken, failure }
    }
}

impl Batch<'_> {
    /// Judges the planned recordings in this order, then writes and prints the account of the run.
    /// Returns the exit status; a failure if the run was stopped or nothing could be judged.
    pub fn run(mut self, planned: &[PlannedRecording]) -> Result<Exit, Failure> {
        // 1. judge; each recording that is looked at gets a row, and then those that are not reached
        let lost = self.account.rows.len();
        let stopped = self.all(planned).err();
        let (end, exit) = match &stopped {
            Some(Stop { end, failure }) => {
                let why = printable::line(&failure.message, MOST_OF_AN_ERROR);
                let left = &planned[self.account.rows.len() - lost..];
                self.account.rows.extend(left.iter().map(|p| p.row(Outcome::NotReached, &why)));
                (*end, failure.exit)
            }
            None => (End::Finished, self.account.exit()),
        };
        // `run.json` is written however that ended, before the closing table is printed
        let written = self.account.write(self.run.out, self.run.means, end, exit);

        // 2. tell the run as a whole; a single recording that was judged has been reported already
        let skipped = self.account.rows.iter().all(|row| row.skipped);
        if self.json {
            let mut event = json!(self.account.totals());
            (event["event"], event["end"]) = (json!("run"), json!(end));
            event["exit"] = json!(exit as u8);
            unless_reader_gone(output::event(&event))?;
        } else if !self.is_alone() || skipped {
            unless_reader_gone(self.account.print(&mut output::report()))?;
            if stopped.is_none() && !output::is_quiet() {
                self.list_faults()?;
            }
        }

        match stopped {
            Some(stop) => return Err(stop.failure), // run.json on a full disk is the lesser loss
            None => written.map_err(FileError::unwritten(&self.run.out.join(RUN_NAME)))?,
        }
        let of = self.account.rows.len();
        match exit {
            Exit::Failed => Err(Failure::new(format!("none of {of} recordings could be judged"))),
            exit => Ok(exit),
        }
    }

    /// Whether the run has a single recording, whose own report is then enough.
    fn is_alone(&self) -> bool {
        self.run.detail == Detail::All
    }

    /// Prints the cleaning list over all recordings of the run, if at least two of them have verdicts.
    fn list_faults(&self) -> Result<(), Failure> {
        let Run { out, replay, progress, control, .. } = &self.run;
        let verdicts = self.account.rows.iter().filter_map(|row| row.verdicts.as_ref());
        let inputs: Vec<Input> = verdicts
            .map(|name| Input { path: out.join(name), below: PathBuf::new() })
            .filter(|input| stored::is_file(&input.path))
            .collect();
        if inputs.len() < 2 {
            return Ok(());
        }
        let read = results::read(&inputs, &replay.settings.report, false, progress, control);
        let ReadReport { report, .. } = match read {
            Ok(read) => read,
            Err(e) => {
                progress.say(&format!("warning: no cleaning list: {}", e.message));
                return Ok(());
            }
        };
        unless_reader_gone(print_report(&report, printable::line, &mut output::report()))
    }

    /// Hands all recordings that are to be judged to the judge, then takes the planned ones in
    /// turn: skips, refuses or judges each. The error is why the run stops before the last.
    fn all(&mut self, planned: &[PlannedRecording]) -> Result<(), Stop> {
        // names that were given and not found have their rows already
        for row in &self.account.rows {
            self.run.progress.fail(&format!("inkling: {}", row.why));
            self.print_row(row, &Value::Null)?;
        }

        // such a judge may write any of the results from now on
        if self.judge.all_at_once() {
            plan::to_judge(planned).for_each(|this| self.set_aside_outdated(this));
        }
        let placed: Vec<PlacedRecording> =
            plan::to_judge(planned).map(|this| this.placed.clone()).collect();
        // a failure to begin stops the run only at the first recording that is to be judged, so
        // that those before it are still told as skipped
        let mut begun = self.judge.begin(&self.run, &placed);
        let mut nth = 0; // number of recordings handed to the judge so far
        for this in planned {
            match &this.decision {
                Decision::Finished { entry, moved } => self.skip(this, entry, *moved)?,
                Decision::Refuse(why) => self.note_failure(this, why.clone(), None)?,
                Decision::Judge(_) => {
                    std::mem::replace(&mut begun, Ok(()))?;
                    self.judge(this, nth)?;
                    nth += 1;
                }
            }
        }
        Ok(())
    }

    /// Leaves a finished recording as it is. If the same content was found under another path or with another
    /// time of change (`moved`), the journal gets an entry for it.
    fn skip(&mut self, this: &PlannedRecording, entry: &Entry, moved: bool) -> Result<(), Stop> {
        if moved {
            let digest = entry.recording.digest.clone();
            let recording = Source { digest, ..this.placed.source.clone() };
            self.append(&Entry { recording, ..entry.clone() })?;
        }
        self.add_row(this.row_of(entry), &entry.counts)?;
        self.annotate(this)
    }

    /// Judges one recording, and keeps what came of it. `nth`: index among the recordings that are to be judged.
    /// The error stops the run; a recording that fails by itself is only noted, unless it is the only one.
    fn judge(&mut self, this: &PlannedRecording, nth: usize) -> Result<(), Stop> {
        if !self.judge.all_at_once() {
            self.set_aside_outdated(this);
        }
        match self.judge.judge(&self.run, nth, &this.placed) {
            Ok(judged) => self.keep(this, judged),
            Err(NotJudged::Failed { why, usage }) => {
                // what earlier runs wrote of it no longer belongs to what the journal says
                self.set_aside(&this.placed.verdicts_in(self.run.out));
                let failure = if usage { Failure::usage(&why) } else { Failure::new(&why) };
                self.note_failure(this, why, Some(failure))
            }
            Err(NotJudged::NoRoom(what)) => Err(self.no_room(&what)),
            Err(NotJudged::Broken(what)) => Err(Failure::new(what).into()),
            Err(NotJudged::Interrupted) => {
                Err(Stop { end: End::Interrupted, failure: PipelineError::Interrupted.into() })
            }
        }
    }

    /// Notes a judged recording in the journal, then replaces the baselines: the next run after one that was
    /// killed between the two finds the earlier baselines, and judges this recording once more.
    fn keep(&mut self, this: &PlannedRecording, mut judged: Judged) -> Result<(), Stop> {
        let verdicts = this.placed.verdicts_in(self.run.out);
        let (entry, baselines) = (&mut judged.entry, judged.baselines.take());
        entry.at = journal::now();

        // 1. prepare the new baseline file beside the old one, so that its digest can go into the journal
        let mut prepared = None;
        if let (Some(file), Some(next)) = (&self.baseline_file, &baselines) {
            let next = file.prepare(next).map_err(|e| self.unwritten(&e, &e.to_string()))?;
            entry.baseline = Some(Link { before: file.digest(), after: Some(next.digest()) });
            prepared = Some(next);
        }

        // 2. the results are new: those that were set aside are removed
        for file in results_of(&verdicts) {
            let _ = stored::remove(&stale(&file)); // mostly there is none
        }
        let _ = stored::remove(&annotation_writer::path_beside(&verdicts)); // those of earlier verdicts

        // 3. the entry in the journal makes the recording finished
        self.append(&judged.entry)?;

        // 4. only then the new baselines replace the old ones
        let replaced = match (&mut self.baseline_file, prepared) {
            (Some(file), Some(prepared)) => file.replace(prepared).map_err(Failure::new),
            _ => Ok(()),
        };

        // 5. what the journal calls finished has its row and is told, whatever failed in step 4
        self.tell_of(this, &judged)?;
        replaced?;
        if baselines.is_some() {
            self.run.replay.baselines = baselines;
        }
        self.annotate(this)
    }

    /// Writes the annotations of a recording, if they are asked for and are not there, and tells of it. One
    /// whose tables cannot be read does not stop the others; what cannot be written does.
    fn annotate(&mut self, this: &PlannedRecording) -> Result<(), Stop> {
        let verdicts = this.placed.verdicts_in(self.run.out);
        let path = annotation_writer::path_beside(&verdicts);
        if !self.annotate || stored::is_file(&path) {
            return Ok(());
        }
        match annotate::annotate(&verdicts) {
            Ok(()) => self.account.annotated += 1,
            Err(NotAnnotated::Unwritten(e)) => return Err(self.unwritten(&e, &in_words(&e))),
            Err(NotAnnotated::Unreadable(why)) => {
                self.account.not_annotated += 1;
                self.run.progress.fail(&format!("inkling: {why}: no annotations"));
                return Ok(());
            }
        }
        let path = path.to_string_lossy();
        let document = || json!({ "event": "annotations", "file": path.as_ref() });
        let text = || format!("  annotations: {}", printable_path(&path));
        Ok(unless_reader_gone(output::tell(self.json, document, text))?)
    }

    /// Adds a judged recording's row to the account; tells its warnings and notes, each kind once in a run,
    /// what of it was not judged, and its report.
    fn tell_of(&mut self, this: &PlannedRecording, judged: &Judged) -> Result<(), Stop> {
        let entry = &judged.entry;
        let row = this.row_of(entry);
        self.account.rows.push(row.clone());
        let label = printable_path(&this.placed.label());
        // the account counts all messages, and says which is the first of its kind
        let tell = |counts: &mut Notes, kind: &str, message: &CountedMessage, all: &str| {
            if counts.add(&label, message) {
                let CountedMessage { what, times } = message;
                let more = if *times > 1 { format!(" ({times} times{all})") } else { "".into() };
                self.run.progress.say(&format!("{kind}: {label}: {what}{more}"));
            }
        };
        let Account { warnings, notes, .. } = &mut self.account;
        for message in entry.damage.iter().chain(&entry.warnings) {
            tell(warnings, "warning", message, "; all in its summary.json");
        }
        entry.notes.iter().for_each(|message| tell(notes, "note", message, ""));
        entry.not_judged.iter().for_each(|what| self.complain(&format!("{label}: {what}")));
        if self.timings {
            judged.timings.iter().for_each(|line| self.run.progress.say(line));
        }
        if !self.json {
            // if the reader of the output is gone, the other recordings are still judged
            unless_reader_gone(output::report().write_all(judged.report.as_bytes()))?;
        }
        self.print_row(&row, &entry.counts)
    }

    fn add_row(&mut self, row: Row, counts: &Value) -> Result<(), Stop> {
        self.account.rows.push(row.clone());
        self.print_row(&row, counts)
    }

    /// Prints a row as a JSON line, if these are asked for.
    fn print_row(&self, row: &Row, counts: &Value) -> Result<(), Stop> {
        if self.json {
            let mut event = json!(row);
            event["event"] = json!("recording");
            event["counts"] = counts.clone();
            unless_reader_gone(output::event(&event))?;
        }
        Ok(())
    }

    /// Notes a recording that failed or is refused. If it is the only one of the run, the run fails with it.
    /// `failure`: how it failed; `None`: it is refused, and was not looked at.
    fn note_failure(
        &mut self,
        this: &PlannedRecording,
        error: String,
        failure: Option<Failure>,
    ) -> Result<(), Stop> {
        let error = printable::line(&error, MOST_OF_AN_ERROR);
        let has_place = failure.is_some(); // a refused recording's place is another file's
        let entry = this.failed(self.run.means, &error, has_place);
        self.append(&entry)?;
        let path = format!("{}: ", this.placed.input.path.display());
        let row = this.row(Outcome::Failed, error.strip_prefix(&path).unwrap_or(&error));
        self.add_row(row, &Value::Null)?;
        if self.is_alone() {
            let failure = failure.unwrap_or_else(|| Failure::new(&error));
            return Err(Stop { end: End::Finished, failure });
        }
        self.complain(&error);
        Ok(())
    }

    /// Tells a failure, also with `--quiet`, unless too many have been told.
    fn complain(&mut self, of: &str) {
        match self.failures {
            n if n < MOST_FAILURES => self.run.progress.fail(&format!("inkling: {of}")),
            MOST_FAILURES => {
                let list = self.run.out.join(RUN_NAME);
                let what = "more recordings failed or were not judged whole";
                self.run.progress.fail(&format!("inkling: {what}; {} lists all", list.display()));
            }
            _ => {}
        }
        self.failures += 1;
    }

    fn append(&mut self, entry: &Entry) -> Result<(), Stop> {
        self.journal.append(entry).map_err(|e| {
            let path = self.journal.path.display();
            self.unwritten(&e, &format!("{path}: cannot be written: {e}"))
        })
    }

    /// The stop for a file that cannot be written. `words`: the error with the file's name.
    fn unwritten(&self, e: &(dyn Error + 'static), words: &str) -> Stop {
        if no_room(e) { self.no_room(words) } else { Failure::new(words).into() }
    }

    /// The stop of a run for whose results no room is left. `what`: the error in words.
    fn no_room(&self, what: &str) -> Stop {
        let out = self.run.out.display();
        let failure = Failure::new(format!(
            "{what}; there is no room left for results in {out}. Make room and run the same command \
             again: it goes on where it stopped"
        ));
        Stop { end: End::NoRoom, failure }
    }

    /// Sets the verdicts of a recording aside if its content has changed since they were made.
    fn set_aside_outdated(&self, this: &PlannedRecording) {
        if matches!(this.decision, Decision::Judge(JudgeReason::RecordingChanged)) {
            self.set_aside(&this.placed.verdicts_in(self.run.out));
        }
    }

    /// Renames a recording's files to `<file>.stale`, so that they do not look current. The
    /// summary, which says that the others are whole, is renamed first: a run that is killed in
    /// between leaves no summary beside missing tables.
    fn set_aside(&self, verdicts: &Path) {
        for file in results_of(verdicts).rev().filter(|file| stored::is_file(file)) {
            if let Err(e) = stored::rename(&file, &stale(&file)) {
                let what = format!("{}: out of date, and stays: {e}", file.display());
                self.run.progress.fail(&format!("inkling: {what}"));
            }
        }
    }
}

/// The files of a recording: its annotations, then the files without which it is not finished (verdicts,
/// episodes and, last, the summary).
fn results_of(verdicts: &Path) -> impl DoubleEndedIterator<Item = PathBuf> {
    std::iter::once(annotation_writer::path_beside(verdicts)).chain(resume::files(verdicts))
}

fn stale(file: &Path) -> PathBuf {
    let name = file.file_name().unwrap_or_default().to_string_lossy();
    file.with_file_name(format!("{name}.stale"))
}
