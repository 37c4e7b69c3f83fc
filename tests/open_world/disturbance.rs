//! What sensors, amplifiers, cables and neighbours add to a healthy ring, of any size.

use super::plant::{Plant, Random};
use super::ring::Ring;
use super::unexplained;
use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::TAU;

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Disturbance {
    Offset,
    Step,
    Ramp,
    OddSample,
    TwoOddSamples,
    FiveOddSamples,
    LowTone,
    ToneNearRing,
    HighTone,
    Hum,
    SquareWave,
    WhiteNoise,
    NoiseInPart,
    RememberingNoise,
    Wander,
    Clipping,
    CoarseSteps,
    LostSamples,
    Crosstalk,
    TwoRings,
    Beat,
    Chirp,
    Modulation,
}

/// One draw of a disturbance, its size still open.
enum Pattern {
    /// So many times this.
    Added(Vec<f64>),
    /// So much of the height is cut.
    Clipped,
    /// Steps of this size.
    Coarse,
    /// From a sample on the ring is so many samples older.
    Later(usize),
    /// The frequency sweeps over so much of itself.
    Sweeping,
}

impl Disturbance {
    pub const ALL: [Disturbance; 23] = {
        use Disturbance::*;
        [
            Offset,
            Step,
            Ramp,
            OddSample,
            TwoOddSamples,
            FiveOddSamples,
            LowTone,
            ToneNearRing,
            HighTone,
            Hum,
            SquareWave,
            WhiteNoise,
            NoiseInPart,
            RememberingNoise,
            Wander,
            Clipping,
            CoarseSteps,
            LostSamples,
            Crosstalk,
            TwoRings,
            Beat,
            Chirp,
            Modulation,
        ]
    };

    /// A healthy ring, disturbed so that `x` noise variances are left unexplained, in noise.
    /// `None`: this draw cannot be made so large.
    pub fn signal(
        self,
        healthy: &Ring,
        x: f64,
        plant: &Plant,
        rng: &mut Random,
    ) -> Option<Vec<f32>> {
        let base = plant.clean(healthy);
        let pattern = self.pattern(healthy, &base, plant, rng);
        let noise = plant.noise_counts();
        let left = |size: f64| {
            let y = pattern.of_size(size, healthy, &base, plant);
            unexplained::energy(&y, healthy, plant.sampling(), noise)
        };
        let size = size_of(x, left, pattern.first_guess(noise), pattern.most())?;
        let mut y = pattern.of_size(size, healthy, &base, plant);
        plant.add_noise(&mut y, rng);
        pattern.after_noise(size, &base, &mut y);
        Some(plant.recorded(y))
    }

    fn pattern(self, healthy: &Ring, base: &[f64], plant: &Plant, rng: &mut Random) -> Pattern {
        let n = plant.samples;
        let times: Vec<f64> = plant.sampling().times().collect();
        let sign = |rng: &mut Random| if rng.random_bool(0.5) { 1.0 } else { -1.0 };
        // per cycle of the healthy resonance: the same on any scale of time
        let tone = |low: f64, high: f64, rng: &mut Random| -> Vec<f64> {
            let omega = healthy.omega() * rng.random_range(low.ln()..high.ln()).exp();
            let phase = rng.random_range(0.0..TAU);
            times.iter().map(|t| (omega * t + phase).cos()).collect()
        };
        Pattern::Added(match self {
            Disturbance::Offset => vec![sign(rng); n],
            Disturbance::Step => {
                let from = middle(n, rng);
                (0..n).map(|k| f64::from(k >= from)).collect()
            }
            Disturbance::Ramp => (0..n).map(|k| k as f64 / n as f64).collect(),
            Disturbance::OddSample => odd_samples(n, 1, rng),
            Disturbance::TwoOddSamples => odd_samples(n, 2, rng),
            Disturbance::FiveOddSamples => odd_samples(n, 5, rng),
            Disturbance::LowTone => tone(0.3, 0.8, rng),
            Disturbance::ToneNearRing => tone(0.8, 1.4, rng),
            Disturbance::HighTone => tone(1.4, 6.2, rng),
            Disturbance::Hum => tone(0.001, 0.08, rng),
            Disturbance::SquareWave => tone(0.3, 4.0, rng).into_iter().map(f64::signum).collect(),
            Disturbance::WhiteNoise => remembering(n, 0.0, rng),
            Disturbance::NoiseInPart => {
                let length = rng.random_range(n / 8..n / 3);
                let from = rng.random_range(0..n - length);
                let part = from..from + length;
                let noise = remembering(n, 0.0, rng).into_iter().enumerate();
                noise.map(|(k, v)| if part.contains(&k) { v } else { 0.0 }).collect()
            }
            Disturbance::RememberingNoise => remembering(n, 0.9, rng),
            Disturbance::Wander => remembering(n, 1.0, rng),
            Disturbance::Clipping => return Pattern::Clipped,
            Disturbance::CoarseSteps => return Pattern::Coarse,
            Disturbance::LostSamples => return Pattern::Later(middle(n, rng)),
            Disturbance::Chirp => return Pattern::Sweeping,
            Disturbance::Crosstalk => {
                let neighbour = plant.ring(plant.healthy.draw(rng));
                let delay = rng.random_range(n / 25..n / 3);
                let arrived =
                    |k: usize| k.checked_sub(delay).map_or(0.0, |k| neighbour.at(times[k]));
                (0..n).map(arrived).collect()
            }
            Disturbance::TwoRings => {
                let other = Ring {
                    frequency_hz: healthy.frequency_hz
                        * if rng.random_bool(0.5) {
                            rng.random_range(0.5..0.9)
                        } else {
                            rng.random_range(1.1..2.0)
                        },
                    damping_per_s: healthy.damping_per_s * rng.random_range(0.3..1.5),
                    phase_rad: rng.random_range(0.0..TAU),
                    pole_share: 0.0,
                    ..*healthy
                };
                other.sampled(plant.sampling())
            }
            Disturbance::Beat => {
                let apart = 1.0 + sign(rng) * rng.random_range(0.05..0.12);
                let other = Ring { frequency_hz: healthy.frequency_hz * apart, ..*healthy };
                other.sampled(plant.sampling())
            }
            Disturbance::Modulation => {
                let by = tone(0.3, 1.5, rng);
                base.iter().zip(by).map(|(y, by)| y * by).collect()
            }
        })
    }
}

