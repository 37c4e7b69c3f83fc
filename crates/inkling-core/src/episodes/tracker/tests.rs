//! Tests of the tracker on whole recordings of few channels: what becomes an episode, with which
//! onset, end and name; that neither order nor repeats nor the way of updating (eight channels at
//! once, or one by one) matter; and that memory stays within its limits.

use super::*;
use crate::episodes::{Counts, IsolatedSignal, Rings};
use rand::{RngExt, SeedableRng};

fn tracker(reorder_signals: usize) -> Tracker {
    let classes = ["BN", "PBN", "SDN"].map(Class::plain);
    let settings = EpisodeSettings { reorder_signals, ..EpisodeSettings::default() };
    Tracker::new(&classes, &[0.28; 3], 0.8, &settings)
}

/// Bursts of four channels, one per second; channel 7 is partly blocked from 50 to 80 s.
fn bursts() -> Vec<Looks> {
    let burst = |step: i64| {
        let faulty = (50..80).contains(&step);
        let wiggle = |row: i64| 0.15 + 0.02 * ((step * 7 + row * 3) % 5) as f32;
        let mut ratios: Vec<f32> = (0..4).map(wiggle).collect();
        let mut named = Vec::new();
        if faulty {
            ratios[2] = 10.0;
            named.push(IsolatedSignal {
                row: 2,
                weights: vec![0.3, 0.69, 0.01],
                candidate: Some(1),
                severity: Some(0.2 + 0.001 * (step - 50) as f32),
                severity_sd: Some(0.01),
                rings: Some(Rings {
                    frequency_hz: 0.95 * 64.7e3,
                    damping_per_s: 1.3 * 2.9e4,
                    healthy_frequency_hz: 64.7e3,
                    healthy_damping_per_s: 2.9e4,
                }),
                ..IsolatedSignal::default()
            });
        }
        Looks { t_ns: step * 1_000_000_000, first_channel: 5, ratios, named, ..Looks::default() }
    };
    (0..140).map(burst).collect()
}

fn run(mut tracker: Tracker, bursts: impl IntoIterator<Item = Looks>) -> (Vec<Episode>, Counts) {
    let name: Arc<str> = "p".into();
    bursts.into_iter().for_each(|looks| tracker.push(&name, looks));
    let mut episodes = tracker.take_ended();
    let over = tracker.finish();
    episodes.extend(over.last);
    (episodes, over.counts)
}

/// The one episode that these bursts give.
fn only(bursts: impl IntoIterator<Item = Looks>) -> Episode {
    let (mut episodes, _) = run(tracker(8), bursts);
    assert_eq!(episodes.len(), 1, "{episodes:?}");
    episodes.remove(0)
}

/// The first bursts, whose named signals have the weights that belong to the second.
fn with_weights(n: usize, weights: fn(i64) -> [f32; 3]) -> impl Iterator<Item = Looks> {
    bursts().into_iter().take(n).map(move |mut looks| {
        for named in &mut looks.named {
            named.weights = weights(looks.t_ns / 1_000_000_000).to_vec();
        }
        looks
    })
}

#[test]
fn fault_is_one_episode_with_onset_end_class_and_sentence() {
    let (e, counts) = (only(bursts()), run(tracker(8), bursts()).1);
    assert_eq!((counts.episodes, counts.still_on), (1, 0));
    assert_eq!((e.channel, e.began_at_ns / 1_000_000_000), (7, 50));
    assert!((51..54).contains(&(e.raised_at_ns / 1_000_000_000)), "{e:?}");
    assert_eq!(e.ended_at_ns.map(|t| t / 1_000_000_000), Some(80));
    assert_eq!(e.bursts, 30);
    assert_eq!(e.fault.as_deref(), Some("PBN"));
    let sizes = [e.severity_first, e.severity_max, e.severity_last].map(|s| s.unwrap() as f32);
    assert_eq!(sizes, [0.2, 0.229, 0.229]);
    assert!(
        e.explanation.starts_with("channel 7: resonance 64.7 → 61.5 kHz, damping +30 %: partly")
    );
}

