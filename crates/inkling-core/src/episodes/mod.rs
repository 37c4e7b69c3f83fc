//! Turns the verdicts of single bursts into episodes: this channel, faulty from then to then.
//!
//! In: of every judged signal its detection statistic over the threshold, of the flagged ones what
//! isolation says; in any order within a bounded window. Out: [`Episode`]s, each with an onset, an
//! end, a class and a sentence. Memory is bounded; what it has no room for is counted. Never changes
//! a verdict.

mod channel;
mod channel_episode;
mod classes;
mod episode_draft;
mod evidence;
mod explanation;
mod intermittent;
mod naming;
mod order;
#[cfg(test)]
mod prices;
mod printhead;
mod settings;
mod tracker;
pub mod tuned;

pub use explanation::{share, size_in_words};
pub use settings::EpisodeSettings;
pub use tracker::Tracker;

use crate::verdict::{Appearance, Reason};
use std::sync::Arc;

/// One fault episode of a channel: a row of the episode table (contract, "Out: verdicts").
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Episode {
    /// Its path below what was asked for; empty until it is written.
    pub recording: Arc<str>,
    pub printhead: Arc<str>,
    pub channel: u32,
    pub category: Option<String>,
    pub fault: Option<String>,
    /// t_a of the burst at which the evidence sufficed.
    pub raised_at_ns: i64,
    /// Best estimate of the onset.
    pub began_at_ns: i64,
    /// The first burst that looked healthy again; `None`: still on.
    pub ended_at_ns: Option<i64>,
    /// The channel's judged bursts in it.
    pub bursts: u64,
    /// Of the named class, else of the named category, else of the best class.
    pub certainty: Option<f64>,
    pub severity_first: Option<f64>,
    pub severity_max: Option<f64>,
    pub severity_last: Option<f64>,
    /// Of `severity_last`.
    pub severity_sd: Option<f64>,
    /// Of the last of its signals that has a ring: resonance, Hz, and damping, 1/s.
    pub resonance_hz: Option<f64>,
    pub damping_per_s: Option<f64>,
    /// Why it has no name; `None`: it has one.
    pub reason: Option<Reason>,
    pub explanation: String,
}

/// The signals of one burst, channels ascending one by one.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Looks {
    pub t_ns: i64,
    pub first_channel: u32,
    /// Which model judged, and its threshold over the median of healthy statistics; 0: not known.
    pub model: u16,
    pub in_medians: f32,
    /// Statistic over threshold per channel; NaN: not judged.
    pub ratios: Vec<f32>,
    /// Per channel, whether its own baseline judged it; empty: no channel's did.
    pub own: Vec<bool>,
    /// Of flagged channels, ascending.
    pub named: Vec<IsolatedSignal>,
}

impl Looks {
    /// Whether the channel's own baseline judged a row.
    fn judged_by_own(&self, row: u32) -> bool {
        self.own.get(row as usize).is_some_and(|&own| own)
    }
}

/// What isolation says of a flagged signal.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct IsolatedSignal {
    /// Place in the burst.
    pub row: u32,
    /// Per class; what they lack to 1 is the weight of no class. Empty: nothing was said.
    pub weights: Vec<f32>,
    /// Why it has no name; `None`: it has one.
    pub reason: Option<Reason>,
    /// Of what fits none, if it was looked at, or may as well fit none.
    pub appearance: Option<Appearance>,
    /// The class that a severity is of.
    pub candidate: Option<u16>,
    pub severity: Option<f32>,
    pub severity_sd: Option<f32>,
    pub ring: Option<RingChange>,
    /// Resonance, Hz, and damping, 1/s, as its row has them.
    pub resonance: Option<(f32, f32)>,
}

impl IsolatedSignal {
    /// It is of no known class, or no ring.
    fn fits_none(&self) -> bool {
        matches!(self.reason, Some(Reason::UnknownFault | Reason::NoRing))
    }
}

/// How a signal's ring differs from the healthy one of its model: ln of their ratios.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RingChange {
    pub ln_frequency: f64,
    pub ln_damping: f64,
    pub healthy_frequency_hz: f64,
    pub healthy_damping_per_s: f64,
}

/// Of a printhead's judged signals, how many are no evidence of anything, as their times are those of others or come
/// too late.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Untimely {
    pub printhead: Arc<str>,
    pub signals: u64,
    pub at_one_time: u64,
    pub too_late: u64,
    /// The last of the times that several signals have.
    pub t_ns: i64,
}

/// What a tracker hands out at the end of a recording.
#[derive(Debug)]
pub struct TrackerResult {
    /// The last episodes, those still on by printhead and channel.
    pub last: Vec<Episode>,
    pub counts: Counts,
    /// By printhead; those of which some signals are.
    pub untimely: Vec<Untimely>,
}

/// What was left out, and what came out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Counts {
    pub episodes: u64,
    /// Of them, still on at the end.
    pub still_on: u64,
    /// Signals that came after later ones of their channel had been looked at: beyond the window.
    pub signals_too_late: u64,
    /// Signals of a burst that was there already, same channel, time and statistic.
    pub signals_repeated: u64,
    /// Other signals that have the time of the one before them on their channel.
    pub signals_at_one_time: u64,
    /// Signals of channels beyond the most that are remembered.
    pub signals_beyond_limit: u64,
}
