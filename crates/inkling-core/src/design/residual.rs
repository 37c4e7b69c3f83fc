//! The residual of a model's FD filter, with disturbances decoupled, and its metrics (energy and maximum).

use super::detector::ring_of;
use super::{DesignError, HealthyModel};
use crate::detect::decoupling::{Disturbance, KnownShapes};
use crate::model::ring_fit::{Features, RingFitter};

impl HealthyModel {
    /// The subspace of the named disturbances, which is removed from deviations before the filter. An error
    /// if they cannot be told from each other or from the ring's own changes.
    pub(super) fn decoupling(
        &self,
        disturbances: &[Disturbance],
    ) -> Result<KnownShapes, DesignError> {
        let ring = ring_of(&self.identification)?;
        let fitter = RingFitter::new(ring, self.generator.dt_s, self.expected.len());
        KnownShapes::new(disturbances, &fitter.tangent(&Features::HEALTHY)).ok_or_else(|| {
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

    /// The residual's energy e(r), disturbances decoupled, counts²·s.
    pub fn residual_energy(&self, deviation: &[f64], scratch: &mut Vec<f64>) -> f64 {
        self.generator.energy(self.without_disturbances(deviation, scratch))
    }

    /// The residual's largest |r|, disturbances decoupled, counts.
    pub fn residual_maximum(&self, deviation: &[f64], scratch: &mut Vec<f64>) -> f64 {
        self.generator.maximum(self.without_disturbances(deviation, scratch))
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
