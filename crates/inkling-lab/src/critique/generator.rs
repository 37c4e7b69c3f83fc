//! Simulates small recordings with one known effect, for the unit tests of this room. (The generator of
//! `tests/foreign`, by which the critique is judged, is other code.)
//!
//! In: [`Run`], the sizes and the planted effect; a seed. Out: [`Observations`] of whole counts. The
//! channel's ring is in closed form, or from the integrator of `unmodelled.rs` for an effect in the equation of
//! motion. The end of the file holds tests of the whole critique on such runs.

use super::catalogue::CauseId;
use super::observations::{Observations, Sampler};
use crate::critique::unmodelled::{Interior, ObservedDecay, Term};
use inkling_core::burst::Beside;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::TAU;

#[derive(Clone, Debug)]
pub struct Run {
    pub channels: usize,
    pub bursts: usize,
    pub samples: usize,
    /// Standard deviation of the white noise, counts.
    pub noise: f64,
    /// Relative scatter between channels (half-widths of uniform distributions) of stiffness, damping, gain.
    pub spread: [f64; 3],
    /// Relative standard deviation, from signal to signal, of the gain and of each of the amplitudes a, b, c.
    pub shot: f64,
    pub effect: Option<CauseId>,
    /// Its size, in most cases the catalogue's parameter in its unit. Tone and random tone have an amplitude in
    /// counts instead, a jitter a standard deviation in signal lengths, and quadratic drag and cubic stiffness
    /// the strength of their term in `unmodelled.rs` at unit drive.
    pub size: f64,
    /// Whether 3 % of the noise samples are five times as large.
    pub heavy: bool,
    /// Number of channels, the first ones, that ring faultily.
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
            effect: None,
            size: 0.0,
            heavy: false,
            faulty: 0,
        }
    }
}

