//! Shapes in which healthy channels may scatter. All have the centre of the healthy box, and
//! `width` times its standard deviation in each of amplitude, damping and frequency.

use super::plant::{Plant, Random, random};
use super::ranges::Features;
use rand::RngExt;
use rand_distr::{Distribution, Gamma, StandardNormal, StudentT};
use std::fmt;

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    Box,
    Gaussian,
    /// Gamma of shape 4: a long tail towards large amplitudes, dampings and frequencies.
    Skewed,
    /// Student's t of 5 degrees of freedom.
    Heavy,
    /// Every channel keeps its own, all its life.
    Lasting,
    /// Seven channels of ten of one make, three of another.
    TwoPopulations,
    /// Most of the scatter is one cause that moves all three.
    Correlated,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scatter {
    pub shape: Shape,
    pub width: f64,
}

impl Scatter {
    pub const BOX: Scatter = Scatter { shape: Shape::Box, width: 1.0 };

    pub fn features(self, plant: &Plant, seed: u64, channel: usize, rng: &mut Random) -> Features {
        let units = match self.shape {
            Shape::Lasting => gaussian(&mut random(seed, 1_000_000 + channel as u64)),
            shape => shape.units(rng),
        };
        let centre = plant.healthy.centre();
        let [amplitude, damping, frequency] = units.map(|unit| self.width * unit);
        Features {
            amplitude: centre.amplitude + plant.healthy.amplitude.sd() * amplitude,
            damping_per_s: centre.damping_per_s + plant.healthy.damping_per_s.sd() * damping,
            frequency_hz: centre.frequency_hz + plant.healthy.frequency_hz.sd() * frequency,
            ..centre
        }
    }
}

impl Shape {
    /// Mean 0 and variance 1 each.
    fn units(self, rng: &mut Random) -> [f64; 3] {
        match self {
            Shape::Box => {
                let half = 3_f64.sqrt();
                [(); 3].map(|()| rng.random_range(-half..=half))
            }
            Shape::Gaussian | Shape::Lasting => gaussian(rng),
            Shape::Skewed => {
                let gamma = Gamma::new(4.0, 1.0).unwrap();
                [(); 3].map(|()| (gamma.sample(rng) - 4.0) / 2.0)
            }
            Shape::Heavy => {
                let student = StudentT::new(5.0).unwrap();
                [(); 3].map(|()| student.sample(rng) * 0.6_f64.sqrt())
            }
            Shape::TwoPopulations => {
                let (share, within): (f64, f64) = (0.7, 0.35);
                let apart = (1.0 - within * within).sqrt();
                let centre = match rng.random_bool(share) {
                    true => apart * ((1.0 - share) / share).sqrt(),
                    false => -apart * (share / (1.0 - share)).sqrt(),
                };
                gaussian(rng).map(|unit| centre + within * unit)
            }
            Shape::Correlated => {
                let cause: f64 = StandardNormal.sample(rng);
                let own = gaussian(rng);
                let moves = [1.0, -1.0, 1.0].map(|sign: f64| sign * 0.8_f64.sqrt() * cause);
                std::array::from_fn(|i| moves[i] + 0.2_f64.sqrt() * own[i])
            }
        }
    }
}

fn gaussian(rng: &mut Random) -> [f64; 3] {
    [(); 3].map(|()| StandardNormal.sample(rng))
}

impl fmt::Display for Scatter {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let shape = match self.shape {
            Shape::Box => "box",
            Shape::Gaussian => "Gaussian",
            Shape::Skewed => "skewed (gamma)",
            Shape::Heavy => "heavy (Student 5)",
            Shape::Lasting => "lasting per channel, Gaussian",
            Shape::TwoPopulations => "two populations",
            Shape::Correlated => "correlated",
        };
        write!(f, "{shape} {}", self.width)
    }
}
