//! The judge of a run's recordings: either this process, which judges each in its turn ([`ReplayJudge`]), or
//! other processes that see the same files and judge all at once (`fleet/`). What is kept of a judged
//! recording is the same either way.

use super::exit::Failure;
use super::progress::Progress;
use super::{failed, notes, report};
use crate::pipeline::{self, Control, PipelineError, RecordingReport, Replay, resume};
use inkling_core::state::Memory;
use inkling_io::dialect::Dialects;
use inkling_io::journal::{CountedMessage, Means, Outcome, Stamp};
use inkling_io::recording::Recording;
use inkling_io::{Limits, stored};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

pub use super::report::Detail;

/// What all recordings of a run share, at the time when one is judged.
pub struct Run<'a> {
    /// Directory of results.
    pub out: &'a Path,
    /// How to judge. With `--baseline` it changes from recording to recording, as baselines learn.
    pub replay: &'a Replay,
    pub means: &'a Means,
    pub dialects: &'a Dialects,
    pub detail: Detail,
    /// Whether finished work of earlier runs is to be done again.
    pub force: bool,
    pub say: &'a dyn Fn(&str),
    pub control: &'a Control,
}

/// A recording that is to be judged.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Item {
    /// Path as the user named it.
    pub path: PathBuf,
    /// Absolute path without symbolic links.
    pub source: String,
    /// Name in messages and reports.
    pub label: String,
    /// Path of the verdict table relative to the directory of results, its parts separated by `/`.
    pub verdicts: String,
    /// Size and time of change of the file; `None` if these cannot be read.
    pub stamp: Option<Stamp>,
    /// Names of its printheads. They are known only with baselines, if the recording is judged elsewhere and
    /// can be read.
    pub printheads: Vec<String>,
}

/// What comes of a judged recording beside its files: for the journal, for a person, and for the next
/// recording.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Judged {
    pub digest: String,
    /// Size and time of change of the recording when it was read.
    pub stamp: Stamp,
    pub outcome: Outcome,
    /// Sizes in bytes of the tables of verdicts and of episodes, and of the summary.
    pub bytes: Vec<u64>,
    /// Counts of signals, as in the summary.
    pub counts: Value,
    /// Sentences about parts of which nothing, or less than half, could be judged.
    pub not_judged: Vec<String>,
    pub damage: Vec<CountedMessage>,
    pub warnings: Vec<CountedMessage>,
    pub notes: Vec<CountedMessage>,
    pub seconds: f64,
    /// The printed report of the recording.
    pub report: String,
    /// Where the time went, as lines of text.
    pub timings: Vec<String>,
    /// With `--baseline`: the channels' baselines after this recording, for the next one.
    pub baselines: Option<Memory>,
}

impl Judged {
    /// From the report of a recording. Its files lie where `report` says, and are named in the text as if
    /// they were at `verdicts`.
    pub fn of(mut report: RecordingReport, label: &str, verdicts: &Path, detail: Detail) -> Judged {
        let size = |file: PathBuf| stored::bytes(&file);
        let bytes = resume::files(&report.verdicts).map(size).to_vec();
        (report.name, report.verdicts) = (label.into(), verdicts.into());
        let mut text = Vec::new();
        let _ = report::print(&report, detail, &mut text); // memory takes all
        Judged {
            digest: report.digest.clone(),
            stamp: report.stamp,
            outcome: report.outcome(),
            bytes,
            counts: json!(report.tally.counts),
            not_judged: notes::not_judged(&report),
            damage: notes::damage(&report),
            warnings: notes::warnings(&report),
            notes: notes::notes(&report),
            seconds: report.seconds,
            report: String::from_utf8_lossy(&text).into_owned(),
            timings: report::timings(&report),
            baselines: report.baselines,
        }
    }

    pub fn signals(&self) -> u64 {
        self.counts["signals"].as_u64().unwrap_or_default()
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
    },
    /// The judge failed, so that neither this nor any other recording can be judged.
    Broken(String),
}

impl From<PipelineError> for NotJudged {
    fn from(e: PipelineError) -> NotJudged {
        match e {
            PipelineError::Interrupted => NotJudged::Interrupted,
            e if failed::no_room(&e) => NotJudged::NoRoom(e.to_string()),
            e => {
                let why = failed::in_words(&e);
                NotJudged::Failed { why, usage: Failure::from(e).is_usage() }
            }
        }
    }
}

/// Judges the recordings of a run.
pub trait Judge {
    /// Called before the first recording, with all of them in their order.
    fn begin(&mut self, _run: &Run, _items: &[Item]) -> Result<(), Failure> {
        Ok(())
    }

    /// Judges the recording with index `at` among those of [`Judge::begin`]. Each one is asked for once, in
    /// order.
    fn judge(&mut self, run: &Run, at: usize, item: &Item) -> Result<Judged, NotJudged>;

    /// Whether all recordings are judged from the beginning on, rather than each in its turn.
    fn all_at_once(&self) -> bool {
        false
    }
}

/// Judges finished recordings in this process, one after another.
pub struct ReplayJudge<'a> {
    pub progress: &'a Progress,
}

impl Judge for ReplayJudge<'_> {
    fn judge(&mut self, run: &Run, _: usize, item: &Item) -> Result<Judged, NotJudged> {
        let verdicts = item.verdicts_in(run.out);
        let mut recording = Recording::open_with(&item.path, Limits::default(), run.dialects)
            .map_err(PipelineError::from)?;
        recording.label.clone_from(&item.label);
        let report = self.progress.during(&item.label, recording.bytes, run.control, || {
            pipeline::replay(run.replay, &recording, &verdicts, run.control)
        });
        Ok(Judged::of(report?, &item.label, &verdicts, run.detail))
    }
}

impl Item {
    pub fn verdicts_in(&self, out: &Path) -> PathBuf {
        self.verdicts.split('/').fold(out.to_path_buf(), |path, part| path.join(part))
    }
}
