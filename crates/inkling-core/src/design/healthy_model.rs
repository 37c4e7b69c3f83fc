//! A healthy model: what a healthy signal of one printhead looks like, and from where on a signal
//! is flagged, all learned from one window or from labelled signals.
//!
//! Here is what follows from its numbers: the expected signal y_hat at a drive s and a temperature,
//! s (y + K above the reference * response), corrected signals, noise, and drift between models.

use super::tuned;
use crate::detect::ResidualGenerator;
use crate::detect::lane_sensitivity::{LaneSensitivity, Limits};
use crate::detect::misfit::Misfit;
use crate::detect::sensitivity::{CLEARLY_FAR, SECOND_LOOK, Sensitivity};
use crate::detect::threshold::Threshold;
use crate::identify::SignalSet;
use crate::identify::grey_box::Identification;
use crate::model::ring::Ring;
use crate::model::ring_fit::RingFitter;
use nalgebra::Vector4;
use serde::{Deserialize, Serialize};

/// One identified model with its x_a_hat, poles and threshold, thesis §3-1 and §3-2.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HealthyModel {
    /// Whose signals it was learned from; `None`: pooled over printheads.
    pub printhead: Option<String>,
    /// Time from which on the model judges bursts, ns since the epoch; `None`: from the beginning.
    pub valid_from_ns: Option<i64>,
    pub n_signals: usize,
    pub n_channels: usize,
    /// Standard deviation of one healthy signal about the mean, pooled over samples, counts.
    pub scatter: f64,
    pub noise: f64,
    /// Mean recorded temperature of the window, °C: the model's reference temperature.
    pub temperature_c: Option<f64>,
    pub identification: Identification,
    /// y_hat = C e^{At} x_a_hat plus the `leftover`, if any, at the reference drive, N, counts.
    pub expected: Vec<f64>,
    /// The part of `expected` beside the ring, N, counts: the mean misfit of healthy signals.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub leftover: Vec<f64>,
    /// Where signals stand while nothing rings, counts, at any drive; `expected` does not hold it.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub offset: f64,
    /// d y_hat / d temperature, counts/K; absent: not recorded or no significant effect.
    pub temperature_response: Option<Vec<f64>>,
    /// Relative change of damping and of resonance per K; 0: not known.
    pub damping_per_k: f64,
    pub frequency_per_k: f64,
    /// Covariance, over channels, of what a kelvin does to a channel's ln amplitude, ln damping, ln frequency and phase in
    /// rad beside what it does to all of them; `None`: not known.
    #[serde(default)]
    pub channels_per_k: Option<[[f64; 4]; 4]>,
    /// How many K above `temperature_c` its ring, expected signal and sensitivities lie: 0 unless it was moved there.
    #[serde(skip)]
    pub moved_k: f64,
    pub generator: ResidualGenerator,
    pub threshold: Threshold,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensitivity: Option<Sensitivity>,
    /// Whether the statistic is the residual's largest sample, counts, and not its energy.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub by_maximum: bool,
    /// Distribution of healthy misfits beside the ring; absent: there is no second test.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub misfit: Option<Misfit>,
    /// Share of the signals labelled healthy that raise the threshold much; training warns of it.
    #[serde(skip)]
    pub apart: Option<f64>,
    /// Median statistic of the first test over the window's signals, in the unit of `threshold`.
    pub median_statistic: f64,
}

fn is_zero(x: &f64) -> bool {
    *x == 0.0
}

impl HealthyModel {
    /// Distances of many signals at once, in f32. `None`: the statistic is of the residual, or a
    /// number is out of the range of f32. An offset is taken off in f64 alone.
    pub(super) fn lanes(&self) -> Option<LaneSensitivity> {
        if self.offset != 0.0 {
            return None;
        }
        let response = self.temperature_response.as_deref();
        LaneSensitivity::new(self.sensitivity.as_ref()?, &self.expected, response)
    }

    /// What the lanes settle lies surely on one side of the threshold, and needs no fit: the near
    /// limit is not above the threshold and the far one not below it.
    pub fn limits(&self) -> Limits {
        let threshold = self.threshold.value;
        Limits {
            near: threshold.min(SECOND_LOOK),
            far: threshold.max(CLEARLY_FAR),
            unexplained: self.misfit.as_ref().map_or(f64::INFINITY, Misfit::settled_square),
        }
    }

    pub fn in_medians(&self) -> f32 {
        (self.threshold.value / self.median_statistic) as f32
    }

    /// The median healthy statistic over the mean by the metric, whatever share it counts.
    pub fn typical_distance(&self) -> f64 {
        self.median_statistic / self.sensitivity.as_ref().map_or(1.0, Sensitivity::mean_square)
    }

    /// Standard deviation, counts, of white noise that would scatter fitted rings as much as the
    /// model's noise, which may be coloured.
    pub(super) fn noise_of_fits(&self) -> f64 {
        self.sensitivity.as_ref().map_or(self.noise, Sensitivity::noise_of_one_sample)
    }

