//! The two detection statistics of one model: along its ring's sensitivities, and orthogonal to them (beside
//! the ring). Both are first computed to first order; where that does not decide, a ring is fitted.
//!
//! In: a signal's deviation from the expected signal, its relative drive. Out: [`Detection`]. For channels
//! that are judged by their own levels, also the four features (with the phase) and the distance from a
//! baseline.

use super::own_channel::{Behind, OwnBaseline, OwnChannels};
use super::rings::Rings;
use super::{DesignError, HealthyModel};
use crate::detect::misfit::Misfit;
use crate::detect::row_projection::Columns;
use crate::detect::sensitivity::{CLEARLY_FAR, SECOND_LOOK, Sensitivity};
use crate::model::inner_product::dot;
use crate::model::ring_fit::{Features, Fit, RingFitter};
use nalgebra::{DMatrix, Matrix3, Matrix3x4, Matrix4, Vector3, Vector4};

/// The detection statistics of a signal.
#[derive(Clone, Copy, Debug)]
pub struct Detection {
    /// Squared distance along the sensitivities. With another `detect.method` its statistic, such as the
    /// residual energy, counts²·s.
    pub ring: f64,
    /// The misfit beside the ring, counts². NaN: the method has no second test, or the signal lies so far
    /// along the ring that only a fit would tell.
    pub unexplained: f64,
}

/// The detection of `detect.method` = `sensitivity`, made ready for one model.
#[derive(Clone, Debug)]
pub struct SensitivityDetector {
    sensitivity: Sensitivity,
    /// Gram matrix of the three sensitivities, counts²: the square norm of the deviation that features stand
    /// for.
    gram: Matrix3<f64>,
    /// A first-order misfit up to this, counts², decides; a larger one is computed again from a fit.
    pub(super) settled: f64,
    /// A signal with a misfit up to this, counts², is a ring and nothing else: the largest healthy misfit.
    ring_only: f64,
    pub(super) rings: Rings,
    /// The expected signal at the reference drive and temperature, N, counts.
    expected: Vec<f64>,
    own: OwnFrame,
}

/// The estimator of four features of a deviation (with the phase free), from which channels' own baselines
/// are made, and its map to the three features of the statistic (with the phase held).
#[derive(Clone, Debug)]
struct OwnFrame {
    /// The pseudoinverse of the four sensitivities: four rows of N, 1/counts. Its product with a deviation at
    /// the reference drive are the features, to first order.
    projection: [Vec<f64>; 4],
    /// The same projection, arranged for many signals at once.
    columns: Columns<4>,
    /// Covariance of the four features due to noise, at the reference drive.
    noise: Matrix4<f64>,
    /// Gram matrix of the four sensitivities, counts².
    gram: Matrix4<f64>,
    /// What the three features with the phase held are for given four features: P T, with P the three rows of
    /// the statistic's projection and T the four sensitivities.
    to_three: Matrix3x4<f64>,
    /// Second derivatives of the ring by its features, projected: to second order, feature k is estimated too
    /// large by x' bend[k] x / 2.
    bend: [Matrix4<f64>; 4],
    /// Variance of one sample, counts².
    noise_square: f64,
}

