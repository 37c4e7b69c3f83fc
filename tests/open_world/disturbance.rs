//! What sensors, amplifiers, cables and neighbours add to a healthy ring, of any size.

use super::pattern::{Pattern, Undisturbed};
use super::plant::{Plant, Random};
use super::ring::Ring;
use clap::ValueEnum;
use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::TAU;

#[derive(Clone, Copy, Debug, PartialEq, ValueEnum)]
pub enum Disturbance {
    Offset,
    Step,
    Ramp,
    OddSample,
    TwoOddSamples,
    FiveOddSamples,
    LowTone,
    ToneNearRing,
    HighTone,
    Hum,
    SquareWave,
    WhiteNoise,
    NoiseInPart,
    RememberingNoise,
    Wander,
    CoarseSteps,
    LostSamples,
    Crosstalk,
    TwoRings,
    Beat,
    Chirp,
    Modulation,
}

impl Disturbance {
    /// A healthy ring, disturbed so that `x` noise variances are left unexplained, in noise.
    /// `None`: this draw cannot be made so large.
    pub fn signal(
        self,
        healthy: &Ring,
        x: f64,
        plant: &Plant,
        rng: &mut Random,
    ) -> Option<Vec<f32>> {
        let base = plant.clean(healthy);
        let undisturbed = Undisturbed { ring: healthy, base: &base, plant };
        self.pattern(&undisturbed, rng).signal(x, &undisturbed, rng)
    }

    fn pattern(self, undisturbed: &Undisturbed, rng: &mut Random) -> Pattern {
        let Undisturbed { ring: healthy, base, plant } = *undisturbed;
        let n = plant.samples;
        let times: Vec<f64> = plant.sampling().times().collect();
        // per cycle of the healthy resonance: the same on any scale of time
        let tone = |low: f64, high: f64, rng: &mut Random| -> Vec<f64> {
            let omega = healthy.omega() * rng.random_range(low.ln()..high.ln()).exp();
            let phase = rng.random_range(0.0..TAU);
            times.iter().map(|t| (omega * t + phase).cos()).collect()
        };
        Pattern::Added(match self {
            Disturbance::Offset => vec![sign(rng); n],
            Disturbance::Step => {
                let from = rng.random_range(n * 3 / 10..n * 7 / 10);
                (0..n).map(|k| f64::from(k >= from)).collect()
            }
            Disturbance::Ramp => (0..n).map(|k| k as f64 / n as f64).collect(),
            Disturbance::OddSample => odd_samples(n, 1, rng),
            Disturbance::TwoOddSamples => odd_samples(n, 2, rng),
            Disturbance::FiveOddSamples => odd_samples(n, 5, rng),
            Disturbance::LowTone => tone(0.3, 0.8, rng),
            Disturbance::ToneNearRing => tone(0.8, 1.4, rng),
            Disturbance::HighTone => tone(1.4, 6.2, rng),
            Disturbance::Hum => tone(0.001, 0.08, rng),
            Disturbance::SquareWave => tone(0.3, 4.0, rng).into_iter().map(f64::signum).collect(),
            Disturbance::WhiteNoise => remembering(n, 0.0, rng),
            Disturbance::NoiseInPart => {
                let length = rng.random_range(n / 8..n / 3);
                let from = rng.random_range(0..n - length);
                let part = from..from + length;
                let noise = remembering(n, 0.0, rng).into_iter().enumerate();
                noise.map(|(k, v)| if part.contains(&k) { v } else { 0.0 }).collect()
            }
            Disturbance::RememberingNoise => remembering(n, 0.9, rng),
            Disturbance::Wander => remembering(n, 1.0, rng),
            Disturbance::CoarseSteps => return Pattern::Coarse,
            Disturbance::LostSamples => return Pattern::Later(rng.random_range(n / 12..n / 2)),
            Disturbance::Chirp => return Pattern::Sweeping,
            Disturbance::Crosstalk => {
                let neighbour = plant.ring(plant.healthy.draw(rng));
                let delay = rng.random_range(n / 25..n / 3);
                let arrived =
                    |k: usize| k.checked_sub(delay).map_or(0.0, |k| neighbour.at(times[k]));
                (0..n).map(arrived).collect()
            }
            Disturbance::TwoRings => {
                let apart = if rng.random_bool(0.5) { 0.5..0.9 } else { 1.1..2.0 };
                let other = Ring {
                    frequency_hz: healthy.frequency_hz * rng.random_range(apart),
                    damping_per_s: healthy.damping_per_s * rng.random_range(0.3..1.5),
                    phase_rad: rng.random_range(0.0..TAU),
                    pole_share: 0.0,
                    ..*healthy
                };
                other.sampled(plant.sampling())
            }
            Disturbance::Beat => {
                let apart = 1.0 + sign(rng) * rng.random_range(0.12..0.3);
                let other = Ring { frequency_hz: healthy.frequency_hz * apart, ..*healthy };
                other.sampled(plant.sampling())
            }
            Disturbance::Modulation => {
                let by = tone(0.3, 1.5, rng);
                base.iter().zip(by).map(|(y, by)| y * by).collect()
            }
        })
    }
}

fn sign(rng: &mut Random) -> f64 {
    if rng.random_bool(0.5) { 1.0 } else { -1.0 }
}

fn odd_samples(n: usize, count: usize, rng: &mut Random) -> Vec<f64> {
    let mut y = vec![0.0; n];
    for at in rand::seq::index::sample(rng, n, count) {
        y[at] = sign(rng);
    }
    y
}

/// Noise of which each sample keeps so much of the one before; 1 is a random walk.
fn remembering(n: usize, keeps: f64, rng: &mut Random) -> Vec<f64> {
    let mut y = 0.0;
    (0..n)
        .map(|_| {
            let new: f64 = StandardNormal.sample(rng);
            y = keeps * y + new;
            y
        })
        .collect()
}
