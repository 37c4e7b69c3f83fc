//! The teller of a run: says to people what became of each recording and of the run as a whole.
//!
//! In: from `batch`, recordings with their entries as they are done. Out: rows and messages of the account
//! ([`Account`], `run.json`), lines on stdout (text, or JSON events), complaints on stderr, and with `--annotate`
//! the annotations of each recording; at the end the account of all recordings of the directory of results
//! (`account.json`). What decides whether a recording is judged again is the ledger's; what is written here can be made
//! again.

use super::account::{Account, End, RUN_NAME, Row};
use super::annotate::{self, NotAnnotated};
use super::exit::{Exit, Failure, in_words, unless_reader_gone};
use super::judge::{Judged, Run};
use super::ledger::Stop;
use super::notes::Notes;
use super::output;
use super::progress::{Progress, first_few, is_called};
use super::report::printable_path;
use super::report_page::{ACCOUNT_NAME, write_json};
use super::results;
use crate::report::print as print_report;
use inkling_io::file_error::FileError;
use inkling_io::job::Job;
use inkling_io::journal::{CountedMessage, Entry, Outcome};
use inkling_io::{annotation_writer, printable, stored};
use serde_json::{Value, json};
use std::io::Write;
use std::path::Path;

/// Most complaints told one by one; names that were not found and annotations that failed are told besides.
const MOST_FAILURES: usize = 10;

pub struct Teller<'a> {
    pub out: &'a Path,
    pub progress: &'a Progress,
    /// That of this run. At first its only rows are of names that were given and not found.
    pub account: Account,
    /// Whether to print one JSON line per recording and one for the run, instead of text.
    pub json: bool,
    pub annotate: bool,
    /// Whether the run has a single recording, whose own report is then enough.
    pub is_alone: bool,
    /// Whether to tell what all recordings of the directory of results come to.
    pub tells_all: bool,
    /// Number of calls of `complain` so far.
    pub failures: usize,
}

