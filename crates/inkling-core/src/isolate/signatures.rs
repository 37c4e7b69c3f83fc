//! The estimation matrix R of thesis §3-3-2, and the inner products of signals with it.
//!
//! In, from `design/isolator.rs`: for each fault class its *signature* rho, N counts. It is the
//! residual, by the FD filter, of the class's mean deviation per unit drive; or that deviation
//! itself, where residual matching compares deviations (`isolate.signal`). Out: the matrix R, from
//! which [`super::residual_matching`] learns once how the signatures lie to each other; then, per
//! signal, c = R^T r, which is all that residual matching needs of it.

use super::{IsolateError, MAX_CLASSES};
use crate::model::inner_product::dot;
use nalgebra::DMatrix;

/// R = [rho_1 ... rho_nf], thesis §3-3-2, counts, and G = R^T R. A column is the signature of one class.
///
/// The matrix that signals are projected on may be another one, F^T R, where F is the matrix of the FD
/// filter: since r = F d, its products with a deviation d are those of R with the residual r, and no signal
/// needs to be filtered (`design/isolator.rs`).
#[derive(Clone, Debug, PartialEq)]
pub struct SignatureMatrix {
    /// R (or F^T R), N x n_f.
    pub r: DMatrix<f64>,
    /// G, n_f x n_f, counts². The solver ([`super::Simplex`]) has a Gram matrix of its own, of centred
    /// signatures; this one is for whoever checks it.
    pub gram: DMatrix<f64>,
}

impl SignatureMatrix {
    /// R from its columns, one for each class. Errors: no classes or more than [`MAX_CLASSES`],
    /// columns of different lengths, and numbers that are not finite or whose products are not.
    pub fn new(columns: &[&[f64]]) -> Result<SignatureMatrix, IsolateError> {
        if columns.is_empty() || columns.len() > MAX_CLASSES {
            return Err(IsolateError::ClassCount { found: columns.len() });
        }
        let expected = columns[0].len();
        for column in columns {
            if column.len() != expected {
                let found = column.len();
                return Err(IsolateError::WrongLength { what: "signature", found, expected });
            }
            if let Some(index) = column.iter().position(|v| !v.is_finite()) {
                return Err(IsolateError::NotFinite { what: "signature", index });
            }
        }
        let r = DMatrix::from_fn(expected, columns.len(), |i, j| columns[j][i]);
        let gram = r.tr_mul(&r);
        if let Some(index) = gram.iter().position(|v| !v.is_finite()) {
            return Err(IsolateError::NotFinite { what: "Gram matrix of the signatures", index });
        }
        Ok(SignatureMatrix { r, gram })
    }

    /// n_f, the number of classes.
    pub fn classes(&self) -> usize {
        self.r.ncols()
    }

    /// Writes the inner products of a signal's samples x with all columns, c = R^T x, into `c`
    /// (n_f, counts²). `x`: N, counts; the residual, or the deviation if the columns are those of
    /// F^T R. If `x` is shorter or longer than the columns, only the first samples, which both
    /// have, count.
    pub fn project(&self, x: &[f64], c: &mut [f64]) {
        let n = self.r.nrows().min(x.len());
        for (c, column) in c.iter_mut().zip(self.r.column_iter()) {
            *c = dot(&column.as_slice()[..n], &x[..n]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_gram_matrix_and_the_projection_are_inner_products() {
        let m = SignatureMatrix::new(&[&[1.0, 2.0, 0.0], &[0.0, 1.0, -1.0]]).unwrap();
        assert_eq!(m.gram, nalgebra::dmatrix![5.0, 2.0; 2.0, 2.0]);
        let mut c = [0.0; 2];
        m.project(&[1.0, 1.0, 1.0], &mut c);
        assert_eq!(c, [3.0, 0.0]);
    }

    #[test]
    fn senseless_signatures_are_errors() {
        assert!(SignatureMatrix::new(&[]).is_err());
        assert!(SignatureMatrix::new(&[&[1.0], &[1.0, 2.0]]).is_err());
        assert!(SignatureMatrix::new(&[&[f64::INFINITY]]).is_err());
        assert!(SignatureMatrix::new(&[&[1e200]]).is_err());
    }
}
