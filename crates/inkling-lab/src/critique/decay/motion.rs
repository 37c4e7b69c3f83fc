//! One oscillator's free motion, with what may be nonlinear in it.
//!
//! x'' = -2 sigma x' - omega^2 (x + k x^3, or sin) - drag |x'| x' - omega^2 stick sign(x'), and the
//! rivals of `terms.rs`. Time counts in samples, x in the largest deviation of the first output
//! from its mean.
//!
//! In: rates, strengths, and the state at the first sample. Out: x and x'/omega at every sample
//! ([`Motion::run`]).
//!
//! The linear part is propagated exactly, by its matrix exponential. The rest is integrated in
//! small steps by Lawson's Runge-Kutta of fourth order, that is in the frame of the linear motion
//! (J. D. Lawson, SIAM J. Numer. Anal. 4, 1967), so that a term of strength zero leaves the linear
//! decay, to rounding. Dry friction changes its sign where x' passes zero: that instant is found,
//! and the body stays at rest where the spring is weaker than the friction.

use super::terms::{RATES, SENSORS, SPRINGS, Strengths};
use inkling_core::model::waves::swing;
use nalgebra::{Matrix2, Vector2};

/// Largest step, in radians of the oscillation, where something is nonlinear.
const RADIANS: f64 = 0.15;
/// A displacement beyond this is no decay any more.
const LOST: f64 = 1e3;

/// How the restoring force departs from the straight line; both forms begin as x + k x^3.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Form {
    #[default]
    Cubic,
    /// sin(sqrt(-6k) x)/sqrt(-6k), a pendulum's; sinh for k > 0.
    Sine,
}

#[derive(Clone, Copy, Debug, Default)]
pub struct Motion {
    pub sigma: f64,
    pub omega: f64,
    pub form: Form,
    pub stiffness: f64,
    pub drag: f64,
    /// Friction over the spring's rate: the displacement within which the body may rest.
    pub stick: f64,
    pub unnamed: Strengths,
}

impl Motion {
    fn is_linear(&self) -> bool {
        [self.stiffness, self.drag, self.stick] == [0.0; 3] && !self.unnamed.has(&SPRINGS)
    }

    /// The propagator e^{Ah} of the linear motion: what becomes of (x, x') in a time h.
    fn turn(&self, h: f64) -> Matrix2<f64> {
        let Motion { sigma, omega, .. } = *self;
        let [c, s] = swing(omega * omega - sigma * sigma, h);
        let fall = (-sigma * h).exp();
        let (to_x, to_v) = (fall * s, -fall * s * (omega * omega));
        Matrix2::new(fall * (c + s * sigma), to_x, to_v, fall * (c - s * sigma))
    }

    /// The spring's force over its rate, less x itself.
    pub fn beyond(&self, x: f64) -> f64 {
        let k = self.stiffness;
        let q = -6.0 * k;
        match self.form {
            Form::Cubic => k * x * x * x,
            Form::Sine if (q * x * x).abs() < 1e-3 => {
                let z = q * x * x;
                k * x * x * x * (1.0 - z / 20.0 + z * z / 840.0)
            }
            Form::Sine if q > 0.0 => (q.sqrt() * x).sin() / q.sqrt() - x,
            Form::Sine => ((-q).sqrt() * x).sinh() / (-q).sqrt() - x,
        }
    }

    /// Acceleration by all that is nonlinear. `sign`: direction of the velocity.
    fn kick(&self, y: Vector2<f64>, sign: f64) -> f64 {
        let (x, v) = (y[0], y[1]);
        let mut spring = if self.stiffness == 0.0 { 0.0 } else { self.beyond(x) };
        if self.unnamed.has(&SPRINGS) {
            spring += self.unnamed.spring(x);
        }
        -self.omega * self.omega * (spring + self.stick * sign) - self.drag * v.abs() * v
    }

    /// One step of Lawson's Runge-Kutta from the state `y` = (x, x'): the classical method for the
    /// state seen in the frame of the linear motion. `half` and `full`: the propagators of `turns`.
    fn step(
        &self,
        y: Vector2<f64>,
        sign: f64,
        h: f64,
        [half, full]: &[Matrix2<f64>; 2],
    ) -> Vector2<f64> {
        let pushed = |by: f64| Vector2::new(0.0, by);
        let k1 = self.kick(y, sign);
        let k2 = self.kick(half * (y + pushed(0.5 * h * k1)), sign);
        let k3 = self.kick(half * y + pushed(0.5 * h * k2), sign);
        let end = full * y;
        let k4 = self.kick(end + half * pushed(h * k3), sign);
        end + (full * pushed(k1) + half * pushed(2.0 * (k2 + k3)) + pushed(k4)) * (h / 6.0)
    }

