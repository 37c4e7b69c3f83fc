//! The two detection statistics of one model (`detect.method` = `sensitivity`): along the
//! sensitivities of its ring (the derivatives by ln amplitude, ln damping and ln frequency), and
//! orthogonal to them, that is, beside the ring.
//!
//! In, from a [`super::Judge`] or from the filter stage (`pipeline/statistics.rs`): a signal's
//! deviation d from the expected signal, N, counts, and its relative drive s. Out: [`Detection`];
//! for channels that are judged by their own levels also four features and the distance from a
//! baseline.
//!
//! With P the pseudoinverse of the three sensitivities T (phase held), x = P d / s are ln
//! amplitude, ln damping and ln frequency to first order; the first statistic is the squared
//! Mahalanobis distance of x from the healthy mean, the second one the misfit |d|² - |T P d|². This
//! is the *first look*. Where it does not decide (a squared distance between `SECOND_LOOK` = 13 and
//! `CLEARLY_FAR` = 1000, or a large misfit), the *second look* fits a ring and computes the
//! statistic again from the fit: with the phase held for the distance, with the phase free for the
//! misfit.

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
    /// The statistic of the first test: the squared distance along the sensitivities, without unit.
    /// With another `detect.method` it is the statistic of that method, such as the residual
    /// energy, counts²·s.
    pub ring: f64,
    /// The statistic of the second test before it is standardised: the misfit beside the ring,
    /// counts² at the signal's own drive. NaN: the method has no second test, or the signal lies so
    /// far along the ring that the first-order misfit says nothing.
    pub unexplained: f64,
}

/// The detection of `detect.method` = `sensitivity`, made ready for one model.
#[derive(Clone, Debug)]
pub struct SensitivityDetector {
    sensitivity: Sensitivity,
    /// Gram matrix T'T of the three sensitivities, counts²: x' T'T x is the square norm of the
    /// deviation that features x stand for.
    gram: Matrix3<f64>,
    /// A first-order misfit up to this, counts², decides; a larger one is computed again from a
    /// fit.
    pub(super) settled: f64,
    /// A signal with a misfit up to this, counts², is a ring and nothing else: the largest misfit
    /// that the second test calls healthy.
    ring_only: f64,
    pub(super) rings: Rings,
    /// The expected signal at the reference drive and temperature, N, counts.
    expected: Vec<f64>,
    own: OwnFrame,
}

/// The estimator of four features of a deviation (ln amplitude, ln damping, ln frequency, phase),
/// from which channels' own baselines are made, and its map to the three features of the statistic,
/// for which the phase is held. The four sensitivities about the healthy ring are called T here.
#[derive(Clone, Debug)]
struct OwnFrame {
    /// The pseudoinverse of T: four rows of N, 1/counts. The product with a deviation at the
    /// reference drive gives the features, to first order.
    projection: [Vec<f64>; 4],
    /// The same projection, arranged for many signals at once.
    columns: Columns<4>,
    /// Covariance of the four features due to noise, at the reference drive.
    noise: Matrix4<f64>,
    /// Gram matrix of the four sensitivities, counts².
    gram: Matrix4<f64>,
    /// The map from four features to the three that the statistic would estimate of the same signal
    /// with the phase held: P T, with P the three rows of the statistic's projection.
    to_three: Matrix3x4<f64>,
    /// Second derivatives of the ring by its features, projected on the features: of a ring at
    /// features x, the linear estimate of feature k is too large by x' bend[k] x / 2, to second
    /// order.
    bend: [Matrix4<f64>; 4],
    /// Variance of one sample's noise, counts².
    noise_square: f64,
}

