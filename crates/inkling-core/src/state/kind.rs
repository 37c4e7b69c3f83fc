//! How a kind of printhead scatters and moves; and the canonical coordinates, in which the noise of
//! one look has covariance 1 and healthy channels' spread is diagonal.
//!
//! In: three covariances of features, from a design (`Judge::kind`): N of one look's noise, S of
//! healthy channels, L of what moves all channels at once. Out: W with W N W' = 1 and W S W' =
//! diag(spread), and all of it in the coordinates y = W x. With N = K K' (Cholesky) and the
//! eigenvectors V of K^-1 S K'^-1, W = V' K^-1.

use nalgebra::{Matrix4, Vector4};

/// ln amplitude, ln damping, ln frequency and phase in rad of a ring, relative to another; or the
/// same in canonical coordinates, in standard deviations of one look's noise.
pub type Features = Vector4<f64>;

#[derive(Clone, Debug)]
pub struct Kind {
    /// W, which leads from features to canonical coordinates.
    pub to: Matrix4<f64>,
    pub from: Matrix4<f64>,
    /// Variances of healthy channels about their head's level, noise apart, canonical.
    pub spread: Features,
    /// Covariance of what a kelvin does to channels beside what it does to all of them, canonical; 0: not known.
    pub per_k: Matrix4<f64>,
    /// Covariance of a leap of the level, canonical.
    pub(super) leap: Matrix4<f64>,
    /// Covariance of where another head's level may be, canonical.
    pub(super) anywhere: Matrix4<f64>,
    /// ln amplitude, relative to the head's base ring, of the ring whose noise is 1.
    pub ring: f64,
}

impl Kind {
    /// `noise` (N): at the reference drive; `None`: it is no covariance. `ring` and `per_k` begin as 0.
    pub fn new(noise: &Matrix4<f64>, spread: &Matrix4<f64>, leap: &Matrix4<f64>) -> Option<Kind> {
        let root = noise.cholesky()?.l();
        let inverse = root.try_inverse()?;
        let white = inverse * spread * inverse.transpose();

        let eigen = ((white + white.transpose()) * 0.5).symmetric_eigen();
        let to = eigen.eigenvectors.transpose() * inverse;
        let finite = to.iter().all(|v| v.is_finite());
        finite.then(|| Kind {
            to,
            from: root * eigen.eigenvectors,
            spread: eigen.eigenvalues.map(|v| v.max(0.0)),
            per_k: Matrix4::zeros(),
            leap: to * leap * to.transpose(),
            anywhere: to * to.transpose(),
            ring: 0.0,
        })
    }

    /// Variances from which no channel lies farther than by the covariance `per_k`, though they know no direction: a
    /// kelvin moves all features of a channel together, and each of them alone would count that again.
    pub(super) fn variances_per_k(&self) -> Features {
        let (trace, square) = (self.per_k.trace(), self.per_k.norm_squared());
        let directions = if square > 0.0 { trace * trace / square } else { 4.0 };
        self.per_k.diagonal() * (4.0 / directions)
    }

    pub fn covariance(&self, of: &Matrix4<f64>) -> Matrix4<f64> {
        self.to * of * self.to.transpose()
    }

    pub fn covariance_from(&self, of: &Matrix4<f64>) -> Matrix4<f64> {
        self.from * of * self.from.transpose()
    }
}

/// A covariance with its variances along its principal directions raised to at least `least`.
pub fn at_least_as_wide(least: f64, of: &Matrix4<f64>) -> Matrix4<f64> {
    let eigen = of.symmetric_eigen();
    let variances = Matrix4::from_diagonal(&eigen.eigenvalues.map(|v| v.max(least)));
    let raised = eigen.eigenvectors * variances * eigen.eigenvectors.transpose();
    (raised + raised.transpose()) * 0.5
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_becomes_one_and_spread_diagonal() {
        let a = Matrix4::from_fn(|i, j| 0.3 * (i as f64 - 1.3 * j as f64).sin());
        let (noise, spread) = (a * a.transpose() + Matrix4::identity() * 0.1, {
            let b = Matrix4::from_fn(|i, j| (1.0 + i as f64 * j as f64).cos());
            b * b.transpose()
        });
        let of = Kind::new(&noise, &spread, &spread).unwrap();
        assert!((of.covariance(&noise) - Matrix4::identity()).amax() < 1e-10);
        assert!((of.covariance(&spread) - Matrix4::from_diagonal(&of.spread)).amax() < 1e-9);
        assert!((of.covariance_from(&Matrix4::identity()) - noise).amax() < 1e-10);
        assert!(Kind::new(&Matrix4::zeros(), &spread, &spread).is_none());
    }
}
