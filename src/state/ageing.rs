//! How far the channels of a head have moved apart: what most of them do is ageing, what one does is a fault.
//!
//! In: what each channel moved by, in standard deviations of what a healthy one moves by. Out: the covariance of it,
//! whatever fewer than half of the channels do. A full one: what ages moves features together, and a channel that
//! went four deviations along the way of all would lie eight off by each feature alone.

use super::canonical::Features;
use crate::model::median::median;
use nalgebra::{Matrix4, Vector4};

/// Channels from which they have a covariance: twice as many as features.
const FEWEST: usize = 8;
/// Steps after which the half that lies closest together is found: it rarely takes five.
const STEPS: usize = 10;
/// Median of chi-squared with one and with four degrees of freedom; upper 2.5 % of the latter.
const MEDIAN_1: f64 = 0.4549;
const MEDIAN_4: f64 = 3.3567;
const UPPER_4: f64 = 11.143;
/// Variance of a Gaussian over that of what is left of it within `UPPER_4`.
const OF_WITHIN: f64 = 0.975 / 0.94;
/// The minimum covariance determinant about zero (Rousseeuw 1984), reweighted, and in no direction less than one. By
/// chance its largest eigenvalue is 1.3 of 60 healthy channels, 1.9 of 8 (medians of 1000 draws).
pub fn covariance(moved: &[Features]) -> Matrix4<f64> {
    robust(moved).map_or(Matrix4::identity(), |of| at_least_one(&of))
}

fn robust(moved: &[Features]) -> Option<Matrix4<f64>> {
    if moved.len() < FEWEST {
        return None;
    }
    let by_feature = Vector4::from_fn(|k, _| {
        median(&mut moved.iter().map(|m| m[k] * m[k]).collect::<Vec<f64>>()) / MEDIAN_1
    });
    let mut of = Matrix4::from_diagonal(&by_feature);
    let half = moved.len().div_ceil(2);
    let mut closest: Vec<&Features> = Vec::new();
    for _ in 0..STEPS {
        let mut by_distance = with_squares(moved, &of)?;
        by_distance.sort_by(|p, q| p.0.total_cmp(&q.0));
        let next: Vec<&Features> = by_distance[..half].iter().map(|of| of.1).collect();
        let scatter = mean_square(&next);
        let mut squares: Vec<f64> =
            with_squares(moved, &scatter)?.into_iter().map(|of| of.0).collect();
        of = scatter * (median(&mut squares) / MEDIAN_4);
        if next.iter().zip(&closest).filter(|(p, q)| std::ptr::eq(**p, **q)).count() == half {
            break;
        }
        closest = next;
    }
    let within = with_squares(moved, &of)?.into_iter().filter(|of| of.0 < UPPER_4);
    let within: Vec<&Features> = within.map(|of| of.1).collect();
    Some(mean_square(&within) * OF_WITHIN)
}

fn with_squares<'a>(
    moved: &'a [Features],
    covariance: &Matrix4<f64>,
) -> Option<Vec<(f64, &'a Features)>> {
    let inverse = covariance.try_inverse().filter(|of| of.iter().all(|v| v.is_finite()))?;
    Some(moved.iter().map(|m| (m.dot(&(inverse * m)), m)).collect())
}

fn mean_square(of: &[&Features]) -> Matrix4<f64> {
    of.iter().fold(Matrix4::zeros(), |sum, m| sum + *m * m.transpose()) / of.len() as f64
}

fn at_least_one(of: &Matrix4<f64>) -> Matrix4<f64> {
    let eigen = of.symmetric_eigen();
    let values = Matrix4::from_diagonal(&eigen.eigenvalues.map(|v| v.max(1.0)));
    eigen.eigenvectors * values * eigen.eigenvectors.transpose()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::StandardNormal;

    fn draws(n: usize, rng: &mut ChaCha8Rng) -> Vec<Features> {
        (0..n).map(|_| Vector4::from_fn(|_, _| rng.sample(StandardNormal))).collect()
    }

    /// What is written at [`covariance`], and that none of a hundred heads hides a fault ten deviations off.
    #[test]
    fn by_chance_little_is_wider() {
        let mut rng = ChaCha8Rng::seed_from_u64(31);
        for (n, usual) in [(8, 1.85), (60, 1.30)] {
            let largest = |_| covariance(&draws(n, &mut rng)).symmetric_eigenvalues().max();
            let mut largest: Vec<f64> = (0..300).map(largest).collect();
            let found = median(&mut largest);
            assert!((found / usual - 1.0).abs() < 0.05, "{n} channels: {found}");
        }
        for _ in 0..100 {
            let mut moved = draws(60, &mut rng);
            moved[0] = Vector4::new(0.0, 0.0, -10.0, 0.0);
            let inverse = covariance(&moved).try_inverse().unwrap();
            assert!(moved[0].dot(&(inverse * moved[0])) > 33.4);
        }
    }

    /// Ageing that ties the features together is found, though two in five channels do something else.
    #[test]
    fn ageing_is_what_most_channels_do() {
        let mut rng = ChaCha8Rng::seed_from_u64(32);
        let way = Vector4::new(4.0, -3.0, 1.0, 0.5);
        let mut moved = draws(60, &mut rng);
        for m in &mut moved[..36] {
            *m += way * rng.sample::<f64, _>(StandardNormal);
        }
        for m in &mut moved[36..] {
            *m += Vector4::new(0.0, 12.0, 30.0, 0.0);
        }
        let of = covariance(&moved);
        let along = way.dot(&(of * way)) / way.norm_squared();
        assert!((10.0..80.0).contains(&along), "{along}, truly {}", 1.0 + way.norm_squared());
        let inverse = of.try_inverse().unwrap();
        let far = |m: &Features| m.dot(&(inverse * m)) > 33.0;
        assert_eq!(moved[..36].iter().filter(|m| far(m)).count(), 0);
        assert_eq!(moved[36..].iter().filter(|m| far(m)).count(), 24);
    }
}
