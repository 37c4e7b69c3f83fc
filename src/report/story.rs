//! Links the episodes of a channel over recordings: one story per fault.
//!
//! In: the `Watch` of a channel (its episodes, and counts of its bursts in and between them), and
//! `Rates`, how often faults begin on channels at all. Out to `fault`: `Story`s (`stories`). Two
//! episodes are of one fault unless the channel was cured between them and the second is another.
//!
//! # Cured or not
//!
//! Whether a channel was cured between two episodes follows from its bursts in between, by a
//! likelihood ratio: either as many of them are flagged as in the episodes (weak faults are not
//! flagged in every burst), or as few as on healthy channels. If the logarithm of the ratio is
//! above 3, the channel was cured (`healthy_over_faulty`). If the first episode ended within its recording, the
//! sequential test of the episodes has seen the cure, and one quiet burst after it is enough. If no
//! burst was judged in between, the fault counts as not cured.
//!
//! # The same fault or another
//!
//! A new fault begins on this channel with the rate `mu` per burst at which faults begin on
//! channels at all, which is small. A fault that comes back does so with a rate lambda of its own,
//! of which nothing is known but that it lies between `mu` and 1 (every burst); its logarithm is
//! taken as uniform. After n quiet bursts the ratio of the two likelihoods, a return over a new
//! fault, is (`returns_over_new`)
//!
//! ```text
//! integral over ln lambda, from ln mu to 0, of lambda e^(-lambda n) / ln(1 / mu), over mu e^(-mu n)
//! = (1 - e^((mu - 1) n)) / (mu n ln(1 / mu))
//! ```
//!
//! The ratio is divided by the share of the category among all episodes, as another fault would
//! rarely be of the same category. Below 1 the second episode is another fault; and it always is if
//! its category differs. So a nozzle that dries every night is one story, and a fault that comes
//! once in a channel's life is a story of its own. This model is the project's own, no published
//! one.

use super::naming::LastNamed;
use super::trend::{self, Course, Direction, Severities, Trend};
use super::watch::{self, BurstCounts, DAMPING, DISTANCE, RESONANCE, Spell, Watch};
use inkling_core::episodes::Episode;
use inkling_core::model::faults::{self, Law};
use inkling_core::verdict::Reason;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// A channel counts as cured above this ln of the likelihood ratio, healthy over still faulty: 20 to 1.
const CURED: f64 = 3.0;
/// Prior of the share of flagged bursts in a channel's episodes: as if this many bursts, half of
/// them flagged, had been seen before.
const PRIOR_BURSTS: f64 = 1.0;
/// Most characters that are kept of an episode's explanation.
const MOST_OF_A_SENTENCE: usize = 300;

/// Rates over all channels of all printheads, against which the bursts of one channel are weighed.
#[derive(Clone, Debug, Default)]
pub struct Rates {
    /// Channels with an episode.
    pub faulty_channels: u64,
    /// Judged signals of all channels.
    pub judged: u64,
    /// Share of signals that are flagged outside of episodes.
    pub false_alarms: f64,
    /// Number of episodes by category.
    pub categories: BTreeMap<String, u64>,
}

impl Rates {
    /// Rate mu at which faults begin, per judged signal, at most one half. The channel in question
    /// has a fault itself, so one channel is taken off; half a fault is added so that the rate is
    /// not 0 if no other channel has any.
    fn onset(&self) -> f64 {
        let others = self.faulty_channels.saturating_sub(1) as f64 + 0.5;
        (others / self.judged.max(1) as f64).min(0.5)
    }

    /// Share of a category among all episodes that have one. One is added to each category's count
    /// and one for all others, so that no share is 0.
    fn share(&self, category: Option<&str>) -> f64 {
        let all: u64 = self.categories.values().sum();
        let of = category.and_then(|c| self.categories.get(c)).copied().unwrap_or(0);
        (of as f64 + 1.0) / (all as f64 + 1.0 + self.categories.len().max(1) as f64)
    }
}

