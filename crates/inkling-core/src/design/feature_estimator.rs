//! The estimator of a signal's four features (ln amplitude, ln damping, ln frequency, phase) without
//! a fit: linear projections of its deviation from the expected signal, straightened to second order.
//!
//! In: a fitter of rings about a model's ring, and the sensitivities of its statistic. Out:
//! [`FeatureEstimator`], from which `detector` makes channels' own baselines and starts fits.

use crate::detect::row_projection::Columns;
use crate::detect::sensitivity::Sensitivity;
use crate::model::ring_fit::{Features, RingFitter};
use nalgebra::{DMatrix, Matrix3x4, Matrix4, Vector4};

/// T here: the four sensitivities about the healthy ring.
#[derive(Clone, Debug)]
pub(super) struct FeatureEstimator {
    /// The pseudoinverse of T: four rows of N, 1/counts; its product with a deviation at the
    /// reference drive gives the features to first order.
    pub projection: [Vec<f64>; 4],
    /// The same, arranged for many signals at once.
    pub columns: Columns<4>,
    /// Covariance of the four features due to noise, at the reference drive.
    pub noise: Matrix4<f64>,
    /// Gram matrix of the four sensitivities, counts².
    pub gram: Matrix4<f64>,
    /// P T, P being the statistic's three rows: what these would estimate of four features.
    pub to_three: Matrix3x4<f64>,
    /// Second derivatives of the ring by its features, projected on the features: at features x, the
    /// linear estimate of feature k is too large by x' bend[k] x / 2, to second order.
    bend: [Matrix4<f64>; 4],
    /// Variance of one sample's noise, counts².
    noise_square: f64,
}

impl FeatureEstimator {
    /// `None`: amplitude, damping, frequency and phase cannot be told apart.
    pub fn new(fitter: &RingFitter, sensitivity: &Sensitivity) -> Option<FeatureEstimator> {
        let noise = sensitivity.noise_of_one_sample();

        let tangent = fitter.tangent(&Features::HEALTHY);
        let gram = tangent.tr_mul(&tangent);
        let inverse = gram.clone().try_inverse()?;
        let projection = &inverse * tangent.transpose();
        let to_three = Matrix3x4::from_fn(|i, j| {
            sensitivity.projection[i].iter().zip(tangent.column(j).iter()).map(|(p, t)| p * t).sum()
        });

        // by_feature[j]: derivative of T by feature j, projected on the features (the rows), 4 x 4
        let by_feature = [0, 1, 2, 3].map(|j| &projection * slope(fitter, j));
        let bend = [0, 1, 2, 3].map(|k| Matrix4::from_fn(|i, j| by_feature[j][(k, i)]));
        let projection = [0, 1, 2, 3].map(|k| projection.row(k).iter().copied().collect());
        Some(FeatureEstimator {
            columns: Columns::new(&projection),
            projection,
            noise: Matrix4::from_fn(|i, j| inverse[(i, j)] * noise * noise),
            gram: Matrix4::from_fn(|i, j| gram[(i, j)]),
            to_three,
            bend,
            noise_square: noise * noise,
        })
    }

    /// The error of the first-order estimate: of a ring at the features `x` it is x + bent(x).
    fn bent(&self, x: &Vector4<f64>) -> Vector4<f64> {
        Vector4::from(self.bend.each_ref().map(|bend| 0.5 * x.dot(&(bend * x))))
    }

    /// Features to second order from first order, by two fixed-point steps of x = first - bent(x),
    /// and whether they need no fit: the third order would change the deviation by less than the
    /// noise of one sample. Features too far off stay as they are.
    pub fn straightened(&self, first: Vector4<f64>, drive: f64) -> (Vector4<f64>, bool) {
        let once = first - self.bent(&first);
        let x = first - self.bent(&once);

        // the square norm, counts², of the deviation of features x
        let square = |x: Vector4<f64>| x.dot(&(self.gram * x)) * drive * drive;
        let (whole, bent) = (square(x), square(self.bent(&x)));
        // taken for a geometric series: the third order is to the second as that is to the first
        let third = bent * bent / whole.max(f64::MIN_POSITIVE);
        // the second order is believed while it is less than half as large as the first (arbitrary)
        match bent < 0.25 * whole {
            true => (x, third <= self.noise_square),
            false => (first, whole <= self.noise_square),
        }
    }
}

/// Derivative of the four sensitivities by one feature at the healthy ring; N x 4, counts.
fn slope(fitter: &RingFitter, feature: usize) -> DMatrix<f64> {
    const STEP: f64 = 1e-4;
    let at = |by: f64| fitter.tangent(&Features::from(Vector4::ith(feature, by)));
    (at(STEP) - at(-STEP)) / (2.0 * STEP)
}