impl Pattern {
    fn of_size(&self, size: f64, healthy: &Ring, base: &[f64], plant: &Plant) -> Vec<f64> {
        let sampling = plant.sampling();
        match self {
            Pattern::Added(v) => base.iter().zip(v).map(|(y, v)| y + size * v).collect(),
            Pattern::Clipped | Pattern::Coarse => {
                let mut y = base.to_vec();
                self.after_noise(size, base, &mut y);
                y
            }
            Pattern::Later(from) => {
                let later = size * sampling.period_s;
                let times = sampling.times().enumerate();
                times.map(|(k, t)| healthy.at(if k >= *from { t + later } else { t })).collect()
            }
            Pattern::Sweeping => {
                let at = |t: f64| {
                    let swept = size * (t / sampling.duration_s() - 0.5);
                    let phase_rad = healthy.phase_rad + healthy.omega() * t * swept;
                    Ring { phase_rad, ..*healthy }.at(t)
                };
                sampling.times().map(at).collect()
            }
        }
    }

    /// What the converter does, it does to signal and noise.
    fn after_noise(&self, size: f64, base: &[f64], y: &mut [f64]) {
        match self {
            Pattern::Clipped => {
                let height = base.iter().fold(0.0, |most: f64, y| most.max(y.abs()));
                let bound = height * (1.0 - size);
                y.iter_mut().for_each(|y| *y = y.clamp(-bound, bound));
            }
            Pattern::Coarse => y.iter_mut().for_each(|y| *y = (*y / size).round() * size),
            Pattern::Added(_) | Pattern::Later(_) | Pattern::Sweeping => {}
        }
    }

    fn first_guess(&self, noise: f64) -> f64 {
        match self {
            Pattern::Added(v) => 20.0 * noise / v.iter().map(|v| v * v).sum::<f64>().sqrt(),
            Pattern::Clipped | Pattern::Sweeping => 0.2,
            Pattern::Coarse => 6.0 * noise,
            Pattern::Later(_) => 2.0,
        }
    }

    /// Beyond it a pattern is something else, or grows no more.
    fn most(&self) -> f64 {
        match self {
            Pattern::Added(_) | Pattern::Coarse => f64::INFINITY,
            Pattern::Clipped => 0.95,
            Pattern::Later(_) => 8.0,
            Pattern::Sweeping => 2.0,
        }
    }
}

/// The size at which `left` is `x`, within 3 %: the secant in logarithms, kept inside a bracket.
fn size_of(x: f64, left: impl Fn(f64) -> f64, first_guess: f64, most: f64) -> Option<f64> {
    let (mut low, mut high) = (0.0_f64, most);
    let mut size = first_guess.min(most);
    for _ in 0..40 {
        let ratio = left(size) / x;
        if (ratio - 1.0).abs() < 0.03 {
            return Some(size);
        }
        if ratio < 1.0 {
            if size == most {
                return None;
            }
            low = size;
        } else {
            high = size;
        }
        // energy grows with the square of the size, about
        let step = size * ratio.max(1e-3).powf(-0.5).clamp(0.2, 5.0);
        size = match (step > low && step < high, high.is_finite()) {
            (true, _) => step,
            (false, true) if step >= high && low < 0.5 * high && high == most => most,
            (false, true) => (low + high) / 2.0,
            (false, false) => 2.0 * low,
        };
    }
    None
}

fn middle(n: usize, rng: &mut Random) -> usize {
    rng.random_range(n * 3 / 10..n * 7 / 10)
}

fn odd_samples(n: usize, count: usize, rng: &mut Random) -> Vec<f64> {
    let mut y = vec![0.0; n];
    for at in rand::seq::index::sample(rng, n, count) {
        y[at] = if rng.random_bool(0.5) { 1.0 } else { -1.0 };
    }
    y
}

/// Noise of which each sample keeps so much of the one before; 1 is a random walk.
fn remembering(n: usize, keeps: f64, rng: &mut Random) -> Vec<f64> {
    let mut y = 0.0;
    (0..n)
        .map(|_| {
            let new: f64 = StandardNormal.sample(rng);
            y = keeps * y + new;
            y
        })
        .collect()
}
