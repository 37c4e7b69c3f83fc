//! The report of a recording that was judged.

use super::episodes::EpisodeReport;
use super::identified::Identified;
use super::pacer::PaceReport;
use super::schedule::Refusal;
use super::tally::Tally;
use super::timings::{PhaseTiming, StageTiming};
use inkling_core::state::Memory;
use inkling_io::damage::Damage;
use inkling_io::journal::{Outcome, Stamp};
use inkling_io::recording::Recording;
use inkling_io::verdict_arrays::VerdictArrays;
use serde::Serialize;
use serde_json::{Map, Value, json};
use std::path::PathBuf;
use std::sync::Arc;

/// A printhead, topic or recording of which hardly anything was judged.
#[derive(Clone, Debug, Default, Serialize)]
pub struct NotJudged {
    /// `None`: it is about the recording as a whole, or about a topic.
    pub printhead: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub topic: Option<String>,
    pub signals: u64,
    /// How many of `signals` were judged.
    pub judged: u64,
    /// A sentence without its full stop: how many of how many signals, why, and what to do.
    pub what: String,
}

/// What a judged recording gave, for the terminal, the journal and the summary.
#[derive(Debug)]
pub struct RecordingReport {
    pub name: String,
    /// Digest of the recording's bytes as they were read.
    pub digest: String,
    pub stamp: Stamp,
    pub tally: Tally,
    pub damage: Vec<Damage>,
    pub refusals: Vec<Refusal>,
    /// Printheads of which nothing was judged, or the recording itself, if less than half of it was.
    pub not_judged: Vec<NotJudged>,
    /// Topics that look like bursts and that nothing reads, if no dialect nearly fits them.
    pub unread: Vec<NotJudged>,
    /// Printheads that a warning of `super::head_movement` is about.
    pub moved_beyond: Vec<Arc<str>>,
    /// Printheads, each with what to know about its verdicts.
    pub warnings: Vec<(Arc<str>, String)>,
    /// Number of models.
    pub models: usize,
    pub seconds: f64,
    pub verdicts: PathBuf,
    pub episodes: EpisodeReport,
    /// How the pace was kept; `None`: bursts were handed on as fast as possible.
    pub paced: Option<PaceReport>,
    /// How the recording's models came to be.
    pub identified: Identified,
    /// Durations of its phases, which came one after the other.
    pub phases: Vec<PhaseTiming>,
    /// Timings of the stages, which ran side by side.
    pub timings: Vec<StageTiming>,
    /// With `--baseline`: what is remembered for the next recording.
    pub baselines: Option<Memory>,
    /// Whether following the recording was ended while nobody had closed it.
    pub cut_off: bool,
    /// The rows, if they stay in memory.
    pub arrays: Option<VerdictArrays>,
    /// Why parts of the table, which a run that followed the recording had written, could not be removed.
    pub parts_left: Option<std::io::Error>,
}

impl RecordingReport {
    /// The outcome for the journal: the worst thing that happened.
    pub fn outcome(&self) -> Outcome {
        match self {
            _ if !self.not_judged.is_empty() => Outcome::NotJudged,
            _ if !self.damage.is_empty() => Outcome::Damaged,
            _ if !self.tally.counts.rejected.is_empty() => Outcome::Damaged,
            _ if !self.refusals.is_empty() => Outcome::WindowRefused,
            _ => Outcome::Judged,
        }
    }

    /// Adds how the run went to the metadata's document, which so becomes the summary.
    pub(super) fn summary(&self, document: &mut Map<String, Value>, recording: &Recording) {
        let mut say = |key: &str, value: Value| document.insert(key.into(), value);
        say("damage", json!(self.damage));
        say("expected", json!(recording.expected));
        say("refused_windows", json!(self.refusals));
        say("not_judged", json!(self.not_judged));
        say("unread", json!(self.unread));
        say("identified", json!(self.identified));
        let rates = json!({
            "seconds": self.seconds,
            "signals_per_s": self.tally.counts.signals as f64 / self.seconds,
            "bytes_per_s": recording.bytes as f64 / self.seconds,
            "paced_bursts": self.paced.map(|paced| paced.bursts),
            "behind_s": self.paced.map(|paced| paced.behind.as_secs_f64()),
        });
        say("rates", rates);
        say("phases", json!(self.phases));
        say("timings", json!(self.timings));
        let warning = |(printhead, what): &(Arc<str>, String)| json!({"printhead": &**printhead, "what": what});
        say("warnings", self.warnings.iter().map(warning).collect());
        say("episodes", json!(self.episodes.counts));
    }
}
