//! Where a run with `--baseline` goes on in the order of the recordings.
//!
//! In: from `cli/plan.rs`, the recordings in the order in which they begin, each with its *link*: the digests of
//! the baselines that its verdicts met and left, as the journal noted them. Out: where recordings are judged by
//! the baselines of their turn ([`go_on`]).
//!
//! Channels' own baselines go from each recording to the next. A recording that is judged again, or that comes
//! in between, would have to meet the baselines as they were then. If these are there, because a run was killed
//! or somebody put them back, all from there on are judged again, and are as in an undisturbed run. So they are, too,
//! where all recordings from which the baselines have learned are to be judged again, by other settings say: then the
//! baselines begin anew. If they are not there, the recording has no place in the order any more: it is judged by the
//! baselines as they are and teaches nothing, and nothing else is changed for its sake.

use super::Result;
use super::groups::{MOST_GROUPS, of_printhead};
use super::visit::Pass;
use inkling_io::journal::Link;
use std::collections::BTreeMap;
use std::sync::Arc;

type State = Option<String>;

/// How a run goes on.
#[derive(Debug, PartialEq, Eq)]
pub enum GoOn {
    /// All recordings from this one on are judged, each by the baselines of its turn. It may lie before the first
    /// one that is to be judged if a run was killed before it wrote its baselines, or somebody put earlier ones back.
    From(usize),
    /// All recordings from this one on are judged, and the baselines begin anew with it.
    Anew(usize),
    /// The baselines have learned from recordings before this one, and from it on they go on to learn. What is to
    /// be judged before it has no place.
    After(usize),
}

/// `links`: for each recording, in order, the baselines before and after it, if it was once judged; `first`: the
/// first recording that is to be judged, or their number; `now`: the baselines as they are.
pub fn go_on(links: &[Option<Link>], first: usize, now: &State) -> GoOn {
    let links: Vec<Option<&Link>> =
        links.iter().map(|link| link.as_ref().filter(|link| link.taught())).collect();
    // the last place at or before `first` that continues from the present baselines
    if let Some(at) = (0..=first).rev().find(|&at| fits(&links, at, now)) {
        return GoOn::From(at);
    }
    let last = links.iter().rposition(Option::is_some);
    match last.is_some_and(|last| first <= last) && rests_on(&links[first..], now) {
        true => GoOn::Anew(first),
        false => GoOn::After(last.map_or(0, |last| last + 1)),
    }
}

/// Whether the baselines are those that the last recording before this place left, or that the next one met.
fn fits(links: &[Option<&Link>], at: usize, now: &State) -> bool {
    let next = links[at..].iter().flatten().next().map(|link| &link.before);
    let last = links[..at].iter().rev().flatten().next().map(|link| &link.after);
    next.is_none() && last.is_none() || [next, last].contains(&Some(now))
}

/// Whether the baselines have learned from these recordings and from no others.
fn rests_on(links: &[Option<&Link>], now: &State) -> bool {
    let links: Vec<&Link> = links.iter().copied().flatten().collect();
    let is_whole = links.windows(2).all(|pair| pair[0].after == pair[1].before);
    let begins = links.first().is_some_and(|link| link.before.is_none());
    is_whole && begins && links.last().is_some_and(|link| link.after == *now)
}

/// The printheads of a recording, for whoever hands recordings out to others. All of it is read.
pub fn printheads(pass: Pass) -> Result<Vec<String>> {
    let mut heads: BTreeMap<Arc<str>, ()> = BTreeMap::new();
    pass.bursts(|burst| {
        of_printhead(&mut heads, &burst.printhead, MOST_GROUPS, || ());
    })?;
    Ok(heads.into_keys().map(|name| name.to_string()).collect())
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
    fn what_follows_goes_on_and_what_lies_before_has_no_place() {
        let mut links = chain(3);
        assert_eq!(go_on(&links, 3, &state(3)), GoOn::From(3), "all is finished");
        assert_eq!(go_on(&links, 3, &state(9)), GoOn::After(3), "and others followed");
        assert_eq!(go_on(&links, 1, &state(3)), GoOn::After(3), "changed in the middle");
        links.push(None);
        assert_eq!(go_on(&links, 3, &state(3)), GoOn::From(3), "a new one at the end");
        assert_eq!(go_on(&links, 3, &state(9)), GoOn::After(3), "after others that are not here");
        links.swap(2, 3);
        assert_eq!(go_on(&links, 2, &state(3)), GoOn::After(4), "a new one in between");
        assert_eq!(go_on(&links, 2, &state(2)), GoOn::From(2), "with the baselines of that time");
        // it was judged without a place: what follows goes on all the same
        links[2] = Some(Link { before: state(3), after: state(3) });
        links.push(None);
        assert_eq!(go_on(&links, 4, &state(3)), GoOn::From(4));
        assert_eq!(go_on(&links, 4, &state(2)), GoOn::From(3), "killed before they were written");
        assert_eq!(go_on(&[None, None], 0, &state(7)), GoOn::From(0), "the first run of a chain");
    }

    #[test]
    fn what_the_baselines_rest_on_alone_is_judged_again_from_the_begin() {
        let mut links = chain(3);
        assert_eq!(go_on(&links, 0, &state(3)), GoOn::Anew(0), "other settings");
        assert_eq!(go_on(&links, 1, &state(3)), GoOn::After(3), "but the first is finished");
        assert_eq!(go_on(&links, 0, &state(9)), GoOn::After(3), "others have taught them, too");
        assert_eq!(go_on(&links[1..], 0, &state(3)), GoOn::After(2), "and before");
        // killed after the first one was judged again: it goes on there
        links[0] = Some(Link { before: None, after: state(7) });
        assert_eq!(go_on(&links, 1, &state(7)), GoOn::From(1));
        assert_eq!(go_on(&links, 1, &state(3)), GoOn::After(3), "others have followed");
    }

    #[test]
    fn the_chain_is_replayed_from_the_baselines_that_are_there() {
        let links = chain(3);
        assert_eq!(go_on(&links, 3, &state(2)), GoOn::From(2), "killed before they were written");
        assert_eq!(go_on(&links, 3, &state(0)), GoOn::From(0), "removed");
        assert_eq!(go_on(&links, 2, &state(1)), GoOn::From(1), "put back");
        let taught_nothing = vec![Some(Link { before: state(1), after: state(1) })];
        assert_eq!(go_on(&taught_nothing, 1, &state(1)), GoOn::From(1));
    }
}