impl OwnFrame {
    /// The frame about the healthy ring. `None`: amplitude, damping, frequency and phase cannot be told
    /// apart.
    fn new(fitter: &RingFitter, sensitivity: &Sensitivity) -> Option<OwnFrame> {
        let noise = sensitivity.noise_of_one_sample();
        let tangent = fitter.tangent(&Features::HEALTHY);
        let gram = tangent.tr_mul(&tangent);
        let inverse = gram.clone().try_inverse()?;
        let projection = &inverse * tangent.transpose();
        let to_three = Matrix3x4::from_fn(|i, j| {
            sensitivity.projection[i].iter().zip(tangent.column(j).iter()).map(|(p, t)| p * t).sum()
        });
        // by_feature[j] is the projected derivative of all sensitivities by feature j, 4 x 4; row k of it
        // belongs to feature k
        let by_feature = [0, 1, 2, 3].map(|j| &projection * slope(fitter, j));
        let bend = [0, 1, 2, 3].map(|k| Matrix4::from_fn(|i, j| by_feature[j][(k, i)]));
        let projection = [0, 1, 2, 3].map(|k| projection.row(k).iter().copied().collect());
        Some(OwnFrame {
            columns: Columns::new(&projection),
            projection,
            noise: Matrix4::from_fn(|i, j| inverse[(i, j)] * noise * noise),
            gram: Matrix4::from_fn(|i, j| gram[(i, j)]),
            to_three,
            bend,
            noise_square: noise * noise,
        })
    }

    /// The second-order error of the first-order estimate of features `x`: what the linear projection returns
    /// is x + bent(x).
    fn bent(&self, x: &Vector4<f64>) -> Vector4<f64> {
        Vector4::from(self.bend.each_ref().map(|bend| 0.5 * x.dot(&(bend * x))))
    }

    /// Features to second order from their first-order estimates, by two fixed-point steps of x = first -
    /// bent(x). Also returns whether what the third order would add is less than the noise of one sample at
    /// this drive, so that no fit is needed. Features that lie too far off for the second order stay as they
    /// are.
    fn straightened(&self, first: Vector4<f64>, drive: f64) -> (Vector4<f64>, bool) {
        let once = first - self.bent(&first);
        let x = first - self.bent(&once);
        // square norm, in counts², of the deviation that a change of features makes
        let square = |x: Vector4<f64>| x.dot(&(self.gram * x)) * drive * drive;
        let (whole, bent) = (square(x), square(self.bent(&x)));
        // the orders are taken for a geometric series: the third is to the second as the second is to the
        // first
        let third = bent * bent / whole.max(f64::MIN_POSITIVE);
        match bent < 0.25 * whole {
            true => (x, third <= self.noise_square),
            false => (first, whole <= self.noise_square),
        }
    }
}

/// Derivative of the four sensitivities by one of the features at the healthy ring, by central differences; N
/// x 4, counts.
fn slope(fitter: &RingFitter, feature: usize) -> DMatrix<f64> {
    const STEP: f64 = 1e-4;
    let at = |by: f64| {
        let mut x = Vector4::zeros();
        x[feature] = by;
        fitter.tangent(&Features::from(x))
    };
    (at(STEP) - at(-STEP)) / (2.0 * STEP)
}

/// The first-order statistics of a signal, and whether they decide or a fit is needed.
#[derive(Clone, Copy, Debug)]
pub struct FirstLook {
    /// ln amplitude, ln damping, ln frequency to first order.
    features: Vector3<f64>,
    /// Squared distance along the ring, to first order.
    pub distance: f64,
    /// Misfit beside the ring, counts². It is an upper bound, since phase and real pole are held.
    pub unexplained: f64,
    /// The metric of the distance, if that must be computed again from a fit; `None`: the first-order
    /// distance decides.
    metric: Option<Matrix3<f64>>,
    /// Whether the misfit must be computed again from a fit.
    beside: bool,
}

impl FirstLook {
    /// Features to start a fit from; `None`: the first look decides both tests, and no fit is needed.
    pub fn asks(&self) -> Option<Features> {
        (self.metric.is_some() || self.beside).then(|| features(&self.features))
    }

    /// Whether a second fit is needed, with the phase free, for the misfit.
    pub fn asks_beside(&self) -> bool {
        self.beside
    }

    /// Features to start the second fit from: those of `held`, the fit with the phase held, if there is one.
    pub fn near(&self, held: Option<&Fit>) -> Features {
        held.map_or_else(|| features(&self.features), |fit| fit.features)
    }

