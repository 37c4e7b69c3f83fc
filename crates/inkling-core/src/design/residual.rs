//! The residual r of a model's FD filter, and its metrics (energy and maximum), thesis §3-2.
//!
//! In: a deviation d from the expected signal, N, counts. Out: r = F Q d, N, counts, and e(r) or
//! max |r|. F is the lower triangular N x N matrix of the filter; Q is the projection that removes
//! the disturbances named by `detect.decouple`, or the identity.

use super::{HealthyModel, Statistic};

impl HealthyModel {
    /// Q d. `scratch`: a buffer for the result.
    fn without_disturbances<'a>(
        &self,
        deviation: &'a [f64],
        scratch: &'a mut Vec<f64>,
    ) -> &'a [f64] {
        let Some(decoupled) = &self.decoupled else { return deviation };
        scratch.clear();
        scratch.extend_from_slice(deviation);
        decoupled.take_off(scratch);
        scratch
    }

    /// The energy e(r), counts²·s, or the largest |r|, counts. `scratch`: a buffer.
    pub(super) fn of_residual(&self, deviation: &[f64], scratch: &mut Vec<f64>) -> f64 {
        let deviation = self.without_disturbances(deviation, scratch);
        match self.statistic {
            Some(Statistic::ResidualMaximum) => self.generator.maximum(deviation),
            _ => self.generator.energy(deviation),
        }
    }

    pub fn residual(&self, deviation: &[f64], residual: &mut [f64]) {
        let mut scratch = Vec::new();
        self.generator.filter(self.without_disturbances(deviation, &mut scratch), residual);
    }

    /// (F Q)' x, N: the inner product of x with a residual is that of (F Q)' x with the deviation,
    /// so signatures can be turned once, and signals need no filtering.
    pub fn adjoint(&self, column: &[f64]) -> Vec<f64> {
        let mut x = self.generator.adjoint(column);
        if let Some(decoupled) = &self.decoupled {
            decoupled.take_off_transposed(&mut x);
        }
        x
    }
}
