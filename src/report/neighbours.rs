//! Neighbouring channels that may have failed together, as with an air front or a flooded plate.
//!
//! In: the faults of all channels, the settings' rows and pitch (how the nozzles lie), and from the
//! survey how much was judged when (`Head`). Out to the page and the list: [`Group`]s of open
//! faults of one category on neighbouring nozzles that began together, each with a sentence.
//!
//! Independent faults also lie beside each other and begin together at times. So two faults are
//! joined (`began_together`) only if both numbers are at most .05:
//! 1. close = 2 x the share of all judged signals between the two onsets: the probability that an
//!    independent fault begins so close to the first, before or after it. Time is counted in judged
//!    signals, since nobody sees an onset when nothing is measured.
//! 2. pairs x touching x close: the number of such pairs that chance makes on a printhead with that
//!    many faults; touching is the probability that two channels are neighbours.
//!
//! Groups are the connected components of joined faults.

use super::fault::Fault;
use super::night::{Span, whole};
use super::settings::ReportSettings;
use super::story::Story;
use super::survey::Head;
use super::words::clock;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Least number of onsets in the order of their channels that show a direction.
const LEAST_OF_A_FRONT: usize = 4;
/// The limit of both numbers of the file's doc.
const CHANCE: f64 = 0.05;

/// Faults of one category on neighbouring nozzles that were on at the same time.
#[derive(Clone, Debug, PartialEq)]
pub struct Group {
    /// Indices into the faults, by ascending channel.
    pub members: Vec<usize>,
    pub sentence: String,
}

/// Share of all judged signals of a printhead that lie between two times, ns, if they are evenly
/// spread over each recording. One burst is added, so that the share is not 0 for equal times.
fn share_between(head: &Head, a_ns: i64, b_ns: i64) -> f64 {
    let (from, to) = (a_ns.min(b_ns) as f64, a_ns.max(b_ns) as f64);
    let judged = head.tallies.values().filter_map(|of| Some((of.span?, of.judged)));
    let within = |((begins, ends), n): (Span, u64)| {
        let (begins, ends) = (begins as f64, ends as f64);
        let overlap = (to.min(ends) - from.max(begins)).max(0.0);
        n as f64 * overlap / (ends - begins).max(1.0)
    };
    let all: u64 = judged.clone().map(|(_, n)| n).sum();
    let between: f64 = judged.map(within).sum();
    (between + head.channels.len() as f64) / all.max(1) as f64
}

/// Whether the faults of two neighbours began closer together than independent faults would.
/// `faults`: number of faults of the printhead; `rows`: its rows of nozzles.
fn began_together(head: &Head, faults: usize, a: &Story, b: &Story, rows: u32) -> bool {
    // The probability that a second, independent onset lies so close to the first, before or after
    // it. If neither onset was seen, only the places of the channels are evidence.
    let unseen = !a.onset_seen && !b.onset_seen;
    let close = match unseen {
        true => 1.0,
        false => (2.0 * share_between(head, a.began_at_ns, b.began_at_ns)).min(1.0),
    };

    // A nozzle has two neighbours in its row, and three in each row beside it, of which there are
    // at most two.
    let neighbours = 2.0 + 3.0 * f64::from((rows - 1).min(2));
    // pairs of faults, and the probability that the channels of a pair are neighbours
    let pairs = 0.5 * faults as f64 * faults.saturating_sub(1) as f64;
    let touching = neighbours / head.channels.len().saturating_sub(1).max(1) as f64;
    (unseen || close <= CHANCE) && pairs * touching * close <= CHANCE
}

