//! A model's residual, with disturbances decoupled, and its metrics.

use super::detector::ring_of;
use super::{DesignError, HealthyModel};
use crate::detect::decoupling::{Disturbance, KnownShapes};
use crate::model::ring_fit::{Features, RingFitter};

/// The FD filter, disturbances decoupled.
impl HealthyModel {
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

    /// A deviation without the disturbances that `detect.decouple` names. `scratch`: for it.
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

    /// e(r) of the FD filter, disturbances decoupled, counts²·s.
    pub fn residual_energy(&self, deviation: &[f64], scratch: &mut Vec<f64>) -> f64 {
        self.generator.energy(self.without_disturbances(deviation, scratch))
    }

    /// The largest |r|, counts.
    pub fn residual_maximum(&self, deviation: &[f64], scratch: &mut Vec<f64>) -> f64 {
        self.generator.maximum(self.without_disturbances(deviation, scratch))
    }

    /// r of the FD filter, disturbances decoupled, counts.
    pub fn residual(&self, deviation: &[f64], residual: &mut [f64]) {
        let mut scratch = Vec::new();
        self.generator.filter(self.without_disturbances(deviation, &mut scratch), residual);
    }

    /// F' x of r = F d, disturbances decoupled.
    pub fn adjoint(&self, column: &[f64]) -> Vec<f64> {
        let mut x = self.generator.adjoint(column);
        if let Some(decoupled) = &self.decoupled {
            decoupled.take_off_transposed(&mut x);
        }
        x
    }
}
