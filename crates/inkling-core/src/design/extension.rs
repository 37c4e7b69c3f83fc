//! A model extension: what a critique (`inkling critique`) found missing in the healthy model, as a
//! correction of signals.
//!
//! In: a signal, N, counts, its covariates and its relative drive s. Out: the signal less the
//! extension, in place, before anything is learned from the signal or it is judged. With D(theta,
//! t) the free decay of thesis (2-2) per unit drive, theta_0 the typical parameters, theta the
//! signal's own ones and t_p the time since the previous actuation, three effects are subtracted:
//! * `shapes`, which every signal has: the sum over k of s^k shape_k;
//! * `follows`, parameters that depend linearly on covariates: s (D(theta, t) - D(theta_0, t));
//! * `previous_tail` p, the previous actuation's decay, which still rings: s p D(theta, t + t_p).

use crate::burst::{Beside, Burst};
use crate::identify::reservoir::relative_drive;
use crate::model::free_decay::{self, ALL, Theta};
use serde::{Deserialize, Serialize};

/// Largest change of ln damping and of ln frequency that all covariates together may cause, against
/// damaged or extrapolated extensions (somewhat arbitrary).
const MOST_SHIFT: f64 = 1.0;

/// A covariate: a number that is recorded with a signal and has an effect on its free decay.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Covariate {
    /// Time of acquisition t_a, s since the epoch.
    Time,
    Channel,
    /// Number of neighbours that were actuated with the channel.
    Neighbours,
    /// ln of the time since the previous actuation in s, clamped to 1 µs .. 1 s.
    LnIdle,
    /// Drive voltage, V.
    Drive,
}

impl Covariate {
    /// NaN: not recorded.
    fn value(self, beside: &Beside) -> f64 {
        match self {
            Covariate::Time => beside.t_acq_ns as f64 * 1e-9,
            Covariate::Channel => f64::from(beside.channel),
            Covariate::Neighbours => beside.neighbours,
            Covariate::LnIdle => beside.ln_idle(),
            Covariate::Drive => beside.drive_v,
        }
    }
}

/// The parameters of the free decay change with a covariate z by slope * (z within `range` - about).
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct CovariateEffect {
    pub covariate: Covariate,
    pub about: f64,
    /// Range of the covariate in the critique's recordings.
    pub range: [f64; 2],
    /// Change of the parameters [`Extension::decay`] per unit of the covariate.
    pub slope: [f64; ALL],
}

#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Extension {
    /// Identifiers of the causes that the critique named, as in `critique.json`.
    pub causes: Vec<String>,
    /// The typical free decay, per unit drive: ln sigma, ln omega, a, b, c, ln lambda; time counts
    /// in signal lengths, amplitudes in counts.
    pub decay: [f64; ALL],
    pub follows: Vec<CovariateEffect>,
    /// Amplitude of the previous actuation's decay over that of the present one at equal ages.
    pub previous_tail: f64,
    /// Shape number k, from 0 on, is scaled by drive^k. Each N, counts, or empty.
    pub shapes: Vec<Vec<f64>>,
}

impl Extension {
    /// Covariates that were not recorded (NaN) have no effect. `drive`: relative; `signal`: counts.
    pub fn subtract(&self, beside: &Beside, drive: f64, dt_s: f64, signal: &mut [f64]) {
        let mut scale = 1.0;
        for shape in &self.shapes {
            signal.iter_mut().zip(shape).for_each(|(y, v)| *y -= scale * v);
            scale *= drive;
        }

        let usual = Theta::from(self.decay);
        let mut own = usual;
        for follows in &self.follows {
            let value = follows.covariate.value(beside);
            if value.is_finite() {
                let z = value.clamp(follows.range[0], follows.range[1]) - follows.about;
                own += Theta::from(follows.slope) * z;
            }
        }
        // the first two parameters are ln damping and ln frequency
        for (own, usual) in own.iter_mut().zip(&usual).take(2) {
            *own = own.clamp(usual - MOST_SHIFT, usual + MOST_SHIFT);
        }
        if !self.follows.is_empty() {
            free_decay::add(&own, 0.0, -drive, signal);
            free_decay::add(&usual, 0.0, drive, signal);
        }

        // the time since the previous actuation in signal lengths; infinite: there was none
        let since = beside.idle_s / (dt_s * signal.len() as f64);
        if self.previous_tail != 0.0 && since.is_finite() && since > 0.0 {
            free_decay::add(&own, since, -drive * self.previous_tail, signal);
        }
    }

