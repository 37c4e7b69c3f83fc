//! The two detection statistics of one model (`detect.method` = `sensitivity`): along the
//! sensitivities of its ring (the derivatives by ln amplitude, ln damping and ln frequency), and
//! orthogonal to them, that is, beside the ring.
//!
//! In, from a [`super::Judge`] or the filter stage (`pipeline/statistics.rs`): a signal's deviation
//! d from the expected signal, N, counts, and its relative drive s. Out: [`Detection`]; for channels
//! that are judged by their own levels also four features and the distance from a baseline.
//!
//! With P the pseudoinverse of the three sensitivities T (phase held), x = P d / s are the features
//! to first order; the first statistic is the squared Mahalanobis distance of x from the healthy
//! mean, the second one the misfit |d|² - |T P d|². This is the *first look*. Where it does not
//! decide (a squared distance between `SECOND_LOOK` and `CLEARLY_FAR`, or a large misfit), the
//! *second look* fits a ring: with the phase held for the distance, free for the misfit.

use super::feature_estimator::FeatureEstimator;
use super::own_channel::{Behind, OwnBaseline, OwnChannels};
use super::rings::Rings;
use super::{HealthyModel, Result, tuned};
use crate::detect::misfit::Misfit;
use crate::detect::row_projection::Columns;
use crate::detect::sensitivity::{CLEARLY_FAR, SECOND_LOOK, Sensitivity};
use crate::model::inner_product::dot;
use crate::model::ring_fit::{Features, Fit, RingFitter};
use nalgebra::{Matrix3, Matrix4, Vector3, Vector4};

pub(super) const DEPENDENT_SENSITIVITIES: &str =
    "amplitude, damping and frequency cannot be told apart";

#[derive(Clone, Copy, Debug)]
pub struct Detection {
    /// The statistic of the first test: the squared distance along the sensitivities, without unit;
    /// or the statistic of another `detect.method`, such as the residual energy, counts²·s.
    pub ring: f64,
    /// The misfit beside the ring, counts² at the signal's own drive. NaN: the method has no second
    /// test, or the signal lies so far along the ring that the first-order misfit says nothing.
    pub unexplained: f64,
}

#[derive(Clone, Debug)]
pub struct SensitivityDetector {
    sensitivity: Sensitivity,
    /// Gram matrix T'T of the three sensitivities, counts².
    gram: Matrix3<f64>,
    /// A first-order misfit up to this, counts², decides.
    pub(super) settled: f64,
    /// The largest misfit that the second test calls healthy, counts².
    ring_only: f64,
    pub(super) rings: Rings,
    /// The expected signal at the reference drive and temperature, N, counts.
    expected: Vec<f64>,
    /// What a kelvin does to it, N, counts, and to the features of its ring; empty and 0: not known.
    response: Vec<f64>,
    per_k: Vector4<f64>,
    estimator: FeatureEstimator,
}

/// The first-order statistics of a signal, and whether they decide or a fit is needed.
#[derive(Clone, Copy, Debug)]
pub struct FirstLook {
    features: Vector3<f64>,
    /// Squared distance along the ring, to first order.
    pub distance: f64,
    /// Misfit beside the ring, counts², at most a fit's, since phase and real pole are held.
    pub unexplained: f64,
    /// The metric of the distance, if that must be computed again from a fit.
    metric: Option<Matrix3<f64>>,
    /// Whether the misfit must be computed again from a fit.
    beside: bool,
}

impl FirstLook {
    /// Features to start a fit with the phase held from; `None`: no fit is needed.
    pub fn asks(&self) -> Option<Features> {
        (self.metric.is_some() || self.beside).then(|| features(&self.features))
    }

    /// Whether a second fit is needed, with the phase free, for the misfit.
    pub fn asks_beside(&self) -> bool {
        self.beside
    }

    /// From the features of the fit with the phase held, or if that failed of the first look.
    pub fn near(&self, held: Option<&Fit>) -> Features {
        held.map_or_else(|| features(&self.features), |fit| fit.features)
    }

    pub fn detection(&self) -> Detection {
        let far = self.distance >= CLEARLY_FAR;
        let unexplained = if far { f64::NAN } else { self.unexplained };
        Detection { ring: self.distance, unexplained }
    }
}

