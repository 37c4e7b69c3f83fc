//! Unmodelled dynamics: what the thesis's linear model leaves out, each effect as one more term in
//! the equation of motion.
//!
//! In: a ring-down as it shows in the output, a term and its strength. Out: the decay with that
//! term, N samples in counts. Model critique asks by it which term would explain what signals have
//! beside their model. Time is in signal lengths. Strengths have no units: each is relative to the
//! ring itself at unit drive ([`Term`] says to what), so that a strength has a meaning without
//! knowing the channel's inner state.
//!
//! 1. The inner state at t_a (V = V_r + V_n, q_r = V_r', q_n = V_n' of thesis (2-2)) and the rates
//!    are found from poles and output ([`Interior::ink`]), which determine the rates but for the
//!    ratio of R_r/I_r to R_n/I_n, which is given.
//! 2. The strength becomes a coefficient of the equation of motion (`Interior::strengths`): by
//!    harmonic balance, with the amplitude that displacement or flow have at t_a.
//! 3. The equation of motion (`Interior::slope`) is integrated by Runge-Kutta:
//!
//! ```text
//! V'   = q_r + q_n
//! q_r' = -a s(V) - g q_r
//! q_n' = -b s(V) - d q_n - drag |q_n| q_n - dry tanh(q_n / small) + memory(t)
//! s(V): the spring's force (V itself without a term); output q_r + q_n
//! ```

use super::catalogue::CauseId;
use inkling_core::model::InkChannel;
use nalgebra::{Vector3, matrix};
use std::f64::consts::PI;

/// Smallest number of Runge-Kutta steps per sample, and largest phase advance per step, rad.
const STEPS: usize = 2;
const RADIANS: f64 = 0.12;

/// A term of the equation of motion. Its strength refers to the amplitudes at t_a and unit drive: the relative change of
/// the frequency, or of the damping, that it causes; or for
///
/// * half-order loss (a boundary layer that oscillates): the share of the nozzle's viscous loss that it replaces;
/// * a spring of even order: the term over the linear force at the amplitude;
/// * a stop: its stiffness over the spring's, beyond a `place`, in amplitudes, on that side of V = 0 on which that lies;
/// * a gap, within which there is no force: half of its width over the amplitude; below 0 the force within is twice as
///   large instead.
#[derive(Clone, Copy, Debug)]
pub struct Term {
    pub id: CauseId,
    pub strength: f64,
    pub place: f64,
}

/// A free decay as it shows in the output: the y of [`inkling_core::model::free_decay`]; rates per signal length,
/// amplitudes a, b, c in counts at unit drive.
#[derive(Clone, Copy, Debug)]
pub struct ObservedDecay {
    pub sigma: f64,
    pub omega: f64,
    pub lambda: f64,
    pub a: f64,
    pub b: f64,
    pub c: f64,
}

/// Coefficients of the equation of motion, in signal lengths and counts; 0: no such term.
#[derive(Default)]
struct Strengths {
    /// Factors of V³ and V² in the spring's force.
    cubic: f64,
    even: f64,
    /// Factor of what V is beyond `at` in the spring's force, and that displacement.
    stop: f64,
    at: f64,
    gap: f64,
    drag: f64,
    dry: f64,
    /// The flow above which dry friction has nearly its full force: a jump would spoil the
    /// integration.
    small: f64,
    /// Force of the half-order loss, one value per sample.
    memory: Option<Vec<f64>>,
}

impl Strengths {
    /// The spring's force at the displacement `v`: without a term `v` itself.
    fn spring(&self, v: f64) -> f64 {
        let Strengths { cubic, even, stop, at, gap, .. } = *self;
        v + cubic * v * v * v + even * v * v + stop * past(v, at) - within(v, gap)
    }

    /// Force of the half-order loss at the time `t`, interpolated between samples.
    fn force(&self, t: f64) -> f64 {
        let Some(f) = &self.memory else { return 0.0 };
        let at = t * f.len() as f64;
        let k = (at as usize).min(f.len() - 2);
        f[k] + (f[k + 1] - f[k]) * (at - k as f64)
    }
}

