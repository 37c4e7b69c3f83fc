//! The residual r of a model's FD filter, and its metrics (energy and maximum), thesis §3-2.
//!
//! In: a deviation d from the expected signal, N, counts. Out: r = F d, N, counts, and e(r) or
//! max |r|. F is the lower triangular N x N matrix of the filter.

use super::HealthyModel;

impl HealthyModel {
    /// The energy e(r), counts²·s, or the largest |r|, counts.
    pub(super) fn of_residual(&self, deviation: &[f64]) -> f64 {
        match self.by_maximum {
            true => self.generator.maximum(deviation),
            false => self.generator.energy(deviation),
        }
    }

    /// The same of many signals, each with the same bits. `deviations`: `samples` counts of each
    /// signal, one signal after the other.
    pub fn of_residuals(&self, deviations: &[f64], samples: usize) -> Vec<f64> {
        match self.by_maximum {
            true => deviations.chunks_exact(samples.max(1)).map(|d| self.of_residual(d)).collect(),
            false => self.generator.energies(deviations, samples),
        }
    }

    pub fn residual(&self, deviation: &[f64], residual: &mut [f64]) {
        self.generator.filter(deviation, residual);
    }

    /// F' x, N: the inner product of x with a residual is that of F' x with the deviation, so
    /// signatures can be turned once, and signals need no filtering.
    pub fn adjoint(&self, column: &[f64]) -> Vec<f64> {
        self.generator.adjoint(column)
    }
}