impl SensitivityDetector {
    /// `misfit`: the model's second test; `None`: there is none (yet), and no misfit asks for a fit.
    /// An error if the model does not ring, or if its sensitivities are linearly dependent.
    pub(super) fn new(
        model: &HealthyModel,
        sensitivity: Sensitivity,
        misfit: Option<&Misfit>,
    ) -> Result<SensitivityDetector> {
        let rings = model.rings()?;
        let estimator = FeatureEstimator::new(&rings.fitter, &sensitivity)
            .ok_or("the model's phase cannot be told")?;
        let gram = sensitivity.gram().ok_or(DEPENDENT_SENSITIVITIES)?;
        Ok(SensitivityDetector {
            sensitivity,
            gram,
            settled: misfit.map_or(f64::INFINITY, Misfit::settled_square),
            ring_only: misfit.map_or(f64::INFINITY, Misfit::healthy_square),
            expected: model.expected.clone(),
            response: model.temperature_response.clone().unwrap_or_default(),
            per_k: model.features_per_k(&rings.fitter),
            rings,
            estimator,
        })
    }

    /// Features of a signal (ln amplitude, ln damping, ln frequency, phase) relative to the model's
    /// ring, to second order and without a fit. `deviation`: N, counts; `drive`: relative.
    pub fn own_features(&self, deviation: &[f64], drive: f64) -> Vector4<f64> {
        self.straightened(self.to_first_order(deviation, drive), drive)
    }

    fn to_first_order(&self, deviation: &[f64], drive: f64) -> Vector4<f64> {
        Vector4::from_fn(|k, _| dot(&self.estimator.projection[k], deviation) / drive)
    }

    pub fn straightened(&self, first: Vector4<f64>, drive: f64) -> Vector4<f64> {
        self.estimator.straightened(first, drive).0
    }

    pub fn own_columns(&self) -> &Columns<4> {
        &self.estimator.columns
    }

    pub fn own_noise(&self) -> &Matrix4<f64> {
        &self.estimator.noise
    }

    /// The inverse covariance of a signal's distance from its channel's own level, in the three
    /// features. `behind`: how well the level is known. `None`: the covariance is singular.
    pub fn own_metric(
        &self,
        own: &OwnChannels,
        behind: Behind,
        drive: f64,
    ) -> Option<Matrix3<f64>> {
        let to_three = &self.estimator.to_three;
        let scatter = to_three * own.scatter(behind) * to_three.transpose();
        let noise = Matrix3::from_fn(|i, j| self.sensitivity.noise[i][j]) / (drive * drive);
        (scatter + noise).try_inverse()
    }

    /// The squared Mahalanobis distance of four features from a channel's baseline, and whether it
    /// decides. If not (the second order may be inaccurate), `own_distance` must.
    pub fn own_look(
        &self,
        metric: &Matrix3<f64>,
        features: &Vector4<f64>,
        own: &OwnBaseline,
    ) -> (f64, bool) {
        let x = self.estimator.to_three * (features - own.baseline);
        let distance = x.dot(&(metric * x));
        (distance, distance <= SECOND_LOOK)
    }

    /// Whether a signal says that the fault of its channel is over: it lies so much nearer to the channel's baseline
    /// than to where the fault is (`own.fault`).
    pub fn is_over(
        &self,
        metric: &Matrix3<f64>,
        features: &Vector4<f64>,
        own: &OwnBaseline,
    ) -> bool {
        let square = |from: Vector4<f64>| {
            let x = self.estimator.to_three * (features - from);
            x.dot(&(metric * x))
        };
        own.fault.is_some_and(|fault| square(fault) - square(own.baseline) > tuned::OVER)
    }

    /// The squared distance of a signal from a channel's baseline by a fitted ring. `near`:
    /// features to start from; `signal`: a buffer. `None`: no upright ring fits.
    pub fn own_distance(
        &self,
        metric: &Matrix3<f64>,
        (near, own): (&Vector4<f64>, &OwnBaseline),
        (deviation, drive): (&[f64], f64),
        signal: &mut Vec<f64>,
    ) -> Option<f64> {
        // what a fit with the phase held would find
        let near = self.estimator.to_three * near;
        self.at_reference(deviation, drive, signal);
        let fit = self.rings.fitter.fit_from(signal, &features(&near), false)?;
        let x = three(&fit)? - self.estimator.to_three * own.baseline;
        Some(x.dot(&(metric * x)))
    }

