//! The report of a recording that was judged, for the terminal, the journal and the summary.
//!
//! In: a finished recording, from `finish`, which fills it in. Out: [`RecordingReport`], with its outcome in a word, and
//! the part of the summary that says how the run went.

use super::episodes::EpisodeReport;
use super::head_movement::HeadMovement;
use super::judges::Refusal;
use super::not_judged::NotJudged;
use super::pacer::PaceReport;
use super::tally::Tally;
use super::timings::{PhaseTiming, StageTiming};
use crate::report::WrongStretch;
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
    pub digest: String,
    pub stamp: Stamp,
    pub tally: Tally,
    pub damage: Vec<Damage>,
    pub refusals: Vec<Refusal>,
    /// Printheads of which nothing was judged, or the recording itself, if less than half of it was.
    pub not_judged: Vec<NotJudged>,
    /// Topics that look like bursts and that nothing reads, if no dialect nearly fits them.
    pub unread: Vec<NotJudged>,
    /// What was odd about the times of printheads' bursts.
    pub odd_times: Vec<NotJudged>,
    /// The bursts whose times stand in no order with others.
    pub wrong_times: Vec<WrongStretch>,
    pub moved: Vec<HeadMovement>,
    /// Printheads, each with what to know about its verdicts.
    pub warnings: Vec<(Arc<str>, String)>,
    /// Those of them about what all channels of a printhead did, or what its channels are.
    pub head_changes: Vec<(Arc<str>, String)>,
    pub models: usize,
    pub seconds: f64,
    /// Path of the verdict table; empty: the rows stay in memory.
    pub verdicts: PathBuf,
    pub episodes: EpisodeReport,
    /// How the pace was kept; `None`: bursts were handed on as fast as possible.
    pub paced: Option<PaceReport>,
    pub phases: Vec<PhaseTiming>,
    pub timings: Vec<StageTiming>,
    /// With `--baseline`: what is remembered for the next recording.
    pub baselines: Option<Memory>,
    /// Whether following the recording was ended while nobody had closed it.
    pub cut_off: bool,
    pub arrays: Option<VerdictArrays>,
}

impl RecordingReport {
    /// Whether a warning about all channels of a printhead explains what its windows and signals show.
    pub fn has_moved(&self, printhead: &str) -> bool {
        self.moved.iter().any(|of| *of.printhead == *printhead && of.is_of_all_channels())
    }

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
        say("odd_times", json!(self.odd_times));
        say("wrong_times", json!(self.wrong_times));
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
        say("head_changes", self.head_changes.iter().map(warning).collect());
        say("episodes", json!(self.episodes.counts));
        say("moved_together", json!(self.moved));
        if let Some(memory) = &self.baselines {
            // what is known of other printheads says nothing of this recording
            let own = memory.printheads.iter();
            let own = own.filter(|(name, _)| self.tally.printheads.contains_key(name.as_str()));
            let channels: usize = own.map(|(_, of)| of.channels.len()).sum();
            say("baseline", json!({ "channels_remembered": channels }));
        }
    }
}
