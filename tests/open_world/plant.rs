//! The thesis form: every class a box of amplitude, damping and frequency, every signal a ring from it in noise.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal, StudentT};
use std::f64::consts::TAU;

pub type Random = ChaCha8Rng;

/// Independent numbers for every use of one seed.
pub fn random(seed: u64, stream: u64) -> Random {
    let mut rng = Random::seed_from_u64(seed);
    rng.set_stream(stream);
    rng
}

pub fn normal(rng: &mut Random) -> f64 {
    StandardNormal.sample(rng)
}

/// Student's t of 5 degrees of freedom, of variance 1.
pub fn student(rng: &mut Random) -> f64 {
    StudentT::new(5.0).unwrap().sample(rng) * 0.6_f64.sqrt()
}

/// One damped oscillation, and a real pole that begins with it.
#[derive(Clone, Copy, Debug)]
pub struct Ring {
    pub amplitude: f64,
    pub damping_per_s: f64,
    pub frequency_hz: f64,
    pub phase_rad: f64,
    /// Of the amplitude.
    pub pole_share: f64,
    pub pole_per_s: f64,
}

/// The least and the most amplitude, damping in 1/s and frequency in Hz of a class.
pub type Box3 = [[f64; 2]; 3];

#[derive(Clone)]
pub struct Plant {
    pub duration_s: f64,
    pub samples: usize,
    pub phase_rad: f64,
    pub pole_share: f64,
    pub pole_per_s: f64,
    pub noise_sd: f64,
    /// Its deviates, of variance 1.
    pub noise: fn(&mut Random) -> f64,
    pub healthy: Box3,
    pub faults: Vec<(&'static str, Box3)>,
}

/// Uniform ranges, found by search so that the thesis's own method lands near its own tables; those of
/// `sample_logs/scenarios/thesis.toml`, written here again so that these tests share nothing with the simulator.
pub fn thesis_form() -> Plant {
    Plant {
        duration_s: 100e-6,
        samples: 128,
        phase_rad: 0.4,
        pole_share: 0.06,
        pole_per_s: 37_000.0,
        noise_sd: 17.6,
        noise: normal,
        healthy: [[385.0, 415.0], [27_000.0, 31_000.0], [64_570.0, 64_830.0]],
        faults: vec![
            ("EC", [[215.0, 610.0], [1_000.0, 14_000.0], [75_000.0, 85_000.0]]),
            ("AB1", [[400.0, 440.0], [20_000.0, 31_000.0], [65_100.0, 75_600.0]]),
            ("AB2", [[332.0, 357.0], [20_000.0, 68_000.0], [54_800.0, 58_200.0]]),
            ("AB3", [[310.0, 560.0], [15_000.0, 29_000.0], [27_500.0, 31_600.0]]),
            ("BN", [[410.0, 510.0], [6_000.0, 16_000.0], [35_100.0, 36_500.0]]),
            ("PBN", [[323.0, 396.0], [25_000.0, 42_000.0], [57_800.0, 64_400.0]]),
            ("SDN", [[366.0, 411.0], [31_000.0, 37_500.0], [62_300.0, 65_000.0]]),
            ("IDN", [[328.0, 419.0], [31_000.0, 46_000.0], [60_200.0, 65_800.0]]),
            ("DDN", [[200.0, 356.0], [60_000.0, 74_000.0], [55_500.0, 66_000.0]]),
        ],
    }
}

impl Plant {
    /// The same shapes in another unit of what is sensed, and on another scale of time.
    pub fn scaled(mut self, gain: f64, time: f64) -> Plant {
        let faults = self.faults.iter_mut().map(|(_, of)| of);
        for of in faults.chain([&mut self.healthy]) {
            let by = [gain, 1.0 / time, 1.0 / time];
            of.iter_mut().zip(by).for_each(|(range, by)| *range = range.map(|end| end * by));
        }
        self.noise_sd *= gain;
        self.pole_per_s /= time;
        self.duration_s *= time;
        self
    }

    pub fn period_s(&self) -> f64 {
        self.duration_s / self.samples as f64
    }

    pub fn ring(&self, [amplitude, damping_per_s, frequency_hz]: [f64; 3]) -> Ring {
        let Plant { phase_rad, pole_share, pole_per_s, .. } = *self;
        Ring { amplitude, damping_per_s, frequency_hz, phase_rad, pole_share, pole_per_s }
    }

    /// A ring from anywhere in a box.
    pub fn drawn(&self, from: Box3, rng: &mut Random) -> Ring {
        self.ring(from.map(|[low, high]| rng.random_range(low..=high)))
    }

    /// What is there before the noise.
    pub fn clean(&self, ring: &Ring) -> Vec<f64> {
        let at = |k: usize| {
            let t = k as f64 * self.period_s();
            let angle = TAU * ring.frequency_hz * t + ring.phase_rad;
            let oscillation = (-ring.damping_per_s * t).exp() * angle.cos();
            ring.amplitude * (oscillation + ring.pole_share * (-ring.pole_per_s * t).exp())
        };
        (0..self.samples).map(at).collect()
    }

    pub fn noisy(&self, mut y: Vec<f64>, rng: &mut Random) -> Vec<f64> {
        y.iter_mut().for_each(|y| *y += self.noise_sd * (self.noise)(rng));
        y
    }

    pub fn signal(&self, ring: &Ring, rng: &mut Random) -> Vec<f64> {
        self.noisy(self.clean(ring), rng)
    }
}
