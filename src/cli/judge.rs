//! Who judges the recordings of a run: this process, each when it is its turn ([`ReplayJudge`]), or others that
//! see the same files, all at once (`fleet/`). What a judged recording leaves is the same either way.

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

/// What all recordings of a run share, as it is now.
pub struct Run<'a> {
    /// Directory of results.
    pub out: &'a Path,
    /// With `--baseline` what is remembered changes from recording to recording.
    pub replay: &'a Replay,
    pub means: &'a Means,
    pub dialects: &'a Dialects,
    pub detail: Detail,
    /// Finished work of earlier runs does not count.
    pub force: bool,
    pub say: &'a dyn Fn(&str),
    pub control: &'a Control,
}

/// A recording that is to be judged.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Item {
    /// As it was named.
    pub path: PathBuf,
    /// Absolute, without links.
    pub source: String,
    /// What a person knows it by.
    pub label: String,
    /// The verdict table below the directory of results, parts separated by `/`.
    pub verdicts: String,
    /// `None`: it cannot be looked at.
    pub stamp: Option<Stamp>,
    /// In it; only with baselines, where it is judged elsewhere and can be read.
    pub printheads: Vec<String>,
}

/// What a judged recording leaves, beside its files: for the journal, for a person, for the next one.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Judged {
    pub digest: String,
    /// Of the recording as it was read.
    pub stamp: Stamp,
    pub outcome: Outcome,
    /// Bytes of verdicts, episodes, summary.
    pub bytes: Vec<u64>,
    /// As in its summary.
    pub counts: Value,
    /// Of what nothing, or less than half, could be judged.
    pub not_judged: Vec<String>,
    pub damage: Vec<CountedMessage>,
    pub warnings: Vec<CountedMessage>,
    pub notes: Vec<CountedMessage>,
    pub seconds: f64,
    /// What is said of it, and where the time went; lines.
    pub report: String,
    pub timings: Vec<String>,
    /// With `--baseline`: what is remembered for the next recording.
    pub baselines: Option<Memory>,
}

impl Judged {
    /// Of a recording whose files lie where `report` says, and will lie at `verdicts`.
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
    /// Nothing more can be written, of no recording.
    NoRoom(String),
    Failed {
        why: String,
        /// By wrong usage or settings.
        usage: bool,
    },
    /// Nobody is left to judge it, or any other.
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

pub trait Judge {
    /// Before the first is asked for: all of them, in this order.
    fn begin(&mut self, _run: &Run, _items: &[Item]) -> Result<(), Failure> {
        Ok(())
    }

    /// The one at this place among them; each is asked for once, in their order.
    fn judge(&mut self, run: &Run, at: usize, item: &Item) -> Result<Judged, NotJudged>;

    /// Whether all are judged from the beginning on, not each at its turn.
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
