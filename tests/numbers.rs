//! Small tables of numbers of every hostile kind through the critique: it answers or refuses, it never panics.

use clap::ValueEnum;
use inkling::burst::Beside;
use inkling::critique::engine::{Rings, critique};
use inkling::critique::finding::{Critique, Verdict};
use inkling::critique::observations::{Observations, Sampler};
use inkling::critique::outcome::CritiqueError;
use inkling::critique::report;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;
use std::panic::AssertUnwindSafe;

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Kind {
    /// Whole counts that end in exact zeros.
    EndsInZeros,
    /// Stays at once, as a body under friction.
    Halts,
    Constant,
    Impulse,
    Step,
    Alternates,
    Walk,
    OneBit,
    Ramp,
    PureSine,
    Grows,
    Huge,
    Tiny,
    Rails,
    Noise,
    Partials,
}

fn series(kind: Kind, n: usize, rng: &mut ChaCha8Rng) -> Vec<f64> {
    let omega = TAU / rng.random_range(5.0..40.0);
    let (phase, fall) = (TAU * rng.random::<f64>(), rng.random_range(1.0..8.0) / n as f64);
    let ring = |k: usize| (-fall * k as f64).exp() * (omega * k as f64 + phase).cos();
    let uneven: f64 = rng.random_range(0.5..2.0);
    let at = rng.random_range(0..n);
    let mut level = 0.0;
    let partials: Vec<[f64; 3]> = (0..12)
        .map(|_| {
            [rng.random_range(0.1..3.0), TAU * rng.random::<f64>(), rng.random_range(0.5..1.0)]
        })
        .collect();
    (0..n)
        .map(|k| {
            let noise = rng.random::<f64>() - 0.5;
            level += noise;
            match kind {
                Kind::EndsInZeros => {
                    (60.0 * uneven * (-4.0 * fall * k as f64).exp() * ring(k)).round()
                }
                Kind::Halts if k < at => 100.0 * ring(k),
                Kind::Halts => 0.0,
                Kind::Constant => 7.0 * uneven,
                Kind::Impulse => f64::from(u8::from(k == at)),
                Kind::Step => f64::from(u8::from(k >= at)) * 3.0,
                Kind::Alternates => [1.0, -1.0][k % 2],
                Kind::Walk => level,
                Kind::OneBit => (noise * 2.0).round(),
                Kind::Ramp => uneven * k as f64,
                Kind::PureSine => (omega * k as f64).sin(),
                Kind::Grows => (fall * k as f64).exp() * (omega * k as f64).cos(),
                Kind::Huge => 1e30 * (ring(k) + 0.01 * noise),
                Kind::Tiny => 1e-30 * (ring(k) + 0.01 * noise),
                Kind::Rails => (40_000.0 * ring(k)).clamp(-32_768.0, 32_767.0).round(),
                Kind::Noise => noise,
                Kind::Partials => {
                    let part = |[w, p, a]: &[f64; 3]| {
                        a * (-fall * k as f64).exp() * (w * k as f64 + p).cos()
                    };
                    100.0 * partials.iter().map(part).sum::<f64>() + noise
                }
            }
        })
        .collect()
}

/// Some decays of one kind, of one or more outputs, not all of one length.
fn table(kind: Kind, [bursts, outputs, samples]: [usize; 3], rng: &mut ChaCha8Rng) -> Observations {
    let mut sampler = Sampler::new(1e-4, 4096);
    for burst in 0..bursts {
        let n = samples - rng.random_range(0..3);
        for output in 0..outputs {
            let drive_v = if burst % 2 == 0 { f64::NAN } else { 20.0 };
            let beside =
                Beside { drive_v, ..Beside::alone(output as u32, 1_000_000 * burst as i64) };
            sampler.offer("p", beside, &series(kind, n, rng));
        }
    }
    sampler.finish()
}

fn told(data: &Observations, rings: Rings) -> Result<Critique, CritiqueError> {
    let critique = critique(data, rings, false)?.critique;
    assert!(report::html(&critique).contains("</html>"));
    serde_json::to_string(&critique).unwrap();
    Ok(critique)
}

#[test]
fn no_table_of_numbers_makes_the_critique_panic() {
    for seed in 0..48 {
        let mut rng = ChaCha8Rng::seed_from_u64(8_800_000 + seed);
        let kinds = Kind::value_variants();
        let kind = kinds[seed as usize % kinds.len()];
        let (rings, shape) = match seed % 3 {
            0 => (Rings::InkChannel, [5, 4, 48]),
            _ => (Rings::Oscillator, [1 + seed as usize % 3, 1 + seed as usize % 2, 90]),
        };
        let data = table(kind, [shape[0], shape[1], shape[2] - seed as usize % 30], &mut rng);
        if let Err(panic) =
            std::panic::catch_unwind(AssertUnwindSafe(|| told(&data, rings).is_ok()))
        {
            panic!("{kind:?} {seed} {rings:?}: {:?}", panic.downcast_ref::<String>());
        }
    }
}

/// Twelve partials of like size: none is a tenth of the whole, and all of it rings.
#[test]
fn many_partials_ring_and_noise_does_not() {
    let mut rng = ChaCha8Rng::seed_from_u64(8_900_000);
    let mut told = |kind| told(&table(kind, [1, 1, 200], &mut rng), Rings::Oscillator);
    for _ in 0..2 {
        let of_partials = told(Kind::Partials);
        assert!(of_partials.is_ok(), "{:?}", of_partials.err());
    }
    assert!(told(Kind::Noise).is_err() && told(Kind::Noise).is_err());
}

/// Nothing but the rounding of samples is left of a decay without noise: no cause.
#[test]
fn a_decay_without_noise_asks_for_nothing_more() {
    let mut sampler = Sampler::new(1e-3, 16);
    let decay = |k: usize| {
        let y = (-1.5e-3 * k as f64).exp() * (0.01 * TAU * k as f64).cos();
        f64::from(y as f32)
    };
    sampler.offer("p", Beside::alone(0, 0), &(0..2000).map(decay).collect::<Vec<f64>>());
    let told = told(&sampler.finish(), Rings::Oscillator).unwrap();
    assert!(told.causes.is_empty() && told.verdict == Verdict::None, "{}", told.sentence);
}

/// A decay that is one sample shorter than another is used with it.
#[test]
fn decays_of_unlike_length_are_cut_to_one() {
    let mut sampler = Sampler::new(1e-4, 16);
    for (burst, n) in [300, 299, 300, 20].into_iter().enumerate() {
        let beside = Beside::alone(0, burst as i64);
        sampler.offer("p", beside, &vec![burst as f64; n]);
    }
    let data = sampler.finish();
    assert_eq!((data.len(), data.samples), (3, 299));
}
