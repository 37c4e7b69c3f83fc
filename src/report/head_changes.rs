//! What happened to whole printheads, or to what their channels are: all channels warmer or colder together,
//! another printhead of the name, a replaced channel, a clock that was set. It stands before the faults, since it
//! explains them.
//!
//! In: `head_changes` and `odd_times` of the recordings' summaries. Out: [`HeadChange`]s, the newest first.

use super::counts::Tally;
use super::night::last_night;
use super::source::Source;
use super::{RecordingLine, survey};
use std::cmp::Reverse;
use std::sync::Arc;

/// A sentence about a printhead in a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct HeadChange {
    pub printhead: Arc<str>,
    pub what: String,
    /// Name of the recording that shows it, its index among the sources, and when it ended, ns.
    pub recording: String,
    pub source: usize,
    pub as_of_ns: Option<i64>,
    /// Whether the recording is of the last night.
    pub is_of_last_night: bool,
}

/// How a printhead moved as a whole, as its recordings say.
pub struct Movements {
    /// From when to when, ns, all of its channels lay together beyond the bounds. A fault that ends there may not be over:
    /// the other channels may have got it, too.
    pub together_ns: Vec<[i64; 2]>,
    /// When another printhead of that name was met, ns: what its channels had before are no faults of those that are there
    /// now.
    pub swapped_ns: Vec<i64>,
}

impl Movements {
    pub fn of(head: &survey::Head, sources: &[Source]) -> Movements {
        let said = |recording: &usize, key| of_movement(head, &sources[*recording], key);
        let together = |(recording, tally): (&usize, &Tally)| {
            Some([said(recording, "beyond_since_ns")?, tally.span?.1])
        };
        let swapped = |recording: &usize| said(recording, "swapped_ns");
        Movements {
            together_ns: head.tallies.iter().filter_map(together).collect(),
            swapped_ns: head.tallies.keys().filter_map(swapped).collect(),
        }
    }
}

/// A number of what a recording's summary says of how a printhead moved.
fn of_movement(head: &survey::Head, source: &Source, key: &str) -> Option<i64> {
    let moved = source.document["moved_together"].as_array()?;
    moved.iter().find(|of| of["printhead"].as_str() == Some(&*head.name))?[key].as_i64()
}

/// The changes in all recordings. `lines`: of the recordings, in the order of time.
pub fn of(lines: &[RecordingLine], sources: &[Source]) -> Vec<HeadChange> {
    let spans: Vec<_> = lines.iter().filter_map(|line| line.span).collect();
    let to_ns = spans.iter().map(|span| span.1).max().unwrap_or_default();
    let from_ns = last_night(&spans, to_ns);
    let of_line = |line: &RecordingLine| {
        let document = &sources[line.source].document;
        let told = ["odd_times", "head_changes"].map(|key| document[key].as_array());
        let change = |told: &serde_json::Value| {
            Some(HeadChange {
                printhead: told["printhead"].as_str()?.into(),
                what: told["what"].as_str()?.to_owned(),
                recording: line.name.clone(),
                source: line.source,
                as_of_ns: line.span.map(|span| span.1),
                is_of_last_night: line.span.is_some_and(|span| span.0 >= from_ns),
            })
        };
        told.into_iter().flatten().flatten().filter_map(change).collect::<Vec<_>>()
    };
    let mut all: Vec<HeadChange> = lines.iter().flat_map(of_line).collect();
    all.sort_by_key(|of| Reverse(of.as_of_ns));
    all
}