    /// Both statistics of a signal, refined by fits where the first look asks for them: the
    /// reference of what the filter stage does for many signals side by side. `signal`: a buffer.
    pub fn detect(&self, deviation: &[f64], drive: f64, signal: &mut Vec<f64>) -> Detection {
        let look = self.first_look(deviation, drive);
        let Some(near) = look.asks() else { return look.detection() };
        self.at_reference(deviation, drive, signal);
        let fitter = &self.rings.fitter;
        let held = fitter.fit_from(signal, &near, false);
        let near = look.asks_beside().then(|| look.near(held.as_ref()));
        let free = near.and_then(|near| fitter.fit_from(signal, &near, true));
        let free = free.as_ref().map(|fit| (signal.as_slice(), fit));
        self.second_look(&look, held.as_ref(), free, drive)
    }

    /// Both statistics to first order, and whether they decide. At a drive at which the covariance
    /// is singular the signal counts as infinitely far, which needs no fit.
    pub fn first_look(&self, deviation: &[f64], drive: f64) -> FirstLook {
        let features = self.sensitivity.features(deviation, drive);
        let along = features * drive;
        let unexplained = dot(deviation, deviation) - along.dot(&(self.gram * along));
        let Some(metric) = self.sensitivity.metric(drive) else {
            let (distance, beside) = (f64::INFINITY, false);
            return FirstLook { features, distance, unexplained, metric: None, beside };
        };
        let distance = self.sensitivity.distance(&metric, &features);
        // near enough or clearly far the first order decides; the latter is flagged in any case
        let settled = distance <= SECOND_LOOK || distance >= CLEARLY_FAR;
        let beside = distance < CLEARLY_FAR && unexplained > self.settled;
        let metric = (!settled).then_some(metric);
        FirstLook { features, distance, unexplained, metric, beside }
    }

    /// A signal's four features, from which printheads and channels are followed. `warmer`: K above the model's
    /// temperature; `far`: whether a fit may be made. `None`: it holds more than a ring; or only a fit would tell its
    /// features.
    pub(super) fn features_of_ring(
        &self,
        deviation: &[f64],
        (drive, warmer): (f64, f64),
        far: bool,
        signal: &mut Vec<f64>,
    ) -> Option<Vector4<f64>> {
        let (near, needs_fit) = self.near_features(deviation, drive, far);
        if !needs_fit {
            return Some(near);
        }
        if !far {
            return None;
        }

        // A lower bound on the fit's misfit than the second test's would lose printheads of warmer
        // ink, since what healthy signals hold beside their ring changes with the ink, too.
        self.at_own_temperature(deviation, (drive, warmer), signal);
        if dot(signal, &self.expected) >= 0.0 {
            return self.fitted_features(near, (drive, warmer), signal);
        }

        // A ring that is upside down (swapped wires) is half a turn away, which no search from the healthy ring
        // reaches. So the signal y is inverted, and deviates by -y - drive * expected. This is done once: a signal of
        // zeros is its own inverse, and which side it is on is chance.
        let inverted = signal.iter().zip(&self.expected).map(|(y, e)| -drive * (y + e));
        let mut inverted: Vec<f64> = inverted.collect();
        let warmth = self.response.iter().map(|slope| drive * warmer * slope);
        inverted.iter_mut().zip(warmth).for_each(|(y, warmth)| *y -= warmth);
        let (near, needs_fit) = self.near_features(&inverted, drive, far);
        self.at_own_temperature(&inverted, (drive, warmer), signal);
        let features = match needs_fit {
            true => self.fitted_features(near, (drive, warmer), signal)?,
            false => near,
        };
        Some(features + Vector4::new(0.0, 0.0, 0.0, std::f64::consts::PI))
    }

    /// A signal's features to second order, and whether only a fit tells them: the ring leaves much of the signal, or the
    /// signal lies far from the model's, where a fit may be made.
    fn near_features(&self, deviation: &[f64], drive: f64, far: bool) -> (Vector4<f64>, bool) {
        let first = self.to_first_order(deviation, drive);
        let along = first * drive;
        let left = dot(deviation, deviation) - along.dot(&(self.estimator.gram * along));
        let (near, is_near) = self.estimator.straightened(first, drive);
        let settled = left <= self.settled;
        (near, !settled || far && !is_near)
    }

    /// The signal of this deviation at reference drive and at its own temperature: corrected for that, a signal in
    /// which nothing rings would hold what is taken off.
    fn at_own_temperature(
        &self,
        deviation: &[f64],
        (drive, warmer): (f64, f64),
        signal: &mut Vec<f64>,
    ) {
        self.at_reference(deviation, drive, signal);
        signal.iter_mut().zip(&self.response).for_each(|(y, slope)| *y += warmer * slope);
    }

