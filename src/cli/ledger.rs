//! The ledger of a run: in which order what became of a recording becomes true on disk, so that any kill and any
//! failed write leaves something that the next run can put right.
//!
//! In: from `batch`, a recording with what was judged of it, or why it has no verdicts. Out: its line in
//! `journal.jsonl`, and with `--baseline` the file of states; where nothing more can be written, a [`Stop`].
//!
//! Three things must agree: a recording's tables, its line in the journal, and the state that learned from it.
//! They become true in this order:
//!
//! 1. The tables: `pipeline/finish.rs` has named them, all whole. Without a line in the journal they count for
//!    nothing: the next run judges the recording again, by the state of then, which is still there.
//! 2. The new state is written beside the old one ([`BaselineFile::prepare`]): a full disk shows before anything
//!    counts, and its digest is known.
//! 3. The line, with the digests of the state before and after, makes the recording finished.
//! 4. The new state replaces the old one. Where it does not, the old one is there, and the line names it as the
//!    state before: from there the next run judges this recording once more (`pipeline/chain.rs`).
//!
//! A state can only follow the recordings in their order. So where one fails in its turn that may succeed
//! the next time, the state learns no more in this run ([`Ledger::wait_for`]): those after it are judged by the state
//! as it is, and once more by the next run, after this one. If it fails then, too, the state passes over it.
//!
//! Results that are out of date, because the recording changed or failed, are renamed to `<file>.stale`, so that
//! nobody takes them for current; the next success removes them.

use super::account::End;
use super::exit::{Failure, no_room};
use super::judge::Judged;
use crate::pipeline::resume;
use crate::report::clock;
use inkling_io::baseline_file::{BaselineFile, Prepared};
use inkling_io::file_error::FileError;
use inkling_io::job::Job;
use inkling_io::journal::{
    self, CountedMessage, Entry, JournalWriter, Link, Means, Outcome, Source,
};
use inkling_io::{annotation_writer, printable, stored};
use std::error::Error;
use std::path::{Path, PathBuf};

pub struct Ledger<'a> {
    pub out: &'a Path,
    /// How recordings are judged, as the journal notes it.
    pub means: &'a Means,
    pub journal: JournalWriter,
    /// The file of `--baseline`; `None`: no state is kept.
    pub state: Option<BaselineFile>,
    /// That another design's state was set aside, until it is told, of the first recording that teaches the new one.
    pub begun_anew: Option<String>,
    /// The recording that failed in its turn, or could not be read when the run was planned, because of which the state learns no more in this run.
    pub waits_for: Option<String>,
    /// The latest recording that the state has learned from before this run, and when it begins, ns since 1970.
    pub latest: Option<(String, i64)>,
}

/// What is told of recordings that the state does not learn from.
const NO_PLACE: &str = "it was judged by the state of --baseline as that is now, and taught it nothing: the state has learned from";
const IN_ORDER: &str = "Remove the file of the state to have all judged again in their order";

const MISDATED: &str = "most of its bursts cannot have been acquired when they say: it was judged by the state \
    of --baseline as that is now, and taught it nothing";

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

impl Stop {
    /// For a file that cannot be written. `words`: the error with the file's name; `out`: the directory of results.
    pub fn unwritten(e: &(dyn Error + 'static), words: &str, out: &Path) -> Stop {
        if no_room(e) { Stop::no_room(words, out) } else { Failure::new(words).into() }
    }

    /// For a run for whose results no room is left. `what`: the error in words.
    pub fn no_room(what: &str, out: &Path) -> Stop {
        let failure = Failure::new(format!(
            "{what}; there is no room left for results in {}. Make room and run the same command \
             again: it goes on where it stopped",
            out.display()
        ));
        Stop { end: End::NoRoom, failure }
    }
}

impl Ledger<'_> {
    /// Makes a recording finished whose tables have their names. The outer error: it is not finished. The inner
    /// error: it is, but the state that learned from it could not replace the old one.
    pub fn commit(&mut self, job: &Job, judged: &mut Judged) -> Result<Result<(), Stop>, Stop> {
        judged.entry.at = journal::now();

        // 2. the new state, beside the old one
        let prepared = self.prepare(job, judged)?;

        // what was set aside, and annotations of earlier verdicts: mostly there are none
        let verdicts = job.verdicts_in(self.out);
        for file in results_of(&verdicts) {
            let _ = stored::remove(&stale(&file));
        }
        let annotations = annotation_writer::path_beside(&verdicts);
        stored::remove(&annotations)
            .map_err(FileError::unwritten(&annotations))
            .map_err(|e| Stop::unwritten(&e, &e.to_string(), self.out))?;

        // 3. the line makes it finished
        self.append(&judged.entry)?;

        // 4. only then the new state is the one that counts
        Ok(match (&mut self.state, prepared) {
            (Some(file), Some(next)) => file.replace(next).map_err(|e| Failure::new(e).into()),
            _ => Ok(()),
        })
    }

