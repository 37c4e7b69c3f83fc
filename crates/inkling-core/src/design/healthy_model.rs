//! A healthy model: identification, filter and threshold of one window. How it is learned stands in `learn`,
//! the validation of one that was read from a file in `checks`.

use super::Statistic;
use crate::detect::ResidualGenerator;
use crate::detect::decoupling::KnownShapes;
use crate::detect::misfit::Misfit;
use crate::detect::sensitivity::Sensitivity;
use crate::detect::threshold::Threshold;
use crate::identify::averaging::SignalSet;
use crate::identify::grey_box::Identification;
use crate::model::ring::Ring;
use crate::model::ring_fit::RingFitter;
use nalgebra::Vector4;
use serde::{Deserialize, Serialize};

/// One identified model with its x_a_hat, poles and threshold, thesis §3-1 and §3-2.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct HealthyModel {
    /// The printhead whose signals it was learned from; `None`: pooled over printheads.
    pub printhead: Option<String>,
    /// Time from which on the model judges bursts, ns since the epoch; `None`: from the beginning.
    pub valid_from_ns: Option<i64>,
    pub n_signals: usize,
    pub n_channels: usize,
    /// Standard deviation of one healthy signal about the mean, pooled over samples, counts.
    pub scatter: f64,
    /// Standard deviation of one sample's noise, counts.
    pub noise: f64,
    /// Mean recorded temperature of the window, °C; `None`: not recorded.
    pub temperature_c: Option<f64>,
    pub identification: Identification,
    /// The expected signal y_hat = C e^{At} x_a_hat at the reference drive, N, counts; with `detect.method` =
    /// `sensitivity` plus the `leftover`.
    pub expected: Vec<f64>,
    /// The mean misfit of healthy signals beside their rings, which is part of `expected`, N, counts; empty:
    /// there is none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub leftover: Vec<f64>,
    /// d y_hat / d temperature, counts/K; absent: temperature was not recorded or has no significant effect.
    pub temperature_response: Option<Vec<f64>>,
    /// Relative change of damping and of resonance per K; 0 where the effect of temperature is not known.
    pub damping_per_k: f64,
    pub frequency_per_k: f64,
    pub generator: ResidualGenerator,
    pub threshold: Threshold,
    /// Distribution of the healthy channels along the model's sensitivities, for `detect.method` =
    /// `sensitivity`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensitivity: Option<Sensitivity>,
    /// What `detect.method` = `residual-maximum` or `practice` computes; absent with the other methods.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub statistic: Option<Statistic>,
    /// Disturbances that are removed from a deviation before the filter, with `detect.decouple`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub decoupled: Option<KnownShapes>,
    /// Distribution of healthy misfits beside the ring, for the second test; absent: there is no second test.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub misfit: Option<Misfit>,
    /// Share of the signals labelled healthy that are outliers, where that raises the threshold noticeably.
    /// It is only used to warn after training.
    #[serde(skip)]
    pub apart: Option<f64>,
    /// Median detection statistic of the window's signals.
    pub median_statistic: f64,
}

impl HealthyModel {
    /// The threshold over the median of healthy statistics.
    pub fn in_medians(&self) -> f32 {
        (self.threshold.value / self.median_statistic) as f32
    }

    /// The median of healthy statistics by a measure that does not depend on how much of the channels' spread
    /// the model's metric counts.
    pub fn typical_distance(&self) -> f64 {
        self.median_statistic / self.sensitivity.as_ref().map_or(1.0, Sensitivity::mean_square)
    }

    /// Writes signal `i` of a set corrected to the reference drive and temperature, N, counts.
    pub(super) fn at_reference(&self, set: &SignalSet, i: usize, y: &mut [f64]) {
        let (drive, warmer) = (set.drive[i], self.warmer(set.temperature_c[i]));
        y.iter_mut().zip(set.signal(i)).for_each(|(y, v)| *y = f64::from(*v) / drive);
        self.warm(-warmer, y);
    }

