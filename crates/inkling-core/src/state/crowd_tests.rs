//! Tests of a head's level where many channels are faulty at once, or channels agree on nothing, or
//! all have moved apart: which of them move the level, and which leave it unknown.

use super::tests::{DAY, NOISE, SECOND, SPREAD, World, looks, none, normal};
use super::*;
use nalgebra::Vector4;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// How far a level lies off, in standard deviations of healthy looks, in the feature in which that
/// is most.
fn in_sds(off: Features) -> f64 {
    (0..4).map(|k| off[k].abs() / NOISE[k].hypot(SPREAD[k])).fold(0.0, f64::max)
}

#[test]
fn faults_that_come_and_go_move_no_level() {
    let gross = Vector4::new(0.2, 0.4, -0.03, 0.0);
    let slight = Vector4::new(-0.06, 0.06, 0.0, 0.0);
    for fault in [gross, slight] {
        for (share, lasting) in [(0.1, 0.0), (0.3, 0.0), (0.38, 0.0), (0.1, 1.0), (0.38, 1.0)] {
            let mut world = World::lasting(42, 48, lasting);
            let (mut most, mut unknown) = (0.0f64, 0);
            for _ in 0..200 {
                match world.sweep_some(48, share, fault) {
                    SweepOutcome::Level { level, .. } => {
                        most = most.max(in_sds(level - world.middle()))
                    }
                    SweepOutcome::Unknown => unknown += 1,
                    strange => panic!("{strange:?}"),
                }
            }
            assert!(most < 1.0, "{fault} {share} {lasting}: {most}");
            assert!(unknown < 100, "{fault} {share} {lasting}: {unknown}");
        }
    }
}

#[test]
fn two_clusters_have_no_level_between_them() {
    // five healthy standard deviations
    let fault = Vector4::new(-0.045, 0.042, 0.0, 0.0);
    for seed in 0..10 {
        let mut world = World::lasting(seed, 48, 0.0);
        world.run(3);
        let before = world.head.level();
        for _ in 0..10 {
            world.sweep_some(48, 0.5, fault);
            // which half is healthy nobody can tell; between them it would be 1.8 off
            let at = world.head.level() - before;
            let off = in_sds(at).min(in_sds(at - fault));
            assert!(off < 1.5, "{seed}: {off}");
        }
    }
}

#[test]
fn a_leap_is_followed_where_two_in_five_are_faulty() {
    let fault = Vector4::new(0.2, 0.4, -0.03, 0.0);
    let step = Vector4::new(0.0, 0.1, 0.0, 0.0);
    for lasting in [0.0, 1.0] {
        let mut world = World::lasting(44, 40, lasting);
        let faulty = |k: usize| if k < 16 { fault } else { none(k) };
        (0..40).for_each(|_| {
            world.sweep(Vector4::zeros(), faulty);
        });
        let before = world.head.level();
        let found = world.sweep(step, faulty);
        let SweepOutcome::Level { level, .. } = found else { panic!("{lasting}: {found:?}") };
        assert!(in_sds(level - before - step) < 0.8, "{lasting}: {}", level - before);
    }
}

#[test]
fn channels_that_share_nothing_have_no_level() {
    let mut rng = ChaCha8Rng::seed_from_u64(45);
    let mut world = World::new(46, 30);
    for _ in 0..50 {
        let any: Vec<Features> =
            (0..30).map(|_| Vector4::from_fn(|_, _| rng.random_range(-1.0..1.0))).collect();
        let found = world.sweep(Vector4::zeros(), |k| any[k]);
        assert_eq!(found, SweepOutcome::Unknown);
    }
    assert!(in_sds(world.head.level()) < 1.0);
}

#[test]
fn a_few_rings_among_signals_that_are_none_move_no_level() {
    let mut world = World::new(47, 40);
    world.run(20);
    let before = world.head.level();
    let mut rng = ChaCha8Rng::seed_from_u64(48);
    for t in 0..20 {
        let rings = (0..6).map(|_| normal(&mut rng, NOISE) + Vector4::new(0.1, 0.2, 0.0, 0.0));
        let found = world.head.sweep(world.t_ns + (t + 1) * SECOND, &looks(rings), 34);
        assert_eq!(found, SweepOutcome::Unknown);
    }
    assert!(in_sds(world.head.level() - before) < 0.5);
}

/// The noise of features is that of the samples over the amplitude: at .15 of the drive looks
/// scatter 6.7 times as far, and agree.
#[test]
fn a_head_whose_rings_are_small_is_told() {
    let size = 0.15f64;
    let mut world = World::new(49, 30);
    world.run(30);
    let mut rng = ChaCha8Rng::seed_from_u64(50);
    for t in 0..30 {
        let smaller = Vector4::new(size.ln(), 0.0, 0.0, 0.0);
        let rings = world.own.iter().map(|own| own + normal(&mut rng, NOISE) / size + smaller);
        let found = world.head.sweep(world.t_ns + (t + 1) * SECOND, &looks(rings), 0);
        assert!(matches!(found, SweepOutcome::Strange { .. }), "{size}: {found:?}");
    }
}

/// Over a pause each channel moves by five times what channels differ by, and all by .15 in
/// amplitude.
#[test]
fn channels_that_moved_apart_in_a_pause_have_a_level_again() {
    let (mut off, mut faulty) = (0.0f64, 0);
    for seed in 0..10 {
        let mut world = World::new(seed, 48);
        world.run(40);
        let before = world.head.level();
        for k in 0..48 {
            world.own[k] += normal(&mut world.rng, SPREAD) * 5.0;
        }
        world.t_ns += 300 * DAY;
        let step = Vector4::new(-0.15, 0.0, 0.0, 0.0);
        (0..20).for_each(|_| {
            world.sweep(step, none);
        });
        off = off.max(in_sds(world.head.level() - before - step));
        faulty += world.faulty().len();
    }
    // the middle of so few that moved so far
    assert!(off < 3.0, "{off}");
    assert!(faulty <= 24, "{faulty} of 480");
}

/// Channels that age each their own way are healthy, and those that all do the same are not,
/// however many they are.
#[test]
fn what_most_channels_do_alike_is_no_ageing() {
    // of sixteen nights, the channels that are faulty after the last
    let faulty_after = |moved: &dyn Fn(f64, f64) -> f64| {
        let mut world = World::new(51, 60);
        let draws: Vec<f64> = (0..60).map(|_| normal(&mut world.rng, [1.0; 4])[0]).collect();
        for night in 0..16 {
            world.t_ns += DAY;
            for sweep in 0..60 {
                let nights = f64::from(night) + f64::from(sweep) / 60.0;
                world.sweep(Vector4::zeros(), |k| Vector4::from(SPREAD) * moved(nights, draws[k]));
            }
        }
        world.faulty().len()
    };
    let ageing = faulty_after(&|nights, draw| 0.5 * nights * draw);
    let alike = faulty_after(&|nights, draw| if nights > 12.5 && draw > -0.25 { 4.0 } else { 0.0 });
    assert!(ageing <= 6, "faulty of 60 by ageing: {ageing}");
    assert!((30..=42).contains(&alike), "faulty of 60 by one fault of three in five: {alike}");
}