    fn turns(&self, h: f64) -> [Matrix2<f64>; 2] {
        [self.turn(0.5 * h), self.turn(h)]
    }

    /// x and x'/omega as the sensor shows them. `start`: both at sample 0. A motion that gets lost
    /// (`LOST`) is NaN from the next sample on, so that its cost is infinite.
    pub fn run(&self, start: [f64; 2], samples: usize) -> Vec<[f64; 2]> {
        let mut path = self.moved(start, samples);
        if self.unnamed.has(&SENSORS) {
            self.unnamed.through_sensor(&mut path);
        }
        path
    }

    /// The equation between sample `samples` and the next one, with rates in the middle.
    fn after(&self, samples: usize) -> Motion {
        let time = samples as f64 + 0.5;
        let sigma = self.sigma + self.unnamed.loss_after(time);
        Motion { sigma, omega: self.omega * (1.0 + self.unnamed.frequency_after(time)), ..*self }
    }

    /// The motion itself, before a sensor bends it: a linear one by its propagator from sample to
    /// sample, any other in steps of at most `RADIANS`.
    fn moved(&self, start: [f64; 2], samples: usize) -> Vec<[f64; 2]> {
        let mut out = Vec::with_capacity(samples);
        let mut y = Vector2::new(start[0], start[1] * self.omega);
        let (is_linear, changes) = (self.is_linear(), self.unnamed.has(&RATES));
        let finest = (self.omega.abs() / RADIANS).ceil().clamp(1.0, 64.0);
        let steps = if is_linear { 1.0 } else { finest };
        let h = 1.0 / steps;
        let (mut now, mut turns) = (*self, self.turns(h));
        // from rest, the spring decides the direction of the friction
        let mut sign = if y[1] != 0.0 { y[1].signum() } else { -y[0].signum() };
        let mut rests = false;
        for k in 0..samples {
            out.push([y[0], y[1] / self.omega]);
            if changes {
                now = self.after(k);
                turns = now.turns(h);
            }
            if is_linear {
                y = turns[1] * y;
                continue;
            }
            for _ in 0..steps as usize {
                if rests {
                    break;
                }
                let next = now.step(y, sign, h, &turns);
                if self.stick == 0.0 || next[1] * sign >= 0.0 {
                    y = next;
                } else {
                    (y, sign, rests) = now.turned(y, sign, h);
                }
            }
            if y[0].is_nan() || y[0].abs() >= LOST {
                out.resize(samples, [f64::NAN; 2]);
                break;
            }
        }
        out
    }

    /// A step of length `h` from `y` in which x' passes zero under friction. Returns the state at
    /// its end, the sign of x' there, and whether the body rests.
    fn turned(&self, mut y: Vector2<f64>, mut sign: f64, h: f64) -> (Vector2<f64>, f64, bool) {
        let part = |y, sign, h| self.step(y, sign, h, &self.turns(h));
        let mut left = h;
        // a step is a small part of a swing: more than two turns in it are rounding
        for _ in 0..3 {
            let end = part(y, sign, left);
            if end[1] * sign >= 0.0 {
                return (end, sign, false);
            }

            let (mut low, mut high) = ((0.0, y[1] * sign), (left, end[1] * sign));
            for _ in 0..40 {
                let at = low.0 + (high.0 - low.0) * (low.1 / (low.1 - high.1)).clamp(0.05, 0.95);
                let v = part(y, sign, at)[1] * sign;
                if v >= 0.0 {
                    low = (at, v);
                } else {
                    high = (at, v);
                }
                if high.0 - low.0 < 1e-13 * h {
                    break;
                }
            }
            y = Vector2::new(part(y, sign, low.0)[0], 0.0);
            left -= low.0;

            let spring = y[0] + self.beyond(y[0]) + self.unnamed.spring(y[0]);
            if spring.abs() <= self.stick {
                return (y, sign, true);
            }
            sign = -spring.signum();
        }
        (part(y, sign, left), sign, false)
    }

