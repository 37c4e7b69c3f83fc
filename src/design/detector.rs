//! The detection statistic of one model: what is compared with its threshold.

use super::DesignError;
use super::own_channel::Own;
use crate::detect::sensitivity::{CLEARLY_FAR, SECOND_LOOK, Sensitivity};
use crate::identify::grey_box::Identification;
use crate::model::ring::Ring;
use crate::model::ring_fit::{Features, Fit, RingFitter};
use nalgebra::{Matrix3, Matrix3x4, Matrix4, Vector3};

/// `detect.method` = `sensitivity`, ready for one model.
#[derive(Clone, Debug)]
pub struct SensitivityDetector {
    sensitivity: Sensitivity,
    fitter: RingFitter,
    expected: Vec<f64>,
    pub(super) own: OwnFrame,
}

/// How a channel's own four features are seen, and how they look in the three of the statistic.
#[derive(Clone, Debug)]
pub(super) struct OwnFrame {
    /// Four rows of N: the features per unit of deviation at the reference drive.
    pub projection: Vec<Vec<f64>>,
    pub noise: Matrix4<f64>,
    to_three: Matrix3x4<f64>,
}

impl OwnFrame {
    /// `None`: amplitude, damping, frequency and phase cannot be told apart.
    fn new(fitter: &RingFitter, sensitivity: &Sensitivity, noise: f64) -> Option<OwnFrame> {
        let tangent = fitter.tangent(&Features::HEALTHY);
        let inverse = tangent.tr_mul(&tangent).try_inverse()?;
        let projection = &inverse * tangent.transpose();
        let to_three = Matrix3x4::from_fn(|i, j| {
            sensitivity.projection[i].iter().zip(tangent.column(j).iter()).map(|(p, t)| p * t).sum()
        });
        Some(OwnFrame {
            projection: projection.row_iter().map(|r| r.iter().copied().collect()).collect(),
            noise: Matrix4::from_fn(|i, j| inverse[(i, j)] * noise * noise),
            to_three,
        })
    }
}

/// A signal's features to first order, and its squared distance by them.
#[derive(Clone, Copy, Debug)]
pub struct FirstLook {
    features: Vector3<f64>,
    pub distance: f64,
    /// Where first order does not settle it: the whitening of the second look.
    near: Option<Matrix3<f64>>,
}

impl FirstLook {
    /// Near what the second look finds its ring; `None`: there is none.
    pub fn asks(&self) -> Option<Features> {
        self.near.map(|_| features(&self.features))
    }
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
        // of one sample, from what it leaves in the amplitude
        let of_amplitude: f64 = sensitivity.projection[0].iter().map(|p| p * p).sum();
        let noise = (sensitivity.noise[0][0] / of_amplitude).sqrt();
        let own = OwnFrame::new(&fitter, &sensitivity, noise)
            .ok_or_else(|| DesignError::Invalid("the model's phase cannot be told".into()))?;
        Ok(SensitivityDetector { sensitivity, fitter, expected: expected.to_vec(), own })
    }

    /// The same statistic about the channel's own baseline: squared distance in what one channel's
    /// signals scatter by.
    pub fn statistic_of_own(
        &self,
        deviation: &[f64],
        drive: f64,
        own: &Own,
        scratch: &mut Scratch,
    ) -> f64 {
        let to_three = &self.own.to_three;
        let scatter = to_three * own.scatter(&self.own.noise) * to_three.transpose();
        let noise = Matrix3::from_fn(|i, j| self.sensitivity.noise[i][j]) / (drive * drive);
        let Some(metric) = (scatter + noise).try_inverse() else { return f64::INFINITY };
        let centre = to_three * own.baseline;
        let distance = |x: &Vector3<f64>| (x - centre).dot(&(metric * (x - centre)));
        let first = self.sensitivity.features(deviation, drive);
        if distance(&first) <= SECOND_LOOK {
            return distance(&first);
        }
        let fitted = self.fitted(&first, deviation, drive, scratch);
        fitted.map_or(distance(&first), |x| distance(&x))
    }

    /// Squared Mahalanobis distance of a signal from the healthy channels. `deviation`: from what is
    /// expected at its drive and temperature, counts.
    pub fn statistic(&self, deviation: &[f64], drive: f64, scratch: &mut Scratch) -> f64 {
        let look = self.first_look(deviation, drive);
        match look.asks() {
            None => look.distance,
            Some(near) => {
                self.at_reference(deviation, drive, &mut scratch.signal);
                let fit = self.fitter.fit_from(&scratch.signal, &near, false);
                self.second_look(&look, fit.as_ref())
            }
        }
    }

    /// To first order.
    pub fn first_look(&self, deviation: &[f64], drive: f64) -> FirstLook {
        let features = self.sensitivity.features(deviation, drive);
        let Some(metric) = self.sensitivity.metric(drive) else {
            return FirstLook { features, distance: f64::INFINITY, near: None };
        };
        let distance = self.sensitivity.distance(&metric, &features);
        let settled = distance <= SECOND_LOOK || distance >= CLEARLY_FAR;
        FirstLook { features, distance, near: (!settled).then_some(metric) }
    }

    /// The statistic by the fit that a first look asked for.
    pub fn second_look(&self, look: &FirstLook, fit: Option<&Fit>) -> f64 {
        match (fit, &look.near) {
            (Some(fit), Some(metric)) => self.sensitivity.distance(metric, &three(fit)),
            _ => look.distance,
        }
    }

    /// What fits signals for a second look, the phase held, as they would be at the reference drive and
    /// temperature.
    pub fn fitter(&self) -> &RingFitter {
        &self.fitter
    }

    /// Leaves a signal as it would be at the reference drive and temperature, counts.
    fn at_reference(&self, deviation: &[f64], drive: f64, out: &mut Vec<f64>) {
        out.clear();
        out.extend(self.expected.iter().zip(deviation).map(|(e, d)| e + d / drive));
    }

    /// (ln A, ln sigma, ln f) of the signal as it would be at the reference drive and temperature.
    fn fitted(
        &self,
        first: &Vector3<f64>,
        deviation: &[f64],
        drive: f64,
        scratch: &mut Scratch,
    ) -> Option<Vector3<f64>> {
        self.at_reference(deviation, drive, &mut scratch.signal);
        let fit = self.fitter.fit_from(&scratch.signal, &features(first), false)?;
        Some(three(&fit))
    }
}

fn three(fit: &Fit) -> Vector3<f64> {
    let x = fit.features;
    Vector3::new(x.ln_amplitude, x.ln_damping, x.ln_frequency)
}

fn features(x: &Vector3<f64>) -> Features {
    Features { ln_amplitude: x[0], ln_damping: x[1], ln_frequency: x[2], phase_rad: 0.0 }
}
