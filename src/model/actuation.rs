//! The state that a channel rings from. In: rates, a rectangular actuation pulse. Out: x_a.
//!
//! thesis (2-2) with its input; from t_a on the channel is autonomous, thesis §2-2.

use super::InkChannel;
use nalgebra::Vector4;

/// A rectangular actuation pulse and the wait until acquisition begins.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Actuation {
    /// Width of the pulse, s.
    pub pulse_s: f64,
    /// From the end of the pulse to t_a, s.
    pub delay_s: f64,
}

impl Actuation {
    /// Acquisition state x_a = (V_r, V_n, V_r', V_n') of a channel that was at rest before the
    /// pulse, thesis (2-2) with B_u = b (0, 0, 1/(I_r B_t), 1/(I_n B_t))^T. `displaced_m3` is
    /// b u, the actuator constant times the voltage; x_a is linear in it and in its unit.
    ///
    /// While the pulse lasts, x_e = (b u, 0, 0, 0) is an equilibrium: A x_e + B_u u = 0. So
    /// x - x_e decays freely from -x_e, and A need not be inverted (it is singular):
    /// x_a = e^{A delay} (x_e - e^{A pulse} x_e), exact.
    pub fn acquisition_state(&self, channel: &InkChannel, displaced_m3: f64) -> Vector4<f64> {
        let x_e = Vector4::new(displaced_m3, 0.0, 0.0, 0.0);
        let at_end_of_pulse = x_e - channel.transition(self.pulse_s) * x_e;
        channel.transition(self.delay_s) * at_end_of_pulse
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DVector;

    const NOMINAL: InkChannel = InkChannel::NOMINAL;
    const ACTUATION: Actuation = Actuation { pulse_s: 9e-6, delay_s: 6e-6 };

    /// x after `duration_s` of x' = A x + B_u u by Runge-Kutta of fourth order.
    fn rk4(
        channel: &InkChannel,
        mut x: DVector<f64>,
        displaced: f64,
        duration_s: f64,
    ) -> DVector<f64> {
        let a = channel.a();
        let b_u = DVector::from_vec(vec![0.0, 0.0, channel.a_per_s2, channel.b_per_s2]);
        let rate = |x: &DVector<f64>| &a * x + &b_u * displaced;
        let steps = 4000;
        let h = duration_s / f64::from(steps);
        for _ in 0..steps {
            let k1 = rate(&x);
            let k2 = rate(&(&x + &k1 * (h / 2.0)));
            let k3 = rate(&(&x + &k2 * (h / 2.0)));
            let k4 = rate(&(&x + &k3 * h));
            x += (k1 + k2 * 2.0 + k3 * 2.0 + k4) * (h / 6.0);
        }
        x
    }

    #[test]
    fn acquisition_state_is_what_integrating_the_pulse_gives() {
        let blocked = crate::model::faults::apply("BN", 0.99, &NOMINAL).unwrap();
        for channel in [NOMINAL, blocked] {
            let end = rk4(&channel, DVector::zeros(4), 30e-12, ACTUATION.pulse_s);
            let expected = rk4(&channel, end, 0.0, ACTUATION.delay_s);
            let x_a = ACTUATION.acquisition_state(&channel, 30e-12);
            for i in 0..4 {
                // volumes against the displaced volume, flows against it times 1e6/s
                let scale = if i < 2 { 30e-12 } else { 30e-6 };
                assert!((x_a[i] - expected[i]).abs() < 1e-10 * scale, "{i}: {x_a} {expected}");
            }
        }
    }

    #[test]
    fn acquisition_state_is_linear_in_the_voltage() {
        let (one, three) = (
            ACTUATION.acquisition_state(&NOMINAL, 1.0),
            ACTUATION.acquisition_state(&NOMINAL, 3.0),
        );
        assert!((three - one * 3.0).norm() < 1e-12 * three.norm());
    }

    #[test]
    fn without_a_pulse_the_channel_stays_at_rest() {
        let none = Actuation { pulse_s: 0.0, delay_s: 6e-6 };
        assert_eq!(none.acquisition_state(&NOMINAL, 1.0), Vector4::zeros());
    }
}
