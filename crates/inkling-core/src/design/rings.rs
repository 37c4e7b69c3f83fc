//! Rings about a model's own ring: fits of rings to signals, and what signals hold beside them.
//!
//! In: a healthy model, and signals of its printhead. Out: a fitter of rings whose features (ln
//! amplitude, ln damping, ln frequency, phase) are relative to the model's ring; the features of
//! each signal that a ring fits; and a signal's misfit beside its ring.

use super::{HealthyModel, Result};
use crate::identify::SignalSet;
use crate::identify::grey_box::Identification;
use crate::model::beside_ring::BesideRing;
use crate::model::ring::Ring;
use crate::model::ring_fit::{Features, FitBuffers, RingFitter};
use nalgebra::Vector4;

#[derive(Clone, Debug)]
pub(super) struct Rings {
    pub fitter: RingFitter,
    pub beside: BesideRing,
    /// The part of every healthy signal beside its ring, N, counts; empty: there is none.
    pub leftover: Vec<f64>,
}

impl Rings {
    /// The misfit of a signal beside its ring, N, counts per unit drive, without the leftover. `y`:
    /// the signal per unit drive, N, counts; `at`: the features of its fitted ring.
    pub fn misfit(&self, y: &[f64], at: &Features) -> Vec<f64> {
        let mut misfit = self.beside.misfit(&self.fitter, y, at);
        let amplitude = at.ln_amplitude.exp();
        misfit.iter_mut().zip(&self.leftover).for_each(|(m, shape)| *m -= amplitude * shape);
        misfit
    }
}

impl HealthyModel {
    /// An error if the model does not oscillate.
    pub(super) fn ring(&self) -> Result<Ring> {
        let Identification { poles, output_state, .. } = self.identification;
        Ok(Ring::new(poles, output_state).ok_or("the identified model does not ring")?)
    }

    pub(super) fn fitter(&self) -> Result<RingFitter> {
        Ok(RingFitter::new(self.ring()?, self.generator.dt_s, self.expected.len()))
    }

    pub(super) fn rings(&self) -> Result<Rings> {
        let beside = BesideRing::new(&self.ring()?, self.generator.dt_s, self.expected.len());
        Ok(Rings { fitter: self.fitter()?, beside, leftover: self.leftover.clone() })
    }

    /// Index and features of every signal of a set that a ring fits (the phase free), corrected to
    /// the model's temperature. The ring is fitted at the signal's own temperature, since
    /// temperature shifts features alike, and signals not.
    pub(super) fn fitted(&self, set: &SignalSet) -> Result<Vec<(usize, Vector4<f64>)>> {
        let fitter = self.fitter()?;
        let per_k = self.features_per_k(&fitter);
        let (mut signal, mut columns) = (Vec::new(), FitBuffers::default());
        let mut found = Vec::new();
        self.each_deviation(set, |i, deviation, drive| {
            let warmer = self.warmer(set.temperature_c[i]);
            self.per_drive(deviation, drive, warmer, &mut signal);
            if let Some(fit) = fitter.fit(&signal, true, &mut columns) {
                found.push((i, fit.features.coordinates() - warmer * per_k));
            }
        });
        Ok(found)
    }
}
