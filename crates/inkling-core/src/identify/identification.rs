//! The result of identification: the model, with its uncertainty and with what was held.

use super::cubic::{basis, cubic_per_us, per_us};
use crate::model::{InkChannel, ring_down::Poles};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Convergence {
    /// The gradient, projected on the bounds, has vanished.
    Gradient,
    /// The best step would reduce the cost by less than a billionth.
    Gain,
    /// No step changes the parameters any more, or none improves the fit.
    Step,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Identification {
    /// The rates of thesis (2-2), each of which depends on the ratio g/d that was held.
    pub channel: InkChannel,
    pub poles: Poles,
    /// p2, p1, p0 of the observable polynomial s^3 + p2 s^2 + p1 s + p0, in 1/s, 1/s², 1/s³.
    pub cubic: [f64; 3],
    /// x_a = (V_r, V_n, V_r', V_n') at the reference drive, counts·s and counts; V_r = V_n is set.
    pub acquisition_state: [f64; 4],
    /// The output and its derivatives y, y', y'' at t_a: counts, counts/s, counts/s².
    pub output_state: [f64; 3],
    /// 100 (1 - ||y - y_hat|| / ||y - mean y||) of the signal that was fitted last.
    pub fit_percent: f64,
    /// Root mean square of y - y_hat of that signal, counts.
    pub misfit_rms: f64,
    pub convergence: Convergence,
    pub iterations: usize,
    /// Starts of the first search: those that ended at the best optimum, and those tried.
    pub starts_agreeing: usize,
    pub starts: usize,
    pub uncertainty: Uncertainty,
    /// How the averaged channels differ; zero where it was not estimated.
    pub scatter: Scatter,
    /// What was held at a guess or has a prior, in words.
    pub held_fixed: Vec<String>,
    pub at_bounds: Vec<String>,
    pub not_identifiable: Vec<String>,
}

impl Identification {
    /// The expected signal y_hat = C e^{At} x_a, N counts; sample 0 lies at t_a.
    pub fn expected(&self, dt_s: f64, samples: usize) -> Vec<f64> {
        let dt_us = dt_s * 1e6;
        let c = Vector3::from(per_us(self.output_state));
        (basis(cubic_per_us(self.cubic), dt_us, samples) * c).as_slice().to_vec()
    }
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Scatter {
    /// Both: standard deviation over signals beyond the noise, relative.
    pub damping_sd: f64,
    pub frequency_sd: f64,
    /// Standard error of the mean over channels, relative; 0 where there are too few channels.
    pub damping_se: f64,
    pub frequency_se: f64,
}

/// Standard deviations of what one decay identifies; damping's and frequency's at least the
/// standard errors over channels ([`Scatter`]).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Uncertainty {
    pub damping_sd_per_s: f64,
    pub frequency_sd_hz: f64,
    pub lambda_sd_per_s: f64,
    pub cubic_sd: [f64; 3],
    /// Of (p2, p1, p0) in 1/µs units, rows.
    pub cubic_covariance_us: [[f64; 3]; 3],
    /// Standard deviation of one sample of the fitted signal on which all of this rests, counts.
    pub noise: f64,
}
