//! What the baseline of ink channels computes with the five free parameters of a decay (ln damping,
//! ln frequency, and the amplitudes a, b, c). "In units of `scale`" means that the amplitudes are divided by the ring's
//! amplitude (`Model::scale`), so that all five numbers are of similar size.

use inkling_core::model::free_decay::{FREE, Theta};
use nalgebra::{SMatrix, SVector};

pub type Matrix5 = SMatrix<f64, FREE, FREE>;
pub type Vector5 = SVector<f64, FREE>;

/// Least eigenvalue of a covariance in units of `scale`, so that it can be inverted: a relative scatter of
/// 1e-5, squared.
const LEAST_SCATTER: f64 = 1e-10;

/// A matrix made symmetric, with its eigenvalues raised to [`LEAST_SCATTER`] at least; in units of `scale`.
pub fn floored(m: &Matrix5) -> Matrix5 {
    let eigen = ((m + m.transpose()) * 0.5).symmetric_eigen();
    let values = eigen.eigenvalues.map(|v| v.max(LEAST_SCATTER));
    eigen.eigenvectors * Matrix5::from_diagonal(&values) * eigen.eigenvectors.transpose()
}

/// Floors `m`, a covariance or a Gram matrix, and inverts it.
pub fn inverse(m: &Matrix5) -> Matrix5 {
    inverse_or_zero(floored(m))
}

pub fn inverse_or_zero(m: Matrix5) -> Matrix5 {
    m.try_inverse().unwrap_or_else(Matrix5::zeros)
}

/// Mean of each group's vectors; 0 for an empty group. `members`: group and vector of each.
pub fn means_of_groups<const N: usize>(
    groups: usize,
    members: impl Iterator<Item = (usize, SVector<f64, N>)>,
) -> Vec<SVector<f64, N>> {
    let mut sums = vec![(SVector::zeros(), 0.0_f64); groups];
    for (group, x) in members {
        sums[group].0 += x;
        sums[group].1 += 1.0;
    }
    sums.into_iter().map(|(sum, count)| sum / count.max(1.0)).collect()
}

pub fn free_part(theta: &Theta, scale: &Vector5) -> Vector5 {
    theta.fixed_rows::<FREE>(0).component_div(scale)
}

/// A covariance in units of `scale`, from the parameters' own.
pub fn scaled(m: &Matrix5, scale: &Vector5) -> Matrix5 {
    Matrix5::from_fn(|i, j| m[(i, j)] / (scale[i] * scale[j]))
}

pub fn unscaled(m: &Matrix5, scale: &Vector5) -> Matrix5 {
    Matrix5::from_fn(|i, j| m[(i, j)] * scale[i] * scale[j])
}
