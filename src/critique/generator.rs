//! Signals with a known effect, for this room's own tests and tuning (the hidden plants of `tests/`
//! are other code). Closed-form decays per channel; physical terms by their integrator.

use super::covariates::Covariates;
use super::model::Model;
use super::observations::{Beside, Observations, Sampler};
use super::selection;
use crate::model::terms::{Interior, Seen, Term};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::TAU;

#[derive(Clone, Debug)]
pub struct Run {
    pub channels: usize,
    pub bursts: usize,
    pub samples: usize,
    pub noise: f64,
    /// Relative scatter between channels (uniform half-widths): stiffness, damping, gain.
    pub spread: [f64; 3],
    /// Burst to burst, relative: gain and state.
    pub shot: f64,
    pub effect: &'static str,
    pub size: f64,
    pub heavy: bool,
    pub faulty: usize,
}

impl Default for Run {
    fn default() -> Run {
        Run {
            channels: 32,
            bursts: 6,
            samples: 128,
            noise: 2.0,
            spread: [0.004, 0.06, 0.025],
            shot: 0.004,
            effect: "none",
            size: 0.0,
            heavy: false,
            faulty: 0,
        }
    }
}

pub fn draw(run: &Run, seed: u64) -> Observations {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let normal = |rng: &mut ChaCha8Rng| -> f64 { StandardNormal.sample(rng) };
    let n = run.samples;
    let mut sampler = Sampler::new(100e-6 / 128.0, n, usize::MAX);
    let e = |id: &str| if run.effect == id { run.size } else { 0.0 };
    let channels: Vec<[f64; 3]> = (0..run.channels)
        .map(|_| run.spread.map(|w| 1.0 + w * rng.random_range(-1.0..1.0)))
        .collect();
    let tone_phase = rng.random_range(0.0..TAU);
    let tone_omega = TAU * rng.random_range(9.0..40.0);
    for burst in 0..run.bursts * run.channels {
        let channel = burst % run.channels;
        let time = burst as f64 / (run.bursts * run.channels - 1) as f64 - 0.5;
        let [k, d, g] = channels[channel];
        let drive: f64 = rng.random_range(15.0..30.0);
        let s = drive / 22.5;
        let temperature = 25.0 + 3.0 * normal(&mut rng);
        let neighbours = f64::from(rng.random_range(0..3_u8));
        let idle = 10f64.powf(rng.random_range(-4.3..-3.0));
        let position = channel as f64 / (run.channels - 1).max(1) as f64 - 0.5;
        let loss = d * (1.0 + e("temperature") * (temperature - 25.0)) * (1.0 + e("ageing") * time);
        let clock = 1.0 + e("clock_drift") * time;
        let stiff = k.sqrt() * (1.0 + e("position_gradient") * position);
        let scale = n as f64 / 128.0;
        let seen = Seen {
            sigma: 2.917 * loss * clock * scale,
            omega: 40.65 * stiff * clock * scale,
            lambda: 3.767 * loss * clock * scale,
            a: 90.0,
            b: -40.0,
            c: 5.0,
        };
        let gain = s
            * g
            * (1.0 + run.shot * normal(&mut rng))
            * (1.0 + e("crosstalk") * neighbours);
        let mut shot = || 1.0 + run.shot * normal(&mut rng);
        let (a, b, c) = (seen.a * shot(), seen.b * shot(), seen.c * shot());
        let shift = e("trigger_jitter") * normal(&mut rng); // in signal lengths
        let at = |t: f64| {
            (-seen.sigma * t).exp() * (a * (seen.omega * t).cos() + b * (seen.omega * t).sin())
                + c * (-seen.lambda * t).exp()
        };
        let phase = rng.random_range(0.0..TAU);
        let faulty = channel < run.faulty;
        let mut y: Vec<f64> = match run.effect {
            "quadratic_drag" | "dry_friction" | "cubic_stiffness" | "meniscus"
            | "fractional_damping" => {
                let term = match run.effect {
                    "quadratic_drag" => Term::QuadraticDrag,
                    "dry_friction" => Term::DryFriction,
                    "cubic_stiffness" => Term::CubicStiffness,
                    "meniscus" => Term::Meniscus,
                    _ => Term::FractionalDamping,
                };
                let seen = Seen { a: a * gain, b: b * gain, c: c * gain, ..seen };
                let interior = Interior::ink(&seen, 0.2).unwrap();
                // strengths are relative to unit drive
                let strength = match term {
                    Term::QuadraticDrag => run.size * gain,
                    Term::CubicStiffness => run.size * gain * gain,
                    Term::DryFriction => run.size / gain,
                    _ => run.size,
                };
                interior.decay(&seen, Some((term, strength)), 1.0, n)
            }
            _ => (0..n).map(|k| gain * at(k as f64 / n as f64 + shift)).collect(),
        };
        if faulty {
            let sigma = 1.6 * seen.sigma;
            y = (0..n)
                .map(|k| {
                    let t = k as f64 / n as f64;
                    0.8 * gain * (-sigma * t).exp() * (a * (seen.omega * t).cos() + b * (seen.omega * t).sin())
                })
                .collect();
        }
        if run.effect == "droop" {
            let w = run.size / n as f64;
            let mut x = 0.0;
            let clean = y.clone();
            for k in 0..n {
                if k > 0 {
                    x = x * (-w).exp() + 0.5 * (clean[k] + clean[k - 1]);
                }
                y[k] = clean[k] - w * x;
            }
        }
        if run.effect == "previous_tail" {
            let shift = idle / 100e-6;
            y.iter_mut().enumerate().for_each(|(k, y)| {
                *y += run.size * gain * at(k as f64 / n as f64 + shift);
            });
        }
        let first = y[0];
        let mut previous = normal(&mut rng);
        for (k, y) in y.iter_mut().enumerate() {
            let t = k as f64 / n as f64;
            *y += e("offset")
                + e("tone") * (tone_omega * t + tone_phase).cos()
                + e("random_tone") * (tone_omega * t + phase).cos()
                + s * e("second_mode") * (-3.0 * t).exp() * (75.0 * t + 0.7).cos()
                + e("lowpass") * first * (-60.0 * t).exp();
            let white = normal(&mut rng);
            let rho = e("correlated_noise");
            previous = rho * previous + (1.0 - rho * rho).sqrt() * white;
            let mut noise = run.noise * previous;
            if run.heavy && rng.random::<f64>() < 0.03 {
                noise *= 5.0;
            }
            if run.effect == "heteroscedastic_noise" {
                noise *= (1.0 + run.size * (*y / 150.0).powi(2)).sqrt();
            }
            *y += noise;
            if run.effect == "clipping" {
                *y = y.min(run.size);
            }
            if run.effect == "coarse_lsb" {
                *y = (*y / run.size).round() * run.size;
            }
            *y = y.round();
        }
        sampler.offer(
            "p",
            Beside {
                channel: channel as u32,
                t_acq_ns: burst as i64 * 10_000_000,
                drive_v: drive,
                temperature_c: temperature,
                idle_s: idle,
                neighbours,
            },
            &y,
        );
    }
    sampler.finish()
}

