//! The estimation matrix R of thesis §3-3-2, and the inner products of signals with it.
//!
//! In: for each fault class its *signature* rho, N counts: the residual of the class's mean
//! deviation per unit drive, or that deviation itself (`isolate.signal`). Out: R, from which
//! [`super::residual_matching`] learns once how signatures lie; then, per signal, c = R^T r.

use super::IsolateError;
use crate::model::inner_product::dot;
use nalgebra::DMatrix;

/// R = [rho_1 ... rho_nf], counts. Signals may be projected on F^T R instead, where F is the matrix
/// of the FD filter: since r = F d, its products with a deviation d are those of R with the
/// residual r, and no signal needs to be filtered.
#[derive(Clone, Debug, PartialEq)]
pub struct SignatureMatrix {
    pub r: DMatrix<f64>,
}

impl SignatureMatrix {
    /// One column per class, all of one length. An error if a number or a product is not finite.
    pub fn new(columns: &[&[f64]]) -> Result<SignatureMatrix, IsolateError> {
        let finite = |what, numbers: &[f64]| match numbers.iter().position(|v| !v.is_finite()) {
            Some(index) => Err(IsolateError::NotFinite { what, index }),
            None => Ok(()),
        };
        columns.iter().try_for_each(|column| finite("signature", column))?;
        let samples = columns.first().map_or(0, |column| column.len());
        let r = DMatrix::from_fn(samples, columns.len(), |i, j| columns[j][i]);
        finite("Gram matrix of the signatures", r.tr_mul(&r).as_slice())?;
        Ok(SignatureMatrix { r })
    }

    /// Writes c = R^T x (n_f, counts²). `x`: N, counts; the residual, or the deviation if the
    /// columns are those of F^T R. Only samples that both have count.
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
    fn senseless_signatures_are_errors() {
        assert!(SignatureMatrix::new(&[&[f64::INFINITY]]).is_err());
        assert!(SignatureMatrix::new(&[&[1e200]]).is_err());
    }
}
