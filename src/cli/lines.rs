//! What is noted of a recording: its entry in the journal and its row in the account. In: a planned recording
//! and what became of it. Out: [`Entry`] and [`Row`].

use super::account::Row;
use super::judge::{Item, Judged};
use super::plan::PlannedRecording;
use crate::pipeline::resume::Decision;
use inkling_io::journal::{self, Entry, Link, Means, Outcome, Results, Source, Stamp};
use inkling_io::printable;
use serde_json::Value;

/// Most characters of a reason in a row.
const MOST_OF_A_REASON: usize = 300;

impl PlannedRecording {
    /// What the judge is told of the recording.
    pub fn item(&self) -> Item {
        Item {
            path: self.placed.input.path.clone(),
            source: self.placed.source.clone(),
            label: self.placed.label(),
            verdicts: self.placed.verdicts.clone(),
            stamp: self.stamp(),
            printheads: self.printheads.clone(),
        }
    }

    /// The entry of a recording that was judged.
    pub fn judged(&self, by: &Means, judged: &Judged, baseline: Option<Link>) -> Entry {
        let bytes = judged.bytes.clone();
        Entry {
            version: journal::VERSION,
            at: journal::now(),
            recording: self.source(Some(judged.stamp), Some(judged.digest.clone())),
            by: by.clone(),
            baseline,
            outcome: judged.outcome,
            results: Some(Results { verdicts: self.placed.verdicts.clone(), bytes }),
            error: None,
            counts: judged.counts.clone(),
            not_judged: judged.not_judged.clone(),
            damage: judged.damage.clone(),
            warnings: judged.warnings.clone(),
            notes: judged.notes.clone(),
            seconds: judged.seconds,
        }
    }

    /// The entry of a recording that failed. It keeps the link to the baselines, as these may have learned
    /// from the recording before. `has_place`: whether its results would have a place.
    pub fn failed(&self, by: &Means, error: &str, has_place: bool) -> Entry {
        let place = Results { verdicts: self.placed.verdicts.clone(), bytes: Vec::new() };
        Entry {
            version: journal::VERSION,
            at: journal::now(),
            recording: self.source(self.stamp(), None),
            by: by.clone(),
            baseline: self.link.clone(),
            outcome: Outcome::Failed,
            results: has_place.then_some(place),
            error: Some(error.into()),
            counts: Value::Null,
            not_judged: Vec::new(),
            damage: Vec::new(),
            warnings: Vec::new(),
            notes: Vec::new(),
            seconds: 0.0,
        }
    }

    /// How the journal identifies the recording.
    pub fn source(&self, stamp: Option<Stamp>, digest: Option<String>) -> Source {
        Source {
            path: self.placed.source.clone(),
            stamp,
            digest,
            day: self.placed.day.clone(),
            starts_at_ns: self.starts_at_ns,
        }
    }

    /// The row of a recording without anything that its entry in the journal would add.
    pub fn row(&self, outcome: Outcome, why: &str) -> Row {
        let refused = matches!(self.decision, Decision::Refuse(_));
        let has_verdicts = !refused && outcome != Outcome::Failed;
        let verdicts = has_verdicts.then(|| self.placed.verdicts.clone());
        let why = printable::line(why, MOST_OF_A_REASON);
        Row { verdicts, ..Row::without(self.placed.label(), outcome, why) }
    }

    /// The row of a recording with verdicts.
    fn row_of(&self, entry: &Entry, why: &str) -> Row {
        let (judged_at, digest) = (Some(entry.at.clone()), entry.recording.digest.clone());
        Row { judged_at, digest, ..self.row(entry.outcome, why) }
    }

    /// The row of a recording that this run judged: what of it is not whole, or else why it was judged.
    pub fn judged_row(&self, judged: &Judged, entry: &Entry) -> Row {
        // what is not whole is more important than why it was judged
        let why = match (&self.decision, not_whole(entry)) {
            (_, Some(what)) => what,
            (Decision::Judge(why), None) => why.to_string(),
            _ => String::new(),
        };
        Row { signals: judged.signals(), ..self.row_of(entry, &why) }
    }

    /// The row of a recording that an earlier run finished.
    pub fn skipped_row(&self, entry: &Entry) -> Row {
        let why = not_whole(entry).unwrap_or_else(|| format!("finished {}", entry.at));
        let signals = entry.counts["signals"].as_u64().unwrap_or_default();
        Row { skipped: true, signals, ..self.row_of(entry, &why) }
    }
}

/// What of a recording was not judged, or not judged as asked; `None` if it is whole.
fn not_whole(entry: &Entry) -> Option<String> {
    let refused = || entry.warnings.first().map(|told| told.what.clone());
    let rejected = || {
        let by_reason = entry.counts["rejected"].as_object();
        let n: u64 = by_reason?.values().filter_map(Value::as_u64).sum();
        (n > 0).then(|| format!("{n} signals rejected"))
    };
    match entry.outcome {
        Outcome::NotJudged => entry.not_judged.first().cloned(),
        Outcome::Damaged => {
            let damage = entry.damage.first().map(|damage| damage.what.clone());
            Some(damage.or_else(rejected).or_else(refused).unwrap_or_default())
        }
        Outcome::WindowRefused => refused(),
        _ => None,
    }
}