/// One fault of a channel over all recordings.
#[derive(Clone, Debug)]
pub struct Story {
    pub printhead: Arc<str>,
    pub channel: u32,
    /// Category of the last episode that has one.
    pub category: Option<String>,
    /// Class, if the episode that the story is named after has one.
    pub fault: Option<String>,
    /// Why the episode of a story without a category has none, or the last one where present signals carry the name no
    /// longer; `no_ring`, too, where the cause lies in the sensor line.
    pub reason: Option<Reason>,
    /// What the episode's explanation says (not trusted) of a story without a category, or of the last one where present
    /// signals carry the name no longer.
    pub explanation: Option<String>,
    pub began_at_ns: i64,
    /// When the fault ended; `None` if it is still on.
    pub ended_at_ns: Option<i64>,
    /// Whether all channels of its printhead moved together when it ended: then they may have got the fault, too.
    pub ended_with_all: bool,
    /// Number of recordings that hold an episode of the fault.
    pub recordings: u32,
    pub spells: Vec<Spell>,
    /// How often the channel was cured between the story's episodes.
    pub cures: u32,
    /// Onset of the first episode after the last cure.
    pub last_began_at_ns: i64,
    /// Of what time name and size are: t_a of the last signal that carries the name, or of a story without a
    /// name, of its last look.
    pub known_at_ns: i64,
    /// Where present signals, or those before its end, carry the name no longer: the size that it had at last, which is
    /// not told as of now. Then the story has no size and no certainty, and its trend is that of the distance from healthy.
    pub lost: Option<LastSize>,
    /// The first and the last severity among the episodes that are sized in `quantity`.
    pub severity_first: Option<f64>,
    pub severity_last: Option<f64>,
    /// Standard deviation of `severity_last`.
    pub severity_sd: Option<f64>,
    /// The quantity that the severities measure; `None` if they measure several.
    pub quantity: Option<String>,
    /// Trend of `quantity` since the last cure; `None` if there are too few sizes.
    pub trend: Option<Trend>,
    /// Mean distance of its latest signals from healthy, in distances of the threshold; `None`: no ring.
    pub distance: Option<f64>,
    /// Certainty, from 0 to 1, of the episode that the story is named after.
    pub certainty: Option<f64>,
    /// When the channel that had the fault was replaced; `None`: it was not.
    pub replaced_at_ns: Option<i64>,
    /// The note of whoever acknowledged that the fault is known.
    pub known: Option<String>,
}

impl Story {
    /// When the fault ended or, if it is on, t_a of the last signal that shows it.
    pub fn last_look_ns(&self) -> i64 {
        let last = self.spells.iter().map(Spell::last_look_ns).max().unwrap_or(self.began_at_ns);
        self.ended_at_ns.unwrap_or(last)
    }
}

/// A size as it was last known, with its standard deviation; `None` of a fault that was never sized.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LastSize {
    pub severity: Option<f64>,
    pub sd: Option<f64>,
}

/// If these words stand in an episode's explanation, the cause lies in the sensor line.
const SENSOR_LINE: &str = "look at cable";

/// Whether the channel was cured between two episodes, or after the last one.
struct Cure {
    is_one: bool,
    /// Bursts that were not flagged.
    quiet: u64,
}

/// What a channel's bursts between two episodes, or after the last one, say about a cure: ln of the binomial
/// likelihood ratio, healthy over still faulty. `share`: share of flagged bursts in the channel's episodes;
/// `false_alarms`: that on healthy channels.
fn healthy_over_faulty(between: &BurstCounts, share: f64, false_alarms: f64) -> f64 {
    // A healthy channel must be flagged more rarely than a faulty one, or the ratio says nothing.
    let false_alarms = false_alarms.clamp(1e-6, 0.5 * share);
    between.flagged as f64 * (false_alarms / share).ln()
        + between.quiet() as f64 * ((1.0 - false_alarms) / (1.0 - share)).ln()
}

