//! Channels that had an episode, looked at burst by burst: how often they were flagged in their
//! episodes and between them. In: episodes, then verdicts in any order. Out: what [`super::story`]
//! links by.

use super::trend::Course;
use inkling_core::episodes::Episode;
use inkling_core::fault;
use inkling_core::verdict::Reason;
use std::collections::BTreeMap;

/// Counts of a channel's judged bursts over some time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LookCounts {
    pub judged: u64,
    pub flagged: u64,
    /// Of the flagged ones: no ring explains them.
    pub no_ring: u64,
    /// A ring, but of no known class.
    pub unknown_fault: u64,
    /// t_a of the first burst that was not flagged.
    pub first_quiet_ns: Option<i64>,
}

impl LookCounts {
    pub fn add(&mut self, t_ns: i64, flagged: bool, reason: Option<Reason>) {
        self.judged += 1;
        if flagged {
            self.flagged += 1;
            self.no_ring += u64::from(reason == Some(Reason::NoRing));
            self.unknown_fault += u64::from(reason == Some(Reason::UnknownFault));
        } else {
            self.first_quiet_ns = self.first_quiet_ns.into_iter().chain([t_ns]).min();
        }
    }

    pub fn absorb(&mut self, other: &LookCounts) {
        self.judged += other.judged;
        self.flagged += other.flagged;
        self.no_ring += other.no_ring;
        self.unknown_fault += other.unknown_fault;
        self.first_quiet_ns = self.first_quiet_ns.into_iter().chain(other.first_quiet_ns).min();
    }
}

/// An episode, and how its channel looked in it.
#[derive(Clone, Debug)]
pub struct Spell {
    /// Which recording's.
    pub recording: usize,
    pub episode: Episode,
    pub looked: LookCounts,
}

/// How bad a signal is.
#[derive(Clone, Copy, Debug)]
pub struct Size<'a> {
    pub quantity: &'a str,
    pub size: f64,
}

/// A channel's episodes in the order of their onsets, and how it looked after each.
#[derive(Clone, Debug)]
pub struct Watch {
    pub spells: Vec<Spell>,
    /// Outside of episodes, after as many of them as the place says (0: before the first).
    pub outside: Vec<LookCounts>,
    /// Severities in its episodes, by what they measure.
    courses: BTreeMap<String, Course>,
}

/// Quantities of a channel: classes of one's own have each their own.
const MOST_QUANTITIES: usize = 16;

impl Watch {
    pub fn new(mut spells: Vec<Spell>) -> Watch {
        spells.sort_by(|a, b| {
            let key = |s: &Spell| (s.episode.began_at_ns, s.recording, s.episode.raised_at_ns);
            key(a).cmp(&key(b))
        });
        let outside = vec![LookCounts::default(); spells.len() + 1];
        Watch { spells, outside, courses: BTreeMap::new() }
    }

    /// A judged burst of a recording.
    pub fn look(
        &mut self,
        recording: usize,
        t_ns: i64,
        flagged: bool,
        reason: Option<Reason>,
        sized: Option<Size<'_>>,
    ) {
        let before = self.spells.partition_point(|s| s.episode.began_at_ns <= t_ns);
        let within = |s: &&mut Spell| {
            s.recording == recording && s.episode.ended_at_ns.is_none_or(|end| t_ns < end)
        };
        // of a recording's episodes the last that began; an earlier one has ended
        match self.spells[..before].iter_mut().rev().find(within) {
            Some(spell) => {
                spell.looked.add(t_ns, flagged, reason);
                let Some(Size { quantity, size: severity }) = sized else { return };
                if !self.courses.contains_key(quantity) && self.courses.len() < MOST_QUANTITIES {
                    self.courses.insert(quantity.to_owned(), Course::default());
                }
                if let Some(course) = self.courses.get_mut(quantity) {
                    course.add(t_ns, severity);
                }
            }
            None => self.outside[before].add(t_ns, flagged, reason),
        }
    }

    /// Its severities over time, where there are any of what an episode's severities measure.
    pub fn course(&self, quantity: &str) -> Option<&Course> {
        self.courses.get(quantity)
    }
}

/// What is measured of a fault that has no name: how far its signals are from healthy, in the threshold's distances.
pub const DISTANCE: &str = "distance from a healthy channel, in thresholds";

/// What an episode's severities measure; `None`: its classes are sized by different quantities.
pub fn quantity(episode: &Episode) -> Option<&str> {
    match (episode.fault.as_deref(), episode.category.as_deref()) {
        (Some(class), _) => Some(fault::quantity(class)),
        (None, Some(category)) => sized_as(category).map(fault::quantity),
        (None, None) => Some(DISTANCE),
    }
}

/// The class by which a category of several is sized, where all of them are sized by one quantity.
pub fn sized_as(category: &str) -> Option<&'static str> {
    match category {
        "blocked_nozzle" => Some("PBN"),
        "dried_nozzle" => Some("IDN"),
        _ => None,
    }
}