impl OwnFrame {
    /// The frame about the healthy ring. `None`: amplitude, damping, frequency and phase cannot be
    /// told apart.
    fn new(fitter: &RingFitter, sensitivity: &Sensitivity) -> Option<OwnFrame> {
        let noise = sensitivity.noise_of_one_sample();

        // Least squares on the four sensitivities: the projection is (T'T)^-1 T', and white noise
        // gives the features the covariance noise² (T'T)^-1.
        let tangent = fitter.tangent(&Features::HEALTHY);
        let gram = tangent.tr_mul(&tangent);
        let inverse = gram.clone().try_inverse()?;
        let projection = &inverse * tangent.transpose();
        let to_three = Matrix3x4::from_fn(|i, j| {
            sensitivity.projection[i].iter().zip(tangent.column(j).iter()).map(|(p, t)| p * t).sum()
        });

        // by_feature[j] is the derivative of all sensitivities by feature j, projected on the
        // features, 4 x 4. Its row k belongs to feature k, so bend[k] collects the rows k of all
        // four.
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

    /// The second-order error of the first-order estimate: of a ring at the features `x`, the
    /// linear projection returns x + bent(x).
    fn bent(&self, x: &Vector4<f64>) -> Vector4<f64> {
        Vector4::from(self.bend.each_ref().map(|bend| 0.5 * x.dot(&(bend * x))))
    }

    /// Features to second order from their first-order estimates `first`, by two fixed-point steps
    /// of x = first - bent(x). Also returns whether the features need no fit: whether the third
    /// order would change the deviation by less than the noise of one sample, at this drive.
    /// Features that lie too far off for the second order stay as they are.
    fn straightened(&self, first: Vector4<f64>, drive: f64) -> (Vector4<f64>, bool) {
        let once = first - self.bent(&first);
        let x = first - self.bent(&once);

        // the square norm, in counts², of the deviation that a change of the features by x makes
        let square = |x: Vector4<f64>| x.dot(&(self.gram * x)) * drive * drive;
        let (whole, bent) = (square(x), square(self.bent(&x)));
        // The square norms of the orders are taken for a geometric series: the third is to the
        // second as the second is to the first.
        let third = bent * bent / whole.max(f64::MIN_POSITIVE);
        // The second order is believed while it is less than half as large as the first (a limit
        // that is somewhat arbitrary).
        match bent < 0.25 * whole {
            true => (x, third <= self.noise_square),
            false => (first, whole <= self.noise_square),
        }
    }
}

/// Derivative of the four sensitivities by feature number `feature` at the healthy ring, by central
/// differences; N x 4, counts.
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
    /// ln amplitude, ln damping, ln frequency relative to the model's ring, to first order.
    features: Vector3<f64>,
    /// Squared distance along the ring, to first order.
    pub distance: f64,
    /// Misfit beside the ring, counts². It is an upper bound of a fit's misfit, since phase and
    /// real pole are held.
    pub unexplained: f64,
    /// The metric of the distance, if that must be computed again from a fit; `None`: the
    /// first-order distance decides.
    metric: Option<Matrix3<f64>>,
    /// Whether the misfit must be computed again from a fit.
    beside: bool,
}

impl FirstLook {
    /// Features to start a fit with the phase held from; `None`: the first look decides both tests,
    /// and no fit is needed.
    pub fn asks(&self) -> Option<Features> {
        (self.metric.is_some() || self.beside).then(|| features(&self.features))
    }

    /// Whether a second fit is needed, with the phase free, for the misfit.
    pub fn asks_beside(&self) -> bool {
        self.beside
    }

    /// Features to start the second fit, with the phase free, from: those of `held`, the fit with
    /// the phase held, or those of the first look if that fit failed.
    pub fn near(&self, held: Option<&Fit>) -> Features {
        held.map_or_else(|| features(&self.features), |fit| fit.features)
    }

    /// The first-order statistics as a [`Detection`]. The first-order misfit of a signal that is
    /// clearly far along the ring says nothing, so it becomes NaN.
    pub fn detection(&self) -> Detection {
        let far = self.distance >= CLEARLY_FAR;
        let unexplained = if far { f64::NAN } else { self.unexplained };
        Detection { ring: self.distance, unexplained }
    }
}

impl SensitivityDetector {
    /// Makes a model's detector with the given sensitivities. `misfit`: the model's second test;
    /// `None`: there is none (yet), and no misfit asks for a fit. An error if the model does not
    /// ring, or if its sensitivities are linearly dependent.
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

    /// Features of a signal (ln amplitude, ln damping, ln frequency, phase), relative to the
    /// model's ring, to second order and without a fit. `deviation`: N, counts; `drive`: relative.
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

    /// The projection that gives the first-order features of many signals at once, for the filter
    /// stage.
    pub fn own_columns(&self) -> &Columns<4> {
        &self.own.columns
    }

