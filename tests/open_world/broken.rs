//! Signals of sensors and acquisitions that have failed: there is no more or less of it.

use super::plant::{Plant, Random};
use super::ring::Ring;
use clap::ValueEnum;
use rand::RngExt;

#[derive(Clone, Copy, Debug, PartialEq, ValueEnum)]
pub enum Broken {
    /// Noise alone.
    DeadLine,
    ConstantLine,
    HalfGain,
    QuarterGain,
    DoubleGain,
    /// From some sample on always the same value.
    Stuck,
    Flipped,
    /// The amplifier ends below the converter's rails.
    Clipped,
    Reversed,
    Rectified,
    /// The ring begins late; before it noise.
    Late,
    /// A decay that does not oscillate.
    DecayAlone,
    /// Every fourth sample is lost and reads zero.
    Gaps,
    /// One bit of the converter always reads one.
    StuckBit,
    SwappedBytes,
    /// Ten times the noise, a ring below it.
    LoudNoise,
    /// The signal a second time, later and smaller: a line that reflects.
    Echo,
    /// Nothing from the middle on, not even noise.
    HalfSent,
    /// Clipped at half its height.
    ClippedAtHalf,
    /// A second ring beside the channel's own, half as large.
    SecondRing,
}

impl Broken {
    pub fn signal(self, healthy: &Ring, plant: &Plant, rng: &mut Random) -> Vec<f32> {
        let n = plant.samples;
        let height = plant.typical().amplitude;
        let clean = plant.clean(healthy);
        let scaled = |by: f64| clean.iter().map(|y| by * y).collect();
        let mut y: Vec<f64> = match self {
            Broken::DeadLine => vec![0.0; n],
            Broken::ConstantLine => {
                let level = rng.random_range(-2.0..2.0) * height;
                return plant.recorded(vec![level; n]);
            }
            Broken::HalfGain => scaled(0.5),
            Broken::QuarterGain => scaled(0.25),
            Broken::DoubleGain => scaled(2.0),
            Broken::Flipped => scaled(-1.0),
            Broken::Reversed => clean.iter().rev().copied().collect(),
            Broken::Late => {
                let from = rng.random_range(n / 12..n / 3);
                [vec![0.0; from], clean[..n - from].to_vec()].concat()
            }
            Broken::DecayAlone => {
                let alone = Ring {
                    amplitude: height * rng.random_range(0.3..1.5),
                    pole_share: 1.0,
                    pole_per_s: healthy.pole_per_s * rng.random_range(0.2..3.0),
                    ..*healthy
                };
                let pole = |t: f64| alone.amplitude * (-alone.pole_per_s * t).exp();
                plant.sampling().times().map(pole).collect()
            }
            Broken::Echo => {
                let later = rng.random_range(n / 10..n / 3);
                let share = rng.random_range(0.3..0.6);
                let of = |k: usize| k.checked_sub(later).map_or(0.0, |k| share * clean[k]);
                clean.iter().enumerate().map(|(k, y)| y + of(k)).collect()
            }
            Broken::SecondRing => {
                let apart = [0.55, 0.7, 1.5, 1.9][rng.random_range(0..4)];
                let second = Ring {
                    amplitude: 0.5 * healthy.amplitude,
                    frequency_hz: healthy.frequency_hz * apart,
                    pole_share: 0.0,
                    ..*healthy
                };
                clean.iter().zip(second.sampled(plant.sampling())).map(|(y, z)| y + z).collect()
            }
            // what fails behind the noise
            _ => clean,
        };
        let noises = if self == Broken::LoudNoise { 100 } else { 1 };
        (0..noises).for_each(|_| plant.add_noise(&mut y, rng));
        match self {
            Broken::Stuck => {
                let from = rng.random_range(n / 5..n * 2 / 5); // while there is a ring to miss
                let value = y[from];
                y[from..].fill(value);
            }
            Broken::Clipped => {
                let bound = height * rng.random_range(0.2..0.4);
                y.iter_mut().for_each(|y| *y = y.clamp(-bound, bound));
            }
            Broken::HalfSent => y[n / 2..].fill(0.0),
            Broken::ClippedAtHalf => {
                let bound = 0.5 * y.iter().fold(0.0f64, |most, y| most.max(y.abs()));
                y.iter_mut().for_each(|y| *y = y.clamp(-bound, bound));
            }
            Broken::Rectified => y.iter_mut().for_each(|y| *y = y.abs()),
            Broken::Gaps => {
                let first = rng.random_range(0..4);
                y.iter_mut().skip(first).step_by(4).for_each(|y| *y = 0.0);
            }
            Broken::StuckBit => {
                let bit = 1 << rng.random_range(7..9);
                y.iter_mut().for_each(|y| *y = f64::from(y.round() as i16 | bit));
            }
            Broken::SwappedBytes => {
                y.iter_mut().for_each(|y| *y = f64::from((y.round() as i16).swap_bytes()))
            }
            _ => {}
        }
        plant.recorded(y)
    }
}
