//! The order of recordings with `--baseline`: when each begins, which is the time of its earliest burst, and from
//! which on they are judged.
//!
//! In: from `cli/plan.rs`, the recordings in order, each with its *link*: the digests of the baselines that its
//! verdicts met and left, as the journal noted them. Out: the index from which on recordings are judged
//! ([`resume_at`]); and for the order the times at which recordings begin ([`starts`]).
//!
//! Channels' own baselines go from each recording to the next. A recording that is judged again, or that comes
//! in between, must meet the baselines as they were then: else its verdicts would differ from those of an
//! undisturbed run. So judging can begin at a place only if the baselines that are there now are those that the
//! next recording met, or that the last one left.

use super::Result;
use super::groups::{MOST_GROUPS, of_printhead};
use super::judges::MOST_REORDER_NS;
use super::visit::Pass;
use inkling_io::journal::Link;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::sync::Arc;

type State = Option<String>;

/// `links`: for each recording, in order, the baselines before and after it, if it was once judged; `first`: the
/// first recording that is to be judged, or their number; `now`: the baselines as they are. `None`: what is to
/// be judged would meet baselines that other recordings have changed since. The index may be below `first` if a
/// run was killed before it wrote its baselines, or somebody put earlier ones back.
pub fn resume_at(links: &[Option<Link>], first: usize, now: &State) -> Option<usize> {
    if links.iter().all(Option::is_none) {
        return Some(first); // nothing here rests on them yet
    }

    let fits = |at: usize| wanted(links, at).is_none_or(|state| state == now);
    // the last place at or before `first` that continues from the present baselines
    match (0..=first).rev().find(|&at| fits(at)) {
        // all is finished, and others were judged since by the same baselines
        None if first == links.len() => Some(first),
        found => found,
    }
}

/// The baselines that the next judged recording met, or else the last one left. `None`: any.
fn wanted(links: &[Option<Link>], at: usize) -> Option<&State> {
    let next = links[at..].iter().flatten().next().map(|link| &link.before);
    let last = links[..at].iter().rev().flatten().next().map(|link| &link.after);
    next.or(last)
}

/// Times of the earliest usable bursts by printhead, ns. Without `all`, where the chunk index says that the file
/// is about in the order of its times, only blocks up to the first one that holds a burst are decoded, and some
/// printheads may be missing.
pub fn starts(pass: Pass, all: bool) -> Result<BTreeMap<Arc<str>, i64>> {
    // without a chunk index nothing is known of the order, and all blocks are decoded
    let ordered = pass.recording.disorder_ns.is_some_and(|ns| ns <= MOST_REORDER_NS);
    let starts: RefCell<BTreeMap<Arc<str>, i64>> = RefCell::default();
    let want = |_| all || !ordered || starts.borrow().is_empty();
    pass.bursts(want, |_, burst| {
        let (t, mut starts) = (burst.t_acq_ns, starts.borrow_mut());
        if let Some(first) = of_printhead(&mut starts, &burst.printhead, MOST_GROUPS, || t) {
            *first = t.min(*first);
        }
    })?;
    Ok(starts.into_inner())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state(digit: u32) -> State {
        (digit > 0).then(|| digit.to_string())
    }

    /// The links of `n` recordings that took the baselines from 0 (none) to 1, to 2 and so on.
    fn chain(n: u32) -> Vec<Option<Link>> {
        (0..n).map(|i| Some(Link { before: state(i), after: state(i + 1) })).collect()
    }

    #[test]
    fn what_follows_goes_on_and_what_lies_before_is_refused() {
        let mut links = chain(3);
        assert_eq!(resume_at(&links, 3, &state(3)), Some(3), "all is finished");
        assert_eq!(resume_at(&links, 3, &state(9)), Some(3), "and others followed");
        assert_eq!(resume_at(&links, 1, &state(3)), None, "changed in the middle");
        links.push(None);
        assert_eq!(resume_at(&links, 3, &state(3)), Some(3), "a new one at the end");
        assert_eq!(resume_at(&links, 3, &state(9)), None, "after others that are not here");
        links.swap(2, 3);
        assert_eq!(resume_at(&links, 2, &state(3)), None, "a new one in between");
        assert_eq!(resume_at(&links, 2, &state(2)), Some(2), "with the baselines of that time");
        assert_eq!(resume_at(&[None, None], 0, &state(7)), Some(0), "the first run of a chain");
    }

    #[test]
    fn the_chain_is_replayed_from_the_baselines_that_are_there() {
        let links = chain(3);
        assert_eq!(resume_at(&links, 3, &state(2)), Some(2), "killed before they were written");
        assert_eq!(resume_at(&links, 3, &state(0)), Some(0), "removed");
        assert_eq!(resume_at(&links, 2, &state(1)), Some(1), "put back");
        let taught_nothing = vec![Some(Link { before: state(1), after: state(1) })];
        assert_eq!(resume_at(&taught_nothing, 1, &state(1)), Some(1));
    }
}
