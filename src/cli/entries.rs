//! What is noted of a recording: its entry in the journal (`journal.jsonl`, which tells later runs)
//! and its row in the account (`run.json`, which tells of this run). In: a planned recording and
//! what became of it, from `batch`. Out: [`Entry`] and [`Row`]. The entry of a recording that was
//! judged is made by the judge (`Judged::of`); here is that of one that failed.

use super::account::Row;
use super::plan::PlannedRecording;
use crate::pipeline::resume::Decision;
use inkling_io::journal::{Entry, Means, Outcome, Results};
use inkling_io::printable;
use serde_json::Value;

/// Most characters of a reason in a row.
const MOST_OF_A_REASON: usize = 300;

impl PlannedRecording {
    /// The entry of a recording that failed or was refused. It keeps the link to the baselines, as
    /// they may have learned from this recording in an earlier run. `has_place`: whether the
    /// recording's results have a place; that of a refused recording is another's.
    pub fn failed(&self, by: &Means, error: &str, has_place: bool) -> Entry {
        let place = Results { verdicts: self.placed.verdicts.clone(), bytes: Vec::new() };
        Entry {
            baseline: self.link.clone(),
            results: has_place.then_some(place),
            error: Some(error.into()),
            ..Entry::new(self.placed.source.clone(), by.clone(), Outcome::Failed)
        }
    }

    /// The row of a recording without anything that its entry in the journal would add. `why`: cut
    /// to a line.
    pub fn row(&self, outcome: Outcome, why: &str) -> Row {
        let refused = matches!(self.decision, Decision::Refuse(_));
        let has_verdicts = !refused && outcome != Outcome::Failed;
        let verdicts = has_verdicts.then(|| self.placed.verdicts.clone());
        let why = printable::line(why, MOST_OF_A_REASON);
        Row { recording: self.placed.label(), outcome, why, verdicts, ..Row::default() }
    }

    /// The row of a recording with verdicts, new or of an earlier run. As the reason it has what is
    /// not whole of them, if anything is not; else why this run judged or skipped the recording.
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

/// What of a recording was not judged, or not judged as asked: the first sentence about it in its
/// entry. `None` if it is whole.
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