#[test]
fn another_statistic_that_reads_higher_is_no_fault() {
    // from 20 s on their own baselines judge
    let mut bursts: Vec<Looks> = bursts().into_iter().take(50).collect();
    for (step, burst) in bursts.iter_mut().enumerate() {
        match step {
            0..20 => burst.ratios.iter_mut().for_each(|r| *r *= 0.1),
            _ => burst.own = vec![true; 4],
        }
    }
    assert_eq!(run(tracker(8), bursts).1.episodes, 0);
}

#[test]
fn order_within_the_window_and_repeats_do_not_matter() {
    let sorted = run(tracker(1000), bursts());
    let mut shuffled = bursts();
    for chunk in shuffled.chunks_mut(9) {
        chunk.reverse();
    }
    assert_eq!(run(tracker(1000), shuffled), sorted);
    let twice = bursts().into_iter().flat_map(|b| [b.clone(), b]);
    let (episodes, counts) = run(tracker(1000), twice);
    assert_eq!((episodes, counts.signals_repeated), (sorted.0.clone(), 4 * 140));
    // the same bursts, one channel per burst
    assert_eq!(run(tracker(1000), bursts().iter().flat_map(apart)), sorted);
}

#[test]
fn what_comes_too_late_is_counted_and_changes_nothing() {
    let sorted = run(tracker(8), bursts());
    let mut late = bursts();
    let first = late.remove(3);
    late.push(first);
    let (episodes, counts) = run(tracker(8), late);
    assert_eq!(episodes, sorted.0);
    assert_eq!(counts.signals_too_late, 4);
}

/// A recording in which everything happens: channels come and go, models and baselines change,
/// bursts come twice or late, signals are rejected, some are faulty for a while.
fn eventful(seed: u64) -> Vec<Looks> {
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
    let mut bursts: Vec<Looks> = Vec::new();
    for step in 0..300i64 {
        let first_channel = if rng.random_bool(0.1) { 3 } else { 0 };
        let healthy = |rng: &mut rand_chacha::ChaCha8Rng| rng.random::<f32>().powi(4) * 1.05;
        let mut ratios: Vec<f32> = (0..37).map(|_| healthy(&mut rng)).collect();
        let mut named = Vec::new();
        for (row, ratio) in ratios.iter_mut().enumerate() {
            let (row, channel) = (row as u32, first_channel + row as u32);
            let from = i64::from(channel) * 13 % 240;
            if channel.is_multiple_of(5) && (from..from + 40).contains(&step) {
                *ratio = rng.random_range(2.0..9.0);
            }
            if rng.random_bool(0.01) {
                *ratio = f32::NAN;
            } else if *ratio > 1.0 {
                named.push(IsolatedSignal {
                    row,
                    weights: vec![0.2, 0.7, 0.1],
                    ..IsolatedSignal::default()
                });
            }
        }
        let own =
            (0..37).map(|row| row % 3 == 0 && step > 150 || (60..120).contains(&step)).collect();
        let model = (step / 90) as u16;
        let in_medians = [7.0, 56.0, 3.5, 28.0][usize::from(model)];
        let t_ns = step * 1_000_000_000;
        bursts.push(Looks { t_ns, first_channel, model, in_medians, ratios, own, named });
        if rng.random_bool(0.05) {
            let before = rng.random_range(0..bursts.len());
            bursts.push(bursts[before].clone());
        }
    }
    bursts
}

/// A burst taken apart into one burst for each of its channels.
fn apart(looks: &Looks) -> Vec<Looks> {
    let own = |row| looks.own.get(row).copied().into_iter().collect();
    let of_row = |row: usize| Looks {
        first_channel: looks.first_channel + row as u32,
        ratios: vec![looks.ratios[row]],
        own: own(row),
        named: (looks.named.iter().filter(|n| n.row == row as u32))
            .map(|n| IsolatedSignal { row: 0, ..n.clone() })
            .collect(),
        ..looks.clone()
    };
    (0..looks.ratios.len()).map(of_row).collect()
}

