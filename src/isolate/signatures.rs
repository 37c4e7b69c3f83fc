//! What each fault looks like: mean deviations, and the estimation matrix R made of them.
//!
//! In: labelled deviations y - (healthy mean), counts. Out: per class rho, and R with its Gram
//! matrix. thesis §3-3-2.
//!
//! Departs: the thesis averages residuals. The filter is linear, so the residual of the mean
//! deviation is the mean residual; and kept as deviations the library survives another model of the
//! healthy channel (with raw signals a 1 % drift of the resonance leaks 48 % of the SDN signature's
//! norm into every signature).

use super::{IsolateError, MAX_CLASSES};
use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};

/// Mean deviation per fault class, per unit of drive scale (1: the drive voltage of the model).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SignatureLibrary {
    pub classes: Vec<String>,
    /// Signals that each mean is of.
    pub n_signals: Vec<u64>,
    /// Per class, N samples, counts.
    pub mean_deviations: Vec<Vec<f64>>,
}

impl SignatureLibrary {
    /// An empty library of these classes, for signals of `samples` samples.
    pub fn new(classes: &[String], samples: usize) -> Result<SignatureLibrary, IsolateError> {
        if classes.is_empty() || classes.len() > MAX_CLASSES {
            return Err(IsolateError::ClassCount { found: classes.len() });
        }
        if let Some((_, class)) =
            classes.iter().enumerate().find(|(i, class)| classes[..*i].contains(class))
        {
            return Err(IsolateError::RepeatedClass { class: class.clone() });
        }
        Ok(SignatureLibrary {
            classes: classes.to_vec(),
            n_signals: vec![0; classes.len()],
            mean_deviations: vec![vec![0.0; samples]; classes.len()],
        })
    }

    /// Takes one signal's deviation (N, counts) into the mean of its class: rho of thesis §3-3-2.
    /// `drive_scale`: its drive voltage over the model's; x_a, hence the signal, is proportional.
    pub fn add(
        &mut self,
        class: usize,
        deviation: &[f64],
        drive_scale: f64,
    ) -> Result<(), IsolateError> {
        let Some(mean) = self.mean_deviations.get_mut(class) else {
            return Err(IsolateError::ClassCount { found: class + 1 });
        };
        if deviation.len() != mean.len() {
            let (found, expected) = (deviation.len(), mean.len());
            return Err(IsolateError::WrongLength { what: "deviation", found, expected });
        }
        if !(drive_scale > 0.0 && drive_scale.is_finite()) {
            return Err(IsolateError::BadDriveScale { value: drive_scale });
        }
        if let Some(index) = deviation.iter().position(|v| !v.is_finite()) {
            return Err(IsolateError::NotFinite { what: "deviation", index });
        }
        self.n_signals[class] += 1;
        let n = self.n_signals[class] as f64;
        for (m, d) in mean.iter_mut().zip(deviation) {
            *m += (d / drive_scale - *m) / n;
        }
        Ok(())
    }

    /// Every class has been seen.
    pub fn check_complete(&self) -> Result<(), IsolateError> {
        match self.n_signals.iter().position(|&n| n == 0) {
            Some(i) => Err(IsolateError::EmptyClass { class: self.classes[i].clone() }),
            None => Ok(()),
        }
    }
}

/// R = [rho_1 ... rho_nf], thesis §3-3-2, and G = R^T R. Columns: the residual of each class's mean
/// deviation, counts, from whatever filter the design has.
#[derive(Clone, Debug, PartialEq)]
pub struct SignatureMatrix {
    /// N x n_f.
    pub r: DMatrix<f64>,
    /// n_f x n_f.
    pub gram: DMatrix<f64>,
}

impl SignatureMatrix {
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

    /// c = R^T r into `c` (n_f). `residual`: N, counts; of the shorter only.
    pub fn project(&self, residual: &[f64], c: &mut [f64]) {
        for (c, column) in c.iter_mut().zip(self.r.column_iter()) {
            *c = column.iter().zip(residual).map(|(rho, r)| rho * r).sum();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(n: usize) -> Vec<String> {
        (0..n).map(|i| format!("F{i}")).collect()
    }

    #[test]
    fn a_signature_is_the_mean_deviation_per_unit_of_drive() {
        let mut library = SignatureLibrary::new(&names(2), 2).unwrap();
        library.add(0, &[1.0, 2.0], 1.0).unwrap();
        library.add(0, &[6.0, 0.0], 2.0).unwrap();
        assert_eq!(library.mean_deviations[0], [2.0, 1.0]);
        assert_eq!(library.n_signals, [2, 0]);
        assert_eq!(
            library.check_complete(),
            Err(IsolateError::EmptyClass { class: "F1".to_string() })
        );
    }

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
        assert!(SignatureLibrary::new(&[], 4).is_err());
        assert!(SignatureLibrary::new(&names(33), 4).is_err());
        assert!(SignatureLibrary::new(&["A".to_string(), "A".to_string()], 4).is_err());
        let mut library = SignatureLibrary::new(&names(1), 2).unwrap();
        assert!(library.add(1, &[1.0, 2.0], 1.0).is_err());
        assert!(library.add(0, &[1.0], 1.0).is_err());
        assert!(library.add(0, &[1.0, f64::NAN], 1.0).is_err());
        assert!(library.add(0, &[1.0, 2.0], 0.0).is_err());
        assert_eq!(library.n_signals, [0]);
        assert!(SignatureMatrix::new(&[]).is_err());
        assert!(SignatureMatrix::new(&[&[1.0], &[1.0, 2.0]]).is_err());
        assert!(SignatureMatrix::new(&[&[f64::INFINITY]]).is_err());
        assert!(SignatureMatrix::new(&[&[1e200]]).is_err());
    }
}
