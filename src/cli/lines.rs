//! What is noted of a recording: its entry in the journal and its row in the account. In: a planned recording
//! and what became of it. Out: [`Entry`] and [`Row`].

use super::account::Row;
use super::plan::PlannedRecording;
use crate::pipeline::resume::Decision;
use inkling_io::journal::{Entry, Means, Outcome, Results};
use inkling_io::printable;
use serde_json::Value;

/// Most characters of a reason in a row.
const MOST_OF_A_REASON: usize = 300;

impl PlannedRecording {
    /// The entry of a recording that failed. It keeps the link to the baselines, as these may have learned
    /// from the recording before. `has_place`: whether its results would have a place.
    pub fn failed(&self, by: &Means, error: &str, has_place: bool) -> Entry {
        let place = Results { verdicts: self.placed.verdicts.clone(), bytes: Vec::new() };
        Entry {
            baseline: self.link.clone(),
            results: has_place.then_some(place),
            error: Some(error.into()),
            ..Entry::new(self.placed.source.clone(), by.clone(), Outcome::Failed)
        }
    }

    /// The row of a recording without anything that its entry in the journal would add.
    pub fn row(&self, outcome: Outcome, why: &str) -> Row {
        let refused = matches!(self.decision, Decision::Refuse(_));
        let has_verdicts = !refused && outcome != Outcome::Failed;
        let verdicts = has_verdicts.then(|| self.placed.verdicts.clone());
        let why = printable::line(why, MOST_OF_A_REASON);
        Row { recording: self.placed.label(), outcome, why, verdicts, ..Row::default() }
    }

    /// The row of a recording with verdicts. It says what of them is not whole, which is more important than
    /// why this run judged or skipped the recording.
    pub fn row_of(&self, entry: &Entry) -> Row {
        let why = not_whole(entry).unwrap_or_else(|| self.words().1);
        Row {
            skipped: !self.is_to_be_judged(),
            judged_at: Some(entry.at.clone()),
            digest: entry.recording.digest.clone(),
            signals: entry.counts["signals"].as_u64().unwrap_or_default(),
            ..self.row(entry.outcome, &why)
        }
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