/// A level that follows a course of amplitudes with a lag: after each amplitude the level's
/// distance from it shrinks by e^(-1 / |lag|), the lag in signals. With a negative lag the level
/// starts as if the first amplitude had lasted for ever before, else at 0.
pub fn lagging(amplitudes: impl Iterator<Item = f64>, lag: f64) -> Vec<f64> {
    let kept = (-1.0 / lag.abs()).exp();
    let mut level = None;
    let follow = |now: f64| {
        let before = level.unwrap_or(if lag < 0.0 { now } else { 0.0 });
        *level.insert(now + (before - now) * kept)
    };
    amplitudes.map(follow).collect()
}

/// What a sensor without a name adds to what it shows of x, in amplitudes, by its strength: c x^2 or c x^3; what a gain
/// 1/(1 + c level) makes of it; or it takes what lies within +-c, where it is deaf (below 0 that comes twice).
pub fn sensed(sensor: CauseId, c: f64, x: f64, level: f64) -> f64 {
    match sensor {
        CauseId::EvenSensor => c * x * x,
        CauseId::OddSensor => c * x * x * x,
        CauseId::GainFollowsAmplitude => x / (1.0 + c * level).max(0.1) - x,
        _ => -within(x, c),
    }
}

/// The part of x within +-width; its negative for a width below 0. Unlike `clamp`, this does not panic where the width
/// is not a number.
pub fn within(x: f64, width: f64) -> f64 {
    x.max(-width.abs()).min(width.abs()) * width.signum()
}

/// How far a displacement is beyond the place `at`, on that side of 0 on which it lies, else 0.
pub fn past(v: f64, at: f64) -> f64 {
    if at >= 0.0 { (v - at).max(0.0) } else { (v - at).min(0.0) }
}

/// An ink channel's equation of motion with its initial state at t_a.
#[derive(Clone, Copy, Debug)]
pub struct Interior {
    decay: ObservedDecay,
    pub channel: InkChannel,
    pub state: [f64; 3],
}

impl Interior {
    /// The ink channel whose output is `decay`. `ratio`: g/d, not 1. `None`: no channel with
    /// positive a and b has that output.
    pub fn ink(decay: &ObservedDecay, ratio: f64) -> Option<Interior> {
        let ObservedDecay { sigma, omega, lambda, a, b, c } = *decay;

        // The observable cubic (s + lambda)(s² + 2 sigma s + sigma² + omega²) has p2 = g + d, p1 =
        // g d + a + b and p0 = a d + b g. So p2 gives d and g, then p1 gives a + b, and p0 each of
        // the two.
        let d = (2.0 * sigma + lambda) / (1.0 + ratio);
        let g = ratio * d;
        let square = sigma * sigma + omega * omega;
        let sum = square + 2.0 * sigma * lambda - g * d; // a + b of thesis (2-2)
        let p0 = lambda * square;
        let b_rate = (sum - p0 / d) / (1.0 - ratio);
        let a_rate = sum - b_rate;

        let y = a + c;
        let dy = -sigma * a + omega * b - lambda * c;
        let ddy =
            (sigma * sigma - omega * omega) * a - 2.0 * sigma * omega * b + lambda * lambda * c;

        // the state (V, q_r, q_n) from y = q_r + q_n, y' = -(a+b) V - g q_r - d q_n, and y'' +
        // (a+b) y = (g a + d b) V + g² q_r + d² q_n
        let m = matrix![
            0.0, 1.0, 1.0;
            -sum, -g, -d;
            g * a_rate + d * b_rate, g * g, d * d
        ];
        let x = m.lu().solve(&Vector3::new(y, dy, ddy + sum * y))?;
        let channel = InkChannel::of([a_rate, b_rate, g, d]);
        let is_channel = a_rate > 0.0 && b_rate > 0.0 && x.iter().all(|v| v.is_finite());
        is_channel.then(|| Interior { decay: *decay, channel, state: x.into() })
    }

