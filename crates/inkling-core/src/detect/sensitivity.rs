//! How far a signal lies from the healthy model along the model's own sensitivities.
//!
//! In: a signal's deviation from what the healthy model expects. Out: the squared Mahalanobis distance of (ln
//! amplitude, ln damping, ln frequency) from the healthy channels', which needs no fault data. To first order
//! the three features are projections of the deviation on dy/d(ln A, ln sigma, ln f). A signal near the
//! threshold is fitted ([`crate::model::ring_fit`]) and judged by the fit.
//!
//! The covariance of healthy features is that of the channels plus that of the noise. The noise weighs more
//! where the drive is low, so the two are kept apart.
//!
//! This is the thesis's statistic with another weight. The FD filter is r = F d, its matrix F lower
//! triangular with no 0 on the diagonal, so d = F^-1 r loses nothing. With the projection P, the features'
//! healthy mean m, their metric M and the relative drive s the squared distance is
//!
//! ```text
//! (P d / s - m)' M (P d / s - m) = (r - r_m)' W (r - r_m),   W = F^-T P' M P F^-1 / s², r_m = s F T m
//! ```
//!
//! T is the tangent, P T = I. So the squared distance is a weighted residual energy about the residual of the
//! mean healthy channel, where the thesis's e(r) = dt r' r has the weight W = dt I and no mean residual. The
//! second test, the square norm beside the ring, is such an energy, too: |d|² - |T P d|² = r' F^-T (I - P' (P
//! P')^-1 P) F^-1 r. W has rank 3, and that weight the remaining rank. The choice of F's denominator changes
//! W and not the statistic; it matters only to e(r), and to what is compared with classes. So by default,
//! too, the steps are reader, identification, FD filter, gate, isolation; F^-1 is multiplied out once per
//! model and not once per signal. Only signals whose squared distance lies within
//! [`SECOND_LOOK`] .. [`CLEARLY_FAR`] are fitted.

use super::tuned;
use crate::model::inner_product::dot;
use crate::model::median::{median, robust_sd};
use nalgebra::{DMatrix, Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// A squared distance to first order beyond this, which 98 % of healthy signals stay below, is computed again
/// from a fitted ring: far from the healthy ring the linear projections are no longer its features. A lower
/// one only fits more signals.
pub const SECOND_LOOK: f64 = 13.0;
/// Squared distance beyond which no healthy signal lies, to first order or by a fit: there the first-order
/// value is kept.
pub const CLEARLY_FAR: f64 = 1e3;

/// What the features of a deviation are to first order, and how healthy features are distributed.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Sensitivity {
    /// P: three rows of N, 1/counts. P d are the features of a deviation d at the reference drive.
    pub projection: Vec<Vec<f64>>,
    /// Mean of the healthy features.
    pub mean: [f64; 3],
    /// Covariance of the healthy features beyond the noise.
    pub spread: [[f64; 3]; 3],
    /// Covariance of the features' noise at the reference drive.
    pub noise: [[f64; 3]; 3],
    /// Share of `spread` that counts in the metric, beside all of the noise. A design that does not tell it
    /// was made when there was one for all.
    #[serde(default = "tuned::spread_counts")]
    pub share: f64,
}

impl Sensitivity {
    /// The projection of a model whose channels' spread is not known yet. `tangent`: N x 3, dy/d(ln A, ln
    /// sigma, ln f), counts. `noise`: standard deviation of one sample, counts. `None`: the columns are
    /// linearly dependent.
    pub fn new(tangent: &DMatrix<f64>, noise: f64) -> Option<Sensitivity> {
        // least squares: P = (T'T)^-1 T', and white noise gives the features the covariance noise² (T'T)^-1
        let gram = tangent.tr_mul(tangent);
        let inverse = gram.try_inverse()?;
        let projection = &inverse * tangent.transpose();
        let new = Sensitivity {
            projection: projection.row_iter().map(|r| r.iter().copied().collect()).collect(),
            mean: [0.0; 3],
            spread: [[0.0; 3]; 3],
            noise: rows(&Matrix3::from_fn(|i, j| inverse[(i, j)] * noise * noise)),
            share: tuned::spread_counts(),
        };
        new.noise.iter().flatten().all(|v| v.is_finite()).then_some(new)
    }

