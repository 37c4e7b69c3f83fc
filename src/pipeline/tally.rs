//! Counts what the run of one recording sees: signals by outcome, for the metadata; channels and flagged signals
//! by printhead, for the terminal.
//!
//! In: judged batches at the writer stage (`Tally::add`). Out: [`Counts`] and a [`PrintheadTally`] per printhead.
//! Memory is bounded: beyond so many printheads and channels only the totals go on.

use super::at_once::AtOnce;
use super::batches::JudgedBatch;
use super::groups::of_printhead;
use super::head_clock::Standing;
use inkling_core::labels::{RecordedSpans, Span};
use inkling_core::verdict::{HealthyRun, Outcome, Part, Reason, VerdictColumns, Verdicts};
use inkling_io::damage::{Damage, note};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// The `counts` of the metadata.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct Counts {
    /// Number of bursts, unusable ones included, and of the latter.
    pub bursts: u64,
    pub unusable_bursts: u64,
    /// Number of signals, judged or rejected, and so of rows; an unusable burst counts as one.
    pub signals: u64,
    pub judged: u64,
    pub rejected: BTreeMap<&'static str, u64>,
    /// Flagged signals by class; `undecided` for those without one.
    pub faulty: BTreeMap<String, u64>,
}

#[derive(Clone, Debug, Default)]
pub struct PrintheadTally {
    /// The channels of which a signal was judged.
    pub channels: BTreeSet<u32>,
    pub signals: u64,
    pub judged: u64,
    pub flagged: u64,
    /// Number of signals that say nothing of their nozzles, by reason: they were rejected, or the printhead
    /// turned out to be another one.
    pub unknown: BTreeMap<Reason, u64>,
    /// Whether most channels are flagged at once.
    pub at_once: AtOnce,
    /// Times of its earliest and its latest signal; `None`: there was none yet.
    times_ns: Option<(i64, i64)>,
    /// A half-open stretch of channels that `channels` holds: saves looking up each of them.
    known: (u32, u32),
}

pub(super) fn widen((from_ns, to_ns): &mut (i64, i64), t_ns: i64) {
    (*from_ns, *to_ns) = (t_ns.min(*from_ns), t_ns.max(*to_ns));
}

impl PrintheadTally {
    /// Number of signals that tell something of their nozzles.
    pub fn known(&self) -> u64 {
        self.signals - self.unknown.values().sum::<u64>()
    }

    /// Number of its bursts that could not be used.
    pub fn unusable_bursts(&self) -> u64 {
        self.unknown.iter().filter(|(reason, _)| reason.is_of_burst()).map(|(_, n)| n).sum()
    }

    /// Remembers a channel if there is room. `remembered`: number of channels of all printheads.
    fn meet(&mut self, channel: u32, remembered: &mut usize) {
        let (from, to) = self.known;
        if (from..to).contains(&channel) {
            return;
        }
        if *remembered < MOST_CHANNELS && self.channels.insert(channel) {
            *remembered += 1;
        }
        if self.channels.contains(&channel) {
            // extend the stretch by a channel that follows it, else begin another stretch
            self.known = match to.checked_add(1) {
                Some(next) if to == channel => (from, next),
                _ => (channel, channel.saturating_add(1)),
            };
        }
    }
}

/// Maximum number of channels that are remembered one by one, over all printheads.
const MOST_CHANNELS: usize = 1 << 20;
const MOST_PRINTHEADS: usize = 1 << 16;

#[derive(Debug, Default)]
pub struct Tally {
    pub counts: Counts,
    pub printheads: BTreeMap<Arc<str>, PrintheadTally>,
    pub damage: Vec<Damage>,
    /// Names of the fault classes, to which indices in rows refer.
    classes: Vec<String>,
    remembered: usize,
}

impl Tally {
    pub fn new(classes: Vec<String>) -> Tally {
        Tally { classes, ..Tally::default() }
    }

    /// The printheads, times and channels that labels may cover: any channels, if none was judged.
    pub fn met(&self) -> RecordedSpans {
        let mut met = RecordedSpans::default();
        for (name, head) in &self.printheads {
            let first_channel = head.channels.first().copied().unwrap_or(0);
            let last_channel = head.channels.last().copied().unwrap_or(u32::MAX);
            let (from_ns, to_ns) = head.times_ns.unwrap_or_default();
            met.see(name, Span { from_ns, to_ns, first_channel, last_channel });
        }
        met
    }

