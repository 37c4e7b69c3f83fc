//! The present state of a recording that is being followed. In: verdicts and episodes, from
//! `follow` on the pipeline's threads. Out: JSON for the page and for programs, metrics for
//! Prometheus, to `answers` on the clients' threads. Memory grows with printheads and channels, not
//! with bursts.
//!
//! Of each channel only the outcome of its last signal is kept, as a letter of its printhead's map;
//! of episodes those that are on. A number counts the changes, by which a waiting thread knows
//! whether there is something new ([`State::wait`]).

use crate::cli::metrics::{self, Found};
use crate::cli::output::episode_event;
use crate::pipeline::{EpisodeEvent, is_same, rfc3339};
use inkling_core::episodes::{Episode, size_in_words};
use inkling_core::verdict::{Outcome, Part, Reason, Verdicts};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Most printheads that are drawn. The signals of all are counted.
const MOST_HEADS: usize = 256;
/// Most channels of a printhead that are drawn.
const MOST_CHANNELS: usize = 1 << 16;

/// Letters of a printhead's map, one for each channel: the outcome of its last signal.
const UNKNOWN: u8 = b' ';
const HEALTHY: u8 = b'.';
const FLAGGED: u8 = b'f';
const REJECTED: u8 = b'x';

/// The status of a followed recording, shared between threads: one changes it, others wait for a change.
#[derive(Debug, Default)]
pub struct State {
    status: Mutex<RecordingStatus>,
    changed: Condvar,
}

/// What the verdicts and episodes say so far.
#[derive(Debug, Default)]
struct RecordingStatus {
    /// One letter per channel, by printhead.
    heads: BTreeMap<Arc<str>, Vec<u8>>,
    /// The names of the classes, to which the indices in verdicts refer.
    classes: Vec<String>,
    /// The episodes that are on, by printhead and channel, with the size and the ring of their latest signal.
    faults: BTreeMap<(Arc<str>, u32), Episode>,
    /// t_a of the latest signal that carries the name of the fault, ns.
    named_ns: BTreeMap<(Arc<str>, u32), i64>,
    /// Number of signals, judged or rejected, and of the rejected ones by reason.
    signals: u64,
    rejected: BTreeMap<&'static str, u64>,
    /// t_a of the latest signal, ns; `None`: there was none yet.
    newest_ns: Option<i64>,
    /// Number of changes so far, by which waiting threads recognise a new state.
    version: u64,
    /// Whether nothing more will come.
    ended: bool,
}

impl State {
    /// `classes`: their names, in the order of the verdicts' indices.
    pub fn new(classes: Vec<String>) -> State {
        let status = RecordingStatus { classes, ..RecordingStatus::default() };
        State { status: Mutex::new(status), ..State::default() }
    }

    /// The status, locked.
    fn status(&self) -> MutexGuard<'_, RecordingStatus> {
        self.status.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Changes the status, and wakes those that wait.
    fn change(&self, take: impl FnOnce(&mut RecordingStatus)) {
        let mut status = self.status();
        take(&mut status);
        status.version += 1;
        drop(status);
        self.changed.notify_all();
    }

    /// Takes in a batch of verdicts.
    pub fn take_rows(&self, of: &Verdicts) {
        self.change(|status| status.take_rows(of));
    }

    /// Takes in an event: an episode that is on becomes the channel's fault, any other event ends
    /// that fault. Where the fault is another episode of the channel, it stays: an earlier one may
    /// be withdrawn while a later one is on.
    pub fn take_episode(&self, of: EpisodeEvent) {
        self.change(|status| {
            // the episode as it is now, if it may be on, and as it was told before
            let (now, before) = match of {
                EpisodeEvent::Revised { now, before } => (Some(now), before),
                EpisodeEvent::Raised(now) => (Some(now), now),
                EpisodeEvent::Ended(before) | EpisodeEvent::Withdrawn(before) => (None, before),
            };
            let key = |episode: &Episode| (episode.printhead.clone(), episode.channel);
            if let Some(on) = now.filter(|now| now.ended_at_ns.is_none()) {
                status.faults.insert(key(on), on.clone());
            } else if status.faults.get(&key(before)).is_some_and(|on| is_same(on, before)) {
                status.faults.remove(&key(before));
                status.named_ns.remove(&key(before));
            }
        });
    }

    /// Notes that nothing more will come.
    pub fn end(&self) {
        self.change(|status| status.ended = true);
    }

    /// Waits until the version differs from `seen` or the recording has ended, but at most for `most`;
    /// returns the version, and whether the recording has ended.
    pub fn wait(&self, seen: u64, most: Duration) -> (u64, bool) {
        let is_seen = |status: &mut RecordingStatus| status.version == seen && !status.ended;
        let waited = self.changed.wait_timeout_while(self.status(), most, is_seen);
        let (status, _) = waited.unwrap_or_else(PoisonError::into_inner);
        (status.version, status.ended)
    }

    /// The state as JSON for the page. `behind_bytes`: bytes that were written and not read yet.
    pub fn as_json(&self, recording: &str, behind_bytes: u64) -> Value {
        let status = self.status();
        let head = |(name, map): (&Arc<str>, &Vec<u8>)| json!({ "printhead": &**name, "channels": String::from_utf8_lossy(map) });
        json!({
            "recording": recording,
            "signals": status.signals,
            "rejected": status.rejected,
            "newest_at": status.newest_ns.map(rfc3339),
            "behind_bytes": behind_bytes,
            "heads": status.heads.iter().map(head).collect::<Vec<_>>(),
            "faults": status.faults_as_json(recording),
            "ended": status.ended,
        })
    }

    /// The open faults, each in the form of `--follow --json`.
    pub fn faults_as_json(&self, recording: &str) -> Value {
        let status = self.status();
        json!({ "recording": recording, "faults": status.faults_as_json(recording) })
    }