impl Teller<'_> {
    /// Tells the names that were given and not found, what lies beside the recordings and is not read, and what of the
    /// acknowledgements cannot be understood.
    pub fn lost(&self) -> Result<(), Failure> {
        self.account.acknowledged.mistakes.iter().for_each(|mistake| self.fail(mistake));
        let unread = self.account.unread.iter().map(|of| format!("{}: {}", of.recording, of.why));
        first_few(unread, MOST_FAILURES, |more| format!("{more} files more are not read"))
            .for_each(|line| self.fail(&line));
        for row in &self.account.rows {
            self.fail(&row.why);
            self.print_row(row, &Value::Null)?;
        }
        Ok(())
    }

    /// Adds a recording's row to the account, and prints it as a JSON line if these are asked for.
    pub fn entered(&mut self, job: &Job, entry: &Entry) -> Result<(), Failure> {
        let row = self.account.enter(job, entry); // whether or not it can be printed
        if row.skipped {
            self.complain_of(&row);
        }
        self.print_row(&row, &entry.counts)
    }

    /// Tells a judged recording: its warnings and notes, each kind once in a run, what of it was not judged, and
    /// its report.
    pub fn judged(&mut self, job: &Job, judged: &Judged) -> Result<(), Failure> {
        let (entry, label) = (&judged.entry, printable_path(&job.label()));
        let row = self.account.enter(job, entry);
        // the account counts all messages, and says which is the first of its kind
        let tell = |counts: &mut Notes, kind: &str, message: &CountedMessage, all: &str| {
            if counts.add(&label, message) {
                let CountedMessage { what, times } = message;
                let more = if *times > 1 { format!(" ({times} times{all})") } else { "".into() };
                self.progress.say(&format!("{kind}: {label}: {what}{more}"));
            }
        };
        let Account { warnings, notes, .. } = &mut self.account;
        for message in entry.always.iter().filter(|of| warnings.add(&label, of)) {
            self.progress.fail(&format!("inkling: {label}: {}", message.what));
        }
        for message in entry.damage.iter().chain(&entry.warnings) {
            tell(warnings, "warning", message, "; all in its summary.json");
        }
        entry.notes.iter().for_each(|message| tell(notes, "note", message, ""));
        if !row.acknowledged {
            entry.not_judged.iter().for_each(|what| self.complain(&format!("{label}: {what}")));
        }
        if row.outcome != Outcome::NotJudged {
            self.complain_of(&row);
        }
        if !self.json {
            // if the reader of the output is gone, the other recordings are still judged
            unless_reader_gone(output::report().write_all(judged.report.as_bytes()))?;
        }
        self.print_row(&row, &entry.counts)
    }

    /// Writes the annotations of a recording, if they are asked for and are not there, and tells of it. One
    /// whose tables cannot be read does not stop the others; what cannot be written does.
    pub fn annotate(&mut self, job: &Job) -> Result<(), Stop> {
        let verdicts = job.verdicts_in(self.out);
        let path = annotation_writer::path_beside(&verdicts);
        if !self.annotate || stored::is_file(&path) {
            return Ok(());
        }
        match annotate::annotate(&verdicts) {
            Ok(()) => self.account.annotated += 1,
            Err(NotAnnotated::Unwritten(e)) => {
                return Err(Stop::unwritten(&e, &in_words(&e), self.out));
            }
            Err(NotAnnotated::Unreadable(why)) => {
                self.account.not_annotated += 1;
                self.fail(&format!("{why}: no annotations"));
                return Ok(());
            }
        }
        let path = path.to_string_lossy();
        let document = || json!({ "event": "annotations", "file": path.as_ref() });
        let text = || format!("  annotations: {}", printable_path(&path));
        Ok(unless_reader_gone(output::tell(self.json, document, text))?)
    }

    /// With `--quiet`, tells why a row makes the exit status another one than 0; otherwise messages or the closing
    /// table tell it.
    fn complain_of(&mut self, row: &Row) {
        let is_lost = row.outcome <= Outcome::Damaged && self.account.is_news(row);
        if is_lost && output::is_quiet() && !is_called() {
            self.complain(&format!("{}: {}", printable_path(&row.recording), row.why));
        }
    }

    /// Tells a failure, also with `--quiet`, unless too many have been told.
    pub fn complain(&mut self, of: &str) {
        match self.failures {
            n if n < MOST_FAILURES => self.fail(of),
            MOST_FAILURES => {
                let list = self.out.join(RUN_NAME);
                let what = "more recordings failed or were not judged whole";
                self.fail(&format!("{what}; {} lists all", list.display()));
            }
            _ => {}
        }
        self.failures += 1;
    }

    pub fn fail(&self, what: &str) {
        self.progress.fail(&format!("inkling: {what}"));
    }

    /// Writes and prints the account of the run, once each recording has its row. Returns the exit status; a
    /// failure if the run was stopped or nothing could be judged.
    pub fn close(self, run: &Run, stopped: Option<Stop>) -> Result<Exit, Failure> {
        let (end, exit) = match &stopped {
            Some(Stop { end, failure }) => (*end, failure.exit),
            None => (End::Finished, self.account.exit()),
        };
        // `run.json` is written however the run ended, before the closing table is printed
        let written = self.account.write(self.out, run.means, end, exit);

        // a single recording that was judged has been reported already
        let skipped = self.account.rows.iter().all(|row| row.skipped);
        if self.json {
            let mut event = json!(self.account.totals());
            (event["event"], event["end"]) = (json!("run"), json!(end));
            event["exit"] = json!(exit as u8);
            unless_reader_gone(output::event(&event))?;
        } else if !self.is_alone || skipped {
            unless_reader_gone(self.account.print(&mut output::report()))?;
        }
        if stopped.is_none() && self.tells_all {
            let is_listed = !self.json && !output::is_quiet() && (!self.is_alone || skipped);
            self.tell_all(run, is_listed)?;
        }

        match stopped {
            // why the run stopped matters more than that `run.json` could not be written
            Some(stop) => return Err(stop.failure),
            None => written.map_err(FileError::unwritten(&self.out.join(RUN_NAME)))?,
        }
        match exit {
            Exit::Failed => Err(Failure::new(match &self.account.rows[..] {
                [only] => format!("{}: {}", printable_path(&only.recording), only.why),
                rows => format!("none of {} recordings could be judged", rows.len()),
            })),
            exit => Ok(exit),
        }
    }

    /// Writes the account of all recordings of the directory of results, and prints their cleaning list if there
    /// are at least two.
    fn tell_all(&self, run: &Run, lists: bool) -> Result<(), Failure> {
        let settings = &run.replay.settings.report;
        let found = results::find(&[self.out.to_string_lossy().into()], "an account");
        let read = found.and_then(|inputs| {
            // the counts are kept, so that later runs need not count the same verdicts again
            let read = results::read(&inputs, settings, true, self.progress, run.control)?;
            Ok((inputs.len(), read.report))
        });
        match read {
            Ok((recordings, report)) => {
                write_json(&self.out.join(ACCOUNT_NAME), &report.account())?;
                if lists && recordings >= 2 {
                    let print = print_report(&report, printable::line, &mut output::report());
                    unless_reader_gone(print)?;
                }
            }
            // where this run judged nothing, and earlier ones left nothing that can be read, there is nothing to tell
            Err(_) if self.account.rows.iter().all(|row| row.verdicts.is_none()) => {}
            Err(e) => self.fail(&format!("no {ACCOUNT_NAME} of this run: {}", e.message)),
        }
        Ok(())
    }

    /// Prints a row as a JSON line, if these are asked for.
    fn print_row(&self, row: &Row, counts: &Value) -> Result<(), Failure> {
        if self.json {
            let mut event = json!(row);
            event["event"] = json!("recording");
            event["counts"] = counts.clone();
            unless_reader_gone(output::event(&event))?;
        }
        Ok(())
    }
}
