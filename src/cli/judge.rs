//! The judge of a run's recordings: either this process, which judges each in its turn
//! ([`ReplayJudge`], or `FollowJudge` in `follow`), or other processes that see the same files and
//! judge all at once (`fleet/`).
//!
//! In: from `batch`, one recording and what the run has in common ([`Run`]). Out: a [`Judged`],
//! whose parts go to the journal, to the output and to the next recording; or a [`NotJudged`]. Both
//! can be written as JSON, so that a process elsewhere can return them. (A judge of *signals* is
//! another thing: a model made ready, `inkling_core::design::Judge`.)

use super::exit::{Failure, in_words, no_room};
use super::progress::Progress;
use super::{notes, report};
use crate::pipeline::{self, Control, PipelineError, RecordingReport, Replay, resume};
use inkling_core::state::Memory;
use inkling_io::dialect::Dialects;
use inkling_io::job::Job;
use inkling_io::journal::{Entry, Means, Results, Source};
use inkling_io::recording::Recording;
use inkling_io::{Limits, stored};
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::path::Path;

pub use super::report::Detail;

/// What a recording is judged with. All recordings of a run share it, except `replay` with
/// `--baseline`.
pub struct Run<'a> {
    pub out: &'a Path,
    /// How to judge. With `--baseline` its baselines change from recording to recording, since they
    /// learn.
    pub replay: Replay,
    /// How to judge, in digests, as the journal notes it.
    pub means: &'a Means,
    pub dialects: &'a Dialects,
    pub detail: Detail,
    /// Whether finished work of earlier runs is to be done again.
    pub force: bool,
    pub progress: &'a Progress,
    pub control: &'a Control,
}

/// What comes of a judged recording beside its files: for the journal, for a person, and for the next
/// recording.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Judged {
    /// Its line in the journal, without the baselines that it was judged by.
    pub entry: Entry,
    pub report: String,
    /// With `--baseline`: the channels' baselines after this recording, for the next one.
    pub baselines: Option<Memory>,
}

impl Judged {
    /// From the pipeline's report of a recording. The recording's files lie where `report` says (a
    /// process elsewhere may have put them into a place of its own), and are named in the text as
    /// if they lay at their place in `out`.
    pub fn of(
        mut report: RecordingReport,
        job: &Job,
        by: &Means,
        out: &Path,
        detail: Detail,
    ) -> Judged {
        let bytes =
            resume::files(&report.verdicts).iter().map(|file| stored::bytes(file)).collect();
        (report.name, report.verdicts) = (job.label(), job.verdicts_in(out));
        let mut text = Vec::new();
        let _ = report::print(&report, detail, &mut text); // writing to memory cannot fail
        let recording = Source {
            stamp: Some(report.stamp),
            digest: Some(report.digest.clone()),
            ..job.source.clone()
        };
        let entry = Entry {
            results: Some(Results { verdicts: job.verdicts.clone(), bytes }),
            counts: json!(report.tally.counts),
            not_judged: notes::not_judged(&report),
            damage: notes::damage(&report),
            warnings: notes::warnings(&report),
            always: notes::always(&report),
            notes: notes::notes(&report),
            seconds: report.seconds,
            ..Entry::new(recording, by.clone(), report.outcome())
        };
        Judged {
            entry,
            report: String::from_utf8_lossy(&text).into_owned(),
            baselines: report.baselines,
        }
    }
}

/// Why a recording has no verdicts.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub enum NotJudged {
    Interrupted,
    /// No room is left, so that nothing of any recording can be written.
    NoRoom(String),
    Failed {
        why: String,
        /// Whether wrong usage or settings are the cause.
        usage: bool,
        /// Whether what is in the recording is the cause.
        by_content: bool,
    },
    /// The judge failed, so that neither this nor any other recording can be judged.
    Broken(String),
}

impl From<PipelineError> for NotJudged {
    fn from(e: PipelineError) -> NotJudged {
        match e {
            PipelineError::Interrupted => NotJudged::Interrupted,
            e if no_room(&e) => NotJudged::NoRoom(e.to_string()),
            e => {
                let (why, by_content) = (in_words(&e), e.is_of_content());
                NotJudged::Failed { why, usage: Failure::from(e).is_usage(), by_content }
            }
        }
    }
}

/// Judges the recordings of a run.
pub trait Judge {
    /// Called before the first recording, with the recordings that are to be judged, in their
    /// order.
    fn begin(&mut self, _run: &Run, _jobs: &[Job]) -> Result<(), Failure> {
        Ok(())
    }

    /// Judges the recording with index `at` among those of [`Judge::begin`]. Each one is asked for
    /// at most once, in order; a run that stops asks for no more.
    fn judge(&mut self, run: &Run, at: usize, job: &Job) -> Result<Judged, NotJudged>;
}

/// Judges finished recordings in this process, one after another.
pub struct ReplayJudge;

impl Judge for ReplayJudge {
    fn judge(&mut self, run: &Run, _: usize, job: &Job) -> Result<Judged, NotJudged> {
        let label = job.label();
        let mut recording = Recording::open_with(&job.input.path, Limits::default(), run.dialects)
            .map_err(PipelineError::from)?;
        recording.label.clone_from(&label);
        let report = run.progress.during(&label, recording.bytes, run.control, || {
            let verdicts = job.verdicts_in(run.out);
            pipeline::replay(&run.replay, &recording, &verdicts, run.control)
        });
        Ok(Judged::of(report?, job, run.means, run.out, run.detail))
    }
}