    /// The metrics in Prometheus's text format.
    pub fn metrics(&self, behind_bytes: u64) -> String {
        let status = self.status();
        let mut found = Found {
            signals: status.signals,
            rejected: status.rejected.clone(),
            newest_ns: status.newest_ns,
            ..Found::default()
        };
        found.open.extend(status.heads.keys().map(|head| ((&**head, ""), 0)));
        for ((head, _), fault) in &status.faults {
            let category = metrics::category(fault.category.as_deref());
            *found.open.entry((head, category)).or_default() += 1;
        }
        let mut metrics = found.metrics();
        let help = "Recorded, and not read yet.";
        metrics.one("inkling_behind_bytes", "gauge", help, behind_bytes as f64);
        metrics.text
    }
}

impl RecordingStatus {
    /// Counts a batch of verdicts, and marks its channels. Healthy signals come as runs of channels, others
    /// as rows.
    fn take_rows(&mut self, of: &Verdicts) {
        self.signals += of.len() as u64;
        for part in &of.parts {
            match part {
                Part::Healthy(run) => {
                    let from = run.first_channel as usize;
                    let name = &of.rows.printheads[run.printhead as usize];
                    self.mark(name, from..from + run.signals.len(), HEALTHY);
                    self.newest_ns = self.newest_ns.max(Some(run.t_ns));
                }
                Part::Rows(rows) => rows.clone().for_each(|row| self.take_row(of, row)),
            }
        }
    }

    /// Marks the channel of one row, and counts the row if it was rejected.
    fn take_row(&mut self, of: &Verdicts, row: usize) {
        let c = &of.rows;
        let channel = c.channel[row] as usize;
        let mark = match c.outcome[row] {
            Outcome::Healthy => HEALTHY,
            Outcome::Faulty | Outcome::Undecided => FLAGGED,
            Outcome::Rejected => REJECTED,
        };
        if mark == REJECTED {
            let reason = c.reason[row].map_or("unknown", Reason::as_str);
            *self.rejected.entry(reason).or_default() += 1;
        }
        let name = &c.printheads[c.printhead[row] as usize];
        self.mark(name, channel..channel + 1, mark);
        self.newest_ns = self.newest_ns.max(Some(c.acquired_at_ns[row]));
        let key = (name.clone(), c.channel[row]);
        if mark == FLAGGED && self.faults.contains_key(&key) {
            self.size_now(key, of, row);
        }
    }

    /// Takes size and ring of a fault that is on from its latest signal. A signal that does not carry the
    /// fault's name leaves no size.
    fn size_now(&mut self, key: (Arc<str>, u32), of: &Verdicts, row: usize) {
        let c = &of.rows;
        let class = c.candidate[row].and_then(|class| self.classes.get(usize::from(class)));
        let Some(fault) = self.faults.get_mut(&key) else { return };
        let is_named = c.outcome[row] == Outcome::Faulty && class == fault.fault.as_ref();
        fault.severity_last = c.severity[row].filter(|_| is_named).map(f64::from);
        fault.severity_sd = c.severity_sd[row].filter(|_| is_named).map(f64::from);
        fault.resonance_hz = c.resonance_hz[row].map(f64::from).or(fault.resonance_hz);
        fault.damping_per_s = c.damping_per_s[row].map(f64::from).or(fault.damping_per_s);
        if is_named {
            self.named_ns.insert(key, c.acquired_at_ns[row]);
        }
    }

    /// Sets the letters of channels in a printhead's map; what is beyond the limits is not drawn.
    fn mark(&mut self, head: &Arc<str>, channels: std::ops::Range<usize>, mark: u8) {
        if !self.heads.contains_key(head) && self.heads.len() < MOST_HEADS {
            self.heads.insert(head.clone(), Vec::new());
        }
        let Some(map) = self.heads.get_mut(head) else { return };
        let to = channels.end.min(MOST_CHANNELS);
        if map.len() < to {
            map.resize(to, UNKNOWN);
        }
        if let Some(cells) = map.get_mut(channels.start..to) {
            cells.fill(mark);
        }
    }

    /// The open faults as events of episodes that are raised.
    fn faults_as_json(&self, recording: &str) -> Vec<Value> {
        let fault = |(key, episode): (&(Arc<str>, u32), &Episode)| {
            let mut event = episode_event(recording, EpisodeEvent::Raised(episode));
            let named_ns = self.named_ns.get(key);
            event["as_of"] = json!(named_ns.copied().map(rfc3339));
            let size = episode
                .fault
                .as_deref()
                .map(|class| size_in_words(class, episode.severity_last, episode.severity_sd));
            event["size_now"] = json!(size.map(|of| of.trim_start_matches(", ").to_owned()));
            event
        };
        self.faults.iter().map(fault).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_earlier_episode_that_is_withdrawn_leaves_the_later_one_on() {
        let raised =
            |at_ns| Episode { raised_at_ns: at_ns, began_at_ns: at_ns, ..Episode::default() };
        let (first, second) = (raised(10), raised(30));
        let state = State::default();
        let on = || state.status().faults.values().map(|of| of.raised_at_ns).collect::<Vec<_>>();
        state.take_episode(EpisodeEvent::Raised(&first));
        state
            .take_episode(EpisodeEvent::Ended(&Episode { ended_at_ns: Some(20), ..first.clone() }));
        assert!(on().is_empty());
        state.take_episode(EpisodeEvent::Raised(&second));
        state.take_episode(EpisodeEvent::Withdrawn(&first));
        assert_eq!(on(), [30]);
        state.take_episode(EpisodeEvent::Withdrawn(&second));
        assert!(on().is_empty());
    }
}
