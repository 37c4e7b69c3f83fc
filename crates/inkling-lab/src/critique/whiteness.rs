//! Whether a misfit is white noise: the test of Ljung and Box (sums of lagged products), with the exact
//! moments for what a fit leaves.
//!
//! In: each signal's residual, and an orthonormal basis Q (n x q) of what was fitted to it. Out: one p-value.
//!
//! A fit leaves u = M e of the noise e, with M = 1 - Q Q^T, and this correlates neighbouring samples even if
//! e is white. So the autocorrelations a_l = u^T A_l u / u^T u at lag l (A_l: the shift by l samples,
//! symmetrised) have moments of their own, which are known exactly, since u points in all directions of its m
//! = n - q dimensions alike (Mathai and Provost 1992)
//!
//! ```text
//! mean a_l = tr(M A_l) / m,   cov(a_k, a_l) = 2 (tr(M A_k M A_l) - tr(M A_k) tr(M A_l) / m) / (m (m + 2)).
//! ```
//!
//! The statistic is off^T covariance^-1 off with both summed over the signals, chi-squared with as many
//! degrees of freedom as lags.

use super::chance::surprise;
use super::ensemble::{project, shifted};
use nalgebra::{DMatrix, DVector};

/// Largest number of lags; short signals have a quarter of their length.
const LAGS: usize = 10;

#[derive(Clone)]
pub struct Lags {
    /// The autocorrelations less their mean under white noise.
    pub off: DVector<f64>,
    pub covariance: DMatrix<f64>,
}

impl Lags {
    /// `residual`: what a fit left, N samples; `q`: orthonormal columns that span those of the fit.
    pub fn of(mut residual: Vec<f64>, q: &DMatrix<f64>) -> Lags {
        project(q, &mut residual);
        let (u, n) = (residual, q.nrows());
        let lags = LAGS.min(n / 4);
        let left = (n - q.ncols()).max(1) as f64;
        let power = u.iter().map(|u| u * u).sum::<f64>().max(f64::MIN_POSITIVE);
        let shifted: Vec<DMatrix<f64>> = (1..=lags).map(|lag| shifted(q, lag)).collect();
        let inner: Vec<DMatrix<f64>> = shifted.iter().map(|s| q.tr_mul(s)).collect();
        // tr M A = tr A - tr Q^T A Q, and a shift has no diagonal, so that tr A = 0
        let trace: Vec<f64> = inner.iter().map(|m| -m.trace()).collect();
        let off = DVector::from_fn(lags, |l, _| {
            let products: f64 = u.iter().zip(&u[l + 1..]).map(|(x, y)| x * y).sum();
            products / power - trace[l] / left
        });
        // tr(M A_a M A_b) = tr(A_a A_b) - 2 tr((A_a Q)^T A_b Q) + tr(Q^T A_a Q Q^T A_b Q)
        let covariance = DMatrix::from_fn(lags, lags, |a, b| {
            let own = if a == b { 0.5 * (n - a - 1) as f64 } else { 0.0 };
            let both =
                own - 2.0 * shifted[a].dot(&shifted[b]) + inner[a].dot(&inner[b].transpose());
            2.0 * (both - trace[a] * trace[b] / left) / (left * (left + 2.0))
        });
        Lags { off, covariance }
    }

    /// `None` without any signal.
    pub fn sum<'a>(mut all: impl Iterator<Item = &'a Lags>) -> Option<Lags> {
        let first = all.next()?.clone();
        Some(all.fold(first, |mut sum, one| {
            sum.off += &one.off;
            sum.covariance += &one.covariance;
            sum
        }))
    }

    /// off^T covariance^-1 off. `None`: the covariance has no inverse.
    pub fn statistic(&self) -> Option<f64> {
        let factor = self.covariance.clone().cholesky()?;
        Some(self.off.dot(&factor.solve(&self.off)))
    }
}

/// NaN without any signal, or if the covariance has no inverse.
pub fn whiteness_p<'a>(all: impl Iterator<Item = &'a Lags>) -> f64 {
    let sum = Lags::sum(all);
    let of = |sum: &Lags| Some(surprise(sum.statistic()?, sum.off.len(), 1.0, f64::INFINITY));
    sum.as_ref().and_then(of).map_or(f64::NAN, |surprise| (-surprise).exp())
}