/// The stories of a channel, in the order of their onsets.
pub fn stories(watch: &Watch, rates: &Rates) -> Vec<Story> {
    // The share of flagged bursts in this channel's episodes, with a weak prior.
    let mut whole = BurstCounts::default();
    watch.spells.iter().for_each(|spell| whole.absorb(&spell.counts));
    let share = (whole.flagged as f64 + 0.5 * PRIOR_BURSTS) / (whole.judged as f64 + PRIOR_BURSTS);
    let share = share.clamp(0.01, 0.999);

    // The gap before episode k; with k the number of episodes, the time after the last one.
    let gap = |k: usize| {
        // The sequential test saw the channel healthy if the episode ended: then one quiet burst is enough, unless
        // so many are flagged all the same that the channel goes on to be faulty.
        let ended = watch.spells[k - 1].episode.ended_at_ns.is_some();
        let between = &watch.outside[k];
        // Bursts from before the last flagged one cure nothing: they come from another channel of that name, in a
        // recording of the same time.
        let is_beside =
            between.first_ns.is_some_and(|t_ns| t_ns <= watch.spells[k - 1].last_look_ns());
        let healthy = healthy_over_faulty(between, share, rates.false_alarms);
        let quiet = between.quiet();
        let is_cured = healthy > CURED && !is_beside;
        Cure { is_one: is_cured || ended && quiet > 0 && healthy > -CURED, quiet }
    };
    // Episodes `from..k` make up the current story, which ends where episode k is another fault.
    let mut all = Vec::new();
    let mut from = 0;
    for k in 1..=watch.spells.len() {
        let last = k == watch.spells.len();
        let (before, here) = (&watch.spells[k - 1], gap(k));
        if !last && !is_another(before, &watch.spells[k], &here, rates) {
            continue;
        }

        // It ended where its last episode did, or at the first quiet burst after it if the channel was cured
        // later.
        let inner: Vec<Cure> = (from + 1..k).map(gap).collect();
        let after = &watch.outside[k];
        let is_over = here.is_one || before.episode.ended_at_ns.is_some() && after.judged == 0;
        let ended_at_ns = before.episode.ended_at_ns.or(after.first_quiet_ns);
        let ended_at_ns = ended_at_ns.filter(|_| is_over);

        all.push(story(watch, &watch.spells[from..k], &inner, ended_at_ns));
        from = k;
    }
    all
}

/// Whether the episode after a gap is a new fault, rather than the old one.
fn is_another(before: &Spell, after: &Spell, gap: &Cure, rates: &Rates) -> bool {
    if !gap.is_one {
        return false; // whatever it is called now, it was never gone
    }

    // The share of the category among all episodes: so often would another fault have the same
    // category by chance. It is 1 if either episode has no category, which is no evidence.
    let (was, is) = (before.episode.category.as_deref(), after.episode.category.as_deref());
    let same = match (was, is) {
        (Some(was), Some(is)) if was != is => return true,
        (Some(_), Some(is)) => rates.share(Some(is)),
        _ => 1.0, // unnamed: no evidence either way
    };
    returns_over_new(gap.quiet as f64, rates.onset()) / same < 1.0
}

/// Likelihood that a fault comes back after n > 0 quiet bursts, over that of a new one. `mu`: rate of new ones.
fn returns_over_new(n: f64, mu: f64) -> f64 {
    (1.0 - ((mu - 1.0) * n).exp()) / (mu * n * (1.0 / mu).ln())
}

/// The episode that the story of these spells is named after: the last one with a class, unless a
/// later episode names another category. An unnamed episode takes nothing back.
fn named_after(spells: &[Spell]) -> &Episode {
    let latest = || spells.iter().rev().map(|s| &s.episode);
    let category = latest().find(|e| e.category.is_some());
    match (latest().find(|e| e.fault.is_some()), category) {
        (Some(fault), Some(category)) if fault.category == category.category => fault,
        (_, Some(category)) => category,
        _ => &spells[spells.len() - 1].episode,
    }
}

