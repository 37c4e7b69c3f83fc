//! How healthy channels scatter about the middle of the healthy box, and what moves all channels of a head alike while
//! nobody records why.

use super::plant::{Plant, Random, Ring, normal, random, student};
use rand::RngExt;
use rand_distr::{Distribution, Gamma};
use std::f64::consts::TAU;

/// One deviate of a scatter, of mean 0 and variance 1.
type Deviate = fn(&mut Random) -> f64;

#[derive(Clone, Copy)]
pub struct Scatter {
    pub name: &'static str,
    pub deviate: Deviate,
    /// Share of the variance that one cause has, which moves amplitude, damping and frequency.
    pub common: f64,
    /// Every channel keeps its own, all its life.
    pub lasts: bool,
    /// Of amplitude, damping and frequency, in standard deviations of the box.
    pub width: f64,
}

const fn scatter(name: &'static str, deviate: Deviate) -> Scatter {
    Scatter { name, deviate, common: 0.0, lasts: false, width: 1.0 }
}

pub const BOX: Scatter = scatter("box", |rng| rng.random_range(-1.0..=1.0) * 3_f64.sqrt());
pub const GAUSSIAN: Scatter = scatter("Gaussian", normal);
pub const LASTING: Scatter = Scatter { lasts: true, ..scatter("lasting", normal) };
pub const SHAPES: [Scatter; 6] = [
    BOX,
    GAUSSIAN,
    LASTING,
    scatter("gamma of shape 4", |rng| (Gamma::new(4.0, 1.0).unwrap().sample(rng) - 4.0) / 2.0),
    scatter("Student of 5", student),
    Scatter { common: 0.8, ..scatter("correlated", normal) },
];

impl Scatter {
    /// A healthy ring of a channel.
    pub fn ring(&self, plant: &Plant, seed: u64, channel: usize, rng: &mut Random) -> Ring {
        let own = &mut random(seed, 1_000_000 + channel as u64);
        let rng = if self.lasts { own } else { rng };
        // what moves amplitude and frequency up moves damping down
        let mut cause = -self.common.sqrt() * (self.deviate)(rng);
        plant.ring(plant.healthy.map(|[low, high]| {
            cause = -cause;
            let deviate = cause + (1.0 - self.common).sqrt() * (self.deviate)(rng);
            (low + high) / 2.0 + self.width * (high - low) / 12_f64.sqrt() * deviate
        }))
    }
}

/// After so many seconds: relative changes of amplitude, damping and frequency.
pub type Drift = fn(f64) -> [f64; 3];

/// Each with how often replay may say that all channels have moved, by the default bounds of `[identify]`: the step
/// lies at one of them.
pub const DRIFTS: [(&str, [usize; 2], Drift); 6] = [
    ("none", [0, 0], |_| [0.0; 3]),
    ("damping +10 %, a step", [0, 1], |t| [0.0, if t < 305.0 { 0.0 } else { 0.1 }, 0.0]),
    ("damping +8 %, slowly", [0, 0], |t| [0.0, 0.08 * t / 600.0, 0.0]),
    ("damping +20 %, slowly", [1, 1], |t| [0.0, 0.2 * t / 600.0, -0.004 * t / 600.0]),
    ("damping ± 8 %", [0, 0], |t| [0.0, 0.08 * (TAU * (t - 20.0) / 200.0).sin(), 0.0]),
    ("all three", [0, 0], |t| {
        let turn = |period_s: f64| (TAU * t / period_s).sin();
        [0.02 * turn(130.0), 0.05 * turn(310.0), 0.003 * turn(170.0)]
    }),
];

pub fn drifted(drift: Drift, t_s: f64, ring: Ring) -> Ring {
    let [amplitude, damping, frequency] = drift(t_s).map(|change| 1.0 + change);
    Ring {
        amplitude: ring.amplitude * amplitude,
        damping_per_s: ring.damping_per_s * damping,
        frequency_hz: ring.frequency_hz * frequency,
        ..ring
    }
}
