//! Fits ring-downs to a printhead's signals, and says what a ring does not explain of them.
//!
//! In: a healthy model, and signals of its printhead. Out: a fitter whose features (ln amplitude, ln damping, ln
//! frequency, phase in rad) are relative to the model's ring; the features of each signal that can be fitted, the
//! others are left out; and a signal's *misfit*: the signal less its ring and less what all healthy signals have
//! beside theirs (the *leftover*).

use super::{HealthyModel, Result};
use crate::identify::SignalSet;
use crate::identify::grey_box::Identification;
use crate::model::beside_ring::BesideRing;
use crate::model::ring::Ring;
use crate::model::ring_fit::{Features, FitBuffers, RingFitter};
use nalgebra::Vector4;

/// What fits rings to signals and takes them off.
#[derive(Clone, Debug)]
pub(super) struct Rings {
    pub fitter: RingFitter,
    pub beside: BesideRing,
    /// The mean misfit of healthy signals, N, counts per unit drive at the amplitude of the model's ring; empty: none is
    /// known.
    pub leftover: Vec<f64>,
}

impl Rings {
    /// The misfit of a signal, N, counts per unit drive, without the leftover, which grows with the ring. `y`: the
    /// signal per unit drive, N, counts; `at`: the features of its fitted ring, relative to the model's.
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

    /// Index and features (ln amplitude, ln damping, ln frequency, phase) of every signal of a set that can be fitted
    /// (`true`: with its phase free), corrected to the model's temperature. A kelvin shifts the features of all signals
    /// by the same amount, but not their samples. So the ring is fitted to the signal at its own temperature, which
    /// `per_drive` gives back to the deviation, and the features are corrected.
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
