//! Tests of slow faults: channels that walk or age from night to night, and faults among them.
//! Healthy channels that walk must seldom be taken for faulty; a fault that grows faster than its
//! head ages must be found.

use super::tests::{DAY, NOISE, SPREAD, World, none, normal};
use super::*;
use nalgebra::Vector4;

/// Plays a night of twenty sweeps, in which each channel lies a little elsewhere, and returns the channels
/// that are taken for faulty at its end. `fault`: what channels have besides, features by channel.
fn night(world: &mut World, fault: impl Fn(usize) -> Features) -> Vec<u32> {
    world.t_ns = (world.t_ns / DAY + 1) * DAY;
    let of_night: Vec<Features> =
        world.own.iter().map(|_| normal(&mut world.rng, NOISE) * 0.3).collect();
    (0..20).for_each(|_| {
        world.sweep(Vector4::zeros(), |k| of_night[k] + fault(k));
    });
    world.faulty()
}

/// The channels walk by a tenth, or a third, of what channels differ by in a month.
#[test]
fn healthy_channels_that_walk_slowly_are_seldom_taken_for_faulty() {
    for (channels, heads) in [(12, 20), (60, 4)] {
        for pace in [0.1, 0.3] {
            let mut flagged = 0;
            for seed in 0..heads {
                let mut world = World::new(61 + seed, channels);
                for _ in 0..60 {
                    for k in 0..channels {
                        world.own[k] += normal(&mut world.rng, SPREAD) * (pace / 30f64.sqrt());
                    }
                    flagged += night(&mut world, none).len();
                }
            }
            let rate = flagged as f64 / (60 * channels * heads as usize) as f64;
            assert!(rate < 1.4e-3, "{channels} {pace}: {rate}");
        }
    }
}

/// The fault grows nine times as fast as the others' damping ages, for forty nights. In a head that
/// does not age such a fault is found in the fifth to the seventh night.
#[test]
fn a_fault_that_grows_while_its_head_ages_is_found_and_stays_so() {
    let (mut first, mut of_last) = (Vec::new(), 0);
    for seed in 0..8 {
        let mut world = World::new(71 + seed, 30);
        let ways = (0..30).map(|_| normal(&mut world.rng, SPREAD)).collect::<Vec<Features>>();
        let mut flagged = Vec::new();
        for n in 0..50 {
            (0..30).for_each(|k| world.own[k] += ways[k] * (1.0 / 30.0));
            let size = 0.5 * f64::from(n - 10i32).max(0.0);
            let fault = Vector4::new(0.0, size * NOISE[1], 0.0, 0.0);
            let of = night(&mut world, |k| fault * f64::from(u8::from(k == 7)));
            flagged.push(of.contains(&7));
        }
        first.push(flagged.iter().position(|is| *is).map_or(40, |n| n - 10));
        of_last += flagged[30..].iter().filter(|is| **is).count();
    }
    assert!(first.iter().all(|n| *n <= 25), "found after {first:?} nights");
    assert!(of_last >= 120, "found in {of_last} of the last 160");
}

/// A recording may hold few of the channels that are remembered, and one of these be faulty from
/// the middle of it on.
#[test]
fn a_fault_stays_one_where_few_of_the_channels_are_heard() {
    for heard in [5, 12, 20, 40] {
        let mut others = 0;
        for seed in 0..8 {
            let mut world = World::new(81 + seed, 60);
            (0..10).for_each(|_| {
                night(&mut world, none);
            });
            world.own.truncate(heard);
            night(&mut world, none);
            world.run(300);
            let fault = Vector4::new(0.0, 12.0 * NOISE[1], 0.0, 0.0);
            for _ in 0..200 {
                world.sweep(Vector4::zeros(), |k| fault * f64::from(u8::from(k == 4)));
            }
            let found = world.faulty();
            assert!(found.contains(&4), "{heard} channels, seed {seed}: {found:?}");
            others += found.len() - 1;
        }
        assert_eq!(others, 0, "{heard} channels");
    }
}

/// A fault of more than half of a head is a fault, and not ageing: further channels that get it are faulty, too,
/// and not replaced, and all are healthy once it is cured.
#[test]
fn a_fault_of_most_channels_hides_none_of_the_others() {
    let dried = Vector4::new(0.0, 0.6, -0.005, 0.0);
    for (seed, first) in [(91, 10), (92, 16), (93, 18), (94, 20), (95, 20)] {
        let mut world = World::new(seed, 32);
        night(&mut world, none);
        let of = |n: usize| move |k: usize| dried * f64::from(u8::from(k < n));
        let then = night(&mut world, of(first));
        assert_eq!(then, (0..first as u32).collect::<Vec<_>>());
        let then = night(&mut world, of(first + 5));
        assert_eq!(then, (0..first as u32 + 5).collect::<Vec<_>>());
        assert!(world.head.wider() < 2.0, "{}", world.head.wider());
        let other = |k: usize| match k {
            25 => Vector4::new(-1.2, 0.0, 0.0, 0.0),
            26 => Vector4::new(0.1, -0.6, 0.11, 0.0),
            27 => Vector4::new(0.0, 1.1, -0.02, 0.0),
            28 => Vector4::new(0.0, 0.0, 0.02, 0.0),
            _ => of(first + 5)(k),
        };
        let then = night(&mut world, other);
        let faulty = (0..first as u32 + 5).chain(25..29).collect::<std::collections::BTreeSet<_>>();
        assert_eq!(then, faulty.into_iter().collect::<Vec<_>>());
        assert!(world.head.wider() < 2.0, "{}", world.head.wider());
        assert_eq!(night(&mut world, none), [0u32; 0], "{first} of 32");
    }
}
