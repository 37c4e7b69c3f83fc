//! Numerator enhancement as Appendix A of the thesis writes it (`detect.denominator` =
//! `appendix-a`), so that its effect can be seen. For use there is [`super::numerator`].
//!
//! In: r_f, the mean of a fault's residuals, sample by sample. Out: M(z). The steps of the text:
//!
//! 1. beta*: the inner products of r_f with a constant and with sines and cosines.
//! 2. D-bar: the rows beta* D^k, k = 0, 1, ..; D is the derivative by time in that basis.
//! 3. Q_x = D-bar D-bar^T, and M(s) = det(Q_x - sI).
//!
//! Q_x is positive semidefinite, so such an M has real roots at or right of 0 whatever the fault is.

use super::DetectError;
use super::poles::monic;
use nalgebra::{DMatrix, DVector, SymmetricEigen};
use std::f64::consts::TAU;

/// Most frequencies of the basis beside the constant. N samples tell (N - 1)/2 of them apart.
const HARMONICS: usize = 40;

/// M(z), monic, descending powers, of degree `degree` >= 1. `residual`: the mean residual of a
/// fault, N, counts. An error if its energy is 0 or not finite, or if a root has no finite image.
///
/// Departs: the roots of the text's M(s) are mapped by the bilinear z = (2 + s) / (2 - s), with
/// time counted in samples. The basis ends below half the sample rate, and beta* has length 1.
pub fn as_written(residual: &[f64], degree: usize) -> Result<Vec<f64>, DetectError> {
    let n = residual.len();
    let failed = || DetectError::Decomposition { rows: degree, columns: degree };
    let energy: f64 = residual.iter().map(|r| r * r).sum();
    if !(energy > 0.0 && energy.is_finite()) {
        return Err(DetectError::NoResidual);
    }
    let harmonics = HARMONICS.min((n - 1) / 2);
    let omega = TAU / n as f64;
    // the inner product with b_i: a constant, then sine (odd i) and cosine (even i) in turn
    let beta = |i: usize| {
        let at = |k: usize| match i % 2 {
            0 => (i as f64 / 2.0 * omega * k as f64).cos(),
            _ => (i.div_ceil(2) as f64 * omega * k as f64).sin(),
        };
        residual.iter().enumerate().map(|(k, r)| at(k) * r).sum::<f64>()
    };
    let mut row = DVector::from_fn(2 * harmonics + 1, |i, _| beta(i));
    row /= row.norm().max(f64::MIN_POSITIVE);

    let mut d_bar = DMatrix::zeros(degree, row.len());
    for k in 0..degree {
        d_bar.row_mut(k).copy_from(&row.transpose());
        let before = row.clone();
        row[0] = 0.0;
        for h in 1..=harmonics {
            let (sin, cos) = (2 * h - 1, 2 * h);
            let frequency = h as f64 * omega;
            (row[sin], row[cos]) = (-frequency * before[cos], frequency * before[sin]);
        }
    }

    let q_x = &d_bar * d_bar.transpose();
    let roots = SymmetricEigen::try_new(q_x, f64::EPSILON, 10_000).ok_or_else(failed)?.eigenvalues;
    let m = monic(roots.iter().map(|s| (2.0 + s) / (2.0 - s)));
    if m.iter().all(|v| v.is_finite()) { Ok(m) } else { Err(failed()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Shows the defect for which `numerator.rs` departs from the text: whatever the fault is, M's
    /// roots are real.
    #[test]
    fn its_zeros_are_real_whatever_the_fault_is() {
        for (frequency, damping) in [(0.3, 0.01), (0.5, 0.05), (1.0, 0.002)] {
            let r: Vec<f64> = (0..128)
                .map(|k| (-damping * f64::from(k)).exp() * (frequency * f64::from(k)).sin())
                .collect();
            let m = as_written(&r, 2).unwrap();
            let [a, b, c] = m[..] else { panic!("{m:?}") };
            assert!(b * b - 4.0 * a * c >= -1e-12, "{m:?}");
        }
    }

    #[test]
    fn of_no_residual_nothing_is_made_and_the_error_says_so() {
        for none in [&[][..], &[0.0; 64], &[f64::NAN; 64]] {
            assert!(matches!(as_written(none, 2), Err(DetectError::NoResidual)));
        }
    }

    #[test]
    fn a_short_residual_has_no_harmonics_beyond_half_the_sample_rate() {
        // One period in 9 samples is the basis's first sine and nothing else (harmonics 8, 10, ..
        // would be that sine again). So the rows of D-bar are that sine and its derivative, and Q_x
        // has the eigenvalues 1 and omega².
        let r: Vec<f64> = (0..9).map(|k| (TAU / 9.0 * f64::from(k)).sin()).collect();
        let root = |s: f64| (2.0 + s) / (2.0 - s);
        let (p, q) = (root(1.0), root(TAU * TAU / 81.0));
        let m = as_written(&r, 2).unwrap();
        assert!((m[1] + p + q).abs() < 1e-9 && (m[2] - p * q).abs() < 1e-9, "{m:?}");
    }
}
