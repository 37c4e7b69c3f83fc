//! Healthy printheads of other makes: of low and of high quality, whose ring has a slow part of some per cent, and whose
//! signals scatter from burst to burst, in counts and in volts. The critique finds nothing in them, and what is put into
//! them by its name. The rings are written down; nothing is integrated, and nothing of the library's is used.

use inkling::burst::Beside;
use inkling::critique::engine::{Rings, critique};
use inkling::critique::finding::{Critique, Verdict};
use inkling::critique::observations::{Observations, Sampler};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::TAU;
use std::sync::OnceLock;

/// What is put in, counts.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Put {
    Nothing,
    Offset(f64),
    Hum(f64),
}

const SAMPLES: usize = 144;
const PERIOD_S: f64 = 0.9e-6;

/// `volts`: of a count; 1: counts.
fn recording(seed: u64, put: Put, volts: f64) -> Observations {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let normal = |rng: &mut ChaCha8Rng| -> f64 { StandardNormal.sample(rng) };
    let n = SAMPLES as f64;
    let quality = 5.0 * 8f64.powf(rng.random::<f64>());
    let falls = rng.random_range(1.0..6.0);
    let turns = quality * falls / std::f64::consts::PI;
    // fewer than four samples a turn are not recorded
    let turns: f64 = turns.min(n / 4.5);
    let (loss, pole) = (std::f64::consts::PI * turns / quality, rng.random_range(0.8..1.8));
    let slow = rng.random_range(0.03..0.08) * if rng.random::<bool>() { 1.0 } else { -1.0 };
    let (size, noise) = (100.0 * 12f64.powf(rng.random::<f64>()), rng.random_range(1.0..3.5));
    let scatter: [f64; 4] = std::array::from_fn(|_| rng.random_range(0.002..0.012));
    let phase = TAU * rng.random::<f64>();
    let (channels, bursts) = (rng.random_range(10..24), rng.random_range(10..24));
    let lasting: Vec<[f64; 4]> =
        (0..channels).map(|_| scatter.map(|sd| sd * normal(&mut rng))).collect();
    let mut sampler = Sampler::new(PERIOD_S, usize::MAX);
    for burst in 0..bursts {
        let drive: f64 = rng.random_range(18.0..26.0);
        for (channel, own) in lasting.iter().enumerate() {
            let now: Vec<f64> =
                own.iter().zip(&scatter).map(|(own, sd)| own + sd * normal(&mut rng)).collect();
            let (sigma, omega) = (loss * now[0].exp(), TAU * turns * now[1].exp());
            let amplitude = size * drive / 22.0 * now[2].exp();
            let y = (0..SAMPLES).map(|k| {
                let t = k as f64 / n;
                let ring = (-sigma * t).exp() * (omega * t + phase + now[3]).cos();
                let added = match put {
                    Put::Nothing => 0.0,
                    Put::Offset(counts) => counts,
                    Put::Hum(counts) => counts * (TAU * 0.61 * turns * t + 0.4).cos(),
                };
                let part = slow * (-pole * sigma * t).exp();
                (amplitude * (ring + part) + added + noise * normal(&mut rng)).round() * volts
            });
            let y: Vec<f64> = y.collect();
            let beside = Beside {
                drive_v: drive,
                temperature_c: 31.0,
                ..Beside::alone(channel as u32, i64::from(burst) * 40_000_000)
            };
            sampler.offer("other", beside, &y);
        }
    }
    sampler.finish()
}

fn said(seed: u64, put: Put, volts: f64) -> Critique {
    let data = recording(seed, put, volts);
    critique(&data, Rings::InkChannel, false).unwrap().critique
}

/// In counts, each once for all tests.
fn in_counts(seed: u64, put: Put) -> &'static Critique {
    static SAID: [OnceLock<Critique>; 103] = [const { OnceLock::new() }; 103];
    SAID[seed as usize - 70_000].get_or_init(|| said(seed, put, 1.0))
}

/// What is put in, of what seed, and its name.
const PUT_IN: [(u64, Put, &str); 2] =
    [(70_101, Put::Offset(2.0), "offset"), (70_102, Put::Hum(2.5), "tone")];

fn names(critique: &Critique) -> Vec<&str> {
    critique.causes.iter().map(|cause| cause.id.name()).collect()
}

#[test]
fn nothing_is_found_in_healthy_heads_with_a_slow_part() {
    let of = |seed| (seed, in_counts(seed, Put::Nothing));
    let found: Vec<_> =
        (70_000..70_016).map(of).filter(|(_, c)| c.verdict != Verdict::None).collect();
    let words: Vec<_> = found.iter().map(|(seed, c)| (seed, names(c), &c.sentence)).collect();
    assert!(words.len() <= 1, "{words:#?}");
    assert!(words.iter().all(|(_, names, _)| names.is_empty()), "{words:#?}");
}

#[test]
fn what_is_put_in_is_named_beside_a_slow_part() {
    for (seed, put, name) in PUT_IN {
        let c = in_counts(seed, put);
        assert_eq!((c.verdict, names(c)), (Verdict::Named, vec![name]), "{}", c.sentence);
    }
}

#[test]
fn volts_say_what_counts_say() {
    let nothing = [70_000, 70_001, 70_002].map(|seed| (seed, Put::Nothing));
    for (seed, put) in nothing.into_iter().chain(PUT_IN.map(|(seed, put, _)| (seed, put))) {
        let counts = in_counts(seed, put);
        for volts in [1e-3, 3e-6] {
            let c = said(seed, put, volts);
            let told = |c: &Critique| (c.verdict, c.signals.outliers);
            assert_eq!(told(&c), told(counts), "{seed} {put:?} x {volts}: {}", c.sentence);
            assert_eq!(names(&c), names(counts), "{seed} {put:?} x {volts}");
        }
    }
}
