//! Ten ways in which every signal, healthy or faulty, differs from what the model says.

use super::ring::{Ring, Sampling};
use clap::ValueEnum;
use std::f64::consts::{FRAC_PI_4, PI, TAU};

#[derive(Clone, Copy, Debug, PartialEq, ValueEnum)]
pub enum ModelError {
    SecondMode,
    SensorTransient,
    AmplifierDroop,
    OffsetWithAmplitude,
    QuadraticDrag,
    CubicStiffness,
    HalfOrderDamping,
    ToneOfTrigger,
    /// Of the plant's noise, not of its rings.
    RememberingNoise,
    AmplifierCompression,
}

/// Between two samples, where a force depends on the motion.
const STEPS_PER_SAMPLE: usize = 4;

impl ModelError {
    /// `typical` is a healthy ring: it says what is large and what is fast.
    pub fn sampled(self, ring: &Ring, typical: &Ring, sampling: Sampling) -> Vec<f64> {
        let mut y = match self {
            ModelError::QuadraticDrag
            | ModelError::CubicStiffness
            | ModelError::HalfOrderDamping => self.forced(ring, typical, sampling),
            _ => ring.sampled(sampling),
        };
        match self {
            ModelError::SecondMode => {
                let second = Ring {
                    amplitude: 0.05 * ring.amplitude,
                    damping_per_s: 1.5 * ring.damping_per_s,
                    frequency_hz: 2.3 * typical.frequency_hz,
                    phase_rad: 1.1,
                    pole_share: 0.0,
                    ..*ring
                };
                y.iter_mut().zip(second.sampled(sampling)).for_each(|(y, more)| *y += more);
            }
            ModelError::SensorTransient => {
                let (mut sensed, keeps) = (0.0, (-1.0_f64 / 2.0).exp()); // two samples' memory
                for y in &mut y {
                    sensed = keeps * sensed + (1.0 - keeps) * *y;
                    *y = sensed;
                }
            }
            ModelError::AmplifierDroop => {
                let (mut lost, share) = (0.0, 1.0 / sampling.samples as f64);
                for y in &mut y {
                    let left = *y - lost;
                    lost += share * left;
                    *y = left;
                }
            }
            ModelError::OffsetWithAmplitude => {
                y.iter_mut().for_each(|y| *y += 0.03 * ring.amplitude)
            }
            ModelError::ToneOfTrigger => {
                let omega = TAU * 1.7 * typical.frequency_hz;
                for (y, t) in y.iter_mut().zip(sampling.times()) {
                    *y += 0.03 * typical.amplitude * (omega * t + 0.7).cos();
                }
            }
            ModelError::AmplifierCompression => {
                let knee = 3.0 * typical.amplitude;
                y.iter_mut().for_each(|y| *y = knee * (*y / knee).tanh());
            }
            ModelError::QuadraticDrag
            | ModelError::CubicStiffness
            | ModelError::HalfOrderDamping
            | ModelError::RememberingNoise => {}
        }
        y
    }

    /// The exact ring between kicks of a force that depends on the motion.
    fn forced(self, ring: &Ring, typical: &Ring, sampling: Sampling) -> Vec<f64> {
        let (omega, h) = (ring.omega(), sampling.period_s / STEPS_PER_SAMPLE as f64);
        let (turn, shrink) = ((omega * h).sin_cos(), (-ring.damping_per_s * h).exp());
        // the oscillation is the real part of a pointer that turns and shrinks
        let (mut re, mut im) =
            (ring.amplitude * ring.phase_rad.cos(), ring.amplitude * ring.phase_rad.sin());
        let start = re;
        let (mut history, weights) =
            (Vec::new(), half_derivative(sampling.samples * STEPS_PER_SAMPLE));
        let mut y = Vec::with_capacity(sampling.samples);
        for step in 0..sampling.samples * STEPS_PER_SAMPLE {
            if step % STEPS_PER_SAMPLE == 0 {
                let t = step as f64 * h;
                y.push(re + ring.amplitude * ring.pole_share * (-ring.pole_per_s * t).exp());
            }
            (re, im) = (shrink * (re * turn.1 - im * turn.0), shrink * (re * turn.0 + im * turn.1));
            let velocity = -ring.damping_per_s * re - omega * im;
            let force = match self {
                ModelError::QuadraticDrag => {
                    // a tenth more damping where a typical ring begins
                    let drag = 0.1 * typical.damping_per_s * 0.75 * PI
                        / (typical.omega() * typical.amplitude);
                    -drag * velocity.abs() * velocity
                }
                ModelError::CubicStiffness => {
                    // 1.5 % more resonance where a typical ring begins
                    let stiffness =
                        0.015 * typical.omega().powi(2) * (8.0 / 3.0) / typical.amplitude.powi(2);
                    -stiffness * re.powi(3)
                }
                _ => {
                    history.push(re - start);
                    let size = 2.0 * 0.15 * typical.damping_per_s * typical.omega().sqrt()
                        / FRAC_PI_4.sin();
                    let latest_first = history.iter().rev().zip(&weights);
                    -size * latest_first.map(|(x, weight)| weight * x).sum::<f64>() / h.sqrt()
                }
            };
            im -= h * force / omega;
        }
        y
    }
}

/// Gruenwald and Letnikov's weights of the last `n` values, the latest first.
fn half_derivative(n: usize) -> Vec<f64> {
    let mut weights = vec![1.0; n];
    (1..n).for_each(|j| weights[j] = weights[j - 1] * (1.0 - 1.5 / j as f64));
    weights
}