/// The story of these episodes. `inner`: the gaps between them, one fewer than episodes;
/// `ended_at_ns`: `None` if the story is still on.
fn story(watch: &Watch, spells: &[Spell], inner: &[Cure], ended_at_ns: Option<i64>) -> Story {
    let (first, named) = (&spells[0].episode, named_after(spells));
    let recordings: BTreeSet<usize> = spells.iter().map(|s| s.recording).collect();
    // the first episode after the last cure
    let last_run = inner.iter().rposition(|gap| gap.is_one).map_or(0, |k| k + 1);
    let last_began_at_ns = spells[last_run].episode.began_at_ns;

    // The size is that of the last episode that has one in the quantity of the story's class. Episodes
    // of another class may be sized in another unit, and those without a name as their best class is.
    let quantity = watch::quantity(named);
    let same = |e: &&Episode| e.category.is_some() && watch::quantity(e) == quantity;
    let mut sized = spells.iter().map(|s| &s.episode).filter(same);
    let last_sized = sized.clone().rfind(|e| e.severity_last.is_some());
    let to_ns = ended_at_ns.unwrap_or(i64::MAX);
    // signals after the last episode of the name may carry it, too
    let of_signals = quantity.filter(|of| *of != DISTANCE).and_then(|of| watch.course(of));
    let of_signals = of_signals.and_then(|of| of.last(first.began_at_ns, to_ns));
    let last = LastSize {
        severity: of_signals.or(last_sized.and_then(|e| e.severity_last)),
        sd: last_sized.and_then(|e| e.severity_sd),
    };
    // where the last signals of a fault carry the name no longer, the distance is what is known of it; those with which
    // it went may be without a name
    let last_named = last_named(watch, spells, named, ended_at_ns.unwrap_or(i64::MAX));
    let ends_unnamed = spells[spells.len() - 1].episode.category.is_none();
    let is_lost = !last_named.is_of_now && (ended_at_ns.is_none() || ends_unnamed);
    let lost = is_lost.then_some(last);
    let quantity = if lost.is_some() { Some(DISTANCE) } else { quantity };

    // The relative standard deviation of the size, measured from the severity of no fault
    // (`Law::none`): all sizes of the channel may be off by this factor, and so may the trend.
    let none = named.fault.as_deref().and_then(faults::law).map(Law::none);
    let scale = last.severity.zip(last.sd).zip(none).filter(|_| lost.is_none());
    let scale = scale.map(|((last, sd), none)| sd / (last - none).abs());
    let scale = scale.filter(|scale| scale.is_finite()).unwrap_or(0.0);
    let course = quantity.and_then(|quantity| watch.course(quantity));
    let trend_of = |course| trend::trend(course, last_began_at_ns, to_ns);
    // The threshold, by which distances are measured, follows what is learned of the channel; the ring does not. So a
    // distance grows only where the ring changes, too.
    let changes = |of: &str| {
        let trend = watch.course(of).and_then(trend_of);
        trend.is_some_and(|trend| trend.direction() != Direction::Steady)
    };
    let is_of_fault =
        |_: &Trend| quantity != Some(DISTANCE) || changes(RESONANCE) || changes(DAMPING);
    let trend = course.and_then(trend_of).filter(is_of_fault);
    let distance = watch.course(DISTANCE).and_then(|course| distance_of_now(course, to_ns));
    let size_of_now = if lost.is_none() { last } else { LastSize::default() };

    // What stands for the name of a story without a category, and beside one that was lost: what the last episode
    // says, unless that is only that it is uncertain.
    let is_unnamed = named.category.is_none();
    let last_episode = &spells[spells.len() - 1].episode;
    let says_more =
        last_episode.category.is_none() && last_episode.reason != Some(Reason::Uncertain);
    let said_by = match lost {
        None => Some(named).filter(|_| is_unnamed),
        Some(_) => Some(last_episode).filter(|_| says_more && ended_at_ns.is_none()),
    };
    let explanation = said_by.and_then(explanation);
    let is_of_line = explanation.as_ref().is_some_and(|words| words.contains(SENSOR_LINE));
    let reason = said_by.and_then(|of| if is_of_line { Some(Reason::NoRing) } else { of.reason });
    Story {
        printhead: first.printhead.clone(),
        channel: first.channel,
        category: named.category.clone(),
        fault: named.fault.clone(),
        reason,
        explanation,
        began_at_ns: first.began_at_ns,
        ended_at_ns,
        ended_with_all: false,
        recordings: recordings.len() as u32,
        cures: inner.iter().filter(|gap| gap.is_one).count() as u32,
        last_began_at_ns,
        severity_first: sized.find_map(|e| e.severity_first),
        severity_last: size_of_now.severity,
        severity_sd: size_of_now.sd,
        trend: trend.map(|trend| trend.of_scale(scale)),
        distance,
        certainty: named.certainty.filter(|_| lost.is_none() && !is_unnamed),
        known_at_ns: last_named.at_ns,
        lost,
        replaced_at_ns: None,
        known: None,
        spells: spells.to_vec(),
        quantity: quantity.map(str::to_owned),
    }
}

/// The distance of the latest signals before `to_ns` that have a ring. `None`: there are none, or more signals without
/// one came after them than there were with one.
fn distance_of_now(course: &Course, to_ns: i64) -> Option<f64> {
    let bins: Vec<&Severities> = course.values().collect();
    let last = bins.iter().rposition(|bin| bin.n > 0.0 && bin.t_ns() < to_ns as f64)?;
    let with_ring: f64 = bins[..=last].iter().map(|bin| bin.n).sum();
    let after: f64 =
        bins[last + 1..].iter().take_while(|bin| bin.n == 0.0).map(|bin| bin.missed).sum();
    (after <= with_ring).then(|| bins[last].mean())
}

