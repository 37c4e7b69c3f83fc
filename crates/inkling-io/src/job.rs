//! A job: a recording of a run, where its results lie, and what is to be done with it. What became of it is an
//! [`Entry`] of the journal.
//!
//! In, from `src/cli/plan.rs`: the recordings that a command line means, and a [`Layout`]. Out: for each a
//! [`Job`] with the path of its verdict table; all other results lie beside that table
//! ([`super::stored::beside`]). No two recordings may get the same place ([`refuse_shared`]).
//! `src/pipeline/resume.rs` decides on each ([`Decision`]); who judges is handed those that are to be judged.

use super::inputs::{Input, InputsError};
use super::journal::{Entry, Link, Means, Outcome, Results, Source};
use super::layout::Layout;
use super::objects::in_object_store;
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;
use thiserror::Error;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Job {
    pub input: Input,
    /// As the journal names it; `plan` stamps it.
    pub source: Source,
    /// Path of the verdict table below the directory of results, with `/` between its parts.
    pub verdicts: String,
    /// The printheads in it, noted only where recordings are handed out to others, who must know which
    /// of them share a state.
    pub printheads: Vec<String>,
    /// With `--baseline`, whether the state learns from it. Otherwise it is judged by the state as it is.
    pub teaches: bool,
    /// Whoever is handed a job by another process is to judge it.
    #[serde(skip)]
    pub decision: Decision,
    /// The states of the baselines before and after its last verdicts, as the journal knows them.
    #[serde(skip)]
    pub link: Option<Link>,
}

/// What is to be done with a recording.
#[derive(Clone, Debug, PartialEq)]
pub enum Decision {
    Judge(JudgeReason),
    /// It was judged, or failed for its content, and neither it nor the means have changed since.
    Finished {
        /// The journal's last line about it.
        entry: Arc<Entry>,
        /// Whether the same content lies under another path or has another time of change, which is to be noted.
        moved: bool,
    },
    Refuse(String),
}

impl Default for Decision {
    fn default() -> Decision {
        Decision::Judge(JudgeReason::New)
    }
}

#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum JudgeReason {
    #[error("new")]
    New,
    #[error("--force")]
    Forced,
    #[error("it failed before")]
    FailedBefore,
    #[error("the recording changed")]
    RecordingChanged,
    #[error("the design changed")]
    DesignChanged,
    #[error("the labels changed")]
    LabelsChanged,
    #[error("settings changed: {0}")]
    SettingsChanged(String),
    /// It was judged by channels' own baselines before and would not be now, or the other way round.
    #[error("--baseline is given now or was then, not both, or its turn came before another's")]
    BaselineChanged,
    #[error("its tables are of another version")]
    OtherTables,
    #[error("the journal does not know of its verdicts")]
    NotInJournal,
    #[error("its verdicts are gone, or not as they were written")]
    ResultsChanged,
    #[error("its baselines follow from one that is judged again")]
    AfterAnother,
}

impl Job {
    /// `day`: the day of the recording with this path, which is asked for if the layout is by day.
    pub fn new(layout: Layout, input: Input, day: impl FnOnce(&str) -> String) -> Job {
        let absolute = || match in_object_store(&input.path) {
            true => input.path.clone(),
            false => std::path::absolute(&input.path).unwrap_or_else(|_| input.path.clone()),
        };
        let source = input.path.canonicalize().unwrap_or_else(|_| absolute());
        let path = source.to_string_lossy().into_owned();
        let day = layout.is_by_day().then(|| day(&path));
        let stem = input.path.file_stem().unwrap_or_default().to_string_lossy();
        let file = format!("{stem}.verdicts.parquet");
        let below = layout.directory(&input, day.as_deref());
        let parts = below.components().filter_map(|part| match part {
            Component::Normal(part) => Some(part.to_string_lossy().into_owned()),
            _ => None,
        });
        let verdicts = parts.chain([file]).collect::<Vec<_>>().join("/");
        let source = Source { path, day, ..Source::default() };
        let (printheads, decision, link) = (Vec::new(), Decision::default(), None);
        Job { input, source, verdicts, printheads, teaches: true, decision, link }
    }

    /// What people call the recording: its path below the directory that was named.
    pub fn label(&self) -> String {
        let name = self.input.path.file_name().unwrap_or_default();
        self.input.below.join(name).to_string_lossy().into_owned()
    }

    pub fn verdicts_in(&self, out: &Path) -> PathBuf {
        self.verdicts.split('/').fold(out.to_path_buf(), |path, part| path.join(part))
    }

    pub fn is_to_be_judged(&self) -> bool {
        matches!(self.decision, Decision::Judge(_))
    }

    pub fn failed_before(&self) -> bool {
        self.decision == Decision::Judge(JudgeReason::FailedBefore)
    }

    /// What is to be done (`judge`, `skip` or `refuse`), and why.
    pub fn words(&self) -> (&'static str, String) {
        match &self.decision {
            Decision::Judge(why) if self.teaches => ("judge", why.to_string()),
            Decision::Judge(why) => ("judge", format!("{why}; the state does not learn from it")),
            Decision::Finished { entry, .. } => {
                let ended = if entry.outcome.is_judged() { "finished" } else { "failed" };
                ("skip", format!("{ended} {}", entry.at))
            }
            Decision::Refuse(why) => ("refuse", why.clone()),
        }
    }

    /// The entry of a recording that failed, was refused or was not reached. It keeps the link to the
    /// baselines, as they may have learned from this recording in an earlier run.
    pub fn without_verdicts(&self, by: &Means, outcome: Outcome, error: &str) -> Entry {
        let place = Results { verdicts: self.verdicts.clone(), bytes: Vec::new() };
        let is_refused = matches!(self.decision, Decision::Refuse(_)); // its place is another file's
        Entry {
            baseline: self.link.clone(),
            results: (!is_refused).then_some(place),
            error: Some(error.into()),
            ..Entry::new(self.source.clone(), by.clone(), outcome)
        }
    }
}

/// Refuses two recordings of one run with the same verdict table; those of earlier runs are up to `resume`.
pub fn refuse_shared(jobs: &[Job]) -> Result<(), InputsError> {
    let mut taken: HashMap<&str, &Job> = HashMap::new();
    for this in jobs {
        if let Some(first) = taken.insert(&this.verdicts, this) {
            let [first, second] = [first, this].map(|job| job.input.path.display());
            // two of one day share a place by day, too
            let by_day = match this.source.day {
                Some(_) => "",
                None => "lay them out by day (--layout date), ",
            };
            let message = format!(
                "{first} and {second} would both be written to {}: name the directory above both, \
                 whose tree is then kept (--layout tree), {by_day}or rename one",
                this.verdicts
            );
            return Err(InputsError::failed(second, message));
        }
    }
    Ok(())
}