    /// Covariance of [`SensitivityDetector::own_features`] due to noise, at the reference drive.
    pub fn own_noise(&self) -> &Matrix4<f64> {
        &self.own.noise
    }

    /// The metric (inverse covariance) of a signal's distance from its channel's own level, in the
    /// three features of the statistic. `behind`: how well the level is known; `drive`: that of the
    /// signal, whose noise is larger relative to a weaker ring. `None`: the covariance is singular.
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

    /// The squared Mahalanobis distance of features from a channel's baseline, and whether that
    /// distance decides. It decides up to the limit of the second look. Beyond the limit a fit
    /// ([`SensitivityDetector::own_distance`]) must decide: the features are of second order, which
    /// is inaccurate far from the model's ring, while the signal may lie near its own channel.
    /// `metric`: from [`SensitivityDetector::own_metric`]; `features`: four, relative to the
    /// model's ring.
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

    /// The squared distance of a signal from a channel's baseline by a fitted ring. `near`:
    /// features to second order, to start from; `deviation`: N, counts; `signal`: a buffer. `None`:
    /// no upright ring fits.
    pub fn own_distance(
        &self,
        metric: &Matrix3<f64>,
        (near, own): (&Vector4<f64>, &OwnBaseline),
        (deviation, drive): (&[f64], f64),
        signal: &mut Vec<f64>,
    ) -> Option<f64> {
        // The fit holds the phase. So the four features of the start and of the baseline are mapped
        // to the three that such a fit would find, which takes up their phases.
        let near = self.own.to_three * near;
        self.at_reference(deviation, drive, signal);
        let fit = self.rings.fitter.fit_from(signal, &features(&near), false)?;
        let x = three(&fit)? - self.own.to_three * own.baseline;
        Some(x.dot(&(metric * x)))
    }