/// The last signal that carries the name of the story of these episodes. Where no signal does by itself, and
/// they are named by what they say together, it is the last look of the last episode of that name. `to_ns`: when the
/// story ended.
fn last_named(watch: &Watch, spells: &[Spell], named: &Episode, to_ns: i64) -> LastNamed {
    let calls = named.category.as_deref().and_then(|category| watch.calls(category));
    let from_ns = spells[0].episode.began_at_ns;
    calls.and_then(|calls| calls.last(from_ns, to_ns)).unwrap_or_else(|| {
        let of_name = spells.iter().rfind(|of| of.episode.category == named.category);
        let of_name = of_name.unwrap_or(&spells[spells.len() - 1]);
        LastNamed {
            at_ns: of_name.last_look_ns(),
            is_of_now: spells.last().is_some_and(|last| std::ptr::eq(last, of_name)),
        }
    })
}

/// An episode's explanation without its beginning `channel 7: `; `None` if it is empty.
fn explanation(of: &Episode) -> Option<String> {
    let prefix = format!("channel {}: ", of.channel);
    let words = of.explanation.strip_prefix(&prefix).unwrap_or(&of.explanation);
    (!words.is_empty()).then(|| words.chars().take(MOST_OF_A_SENTENCE).collect())
}

#[cfg(test)]
mod tests {
    use super::super::fixtures::{spell, watch_of};
    use super::super::watch::{Flagged, Size};
    use super::*;

    const RATES: fn() -> Rates = || Rates {
        faulty_channels: 6,
        judged: 700_000,
        false_alarms: 5e-4,
        categories: BTreeMap::from([("dried_nozzle".into(), 20), ("air_bubble".into(), 20)]),
    };

    /// A watch of recordings r of 20 bursts each, at the times 100 r, 100 r + 1, ...; flagged where `on` is
    /// true.
    fn watched(spells: Vec<Spell>, recordings: usize, on: impl Fn(i64) -> bool) -> Watch {
        let times = (0..recordings).flat_map(|r| (0..20).map(move |k| (r, 100 * r as i64 + k)));
        let burst = |(r, t): (usize, i64)| (r, t, on(t).then(Flagged::default));
        watch_of(spells, &times.map(burst).collect::<Vec<_>>())
    }

    #[test]
    fn a_recording_that_begins_healthy_cures_what_was_still_on() {
        let spells = vec![spell(0, 5, None, "dried_nozzle")];
        let all = stories(&watched(spells, 3, |t| (5..100).contains(&t)), &RATES());
        assert_eq!(all[0].ended_at_ns, Some(100));
        // three unflagged bursts of a fault that shows in every other burst cure nothing
        let weak = vec![spell(0, 0, None, "dried_nozzle")];
        let all = stories(&watched(weak, 1, |t| t % 2 == 0), &RATES());
        assert_eq!(all[0].ended_at_ns, None);
    }

    #[test]
    fn a_fault_that_goes_on_in_one_of_three_bursts_is_not_over_where_its_episode_ended() {
        let ended = || vec![spell(0, 5, Some(12), "dried_nozzle")];
        let goes_on = |t: i64| (5..12).contains(&t) || t >= 12 && t % 3 == 0;
        assert_eq!(stories(&watched(ended(), 3, goes_on), &RATES())[0].ended_at_ns, None);
        let once_more = |t: i64| (5..12).contains(&t) || t == 15;
        assert_eq!(stories(&watched(ended(), 3, once_more), &RATES())[0].ended_at_ns, Some(12));
    }

    /// Thresholds tighten while a channel is learned: distances grow, and no ring changes.
    #[test]
    fn a_distance_grows_only_where_the_ring_changes() {
        let day = 86_400_000_000_000;
        let grows = |hz_a_day: f64| {
            let spells = (0..8).map(|r| {
                let mut on = spell(r, r as i64 * day, None, "");
                on.episode.category = None;
                on
            });
            let bursts = (0..8usize).flat_map(|r| {
                (0..20).map(move |k| {
                    let t_ns = r as i64 * day + i64::from(k) * 1_000_000_000;
                    let wobble = f64::from(k % 3);
                    let ring = [50e3 + hz_a_day * r as f64 + wobble, 3e4];
                    let distance = Some(3.0 + r as f64 + 0.01 * wobble);
                    (r, t_ns, Some(Flagged { distance, ring: Some(ring), ..Flagged::default() }))
                })
            });
            let bursts: Vec<_> = bursts.collect();
            stories(&watch_of(spells.collect(), &bursts), &RATES())[0].trend.is_some()
        };
        assert!(!grows(0.0) && grows(-40.0));
    }

