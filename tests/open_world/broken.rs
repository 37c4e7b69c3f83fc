//! Signals of sensors and acquisitions that have failed: there is no more or less of it.

use super::plant::{Plant, Random};
use super::ring::Ring;
use rand::RngExt;

#[derive(Clone, Copy, Debug, PartialEq)]
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
}

impl Broken {
    pub const ALL: [Broken; 16] = {
        use Broken::*;
        [
            DeadLine,
            ConstantLine,
            HalfGain,
            QuarterGain,
            DoubleGain,
            Stuck,
            Flipped,
            Clipped,
            Reversed,
            Rectified,
            Late,
            DecayAlone,
            Gaps,
            StuckBit,
            SwappedBytes,
            LoudNoise,
        ]
    };

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
            Broken::Stuck
            | Broken::Clipped
            | Broken::Rectified
            | Broken::Gaps
            | Broken::StuckBit
            | Broken::SwappedBytes
            | Broken::LoudNoise => clean,
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