/// Groups of two or more open faults, the largest first. `heads`: all printheads.
pub fn groups(faults: &[Fault], heads: &[Head], settings: &ReportSettings) -> Vec<Group> {
    let mut left: Vec<usize> = (0..faults.len()).filter(|k| faults[*k].is_open()).collect();
    let mut groups = Vec::new();
    let of_head = |name: &Arc<str>| faults.iter().filter(|of| of.story.printhead == *name).count();
    let heads: BTreeMap<&Arc<str>, (&Head, usize)> =
        heads.iter().map(|head| (&head.name, (head, of_head(&head.name)))).collect();
    let joined = |Fault { story: a, .. }: &Fault, Fault { story: b, .. }: &Fault| {
        let together =
            |(head, faults): &(&Head, usize)| began_together(head, *faults, a, b, settings.rows);
        touch(a, b, settings) && heads.get(&a.printhead).is_some_and(together)
    };

    // Grow a group from any fault by what is joined to one of its members, until nothing is.
    while let Some(first) = left.pop() {
        let mut members = vec![first];
        let mut at = 0;
        while at < members.len() {
            let of = &faults[members[at]];
            let (near, far) =
                left.into_iter().partition::<Vec<usize>, _>(|k| joined(of, &faults[*k]));
            members.extend(near);
            left = far;
            at += 1;
        }
        if members.len() > 1 {
            members.sort_by_key(|k| faults[*k].story.channel);
            let sentence = sentence(&members, faults, settings);
            groups.push(Group { members, sentence });
        }
    }
    groups.sort_by_key(|g| (std::cmp::Reverse(g.members.len()), g.members.clone()));
    groups
}

/// Whether two faults of one category are on neighbouring nozzles, and were on at the same time.
fn touch(a: &Story, b: &Story, settings: &ReportSettings) -> bool {
    let place =
        |channel: u32| (i64::from(channel % settings.rows), i64::from(channel / settings.rows));
    let ((row_a, at_a), (row_b, at_b)) = (place(a.channel), place(b.channel));
    let together = |x: Option<i64>, y: i64| x.is_none_or(|end| end >= y);
    a.printhead == b.printhead
        && a.category.is_some()
        && a.category == b.category
        && (row_a - row_b).abs() <= 1
        && (at_a - at_b).abs() <= 1
        && together(a.ended_at_ns, b.began_at_ns)
        && together(b.ended_at_ns, a.began_at_ns)
}

