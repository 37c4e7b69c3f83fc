//! Finds when a recording begins, which is the time of its earliest burst. On that depends in which order
//! recordings are judged with `--baseline`, and where printheads' first windows lie.

use super::groups::MOST_GROUPS;
use super::learning::MOST_REORDER_NS;
use super::{Control, PipelineError, visit};
use inkling_io::recording::Recording;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Time of the earliest usable burst of printheads, ns: with `all` of every one. Else, where the chunk index
/// says that the file is about in the order of its times, only blocks up to the first one that holds a burst
/// are decoded.
pub fn starts(
    recording: &Recording,
    all: bool,
    control: &Control,
) -> Result<BTreeMap<Arc<str>, i64>, PipelineError> {
    // without a chunk index nothing is known of the order, and all blocks are decoded
    let ordered = recording.disorder_ns.is_some_and(|ns| ns <= MOST_REORDER_NS);
    let starts: RefCell<BTreeMap<Arc<str>, i64>> = RefCell::default();
    let want = |_| all || !ordered || starts.borrow().is_empty();
    visit::bursts(recording, control, want, |_, burst| {
        let (t, mut starts) = (burst.t_acq_ns, starts.borrow_mut());
        if let Some(first) = starts.get_mut(&burst.printhead) {
            *first = t.min(*first);
        } else if starts.len() < MOST_GROUPS {
            starts.insert(burst.printhead.clone(), t);
        }
    })?;
    Ok(starts.into_inner())
}
