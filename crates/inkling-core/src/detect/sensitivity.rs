//! The default detection statistic, to first order: how far a signal lies from the healthy channels
//! along the model's own sensitivities.
//!
//! In: a signal's deviation d (N, counts) from what the healthy model expects, and its relative
//! drive s. Out: the squared Mahalanobis distance of the signal's features (ln amplitude, ln
//! damping, ln frequency, relative to the healthy ring) from those of healthy channels. No fault
//! data are needed.
//!
//! 1. Tangent: T (N x 3) holds dy/d(ln A, ln sigma, ln f) of the healthy ring.
//! 2. Features to first order, by least squares: x = P d / s with the projection P = (T'T)^-1 T'.
//! 3. Covariance of healthy features: C(s) = share * spread + noise / s². `spread` is how channels
//!    differ, `noise` what the noise of the samples does at the reference drive.
//! 4. Distance: (x - m)' M (x - m) with the healthy mean m and the metric M = C(s)^-1.
//!
//! Far from the healthy ring first-order features are wrong. So the detector fits a ring
//! ([`crate::model::ring_fit`]) to a signal whose squared distance lies within [`SECOND_LOOK`] ..
//! [`CLEARLY_FAR`], and takes the distance of the fitted features.
//!
//! The thesis's statistic has another weight: the FD filter r = F d is invertible (F is lower
//! triangular with no 0 on the diagonal) and P T = I, so
//!
//! ```text
//! (P d / s - m)' M (P d / s - m) = (r - r_m)' W (r - r_m),   W = F^-T P' M P F^-1 / s², r_m = s F T m
//! ```
//!
//! is a weighted residual energy about r_m, where the thesis's e(r) = dt r' r has the weight W = dt I.
//! The second test is such an energy, too: |d|² - |T P d|² = r' F^-T (I - P' (P P')^-1 P) F^-1 r.

use super::tuned;
use crate::model::inner_product::dot;
use crate::model::median::{median, robust_sd};
use nalgebra::{DMatrix, Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// A squared distance to first order beyond this, as of 2 % of healthy signals, gets a second look.
pub const SECOND_LOOK: f64 = 13.0;
/// Squared distance, to first order, beyond which no healthy signal lies, and no ring is fitted.
pub const CLEARLY_FAR: f64 = 1e3;

#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Sensitivity {
    /// The projection P: three rows of N, 1/counts.
    pub projection: Vec<Vec<f64>>,
    /// The mean m of the healthy features. Not quite 0, as the model is identified from an average.
    pub mean: [f64; 3],
    pub spread: [[f64; 3]; 3],
    pub noise: [[f64; 3]; 3],
    /// Share of `spread` that counts in the metric, above 0 and at most 1.
    pub share: f64,
}

impl Sensitivity {
    /// The sensitivity with mean and spread 0. `tangent`: T, counts; `noise`: standard deviation of
    /// one sample, counts. `None`: the columns of T are linearly dependent.
    pub fn new(tangent: &DMatrix<f64>, noise: f64) -> Option<Sensitivity> {
        let gram = tangent.tr_mul(tangent);
        let inverse = gram.try_inverse()?;
        let projection = &inverse * tangent.transpose();
        let new = Sensitivity {
            projection: projection.row_iter().map(|r| r.iter().copied().collect()).collect(),
            mean: [0.0; 3],
            spread: [[0.0; 3]; 3],
            noise: rows(&Matrix3::from_fn(|i, j| inverse[(i, j)] * noise * noise)),
            share: tuned::SPREAD_COUNTS,
        };
        new.noise.iter().flatten().all(|v| v.is_finite()).then_some(new)
    }