    /// The same for coloured noise: the features' noise covariance is multiplied by the largest ratio, over
    /// the features, of their variance p' R p under the noise's autocovariance R to that under white noise;
    /// no ratio below 1 is used. `autocovariance`: of the misfit beside the ring, counts², from lag 0 on;
    /// `of_white`: that of white noise with the same third differences.
    pub fn coloured(mut self, autocovariance: &[f64], of_white: &[f64]) -> Sensitivity {
        // p' R p of a Toeplitz matrix R: every lag but 0 occurs on both sides of the diagonal
        let along = |row: &[f64], r: &[f64]| -> f64 {
            let lagged =
                |lag: usize| -> f64 { row.iter().zip(&row[lag..]).map(|(p, q)| p * q).sum() };
            (0..r.len().min(row.len()))
                .map(|lag| if lag == 0 { 1.0 } else { 2.0 } * r[lag] * lagged(lag))
                .sum()
        };
        let ratios = self.projection.iter().map(|p| along(p, autocovariance) / along(p, of_white));
        let ratio = ratios.fold(0.0, f64::max);
        if ratio.is_finite() && ratio > 1.0 {
            self.noise.iter_mut().flatten().for_each(|v| *v *= ratio);
        }
        self
    }

    /// The same with mean and spread learned from healthy channels. `features`: one vector per signal, each
    /// with the signal's relative drive.
    pub fn with_spread(self, features: &[(Vector3<f64>, f64)]) -> Sensitivity {
        let n = features.len() as f64;
        let mean = features.iter().map(|(x, _)| x).sum::<Vector3<f64>>() / n;
        let total = features.iter().fold(Matrix3::zeros(), |s, (x, _)| {
            let d = x - mean;
            s + d * d.transpose()
        }) / (n - 1.0).max(1.0);
        self.with_total(mean, total, features)
    }

    /// Standard deviation of one sample's noise, counts; an equivalent value where the noise is coloured.
    pub fn noise_of_one_sample(&self) -> f64 {
        let square = self.projection[0].iter().map(|p| p * p).sum::<f64>();
        (self.noise[0][0] / square).sqrt()
    }

    /// The same after a common change of all channels. `tangent`: that of the changed ring. `None`: its
    /// columns are linearly dependent.
    pub fn moved(&self, tangent: &DMatrix<f64>) -> Option<Sensitivity> {
        Some(Sensitivity::new(tangent, self.noise_of_one_sample())?.with_spread_of(self))
    }

    /// The same with the mean and the spread that another model has learned, of which as much counts, for a
    /// window of few signals.
    pub fn with_spread_of(self, other: &Sensitivity) -> Sensitivity {
        Sensitivity { mean: other.mean, spread: other.spread, share: other.share, ..self }
    }

    /// [`Sensitivity::with_spread`] by robust moments, where up to two in five of the signals may be faulty.
    pub fn with_core_spread(self, features: &[(Vector3<f64>, f64)]) -> Sensitivity {
        let points: Vec<Vector3<f64>> = features.iter().map(|(x, _)| *x).collect();
        let Core { mean, covariance } = core_of(&points);
        self.with_total(mean, covariance, features)
    }

    /// The same with its own mean, and with the spread that another model has learned.
    pub fn scattering_like(self, other: &Sensitivity) -> Sensitivity {
        Sensitivity { spread: other.spread, ..self }
    }

    /// Mean squared distance, at the reference drive, of signals with this spread and this noise. It is 3 if
    /// all of the spread counts.
    pub fn mean_square(&self) -> f64 {
        let all = matrix(&self.spread) + matrix(&self.noise);
        self.metric(1.0).map_or(f64::NAN, |metric| (metric * all).trace())
    }

    /// Volume in the space of the features within a squared distance of the mean, at the reference drive, up
    /// to a factor that all models share.
    pub fn volume(&self, square: f64) -> f64 {
        let density = self.metric(1.0).map_or(0.0, |metric| metric.determinant());
        (square.powi(3) / density).sqrt()
    }

