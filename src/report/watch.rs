//! Counts over the bursts of a channel that had an episode: how often it was flagged in its
//! episodes and between them, and how severe its faults were over time.
//!
//! In: the episodes of a channel in one recording, then from `recording_counts` its judged bursts there one by one
//! ([`Watched::add_burst`]). Out: a [`Watched`]; and over all recordings, in any order, a [`Watch`], from which
//! [`super::story`] decides which episodes are of one fault, and which `false_alarms` counts over. A burst holds one
//! signal of the channel, so bursts and signals are the same number here.

use super::bins::{Pooled, TimeBins};
use super::naming::{Called, Calls};
use super::trend::{Course, Severities};
use inkling_core::episodes::Episode;
use inkling_core::fault;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Counts of a channel's judged bursts over some time.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct BurstCounts {
    pub judged: u64,
    pub flagged: u64,
    /// t_a of the first burst.
    pub first_ns: Option<i64>,
    /// t_a of the first burst that was not flagged.
    pub first_quiet_ns: Option<i64>,
    /// t_a of the last burst that was flagged.
    pub last_flagged_ns: Option<i64>,
}

impl BurstCounts {
    /// Counts one judged burst. `t_ns`: its t_a.
    pub fn add(&mut self, t_ns: i64, flagged: bool) {
        self.judged += 1;
        self.first_ns = self.first_ns.into_iter().chain([t_ns]).min();
        if flagged {
            self.flagged += 1;
            self.last_flagged_ns = self.last_flagged_ns.max(Some(t_ns));
        } else {
            self.first_quiet_ns = self.first_quiet_ns.into_iter().chain([t_ns]).min();
        }
    }

    /// Number of bursts that were not flagged.
    pub fn quiet(&self) -> u64 {
        self.judged - self.flagged
    }

    /// Adds the counts of another stretch of time.
    pub fn absorb(&mut self, other: &BurstCounts) {
        self.judged += other.judged;
        self.flagged += other.flagged;
        self.first_ns = self.first_ns.into_iter().chain(other.first_ns).min();
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
    /// Resonance, Hz, and damping, 1/s, of its ring.
    pub ring: Option<[f64; 2]>,
}

/// Most quantities that are followed for a channel, and most categories; each own class may have one.
const MOST_FOLLOWED: usize = 16;

/// What a channel's judged bursts in one recording, in which it had episodes, say of these.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Watched {
    /// Onset and end of each episode, in the order of onsets; `None`: it is on to the end.
    episodes: Vec<(i64, Option<i64>)>,
    /// Counts in each episode.
    within: Vec<BurstCounts>,
    /// Counts outside of episodes: `outside[k]` holds the bursts after the onsets of k episodes.
    outside: Vec<BurstCounts>,
    /// Names and sizes of the flagged bursts in episodes.
    said: Said,
}

/// What flagged bursts in episodes say over time.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Said {
    /// Which of them are named by a category, for each one met.
    calls: Followed<Called>,
    /// Their severities, by the quantity that they measure. A burst without a size in a quantity counts there as
    /// missed.
    courses: Followed<Severities>,
}

/// What is followed over time under several names.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(bound = "T: Pooled + Clone + Serialize + serde::de::DeserializeOwned")]
struct Followed<T: Pooled> {
    by_name: BTreeMap<String, TimeBins<T>>,
    /// All of it as of other names: what a new name begins with.
    others: TimeBins<T>,
}

impl<T: Pooled + Clone> Followed<T> {
    /// What is followed under a name, if there is room for it.
    fn of(&mut self, name: &str) -> Option<&mut TimeBins<T>> {
        if !self.by_name.contains_key(name) && self.by_name.len() < MOST_FOLLOWED {
            self.by_name.insert(name.to_owned(), self.others.clone());
        }
        self.by_name.get_mut(name)
    }

    /// What is followed under other names, and what new ones begin with.
    fn but_for(&mut self, is_it: impl Fn(&str) -> bool) -> impl Iterator<Item = &mut TimeBins<T>> {
        let others = self.by_name.iter_mut().filter(move |(name, _)| !is_it(name));
        others.map(|(_, bins)| bins).chain([&mut self.others])
    }

    /// Adds what was followed elsewhere. What only one of both follows is in the other as of other names.
    fn absorb(&mut self, other: &Followed<T>) {
        for name in other.by_name.keys() {
            let _ = self.of(name);
        }
        for (name, bins) in &mut self.by_name {
            let there = other.by_name.get(name).unwrap_or(&other.others);
            bins.absorb(there.clone(), |bin| bin);
        }
        self.others.absorb(other.others.clone(), |bin| bin);
    }
}

