//! Signals that belong to no class: what sensors, amplifiers, cables and neighbours add to a healthy ring; sensors and
//! acquisitions that have failed; rings of no class.

use super::plant::{Plant, Random, Ring, normal};
use nalgebra::{DMatrix, DVector};
use rand::RngExt;
use std::f64::consts::TAU;

/// Samples that a healthy ring leads to: what is added to it, in any size; or all that is sensed of it, with the noise.
type Samples = fn(&Plant, &Ring, &mut Random) -> Vec<f64>;

pub struct Family {
    pub name: &'static str,
    samples: Samples,
    /// Of what is added, so many variances of the noise that no healthy ring explains.
    pub energy: Option<f64>,
}

const ADDED: [(&str, Samples); 5] = [
    ("offset", |plant, _, _| vec![1.0; plant.samples]),
    ("odd sample", |plant, _, rng| {
        let at = rng.random_range(0..plant.samples);
        (0..plant.samples).map(|k| f64::from(k == at)).collect()
    }),
    ("hum", |plant, ring, rng| tone(plant, ring, [0.001, 0.08], rng)),
    ("high tone", |plant, ring, rng| tone(plant, ring, [1.4, 6.2], rng)),
    ("white noise", |plant, _, rng| (0..plant.samples).map(|_| normal(rng)).collect()),
];

const SENSED: [(&str, Samples); 6] = [
    ("dead line", |plant, _, rng| plant.noisy(vec![0.0; plant.samples], rng)),
    ("half gain", |plant, ring, rng| {
        plant.signal(&Ring { amplitude: 0.5 * ring.amplitude, ..*ring }, rng)
    }),
    ("stuck", |plant, ring, rng| {
        let mut y = plant.signal(ring, rng);
        let from = rng.random_range(y.len() / 5..y.len() * 2 / 5); // while there is a ring to miss
        let value = y[from];
        y[from..].fill(value);
        y
    }),
    ("clipped", |plant, ring, rng| {
        let bound = ring.amplitude * rng.random_range(0.2..0.4);
        plant.signal(ring, rng).into_iter().map(|y| y.clamp(-bound, bound)).collect()
    }),
    ("ten times the noise", |plant, ring, rng| {
        (0..100).fold(plant.clean(ring), |y, _| plant.noisy(y, rng))
    }),
    ("a ring of no class", |plant, ring, rng| {
        let strange = std::iter::repeat_with(|| Ring {
            // two cycles a signal to a tenth of the sample rate
            frequency_hz: logarithmic([2.0, 0.1 * plant.samples as f64], rng) / plant.duration_s,
            damping_per_s: logarithmic([1e3, 1.2e5], rng),
            ..*ring
        });
        let strange = strange.into_iter().find(|ring| is_far_from_all(ring, plant)).unwrap();
        plant.signal(&strange, rng)
    }),
];

impl Family {
    /// All of them; what comes in any size comes in these two.
    pub fn all(energies: [f64; 2]) -> Vec<Family> {
        let added =
            |(name, samples)| energies.map(|energy| Family { name, samples, energy: Some(energy) });
        let sensed = SENSED.map(|(name, samples)| Family { name, samples, energy: None });
        ADDED.into_iter().flat_map(added).chain(sensed).collect()
    }

    pub fn signal(&self, plant: &Plant, rng: &mut Random) -> Vec<f64> {
        let healthy = plant.drawn(plant.healthy, rng);
        let samples = (self.samples)(plant, &healthy, rng);
        let Some(energy) = self.energy else { return samples };
        let size = (energy / unexplained(plant, &healthy, &samples)).sqrt();
        let both = plant.clean(&healthy).into_iter().zip(samples).map(|(y, v)| y + size * v);
        plant.noisy(both.collect(), rng)
    }
}

/// Energy of what no ring near this one explains, in variances of the noise: what is left of `added` where amplitude,
/// damping, frequency, phase and the real pole's share and rate are free, to first order.
fn unexplained(plant: &Plant, ring: &Ring, added: &[f64]) -> f64 {
    let more = 1.0 + 1e-4;
    let moved = [
        Ring { amplitude: ring.amplitude * more, ..*ring },
        Ring { damping_per_s: ring.damping_per_s * more, ..*ring },
        Ring { frequency_hz: ring.frequency_hz * more, ..*ring },
        Ring { phase_rad: ring.phase_rad * more, ..*ring },
        Ring { pole_share: ring.pole_share * more, ..*ring },
        Ring { pole_per_s: ring.pole_per_s * more, ..*ring },
    ];
    let base = DVector::from(plant.clean(ring));
    let tangents = moved.map(|ring| DVector::from(plant.clean(&ring)) - &base);
    let explains = DMatrix::from_columns(&tangents).qr().q();
    let added = DVector::from_column_slice(added);
    let left = &added - &explains * explains.tr_mul(&added);
    left.norm_squared() / plant.noise_sd.powi(2)
}

/// It leaves each class by a factor of its bounds.
fn is_far_from_all(ring: &Ring, plant: &Plant) -> bool {
    let outside = |value: f64, [low, high]: [f64; 2], factor: f64| {
        value < low / factor || value > high * factor
    };
    let classes = plant.faults.iter().map(|(_, of)| *of).chain([plant.healthy]);
    classes.into_iter().all(|[_, damping, frequency]| {
        outside(ring.frequency_hz, frequency, 1.12) || outside(ring.damping_per_s, damping, 1.6)
    })
}

fn logarithmic([low, high]: [f64; 2], rng: &mut Random) -> f64 {
    rng.random_range(low.ln()..high.ln()).exp()
}

/// Of so many cycles for each of the ring's.
fn tone(plant: &Plant, ring: &Ring, cycles: [f64; 2], rng: &mut Random) -> Vec<f64> {
    let frequency_hz = ring.frequency_hz * logarithmic(cycles, rng);
    let phase_rad = rng.random_range(0.0..TAU);
    let steady = Ring { frequency_hz, phase_rad, damping_per_s: 0.0, pole_share: 0.0, ..*ring };
    plant.clean(&steady)
}
