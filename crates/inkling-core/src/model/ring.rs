//! A ring-down described by amplitude, phase, damping and frequency: a *ring*.
//!
//! In: the poles of an identified model and its output at t_a (y, y', y''). Out: the [`Ring`]
//!
//! ```text
//! y(t) = A (e^{-sigma t} cos(omega t + phi) + rho e^{-lambda t}),
//! ```
//!
//! with which the signals of the model's printhead are compared (`ring_fit`).

use super::ring_down::Poles;
use nalgebra::{Complex, Matrix3, Vector3};
use serde::{Deserialize, Serialize};

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Ring {
    /// Amplitude A of the pair at t_a, counts.
    pub amplitude: f64,
    /// Phase phi at t_a, rad.
    pub phase_rad: f64,
    pub damping_per_s: f64,
    /// Frequency f = omega / 2 pi, Hz.
    pub frequency_hz: f64,
    /// rho, the real pole's amplitude at t_a over the pair's; negative where they are opposed.
    pub real_share: f64,
    pub lambda_per_s: f64,
}

impl Ring {
    /// `output_state`: y, y', y'' at t_a, counts, counts/s, counts/s². `None`: nothing oscillates.
    pub fn new(poles: Poles, output_state: [f64; 3]) -> Option<Ring> {
        let omega = 2.0 * std::f64::consts::PI * poles.frequency_hz * 1e-6;
        let s = Complex::new(-poles.damping_per_s * 1e-6, omega);
        let lambda = poles.lambda_per_s * 1e-6;

        // Per µs, so that the system is well conditioned. With the complex amplitude C of the pair
        // and the amplitude R of the real pole: y = Re C + R; y' = Re (s C) - lambda R; y'' = Re
        // (s² C) + lambda² R.
        let s2 = s * s;
        let m = Matrix3::new(1.0, 0.0, 1.0, s.re, -s.im, -lambda, s2.re, -s2.im, lambda * lambda);
        let [y, dy, ddy] = output_state;
        let x = m.lu().solve(&Vector3::new(y, dy * 1e-6, ddy * 1e-12))?;

        let c = Complex::new(x[0], x[1]);
        (c.norm() > 0.0 && c.norm().is_finite()).then(|| Ring {
            amplitude: c.norm(),
            phase_rad: c.arg(),
            damping_per_s: poles.damping_per_s,
            frequency_hz: poles.frequency_hz,
            real_share: x[2] / c.norm(),
            lambda_per_s: poles.lambda_per_s,
        })
    }

    /// y, y', y'' at t_a, in counts, counts/s, counts/s²: the inverse of [`Ring::new`].
    pub fn output_state(&self) -> [f64; 3] {
        let omega = 2.0 * std::f64::consts::PI * self.frequency_hz;
        let s = Complex::new(-self.damping_per_s, omega);
        let c = Complex::from_polar(self.amplitude, self.phase_rad);
        let (real, lambda) = (self.real_share * self.amplitude, self.lambda_per_s);
        [c.re + real, (s * c).re - lambda * real, (s * s * c).re + lambda * lambda * real]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::InkChannel;
    use crate::model::ring_down::ring_down;
    use nalgebra::DVector;

    #[test]
    fn ring_is_the_decay_of_the_state_it_was_made_of() {
        let channel = InkChannel::NOMINAL;
        let x = [3e-4, 1e-4, 150.0, 240.0];
        let state = channel.output_state(x);
        let ring = Ring::new(channel.poles().unwrap(), state).unwrap();
        let dt = 0.78125e-6;
        let decay = ring_down(&channel, &DVector::from_row_slice(&x), dt, 64);
        for (found, given) in ring.output_state().into_iter().zip(state) {
            assert!((found / given - 1.0).abs() < 1e-9, "{found} {given}");
        }
        for (k, y) in decay.iter().enumerate() {
            let t = k as f64 * dt;
            let angle = 2.0 * std::f64::consts::PI * ring.frequency_hz * t + ring.phase_rad;
            let z = ring.amplitude
                * ((-ring.damping_per_s * t).exp() * angle.cos()
                    + ring.real_share * (-ring.lambda_per_s * t).exp());
            assert!((y - z).abs() < 1e-6, "{y} {z}");
        }
    }
}