    /// Standard deviation of one sample's noise, counts, from the mean misfit of healthy signals
    /// beside their rings; where there is no second test, [`HealthyModel::noise`].
    pub(super) fn noise_beside(&self) -> f64 {
        let of_misfit = |misfit: &Misfit| (misfit.square / self.expected.len() as f64).sqrt();
        self.misfit.as_ref().map_or(self.noise, of_misfit)
    }

    /// Adds to `y`, a healthy signal at the reference drive, what `warmer` K change; N, counts.
    pub(super) fn warm(&self, warmer: f64, y: &mut [f64]) {
        if let Some(response) = self.temperature_response.as_ref().filter(|_| warmer != 0.0) {
            y.iter_mut().zip(response).for_each(|(y, slope)| *y += warmer * slope);
        }
    }

    /// Change of a ring's features per K, 0: not known. It holds for healthy rings and about so for
    /// faulty ones (the signals themselves change differently).
    pub(super) fn features_per_k(&self, fitter: &RingFitter) -> Vector4<f64> {
        let response = self.temperature_response.as_deref();
        response.and_then(|response| fitter.features_of(response)).unwrap_or_default()
    }

    /// ln damping and ln frequency of this model's ring at `warmer` K more, relative to `ring`.
    pub(super) fn ring_from(&self, ring: &Ring, warmer: f64) -> [f64; 2] {
        let poles = self.identification.poles;
        [
            (poles.damping_per_s / ring.damping_per_s).ln() + warmer * self.damping_per_k,
            (poles.frequency_hz / ring.frequency_hz).ln() + warmer * self.frequency_per_k,
        ]
    }

    /// Writes to `out` a signal per unit drive, N, counts, at a temperature `warmer` K above the
    /// model's. `deviation`: from what is expected at the signal's own drive and temperature.
    pub(super) fn per_drive(&self, deviation: &[f64], drive: f64, warmer: f64, out: &mut Vec<f64>) {
        out.clear();
        out.extend(self.expected.iter().zip(deviation).map(|(e, d)| e + d / drive));
        self.warm(warmer, out);
    }

    /// How many K a temperature lies above where the model is; 0: without effect, or it is unknown (NaN) or not to be
    /// believed. Then it is taken for what it was last, where the model was moved to: ink does not jump from burst to
    /// burst, sensors do.
    pub fn warmer(&self, temperature_c: f64) -> f64 {
        match (&self.temperature_response, self.temperature_c) {
            (Some(_), Some(reference)) if self.believes(temperature_c) => {
                temperature_c - reference - self.moved_k
            }
            _ => 0.0,
        }
    }

    /// Whether a recorded temperature may be that of the ink: what is far from the model's was recorded in another
    /// unit, or is a sensor's word for a fault.
    pub fn believes(&self, temperature_c: f64) -> bool {
        let off = self.temperature_c.map_or(0.0, |reference| temperature_c - reference);
        off.abs() <= tuned::REACH_K
    }

    /// Writes the expected signal y_hat, N, counts. `temperature_c`: NaN: not recorded.
    pub fn expect(&self, drive: f64, temperature_c: f64, out: &mut [f64]) {
        out.iter_mut().zip(&self.expected).for_each(|(y, e)| *y = *e);
        self.warm(self.warmer(temperature_c), out);
        out.iter_mut().for_each(|y| *y *= drive);
    }

    /// Calls `see` with the index, the deviation (N, counts) and the drive of every signal of a set.
    pub fn each_deviation(&self, set: &SignalSet, mut see: impl FnMut(usize, &[f64], f64)) {
        let mut deviation = vec![0.0; set.samples];
        for i in 0..set.len() {
            self.expect(set.drive[i], set.temperature_c[i], &mut deviation);
            for (d, &y) in deviation.iter_mut().zip(set.signal(i)) {
                *d = f64::from(y) - self.offset - *d;
            }
            see(i, &deviation, set.drive[i]);
        }
    }

    /// Relative drift (frequency, damping) from this model to `later`, beyond what the recorded
    /// temperatures explain by this model's effect of temperature, or else `later`'s.
    pub fn drift_to(&self, later: &HealthyModel) -> (f64, f64) {
        let knows = if self.temperature_response.is_some() { self } else { later };
        let warmer = match (self.temperature_c, later.temperature_c) {
            (Some(here), Some(there)) => there - here,
            _ => 0.0,
        };
        let (p, q) = (self.identification.poles, later.identification.poles);
        (
            q.frequency_hz / (p.frequency_hz * (1.0 + warmer * knows.frequency_per_k)) - 1.0,
            q.damping_per_s / (p.damping_per_s * (1.0 + warmer * knows.damping_per_k)) - 1.0,
        )
    }
}

/// Deviations per unit drive of all signals, N each, counts, by the model of their printhead.
pub(super) fn deviations(sets: &[(&HealthyModel, &SignalSet)]) -> Vec<Vec<f64>> {
    let mut all = Vec::new();
    for (model, set) in sets {
        model.each_deviation(set, |_, deviation, drive| {
            all.push(deviation.iter().map(|d| d / drive).collect());
        });
    }
    all
}