    /// What turns a strength into a coefficient: the amplitudes of the displacement V and of the
    /// flow q_n at t_a, and the derivative of the ring's damping by the loss d.
    fn amplitudes(&self) -> [f64; 3] {
        let ObservedDecay { sigma, omega, .. } = self.decay;
        // amplitude of a damped oscillation from its value and its derivative
        let envelope = |x: f64, dx: f64| x.hypot((dx + sigma * x) / omega);
        let Interior { channel, state: [v, q_r, q_n], .. } = *self;
        let stiff = envelope(v, q_r + q_n);
        let damped = envelope(q_n, -channel.b_per_s2 * v - channel.d_per_s * q_n);

        // numerically; of a channel whose poles fail, .3 is a rough guess
        let at = |d: f64| InkChannel { d_per_s: d, ..channel }.poles().map(|p| p.damping_per_s);
        let h = 1e-3 * channel.d_per_s;
        let slope = match (at(channel.d_per_s + h), at(channel.d_per_s - h)) {
            (Some(up), Some(down)) => (up - down) / (2.0 * h),
            _ => 0.3,
        };
        [stiff, damped, slope]
    }

    /// The decay at the relative drive `drive`, with a term of a strength ([`Term`]) or without
    /// one: `samples` samples over one signal length, counts.
    pub fn decay(&self, term: Option<Term>, drive: f64, samples: usize) -> Vec<f64> {
        let strengths = self.strengths(term, drive, samples);
        let path = self.path(&strengths, drive, samples);
        path.into_iter().map(|x| x[1] + x[2]).collect()
    }

    /// The state (V, q_r, q_n) at each sample, by Runge-Kutta of fourth order.
    fn path(&self, strengths: &Strengths, drive: f64, samples: usize) -> Vec<Vector3<f64>> {
        let steps = STEPS.max((self.decay.omega / samples as f64 / RADIANS).ceil() as usize);
        let h = 1.0 / (samples * steps) as f64;
        let slope = |x: Vector3<f64>, t: f64| self.slope(strengths, x, t);
        let mut x = Vector3::from(self.state) * drive;
        let each = (0..samples).map(|sample| {
            let now = x;
            for step in 0..steps {
                let t = (sample * steps + step) as f64 * h;
                let k1 = slope(x, t);
                let k2 = slope(x + k1 * (h / 2.0), t + h / 2.0);
                let k3 = slope(x + k2 * (h / 2.0), t + h / 2.0);
                let k4 = slope(x + k3 * h, t + h);
                x += (k1 + k2 * 2.0 + k3 * 2.0 + k4) * (h / 6.0);
            }
            now
        });
        each.collect()
    }

    fn strengths(&self, term: Option<Term>, drive: f64, samples: usize) -> Strengths {
        let [stiff, damped, slope] = self.amplitudes();
        let sigma = self.decay.sigma;
        let mut of = Strengths { small: 0.02 * damped, ..Strengths::default() };
        let Some(Term { id, strength: e, place }) = term else { return of };
        match id {
            // harmonic balance at amplitude A: x'' = -w²(x + k x³) oscillates at w (1 + 3/8 k A²)
            CauseId::CubicStiffness => of.cubic = e * 8.0 / 3.0 / (stiff * stiff),
            // equivalent linear loss over a period: k |q| q acts as 8/(3 pi) k A q
            CauseId::QuadraticDrag => of.drag = e * sigma / (slope * 8.0 / (3.0 * PI) * damped),
            // mu sign(q) acts over a period as 4 mu/(pi A) q
            CauseId::DryFriction => of.dry = e * sigma * PI * damped / (4.0 * slope),
            CauseId::EvenSpring => of.even = e / stiff,
            CauseId::OneSidedSpring => (of.stop, of.at) = (e, place * stiff),
            CauseId::SpringWithGap => of.gap = e * stiff,
            // half-order loss
            _ => {
                let linear = self.path(&of, drive, samples);
                of.memory = Some(self.memory_force(e, linear.iter().map(|x| x[2]).collect()));
            }
        }
        of
    }

    /// The right-hand side of the equation of motion: x' at x = (V, q_r, q_n).
    fn slope(&self, of: &Strengths, x: Vector3<f64>, t: f64) -> Vector3<f64> {
        let (q_r, q_n, pressure) = (x[1], x[2], of.spring(x[0]));
        let [a, b, g, d] = self.channel.rates();
        let extra = -of.drag * q_n.abs() * q_n - of.dry * (q_n / of.small).tanh() + of.force(t);
        Vector3::new(q_r + q_n, -a * pressure - g * q_r, -b * pressure - d * q_n + extra)
    }

