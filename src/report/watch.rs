//! Counts over the bursts of a channel that had an episode: how often it was flagged in its
//! episodes and between them, and how severe its faults were over time.
//!
//! In: the episodes of a channel, then from `survey` its judged bursts one by one (`Watch::add_burst`),
//! from recordings in any order. Out: a `Watch`, from which [`super::story`] decides which episodes
//! are of one fault, and which `false_alarms` counts over. A burst holds one signal of the channel,
//! so bursts and signals are the same number here.

use super::naming::Calls;
use super::trend::Course;
use inkling_core::episodes::Episode;
use inkling_core::fault;
use std::collections::BTreeMap;

/// Counts of a channel's judged bursts over some time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BurstCounts {
    pub judged: u64,
    pub flagged: u64,
    /// t_a of the first burst that was not flagged.
    pub first_quiet_ns: Option<i64>,
    /// t_a of the last burst that was flagged.
    pub last_flagged_ns: Option<i64>,
}

impl BurstCounts {
    /// Counts one judged burst. `t_ns`: its t_a.
    pub fn add(&mut self, t_ns: i64, flagged: bool) {
        self.judged += 1;
        if flagged {
            self.flagged += 1;
            self.last_flagged_ns = self.last_flagged_ns.max(Some(t_ns));
        } else {
            self.first_quiet_ns = self.first_quiet_ns.into_iter().chain([t_ns]).min();
        }
    }

    /// Adds the counts of another stretch of time.
    pub fn absorb(&mut self, other: &BurstCounts) {
        self.judged += other.judged;
        self.flagged += other.flagged;
        self.first_quiet_ns = self.first_quiet_ns.into_iter().chain(other.first_quiet_ns).min();
        self.last_flagged_ns = self.last_flagged_ns.max(other.last_flagged_ns);
    }
}

/// An episode, and the counts of its channel's bursts in the episode.
#[derive(Clone, Debug)]
pub struct Spell {
    /// Index of the recording that the episode is in.
    pub recording: usize,
    pub episode: Episode,
    pub counts: BurstCounts,
}

impl Spell {
    /// t_a of the last signal that shows the fault.
    pub fn last_look_ns(&self) -> i64 {
        self.counts.last_flagged_ns.unwrap_or(self.episode.raised_at_ns)
    }
}

/// The size of one signal's fault, and the quantity (words with the unit) in which it is measured.
#[derive(Clone, Copy, Debug)]
pub struct Size<'a> {
    pub quantity: &'a str,
    pub size: f64,
}

/// What a flagged signal says.
#[derive(Clone, Copy, Debug, Default)]
pub struct Flagged<'a> {
    /// The category that it is named by; `None`: none is certain.
    pub category: Option<&'a str>,
    pub size: Option<Size<'a>>,
    /// Its distance from healthy, in distances of the threshold; `None`: it has no ring.
    pub distance: Option<f64>,
}

/// A channel's episodes in the order of their onsets, and counts of its bursts in and outside of them.
#[derive(Clone, Debug)]
pub struct Watch {
    pub spells: Vec<Spell>,
    /// Counts outside of episodes: `outside[k]` holds the bursts after the onsets of k episodes.
    pub outside: Vec<BurstCounts>,
    /// Names of the flagged bursts in episodes over time, by the categories of the episodes.
    calls: BTreeMap<String, Calls>,
    /// Severities of the flagged bursts in episodes over time, by the quantity that they measure. A
    /// flagged burst without a size in a quantity counts there as missed.
    courses: BTreeMap<String, Course>,
    /// All flagged bursts in episodes as missed: what the course of a new quantity begins with.
    missed: Course,
}

/// Most quantities that are followed for a channel; each own class has one.
const MOST_QUANTITIES: usize = 16;

impl Watch {
    /// A watch of the episodes of one channel, without any bursts yet.
    pub fn new(mut spells: Vec<Spell>) -> Watch {
        spells.sort_by(|a, b| {
            let key = |s: &Spell| (s.episode.began_at_ns, s.recording, s.episode.raised_at_ns);
            key(a).cmp(&key(b))
        });
        let outside = vec![BurstCounts::default(); spells.len() + 1];
        let categories = spells.iter().filter_map(|spell| spell.episode.category.clone());
        let calls = categories.map(|category| (category, Calls::default())).collect();
        Watch { spells, outside, calls, courses: BTreeMap::new(), missed: Course::default() }
    }

