//! The detection statistic of one model: what is compared with its threshold.

use super::DesignError;
use crate::detect::sensitivity::{CLEARLY_FAR, SECOND_LOOK, Sensitivity};
use crate::identify::grey_box::Identification;
use crate::model::ring::Ring;
use crate::model::ring_fit::{Features, RingFitter};
use nalgebra::Vector3;

/// `detect.method` = `sensitivity`, ready for one model.
#[derive(Clone, Debug)]
pub struct SensitivityDetector {
    sensitivity: Sensitivity,
    fitter: RingFitter,
    expected: Vec<f64>,
}

/// Scratch of one worker.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    signal: Vec<f64>,
}

/// The ring of an identified model.
pub fn ring_of(identification: &Identification) -> Result<Ring, DesignError> {
    Ring::new(identification.poles, identification.output_state)
        .ok_or_else(|| DesignError::Invalid("the identified model does not ring".into()))
}

impl SensitivityDetector {
    /// `expected`: y_hat at the reference drive, counts.
    pub fn new(
        identification: &Identification,
        sensitivity: Sensitivity,
        expected: &[f64],
        dt_s: f64,
    ) -> Result<SensitivityDetector, DesignError> {
        let fitter = RingFitter::new(ring_of(identification)?, dt_s, expected.len());
        Ok(SensitivityDetector { sensitivity, fitter, expected: expected.to_vec() })
    }

    /// Squared Mahalanobis distance of a signal from the healthy channels. `deviation`: from what is
    /// expected at its drive and temperature, counts.
    pub fn statistic(&self, deviation: &[f64], drive: f64, scratch: &mut Scratch) -> f64 {
        let Some(metric) = self.sensitivity.metric(drive) else { return f64::INFINITY };
        let first = self.sensitivity.features(deviation, drive);
        let distance = self.sensitivity.distance(&metric, &first);
        if distance <= SECOND_LOOK || distance >= CLEARLY_FAR {
            return distance;
        }
        match self.fitted(&first, deviation, drive, scratch) {
            Some(fitted) => self.sensitivity.distance(&metric, &fitted),
            None => distance,
        }
    }

    /// (ln A, ln sigma, ln f) of the signal as it would be at the reference drive and temperature.
    fn fitted(
        &self,
        first: &Vector3<f64>,
        deviation: &[f64],
        drive: f64,
        scratch: &mut Scratch,
    ) -> Option<Vector3<f64>> {
        scratch.signal.clear();
        let at_reference = self.expected.iter().zip(deviation).map(|(e, d)| e + d / drive);
        scratch.signal.extend(at_reference);
        let near = Features {
            ln_amplitude: first[0],
            ln_damping: first[1],
            ln_frequency: first[2],
            phase_rad: 0.0,
        };
        let fit = self.fitter.fit_from(&scratch.signal, &near, false)?;
        let x = fit.features;
        Some(Vector3::new(x.ln_amplitude, x.ln_damping, x.ln_frequency))
    }
}
