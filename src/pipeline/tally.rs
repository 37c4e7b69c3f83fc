//! What a run counts: signals by outcome, for the metadata; channels and flagged signals, for the terminal.

use super::batches::Judged;
use crate::io::damage::{Damage, note};
use crate::verdict::{Outcome, Reason, VerdictColumns};
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::sync::Arc;

/// The contract's `counts`.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct Counts {
    pub bursts: u64,
    pub unusable_bursts: u64,
    pub signals: u64,
    pub judged: u64,
    pub rejected: BTreeMap<&'static str, u64>,
    pub faulty: BTreeMap<String, u64>,
}

#[derive(Clone, Debug, Default)]
pub struct PrintheadTally {
    pub channels: BTreeSet<u32>,
    pub signals: u64,
    pub judged: u64,
    pub passed: u64,
    /// Channels from .. to that `channels` is known to have: saves looking for each.
    known: (u32, u32),
}

impl PrintheadTally {
    /// Whether all of them are among `known`; without a branch per channel.
    fn knows(&self, channels: &[u32]) -> bool {
        let (from, to) = self.known;
        channels.iter().fold(true, |all, &channel| all & (from <= channel) & (channel < to))
    }

    /// Remembers a channel while there is `room`; whether it is new.
    fn meet(&mut self, channel: u32, room: bool) -> bool {
        let (from, to) = self.known;
        if (from..to).contains(&channel) {
            return false;
        }
        let new = room && self.channels.insert(channel);
        if new || self.channels.contains(&channel) {
            self.known = match to.checked_add(1) {
                Some(next) if to == channel => (from, next),
                _ => (channel, channel.saturating_add(1)),
            };
        }
        new
    }
}

/// Channels that are remembered one by one, over all printheads; beyond, only counts go on.
const MOST_CHANNELS: usize = 1 << 20;
/// Printheads that are remembered by name.
const MOST_PRINTHEADS: usize = 1 << 16;

#[derive(Debug, Default)]
pub struct Tally {
    pub counts: Counts,
    pub printheads: BTreeMap<Arc<str>, PrintheadTally>,
    pub damage: Vec<Damage>,
    classes: Vec<String>,
    remembered: usize,
}

impl Tally {
    pub fn new(classes: Vec<String>) -> Tally {
        Tally { classes, ..Tally::default() }
    }

    pub(super) fn add(&mut self, judged: &Judged) {
        self.counts.bursts += judged.bursts;
        judged.damage.iter().for_each(|damage| note(&mut self.damage, damage.clone()));
        let c = &judged.columns;
        let mut from = 0;
        for of_one in c.printhead.chunk_by(|p, q| p == q) {
            let name = &c.printheads[of_one[0] as usize];
            if !self.printheads.contains_key(name) && self.printheads.len() < MOST_PRINTHEADS {
                self.printheads.insert(name.clone(), PrintheadTally::default());
            }
            self.add_rows(c, name, from..from + of_one.len());
            from += of_one.len();
        }
    }

    /// Rows of one printhead.
    fn add_rows(&mut self, c: &VerdictColumns, name: &str, rows: Range<usize>) {
        let mut printhead = self.printheads.get_mut(name);
        let mut row = rows.start;
        while row < rows.end {
            let here = c.outcome[row..rows.end].iter();
            let healthy = here.take_while(|o| **o == Outcome::Healthy).count();
            let channels = &c.channel[row..row + healthy];
            self.counts.signals += healthy as u64;
            self.counts.judged += healthy as u64;
            if let Some(p) = printhead.as_deref_mut() {
                p.signals += healthy as u64;
                p.judged += healthy as u64;
                if !p.knows(channels) {
                    for &channel in channels {
                        let room = self.remembered < MOST_CHANNELS;
                        self.remembered += usize::from(p.meet(channel, room));
                    }
                }
            }
            row += healthy;
            if row == rows.end {
                break;
            }
            let at = row;
            row += 1;
            self.counts.signals += 1;
            let printhead = printhead.as_deref_mut();
            if c.outcome[at] == Outcome::Rejected {
                let reason = c.reason[at].unwrap_or(Reason::Undecodable);
                *self.counts.rejected.entry(reason.as_str()).or_default() += 1;
                self.counts.unusable_bursts += u64::from(reason.is_of_burst());
                if let Some(p) = printhead {
                    p.signals += 1;
                }
                continue;
            }
            self.counts.judged += 1;
            let named = c.fault[at];
            let class = named.map_or("undecided", |k| self.classes[k as usize].as_str());
            match self.counts.faulty.get_mut(class) {
                Some(n) => *n += 1,
                None => drop(self.counts.faulty.insert(class.into(), 1)),
            }
            let Some(p) = printhead else { continue };
            p.signals += 1;
            p.judged += 1;
            let channel = c.channel[at];
            self.remembered += usize::from(p.meet(channel, self.remembered < MOST_CHANNELS));
            p.passed += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::burst::Place;

    /// One row each, of printhead and channel.
    fn judged(rows: impl Iterator<Item = (String, u32)>) -> Judged {
        let mut columns = VerdictColumns::default();
        for (row, (name, channel)) in rows.enumerate() {
            columns.printheads.push(name.into());
            columns.printhead.push(row as u32);
            columns.channel.push(channel);
            columns.outcome.push(Outcome::Healthy);
        }
        Judged {
            place: Place { block: 0, piece: 0 },
            leaves: None,
            damage: Vec::new(),
            columns,
            judges: Vec::new(),
            flagged: Vec::new(),
            bursts: 0,
        }
    }

    #[test]
    fn beyond_the_names_that_are_remembered_the_totals_go_on() {
        let mut tally = Tally::new(Vec::new());
        let more = MOST_PRINTHEADS + 10;
        tally.add(&judged((0..more).map(|i| (i.to_string(), 0))));
        assert_eq!((tally.printheads.len(), tally.counts.signals), (MOST_PRINTHEADS, more as u64));
        // whoever is known stays known
        tally.add(&judged([("0".to_owned(), 0)].into_iter()));
        assert_eq!(tally.printheads["0"].signals, 2);

        let mut tally = Tally::new(Vec::new());
        for head in 0..4 {
            let of_one = (0..MOST_CHANNELS as u32 / 3).map(|c| (head.to_string(), 2 * c));
            tally.add(&judged(of_one));
        }
        let channels: usize = tally.printheads.values().map(|p| p.channels.len()).sum();
        assert_eq!(channels, MOST_CHANNELS);
        assert_eq!(tally.counts.judged, 4 * (MOST_CHANNELS as u64 / 3));
    }
}
