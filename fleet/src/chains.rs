//! Which recordings go to one executor in one piece.
//!
//! Usually that is one recording. With baselines it is a *chain*: all recordings that have a printhead in
//! common, directly or by way of others, in the order of their times, because each must begin with what the
//! one before has taught.

use inkling::io::job::Job;
use std::collections::HashMap;

/// The chains, as places among `items`, which stand in the order of their times. Every item is in one chain.
pub fn split(items: &[Job], with_baselines: bool) -> Vec<Vec<usize>> {
    let mut groups = Groups((0..items.len()).collect());
    if with_baselines {
        let mut first_of: HashMap<&str, usize> = HashMap::new();
        for (at, item) in items.iter().enumerate() {
            for printhead in &item.printheads {
                let first = *first_of.entry(printhead).or_insert(at);
                groups.join(first, at);
            }
        }
    }
    let mut chains: Vec<Vec<usize>> = Vec::new();
    let mut place: HashMap<usize, usize> = HashMap::new();
    for at in 0..items.len() {
        let chain = *place.entry(groups.of(at)).or_insert(chains.len());
        if chain == chains.len() {
            chains.push(Vec::new());
        }
        chains[chain].push(at);
    }
    chains
}

/// Disjoint sets of places: each place points to an earlier one of its set, and the first to itself.
struct Groups(Vec<usize>);

impl Groups {
    /// The first place of the set that a place is in. It shortens the way for later questions.
    fn of(&mut self, mut at: usize) -> usize {
        while self.0[at] != at {
            self.0[at] = self.0[self.0[at]];
            at = self.0[at];
        }
        at
    }

    /// Makes one set of those of two places.
    fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.of(a), self.of(b));
        self.0[a.max(b)] = a.min(b);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use inkling::io::inputs::Input;
    use inkling::io::layout::Layout;

    fn item(printheads: &[&str]) -> Job {
        let input = Input { path: "/x".into(), below: "".into() };
        Job {
            printheads: printheads.iter().map(|name| name.to_string()).collect(),
            ..Job::new(Layout::Tree, input, |_| String::new())
        }
    }

    #[test]
    fn recordings_that_share_a_printhead_stay_together_in_order() {
        let items = [&["a"][..], &["b"], &["a", "c"], &[], &["d"], &["c"], &["b"], &["d", "b"]];
        let items: Vec<Job> = items.iter().map(|names| item(names)).collect();
        let one_by_one: Vec<Vec<usize>> = (0..8).map(|at| vec![at]).collect();
        assert_eq!(split(&items, false), one_by_one);
        assert_eq!(split(&items, true), [vec![0, 2, 5], vec![1, 4, 6, 7], vec![3]]);
        assert!(split(&[], true).is_empty());
    }
}
