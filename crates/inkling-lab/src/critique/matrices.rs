//! Covariances of a signal's own parameters: what all files of this room do with them.

use inkling_core::model::free_decay::FREE;
use nalgebra::{SMatrix, SVector};

pub type Matrix5 = SMatrix<f64, FREE, FREE>;
pub type Vector5 = SVector<f64, FREE>;

/// Scatter below this share, squared, is none: it keeps covariances invertible.
const LEAST_SCATTER: f64 = 1e-10;

pub fn floored(m: &Matrix5) -> Matrix5 {
    let eigen = ((m + m.transpose()) * 0.5).symmetric_eigen();
    let values = eigen.eigenvalues.map(|v| v.max(LEAST_SCATTER));
    eigen.eigenvectors * Matrix5::from_diagonal(&values) * eigen.eigenvectors.transpose()
}

pub fn inverse(m: &Matrix5) -> Matrix5 {
    floored(m).try_inverse().unwrap_or_else(Matrix5::zeros)
}

pub fn scaled(m: &Matrix5, scale: &Vector5) -> Matrix5 {
    Matrix5::from_fn(|i, j| m[(i, j)] / (scale[i] * scale[j]))
}