impl Said {
    fn add(&mut self, t_ns: i64, Flagged { category, size, distance, ring }: Flagged<'_>) {
        let named = category.and_then(|of| self.calls.of(of));
        named.into_iter().for_each(|calls| calls.add(t_ns, true));
        let others = self.calls.but_for(|of| category == Some(of));
        others.for_each(|calls| calls.add(t_ns, false));

        // a flagged burst without a size in some quantity is counted there, since `trend` corrects for such bursts
        let distance = distance.map(|size| Size { quantity: DISTANCE, size });
        let [resonance, damping] = [(RESONANCE, 0), (DAMPING, 1)]
            .map(|(quantity, k)| ring.map(|ring| Size { quantity, size: ring[k] }));
        let sizes = [size, distance, resonance, damping];
        let is_measured = |of: &str| sizes.iter().flatten().any(|size| size.quantity == of);
        for Size { quantity, size } in sizes.iter().flatten() {
            let course = self.courses.of(quantity);
            course.into_iter().for_each(|course| course.add(t_ns, *size, category.is_some()));
        }
        self.courses.but_for(is_measured).for_each(|course| course.miss(t_ns));
    }
}

impl Watched {
    /// The episodes of one channel in one recording, without any bursts yet.
    pub fn new(mut episodes: Vec<&Episode>) -> Watched {
        episodes.sort_by_key(|of| (of.began_at_ns, of.raised_at_ns));
        let n = episodes.len();
        Watched {
            episodes: episodes.iter().map(|of| (of.began_at_ns, of.ended_at_ns)).collect(),
            within: vec![BurstCounts::default(); n],
            outside: vec![BurstCounts::default(); n + 1],
            ..Watched::default()
        }
    }

    /// Counts one judged burst, for the episode that it lies in or else for the time between episodes. `flagged`:
    /// what it says; `None`: it looks healthy.
    pub fn add_burst(&mut self, t_ns: i64, flagged: Option<Flagged<'_>>) {
        let before = self.episodes.partition_point(|(began_ns, _)| *began_ns <= t_ns);
        // of the episodes the one that began last: earlier ones have ended
        let is_on = |(_, ended_ns): &(i64, Option<i64>)| ended_ns.is_none_or(|end| t_ns < end);
        let Some(at) = self.episodes[..before].iter().rposition(is_on) else {
            return self.outside[before].add(t_ns, flagged.is_some());
        };
        self.within[at].add(t_ns, flagged.is_some());
        flagged.into_iter().for_each(|flagged| self.said.add(t_ns, flagged));
    }
}

/// A channel's episodes over all recordings in the order of their onsets, and what its bursts in and outside of them
/// say.
#[derive(Clone, Debug)]
pub struct Watch {
    pub spells: Vec<Spell>,
    /// Counts outside of episodes: `outside[k]` holds the bursts after the onsets of k episodes.
    pub outside: Vec<BurstCounts>,
    said: Said,
}

impl Watch {
    /// A watch of the episodes of one channel, without any bursts yet.
    pub fn new(mut spells: Vec<Spell>) -> Watch {
        spells.sort_by_key(|s| (s.episode.began_at_ns, s.recording, s.episode.raised_at_ns));
        let outside = vec![BurstCounts::default(); spells.len() + 1];
        Watch { spells, outside, said: Said::default() }
    }

    /// Adds what the recording with this index, in which the channel had episodes, says. Where another recording of
    /// the same time has episodes, too, bursts outside of episodes count as those of the time at which they begin.
    pub fn absorb(&mut self, recording: usize, watched: &Watched) {
        let of_it = self.spells.iter_mut().filter(|spell| spell.recording == recording);
        of_it.zip(&watched.within).for_each(|(spell, counts)| spell.counts.absorb(counts));
        watched.outside.iter().for_each(|counts| self.absorb_outside(counts));
        self.said.calls.absorb(&watched.said.calls);
        self.said.courses.absorb(&watched.said.courses);
    }

    /// Adds bursts outside of episodes.
    pub fn absorb_outside(&mut self, counts: &BurstCounts) {
        let Some(first_ns) = counts.first_ns else { return };
        let before = self.spells.partition_point(|of| of.episode.began_at_ns <= first_ns);
        self.outside[before].absorb(counts);
    }

    /// Which flagged bursts in episodes are named by `category`; `None` if none is.
    pub fn calls(&self, category: &str) -> Option<&Calls> {
        self.said.calls.by_name.get(category)
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
        self.said.courses.by_name.get(quantity)
    }
}

/// The quantity of a fault without a name, which all flagged signals with a ring have.
pub const DISTANCE: &str = "distance from a healthy channel, in thresholds";
/// What the rings of all flagged signals have, Hz and 1/s.
pub const RESONANCE: &str = "resonance";
pub const DAMPING: &str = "damping";

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
