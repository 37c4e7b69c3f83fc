//! The thesis form: every class a box of amplitude, damping and frequency, every signal a ring from it in noise. How healthy
//! channels scatter about the middle of their box, and what moves all channels of a head alike while nobody records why.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Gamma, StandardNormal, StudentT};
use std::f64::consts::TAU;

pub type Random = ChaCha8Rng;

/// Independent numbers for every use of one seed.
pub fn random(seed: u64, stream: u64) -> Random {
    let mut rng = Random::seed_from_u64(seed);
    rng.set_stream(stream);
    rng
}

/// A deviate of mean 0 and variance 1.
pub type Deviate = fn(&mut Random) -> f64;

pub fn normal(rng: &mut Random) -> f64 {
    StandardNormal.sample(rng)
}

/// Student's t of 5 degrees of freedom.
pub fn student(rng: &mut Random) -> f64 {
    StudentT::new(5.0).unwrap().sample(rng) * 0.6_f64.sqrt()
}

/// Amplitude in counts, damping in 1/s and frequency in Hz; phase and real pole are those of all.
pub type Ring = [f64; 3];
/// The least and the most of each.
pub type Box3 = [[f64; 2]; 3];

pub const SAMPLES: usize = 128;
pub const PERIOD_S: f64 = 100e-6 / SAMPLES as f64;
pub const NOISE: f64 = 17.6;

/// Uniform ranges, found by search so that the thesis's own method lands near its own tables; those of
/// `sample_logs/scenarios/thesis.toml`, written here again so that these tests share nothing with the simulator.
pub const HEALTHY: Box3 = [[385.0, 415.0], [27_000.0, 31_000.0], [64_570.0, 64_830.0]];
pub const FAULTS: [(&str, Box3); 9] = [
    ("EC", [[215.0, 610.0], [1_000.0, 14_000.0], [75_000.0, 85_000.0]]),
    ("AB1", [[400.0, 440.0], [20_000.0, 31_000.0], [65_100.0, 75_600.0]]),
    ("AB2", [[332.0, 357.0], [20_000.0, 68_000.0], [54_800.0, 58_200.0]]),
    ("AB3", [[310.0, 560.0], [15_000.0, 29_000.0], [27_500.0, 31_600.0]]),
    ("BN", [[410.0, 510.0], [6_000.0, 16_000.0], [35_100.0, 36_500.0]]),
    ("PBN", [[323.0, 396.0], [25_000.0, 42_000.0], [57_800.0, 64_400.0]]),
    ("SDN", [[366.0, 411.0], [31_000.0, 37_500.0], [62_300.0, 65_000.0]]),
    ("IDN", [[328.0, 419.0], [31_000.0, 46_000.0], [60_200.0, 65_800.0]]),
    ("DDN", [[200.0, 356.0], [60_000.0, 74_000.0], [55_500.0, 66_000.0]]),
];

/// A ring from anywhere in a box.
pub fn drawn(from: Box3, rng: &mut Random) -> Ring {
    from.map(|[low, high]| rng.random_range(low..=high))
}

/// What is there before the noise.
pub fn clean([amplitude, damping_per_s, frequency_hz]: Ring) -> Vec<f64> {
    let at = |k: usize| {
        let t = k as f64 * PERIOD_S;
        let oscillation = (-damping_per_s * t).exp() * (TAU * frequency_hz * t + 0.4).cos();
        amplitude * (oscillation + 0.06 * (-37_000.0 * t).exp())
    };
    (0..SAMPLES).map(at).collect()
}

pub fn noisy(mut y: Vec<f64>, noise: Deviate, rng: &mut Random) -> Vec<f64> {
    y.iter_mut().for_each(|y| *y += NOISE * noise(rng));
    y
}

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
    pub fn ring(&self, seed: u64, channel: usize, rng: &mut Random) -> Ring {
        let own = &mut random(seed, 1_000_000 + channel as u64);
        let rng = if self.lasts { own } else { rng };
        // what moves amplitude and frequency up moves damping down
        let mut cause = -self.common.sqrt() * (self.deviate)(rng);
        HEALTHY.map(|[low, high]| {
            cause = -cause;
            let deviate = cause + (1.0 - self.common).sqrt() * (self.deviate)(rng);
            (low + high) / 2.0 + self.width * (high - low) / 12_f64.sqrt() * deviate
        })
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
