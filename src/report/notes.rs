//! What the reader should know before anything is cleaned, in sentences that stand at the top of
//! the page and of the terminal's list.
//!
//! In: a survey, its faults and its recordings. Out: notes about printheads with so many
//! faults at once that the cause is hardly the nozzles, and about recordings that overlap in time,
//! whose signals count twice.

use super::counts::Tally;
use super::fault::Fault;
use super::source::Source;
use super::survey::{Head, Survey};
use super::words::{counted, first_of, percent, thousands};
use inkling_core::verdict::at_once::{ADVICE, FEWEST_CHANNELS, MOST_AT_ONCE};
use std::sync::Arc;

/// Most pairs of overlapping recordings that are named; of further ones only the number is told.
const MOST_NAMED: usize = 3;

/// A sentence that the reader should know before anything is cleaned.
#[derive(Clone, Debug)]
pub struct Note {
    /// Whose faults it is about; `None`: no printhead's.
    pub printhead: Option<Arc<str>>,
    pub what: String,
}

impl Note {
    pub fn of_all(what: String) -> Note {
        Note { printhead: None, what }
    }
}

/// All notes of a report.
pub fn notes(survey: &Survey, faults: &[Fault], sources: &[Source]) -> Vec<Note> {
    let at_once = survey.heads.iter().filter_map(|head| {
        let what = at_once(head, faults)?;
        Some(Note { printhead: Some(head.name.clone()), what })
    });
    at_once.chain(overlaps(survey, sources).map(Note::of_all)).collect()
}

/// The note of a printhead of which so much looks faulty at once that what its channels share is the
/// likelier cause. So it is where more than the share [`MOST_AT_ONCE`] of its channels have a fault that is
/// still on, or more than that share of the judged signals of its latest recording are flagged. A printhead
/// of fewer than [`FEWEST_CHANNELS`] channels gets no such note.
fn at_once(head: &Head, faults: &[Fault]) -> Option<String> {
    let channels = head.channels.len();
    let on = |f: &&Fault| f.story.printhead == head.name && f.story.ended_at_ns.is_none();
    // faults that are on are as many channels, since only the last fault of a channel can be on
    let faulty = faults.iter().filter(on).count();
    // of the recordings in which the printhead was judged, the one with the latest signal
    let latest =
        head.tallies.values().filter(|t| t.judged > 0).max_by_key(|t| t.span.map(|span| span.1))?;
    let limit = |of: u64| MOST_AT_ONCE * of as f64;
    let many_faulty = faulty as f64 > limit(channels as u64);
    let many_flagged = latest.flagged as f64 > limit(latest.judged);
    (channels >= FEWEST_CHANNELS && (many_faulty || many_flagged)).then(|| {
        format!(
            "{}: {} of its {} have faults that are still on, and {} of its latest signals are flagged. {ADVICE}.",
            head.name,
            thousands(faulty as u64),
            counted(channels as u64, "channel"),
            percent(latest.flagged, latest.judged)
        )
    })
}

/// The note about recordings that seem to hold the same channels at the same time.
fn overlaps(survey: &Survey, sources: &[Source]) -> Option<String> {
    let heads = survey.heads.iter().filter(|head| !overlapping(head).is_empty()).count();
    let pairs = overlapping_recordings(survey);
    let name = |k: usize| sources.get(k).map_or("", |source| source.name.as_str());
    let both = |&(a, b): &(usize, usize)| format!("{} and {}", name(a), name(b));
    let named: Vec<String> = pairs.iter().map(both).collect();
    (!pairs.is_empty()).then(|| {
        format!(
            "Recordings overlap in time on {}: {}. What two of them hold counts twice; or a clock \
             was wrong, or two printheads have one name.",
            counted(heads as u64, "printhead"),
            first_of(&named, MOST_NAMED, ", ")
        )
    })
}

/// Pairs of recordings, by their indices, that overlap on any printhead.
pub fn overlapping_recordings(survey: &Survey) -> Vec<(usize, usize)> {
    let mut pairs: Vec<(usize, usize)> = survey.heads.iter().flat_map(overlapping).collect();
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}

/// Pairs of recordings of a printhead, by their indices, that overlap in time and in the range of channels that
/// they judged. Each recording is paired with at most one of the [`MOST_LOOKED_BACK`] before it: the latest one
/// that it overlaps.
fn overlapping(head: &Head) -> Vec<(usize, usize)> {
    let span = |(&k, t): (&usize, &Tally)| t.span.map(|(from, to)| (from, to, k));
    let mut spans: Vec<(i64, i64, usize)> = head.tallies.iter().filter_map(span).collect();
    spans.sort_unstable();
    let pair = |(at, &(from, _, k)): (usize, &(i64, i64, usize))| {
        let shares = |other: usize| {
            let (a, b) = (head.tallies[&k].channels, head.tallies[&other].channels);
            a.zip(b).is_some_and(|([a, z], [b, y])| a.max(b) <= z.min(y))
        };
        let mut earlier = spans[..at].iter().rev().take(MOST_LOOKED_BACK);
        let of = earlier.find(|(_, to, other)| *to > from && shares(*other));
        of.map(|&(_, _, other)| (other.min(k), other.max(k)))
    };
    spans.iter().enumerate().filter_map(pair).collect()
}

/// Number of preceding recordings with which each one is compared, to bound the time.
const MOST_LOOKED_BACK: usize = 64;
