//! The second test of detection, of goodness of fit: whether a signal contains something that no
//! ring explains.
//!
//! In, from `design/detector.rs`: a signal's *misfit*, the square norm, counts², that remains when
//! a ring with free amplitude, damping, frequency and phase is fitted to the signal (or an upper
//! bound to first order, where that decides). Out: how far the misfit exceeds that of healthy
//! signals, as a squared distance, which is compared with a threshold.
//! `design/learn_distances.rs` learns the [`Misfit`] of a model.
//!
//! The first test ([`super::sensitivity`]) looks along the ring's sensitivities, this one at their
//! orthogonal complement: offsets, drifts, outlying samples, noise and other disturbances of the
//! sensor. The idea: the root of a healthy misfit scatters about a median with a standard
//! deviation; the statistic is the square of (root - median) / standard deviation, and 0 below the
//! median, since too small a misfit is no fault.

use super::Threshold;
use crate::model::median::{median, robust_sd};
use serde::{Deserialize, Serialize};

/// A first-order misfit whose root exceeds the healthy median by more than this many healthy
/// standard deviations is computed again by a fit. A smaller number costs time (more signals are
/// fitted) and changes little else.
pub const SECOND_LOOK_SDS: f64 = 3.0;

/// The distribution of healthy signals' misfit, and the test's threshold.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Misfit {
    /// Mean misfit of a healthy signal, counts²: the unit of [`Misfit::relative`], and the noise
    /// level by which isolation counts what lies beside a ring.
    pub square: f64,
    /// Median and robust standard deviation of the roots of the healthy misfits, counts.
    pub root: f64,
    pub root_sd: f64,
    /// The threshold on [`Misfit::statistic`], a squared distance.
    pub threshold: Threshold,
}

impl Misfit {
    /// Robust location and scale (median and scaled median absolute deviation), in counts, of the
    /// roots of misfits, of which two in five may be of faulty signals. `squares`: misfits,
    /// counts². `None`: there are no misfits, or half of them are equal, 0 or not finite, so that
    /// location or scale is no positive number.
    pub fn scale(squares: &[f64]) -> Option<[f64; 2]> {
        let mut roots: Vec<f64> = squares.iter().map(|q| q.max(0.0).sqrt()).collect();
        if roots.is_empty() {
            return None;
        }
        let root = median(&mut roots);
        let sd = robust_sd(&roots, root);
        (root > 0.0 && sd > 0.0 && sd.is_finite()).then_some([root, sd])
    }

    /// The squared standardised excess of a misfit's root over the healthy median; 0 below the median.
    /// `square`: the misfit, counts²; the pair: median and standard deviation of [`Misfit::scale`].
    pub fn distance(square: f64, [root, sd]: [f64; 2]) -> f64 {
        ((square.max(0.0).sqrt() - root) / sd).max(0.0).powi(2)
    }

    /// [`Misfit::distance`] by this model's median and standard deviation; NaN for an unknown
    /// misfit (NaN).
    pub fn statistic(&self, square: f64) -> f64 {
        if square.is_nan() { f64::NAN } else { Misfit::distance(square, [self.root, self.root_sd]) }
    }

    /// The misfit over the healthy mean: 1 is what noise alone leaves.
    pub fn relative(&self, square: f64) -> f64 {
        square / self.square
    }

    /// The misfit, counts², up to which the first-order value decides the test: three standard
    /// deviations above the median, or the threshold if that is lower.
    pub fn settled_square(&self) -> f64 {
        let sds = SECOND_LOOK_SDS.min(self.threshold.value.sqrt());
        (self.root + self.root_sd * sds).powi(2)
    }

    /// The largest misfit, counts², that this test calls healthy: the one whose statistic is the
    /// threshold.
    pub fn healthy_square(&self) -> f64 {
        (self.root + self.root_sd * self.threshold.value.sqrt()).powi(2)
    }

    /// Refuses a stored misfit that could not have been learned.
    pub fn check(&self) -> Result<(), String> {
        let positive = |v: f64| (1e-30..=1e30).contains(&v);
        let whole = [self.square, self.root, self.root_sd, self.threshold.value];
        match whole.into_iter().all(positive) {
            true => Ok(()),
            false => Err("`misfit` must hold positive numbers".into()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::detect::contamination::{Degrees, Spread, contaminated};
    use crate::model::normal::draws;

    #[test]
    fn noise_alone_is_at_1_and_an_offset_stands_out() {
        let mut normal = draws(3);
        let mut squares = |offset: f64| -> Vec<f64> {
            let mut square = || (0..100).map(|_| (3.0 * normal() + offset).powi(2)).sum::<f64>();
            (0..2000).map(|_| square()).collect()
        };
        let healthy = squares(0.0);
        let scale = Misfit::scale(&healthy).unwrap();
        let distances: Vec<f64> = healthy.iter().map(|q| Misfit::distance(*q, scale)).collect();
        let channels: Vec<u32> = (0..2000).collect();
        let threshold =
            contaminated(&distances, &channels, (Degrees::OneSided, Spread::Own), 1e-3, 0.95)
                .unwrap();
        let square = healthy.iter().sum::<f64>() / 2000.0;
        let misfit = Misfit { square, root: scale[0], root_sd: scale[1], threshold };
        misfit.check().unwrap();
        let beyond = |of: &[f64]| {
            of.iter().filter(|q| misfit.statistic(**q) > misfit.threshold.value).count()
        };
        let fresh = squares(0.0);
        assert!(beyond(&fresh) <= 7, "{} of 2000 at a rate of 1e-3", beyond(&fresh));
        assert_eq!(beyond(&squares(6.0)), 2000); // 400 noise variances
        let mean = fresh.iter().map(|q| misfit.relative(*q)).sum::<f64>() / 2000.0;
        assert!((mean - 1.0).abs() < 0.02, "{mean}");
        assert!(misfit.statistic(f64::NAN).is_nan());
        assert!(misfit.settled_square() < scale[0].powi(2) * 2.0);
        let at_threshold = misfit.statistic(misfit.healthy_square());
        assert!((at_threshold / misfit.threshold.value - 1.0).abs() < 1e-9, "{at_threshold}");
    }
}
