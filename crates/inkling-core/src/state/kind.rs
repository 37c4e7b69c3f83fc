//! How a kind of printhead scatters and moves, whatever one of them does; and the canonical coordinates, in which
//! the noise of one look has covariance 1 and healthy channels' spread is diagonal.

use nalgebra::{Matrix4, Vector4};

/// ln amplitude, ln damping, ln frequency and phase in rad of a ring, relative to another; or the same in canonical
/// coordinates, in standard deviations of one look's noise at the reference drive.
pub type Features = Vector4<f64>;

/// How a kind of head scatters and moves: what a design says of it.
#[derive(Clone, Debug)]
pub struct Kind {
    /// W, which leads to canonical coordinates: W noise W' = 1 and W spread W' = diag(`spread`).
    pub to: Matrix4<f64>,
    pub from: Matrix4<f64>,
    /// Variances of healthy channels, canonical.
    pub spread: Features,
    /// Covariance of a leap, canonical.
    pub(super) leap: Matrix4<f64>,
    /// The same of where another head may be: of order one in each feature.
    pub(super) anywhere: Matrix4<f64>,
    /// ln amplitude, from the head's base ring, of the ring whose noise is 1: the model that a window
    /// identified has the noise of its own ring.
    pub ring: f64,
}

impl Kind {
    /// Covariances of features: of one look's noise at the reference drive, of healthy channels, of what moves all
    /// channels at once (another drive, another temperature). `None`: `noise` is no covariance.
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
            leap: to * leap * to.transpose(),
            anywhere: to * to.transpose(),
            ring: 0.0,
        })
    }

    /// A covariance of features, in canonical coordinates.
    pub fn covariance(&self, of: &Matrix4<f64>) -> Matrix4<f64> {
        self.to * of * self.to.transpose()
    }

    /// A covariance in canonical coordinates, of features.
    pub fn covariance_from(&self, of: &Matrix4<f64>) -> Matrix4<f64> {
        self.from * of * self.from.transpose()
    }
}

/// A covariance with no less than `least` in any direction.
pub(super) fn at_least(least: f64, of: &Matrix4<f64>) -> Matrix4<f64> {
    let eigen = of.symmetric_eigen();
    let variances = Matrix4::from_diagonal(&eigen.eigenvalues.map(|v| v.max(least)));
    eigen.eigenvectors * variances * eigen.eigenvectors.transpose()
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