    /// Writes the new state beside the old one, if the state is to learn from the recording; its entry says by
    /// which state it was judged.
    fn prepare(&mut self, job: &Job, judged: &mut Judged) -> Result<Option<Prepared>, Stop> {
        let (Some(file), Some(learned)) = (&self.state, judged.baselines.take()) else {
            return Ok(None);
        };
        let told = |what: String| CountedMessage { what, times: 1 };
        if let Some(failed) = &self.waits_for {
            // without a link the next run judges it again
            judged.entry.warnings.push(told(format!(
                "it was judged by the state of --baseline as that is now, and will be judged again in its turn by the \
                 next run, after {failed}"
            )));
            return Ok(None);
        }
        if !job.teaches {
            let why = if job.source.misdated { MISDATED.into() } else { self.no_place(job) };
            // of what was not judged other sentences say why it taught nothing
            if judged.entry.counts["judged"] != 0 {
                judged.entry.always.push(told(why));
            }
            let now = Link { before: file.digest(), after: file.digest() };
            judged.entry.baseline = Some(job.link.clone().unwrap_or(now));
            return Ok(None);
        }
        judged.entry.always.extend(self.begun_anew.take().map(told));
        let next =
            file.prepare(&learned).map_err(|e| Stop::unwritten(&e, &e.to_string(), self.out))?;
        judged.entry.baseline = Some(Link { before: file.digest(), after: Some(next.digest()) });
        judged.baselines = Some(learned);
        Ok(Some(next))
    }

    /// Why a recording has no place in the order of the state. A later one that is dated wrongly takes the place of
    /// all that follow, so that it is named.
    fn no_place(&self, job: &Job) -> String {
        let begin_ns = job.source.starts_at_ns.unwrap_or(i64::MAX);
        match self.latest.as_ref().filter(|(_, latest_ns)| *latest_ns > begin_ns) {
            Some((name, latest_ns)) => format!(
                "{NO_PLACE} {}, which is dated {}. If that is wrong, take it and its results away. {IN_ORDER}",
                printable::cell(name),
                clock(*latest_ns)
            ),
            None => format!("{NO_PLACE} it, or from later recordings, before. {IN_ORDER}"),
        }
    }

    /// Notes that a finished recording lies under another path, or has another time of change.
    pub fn note_moved(&mut self, job: &Job, entry: &Entry) -> Result<(), Stop> {
        let digest = entry.recording.digest.clone();
        let recording = Source { digest, ..job.source.clone() };
        self.append(&Entry { recording, ..entry.clone() })
    }

    /// Notes a recording that failed or is refused. `by_content`: because of what is in it.
    pub fn note_failure(
        &mut self,
        job: &Job,
        error: &str,
        by_content: bool,
    ) -> Result<Entry, Stop> {
        let entry = job.without_verdicts(self.means, Outcome::Failed, error);
        let entry = Entry { by_content, ..entry };
        self.append(&entry)?;
        Ok(entry)
    }

    /// The state learns no more in this run, as a recording failed whose turn it was. One that failed before, or
    /// has meanwhile been removed, is not waited for.
    pub fn wait_for(&mut self, failed: &Job) {
        let may_succeed = !failed.failed_before() && stored::exists(&failed.input.path);
        if self.state.is_some() && failed.teaches && may_succeed {
            self.waits_for.get_or_insert(failed.label());
        }
    }

    /// Renames a recording's files to `<file>.stale`; returns a sentence about each that stays. The summary, which
    /// says that the others are whole, is renamed first: a run that is killed in between leaves no summary beside
    /// missing tables.
    pub fn set_aside(&self, job: &Job) -> Vec<String> {
        let (mut stay, verdicts) = (Vec::new(), job.verdicts_in(self.out));
        for file in results_of(&verdicts).rev().filter(|file| stored::is_file(file)) {
            if let Err(e) = stored::rename(&file, &stale(&file)) {
                stay.push(format!("{}: out of date, and stays: {e}", file.display()));
            }
        }
        stay
    }

    fn append(&mut self, entry: &Entry) -> Result<(), Stop> {
        self.journal.append(entry).map_err(|e| {
            let words = format!("{}: cannot be written: {e}", self.journal.path.display());
            Stop::unwritten(&e, &words, self.out)
        })
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