    /// Enlarges the noise covariance by the largest ratio, over white noise, of p' R p (p: row of P;
    /// R: Toeplitz matrix of the misfits' autocovariance, counts², from lag 0 on).
    pub fn coloured(mut self, autocovariance: &[f64], of_white: &[f64]) -> Sensitivity {
        // every lag but 0 occurs on both sides of R's diagonal
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

    /// Mean and spread by plain moments. `features`: of signals, with their drives; not empty.
    pub fn with_spread(self, features: &[(Vector3<f64>, f64)]) -> Sensitivity {
        let n = features.len() as f64;
        let mean = features.iter().map(|(x, _)| x).sum::<Vector3<f64>>() / n;
        let total = features.iter().fold(Matrix3::zeros(), |s, (x, _)| {
            let d = x - mean;
            s + d * d.transpose()
        }) / (n - 1.0).max(1.0);
        self.with_total(mean, total, features)
    }

    /// Standard deviation of one sample's noise, counts, as the noise of ln amplitude implies it.
    pub fn noise_of_one_sample(&self) -> f64 {
        let square = self.projection[0].iter().map(|p| p * p).sum::<f64>();
        (self.noise[0][0] / square).sqrt()
    }

    /// The sensitivity after a change that all channels share. `tangent`: N x 3, of the changed ring; `louder`: how many
    /// times as large the noise is.
    pub fn moved(&self, tangent: &DMatrix<f64>, louder: f64) -> Option<Sensitivity> {
        let noise = louder * self.noise_of_one_sample();
        Some(Sensitivity::new(tangent, noise)?.with_spread_of(self))
    }

    pub fn with_spread_of(self, other: &Sensitivity) -> Sensitivity {
        Sensitivity { mean: other.mean, spread: other.spread, share: other.share, ..self }
    }

    /// As [`Sensitivity::with_spread`], but up to two in five of the signals may be faulty.
    pub fn with_core_spread(self, features: &[(Vector3<f64>, f64)]) -> Sensitivity {
        let points: Vec<Vector3<f64>> = features.iter().map(|(x, _)| *x).collect();
        let Core { mean, covariance } = core_of(&points);
        self.with_total(mean, covariance, features)
    }

    pub fn scattering_like(self, other: &Sensitivity) -> Sensitivity {
        Sensitivity { spread: other.spread, ..self }
    }

    /// Mean squared distance, at the reference drive, of healthy signals that have this spread and
    /// this noise: tr(M C) with C the whole covariance. NaN: the metric is singular.
    pub fn mean_square(&self) -> f64 {
        let all = matrix(&self.spread) + matrix(&self.noise);
        self.metric(1.0).map_or(f64::NAN, |metric| (metric * all).trace())
    }

    /// Volume, up to a factor, of the features whose squared distance is at most `square`: of two tests
    /// with one rate of false alarms the smaller one finds more faults.
    pub fn volume(&self, square: f64) -> f64 {
        let density = self.metric(1.0).map_or(0.0, |metric| metric.determinant());
        (square.powi(3) / density).sqrt()
    }

    /// Sets the mean, and the spread as the covariance `total` less the mean noise's at these drives.
    fn with_total(
        mut self,
        mean: Vector3<f64>,
        total: Matrix3<f64>,
        features: &[(Vector3<f64>, f64)],
    ) -> Sensitivity {
        let n = features.len() as f64;
        let of_noise = features.iter().map(|(_, s)| 1.0 / (s * s)).sum::<f64>() / n;
        let beyond = total - matrix(&self.noise) * of_noise;

        // by sampling error a direction may have less variance than the noise: it has no spread
        let eigen = beyond.symmetric_eigen();
        let kept = eigen.eigenvalues.map(|v| v.max(0.0));
        let spread =
            eigen.eigenvectors * Matrix3::from_diagonal(&kept) * eigen.eigenvectors.transpose();
        self.mean = mean.into();
        self.spread = rows(&spread);
        self
    }

    /// Features to first order. `deviation`: d, N, counts; `drive`: s, relative to the reference.
    pub fn features(&self, deviation: &[f64], drive: f64) -> Vector3<f64> {
        Vector3::from_fn(|k, _| dot(&self.projection[k], deviation) / drive)
    }

    /// The metric M at a relative drive. `None`: the covariance is singular.
    pub fn metric(&self, drive: f64) -> Option<Matrix3<f64>> {
        (matrix(&self.spread) * self.share + matrix(&self.noise) / (drive * drive)).try_inverse()
    }

    /// Gram matrix T'T of the sensitivities, counts². `None`: they are linearly dependent.
    pub fn gram(&self) -> Option<Matrix3<f64>> {
        // T itself is not stored, but P P' = (T'T)^-1
        let row = |i: usize| &self.projection[i];
        Matrix3::from_fn(|i, j| dot(row(i), row(j))).try_inverse()
    }

    pub fn distance(&self, metric: &Matrix3<f64>, features: &Vector3<f64>) -> f64 {
        let d = features - Vector3::from(self.mean);
        d.dot(&(metric * d))
    }
}

pub(super) struct Core {
    pub mean: Vector3<f64>,
    pub covariance: Matrix3<f64>,
}

/// Robust mean and covariance of one or more points by the minimum covariance determinant: the moments
/// of the closest three in five, by concentration steps (Rousseeuw and Van Driessen 1999) from one
/// start, scaled up for a Gaussian.
pub(super) fn core_of(points: &[Vector3<f64>]) -> Core {
    /// Variance of the innermost .6 (`core_share`) of a three-dimensional Gaussian over that of all:
    /// P(chi²_5 < q) / .6 with P(chi²_3 < q) = .6.
    const SHRINKS: f64 = 0.486;
    const STEPS: usize = 30;
    let kept = ((tuned::CORE_SHARE * points.len() as f64).ceil() as usize).clamp(1, points.len());

    let along = |k: usize| points.iter().map(|x| x[k]).collect::<Vec<f64>>();
    let mut mean = Vector3::from_fn(|k, _| median(&mut along(k)));
    let spread =
        Vector3::from_fn(|k, _| robust_sd(&along(k), mean[k]).powi(2).max(f64::MIN_POSITIVE));
    let mut covariance = Matrix3::from_diagonal(&spread);
    let mut order: Vec<usize> = (0..points.len()).collect();
    for _ in 0..STEPS {
        let Some(metric) = covariance.try_inverse() else { break };
        let far: Vec<f64> = points
            .iter()
            .map(|x| {
                let d = x - mean;
                d.dot(&(metric * d))
            })
            .collect();
        // ordered by index, so that the result has the same bits in every run
        order.select_nth_unstable_by(kept - 1, |&i, &j| far[i].total_cmp(&far[j]).then(i.cmp(&j)));
        let mut nearest = order[..kept].to_vec();
        nearest.sort_unstable();
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

pub(super) fn rows(m: &Matrix3<f64>) -> [[f64; 3]; 3] {
    std::array::from_fn(|i| std::array::from_fn(|j| m[(i, j)]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::normal::draws;

    fn tangent(n: usize) -> DMatrix<f64> {
        DMatrix::from_fn(n, 3, |i, j| ((i * (j + 1)) as f64 * 0.1).sin() * 100.0)
    }

    /// Draws a deviation of 64 samples: each parameter moves with its standard deviation, and the
    /// noise is that of the tests' sensitivities.
    fn deviation(sds: [f64; 3], drive: f64, normal: &mut impl FnMut() -> f64) -> Vec<f64> {
        let theta = Vector3::from(sds.map(|sd| sd * normal()));
        let moved = tangent(64) * theta * drive;
        moved.iter().map(|moved| moved + 10.0 * normal()).collect()
    }

    /// Tests what the head of this file derives: W is computed by triangular solves from F itself.
    #[test]
    fn the_distance_is_a_weighted_energy_of_the_fd_filters_residual_whatever_its_denominator() {
        use crate::detect::ResidualGenerator;
        use nalgebra::DVector;
        const N: usize = 96;
        let tangent = tangent(N);
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
        let sensitivity = Sensitivity::new(&tangent(64), 10.0).unwrap();
        let sds = [0.02, 0.05, 0.03];
        for drive in [0.5, 1.0, 2.0] {
            let mut signal = || {
                let d = deviation(sds, drive, &mut normal);
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
        let mut healthy = |n: usize| -> Vec<(Vec<f64>, f64)> {
            (0..n)
                .map(|i| {
                    let drive = if i % 3 == 0 { 0.8 } else { 1.0 };
                    let d = deviation([0.02, 0.05, 0.002], drive, &mut normal);
                    (d, drive)
                })
                .collect()
        };
        let new = Sensitivity::new(&tangent(64), 10.0).unwrap();
        let features: Vec<(Vector3<f64>, f64)> =
            healthy(4000).iter().map(|(d, drive)| (new.features(d, *drive), *drive)).collect();
        let learned = new.with_spread(&features);
        let fresh = healthy(4000);
        let theta = Matrix3::from_diagonal(&Vector3::new(4e-4, 25e-4, 4e-6));
        let [mut all, mut part] = [0.0; 2];
        for (share, found) in [(1.0, &mut all), (0.35, &mut part)] {
            let learned = Sensitivity { share, ..learned.clone() };
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
}