    /// The first-order statistics as a result. Of a signal that is clearly far along the ring the first-order
    /// misfit says nothing, hence NaN.
    pub fn detection(&self) -> Detection {
        let far = self.distance >= CLEARLY_FAR;
        let unexplained = if far { f64::NAN } else { self.unexplained };
        Detection { ring: self.distance, unexplained }
    }
}

impl SensitivityDetector {
    /// Makes a model's detector with the given sensitivities. `misfit`: the second test; `None`: no misfit
    /// asks for a fit.
    pub(super) fn new(
        model: &HealthyModel,
        sensitivity: Sensitivity,
        misfit: Option<&Misfit>,
    ) -> Result<SensitivityDetector, DesignError> {
        let rings = model.rings()?;
        let own = OwnFrame::new(&rings.fitter, &sensitivity)
            .ok_or_else(|| DesignError::Invalid("the model's phase cannot be told".into()))?;
        let gram = sensitivity.gram().ok_or_else(|| {
            DesignError::Invalid("amplitude, damping and frequency cannot be told apart".into())
        })?;
        Ok(SensitivityDetector {
            sensitivity,
            gram,
            settled: misfit.map_or(f64::INFINITY, Misfit::settled_square),
            ring_only: misfit.map_or(f64::INFINITY, Misfit::healthy_square),
            rings,
            expected: model.expected.clone(),
            own,
        })
    }

    /// Features of a signal (ln amplitude, ln damping, ln frequency, phase) to second order, the phase free.
    pub fn own_features(&self, deviation: &[f64], drive: f64) -> Vector4<f64> {
        self.straightened(self.to_first_order(deviation, drive), drive)
    }

    /// The same four features to first order: linear projections of the deviation per unit drive.
    fn to_first_order(&self, deviation: &[f64], drive: f64) -> Vector4<f64> {
        Vector4::from_fn(|k, _| dot(&self.own.projection[k], deviation) / drive)
    }

    /// Features to second order, from those to first order.
    pub fn straightened(&self, first: Vector4<f64>, drive: f64) -> Vector4<f64> {
        self.own.straightened(first, drive).0
    }

    /// The projection that gives the first-order features of many signals at once.
    pub fn own_columns(&self) -> &Columns<4> {
        &self.own.columns
    }

    /// Covariance of [`SensitivityDetector::own_features`] due to noise, at the reference drive.
    pub fn own_noise(&self) -> &Matrix4<f64> {
        &self.own.noise
    }

    /// The metric (inverse covariance) of a signal's distance from its channel's own level, in the three
    /// features of the statistic. `behind`: how well the level is known; `drive`: that of the signal, whose
    /// noise is larger relative to a weaker ring. `None`: the covariance is singular.
    pub fn own_metric(
        &self,
        own: &OwnChannels,
        behind: Behind,
        drive: f64,
    ) -> Option<Matrix3<f64>> {
        let to_three = &self.own.to_three;
        let scatter = to_three * own.scatter(behind) * to_three.transpose();
        let noise = Matrix3::from_fn(|i, j| self.sensitivity.noise[i][j]) / (drive * drive);
        (scatter + noise).try_inverse()
    }

    /// The squared Mahalanobis distance of features from a baseline, to second order, and whether it decides.
    /// It does up to the limit of the second look. Beyond, a fit must decide, since second-order features of
    /// a signal far from the model's ring are inaccurate while the signal may lie near its own channel.
    pub fn own_look(
        &self,
        metric: &Matrix3<f64>,
        features: &Vector4<f64>,
        own: &OwnBaseline,
    ) -> (f64, bool) {
        let x = self.own.to_three * (features - own.baseline);
        let distance = x.dot(&(metric * x));
        (distance, distance <= SECOND_LOOK)
    }