    /// The same of row `row` of a burst. `reference_v`: voltage that relative drives refer to.
    pub fn take_off(
        &self,
        burst: &Burst,
        row: usize,
        reference_v: Option<f64>,
        signal: &mut [f64],
    ) {
        let drive = relative_drive(burst.drive_voltage_v.unwrap_or(f64::NAN), reference_v);
        self.subtract(&burst.beside(row), drive, burst.sample_period_s, signal);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const N: usize = 128;
    const DT_S: f64 = 1e-6;

    fn extension() -> Extension {
        Extension {
            causes: vec!["ageing".into(), "previous_tail".into(), "offset".into()],
            decay: [2.9_f64.ln(), 40.6_f64.ln(), 90.0, -40.0, 6.0, 3.7_f64.ln()],
            follows: vec![CovariateEffect {
                covariate: Covariate::Time,
                about: 1000.0,
                range: [900.0, 1100.0],
                slope: [2e-3, 1e-4, 0.0, 0.1, 0.0, 0.0],
            }],
            previous_tail: 0.3,
            shapes: vec![vec![0.5; N], vec![], vec![0.25; N]],
        }
    }

    fn beside(t_s: f64, idle_s: f64) -> Beside {
        Beside { drive_v: 30.0, idle_s, ..Beside::alone(3, (t_s * 1e9) as i64) }
    }

    /// A free decay at time `t`, in signal lengths, from its formula.
    fn decay(theta: &[f64; ALL], t: f64) -> f64 {
        let [sigma, omega, lambda] = [theta[0].exp(), theta[1].exp(), theta[5].exp()];
        let pair = theta[2] * (omega * t).cos() + theta[3] * (omega * t).sin();
        (-sigma * t).exp() * pair + theta[4] * (-lambda * t).exp()
    }

    #[test]
    fn what_is_left_is_the_usual_decay() {
        let (extension, drive) = (extension(), 0.8);
        // 50 s after the covariate's reference; 5000 s after lies beyond what was seen and counts
        // as 100
        for (t_s, off) in [(1050.0, 50.0), (6000.0, 100.0), (1000.0, 0.0)] {
            for idle_s in [150e-6, f64::INFINITY, f64::NAN] {
                let mut own = extension.decay;
                own.iter_mut().zip(extension.follows[0].slope).for_each(|(x, s)| *x += s * off);
                let of = |k: usize| {
                    let t = k as f64 / N as f64;
                    let tail = if idle_s.is_finite() {
                        0.3 * decay(&own, t + idle_s / (N as f64 * DT_S))
                    } else {
                        0.0
                    };
                    drive * (decay(&own, t) + tail) + 0.5 + drive * drive * 0.25
                };
                let mut signal: Vec<f64> = (0..N).map(of).collect();
                extension.subtract(&beside(t_s, idle_s), drive, DT_S, &mut signal);
                for (k, y) in signal.iter().enumerate() {
                    let usual = drive * decay(&extension.decay, k as f64 / N as f64);
                    assert!((y - usual).abs() < 1e-9, "{t_s} {idle_s} {k}: {y} {usual}");
                }
            }
        }
    }

    #[test]
    fn what_was_not_recorded_adds_nothing() {
        let mut extension = extension();
        extension.shapes.clear();
        extension.follows[0].covariate = Covariate::Neighbours;
        let mut signal = vec![1.0; N];
        extension.subtract(&beside(1000.0, f64::NAN), 1.0, DT_S, &mut signal);
        assert!(signal.iter().all(|y| (y - 1.0).abs() < 1e-9));
    }
}
