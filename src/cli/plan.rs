//! The plan of a run: what is to be done with each recording, and why. It is decided for all recordings
//! before anything is written. In: recordings and the journal of earlier runs, from `replay`. Out:
//! [`Job`]s in the order in which they are to be judged.
//!
//! The steps: each recording gets a place for its results ([`place`]); each is decided on by itself
//! ([`Planner::plan`], by `pipeline::resume`); with `--baseline` the recordings are put into the
//! order of their times, and those that follow one that is judged again are judged again, too
//! ([`Planner::chain`], by `pipeline::chain`).

use super::account::{RUN_NAME, Row};
use super::acknowledge::ACKNOWLEDGED_NAME;
use super::exit::{Exit, Failure};
use super::night::{NIGHT_NAME, PAGE_NAME};
use super::output;
use super::progress::{Progress, thousands};
use super::report::printable_path;
use super::report_page::ACCOUNT_NAME;
use crate::pipeline::chain::{self, GoOn};
use crate::pipeline::resume::{self, Resume};
use crate::pipeline::visit::Pass;
use crate::pipeline::{Control, PipelineError};
use crate::settings::Settings;
use inkling_io::dialect::Dialects;
use inkling_io::inputs::{Input, InputsError};
use inkling_io::job::{Decision, Job, JudgeReason};
use inkling_io::journal::{Journal, Link, Outcome};
use inkling_io::layout::{self, Layout};
use inkling_io::recording::Recording;
use inkling_io::when::{self, Begin};
use inkling_io::{Limits, digest, part_file, stored};
use serde_json::json;
use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

/// Gives each recording a place for its results. With a layout by day the recording's day (UTC, of
/// its begin) is taken from the journal if the file has not changed, which saves opening the
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
/// run writes: those of verdicts, their counts, episodes, summaries and `run.json`, and those of a night.
pub fn sweep(jobs: &[Job], out: &Path) {
    let files = jobs.iter().flat_map(|job| resume::files(&job.verdicts_in(out)));
    let dirs = files.filter_map(|file| file.parent().map(Path::to_path_buf));
    let dirs: BTreeSet<PathBuf> = dirs.chain([out.into()]).collect();
    let endings = [
        ".verdicts.parquet",
        ".episodes.parquet",
        ".summary.json",
        ".annotations.mcap",
        ".faults.parquet",
        ".counts",
    ];
    let names = [RUN_NAME, ACCOUNT_NAME, NIGHT_NAME, PAGE_NAME, ACKNOWLEDGED_NAME];
    let ours = |name: &str| names.contains(&name) || endings.iter().any(|end| name.ends_with(end));
    for dir in &dirs {
        part_file::sweep(dir, ours);
    }
}

/// Recordings in the order that baselines need.
#[derive(Default)]
pub struct Chained {
    pub jobs: Vec<Job>,
    /// The recording, if any, whose place is not known tonight.
    pub waits_for: Option<String>,
    /// The latest recording that the baselines have learned from, and when it begins, ns since 1970.
    pub latest: Option<(String, i64)>,
    /// Whether the baselines begin anew with the first recording that is judged.
    pub is_anew: bool,
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
                Decision::Judge(_) => self
                    .resume
                    .journal
                    .link_of(&job.source.path, &self.resume.means.design)
                    .cloned(),
                Decision::Refuse(_) => None,
            };
        }
        Ok(jobs)
    }

    /// Orders the recordings by when they begin, since each is judged by the baselines that the recordings before
    /// it left. If one is to be judged again and the baselines of its turn are there, all recordings after it are,
    /// too; if they are not, it teaches nothing. What is refused, cannot be read or has no time comes last, and
    /// teaches nothing either. `baselines`: digest of the baseline file; `None`: there is none yet.
    pub fn chain(
        &self,
        mut jobs: Vec<Job>,
        baselines: &Option<String>,
    ) -> Result<Chained, Failure> {
        // 1. when each begins: the journal knows it of finished recordings, the others are opened
        let mut unread = None;
        for job in &mut jobs {
            job.source.starts_at_ns = match &job.decision {
                Decision::Refuse(_) => None,
                Decision::Finished { entry, .. } if entry.by_content => None,
                Decision::Finished { entry, .. } if entry.recording.starts_at_ns.is_some() => {
                    job.source.misdated = entry.recording.misdated;
                    entry.recording.starts_at_ns
                }
                _ => {
                    let (begin, is_unread) = self.begin(job)?;
                    if is_unread && !job.failed_before() {
                        unread.get_or_insert(job.label());
                    }
                    job.source.misdated = begin.is_some_and(|begin| begin.is_misdated);
                    begin.map(|begin| begin.t_ns)
                }
            };
        }
        jobs.sort_by_key(|job| job.source.starts_at_ns.unwrap_or(i64::MAX));
        let has_a_place = |job: &Job| {
            job.source.starts_at_ns.is_some_and(|begin_ns| !when::is_far_ahead(begin_ns))
        };
        let (mut chained, mut others): (Vec<_>, Vec<_>) = jobs.into_iter().partition(has_a_place);
        others.iter_mut().for_each(|job| job.teaches = false);

        // 2. where the baselines go on
        let first = chained.iter().position(Job::is_to_be_judged);
        let first = first.unwrap_or(chained.len());
        let links: Vec<Option<Link>> = chained.iter().map(|job| job.link.clone()).collect();
        let go_on = chain::go_on(&links, first, baselines);
        match go_on {
            GoOn::From(from) | GoOn::Anew(from) => {
                for job in chained[from..].iter_mut().filter(|job| !job.is_to_be_judged()) {
                    job.decision = Decision::Judge(JudgeReason::AfterAnother);
                }
            }
            GoOn::After(last) => {
                chained[..last].iter_mut().for_each(|job| job.teaches = false);
            }
        }
        let has_taught = |job: &&Job| job.link.as_ref().is_some_and(Link::taught);
        let latest = chained.iter().rfind(has_taught);
        let latest = latest.and_then(|job| Some((job.label(), job.source.starts_at_ns?)));
        chained.iter_mut().filter(|job| job.source.misdated).for_each(|job| job.teaches = false);
        chained.extend(others);
        let is_anew = matches!(go_on, GoOn::Anew(_));
        Ok(Chained { jobs: chained, waits_for: unread, latest, is_anew })
    }

    /// When a recording begins, and whether it could not be read although it is there; its printheads are noted
    /// if they are asked for. The error of one without a begin is told when it is judged.
    fn begin(&self, job: &mut Job) -> Result<(Option<Begin>, bool), Failure> {
        let opened = Recording::open_with(&job.input.path, Limits::default(), self.dialects);
        let recording = match opened {
            Ok(recording) => recording,
            Err(e) => return Ok((None, !PipelineError::from(e).is_of_content())),
        };
        let begin = when::begin(&recording, || self.control.check())?;
        if self.printheads {
            job.printheads =
                chain::printheads(Pass { recording: &recording, control: self.control })?;
        }
        let is_unread = recording.check_read().is_err();
        Ok((begin.filter(|_| !is_unread), is_unread))
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