/// Strengths near one or two detection limits.
const EFFECTS: [(&str, f64); 15] = [
    ("offset", 0.2),
    ("droop", 0.2),
    ("meniscus", 0.05),
    ("lowpass", 0.03),
    ("second_mode", 0.6),
    ("quadratic_drag", 0.1),
    ("dry_friction", 0.1),
    ("cubic_stiffness", 0.01),
    ("tone", 0.2),
    ("previous_tail", 0.3),
    ("crosstalk", 0.02),
    ("temperature", 0.006),
    ("ageing", 0.06),
    ("position_gradient", 0.005),
    ("clock_drift", 0.005),
];

/// Prints what the selection says: for tuning, `cargo test --lib critique::generator -- --ignored`.
#[test]
#[ignore = "prints a table for tuning"]
fn tuning_table() {
    let seeds: u64 = std::env::var("SEEDS").ok().and_then(|s| s.parse().ok()).unwrap_or(2);
    let only = std::env::var("ONLY").unwrap_or_default();
    let times: f64 = std::env::var("TIMES").ok().and_then(|s| s.parse().ok()).unwrap_or(1.0);
    let mut effects = vec![("none", 0.0)];
    effects.extend(EFFECTS);
    for (effect, size) in effects {
        if !only.is_empty() && !only.split(',').any(|o| o == effect) {
            continue;
        }
        for seed in 0..seeds {
            let run = Run { effect, size: size * times, ..Run::default() };
            let data = draw(&run, 1000 + seed);
            let started = std::time::Instant::now();
            let beside = Covariates::of(&data);
            let mut model = Model::start(&data, &beside, true).unwrap();
            model.fit(&data, &beside, 2);
            let selected = selection::select(model, &data, &beside, &mut |_| {});
            let said: Vec<String> = selected
                .causes
                .iter()
                .map(|c| {
                    format!(
                        "{} {:.4}±{:.4} (DL {:.1}) tied {:?}",
                        c.scored.applied.id,
                        c.scored.value,
                        c.scored.sd,
                        (c.statistic / 20.9).sqrt(),
                        c.tied_with
                    )
                })
                .collect();
            let top: Vec<String> = selected
                .evidence
                .iter()
                .filter(|e| e.step == 0)
                .take(3)
                .map(|e| format!("{}:{:.1}", e.id, -e.p.ln()))
                .collect();
            println!(
                "{effect:<20} {:.4} | {} | {} | {:.1}s noise {:.3}",
                run.size,
                said.join("; "),
                top.join(" "),
                started.elapsed().as_secs_f64(),
                selected.model.noise_var.sqrt()
            );
        }
    }
}
