//! Turns the verdicts of single bursts into episodes: this channel, faulty from then to then.
//!
//! In: for every judged signal its detection statistic over the threshold, for flagged ones what
//! isolation says; in any order within a bounded window. Out: [`Episode`]s, each with an onset, an
//! end, a class and a sentence. Memory is bounded; what it has no room for is counted. Never
//! changes a verdict.
//!
//! `tracker` follows a recording, `order` puts its bursts in time order, `printhead` follows the
//! channels of one printhead and `channel` one channel. A channel's looks go through the tests of
//! `evidence` and `intermittent`. What isolation says is gathered in an `episode_draft`, whose class
//! `classes` filters over time; `channel_episode` makes an [`Episode`] of it by the rules of names
//! (`rules`), and `explanation` puts it into words. `docs/design/state.md` tells the method.
//!
//! A *look* is one observation of a channel: the statistic of one judged signal. *Flagged* is a
//! look whose ratio, its statistic over the threshold, exceeds 1.

mod channel;
mod channel_episode;
mod classes;
mod episode_draft;
mod evidence;
mod explanation;
mod intermittent;
mod order;
mod printhead;
mod rules;
mod settings;
mod tracker;
pub mod tuned;

pub use explanation::{share, size_in_words};
pub use settings::EpisodeSettings;
pub use tracker::Tracker;

use crate::verdict::{Appearance, Reason};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// One fault episode of a channel: a row of the episode table.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Episode {
    /// Path of the recording below what was asked for; empty until the episode is written.
    pub recording: Arc<str>,
    pub printhead: Arc<str>,
    pub channel: u32,
    /// Category and class of the fault, by name; `None`: it is not certain.
    pub category: Option<String>,
    pub fault: Option<String>,
    /// t_a of the burst at which the evidence sufficed, ns since the epoch.
    #[serde(rename = "raised_at")]
    pub raised_at_ns: i64,
    /// Best estimate of the time of the onset, ns since the epoch.
    #[serde(rename = "began_at")]
    pub began_at_ns: i64,
    /// Time of the first burst in which the channel looked healthy again; `None`: still on.
    #[serde(rename = "ended_at")]
    pub ended_at_ns: Option<i64>,
    pub bursts: u64,
    /// Weight of the named class or category, else of the best class; `None`: no signal fits one.
    pub certainty: Option<f64>,
    /// The first, largest and last severity that was estimated, in the class's unit.
    pub severity_first: Option<f64>,
    pub severity_max: Option<f64>,
    pub severity_last: Option<f64>,
    pub severity_sd: Option<f64>,
    /// Resonance, Hz, and damping, 1/s, of the last signal that has a ring.
    pub resonance_hz: Option<f64>,
    pub damping_per_s: Option<f64>,
    /// Why the episode has no name; `None`: it has one.
    pub reason: Option<Reason>,
    pub explanation: String,
}

/// The looks at the channels of one burst: row r is the channel `first_channel` + r.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Looks {
    pub t_ns: i64,
    pub first_channel: u32,
    pub model: u16,
    /// The model's threshold over the median of healthy statistics; 0: not known.
    pub in_medians: f32,
    /// Detection statistic over threshold of each channel; NaN: not judged.
    pub ratios: Vec<f32>,
    /// Whether each channel was judged about its own level; empty: none was.
    pub own: Vec<bool>,
    /// What isolation says, one entry for each flagged row, in ascending order of rows.
    pub named: Vec<IsolatedSignal>,
}

impl Looks {
    fn judged_by_own(&self, row: u32) -> bool {
        self.own.get(row as usize).is_some_and(|&own| own)
    }
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct IsolatedSignal {
    pub row: u32,
    /// Weight of each class, and to 1 of no class. Empty: isolation said nothing.
    pub weights: Vec<f32>,
    pub reason: Option<Reason>,
    /// What the signal looks like, if it fits no class, or may as well be none.
    pub appearance: Option<Appearance>,
    /// Index of the class with the largest weight, to which `severity` refers.
    pub candidate: Option<u16>,
    /// Severity of the fault in that class's unit, and its standard deviation.
    pub severity: Option<f32>,
    pub severity_sd: Option<f32>,
    /// The signal's ring beside the healthy one of its model, if a ring was fitted.
    pub rings: Option<Rings>,
    /// Resonance, Hz, and damping, 1/s, of the verdict table.
    pub resonance: Option<(f32, f32)>,
}

impl IsolatedSignal {
    /// Whether the signal is of no known class, or no ring.
    fn fits_none(&self) -> bool {
        matches!(self.reason, Some(Reason::UnknownFault | Reason::NoRing))
    }
}

/// A faulty ring, and that of its channel while it is healthy, at the same temperature: its own, where that is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rings {
    pub frequency_hz: f64,
    pub damping_per_s: f64,
    pub healthy_frequency_hz: f64,
    pub healthy_damping_per_s: f64,
}

/// How many of a printhead's judged signals are no evidence, because of their times.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Untimely {
    pub printhead: Arc<str>,
    pub signals: u64,
    /// Signals with the time of another one of their channel, but another statistic.
    pub at_one_time: u64,
    /// Signals that came after later ones of their channel had been looked at.
    pub too_late: u64,
    /// The last of the times that several signals have, ns since the epoch.
    pub t_ns: i64,
}

impl Untimely {
    pub fn lost(&self) -> u64 {
        self.at_one_time + self.too_late
    }
}

#[derive(Debug)]
pub struct TrackerResult {
    /// The episodes that were not yet taken; those still on come last, by printhead and channel.
    pub last: Vec<Episode>,
    pub counts: Counts,
    pub untimely: Vec<Untimely>,
}

/// Numbers of episodes, and of signals that were left out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Counts {
    pub episodes: u64,
    pub still_on: u64,
    /// Signals that came after later ones of their channel had been looked at: beyond the window.
    pub signals_too_late: u64,
    /// Signals that were there already, with the same channel, time and statistic.
    pub signals_repeated: u64,
    /// Signals with the time of the one before them on their channel, and another statistic.
    pub signals_at_one_time: u64,
    /// Signals of channels beyond the largest number that is remembered.
    pub signals_beyond_limit: u64,
}