    /// Counts one judged burst of a recording, for the episode that it lies in or else for the time
    /// between episodes. `flagged`: what it says; `None`: it looks healthy.
    pub fn add_burst(&mut self, recording: usize, t_ns: i64, flagged: Option<Flagged<'_>>) {
        let before = self.spells.partition_point(|s| s.episode.began_at_ns <= t_ns);
        let within = |s: &&mut Spell| {
            s.recording == recording && s.episode.ended_at_ns.is_none_or(|end| t_ns < end)
        };
        // Of the recording's episodes the one that began last: earlier ones have ended.
        let Some(spell) = self.spells[..before].iter_mut().rev().find(within) else {
            return self.outside[before].add(t_ns, flagged.is_some());
        };
        spell.counts.add(t_ns, flagged.is_some());
        let Some(Flagged { category, size, distance }) = flagged else { return };
        for (of, calls) in &mut self.calls {
            calls.add(t_ns, category == Some(of.as_str()));
        }

        // A flagged burst without a size in some quantity is counted there, since `trend` corrects
        // for such bursts. A quantity beyond the limit is not followed.
        let distance = distance.map(|size| Size { quantity: DISTANCE, size });
        let sizes = [size, distance];
        let is_measured = |of: &str| sizes.iter().flatten().any(|size| size.quantity == of);
        let others = self.courses.iter_mut().filter(|(of, _)| !is_measured(of));
        others.for_each(|(_, course)| course.miss(t_ns));
        for Size { quantity, size } in sizes.into_iter().flatten() {
            if !self.courses.contains_key(quantity) && self.courses.len() < MOST_QUANTITIES {
                self.courses.insert(quantity.to_owned(), self.missed.clone());
            }
            if let Some(course) = self.courses.get_mut(quantity) {
                course.add(t_ns, size);
            }
        }
        self.missed.miss(t_ns);
    }

    /// Which flagged bursts are named by `category`; `None` if no episode is.
    pub fn calls(&self, category: &str) -> Option<&Calls> {
        self.calls.get(category)
    }

    /// The watches of the channel before `at_ns`, when it was replaced, and since then, as far as each has episodes. An
    /// episode that was on ended with the replacement, and another one began if its recording goes on beyond it.
    /// `ends_ns`: when a recording ends.
    pub fn divided(self, at_ns: i64, ends_ns: impl Fn(usize) -> i64) -> [Option<Watch>; 2] {
        let (mut before, mut after) = (self.clone(), self);
        let m = before.spells.partition_point(|of| of.episode.began_at_ns < at_ns);
        before.spells.truncate(m);
        before.outside.truncate(m + 1);
        after.spells.drain(..m);
        after.outside.drain(..m);
        let last = before.spells.len().saturating_sub(1);
        for (k, spell) in before.spells.iter_mut().enumerate() {
            let ended_at_ns = spell.episode.ended_at_ns.unwrap_or(i64::MAX);
            if ended_at_ns.min(ends_ns(spell.recording)) > at_ns {
                let mut rest = spell.clone();
                rest.episode.began_at_ns = at_ns;
                rest.episode.raised_at_ns = rest.episode.raised_at_ns.max(at_ns);
                after.spells.insert(0, rest);
                after.outside.insert(0, BurstCounts::default());
            } else if k < last {
                continue; // whether it was over then, the bursts until the next episode say
            }
            spell.episode.ended_at_ns = Some(ended_at_ns.min(at_ns));
        }
        [before, after].map(|watch| (!watch.spells.is_empty()).then_some(watch))
    }

    /// The severities over time that are measured in `quantity`; `None` if there are none.
    pub fn course(&self, quantity: &str) -> Option<&Course> {
        self.courses.get(quantity)
    }
}

/// The quantity of a fault without a name, which all flagged signals with a ring have.
pub const DISTANCE: &str = "distance from a healthy channel, in thresholds";

/// The quantity that an episode's severities measure, if its category has one quantity.
pub fn quantity(episode: &Episode) -> Option<&str> {
    match (episode.fault.as_deref(), episode.category.as_deref()) {
        (Some(class), _) => Some(fault::quantity(class)),
        (None, Some(category)) => sized_as(category).map(fault::quantity),
        (None, None) => Some(DISTANCE),
    }
}

/// A class whose quantity stands for a category, if all its classes are sized by that.
pub fn sized_as(category: &str) -> Option<&'static str> {
    match category {
        "blocked_nozzle" => Some("PBN"),
        "dried_nozzle" => Some("IDN"),
        _ => None,
    }
}