    /// The same distance by a fit. `near`: features to second order, to start from; `deviation`: N, counts;
    /// `signal`: a buffer. `None`: no upright ring fits.
    pub fn own_distance(
        &self,
        metric: &Matrix3<f64>,
        (near, own): (&Vector4<f64>, &OwnBaseline),
        (deviation, drive): (&[f64], f64),
        signal: &mut Vec<f64>,
    ) -> Option<f64> {
        // The fit holds the phase; the baseline's phase is mapped into the three features, too.
        let near = self.own.to_three * near;
        self.at_reference(deviation, drive, signal);
        let fit = self.rings.fitter.fit_from(signal, &features(&near), false)?;
        let x = three(&fit)? - self.own.to_three * own.baseline;
        Some(x.dot(&(metric * x)))
    }

    /// Both statistics of a signal, refined by fits where the first look asks for them. `deviation`: from the
    /// expected signal at its drive and temperature, N, counts; `signal`: a buffer.
    pub fn detect(&self, deviation: &[f64], drive: f64, signal: &mut Vec<f64>) -> Detection {
        let look = self.first_look(deviation, drive);
        match look.asks() {
            None => look.detection(),
            Some(near) => {
                // first the fit with the phase held, for the distance; from there the fit with the phase
                // free, for the misfit
                self.at_reference(deviation, drive, signal);
                let fitter = &self.rings.fitter;
                let fit = fitter.fit_from(signal, &near, false);
                let near = look.asks_beside().then(|| look.near(fit.as_ref()));
                let free = near.and_then(|near| fitter.fit_from(signal, &near, true));
                let free = free.as_ref().map(|fit| (signal.as_slice(), fit));
                self.second_look(&look, fit.as_ref(), free, drive)
            }
        }
    }

    /// Both statistics to first order, and whether they decide. Without a metric (a drive at which the
    /// covariance is singular) the signal counts as infinitely far, which needs no fit.
    pub fn first_look(&self, deviation: &[f64], drive: f64) -> FirstLook {
        let features = self.sensitivity.features(deviation, drive);
        let along = features * drive;
        let unexplained = dot(deviation, deviation) - along.dot(&(self.gram * along));
        let Some(metric) = self.sensitivity.metric(drive) else {
            let (distance, beside) = (f64::INFINITY, false);
            return FirstLook { features, distance, unexplained, metric: None, beside };
        };
        let distance = self.sensitivity.distance(&metric, &features);
        // near enough, or clearly far: the first-order distance decides
        let settled = distance <= SECOND_LOOK || distance >= CLEARLY_FAR;
        let beside = distance < CLEARLY_FAR && unexplained > self.settled;
        let metric = (!settled).then_some(metric);
        FirstLook { features, distance, unexplained, metric, beside }
    }

    /// A signal's four features (the phase free), for following channels. `signal`: a buffer. `None`: the
    /// signal holds more than a ring; or `far` is false and only a fit would tell, because the signal lies
    /// too far off.
    pub(super) fn features_of_ring(
        &self,
        deviation: &[f64],
        drive: f64,
        far: bool,
        signal: &mut Vec<f64>,
    ) -> Option<Vector4<f64>> {
        // First and second order decide if what they leave is small, and if the signal is near or a fit is
        // not wanted.
        let first = self.to_first_order(deviation, drive);
        let along = first * drive;
        let settled =
            dot(deviation, deviation) - along.dot(&(self.own.gram * along)) <= self.settled;
        let (near, is_near) = self.own.straightened(first, drive);
        if settled && (is_near || !far) {
            return Some(near);
        }
        if !far {
            return None;
        }
        // A fit tells what neither order does, and whether what they leave is a ring that lies far off. What
        // healthy signals hold beside their ring moves with the ink, too. A bound below that of the second
        // test would keep out most channels of a head that is some degrees warmer, which then would not be
        // followed.
        self.at_reference(deviation, drive, signal);

        // The ring is upside down (swapped wires), half a turn away, which no search from the healthy ring
        // reaches. So the inverted signal is looked at, and pi added to its phase. What healthy signals hold
        // beside their ring is inverted with it, too.
        if dot(signal, &self.expected) < 0.0 {
            let upright = signal.iter().zip(&self.expected).map(|(y, e)| -drive * (y + e));
            let upright: Vec<f64> = upright.collect();
            let features = self.features_of_ring(&upright, drive, far, signal)?;
            return Some(features + Vector4::new(0.0, 0.0, 0.0, std::f64::consts::PI));
        }

        let fit = self.rings.fitter.fit_from(signal, &Features::from(near), true)?;
        let is_ring = self.unexplained(signal, &fit, drive) <= self.ring_only;
        is_ring.then(|| fit.features.coordinates())
    }

