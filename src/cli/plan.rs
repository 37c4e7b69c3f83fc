//! The plan of a run: what is to be done with each recording, and why. It is decided for all recordings
//! before anything is written. In: recordings and the journal of earlier runs, from `replay`. Out:
//! [`Job`]s in the order in which they are to be judged.
//!
//! The steps: each recording gets a place for its results ([`place`]); each is decided on by itself
//! ([`Planner::plan`], by `pipeline::resume`); with `--baseline` the recordings are put into the
//! order of their times, and those that follow one that is judged again are judged again, too
//! ([`Planner::chain`], by `pipeline::chain`).

use super::account::{RUN_NAME, Row};
use super::exit::{Exit, Failure};
use super::output;
use super::progress::{Progress, thousands};
use super::report::printable_path;
use crate::pipeline::resume::{self, Resume};
use crate::pipeline::visit::Pass;
use crate::pipeline::{Control, PipelineError, chain};
use crate::settings::Settings;
use inkling_io::dialect::Dialects;
use inkling_io::inputs::{Input, InputsError};
use inkling_io::job::{Decision, Job, JudgeReason};
use inkling_io::journal::{Journal, Link, Outcome};
use inkling_io::layout::{self, Layout};
use inkling_io::recording::Recording;
use inkling_io::{Limits, digest, part_file, stored};
use serde_json::json;
use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

/// Gives each recording a place for its results. With a layout by day the recording's day (UTC, of
/// its first burst) is taken from the journal if the file has not changed, which saves opening the
/// file.
pub fn place(
    inputs: Vec<Input>,
    layout: Layout,
    journal: &Journal,
    dialects: &Dialects,
) -> Vec<Job> {
    let day = |path: &Path, source: &str| {
        let stamp = stored::stamp(path).ok();
        let known = journal.of_recording(source).map(|entry| &entry.recording);
        let day_then = known.and_then(|of| of.day.clone());
        let is_unchanged = stamp.is_some() && known.is_some_and(|of| of.stamp == stamp);
        // if the recording cannot be read now, its earlier results are still where they were
        let day = match day_then {
            Some(day) if is_unchanged => Some(day),
            day_then => layout::day_of(path, dialects).or(day_then),
        };
        day.unwrap_or_else(|| layout::UNDATED.into())
    };
    let of_input = |input: Input| {
        let path = input.path.clone();
        Job::new(layout, input, |source| day(&path, source))
    };
    inputs.into_iter().map(of_input).collect()
}

/// Whether an earlier run judged a recording by the dialects of these settings, and the file has
/// not changed since, by its size and time of change.
pub fn is_known(input: &Input, journal: &Journal, settings: &Settings) -> bool {
    let stamp = stored::stamp(&input.path).ok().filter(|stamp| stamp.modified_ns.is_some());
    let (Some(stamp), Ok(source)) = (stamp, input.path.canonicalize()) else { return false };
    journal.of_recording(&source.to_string_lossy()).is_some_and(|entry| {
        entry.outcome.is_judged()
            && entry.recording.stamp == Some(stamp)
            && entry.by.settings["input"]["dialect"] == json!(settings.input.dialect)
    })
}

/// The row of a recording that was named and does not exist.
pub fn lost(e: &InputsError) -> Row {
    let (outcome, why) = (Outcome::Failed, e.to_string());
    Row { recording: e.subject.clone(), outcome, why, ..Row::default() }
}

/// Removes the unfinished files (`.part`) that killed runs left in the directories to which this
/// run writes: those of verdicts, episodes, summaries and `run.json`.
pub fn sweep(jobs: &[Job], out: &Path) {
    let files = jobs.iter().flat_map(|job| resume::files(&job.verdicts_in(out)));
    let dirs = files.filter_map(|file| file.parent().map(Path::to_path_buf));
    let dirs: BTreeSet<PathBuf> = dirs.chain([out.into()]).collect();
    let endings = [".verdicts.parquet", ".episodes.parquet", ".summary.json"];
    let ours = |name: &str| name == RUN_NAME || endings.iter().any(|end| name.ends_with(end));
    for dir in &dirs {
        part_file::sweep(dir, ours);
    }
}

/// Decides what is to be done with recordings.
pub struct Planner<'a> {
    /// Whether the printheads of recordings are looked up: for a judge that hands recordings out to
    /// others, and so must know which of them share baselines. Only [`Planner::chain`] does so.
    pub printheads: bool,
    /// Decides whether a recording is finished.
    pub resume: Resume<'a>,
    pub dialects: &'a Dialects,
    pub progress: &'a Progress,
    pub control: &'a Control,
}