    /// Takes the noise from the covariance of the features. `total`: that covariance, the noise's included.
    fn with_total(
        mut self,
        mean: Vector3<f64>,
        total: Matrix3<f64>,
        features: &[(Vector3<f64>, f64)],
    ) -> Sensitivity {
        let n = features.len() as f64;
        // the mean of the noise's variance over the signals' drives
        let of_noise = features.iter().map(|(_, s)| 1.0 / (s * s)).sum::<f64>() / n;
        let beyond = total - matrix(&self.noise) * of_noise;
        // by sampling error a direction may have less variance than the noise: its spread is set to 0
        let eigen = beyond.symmetric_eigen();
        let kept = eigen.eigenvalues.map(|v| v.max(0.0));
        let spread =
            eigen.eigenvectors * Matrix3::from_diagonal(&kept) * eigen.eigenvectors.transpose();
        self.mean = mean.into();
        self.spread = rows(&spread);
        self
    }

    /// The features (ln A, ln sigma, ln f) to first order, relative to the expected signal's ring.
    /// `deviation`: N, counts.
    pub fn features(&self, deviation: &[f64], drive: f64) -> Vector3<f64> {
        Vector3::from_fn(|k, _| dot(&self.projection[k], deviation) / drive)
    }

    /// The metric M at a relative drive: the inverse of the spread's share plus the noise over drive².
    pub fn metric(&self, drive: f64) -> Option<Matrix3<f64>> {
        (matrix(&self.spread) * self.share + matrix(&self.noise) / (drive * drive)).try_inverse()
    }

    /// Gram matrix T'T of the sensitivities: x' T'T x is the square norm, counts², of that part of a
    /// deviation with features x that lies along the sensitivities.
    pub fn gram(&self) -> Option<Matrix3<f64>> {
        // P P' = (T'T)^-1
        let row = |i: usize| &self.projection[i];
        Matrix3::from_fn(|i, j| dot(row(i), row(j))).try_inverse()
    }

    /// Squared distance of features from the healthy mean, by a metric ([`Sensitivity::metric`]).
    pub fn distance(&self, metric: &Matrix3<f64>, features: &Vector3<f64>) -> f64 {
        let d = features - Vector3::from(self.mean);
        d.dot(&(metric * d))
    }

    /// Refuses what could not have been learned.
    pub fn check(&self, samples: usize) -> Result<(), String> {
        let finite = |v: &[f64]| v.iter().all(|x| x.is_finite());
        let whole = self.projection.len() == 3
            && self.projection.iter().all(|r| r.len() == samples && finite(r))
            && finite(&self.mean)
            && self.spread.iter().chain(&self.noise).all(|r| finite(r))
            && self.share > 0.0
            && self.share <= 1.0;
        match whole && self.metric(1.0).is_some() {
            true => Ok(()),
            false => Err(format!(
                "`sensitivity` must be three finite rows of {samples}, with a `share` in (0, 1]"
            )),
        }
    }
}

/// A robust mean and covariance.
pub(super) struct Core {
    pub mean: Vector3<f64>,
    pub covariance: Matrix3<f64>,
}

