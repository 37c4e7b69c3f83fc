//! The thesis form: every class a box of amplitude, damping and frequency, every signal a ring from
//! it in noise. Everything that is the same for all signals can be set.

use super::model_error::ModelError;
use super::ranges::{Features, Ranges};
use super::ring::{Ring, Sampling};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal, StudentT};
use serde::Deserialize;
use std::collections::BTreeMap;

pub type Random = ChaCha8Rng;

/// Independent numbers for every use of one seed.
pub fn random(seed: u64, stream: u64) -> Random {
    let mut rng = Random::seed_from_u64(seed);
    rng.set_stream(stream);
    rng
}

#[derive(Clone, Copy, Debug)]
pub enum Noise {
    White,
    /// Student's t of 5 degrees of freedom, of the same variance.
    Heavy,
    /// Each sample remembers half of the one before; of the same variance.
    Remembering,
}

#[derive(Clone, Debug)]
pub struct Plant {
    pub healthy: Ranges,
    pub faults: BTreeMap<String, Ranges>,
    pub samples: usize,
    pub duration_s: f64,
    pub phase_rad: f64,
    pub pole_share: f64,
    pub pole_per_s: f64,
    pub noise_sd: f64,
    pub noise: Noise,
    /// Of signal and noise alike. Anything but 1 is recorded in floats: rounding is no gain.
    pub gain: f64,
    /// The sample period times this, the shapes kept.
    pub time_scale: f64,
    /// What every signal holds, healthy or faulty.
    pub error: Option<ModelError>,
}

/// As in `classes.json`.
#[derive(Deserialize)]
struct File {
    #[serde(rename = "T_us")]
    t_us: f64,
    #[serde(rename = "N")]
    n: usize,
    phi0_rad: f64,
    rho: f64,
    lambda_per_s: f64,
    noise_sd_counts: f64,
    classes: BTreeMap<String, Ranges>,
}

impl Plant {
    /// The frozen data set's.
    pub fn thesis_form() -> Plant {
        Plant::of(include_str!("classes.json"))
    }

    /// A head of another make, some of whose classes no physics knows, and not all are labelled.
    pub fn other_make() -> Plant {
        Plant::of(include_str!("other_make.json"))
    }

    fn of(file: &str) -> Plant {
        let file: File = serde_json::from_str(file).unwrap();
        let mut faults = file.classes;
        Plant {
            healthy: faults.remove("healthy").unwrap(),
            faults,
            samples: file.n,
            duration_s: file.t_us * 1e-6,
            phase_rad: file.phi0_rad,
            pole_share: file.rho,
            pole_per_s: file.lambda_per_s,
            noise_sd: file.noise_sd_counts,
            noise: Noise::White,
            gain: 1.0,
            time_scale: 1.0,
            error: None,
        }
    }

    pub fn sampling(&self) -> Sampling {
        let period_s = self.duration_s / self.samples as f64 * self.time_scale;
        Sampling { samples: self.samples, period_s }
    }

    pub fn is_rounded(&self) -> bool {
        self.gain == 1.0
    }

    pub fn ring(&self, features: Features) -> Ring {
        Ring {
            amplitude: features.amplitude * self.gain,
            damping_per_s: features.damping_per_s / self.time_scale,
            frequency_hz: features.frequency_hz / self.time_scale,
            phase_rad: self.phase_rad + features.turned_rad,
            pole_share: self.pole_share,
            pole_per_s: self.pole_per_s / self.time_scale,
            overtone: features.overtone,
        }
    }

    /// The healthy ring in the middle.
    pub fn typical(&self) -> Ring {
        self.ring(self.healthy.centre())
    }

    /// What is there before the noise.
    pub fn clean(&self, ring: &Ring) -> Vec<f64> {
        match &self.error {
            None => ring.sampled(self.sampling()),
            Some(error) => error.sampled(ring, &self.typical(), self.sampling()),
        }
    }

    /// Standard deviation of the noise as recorded.
    pub fn noise_counts(&self) -> f64 {
        self.noise_sd * self.gain
    }

    pub fn add_noise(&self, y: &mut [f64], rng: &mut Random) {
        let heavy = StudentT::new(5.0).unwrap();
        let mut before: f64 = StandardNormal.sample(rng);
        for y in y {
            let normal: f64 = StandardNormal.sample(rng);
            let unit = match self.noise {
                Noise::White => normal,
                Noise::Heavy => heavy.sample(rng) * 0.6_f64.sqrt(),
                Noise::Remembering => {
                    before = 0.5 * before + 0.75_f64.sqrt() * normal;
                    before
                }
            };
            *y += self.noise_counts() * unit;
        }
    }

    /// As the acquisition hands it on.
    pub fn recorded(&self, mut y: Vec<f64>) -> Vec<f32> {
        if self.is_rounded() {
            y.iter_mut().for_each(|y| *y = y.round().clamp(-32_768.0, 32_767.0));
        }
        y.into_iter().map(|y| y as f32).collect()
    }

    pub fn signal(&self, features: Features, rng: &mut Random) -> Vec<f32> {
        let mut y = self.clean(&self.ring(features));
        self.add_noise(&mut y, rng);
        self.recorded(y)
    }
}