/// The group in one sentence: which channels, since when, and what may be the cause.
fn sentence(members: &[usize], faults: &[Fault], settings: &ReportSettings) -> String {
    let stories: Vec<_> = members.iter().map(|k| &faults[*k].story).collect();
    let category = stories[0].category.as_deref().unwrap_or_default();
    let channels = |k: usize| stories[k].channel;
    let last = stories.len() - 1;
    let (head, n, sort) = (&stories[0].printhead, stories.len(), category.replace('_', " "));
    let range = format!("{} to {}", channels(0), channels(last));
    let mut text =
        format!("{head}: {n} neighbouring channels, {range}, have the same sort of fault ({sort})");
    if settings.pitch > 0.0 {
        let width = f64::from(channels(last) / settings.rows - channels(0) / settings.rows);
        text += &format!(", over {:.2} mm", width * settings.pitch / 1e3);
    }

    // Four or more onsets in the order of the channels look like a front.
    let onsets: Vec<i64> = stories.iter().map(|s| s.began_at_ns).collect();
    let (rising, falling) = (onsets.is_sorted(), onsets.iter().rev().is_sorted());
    let (first_ns, last_ns) = whole(onsets.iter().map(|t| (*t, *t))).unwrap_or_default();
    let moves = first_ns != last_ns && onsets.len() >= LEAST_OF_A_FRONT;
    text += &match stories.iter().any(|s| s.onset_seen) {
        false => ", all since before they were first looked at".to_owned(),
        true if first_ns == last_ns => format!(", all since {}", clock(first_ns)),
        true => format!(", since {} to {}", clock(first_ns), clock(last_ns)),
    };

    // What may be the cause.
    text += &match category {
        _ if moves && (rising || falling) => {
            let to = channels(if rising { last } else { 0 });
            format!(", one after the other towards channel {to}: perhaps a front that moves")
        }
        "air_bubble" | "empty_channel" => ": perhaps air in what they share".to_owned(),
        "blocked_nozzle" | "dried_nozzle" => ": perhaps something on the plate".to_owned(),
        _ => ": perhaps of one cause".to_owned(),
    };
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::counts::{ChannelCount, Tally};
    use crate::report::fixtures::spell;
    use crate::report::story::{Rates, stories};
    use crate::report::watch::Watch;

    const BEFORE: i64 = -1_000_000;

    fn fault(channel: u32, began: i64, category: &str) -> Fault {
        let mut on = spell(0, began, None, category);
        on.episode.channel = channel;
        let mut watch = Watch::new(vec![on]);
        watch.add_burst(0, BEFORE, false, None, None);
        let stories = stories(&watch, &Rates::default());
        Fault::of_channel(stories, &ReportSettings::default()).remove(0)
    }

    fn of(faults: &[Fault], rows: u32) -> Vec<Group> {
        let span = Some((BEFORE, 1_000_000));
        let tally = Tally { judged: 256 * 2000, span, ..Tally::default() };
        let head = Head {
            name: "p".into(),
            channels: vec![ChannelCount::default(); 256],
            tallies: BTreeMap::from([(0, tally)]),
            ..Head::default()
        };
        groups(faults, &[head], &ReportSettings { rows, pitch: 100.0, ..Default::default() })
    }

    #[test]
    fn neighbours_of_one_sort_are_a_group_and_others_are_not() {
        let faults = [
            fault(3, 0, "dried_nozzle"),
            fault(4, 0, "dried_nozzle"),
            fault(5, 0, "air_bubble"),
            fault(9, 0, "dried_nozzle"),
        ];
        let groups = of(&faults, 1);
        assert_eq!(groups.len(), 1);
        assert_eq!(groups[0].members, [0, 1]);
        assert!(groups[0].sentence.contains("perhaps something on the plate"), "{groups:?}");
        assert!(groups[0].sentence.contains("0.10 mm"), "{}", groups[0].sentence);
    }

    #[test]
    fn neighbours_that_began_far_apart_are_no_group_and_nor_is_what_chance_makes() {
        let apart = [fault(3, 0, "dried_nozzle"), fault(4, 200_000, "dried_nozzle")];
        assert_eq!(of(&apart, 1), []);
        // two faults on neighbours that begin within a hundredth of the time; then sixty more faults
        let mut many = vec![fault(3, 0, "dried_nozzle"), fault(4, 20_000, "dried_nozzle")];
        assert_eq!(of(&many, 1).len(), 1);
        many.extend((0..60).map(|k| fault(10 + 2 * k, 0, "air_bubble")));
        assert_eq!(of(&many, 1), []);
    }

    #[test]
    fn faults_that_nobody_saw_begin_speak_by_their_places() {
        let unseen = |channel| {
            let mut of = fault(channel, 0, "dried_nozzle");
            of.story.onset_seen = false;
            of
        };
        let groups = of(&[unseen(3), unseen(4)], 1);
        assert!(groups[0].sentence.contains("first looked at"), "{groups:?}");
    }

    #[test]
    fn onsets_one_after_the_other_are_a_front() {
        let faults: Vec<Fault> =
            (0..5).map(|k| fault(10 - k, 1000 * i64::from(k), "air_bubble")).collect();
        let sentence = &of(&faults, 1)[0].sentence;
        assert!(sentence.contains("towards channel 6") && sentence.contains("front"), "{sentence}");
    }

    #[test]
    fn rows_say_who_the_neighbours_are() {
        let faults = [fault(8, 0, "air_bubble"), fault(12, 0, "air_bubble")];
        assert_eq!(of(&faults, 1).len(), 0);
        assert_eq!(of(&faults, 4).len(), 1, "the same row, beside each other");
        let faults = [fault(3, 0, "air_bubble"), fault(4, 0, "air_bubble")];
        assert_eq!(of(&faults, 4).len(), 0, "the last row and the first");
    }
}
