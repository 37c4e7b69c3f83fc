//! How a kind of printhead scatters and moves, whatever one of them does.

use super::canonical::Canonical;
use nalgebra::Matrix4;

/// How a kind of head scatters and moves: what a design says of it.
#[derive(Clone, Debug)]
pub struct Kind {
    pub canonical: Canonical,
    /// Covariance of a leap, canonical.
    pub(super) leap: Matrix4<f64>,
    /// The same of where another head may be: of order one in each feature.
    pub(super) anywhere: Matrix4<f64>,
}

impl Kind {
    /// Covariances of features: of one look's noise at the reference drive, of healthy channels, of what moves all
    /// channels at once (another drive, another temperature). `None`: `noise` is no covariance.
    pub fn new(noise: &Matrix4<f64>, spread: &Matrix4<f64>, leap: &Matrix4<f64>) -> Option<Kind> {
        let canonical = Canonical::new(noise, spread)?;
        let leap = canonical.covariance(leap);
        let anywhere = canonical.covariance(&Matrix4::identity());
        Some(Kind { canonical, leap, anywhere })
    }
}