#[test]
fn channels_that_are_looked_at_together_are_judged_as_if_each_came_alone() {
    let sorted = |(mut episodes, counts): (Vec<Episode>, Counts)| {
        episodes.sort_by_key(|e| (e.channel, e.began_at_ns));
        (episodes, counts)
    };
    for seed in 0..8 {
        // no burst waits, so that what comes late is too late
        let together = sorted(run(tracker(0), eventful(seed)));
        let alone = sorted(run(tracker(0), eventful(seed).iter().flat_map(apart)));
        assert_eq!(together, alone, "seed {seed}");
        let (episodes, counts) = together;
        assert!(episodes.len() >= 7, "{}", episodes.len());
        assert!(counts.signals_repeated + counts.signals_too_late > 100, "{counts:?}");
    }
}

#[test]
fn another_threshold_changes_neither_onset_nor_the_look_that_raises() {
    let one = run(tracker(8), bursts());
    let other = bursts().into_iter().enumerate().map(|(step, mut looks)| {
        let model = u16::from(step >= 30);
        if model == 1 {
            looks.ratios.iter_mut().for_each(|r| *r /= 8.0);
        }
        Looks { model, in_medians: 7.5 * f32::from(1 + 7 * model), ..looks }
    });
    let other = run(tracker(8), other);
    let times = |(episodes, _): &(Vec<Episode>, Counts)| {
        episodes.iter().map(|e| (e.began_at_ns, e.raised_at_ns)).collect::<Vec<_>>()
    };
    assert_eq!((times(&one).len(), times(&one)), (1, times(&other)));
}

#[test]
fn of_a_category_whose_classes_cannot_be_told_apart_the_category_is_named() {
    let naming = tracker(8).rules.naming;
    assert_eq!(naming.categories, ["blocked_nozzle", "dried_nozzle"]);
    let named = naming.name(&[0.5, 0.375, 0.125], 1.0).unwrap();
    assert_eq!((named.fault, named.category, named.certainty), (None, Some(0), 0.875));
    let e = only(with_weights(140, |_| [0.5, 0.49, 0.01]));
    assert_eq!((e.category.as_deref(), &e.fault), (Some("blocked_nozzle"), &None));
    assert!(e.certainty.is_some_and(|c| c > 0.98), "{e:?}");
}

#[test]
fn what_waits_is_what_is_held_and_no_more_than_it_may_be() {
    let mut tracker = tracker(8);
    let names: [Arc<str>; 2] = ["p".into(), "q".into()];
    for (looks, name) in bursts().into_iter().zip(names.iter().cycle()) {
        tracker.push(name, looks);
        let held: Vec<usize> = tracker.printheads.values().map(|of| of.waiting.signals).collect();
        assert_eq!(tracker.waiting, held.iter().sum::<usize>());
        assert!(held.iter().all(|&held| held <= 8), "{held:?}");
    }
    assert_eq!(tracker.waiting, 16);
}

/// A printhead of one channel that is flagged at one look in ten, after some healthy ones.
#[test]
fn a_fault_that_comes_and_goes_is_found_as_soon_after_any_healthy_past() {
    let second = 1_000_000_000;
    for past in [20, 20_000] {
        let burst = |step: i64| {
            let is_on = step >= past && (step - past) % 10 == 0;
            let ratio = if is_on { 3.0 } else { 0.1 + 0.02 * (step * 7 % 11) as f32 };
            let named =
                IsolatedSignal { weights: vec![0.2, 0.7, 0.1], ..IsolatedSignal::default() };
            Looks {
                t_ns: step * second,
                first_channel: 5,
                ratios: vec![ratio],
                named: if is_on { vec![named] } else { Vec::new() },
                ..Looks::default()
            }
        };
        let e = only((0..past + 300).map(burst));
        assert_eq!(e.began_at_ns, past * second, "after {past}");
        let looks = (e.raised_at_ns - e.began_at_ns) / second;
        assert!((40..100).contains(&looks), "after {past}: {looks}");
        assert!(e.explanation.contains("comes and goes"), "{}", e.explanation);
        assert_eq!(e.ended_at_ns, None);
    }
}