    /// Force of a half-order loss that replaces a share `e` of the viscous one: -e d (omega^-1/2
    /// D^1/2 q - q), one value per sample. D^1/2 is Caputo's derivative from t_a on, by the L1
    /// scheme, which takes the flow to be linear between samples: D^1/2 q at sample k is 2 /
    /// sqrt(pi h) times the sum over j of (sqrt(j + 1) - sqrt(j)) (q_{k-j} - q_{k-j-1}). q is the
    /// flow without the term, so the force is right to first order in e, and no integral equation
    /// has to be solved.
    fn memory_force(&self, e: f64, flow: Vec<f64>) -> Vec<f64> {
        let (samples, loss) = (flow.len(), self.channel.d_per_s);
        let h = 1.0 / samples as f64;
        let scale = 2.0 / PI.sqrt() / h.sqrt();
        let weight: Vec<f64> =
            (0..samples).map(|j| ((j + 1) as f64).sqrt() - (j as f64).sqrt()).collect();
        let force = |k: usize| {
            let sum: f64 = (0..k).map(|j| weight[j] * (flow[k - j] - flow[k - j - 1])).sum();
            -e * loss * (scale * sum / self.decay.omega.sqrt() - flow[k])
        };
        (0..samples).map(force).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DECAY: ObservedDecay =
        ObservedDecay { sigma: 2.917, omega: 40.65, lambda: 3.767, a: 80.0, b: -50.0, c: 5.0 };

    /// The decay without any term.
    fn linear(t: f64) -> f64 {
        (-DECAY.sigma * t).exp()
            * (DECAY.a * (DECAY.omega * t).cos() + DECAY.b * (DECAY.omega * t).sin())
            + DECAY.c * (-DECAY.lambda * t).exp()
    }

    #[test]
    fn interior_without_a_term_is_what_was_seen() {
        let ink = Interior::ink(&DECAY, 0.2).unwrap();
        for (k, y) in ink.decay(None, 1.5, 128).iter().enumerate() {
            assert!((y - 1.5 * linear(k as f64 / 128.0)).abs() < 2e-3, "{k}");
        }
    }

    #[test]
    fn strength_of_cubic_stiffness_is_the_change_of_frequency() {
        // hardly damped, so that the frequency can be found by counting periods
        let decay = ObservedDecay { sigma: 1e-3, omega: 60.0, lambda: 1.3e-3, c: 0.0, ..DECAY };
        let ink = Interior::ink(&decay, 0.2).unwrap();
        let term = Term { id: CauseId::CubicStiffness, strength: 0.02, place: 0.0 };
        let y = ink.decay(Some(term), 1.0, 4000);
        let crossings: Vec<f64> = (1..4000)
            .filter(|&k| y[k - 1] < 0.0 && y[k] >= 0.0)
            .map(|k| k as f64 - y[k] / (y[k] - y[k - 1]))
            .collect();
        let n = crossings.len() - 1;
        let omega = 2.0 * PI * n as f64 / ((crossings[n] - crossings[0]) / 4000.0);
        assert!((omega / 60.0 - 1.02).abs() < 1e-3, "{}", omega / 60.0);
    }

    #[test]
    fn strengths_of_drag_and_friction_are_the_change_of_damping_at_the_start() {
        let decay = ObservedDecay { sigma: 0.5, omega: 300.0, lambda: 0.65, c: 0.0, ..DECAY };
        let ink = Interior::ink(&decay, 0.2).unwrap();
        for id in [CauseId::QuadraticDrag, CauseId::DryFriction] {
            let y = ink.decay(Some(Term { id, strength: 0.2, place: 0.0 }), 1.0, 8000);
            // amplitude over the first periods, by projection on the ring's frequency
            let amplitude = |from: usize| {
                let (mut re, mut im) = (0.0, 0.0);
                for (k, y) in y.iter().enumerate().skip(from).take(168) {
                    let t = k as f64 / 8000.0;
                    re += y * (300.0 * t).cos();
                    im += y * (300.0 * t).sin();
                }
                f64::hypot(re, im)
            };
            let sigma = (amplitude(0) / amplitude(336)).ln() / (336.0 / 8000.0);
            assert!((sigma / 0.5 - 1.2).abs() < 0.02, "{id} {sigma}");
        }
    }
}