    /// Adds to a signal at the reference drive what `warmer` K change in it, N, counts.
    pub(super) fn warm(&self, warmer: f64, y: &mut [f64]) {
        if let Some(response) = self.temperature_response.as_ref().filter(|_| warmer != 0.0) {
            y.iter_mut().zip(response).for_each(|(y, slope)| *y += warmer * slope);
        }
    }

    /// Change of a ring's features per K, of a healthy ring as of a faulty one: temperature shifts the
    /// features of both by about the same, unlike the signals themselves. 0 where the effect is not known.
    pub(super) fn features_per_k(&self, fitter: &RingFitter) -> Vector4<f64> {
        let response = self.temperature_response.as_deref();
        response.and_then(|response| fitter.features_of(response)).unwrap_or_default()
    }

    /// ln damping and ln frequency of this model's ring at a temperature `warmer` K above its window's,
    /// relative to `ring`.
    pub(super) fn ring_from(&self, ring: &Ring, warmer: f64) -> [f64; 2] {
        let poles = self.identification.poles;
        [
            (poles.damping_per_s / ring.damping_per_s).ln() + warmer * self.damping_per_k,
            (poles.frequency_hz / ring.frequency_hz).ln() + warmer * self.frequency_per_k,
        ]
    }

    /// Writes a signal per unit drive, at its own temperature, N, counts. `deviation`: the signal's, from
    /// what is expected at its drive and temperature.
    pub(super) fn per_drive(&self, deviation: &[f64], drive: f64, warmer: f64, out: &mut Vec<f64>) {
        out.clear();
        out.extend(self.expected.iter().zip(deviation).map(|(e, d)| e + d / drive));
        self.warm(warmer, out);
    }

    /// How many K a temperature lies above the model's; 0 where it is unknown (NaN) or has no effect.
    pub fn warmer(&self, temperature_c: f64) -> f64 {
        match (&self.temperature_response, self.temperature_c) {
            (Some(_), Some(reference)) if temperature_c.is_finite() => temperature_c - reference,
            _ => 0.0,
        }
    }

    /// Writes the expected signal y_hat at a drive and temperature (NaN: not recorded), N, counts: drive
    /// times (y + K above the reference times the response).
    pub fn expect(&self, drive: f64, temperature_c: f64, out: &mut [f64]) {
        let warmer = self.warmer(temperature_c);
        match &self.temperature_response {
            Some(response) if warmer != 0.0 => {
                for ((y, e), slope) in out.iter_mut().zip(&self.expected).zip(response) {
                    *y = drive * (e + warmer * slope);
                }
            }
            _ => out.iter_mut().zip(&self.expected).for_each(|(y, e)| *y = drive * e),
        }
    }

    /// Calls `see` with the index, the deviation and the drive of every signal of a set.
    pub fn each_deviation(&self, set: &SignalSet, mut see: impl FnMut(usize, &[f64], f64)) {
        let mut deviation = vec![0.0; set.samples];
        for i in 0..set.len() {
            self.expect(set.drive[i], set.temperature_c[i], &mut deviation);
            for (d, &y) in deviation.iter_mut().zip(set.signal(i)) {
                *d = f64::from(y) - *d;
            }
            see(i, &deviation, set.drive[i]);
        }
    }

    /// Relative drift (frequency, damping) of `later` from this model, beyond what the recorded
    /// temperatures explain where one of the two knows their effect.
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

/// Deviations per unit drive of all signals from what their printheads' models expect, counts.
pub(super) fn deviations(sets: &[(&HealthyModel, &SignalSet)]) -> Vec<Vec<f64>> {
    let mut all = Vec::new();
    for (model, set) in sets {
        model.each_deviation(set, |_, deviation, drive| {
            all.push(deviation.iter().map(|d| d / drive).collect());
        });
    }
    all
}