    /// Standard deviations of healthy signals' four features, noise included.
    pub(super) fn healthy_sd(&self) -> Vector4<f64> {
        (self.healthy_spread().diagonal() + self.own.noise.diagonal()).map(f64::sqrt)
    }

    /// Covariance of healthy channels' four features, without noise. How much the phase scatters was not
    /// learned. An upper bound is used: all of the scatter of the frequency where the phase is held, taken as
    /// the effect of the phase. Its covariances with the others are taken as 0.
    pub(super) fn healthy_spread(&self) -> Matrix4<f64> {
        let known = &self.sensitivity.spread;
        let of_phase = known[2][2] / self.own.to_three[(2, 3)].powi(2).max(f64::MIN_POSITIVE);
        Matrix4::from_fn(|i, j| match (i, j) {
            (0..3, 0..3) => known[i][j],
            (3, 3) => of_phase,
            _ => 0.0,
        })
    }

    /// The statistics of a first look, refined by the fits that it asked for. `fit`: with the phase held.
    /// `free`: if [`FirstLook::asks_beside`], the signal corrected to reference drive and temperature, N,
    /// counts, and its fit with the phase free that was started from [`FirstLook::near`]. A statistic whose
    /// fit failed keeps its first-order value.
    pub fn second_look(
        &self,
        look: &FirstLook,
        fit: Option<&Fit>,
        free: Option<(&[f64], &Fit)>,
        drive: f64,
    ) -> Detection {
        let mut found = look.detection();
        if let (Some(x), Some(metric)) = (fit.and_then(three), &look.metric) {
            found.ring = self.sensitivity.distance(metric, &x);
        }
        if look.beside {
            let unexplained = |(signal, free)| self.unexplained(signal, free, drive);
            found.unexplained = free.map_or(look.unexplained, unexplained);
        }
        found
    }

    /// The misfit of a signal beside its ring, without the leftover that every healthy signal has, counts² at
    /// the signal's own drive. `signal`: corrected to reference drive and temperature, N, counts; `fit`: its
    /// fit with the phase free.
    pub fn unexplained(&self, signal: &[f64], fit: &Fit, drive: f64) -> f64 {
        let left = self.rings.misfit(signal, &fit.features);
        dot(&left, &left) * drive * drive
    }

    /// The fitter of rings for second looks, for signals corrected to the reference drive and temperature.
    pub fn fitter(&self) -> &RingFitter {
        &self.rings.fitter
    }

    /// Writes the signal corrected to the reference drive and temperature, N, counts: the expected signal
    /// plus the deviation per unit drive.
    fn at_reference(&self, deviation: &[f64], drive: f64, out: &mut Vec<f64>) {
        out.clear();
        out.extend(self.expected.iter().zip(deviation).map(|(e, d)| e + d / drive));
    }
}

/// The three features of a fit whose phase was held. `None`: the fitted ring is upside down, which these
/// three features would not show.
fn three(fit: &Fit) -> Option<Vector3<f64>> {
    let x = fit.features;
    let is_upright = x.phase_rad.cos() > 0.0;
    is_upright.then(|| Vector3::new(x.ln_amplitude, x.ln_damping, x.ln_frequency))
}

/// Three features as a ring's features, with the healthy phase.
fn features(x: &Vector3<f64>) -> Features {
    x.push(0.0).into()
}
