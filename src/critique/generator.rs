//! Signals with a known effect, for this room's own tests and tuning (the hidden plants of `tests/`
//! are other code). Closed-form decays per channel; physical terms by their integrator.

use super::observations::{Observations, Sampler};
use crate::burst::Beside;
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
            c: 0.3,
        };
        let gain =
            s * g * (1.0 + run.shot * normal(&mut rng)) * (1.0 + e("crosstalk") * neighbours);
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
                    0.8 * gain
                        * (-sigma * t).exp()
                        * (a * (seen.omega * t).cos() + b * (seen.omega * t).sin())
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
const EFFECTS: [(&str, f64); 22] = [
    ("offset", 0.15),
    ("droop", 0.5),
    ("meniscus", 0.01),
    ("lowpass", 0.02),
    ("second_mode", 0.5),
    ("quadratic_drag", 0.04),
    ("dry_friction", 0.01),
    ("cubic_stiffness", 0.002),
    ("fractional_damping", 0.2),
    ("tone", 0.15),
    ("random_tone", 0.3),
    ("trigger_jitter", 0.0005),
    ("clipping", 120.0),
    ("coarse_lsb", 2.0),
    ("previous_tail", 0.1),
    ("crosstalk", 0.01),
    ("temperature", 0.006),
    ("ageing", 0.06),
    ("position_gradient", 0.008),
    ("clock_drift", 0.003),
    ("correlated_noise", 0.05),
    ("heteroscedastic_noise", 0.5),
];

fn said(critique: &super::finding::Critique) -> String {
    let causes: Vec<String> = critique
        .causes
        .iter()
        .map(|c| {
            format!(
                "{} {:.4e} [{:.3e}, {:.3e}] DL {:.1} {:?}",
                c.id, c.value, c.ci95[0], c.ci95[1], c.strength_dl, c.tied_with
            )
        })
        .collect();
    format!("{} | {} | {:?}", critique.verdict.as_str(), causes.join("; "), critique.remarks)
}

/// For tuning: `SEEDS=3 ONLY=offset,tone TIMES=2 cargo test --release critique::generator -- --ignored --nocapture`.
#[test]
#[ignore = "prints a table for tuning"]
fn tuning_table() {
    let number = |name: &str, default: f64| -> f64 {
        std::env::var(name).ok().and_then(|s| s.parse().ok()).unwrap_or(default)
    };
    let only = std::env::var("ONLY").unwrap_or_default();
    let mut effects = vec![("none", 0.0)];
    effects.extend(EFFECTS);
    for (effect, size) in effects {
        if !only.is_empty() && !only.split(',').any(|o| o == effect) {
            continue;
        }
        let (mut seconds, mut named) = (0.0, 0);
        for seed in 0..number("SEEDS", 2.0) as u64 {
            let scaled = match effect {
                "clipping" => size,
                _ => size * number("TIMES", 1.0),
            };
            let run = Run {
                effect,
                size: scaled,
                channels: number("CHANNELS", 32.0) as usize,
                bursts: number("BURSTS", 6.0) as usize,
                heavy: number("HEAVY", 0.0) > 0.0,
                faulty: number("FAULTY", 0.0) as usize,
                spread: [number("STIFF", 0.004), 0.06, 0.025],
                ..Run::default()
            };
            let data = draw(&run, number("SEED", 1000.0) as u64 + seed);
            let started = std::time::Instant::now();
            let outcome = super::engine::critique(
                &data,
                super::engine::Rings::InkChannel,
                false,
                &mut |_| {},
            )
            .unwrap();
            seconds += started.elapsed().as_secs_f64();
            let verdict = said(&outcome.critique);
            if effect == "none" && verdict.starts_with("none") {
                named += 1;
                continue;
            }
            let mut top: Vec<_> =
                outcome.critique.evidence.iter().filter(|e| e.step == 0).collect();
            top.sort_by(|p, q| p.p.total_cmp(&q.p));
            let top: Vec<String> = top
                .iter()
                .take(3)
                .map(|e| format!("{}:{:.1}", e.id, -e.p.max(1e-300).ln()))
                .collect();
            println!("{effect:<20} {scaled:.4} | {verdict} | {}", top.join(" "));
        }
        println!("{effect}: {seconds:.1} s, {named} none");
    }
}

/// Verdict and names of a run.
fn names(run: &Run, seed: u64) -> (super::finding::Verdict, Vec<super::finding::Cause>) {
    let data = draw(run, seed);
    let rings = super::engine::Rings::InkChannel;
    let critique = super::engine::critique(&data, rings, false, &mut |_| {}).unwrap().critique;
    (critique.verdict, critique.causes)
}

#[test]
fn a_right_model_is_left_alone_and_a_wrong_one_is_named_with_its_size() {
    use super::finding::Verdict;
    let small = Run { channels: 24, bursts: 5, ..Run::default() };
    for seed in [1, 2] {
        assert_eq!(names(&small, seed).0, Verdict::None, "seed {seed}");
    }
    let heavy = Run { heavy: true, faulty: 1, ..small.clone() };
    assert_eq!(names(&heavy, 3).0, Verdict::None);
    for (effect, size, within) in [("offset", 0.6, 0.15), ("temperature", 0.02, 0.004)] {
        let (verdict, causes) = names(&Run { effect, size, ..small.clone() }, 4);
        assert_eq!((verdict, causes.len()), (Verdict::Named, 1), "{effect}: {causes:?}");
        assert_eq!(causes[0].id, effect);
        assert!((causes[0].value - size).abs() < within, "{effect}: {}", causes[0].value);
    }
}

#[test]
fn covariates_that_follow_each_other_tie() {
    let run = Run { effect: "ageing", size: 0.2, channels: 24, bursts: 5, ..Run::default() };
    let mut data = draw(&run, 5);
    for row in &mut data.rows {
        row.beside.temperature_c = 20.0 + row.beside.t_acq_ns as f64 * 1e-9;
    }
    let rings = super::engine::Rings::InkChannel;
    let critique = super::engine::critique(&data, rings, false, &mut |_| {}).unwrap().critique;
    assert_eq!(critique.verdict, super::finding::Verdict::Tie, "{:?}", critique.causes);
}