/// Minimum covariance determinant: mean and covariance of the points that lie closest together, by
/// concentration steps (Rousseeuw and Van Driessen 1999); the covariance is scaled to be consistent for a
/// Gaussian. It withstands two in five outliers. At least one point is needed.
pub(super) fn core_of(points: &[Vector3<f64>]) -> Core {
    /// Covariance of the nearest .6 of a three-dimensional Gaussian over that of all of it: P(chi²_5 < q) /
    /// .6 with P(chi²_3 < q) = .6, q = 2.946.
    const SHRINKS: f64 = 0.486;
    const STEPS: usize = 30;
    let kept = ((tuned::core_share() * points.len() as f64).ceil() as usize).clamp(1, points.len());
    // start from the medians and the median absolute deviations of each feature
    let along = |k: usize| points.iter().map(|x| x[k]).collect::<Vec<f64>>();
    let mut mean = Vector3::from_fn(|k, _| median(&mut along(k)));
    let spread =
        Vector3::from_fn(|k, _| robust_sd(&along(k), mean[k]).powi(2).max(f64::MIN_POSITIVE));
    let mut covariance = Matrix3::from_diagonal(&spread);
    let mut order: Vec<usize> = (0..points.len()).collect();
    for _ in 0..STEPS {
        // concentration: keep the points nearest to the present mean, and take their mean and covariance
        let Some(metric) = covariance.try_inverse() else { break };
        let far: Vec<f64> = points
            .iter()
            .map(|x| {
                let d = x - mean;
                d.dot(&(metric * d))
            })
            .collect();
        order.select_nth_unstable_by(kept - 1, |&i, &j| far[i].total_cmp(&far[j]).then(i.cmp(&j)));
        let mut nearest = order[..kept].to_vec();
        nearest.sort_unstable(); // sums in one order
        let before = mean;
        mean = nearest.iter().map(|&i| points[i]).sum::<Vector3<f64>>() / kept as f64;
        covariance = nearest.iter().fold(Matrix3::zeros(), |s, &i| {
            let d = points[i] - mean;
            s + d * d.transpose()
        }) / (kept as f64 * SHRINKS);
        if mean == before {
            break;
        }
    }
    Core { mean, covariance }
}

fn matrix(rows: &[[f64; 3]; 3]) -> Matrix3<f64> {
    Matrix3::from_fn(|i, j| rows[i][j])
}