    pub(super) fn add(&mut self, judged: &JudgedBatch) {
        self.counts.bursts += judged.bursts;
        judged.damage.iter().for_each(|damage| note(&mut self.damage, damage.clone()));
        let Verdicts { parts, rows: c, .. } = &judged.verdicts;
        let is_stray = |t_ns, printhead| judged.standing(t_ns, printhead) == Standing::Stray;
        for part in parts {
            match part {
                Part::Healthy(run) => {
                    let is_stray = is_stray(run.t_ns, run.printhead);
                    self.add_healthy(c, run, is_stray);
                }
                Part::Rows(rows) => {
                    for row in rows.clone() {
                        let is_stray = is_stray(c.acquired_at_ns[row], c.printhead[row]);
                        self.add_row(c, row, is_stray);
                    }
                }
            }
        }
    }

    /// Counts signals of one moment and printhead: all of them, those judged, and those flagged. Returns the
    /// printhead's tally, and the number of channels remembered. `None`: the printhead is not remembered. `t_ns`:
    /// `None` if the time cannot be believed.
    fn count(
        &mut self,
        printhead: &Arc<str>,
        t_ns: Option<i64>,
        [signals, judged, flagged]: [u64; 3],
    ) -> Option<(&mut PrintheadTally, &mut usize)> {
        self.counts.signals += signals;
        self.counts.judged += judged;
        let new = PrintheadTally::default;
        let p = of_printhead(&mut self.printheads, printhead, MOST_PRINTHEADS, new)?;
        p.signals += signals;
        p.judged += judged;
        p.flagged += flagged;
        let Some(t_ns) = t_ns else { return Some((p, &mut self.remembered)) };
        widen(p.times_ns.get_or_insert((t_ns, t_ns)), t_ns);
        if judged > 0 {
            p.at_once.see(t_ns, judged, flagged, p.channels.len() as u64);
        }
        Some((p, &mut self.remembered))
    }

    fn add_healthy(&mut self, c: &VerdictColumns, run: &HealthyRun, is_stray: bool) {
        let printhead = &c.printheads[run.printhead as usize];
        let signals = run.signals.len() as u64;
        let counted = self.count(printhead, (!is_stray).then_some(run.t_ns), [signals, signals, 0]);
        let Some((p, remembered)) = counted else { return };

        let to = run.first_channel.saturating_add(run.signals.len() as u32); // a batch has few
        // the usual case: all these channels are known to be remembered
        if p.known.0 <= run.first_channel && to <= p.known.1 {
            return;
        }
        (run.first_channel..to).for_each(|channel| p.meet(channel, remembered));
    }

    fn add_row(&mut self, c: &VerdictColumns, row: usize, is_stray: bool) {
        let judged = c.outcome[row] != Outcome::Rejected;
        if !judged {
            let reason = c.reason[row].unwrap_or(Reason::Undecodable);
            *self.counts.rejected.entry(reason.as_str()).or_default() += 1;
            self.counts.unusable_bursts += u64::from(reason.is_of_burst());
        }

        let flagged = judged && c.outcome[row] != Outcome::Healthy;
        if flagged {
            let class = c.fault[row].map_or("undecided", |k| self.classes[k as usize].as_str());
            match self.counts.faulty.get_mut(class) {
                Some(n) => *n += 1,
                None => drop(self.counts.faulty.insert(class.into(), 1)),
            }
        }

        let printhead = &c.printheads[c.printhead[row] as usize];
        let signals = [1, u64::from(judged), u64::from(flagged)];
        let t_ns = (!is_stray).then(|| c.acquired_at_ns[row]);
        let counted = self.count(printhead, t_ns, signals);
        let Some((p, remembered)) = counted else { return };
        if let Some(reason) = c.reason[row].filter(|reason| !judged || reason.is_of_head()) {
            *p.unknown.entry(reason).or_default() += 1;
        }
        if judged {
            p.meet(c.channel[row], remembered);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A batch with one healthy row for each printhead and channel given.
    fn judged(rows: impl Iterator<Item = (String, u32)>) -> JudgedBatch {
        let mut columns = VerdictColumns::default();
        for (row, (name, channel)) in rows.enumerate() {
            columns.printheads.push(name.into());
            columns.printhead.push(row as u32);
            columns.channel.push(channel);
            columns.outcome.push(Outcome::Healthy);
            columns.acquired_at_ns.push(0);
        }
        columns.fill_up();
        JudgedBatch { verdicts: columns.into(), ..JudgedBatch::default() }
    }

    #[test]
    fn beyond_the_names_that_are_remembered_the_totals_go_on() {
        let mut tally = Tally::new(Vec::new());
        let more = MOST_PRINTHEADS + 10;
        tally.add(&judged((0..more).map(|i| (i.to_string(), 0))));
        assert_eq!((tally.printheads.len(), tally.counts.signals), (MOST_PRINTHEADS, more as u64));
        // a printhead that is remembered is counted on
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
