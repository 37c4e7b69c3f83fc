//! Finds when a recording begins, which is the time of its earliest burst. On that depends in which order
//! recordings are judged with `--baseline`, and where printheads' first windows lie.

use super::learning::MOST_REORDER_NS;
use super::{Control, PipelineError, visit};
use inkling_io::recording::Recording;
use std::cell::Cell;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Time of the earliest usable burst of every printhead, ns. Reads the whole recording.
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

/// Time of the earliest usable burst, ns; `None`: there is none. Where the chunk index says that the file is
/// about in the order of its times, only blocks up to the first one that holds a burst are decoded.
pub fn earliest_ns(recording: &Recording, control: &Control) -> Result<Option<i64>, PipelineError> {
    // without a chunk index nothing is known of the order, and all blocks are decoded
    let ordered = recording.disorder_ns.is_some_and(|ns| ns <= MOST_REORDER_NS);
    let earliest = Cell::new(None::<i64>);
    let want = |_| !ordered || earliest.get().is_none();
    visit::bursts(recording, control, want, |_, burst| {
        let t_ns = burst.t_acq_ns;
        earliest.set(Some(earliest.get().map_or(t_ns, |earliest| earliest.min(t_ns))));
    })?;
    Ok(earliest.get())
}
