//! The residual r of a model's FD filter, and its metrics (energy and maximum), thesis §3-2.
//!
//! In: a deviation d from the expected signal, N, counts. Out: r = F Q d, N, counts, and e(r) or
//! max |r|. F is the lower triangular N x N matrix of the filter; Q is the projection that removes
//! the disturbances named by `detect.decouple` (an offset, a drift), and the identity where none
//! are named. `judge` compares the metrics with thresholds, `isolator` compares residuals.

use super::{DesignError, HealthyModel, Statistic};
use crate::detect::decoupling::{Disturbance, KnownShapes};
use crate::model::ring_fit::Features;

impl HealthyModel {
    /// The projection Q that removes the named disturbances from deviations, and keeps every change
    /// of the model's ring whole. An error if the disturbances cannot be told from each other or
    /// from the ring's changes.
    pub(super) fn decoupling(
        &self,
        disturbances: &[Disturbance],
    ) -> Result<KnownShapes, DesignError> {
        let tangent = self.fitter()?.tangent(&Features::HEALTHY);
        KnownShapes::new(disturbances, &tangent).ok_or_else(|| {
            DesignError::Invalid("detect.decouple: they cannot be told from each other".into())
        })
    }

    /// Q d: a deviation without the disturbances that `detect.decouple` names. `scratch`: a buffer
    /// for the result, not used if no disturbances are named.
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

    /// The statistic of the residual of a deviation, N, counts: the energy e(r), counts²·s, or with
    /// `detect.method` = `residual-maximum` the largest |r|, counts. `scratch`: a buffer.
    pub(super) fn of_residual(&self, deviation: &[f64], scratch: &mut Vec<f64>) -> f64 {
        let deviation = self.without_disturbances(deviation, scratch);
        match self.statistic {
            Some(Statistic::ResidualMaximum) => self.generator.maximum(deviation),
            _ => self.generator.energy(deviation),
        }
    }

    /// Writes to `residual` the residual r = F Q d of a deviation; both N, counts.
    pub fn residual(&self, deviation: &[f64], residual: &mut [f64]) {
        let mut scratch = Vec::new();
        self.generator.filter(self.without_disturbances(deviation, &mut scratch), residual);
    }

    /// (F Q)' x, N, for a column x of N: the inner product of x with a residual is that of (F Q)' x
    /// with the deviation. So signatures can be turned once, and signals need no filtering.
    pub fn adjoint(&self, column: &[f64]) -> Vec<f64> {
        let mut x = self.generator.adjoint(column);
        if let Some(decoupled) = &self.decoupled {
            decoupled.take_off_transposed(&mut x);
        }
        x
    }
}
