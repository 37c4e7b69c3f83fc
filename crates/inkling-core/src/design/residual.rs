//! The residual of a model's FD filter, with disturbances decoupled, and its metrics (energy and maximum).

use super::{DesignError, HealthyModel, Statistic};
use crate::detect::decoupling::{Disturbance, KnownShapes};
use crate::model::ring_fit::Features;

impl HealthyModel {
    /// The subspace of the named disturbances, which is removed from deviations before the filter. An error
    /// if they cannot be told from each other or from the ring's own changes.
    pub(super) fn decoupling(
        &self,
        disturbances: &[Disturbance],
    ) -> Result<KnownShapes, DesignError> {
        let tangent = self.fitter()?.tangent(&Features::HEALTHY);
        KnownShapes::new(disturbances, &tangent).ok_or_else(|| {
            DesignError::Invalid("detect.decouple: they cannot be told from each other".into())
        })
    }

    /// A deviation without the disturbances that `detect.decouple` names. `scratch`: a buffer for the result.
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

    /// The statistic of the residual, disturbances decoupled: its energy e(r), counts²·s, or its largest |r|,
    /// counts, with `detect.method` = `residual-maximum`. `scratch`: a buffer.
    pub(super) fn of_residual(&self, deviation: &[f64], scratch: &mut Vec<f64>) -> f64 {
        let deviation = self.without_disturbances(deviation, scratch);
        match self.statistic {
            Some(Statistic::ResidualMaximum) => self.generator.maximum(deviation),
            _ => self.generator.energy(deviation),
        }
    }

    /// Writes the residual r of the FD filter, disturbances decoupled, N, counts.
    pub fn residual(&self, deviation: &[f64], residual: &mut [f64]) {
        let mut scratch = Vec::new();
        self.generator.filter(self.without_disturbances(deviation, &mut scratch), residual);
    }

    /// F' x, with the matrix F of the filter r = F d, decoupling of disturbances included. The inner product
    /// of x with a residual is that of F' x with the deviation.
    pub fn adjoint(&self, column: &[f64]) -> Vec<f64> {
        let mut x = self.generator.adjoint(column);
        if let Some(decoupled) = &self.decoupled {
            decoupled.take_off_transposed(&mut x);
        }
        x
    }
}