#[test]
fn printheads_beyond_the_limit_are_counted() {
    let mut tracker = tracker(8);
    for p in 0..=MOST_PRINTHEADS {
        let (ratios, t_ns) = (vec![0.1; 3], 0);
        tracker.push(&p.to_string().into(), Looks { ratios, t_ns, ..Looks::default() });
    }
    assert_eq!(tracker.finish().counts.signals_beyond_limit, 3);
}

#[test]
fn at_once_an_episode_is_told_with_the_burst_that_raises_it() {
    let mut tracker = tracker(1000).at_once();
    let name: Arc<str> = "p".into();
    let mut raised = Vec::new();
    for looks in bursts() {
        let t_ns = looks.t_ns;
        tracker.push(&name, looks);
        for episode in tracker.take_raised() {
            let name = |of: &Episode| (of.category.clone(), of.fault.clone());
            match raised.last() {
                None => assert_eq!(episode.raised_at_ns, t_ns),
                Some(before) => assert_ne!(name(before), name(&episode), "named meanwhile"),
            }
            raised.push(episode);
        }
    }
    let (told, whole) = (&raised[0], &run(self::tracker(1000), bursts()).0[0]);
    assert_eq!(raised.last().unwrap().fault, whole.fault, "what it is called at last is told");
    assert_eq!((told.channel, told.raised_at_ns), (whole.channel, whole.raised_at_ns));
    assert_eq!(told.began_at_ns, whole.began_at_ns);
    assert_eq!(told.fault, None, "by then it is not certain, at the end it is");
    assert_eq!(told.ended_at_ns, None);
    assert!(told.bursts < whole.bursts);
}

#[test]
fn an_episode_that_only_loses_its_class_is_not_told_again() {
    let mut tracker = tracker(1000).at_once();
    let name: Arc<str> = "p".into();
    let weights = |second: i64| match second {
        ..58 => [0.02, 0.96, 0.01],
        58..63 => [0.8, 0.19, 0.01],
        _ => [0.5, 0.49, 0.01],
    };
    with_weights(80, weights).for_each(|looks| tracker.push(&name, looks));
    let told = tracker.take_raised();
    let last = tracker.finish().last.remove(0);
    assert_eq!((last.category.as_deref(), last.fault), (Some("blocked_nozzle"), None));
    assert_eq!(told.last().unwrap().fault.as_deref(), Some("PBN"), "{told:?}");
}

#[test]
fn still_on_has_no_end_and_rejected_signals_are_no_looks() {
    let mut cut: Vec<Looks> = bursts().into_iter().take(70).collect();
    for looks in &mut cut[55..60] {
        looks.ratios.fill(f32::NAN);
        looks.named.clear();
    }
    let (episodes, counts) = run(tracker(8), cut);
    assert_eq!((episodes.len(), counts.still_on), (1, 1));
    assert_eq!((episodes[0].ended_at_ns, episodes[0].bursts), (None, 15));
}

#[test]
fn without_classes_episodes_are_found_and_not_named() {
    let tracker = Tracker::new(&[], &[], 0.8, &EpisodeSettings::default());
    let unnamed = bursts().into_iter().map(|b| Looks { named: Vec::new(), ..b });
    let (episodes, _) = run(tracker, unnamed);
    assert_eq!(episodes.len(), 1);
    let e = &episodes[0];
    assert_eq!((&e.fault, &e.category, e.certainty), (&None, &None, None));
    assert_eq!(e.explanation, "channel 7: rings unlike a healthy channel: not named");
}
