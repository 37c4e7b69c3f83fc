//! What is told of a recording that was judged.

use super::episodes::EpisodeReport;
use super::identified::Identified;
use super::not_judged::NotJudged;
use super::pacer::PaceReport;
use super::schedule::Refusal;
use super::tally::Tally;
use super::timings::{PhaseTiming, StageTiming};
use inkling_core::state::Memory;
use inkling_io::damage::Damage;
use inkling_io::journal::{Outcome, Stamp};
use inkling_io::recording::Recording;
use inkling_io::verdict_arrays::VerdictArrays;
use serde_json::{Map, Value, json};
use std::path::PathBuf;
use std::sync::Arc;

/// What a judged recording gave, for the terminal, the journal and the summary.
#[derive(Debug)]
pub struct RecordingReport {
    pub name: String,
    /// Of the recording, as it was read.
    pub digest: String,
    pub stamp: Stamp,
    pub tally: Tally,
    pub damage: Vec<Damage>,
    pub refusals: Vec<Refusal>,
    /// Printheads of which nothing was judged, or the recording, if less than half of it was.
    pub not_judged: Vec<NotJudged>,
    /// Topics that look like bursts and are read by nothing, if nobody knows that they are.
    pub unread: Vec<NotJudged>,
    /// Printheads of which a warning says that all channels moved together beyond the bounds.
    pub moved_beyond: Vec<Arc<str>>,
    /// Printhead and what to know about its verdicts.
    pub warnings: Vec<(Arc<str>, String)>,
    pub models: usize,
    pub seconds: f64,
    pub verdicts: PathBuf,
    pub episodes: EpisodeReport,
    /// How the pace was kept, where there was one.
    pub paced: Option<PaceReport>,
    /// How its models came to be.
    pub identified: Identified,
    /// Where the time went, one after the other.
    pub phases: Vec<PhaseTiming>,
    /// Where that of the stages went, side by side.
    pub timings: Vec<StageTiming>,
    /// With `--baseline`: what is remembered for the next recording.
    pub baselines: Option<Memory>,
    /// It was followed until that was enough, and nobody had closed it.
    pub cut_off: bool,
    /// Of a recording whose rows stay in memory.
    pub arrays: Option<VerdictArrays>,
    /// Why parts of the table, of a run that followed the recording, could not be removed.
    pub parts_left: Option<std::io::Error>,
}

impl RecordingReport {
    /// The worst that happened to it.
    pub fn outcome(&self) -> Outcome {
        match self {
            _ if !self.not_judged.is_empty() => Outcome::NotJudged,
            _ if !self.damage.is_empty() => Outcome::Damaged,
            _ if !self.tally.counts.rejected.is_empty() => Outcome::Damaged,
            _ if !self.refusals.is_empty() => Outcome::WindowRefused,
            _ => Outcome::Judged,
        }
    }

    /// Adds how it went to the metadata's document.
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
