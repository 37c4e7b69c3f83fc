//! The second test of detection, of goodness of fit: whether a signal contains something that no
//! ring explains.
//!
//! In: a signal's *misfit*, the square norm, counts², that remains when a ring is fitted to the
//! signal (or an upper bound to first order, where that decides). Out: how far it exceeds that of
//! healthy signals: the square of (root of the misfit - median) / standard deviation, and 0 below
//! the median, since too small a misfit is no fault.
//!
//! The first test ([`super::sensitivity`]) looks along the ring's sensitivities, this one at their
//! orthogonal complement: offsets, drifts, outlying samples and other disturbances of the sensor.

use super::Threshold;
use crate::model::median::{median, robust_sd};
use serde::{Deserialize, Serialize};

/// Beyond so many healthy standard deviations a first-order misfit is computed again by a fit.
pub const SECOND_LOOK_SDS: f64 = 3.0;

#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Misfit {
    pub square: f64,
    /// Median and robust standard deviation of the roots of the healthy misfits, counts.
    pub root: f64,
    pub root_sd: f64,
    /// The threshold on [`Misfit::statistic`], a squared distance.
    pub threshold: Threshold,
}

impl Misfit {
    /// Robust location and scale, in counts, of the roots of misfits (`squares`, counts²), of which
    /// two in five may be of faulty signals. `None`: location or scale is no positive number.
    pub fn scale(squares: &[f64]) -> Option<[f64; 2]> {
        let mut roots: Vec<f64> = squares.iter().map(|q| q.max(0.0).sqrt()).collect();
        if roots.is_empty() {
            return None;
        }
        let root = median(&mut roots);
        let sd = robust_sd(&roots, root);
        (root > 0.0 && sd > 0.0 && sd.is_finite()).then_some([root, sd])
    }

    /// The header's statistic of one misfit, by the numbers of [`Misfit::scale`].
    pub fn distance(square: f64, [root, sd]: [f64; 2]) -> f64 {
        ((square.max(0.0).sqrt() - root) / sd).max(0.0).powi(2)
    }

    /// [`Misfit::distance`] by this model's numbers; NaN for an unknown misfit (NaN).
    pub fn statistic(&self, square: f64) -> f64 {
        if square.is_nan() { f64::NAN } else { Misfit::distance(square, [self.root, self.root_sd]) }
    }

    /// The misfit over the healthy mean: 1 is what noise alone leaves.
    pub fn relative(&self, square: f64) -> f64 {
        square / self.square
    }

    /// The test of signals that are `times` as large, noise and all, as those of another gain are.
    pub fn louder(self, times: f64) -> Misfit {
        let (root, root_sd) = (times * self.root, times * self.root_sd);
        Misfit { square: times * times * self.square, root, root_sd, ..self }
    }

    pub fn settled_square(&self) -> f64 {
        let sds = SECOND_LOOK_SDS.min(self.threshold.value.sqrt());
        (self.root + self.root_sd * sds).powi(2)
    }

    /// The largest misfit, counts², that this test calls healthy.
    pub fn healthy_square(&self) -> f64 {
        (self.root + self.root_sd * self.threshold.value.sqrt()).powi(2)
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
