//! When a recording begins: its earliest burst, of which depends in which order recordings with `--baseline` are
//! judged, and where printheads' first windows lie.

use super::learning::MOST_REORDER_NS;
use super::{Control, PipelineError, visit};
use inkling_io::recording::Recording;
use std::cell::Cell;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Earliest usable burst of every printhead, ns; reads all of the recording.
pub fn starts(
    recording: &Recording,
    control: &Control,
) -> Result<BTreeMap<Arc<str>, i64>, PipelineError> {
    let mut starts: BTreeMap<Arc<str>, i64> = BTreeMap::new();
    visit::all(recording, control, |burst| {
        let t = burst.t_acq_ns;
        if let Some(first) = starts.get_mut(&burst.printhead) {
            *first = t.min(*first);
        } else if starts.len() < super::survey::MOST_GROUPS {
            starts.insert(burst.printhead.clone(), t);
        }
    })?;
    Ok(starts)
}

/// The earliest usable burst, ns. Where the chunk index says that the file is about in the order of its times, only its
/// first block that holds a burst is read.
pub fn earliest_ns(recording: &Recording, control: &Control) -> Result<Option<i64>, PipelineError> {
    let ordered = recording.disorder_ns.is_some_and(|ns| ns <= MOST_REORDER_NS);
    let earliest = Cell::new(None::<i64>);
    let want = |_| !ordered || earliest.get().is_none();
    visit::bursts(recording, control, want, |_, burst| {
        let t_ns = burst.t_acq_ns;
        earliest.set(Some(earliest.get().map_or(t_ns, |earliest| earliest.min(t_ns))));
    })?;
    Ok(earliest.get())
}