    /// Frequency at an amplitude over that of the smallest motion, by harmonic balance (N. M.
    /// Krylov and N. N. Bogoliubov). Rivals' springs are not included.
    pub fn frequency_ratio(&self, amplitude: f64) -> f64 {
        const POINTS: usize = 64;
        let mut sum = 0.0;
        for j in 0..POINTS {
            let phase = std::f64::consts::TAU * (j as f64 + 0.5) / POINTS as f64;
            let x = amplitude * phase.cos();
            sum += (x + self.beyond(x)) * phase.cos();
        }
        (2.0 * sum / (POINTS as f64 * amplitude)).max(0.0).sqrt()
    }

    /// Rate of a viscous damping, per sample, that loses as much energy in one swing. Rivals are
    /// not included.
    pub fn damping_at(&self, amplitude: f64) -> f64 {
        use std::f64::consts::PI;
        self.sigma
            + 4.0 / (3.0 * PI) * self.drag * self.omega * amplitude
            + 2.0 / PI * self.stick * self.omega / amplitude
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plain() -> Motion {
        Motion { sigma: 0.004, omega: 0.3, ..Motion::default() }
    }

    fn run(motion: Motion, n: usize) -> Vec<[f64; 2]> {
        motion.run([1.0, 0.0], n)
    }

    #[test]
    fn a_term_of_no_strength_is_the_linear_decay() {
        let linear = run(plain(), 600);
        let w = (0.3_f64.powi(2) - 0.004_f64.powi(2)).sqrt();
        for (k, [x, _]) in linear.iter().enumerate() {
            let t = k as f64;
            let exact = (-0.004 * t).exp() * ((w * t).cos() + 0.004 / w * (w * t).sin());
            assert!((x - exact).abs() < 1e-10);
        }
        let almost = run(Motion { drag: 1e-14, ..plain() }, 600);
        assert!(linear.iter().zip(&almost).all(|(a, b)| (a[0] - b[0]).abs() < 1e-10));
    }

    #[test]
    fn energy_is_kept_without_loss_and_the_spring_decides_the_frequency() {
        for (form, k) in [(Form::Cubic, 0.3), (Form::Cubic, -0.3), (Form::Sine, -1.0 / 6.0)] {
            let motion = Motion { sigma: 0.0, form, stiffness: k, ..plain() };
            let energy = |[x, u]: [f64; 2]| {
                let spring = match form {
                    Form::Cubic => 0.5 * x * x + 0.25 * k * x.powi(4),
                    Form::Sine => 1.0 - x.cos(),
                };
                0.5 * u * u + spring
            };
            let path = run(motion, 2000);
            let first = energy(path[0]);
            assert!(path.iter().all(|y| (energy(*y) / first - 1.0).abs() < 2e-4), "{form:?}");
        }
        let duffing = Motion { stiffness: 0.2, ..plain() };
        assert!(
            (duffing.frequency_ratio(0.5) - (1.0_f64 + 0.75 * 0.2 * 0.25).sqrt()).abs() < 1e-12
        );
        // a pendulum at 1 rad: 1/1.0663 of its small swings (complete elliptic integral)
        let pendulum = Motion { form: Form::Sine, stiffness: -1.0 / 6.0, ..plain() };
        assert!((pendulum.frequency_ratio(1.0) - 1.0 / 1.0663).abs() < 1e-3);
    }

    #[test]
    fn dry_friction_takes_the_same_from_every_swing_and_ends_at_rest() {
        let motion = Motion { sigma: 0.0, stick: 0.01, ..plain() };
        let path = run(motion, 2000);
        let peaks: Vec<f64> = path
            .windows(3)
            .filter(|w| w[1][0] > w[0][0] && w[1][0] >= w[2][0])
            .map(|w| w[1][0])
            .collect();
        for pair in peaks.windows(2).take(10) {
            assert!((pair[0] - pair[1] - 0.04).abs() < 0.01, "{pair:?}");
        }
        let total = peaks[0] - peaks[10];
        assert!((total - 0.4).abs() < 0.012, "{total}");
        let [x, u] = path[1999];
        assert!(u == 0.0 && x.abs() <= 0.01, "at rest within the dead zone: {x}");
    }
}
