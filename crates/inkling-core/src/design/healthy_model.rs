//! A healthy model: what a healthy signal of one printhead looks like, and from where on a signal
//! is flagged. It holds the identified channel, the FD filter, the effect of temperature, and the
//! statistics with their thresholds, all learned from one window or from labelled signals.
//!
//! `learn` makes models, `checks` validates models that were read from a file, `judge` uses them.
//! Here is what follows from a model's numbers: the expected signal y_hat at a drive s and a
//! temperature, s (y + K above the reference * response), signals corrected to the reference drive
//! and temperature, and the drift from one model to another.

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
    /// Numbers of signals and of channels that the average was taken over.
    pub n_signals: usize,
    pub n_channels: usize,
    /// Standard deviation of one healthy signal about the mean, pooled over samples, counts.
    pub scatter: f64,
    /// Standard deviation of one sample's noise, counts.
    pub noise: f64,
    /// Mean recorded temperature of the window, °C: the model's reference temperature. `None`: not
    /// recorded.
    pub temperature_c: Option<f64>,
    /// The identified channel, its poles and its state at t_a, thesis (3-1).
    pub identification: Identification,
    /// The expected signal y_hat = C e^{At} x_a_hat at the reference drive, N, counts; with
    /// `detect.method` = `sensitivity` plus the `leftover`.
    pub expected: Vec<f64>,
    /// The mean misfit of healthy signals beside their rings, which is part of `expected`, N,
    /// counts; empty: there is none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub leftover: Vec<f64>,
    /// d y_hat / d temperature, counts/K; absent: temperature was not recorded or has no
    /// significant effect.
    pub temperature_response: Option<Vec<f64>>,
    /// Relative change of damping and of resonance per K; 0 where the effect of temperature is not
    /// known.
    pub damping_per_k: f64,
    pub frequency_per_k: f64,
    /// The FD filter.
    pub generator: ResidualGenerator,
    /// The threshold on the statistic of the first (or only) test.
    pub threshold: Threshold,
    /// Distribution of the healthy channels along the model's sensitivities, for `detect.method` =
    /// `sensitivity`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensitivity: Option<Sensitivity>,
    /// What `detect.method` = `residual-maximum` or `practice` computes; absent with the other
    /// methods.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub statistic: Option<Statistic>,
    /// Disturbances that are removed from a deviation before the filter, with `detect.decouple`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub decoupled: Option<KnownShapes>,
    /// Distribution of healthy misfits beside the ring, for the second test; absent: there is no
    /// second test.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub misfit: Option<Misfit>,
    /// Share of the signals labelled healthy that are outliers, where these raise the threshold
    /// much (`tuned::suspect`); else `None`. It is only used to warn after training.
    #[serde(skip)]
    pub apart: Option<f64>,
    /// Median statistic of the first test over the window's signals, in the unit of `threshold`.
    pub median_statistic: f64,
}

impl HealthyModel {
    /// The threshold in units of the median healthy statistic.
    pub fn in_medians(&self) -> f32 {
        (self.threshold.value / self.median_statistic) as f32
    }

    /// The median healthy statistic over the mean that the model's metric gives. Unlike the median
    /// itself, this does not depend on which share of the channels' spread the metric counts.
    pub fn typical_distance(&self) -> f64 {
        self.median_statistic / self.sensitivity.as_ref().map_or(1.0, Sensitivity::mean_square)
    }

    /// Writes signal `i` of a set, corrected to the reference drive and temperature, to `y`; N,
    /// counts.
    pub(super) fn at_reference(&self, set: &SignalSet, i: usize, y: &mut [f64]) {
        let (drive, warmer) = (set.drive[i], self.warmer(set.temperature_c[i]));
        y.iter_mut().zip(set.signal(i)).for_each(|(y, v)| *y = f64::from(*v) / drive);
        self.warm(-warmer, y);
    }

    /// Adds to `y`, a healthy signal at the reference drive, what `warmer` K change in it; N,
    /// counts.
    pub(super) fn warm(&self, warmer: f64, y: &mut [f64]) {
        if let Some(response) = self.temperature_response.as_ref().filter(|_| warmer != 0.0) {
            y.iter_mut().zip(response).for_each(|(y, slope)| *y += warmer * slope);
        }
    }

    /// Change of a ring's features per K. It holds for healthy rings and about so for faulty ones,
    /// since temperature shifts the features of both alike (the signals themselves it changes
    /// differently). 0 where the effect is not known. `fitter`: of rings about the model's ring.
    pub(super) fn features_per_k(&self, fitter: &RingFitter) -> Vector4<f64> {
        let response = self.temperature_response.as_deref();
        response.and_then(|response| fitter.features_of(response)).unwrap_or_default()
    }

    /// ln damping and ln frequency of this model's ring, relative to `ring`, at a temperature
    /// `warmer` K above the model's.
    pub(super) fn ring_from(&self, ring: &Ring, warmer: f64) -> [f64; 2] {
        let poles = self.identification.poles;
        [
            (poles.damping_per_s / ring.damping_per_s).ln() + warmer * self.damping_per_k,
            (poles.frequency_hz / ring.frequency_hz).ln() + warmer * self.frequency_per_k,
        ]
    }

    /// Writes to `out` a signal per unit drive, N, counts, from its deviation: (expected +
    /// deviation / drive) at the reference temperature, plus what `warmer` K change. With the
    /// signal's own `warmer` the result is at the signal's own temperature, with 0 at the model's.
    /// `deviation`: from what is expected at the signal's drive and temperature.
    pub(super) fn per_drive(&self, deviation: &[f64], drive: f64, warmer: f64, out: &mut Vec<f64>) {
        out.clear();
        out.extend(self.expected.iter().zip(deviation).map(|(e, d)| e + d / drive));
        self.warm(warmer, out);
    }

    /// How many K a temperature lies above the model's; 0 where it is unknown (NaN) or has no
    /// effect.
    pub fn warmer(&self, temperature_c: f64) -> f64 {
        match (&self.temperature_response, self.temperature_c) {
            (Some(_), Some(reference)) if temperature_c.is_finite() => temperature_c - reference,
            _ => 0.0,
        }
    }

    /// Writes to `out` the expected signal y_hat at a relative drive and a temperature (NaN: not
    /// recorded), N, counts: drive * (expected + K above the reference * response).
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

    /// Calls `see` with the index, the deviation (N, counts) and the drive of every signal of a
    /// set. The deviation is from what the model expects at the signal's drive and temperature.
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

    /// Relative drift (frequency, damping) from this model to `later`, beyond what the recorded
    /// temperatures explain. The effect of temperature is that of this model, or else of `later`;
    /// where neither knows it, or a temperature was not recorded, the whole change counts.
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

/// Deviations per unit drive of all signals from what their printheads' models expect; N each,
/// counts. `sets`: signals with the model of their printhead.
pub(super) fn deviations(sets: &[(&HealthyModel, &SignalSet)]) -> Vec<Vec<f64>> {
    let mut all = Vec::new();
    for (model, set) in sets {
        model.each_deviation(set, |_, deviation, drive| {
            all.push(deviation.iter().map(|d| d / drive).collect());
        });
    }
    all
}