impl Planner<'_> {
    /// Decides on each recording by itself, without the order that baselines need. A failure only
    /// if the run is interrupted.
    pub fn plan(&self, mut jobs: Vec<Job>) -> Result<Vec<Job>, Failure> {
        for job in &mut jobs {
            job.source.stamp = stored::stamp(&job.input.path).ok();
            job.decision = self.resume.decide(job, |path| self.digest(path))?;
            job.link = match &job.decision {
                Decision::Finished { entry, .. } => entry.baseline.clone(),
                Decision::Judge(_) => self.learned_from(job),
                Decision::Refuse(_) => None,
            };
        }
        Ok(jobs)
    }

    /// The states of the baselines before and after they learned from a recording that is to be judged again;
    /// `None` if they did not.
    fn learned_from(&self, job: &Job) -> Option<Link> {
        let known = self.resume.journal.of_result(&job.verdicts)?;
        known.baseline.clone().filter(|_| known.recording.path == job.source.path)
    }

    /// Orders the recordings by the times of their first bursts, since each is judged by the
    /// baselines that the recordings before it left. If one is to be judged again, all recordings
    /// after it are, too. Recordings that are refused or cannot be read come last. `baselines`:
    /// digest of the baseline file; `None`: there is none yet.
    ///
    /// # Errors
    /// No state of the baselines is left from which the first recording could be judged
    /// again as it was.
    pub fn chain(
        &self,
        mut jobs: Vec<Job>,
        baselines: &Option<String>,
    ) -> Result<Vec<Job>, Failure> {
        // 1. when each begins: the journal knows it of finished recordings, the others are opened
        for job in &mut jobs {
            job.source.starts_at_ns = match &job.decision {
                Decision::Refuse(_) => None,
                Decision::Finished { entry, .. } if entry.recording.starts_at_ns.is_some() => {
                    entry.recording.starts_at_ns
                }
                _ => self.begin(job)?,
            };
        }
        jobs.sort_by_key(|job| job.source.starts_at_ns.unwrap_or(i64::MAX));

        // the baselines do not learn from recordings that are refused or cannot be read, which have
        // no time: these are no links of the chain
        let teaches = |job: &Job| job.source.starts_at_ns.is_some();
        let (mut chained, others): (Vec<_>, Vec<_>) = jobs.into_iter().partition(teaches);

        // 2. The baselines must be as they were before the first recording that is to be judged. If
        // they are not, judging resumes at an earlier recording, or is impossible.
        let first = chained.iter().position(Job::is_to_be_judged);
        let first = first.unwrap_or(chained.len());
        let links: Vec<Option<Link>> = chained.iter().map(|job| job.link.clone()).collect();
        let Some(from) = chain::resume_at(&links, first, baselines) else {
            return Err(broken_chain(&chained[first]));
        };

        // 3. all recordings from there on are judged again, since the baselines before them change
        for job in chained[from..].iter_mut().filter(|job| !job.is_to_be_judged()) {
            job.decision = Decision::Judge(JudgeReason::AfterAnother);
        }
        chained.extend(others);
        Ok(chained)
    }

    /// The time of a recording's first burst; its printheads are noted if they are asked for. `None` if the
    /// recording cannot be read: the error is told when it is judged.
    fn begin(&self, job: &mut Job) -> Result<Option<i64>, Failure> {
        let opened = Recording::open_with(&job.input.path, Limits::default(), self.dialects);
        let Ok(recording) = opened else { return Ok(None) };
        let pass = Pass { recording: &recording, control: self.control };
        let starts = match chain::starts(pass, self.printheads) {
            Ok(starts) => starts,
            Err(e @ PipelineError::Interrupted) => return Err(e.into()),
            Err(_) => return Ok(None),
        };
        if self.printheads {
            job.printheads = starts.keys().map(|name| name.to_string()).collect();
        }
        Ok(starts.into_values().min())
    }

    /// The digest of a file, with progress; `None` if it cannot be read. An interruption is a failure.
    fn digest(&self, path: &Path) -> Result<Option<String>, Failure> {
        let (name, bytes) = (path.to_string_lossy(), stored::bytes(path));
        self.control.bytes_read.store(0, Ordering::Relaxed);
        let check = |n| {
            self.control.bytes_read.fetch_add(n, Ordering::Relaxed);
            let is_interrupted = self.control.interrupted();
            if is_interrupted { Err(io::Error::from(io::ErrorKind::Interrupted)) } else { Ok(()) }
        };
        let digest =
            self.progress.during(&name, bytes, self.control, || digest::of_file(path, check));
        if digest.is_err() && self.control.interrupted() {
            return Err(PipelineError::Interrupted.into());
        }
        Ok(digest.ok())
    }
}

/// The failure if no state of the baselines is left from which `first` could be judged again.
fn broken_chain(first: &Job) -> Failure {
    let (name, (_, why)) = (printable_path(&first.label()), first.words());
    Failure::new(format!(
        "{name}: to be judged ({why}), but the channels' baselines have meanwhile learned from it or from \
         recordings after it: its verdicts would not be those of an undisturbed run. Put the baseline \
         file back as it was before this recording, or remove it to judge all of them again in their \
         order; what another run judges needs a baseline file of its own"
    ))
}

/// Prints what would be done, and why, for `--dry-run`. `lost`: rows of names that lead to no
/// recording. The exit status is 3 if something would be refused or is lost.
pub fn print(jobs: &[Job], lost: &[Row], json: bool) -> Result<Exit, Failure> {
    let missing = lost.iter().map(|row| (row.recording.clone(), ("lost", row.why.clone())));
    let all = jobs.iter().map(|job| (job.label(), job.words())).chain(missing);
    let mut counts: BTreeMap<&str, u64> = BTreeMap::new();
    for (recording, (what, why)) in all {
        *counts.entry(what).or_default() += 1;
        let event = || json!({ "event": "plan", "recording": recording, "do": what, "why": why });
        let text = || format!("{what:<6}  {}  {why}", printable_path(&recording));
        output::tell(json, event, text)?;
    }
    let [judge, skip, refuse, lost] =
        ["judge", "skip", "refuse", "lost"].map(|what| counts.get(what).copied().unwrap_or(0));
    if !json {
        let (judge, skip) = (thousands(judge), thousands(skip));
        let mut out = output::report();
        writeln!(out, "would judge {judge}, skip {skip}, refuse {refuse}, not find {lost}")?;
    }
    Ok(if refuse + lost > 0 { Exit::Incomplete } else { Exit::Done })
}
