//! Counts what the run of one recording sees: signals by outcome, for the metadata; channels and
//! flagged signals by printhead, for the terminal.
//!
//! In: judged batches at the writer stage (`Tally::add`). Out: [`Counts`] and a [`PrintheadTally`]
//! per printhead, for `finish`, `recording_report` and the printed report. Memory is bounded:
//! beyond so many printheads and channels only the totals go on.

use super::at_once::AtOnce;
use super::batches::JudgedBatch;
use inkling_core::labels::{RecordedSpans, Span};
use inkling_core::verdict::{HealthyRun, Outcome, Part, Reason, VerdictColumns};
use inkling_io::damage::{Damage, note};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// The `counts` of the metadata.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct Counts {
    /// Number of bursts, unusable ones included, and of the latter.
    pub bursts: u64,
    pub unusable_bursts: u64,
    /// Number of signals, judged or rejected; an unusable burst counts as one. It is also the
    /// number of rows.
    pub signals: u64,
    pub judged: u64,
    /// Rejected signals by reason.
    pub rejected: BTreeMap<&'static str, u64>,
    /// Flagged signals by class; `undecided` for those without one.
    pub faulty: BTreeMap<String, u64>,
}

/// Counts of one printhead.
#[derive(Clone, Debug, Default)]
pub struct PrintheadTally {
    /// The channels of which a signal was judged.
    pub channels: BTreeSet<u32>,
    pub signals: u64,
    pub judged: u64,
    /// Number of flagged signals.
    pub passed: u64,
    /// Number of signals that say nothing of their nozzles, by reason: they were rejected, or the printhead
    /// turned out to be another one.
    pub unknown: BTreeMap<Reason, u64>,
    /// Whether most channels are flagged at once.
    pub at_once: AtOnce,
    /// Times of its earliest and its latest signal; `None`: there was none yet.
    times_ns: Option<(i64, i64)>,
    /// A half-open stretch of channels that `channels` is known to hold: saves looking up each of them.
    known: (u32, u32),
}

/// Widens a span of time to hold `t_ns`.
pub(super) fn widen((from_ns, to_ns): &mut (i64, i64), t_ns: i64) {
    (*from_ns, *to_ns) = (t_ns.min(*from_ns), t_ns.max(*to_ns));
}

impl PrintheadTally {
    /// Remembers a channel if there is `room`. Returns whether it is new.
    fn meet(&mut self, channel: u32, room: bool) -> bool {
        let (from, to) = self.known;
        if (from..to).contains(&channel) {
            return false;
        }
        let new = room && self.channels.insert(channel);
        if new || self.channels.contains(&channel) {
            // extend the stretch by a channel that follows it, else begin another stretch
            self.known = match to.checked_add(1) {
                Some(next) if to == channel => (from, next),
                _ => (channel, channel.saturating_add(1)),
            };
        }
        new
    }
}

/// Maximum number of channels that are remembered one by one, over all printheads;
/// beyond, only the counts go on.
const MOST_CHANNELS: usize = 1 << 20;
/// Maximum number of printheads that are remembered by name.
const MOST_PRINTHEADS: usize = 1 << 16;

/// All counts of a recording.
#[derive(Debug, Default)]
pub struct Tally {
    pub counts: Counts,
    pub printheads: BTreeMap<Arc<str>, PrintheadTally>,
    /// Damage that decoding met.
    pub damage: Vec<Damage>,
    /// Names of the fault classes, to which indices in rows refer.
    classes: Vec<String>,
    /// Number of channels remembered, over all printheads.
    remembered: usize,
}

impl Tally {
    /// A tally that has counted nothing.
    pub fn new(classes: Vec<String>) -> Tally {
        Tally { classes, ..Tally::default() }
    }

    /// The printheads, times and channels that labels may cover. If no channel of a printhead was judged, its
    /// channels may be any.
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

    /// Counts a batch.
    pub(super) fn add(&mut self, judged: &JudgedBatch) {
        self.counts.bursts += judged.bursts;
        judged.damage.iter().for_each(|damage| note(&mut self.damage, damage.clone()));
        for part in &judged.verdicts.parts {
            match part {
                Part::Healthy(run) => self.add_healthy(&judged.verdicts.rows, run),
                Part::Rows(rows) => {
                    rows.clone().for_each(|row| self.add_row(&judged.verdicts.rows, row))
                }
            }
        }
    }

    /// Counts a run of healthy signals.
    fn add_healthy(&mut self, c: &VerdictColumns, run: &HealthyRun) {
        let signals = run.signals.len() as u64;
        self.counts.signals += signals;
        self.counts.judged += signals;

        let Some(p) = of_printhead(&mut self.printheads, c, run.printhead) else { return };
        p.signals += signals;
        p.judged += signals;
        widen(p.times_ns.get_or_insert((run.t_ns, run.t_ns)), run.t_ns);
        p.at_once.see(run.t_ns, signals, 0, p.channels.len() as u64);

        let to = run.first_channel.saturating_add(run.signals.len() as u32); // a batch has few
        // the usual case: all these channels are known to be remembered
        if p.known.0 <= run.first_channel && to <= p.known.1 {
            return;
        }
        for channel in run.first_channel..to {
            let room = self.remembered < MOST_CHANNELS;
            self.remembered += usize::from(p.meet(channel, room));
        }
    }

    /// Counts a single row.
    fn add_row(&mut self, c: &VerdictColumns, row: usize) {
        // the recording's counts
        self.counts.signals += 1;
        let p = of_printhead(&mut self.printheads, c, c.printhead[row]);
        let judged = c.outcome[row] != Outcome::Rejected;
        if judged {
            self.counts.judged += 1;
        } else {
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

        // the printhead's
        let Some(p) = p else { return };
        p.signals += 1;
        let t_ns = c.acquired_at_ns[row];
        widen(p.times_ns.get_or_insert((t_ns, t_ns)), t_ns);
        if let Some(reason) = c.reason[row].filter(|reason| !judged || reason.is_of_head()) {
            *p.unknown.entry(reason).or_default() += 1;
        }
        p.judged += u64::from(judged);
        p.passed += u64::from(flagged);
        if judged {
            p.at_once.see(c.acquired_at_ns[row], 1, u64::from(flagged), p.channels.len() as u64);
            let room = self.remembered < MOST_CHANNELS;
            self.remembered += usize::from(p.meet(c.channel[row], room));
        }
    }
}

/// The tally of one of a batch's printheads, made if there is none. `place`: the printhead's index
/// in the batch. `None`: more printheads came than are remembered.
fn of_printhead<'a>(
    printheads: &'a mut BTreeMap<Arc<str>, PrintheadTally>,
    c: &VerdictColumns,
    place: u32,
) -> Option<&'a mut PrintheadTally> {
    let name = &c.printheads[place as usize];
    if !printheads.contains_key(name) && printheads.len() < MOST_PRINTHEADS {
        printheads.insert(name.clone(), PrintheadTally::default());
    }
    printheads.get_mut(name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use inkling_core::burst::Place;

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
        JudgedBatch {
            place: Place { block: 0, piece: 0 },
            leaves: None,
            damage: Vec::new(),
            verdicts: columns.into(),
            judges: Vec::new(),
            own: Vec::new(),
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