    /// The features of the ring that fits a signal best, near those given. `None`: it holds more than a ring.
    fn fitted_features(
        &self,
        near: Vector4<f64>,
        (drive, warmer): (f64, f64),
        signal: &[f64],
    ) -> Option<Vector4<f64>> {
        let fit = self.rings.fitter.fit_from(signal, &Features::from(near), true)?;
        // what a ring leaves of a larger signal is larger by as much, so that a louder head is a ring all the same
        let louder = fit.features.ln_amplitude.exp().max(1.0);
        let is_ring_only = self.unexplained(signal, &fit, drive) <= self.ring_only * louder.powi(2);
        // where a cable is out, noise alone leaves little, too: it says nothing of where the channel lies
        let noise = self.sensitivity.noise_of_one_sample() / drive;
        let features = || fit.features.coordinates() - warmer * self.per_k;
        (is_ring_only && is_ring(&fit, noise)).then(features)
    }

    /// Standard deviations of healthy signals' four features, noise included.
    pub(super) fn healthy_sd(&self) -> Vector4<f64> {
        (self.healthy_spread().diagonal() + self.estimator.noise.diagonal()).map(f64::sqrt)
    }

    /// Covariance of healthy channels' four features, without noise. Training holds the phase, so
    /// its variance is not known: the upper bound is taken, that which explains all the variance of
    /// ln frequency; its covariances are taken as 0.
    pub(super) fn healthy_spread(&self) -> Matrix4<f64> {
        let known = &self.sensitivity.spread;
        let of_phase = known[2][2] / self.estimator.to_three[(2, 3)].powi(2).max(f64::MIN_POSITIVE);
        Matrix4::from_fn(|i, j| match (i, j) {
            (0..3, 0..3) => known[i][j],
            (3, 3) => of_phase,
            _ => 0.0,
        })
    }

    /// The statistics of a first look, refined by those fits that it asked for and that succeeded:
    /// `held`, and `free`, of the signal at reference drive and temperature (N, counts).
    pub fn second_look(
        &self,
        look: &FirstLook,
        held: Option<&Fit>,
        free: Option<(&[f64], &Fit)>,
        drive: f64,
    ) -> Detection {
        let mut found = look.detection();
        if let (Some(x), Some(metric)) = (held.and_then(three), &look.metric) {
            found.ring = self.sensitivity.distance(metric, &x);
        }
        if look.beside {
            let unexplained = |(signal, free)| self.unexplained(signal, free, drive);
            found.unexplained = free.map_or(look.unexplained, unexplained);
        }
        found
    }

    /// The misfit of a signal beside its ring, without the leftover, counts² at the signal's own
    /// drive. `signal`: at reference drive and temperature, N, counts; `fit`: the phase free.
    pub fn unexplained(&self, signal: &[f64], fit: &Fit, drive: f64) -> f64 {
        let left = self.rings.misfit(signal, &fit.features);
        dot(&left, &left) * drive * drive
    }

    /// The fitter of second looks, for signals corrected to the reference drive and temperature.
    pub fn fitter(&self) -> &RingFitter {
        &self.rings.fitter
    }

    /// Writes the signal corrected to the reference drive and temperature, N, counts.
    fn at_reference(&self, deviation: &[f64], drive: f64, out: &mut Vec<f64>) {
        out.clear();
        out.extend(self.expected.iter().zip(deviation).map(|(e, d)| e + d / drive));
    }
}

/// Whether a fit explains more of a signal than of noise alone. `noise`: standard deviation of one
/// sample of the signal that was fitted, counts. Of noise alone a damped cosine explains a square
/// norm (over noise²) as large as the largest of some hundred values of chi-squared with two
/// degrees of freedom, one per frequency, which exceeds 2 ln(100 / p) with probability p.
pub(super) fn is_ring(fit: &Fit, noise: f64) -> bool {
    /// 2 ln(100 / p) with p one in five million: so rarely noise alone counts as a ring.
    const NOISE_ALONE: f64 = 40.0;
    fit.square - fit.misfit > NOISE_ALONE * noise * noise
}

/// The features of a fit whose phase was held. `None`: the ring is upside down (a phase of half a
/// turn), which these three would not show.
pub(super) fn three(fit: &Fit) -> Option<Vector3<f64>> {
    let x = fit.features;
    let is_upright = x.phase_rad.cos() > 0.0;
    is_upright.then(|| Vector3::new(x.ln_amplitude, x.ln_damping, x.ln_frequency))
}

/// Three features as a ring's features, with the healthy phase.
fn features(x: &Vector3<f64>) -> Features {
    x.push(0.0).into()
}
