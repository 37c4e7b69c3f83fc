//! The acquisition state x_a of thesis (2-2) from which a channel rings.
//!
//! In: a channel's rates, the waveform of the actuation and the wait until the acquisition begins.
//! Out: x_a. A channel at rest is driven by thesis (2-2) with its input u, whose voltage is
//! constant within each step of the waveform, so each step is solved exactly by one matrix
//! exponential. From t_a on u is 0, thesis §2-2.

use super::InkChannel;
use nalgebra::Vector4;
use serde::{Deserialize, Serialize};

pub const MOST_STEPS: usize = 32;

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(into = "Vec<[f64; 2]>", try_from = "Vec<[f64; 2]>")]
pub struct Waveform {
    /// Each step's share of the whole duration, and its voltage over the drive's; 0 beyond `n`.
    steps: [[f64; 2]; MOST_STEPS],
    n: usize,
}

impl Default for Waveform {
    fn default() -> Waveform {
        Waveform::PULSE
    }
}

impl Waveform {
    pub const PULSE: Waveform = {
        let mut steps = [[0.0; 2]; MOST_STEPS];
        steps[0] = [1.0, 1.0];
        Waveform { steps, n: 1 }
    };

    /// Of steps [duration in any unit, relative voltage]; with it comes the sum of the durations.
    pub fn new(steps: &[[f64; 2]]) -> Result<(Waveform, f64), String> {
        let whole: f64 = steps.iter().map(|[duration, _]| duration).sum();
        let is_step = |[duration, level]: &[f64; 2]| {
            *duration > 0.0 && duration.is_finite() && level.abs() <= 100.0
        };
        let is_any = steps.iter().any(|[_, level]| *level != 0.0);
        if !(1..=MOST_STEPS).contains(&steps.len()) || !steps.iter().all(is_step) || !is_any {
            return Err(format!(
                "give 1 to {MOST_STEPS} steps [duration, voltage relative to the drive's], durations above 0, voltages of at \
                 most 100 and not all 0"
            ));
        }
        let mut waveform = Waveform { steps: [[0.0; 2]; MOST_STEPS], n: steps.len() };
        for (own, [duration, level]) in waveform.steps.iter_mut().zip(steps) {
            *own = [duration / whole, *level];
        }
        Ok((waveform, whole))
    }

    pub fn is_pulse(&self) -> bool {
        *self == Waveform::PULSE
    }

    fn steps(&self) -> &[[f64; 2]] {
        &self.steps[..self.n]
    }
}

impl From<Waveform> for Vec<[f64; 2]> {
    fn from(waveform: Waveform) -> Vec<[f64; 2]> {
        waveform.steps().to_vec()
    }
}

impl TryFrom<Vec<[f64; 2]>> for Waveform {
    type Error = String;

    fn try_from(steps: Vec<[f64; 2]>) -> Result<Waveform, String> {
        Ok(Waveform::new(&steps)?.0)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Actuation {
    pub pulse_s: f64,
    /// Time from the end of the actuation to t_a, s.
    pub delay_s: f64,
    #[serde(default, skip_serializing_if = "Waveform::is_pulse")]
    pub waveform: Waveform,
}

impl Actuation {
    pub const fn pulse(pulse_s: f64, delay_s: f64) -> Actuation {
        Actuation { pulse_s, delay_s, waveform: Waveform::PULSE }
    }

    /// x_a = (V_r, V_n, V_r', V_n') of a channel that was at rest, thesis (2-2) with B_u = b (0, 0,
    /// 1/(I_r B_t), 1/(I_n B_t))^T. `displaced_m3`: b u, the actuator constant times the drive
    /// voltage, to which x_a is proportional: counts·s give a state whose output is in counts.
    ///
    /// While a voltage u lasts, x_e = (b u, 0, 0, 0) is an equilibrium: A x_e + B_u u = 0. So x -
    /// x_e decays freely, which is exact and needs no inverse of the singular A.
    pub fn acquisition_state(&self, channel: &InkChannel, displaced_m3: f64) -> Vector4<f64> {
        let mut x = Vector4::zeros();

        for [share, level] in self.waveform.steps() {
            let x_e = Vector4::new(displaced_m3 * level, 0.0, 0.0, 0.0);
            x = x_e + channel.transition(self.pulse_s * share) * (x - x_e);
        }

        channel.transition(self.delay_s) * x
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DVector;

    const NOMINAL: InkChannel = InkChannel::NOMINAL;
    const ACTUATION: Actuation = Actuation::pulse(9e-6, 6e-6);

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

    /// Tests one pulse, and a waveform of several pulses of several heights, such as
    /// drop-on-demand heads are driven with.
    #[test]
    fn any_waveform_is_what_integrating_it_step_by_step_gives() {
        let blocked = crate::model::faults::apply("BN", 0.99, &NOMINAL).unwrap();
        let several = [[5e-6, 1.0], [2e-6, 0.0], [4e-6, -0.4], [1e-6, 0.3]];
        let (waveform, pulse_s) = Waveform::new(&several).unwrap();
        assert!((pulse_s - 12e-6).abs() < 1e-18);
        let by_several = Actuation { pulse_s, waveform, ..ACTUATION };
        for (channel, actuation, steps) in [
            (NOMINAL, ACTUATION, &[[ACTUATION.pulse_s, 1.0]][..]),
            (blocked, ACTUATION, &[[ACTUATION.pulse_s, 1.0]]),
            (NOMINAL, by_several, &several),
        ] {
            let mut x = DVector::zeros(4);
            for [duration, level] in steps {
                x = rk4(&channel, x, 30e-12 * level, *duration);
            }
            let expected = rk4(&channel, x, 0.0, actuation.delay_s);
            let x_a = actuation.acquisition_state(&channel, 30e-12);
            for i in 0..4 {
                // volumes against the displaced volume, flows against it times 1e6/s
                let scale = if i < 2 { 30e-12 } else { 30e-6 };
                assert!((x_a[i] - expected[i]).abs() < 1e-10 * scale, "{i}: {x_a} {expected}");
            }
        }
        let none = Actuation::pulse(0.0, 6e-6);
        assert_eq!(none.acquisition_state(&NOMINAL, 1.0), Vector4::zeros());
        // two halves of a pulse are the pulse
        let (halves, _) = Waveform::new(&[[1.0, 1.0], [1.0, 1.0]]).unwrap();
        let halved = Actuation { waveform: halves, ..ACTUATION }.acquisition_state(&NOMINAL, 1.0);
        let whole = ACTUATION.acquisition_state(&NOMINAL, 1.0);
        assert!((halved - whole).norm() < 1e-12 * whole.norm());
        for wrong in [&[][..], &[[0.0, 1.0]], &[[1.0, f64::NAN]], &[[1.0, 0.0]], &[[1.0, 1.0]; 33]]
        {
            assert!(Waveform::new(wrong).is_err());
        }
    }
}