    /// The signals of the first five recordings are named and sized, those of the others only grow.
    #[test]
    fn what_signals_carry_no_longer_is_told_as_last_known() {
        let hour = 3_600_000_000_000;
        let spells_of = |ended_at_ns: Option<i64>| -> Vec<Spell> {
            let ended = |r: usize| ended_at_ns.filter(|_| r == 9);
            let on = |r| spell(r, r as i64 * 24 * hour, ended(r), "dried_nozzle");
            (0..10).map(on).collect()
        };
        let mut spells = spells_of(None);
        spells[5..].iter_mut().for_each(|of| of.episode.category = None);
        let now = "half its size; look at cable";
        spells[9].episode.explanation = format!("channel 7: {now}");
        let mut bursts = Vec::new();
        for r in 0..10 {
            for k in 0..20 {
                let is_named = r < 5;
                let size = Size { quantity: "viscosity", size: 1.4 };
                let ring = [50e3 - 100.0 * r as f64 - f64::from(k % 3), 3e4];
                let signal = Flagged {
                    ring: Some(ring),
                    category: is_named.then_some("dried_nozzle"),
                    size: is_named.then_some(size),
                    distance: Some(2.0 + r as f64 + 0.01 * f64::from(k % 3)),
                };
                bursts.push((r, r as i64 * 24 * hour + i64::from(k) * 1_000_000, Some(signal)));
            }
        }
        let all = stories(&watch_of(spells, &bursts), &RATES());
        assert_eq!(all.len(), 1, "it was never gone");
        let s = &all[0];
        // so it is where it is over
        let mut over = spells_of(Some(10 * 24 * hour));
        over[5..].iter_mut().for_each(|of| of.episode.category = None);
        let quiet = (0..20).map(|k| (9, 10 * 24 * hour + i64::from(k), None));
        let bursts: Vec<_> = bursts.into_iter().chain(quiet).collect();
        let past = &stories(&watch_of(over, &bursts), &RATES())[0];
        assert!(past.ended_at_ns.is_some());
        assert_eq!((past.severity_last, past.certainty, past.lost), (None, None, s.lost));
        assert_eq!((s.severity_last, s.certainty), (None, None));
        assert_eq!(s.lost, Some(LastSize { severity: Some(1.4), sd: Some(0.1) }));
        assert_eq!(s.category.as_deref(), Some("dried_nozzle"), "the name it had");
        assert_eq!((s.explanation.as_deref(), s.reason), (Some(now), Some(Reason::NoRing)));
        assert_eq!(s.known_at_ns, 4 * 24 * hour + 19_000_000);
        assert!(s.distance.is_some_and(|d| d > 10.9), "{:?}", s.distance);
        let trend = s.trend.expect("ten nights of distances");
        assert!((trend.per_day - 1.0).abs() < 0.05, "{trend:?}");
    }

    #[test]
    fn another_sort_of_fault_after_a_cure_is_another_story_and_without_a_cure_is_not() {
        let two = |gap_flagged: bool| {
            let spells =
                vec![spell(0, 0, Some(10), "dried_nozzle"), spell(9, 905, None, "air_bubble")];
            stories(&watched(spells, 10, |t| gap_flagged || !(10..905).contains(&t)), &RATES())
        };
        assert_eq!(two(false).len(), 2);
        let spells = vec![spell(0, 0, None, "dried_nozzle"), spell(1, 100, None, "air_bubble")];
        let one = stories(&watched(spells, 2, |_| true), &RATES());
        assert_eq!(one.len(), 1);
        assert_eq!(one[0].category.as_deref(), Some("air_bubble"));
    }

    #[test]
    fn where_faults_are_frequent_and_the_gap_is_long_a_return_is_another_fault() {
        assert!(returns_over_new(60.0, 7e-6) > 100.0);
        assert!(returns_over_new(3e5, 7e-6) < 1.0);
        // the closed form against a Riemann sum of the integral over ln lambda of lambda e^(-lambda n)
        let (n, mu): (f64, f64) = (500.0, 1e-4);
        let steps = 100_000;
        let width = (1.0 / mu).ln() / f64::from(steps);
        let sum: f64 = (0..steps)
            .map(|k| mu * ((f64::from(k) + 0.5) * width).exp())
            .map(|lambda| lambda * (-lambda * n).exp() * width)
            .sum();
        let odds = sum / (1.0 / mu).ln() / (mu * (-mu * n).exp());
        assert!((returns_over_new(n, mu) / odds - 1.0).abs() < 1e-3, "{odds}");
    }
}
