//! A ring, and when it is sampled.

use std::f64::consts::TAU;

#[derive(Clone, Copy, Debug)]
pub struct Sampling {
    pub samples: usize,
    pub period_s: f64,
}

impl Sampling {
    pub fn times(self) -> impl Iterator<Item = f64> {
        (0..self.samples).map(move |k| k as f64 * self.period_s)
    }

    pub fn duration_s(self) -> f64 {
        self.samples as f64 * self.period_s
    }
}

/// One damped oscillation and a real pole that begins with it.
#[derive(Clone, Copy, Debug)]
pub struct Ring {
    pub amplitude: f64,
    pub damping_per_s: f64,
    pub frequency_hz: f64,
    pub phase_rad: f64,
    /// Of the amplitude.
    pub pole_share: f64,
    pub pole_per_s: f64,
    /// A second mode of a fixed multiple of its frequency, of the amplitude.
    pub overtone: f64,
}

/// Of the second mode's frequency.
const OVERTONE_FACTOR: f64 = 2.7;

impl Ring {
    pub fn omega(&self) -> f64 {
        TAU * self.frequency_hz
    }

    pub fn at(&self, t_s: f64) -> f64 {
        let angle = self.omega() * t_s;
        let shape =
            (angle + self.phase_rad).cos() + self.overtone * (OVERTONE_FACTOR * angle).sin();
        let oscillation = (-self.damping_per_s * t_s).exp() * shape;
        self.amplitude * (oscillation + self.pole_share * (-self.pole_per_s * t_s).exp())
    }

    pub fn sampled(&self, sampling: Sampling) -> Vec<f64> {
        sampling.times().map(|t| self.at(t)).collect()
    }
}