fn rows(m: &Matrix3<f64>) -> [[f64; 3]; 3] {
    std::array::from_fn(|i| std::array::from_fn(|j| m[(i, j)]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::normal::draws;

    /// Tests what the head of this file derives: W is computed by triangular solves from F itself.
    #[test]
    fn the_distance_is_a_weighted_energy_of_the_fd_filters_residual_whatever_its_denominator() {
        use crate::detect::ResidualGenerator;
        use nalgebra::DVector;
        const N: usize = 96;
        let tangent = DMatrix::from_fn(N, 3, |i, j| ((i * (j + 1)) as f64 * 0.1).sin() * 100.0);
        let spread = Matrix3::from_diagonal(&Vector3::new(4e-4, 25e-4, 4e-6));
        let learned = Sensitivity {
            mean: [0.01, -0.02, 0.001],
            spread: rows(&spread),
            ..Sensitivity::new(&tangent, 10.0).unwrap()
        };
        let p = DMatrix::from_fn(3, N, |i, k| learned.projection[i][k]);
        let gram = learned.gram().unwrap();
        let mut normal = draws(3);
        for omega in [4.06e5, 4.5e5] {
            let filter = ResidualGenerator::of_nominal(omega);
            let f = filter.matrix(N);
            // F^-T P': the columns that a residual is multiplied with
            let columns = f.transpose().solve_upper_triangular(&p.transpose()).unwrap();
            for drive in [0.7, 1.0] {
                let metric = learned.metric(drive).unwrap();
                let m = DMatrix::from_fn(3, 3, |i, j| metric[(i, j)] / (drive * drive));
                let w = &columns * m * columns.transpose();
                let mean = DVector::from_column_slice(&learned.mean);
                let r_mean = &f * &tangent * mean * drive;
                let d: Vec<f64> = (0..N).map(|_| 30.0 * normal()).collect();
                let mut r = DVector::zeros(N);
                filter.filter(&d, r.as_mut_slice());
                let about = &r - r_mean;
                let weighted = about.dot(&(w * &about));
                let distance = learned.distance(&metric, &learned.features(&d, drive));
                assert!((weighted / distance - 1.0).abs() < 1e-8, "{weighted} {distance}");
                // beside the ring: what least squares on the tangent leave
                let deviation = DVector::from_column_slice(&d);
                let left = &deviation - &tangent * (&p * &deviation);
                let back = f.solve_lower_triangular(&r).unwrap();
                let along = columns.tr_mul(&r);
                let along = Vector3::new(along[0], along[1], along[2]);
                let beside = back.norm_squared() - along.dot(&(gram * along));
                assert!((beside / left.norm_squared() - 1.0).abs() < 1e-8);
            }
        }
    }

    #[test]
    fn the_spread_that_is_learned_is_the_channels_alone_at_any_drive() {
        let mut normal = draws(5);
        let tangent = DMatrix::from_fn(64, 3, |i, j| ((i * (j + 1)) as f64 * 0.1).sin() * 100.0);
        let sensitivity = Sensitivity::new(&tangent, 10.0).unwrap();
        let sds = [0.02, 0.05, 0.03];
        for drive in [0.5, 1.0, 2.0] {
            let mut signal = || {
                let theta = sds.map(|sd| sd * normal());
                let moved = |k: usize| -> f64 { (0..3).map(|j| tangent[(k, j)] * theta[j]).sum() };
                let d: Vec<f64> = (0..64).map(|k| drive * moved(k) + 10.0 * normal()).collect();
                (sensitivity.features(&d, drive), drive)
            };
            let features: Vec<(Vector3<f64>, f64)> = (0..6000).map(|_| signal()).collect();
            let learned = sensitivity.clone().with_spread(&features);
            for (k, sd) in sds.iter().enumerate() {
                let ratio = learned.spread[k][k] / (sd * sd);
                assert!((ratio - 1.0).abs() < 0.25, "{ratio} of feature {k} at {drive}");
            }
        }
    }

    #[test]
    fn mean_distance_of_healthy_signals_is_what_their_covariance_says() {
        let mut normal = draws(2);
        let tangent = DMatrix::from_fn(64, 3, |i, j| ((i * (j + 1)) as f64 * 0.1).sin() * 100.0);
        let mut healthy = |n: usize| -> Vec<(Vec<f64>, f64)> {
            (0..n)
                .map(|i| {
                    let drive = if i % 3 == 0 { 0.8 } else { 1.0 };
                    let theta = [0.02 * normal(), 0.05 * normal(), 0.002 * normal()];
                    let d = (0..64)
                        .map(|k| {
                            let moved: f64 = (0..3).map(|j| tangent[(k, j)] * theta[j]).sum();
                            drive * moved + 10.0 * normal()
                        })
                        .collect();
                    (d, drive)
                })
                .collect()
        };
        let new = Sensitivity::new(&tangent, 10.0).unwrap();
        let features: Vec<(Vector3<f64>, f64)> =
            healthy(4000).iter().map(|(d, drive)| (new.features(d, *drive), *drive)).collect();
        let learned = new.with_spread(&features);
        let fresh = healthy(4000);
        let theta = Matrix3::from_diagonal(&Vector3::new(4e-4, 25e-4, 4e-6));
        let [mut all, mut part] = [0.0; 2];
        for (share, found) in [(1.0, &mut all), (0.35, &mut part)] {
            let learned = Sensitivity { share, ..learned.clone() };
            learned.check(64).unwrap();
            // E d' M d = tr M cov d, the covariance of what was drawn
            let mut expected = 0.0;
            for (d, drive) in &fresh {
                let metric = learned.metric(*drive).unwrap();
                *found += learned.distance(&metric, &learned.features(d, *drive));
                expected += (metric * (theta + matrix(&learned.noise) / (drive * drive))).trace();
            }
            assert!((*found / expected - 1.0).abs() < 0.05, "{found} {expected}");
            *found /= learned.mean_square();
        }
        // by what is expected of them, distances do not depend on the share
        assert!((part / all - 1.0).abs() < 0.05, "{part} {all}");
    }

    #[test]
    fn without_a_share_or_with_more_than_all_no_sensitivity_is_taken() {
        let tangent = DMatrix::from_fn(64, 3, |i, j| ((i * (j + 1)) as f64 * 0.1).sin() * 100.0);
        let new = Sensitivity::new(&tangent, 10.0).unwrap();
        new.check(64).unwrap();
        for share in [0.0, -0.5, 1.01, f64::NAN] {
            assert!(Sensitivity { share, ..new.clone() }.check(64).is_err(), "{share}");
        }
    }
}
