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
