//! The estimation matrix R of thesis §3-3-2: what each fault's residual looks like.
//!
//! In: per class rho, the residual of its mean deviation. Out: the matrix R with its Gram matrix.

use super::{IsolateError, MAX_CLASSES};
use crate::model::inner_product::dot;
use nalgebra::DMatrix;

/// R = [rho_1 ... rho_nf], thesis §3-3-2, and G = R^T R. A column is the residual of one class's mean
/// deviation, counts, by whatever filter the design has.
#[derive(Clone, Debug, PartialEq)]
pub struct SignatureMatrix {
    /// R, N x n_f.
    pub r: DMatrix<f64>,
    /// G, n_f x n_f.
    pub gram: DMatrix<f64>,
}

impl SignatureMatrix {
    /// R from its columns. Refused are columns of different lengths, and numbers whose products are not
    /// finite.
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

    pub fn classes(&self) -> usize {
        self.r.ncols()
    }

    /// Writes c = R^T r into `c` (n_f). `residual`: N, counts; if its length is another, only the part that
    /// both have counts.
    pub fn project(&self, residual: &[f64], c: &mut [f64]) {
        let n = self.r.nrows().min(residual.len());
        for (c, column) in c.iter_mut().zip(self.r.column_iter()) {
            *c = dot(&column.as_slice()[..n], &residual[..n]);
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
