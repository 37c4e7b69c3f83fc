//! Tests of what lies beside a ring, or is done to its samples: zeros that drift, values that are repeated or cut.

use super::critique;
use crate::critique::finding::{Critique, Verdict};
use crate::critique::observations::Sampler;
use crate::critique::outcome::{CritiqueError, Outcome};
use inkling_core::burst::Beside;
use nalgebra::{DMatrix, DVector};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};
use std::f64::consts::TAU;

const DT_S: f64 = 0.01;
const HERTZ: f64 = 1.3;
const PER_S: f64 = 0.15;

fn of(y: &[f64]) -> Result<Outcome, CritiqueError> {
    let mut sampler = Sampler::new(DT_S, 1);
    sampler.offer("decay", Beside::alone(0, 0), y);
    critique(&sampler.finish())
}

fn said(y: &[f64]) -> Critique {
    of(y).unwrap().critique
}

/// 15 s of what is shown at a time, with noise.
fn samples(seed: u64, shown: impl Fn(f64) -> f64) -> Vec<f64> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let noise = Normal::new(0.0, 0.003).unwrap();
    (0..1500).map(|k| shown(f64::from(k) * DT_S) + noise.sample(&mut rng)).collect()
}

fn ring(t: f64) -> f64 {
    (-PER_S * t).exp() * (TAU * HERTZ * t).cos()
}

/// Share of the movement, in percent, that is left beside these modes and whatever is as slow as a cubic.
fn left_by_modes(y: &[f64], c: &Critique) -> f64 {
    let modes = &c.plant.as_ref().unwrap().modes;
    let time = |k: usize| k as f64 * DT_S;
    let column = |k: usize, j: usize| match j.checked_sub(4) {
        None => (time(k) / 15.0).powi(j as i32),
        Some(j) => {
            let turn = TAU * modes[j / 2].frequency_hz * time(k);
            let shape = if j % 2 == 0 { turn.cos() } else { turn.sin() };
            (-modes[j / 2].damping_per_s * time(k)).exp() * shape
        }
    };
    let columns = DMatrix::from_fn(y.len(), 4 + 2 * modes.len(), column);
    let all = DVector::from_column_slice(y);
    let fitted = columns.clone().svd(true, true).solve(&all, 1e-12).unwrap();
    100.0 * (&all - columns * fitted).norm() / all.add_scalar(-all.mean()).norm()
}

/// The share that the page tells for what it prints.
fn told(c: &Critique) -> f64 {
    let alone = |said: &String| {
        let (_, share) = said.split_once("alone, they miss ")?;
        share.split_once(' ')?.0.parse().ok()
    };
    let after = c.gain.after.nrmse_percent;
    c.remarks.iter().find_map(alone).unwrap_or(after)
}

/// What is added to a decay, by the time.
type Slow = fn(f64) -> f64;

#[test]
fn beside_a_zero_that_drifts_the_ring_has_its_own_frequency() {
    let slow: [(f64, Slow); 5] = [
        (0.0, |t| 0.002 * t),
        (0.0, |t| -0.02 * t),
        (0.3, |t| 0.3 * (-t / 8.0).exp()),
        (0.05, |t| 0.05 * (-t / 5.0).exp()),
        (2.0, |t| 2.0 - 0.1 * t),
    ];
    for (seed, (first, shown)) in (1..).zip(slow) {
        let y = samples(seed, |t| ring(t) + shown(t));
        let c = said(&y);
        assert_eq!((c.verdict, c.causes.len()), (Verdict::Unknown, 0), "{seed}: {}", c.sentence);
        assert!(c.sentence.contains("at rest drifts, from"), "{seed}: {}", c.sentence);
        let from = c.sentence.split_once("drifts, from ").unwrap().1;
        let from: f64 = from.split_once(' ').unwrap().0.parse().unwrap();
        assert!((from - first).abs() < 0.01, "{seed}: {}", c.sentence);
        let mode = &c.plant.as_ref().unwrap().modes[0];
        let near = (mode.frequency_hz - HERTZ).abs() < 3e-4;
        assert!(near && (mode.damping_per_s - PER_S).abs() < 1e-3, "{seed}: {mode:?}");
    }
}

/// Also where something without a name is in the model, which bends the ring or what is seen of it.
#[test]
fn the_modes_that_are_told_leave_what_is_told() {
    let shown: [fn(f64) -> f64; 5] = [
        ring,
        |t| ring(t) + 0.003 * t,
        |t| ring(t) + 0.05 * ring(t).powi(2),
        |t| ring(t) - 0.1 * ring(t).powi(3),
        |t| ring(t) + 0.2 * (-0.3 * t).exp() * (TAU * 3.7 * t).sin(),
    ];
    for (seed, shown) in (11..).zip(shown) {
        let y = samples(seed, shown);
        let c = said(&y);
        let (left, told) = (left_by_modes(&y, &c), told(&c));
        assert!(left < 1.2 * told, "{seed}: {left} of {told}: {}, {:?}", c.sentence, c.remarks);
    }
}

#[test]
fn samples_that_are_repeated_interpolated_or_cut_on_one_side_give_no_names() {
    let measured = samples(21, ring);
    let held: Vec<f64> = (0..1500).map(|k| measured[k / 10 * 10]).collect();
    let between = |k: usize| {
        let (from, share) = (k / 10, (k % 10) as f64 / 10.0);
        measured[10 * from] * (1.0 - share) + measured[(10 * from + 10).min(1499)] * share
    };
    let interpolated: Vec<f64> = (0..1490).map(between).collect();
    let cut: Vec<f64> = measured.iter().map(|y| y.max(-0.9)).collect();
    for (y, words) in [
        (held, "each value stands 10 times in a row"),
        (interpolated, "between every 10 samples"),
        (cut, "clipping"),
    ] {
        let c = said(&y);
        assert_eq!((c.verdict, c.causes.len()), (Verdict::Unknown, 0), "{words}: {}", c.sentence);
        assert!(c.sentence.contains(words), "{words}: {}", c.sentence);
    }
}

#[test]
fn what_creeps_does_not_ring() {
    for rate in [0.15, 0.5] {
        let y = samples(31, |t| (-rate * t).exp());
        assert!(matches!(of(&y), Err(CritiqueError::NoRing)), "{rate}");
    }
}