    /// Both statistics of a signal, refined by fits where the first look asks for them. This is the
    /// reference, signal by signal; the filter stage does the same for many signals side by side.
    /// `deviation`: from the expected signal at the signal's drive and temperature, N, counts;
    /// `signal`: a buffer.
    pub fn detect(&self, deviation: &[f64], drive: f64, signal: &mut Vec<f64>) -> Detection {
        let look = self.first_look(deviation, drive);
        match look.asks() {
            None => look.detection(),
            Some(near) => {
                // First the fit with the phase held, for the distance. From there, if the misfit is
                // asked for, the fit with the phase free.
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

    /// Both statistics to first order, and whether they decide. `deviation`: N, counts. At a drive
    /// at which the covariance is singular there is no metric: the signal counts as infinitely far,
    /// which needs no fit.
    pub fn first_look(&self, deviation: &[f64], drive: f64) -> FirstLook {
        // The misfit is the square norm of the deviation less that of its part along the
        // sensitivities.
        let features = self.sensitivity.features(deviation, drive);
        let along = features * drive;
        let unexplained = dot(deviation, deviation) - along.dot(&(self.gram * along));
        let Some(metric) = self.sensitivity.metric(drive) else {
            let (distance, beside) = (f64::INFINITY, false);
            return FirstLook { features, distance, unexplained, metric: None, beside };
        };
        let distance = self.sensitivity.distance(&metric, &features);
        // Near enough, or clearly far: the first-order distance decides. The misfit is computed
        // again if it is large, except for signals clearly far along the ring, which the first test
        // flags anyway.
        let settled = distance <= SECOND_LOOK || distance >= CLEARLY_FAR;
        let beside = distance < CLEARLY_FAR && unexplained > self.settled;
        let metric = (!settled).then_some(metric);
        FirstLook { features, distance, unexplained, metric, beside }
    }

    /// A signal's four features (the phase free), from which the state of printheads and channels
    /// is followed. `deviation`: N, counts; `far`: whether a fit may be made; `signal`: a buffer.
    /// `None`: the signal holds more than a ring; or `far` is false and the signal lies so far off
    /// that only a fit would tell its features.
    pub(super) fn features_of_ring(
        &self,
        deviation: &[f64],
        drive: f64,
        far: bool,
        signal: &mut Vec<f64>,
    ) -> Option<Vector4<f64>> {
        // The features to second order suffice if what the ring leaves of the signal is small
        // (`settled`), and if the signal is near enough for the second order or no fit is wanted.
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

        // Beyond, a fit gives the features, and tells whether the signal is a ring at all. The
        // bound on the fit's misfit is that of the second test (`ring_only`): a lower one would
        // keep out most channels of a printhead whose ink is some degrees warmer, since what
        // healthy signals hold beside their ring changes with the ink, too. Then such a printhead
        // could not be followed.
        self.at_reference(deviation, drive, signal);

        // A ring that is upside down (swapped wires) is half a turn away, which no search from the
        // healthy ring reaches. So the features of the inverted signal are taken, and pi is added
        // to the phase. `upright` is the deviation of the inverted signal: -y - drive * expected,
        // with y = drive * `signal`. The leftover, part of the expected signal, is inverted with
        // the ring.
        if dot(signal, &self.expected) < 0.0 {
            let upright = signal.iter().zip(&self.expected).map(|(y, e)| -drive * (y + e));
            let upright: Vec<f64> = upright.collect();
            let features = self.features_of_ring(&upright, drive, far, signal)?;
            return Some(features + Vector4::new(0.0, 0.0, 0.0, std::f64::consts::PI));
        }

        // An upright ring: the fit from the features to second order.
        let fit = self.rings.fitter.fit_from(signal, &Features::from(near), true)?;
        let is_ring = self.unexplained(signal, &fit, drive) <= self.ring_only;
        is_ring.then(|| fit.features.coordinates())
    }

    /// Standard deviations of healthy signals' four features at the reference drive, noise
    /// included.
    pub(super) fn healthy_sd(&self) -> Vector4<f64> {
        (self.healthy_spread().diagonal() + self.own.noise.diagonal()).map(f64::sqrt)
    }

    /// Covariance of healthy channels' four features, without noise. Training learns only that of
    /// three features with the phase held, so the variance of the phase is not known. An upper
    /// bound is used: the phase that alone would explain all of the variance of ln frequency. The
    /// phase's covariances with the other features are taken as 0.
    pub(super) fn healthy_spread(&self) -> Matrix4<f64> {
        let known = &self.sensitivity.spread;
        let of_phase = known[2][2] / self.own.to_three[(2, 3)].powi(2).max(f64::MIN_POSITIVE);
        Matrix4::from_fn(|i, j| match (i, j) {
            (0..3, 0..3) => known[i][j],
            (3, 3) => of_phase,
            _ => 0.0,
        })
    }

    /// The statistics of a first look, refined by the fits that `look` asked for. `fit`: the one
    /// with the phase held. `free`: if [`FirstLook::asks_beside`], the signal corrected to
    /// reference drive and temperature, N, counts, and its fit with the phase free that was started
    /// from [`FirstLook::near`]. A statistic whose fit failed keeps its first-order value.
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

    /// The misfit of a signal beside its ring, without the leftover that every healthy signal has,
    /// counts² at the signal's own drive. `signal`: corrected to reference drive and temperature,
    /// N, counts; `fit`: its fit with the phase free.
    pub fn unexplained(&self, signal: &[f64], fit: &Fit, drive: f64) -> f64 {
        let left = self.rings.misfit(signal, &fit.features);
        dot(&left, &left) * drive * drive
    }

    /// The fitter of rings for second looks, for signals corrected to the reference drive and
    /// temperature.
    pub fn fitter(&self) -> &RingFitter {
        &self.rings.fitter
    }

    /// Writes the signal corrected to the reference drive and temperature to `out`, N, counts: the
    /// expected signal plus the deviation per unit drive.
    fn at_reference(&self, deviation: &[f64], drive: f64, out: &mut Vec<f64>) {
        out.clear();
        out.extend(self.expected.iter().zip(deviation).map(|(e, d)| e + d / drive));
    }
}

/// The three features of a fit whose phase was held. `None`: the fitted ring is upside down (a
/// negative amplitude, a phase of half a turn), which these three features would not show.
fn three(fit: &Fit) -> Option<Vector3<f64>> {
    let x = fit.features;
    let is_upright = x.phase_rad.cos() > 0.0;
    is_upright.then(|| Vector3::new(x.ln_amplitude, x.ln_damping, x.ln_frequency))
}

/// Three features as a ring's features, with the healthy phase.
fn features(x: &Vector3<f64>) -> Features {
    x.push(0.0).into()
}
