//! Signals that belong to no class: what sensors, amplifiers, cables and neighbours add to a healthy ring; sensors and
//! acquisitions that have failed; rings of no class.

use super::plant::{HEALTHY, NOISE, PERIOD_S, Random, Ring, SAMPLES, clean, drawn, noisy, normal};
use rand::RngExt;
use std::f64::consts::TAU;

/// Samples that a healthy ring leads to: what is added to it, in any size; or all that is sensed of it, with the noise.
type Samples = fn(Ring, &mut Random) -> Vec<f64>;

pub struct Family {
    pub name: &'static str,
    samples: Samples,
    /// Of what is added, so many variances of the noise.
    pub energy: Option<f64>,
}

/// In variances of the noise: what nobody can overlook, and what is gross.
const SIZES: [f64; 2] = [400.0, 1600.0];

const ADDED: [(&str, [f64; 2], Samples); 5] = [
    ("offset", SIZES, |_, _| vec![1.0; SAMPLES]),
    ("odd sample", SIZES, |_, rng| {
        let at = rng.random_range(0..SAMPLES);
        (0..SAMPLES).map(|k| f64::from(k == at)).collect()
    }),
    // most of it looks like the ring's own slow part
    ("hum", [1600.0, 6400.0], |ring, rng| tone(ring, [0.001, 0.08], rng)),
    ("high tone", SIZES, |ring, rng| tone(ring, [1.4, 6.2], rng)),
    ("white noise", SIZES, |_, rng| (0..SAMPLES).map(|_| normal(rng)).collect()),
];

const SENSED: [(&str, Samples); 6] = [
    ("dead line", |_, rng| noisy(vec![0.0; SAMPLES], normal, rng)),
    ("half gain", |[amplitude, damping, frequency], rng| {
        noisy(clean([0.5 * amplitude, damping, frequency]), normal, rng)
    }),
    ("stuck", |ring, rng| {
        let mut y = noisy(clean(ring), normal, rng);
        let from = rng.random_range(SAMPLES / 5..SAMPLES * 2 / 5); // while there is a ring to miss
        let value = y[from];
        y[from..].fill(value);
        y
    }),
    ("clipped", |ring, rng| {
        let bound = ring[0] * rng.random_range(0.2..0.4);
        let y = noisy(clean(ring), normal, rng);
        y.into_iter().map(|y| y.clamp(-bound, bound)).collect()
    }),
    ("ten times the noise", |ring, rng| (0..100).fold(clean(ring), |y, _| noisy(y, normal, rng))),
    ("a ring of no class", |[amplitude, ..], rng| {
        // a tenth from the classes' frequencies on either side
        let between = [[20e3, 24.5e3], [41e3, 48.9e3], [95.2e3, 128e3]];
        let frequency = logarithmic(between[rng.random_range(0..3)], rng);
        noisy(clean([amplitude, logarithmic([1e3, 1.2e5], rng), frequency]), normal, rng)
    }),
];

impl Family {
    /// All of them; what comes in any size comes in two.
    pub fn all() -> Vec<Family> {
        let added = |(name, sizes, samples): (_, [f64; 2], _)| {
            sizes.map(|energy| Family { name, samples, energy: Some(energy) })
        };
        let sensed = SENSED.map(|(name, samples)| Family { name, samples, energy: None });
        ADDED.into_iter().flat_map(added).chain(sensed).collect()
    }

    pub fn signal(&self, rng: &mut Random) -> Vec<f64> {
        let healthy = drawn(HEALTHY, rng);
        let samples = (self.samples)(healthy, rng);
        let Some(energy) = self.energy else { return samples };
        let size = NOISE * (energy / samples.iter().map(|v| v * v).sum::<f64>()).sqrt();
        let both = clean(healthy).into_iter().zip(samples).map(|(y, v)| y + size * v);
        noisy(both.collect(), normal, rng)
    }
}

fn logarithmic([low, high]: [f64; 2], rng: &mut Random) -> f64 {
    rng.random_range(low.ln()..high.ln()).exp()
}

/// Of so many cycles for each of the ring's.
fn tone([.., frequency_hz]: Ring, cycles: [f64; 2], rng: &mut Random) -> Vec<f64> {
    let turns = TAU * frequency_hz * logarithmic(cycles, rng) * PERIOD_S;
    let phase = rng.random_range(0.0..TAU);
    (0..SAMPLES).map(|k| (turns * k as f64 + phase).cos()).collect()
}