/// Draws the signals of a run: one signal each 10 ms, the channels in turn, so that each signal is a burst of
/// its own with its own drive (15 to 30 V), temperature, idle time and number of neighbours.
pub fn draw(run: &Run, seed: u64) -> Observations {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let normal = |rng: &mut ChaCha8Rng| -> f64 { StandardNormal.sample(rng) };
    let n = run.samples;
    let mut sampler = Sampler::new(100e-6 / 128.0, usize::MAX);
    let e = |id: CauseId| if run.effect == Some(id) { run.size } else { 0.0 };
    let channels: Vec<[f64; 3]> = (0..run.channels)
        .map(|_| run.spread.map(|w| 1.0 + w * rng.random_range(-1.0..1.0)))
        .collect();
    let tone_phase = rng.random_range(0.0..TAU);
    let tone_omega = TAU * rng.random_range(9.0..40.0);
    for burst in 0..run.bursts * run.channels {
        // what is recorded beside the signal; time and position go from -0.5 to 0.5
        let channel = burst % run.channels;
        let time = burst as f64 / (run.bursts * run.channels - 1) as f64 - 0.5;
        let [k, d, g] = channels[channel];
        let drive: f64 = rng.random_range(15.0..30.0);
        let s = drive / 22.5;
        let temperature = 25.0 + 3.0 * normal(&mut rng);
        let neighbours = f64::from(rng.random_range(0..3_u8));
        let idle = 10f64.powf(rng.random_range(-4.3..-3.0));
        let position = channel as f64 / (run.channels - 1).max(1) as f64 - 0.5;
        let loss = d
            * (1.0 + e(CauseId::Temperature) * (temperature - 25.0))
            * (1.0 + e(CauseId::Ageing) * time);
        let stiff = k.sqrt() * (1.0 + e(CauseId::PositionGradient) * position);
        // rates per signal length, for signals of 128 samples those of the design (64.7 kHz, 100 µs)
        let scale = n as f64 / 128.0;
        let seen = ObservedDecay {
            sigma: 2.917 * loss * scale,
            omega: 40.65 * stiff * scale,
            lambda: 3.767 * loss * scale,
            a: 90.0,
            b: -40.0,
            c: 0.3,
        };
        let gain = s * g * (1.0 + run.shot * normal(&mut rng));
        let mut shot = || 1.0 + run.shot * normal(&mut rng);
        let (a, b, c) = (seen.a * shot(), seen.b * shot(), seen.c * shot());
        let shift = e(CauseId::TriggerJitter) * normal(&mut rng); // in signal lengths
        // the ring at time t in signal lengths, without the gain
        let at = |t: f64| {
            (-seen.sigma * t).exp() * (a * (seen.omega * t).cos() + b * (seen.omega * t).sin())
                + c * (-seen.lambda * t).exp()
        };
        let phase = rng.random_range(0.0..TAU);
        let faulty = channel < run.faulty;
        // the run's strength is relative to unit drive, the term's to this signal's amplitude
        let strength = match run.effect {
            Some(CauseId::QuadraticDrag) => Some(run.size * gain),
            Some(CauseId::CubicStiffness) => Some(run.size * gain * gain),
            _ => None,
        };
        let term = run.effect.zip(strength).map(|(id, strength)| Term { id, strength, place: 0.0 });
        let mut y: Vec<f64> = match term {
            Some(_) => {
                let seen = ObservedDecay { a: a * gain, b: b * gain, c: c * gain, ..seen };
                Interior::ink(&seen, 0.2).unwrap().decay(term, 1.0, n)
            }
            None => (0..n).map(|k| gain * at(k as f64 / n as f64 + shift)).collect(),
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
        let mut previous = normal(&mut rng);
        for (k, y) in y.iter_mut().enumerate() {
            let t = k as f64 / n as f64;
            *y += e(CauseId::Offset)
                + e(CauseId::Tone) * (tone_omega * t + tone_phase).cos()
                + e(CauseId::RandomTone) * (tone_omega * t + phase).cos();
            let white = normal(&mut rng);
            let rho = e(CauseId::CorrelatedNoise);
            previous = rho * previous + (1.0 - rho * rho).sqrt() * white;
            let mut noise = run.noise * previous;
            if run.heavy && rng.random::<f64>() < 0.03 {
                noise *= 5.0;
            }
            if run.effect == Some(CauseId::HeteroscedasticNoise) {
                noise *= (1.0 + run.size * (*y / 150.0).powi(2)).sqrt();
            }
            *y += noise;
            if run.effect == Some(CauseId::Clipping) {
                *y = y.min(run.size);
            }
            if run.effect == Some(CauseId::CoarseLsb) {
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

/// Asserts that p-values are uniform, by a Kolmogorov-Smirnov test at 99 %.
pub fn assert_uniform(mut p: Vec<f64>) {
    p.sort_by(f64::total_cmp);
    let n = p.len() as f64;
    for (k, p) in p.iter().enumerate() {
        let share = (k as f64 + 0.5) / n;
        assert!((p - share).abs() < 1.63 / n.sqrt(), "{share}: {p}");
    }
}

pub fn criticised(data: &Observations) -> super::finding::Critique {
    let rings = super::engine::Rings::InkChannel;
    super::engine::critique(data, rings, false).unwrap().critique
}

#[test]
fn a_right_model_is_left_alone() {
    use super::finding::Verdict;
    let small = Run { channels: 24, bursts: 5, ..Run::default() };
    for seed in [1, 2] {
        assert_eq!(criticised(&draw(&small, seed)).verdict, Verdict::None, "seed {seed}");
    }
    let heavy = Run { heavy: true, faulty: 1, ..small.clone() };
    assert_eq!(criticised(&draw(&heavy, 3)).verdict, Verdict::None);
}

#[test]
fn covariates_that_follow_each_other_tie() {
    let effect = Some(CauseId::Ageing);
    let run = Run { effect, size: 0.2, channels: 24, bursts: 5, ..Run::default() };
    let mut data = draw(&run, 5);
    for row in &mut data.rows {
        row.beside.temperature_c = 20.0 + row.beside.t_acq_ns as f64 * 1e-9;
    }
    let critique = criticised(&data.standardised());
    assert_eq!(critique.verdict, super::finding::Verdict::Tie, "{:?}", critique.causes);
}

/// A twentieth of the own ring for each neighbour, a third of a period behind.
#[test]
fn a_neighbours_ring_is_told_with_its_share_and_its_phase() {
    let plain = draw(&Run { channels: 24, bursts: 5, ..Run::default() }, 6);
    let mut heard = Sampler::new(plain.dt_s, usize::MAX);
    for (i, row) in plain.rows.iter().enumerate() {
        let of = 0.05 * row.beside.neighbours * row.beside.drive_v / 22.5;
        let y = plain.signal(i).iter().enumerate().map(|(k, y)| {
            let t = k as f64 / plain.samples as f64;
            let turned = 40.65 * t - TAU / 3.0;
            let ring = (-2.917 * t).exp() * (90.0 * turned.cos() - 40.0 * turned.sin());
            (f64::from(*y) + of * ring).round()
        });
        heard.offer("p", row.beside, &y.collect::<Vec<f64>>());
    }
    let critique = criticised(&heard.finish());
    let [cause] = &critique.causes[..] else { panic!("{:?}", critique.causes) };
    assert_eq!(cause.id, CauseId::Crosstalk);
    assert!((cause.value - 0.05).abs() < 0.005, "{}", cause.sentence);
    assert!(cause.ci95[0] < 0.05 && 0.05 < cause.ci95[1], "{:?}", cause.ci95);
    let told = cause.sentence.strip_suffix("° behind the own ring").unwrap();
    let degrees: f64 = told.rsplit(' ').next().unwrap().parse().unwrap();
    assert!((degrees - 120.0).abs() < 6.0, "{}", cause.sentence);
}
