//! The ring of a signal as verdicts state it: resonance and damping (columns `resonance_hz` and
//! `damping_per_s`), whether there is a design or not.
//!
//! In, from the isolate stage (`pipeline/isolator.rs`): a signal that was judged. Out: resonance, Hz,
//! and damping, 1/s, of a ring fitted to it (flagged signals, and where the closed form fails), or
//! in closed form from its deviation (other signals, where `output.ring` asks for them).

use super::detector::is_ring;
use super::judge::Judge;
use super::workspace::Workspace;
use crate::model::ring_fit::RingFitter;
use nalgebra::Vector4;

impl Judge {
    /// Resonance, Hz, and damping, 1/s, of the ring fitted to a signal, in its isolation or now.
    /// `signal`: writes it per unit drive, N, counts. `None`: it does not ring.
    pub fn ring_of(
        &self,
        signal: impl FnOnce(&mut Vec<f64>),
        drive: f64,
        work: &mut Workspace,
    ) -> Option<[f64; 2]> {
        let fitter = self.fitter()?;
        let fit = work.fit.or_else(|| {
            let mut y = std::mem::take(&mut work.residual);
            signal(&mut y);
            let fit = fitter.fit(&y, true, &mut work.products);
            work.residual = y;
            fit
        });
        let noise = self.model.noise_beside() / drive;
        fit.filter(|fit| is_ring(fit, noise)).map(|fit| fitter.frequency_and_damping(&fit.features))
    }

    /// Resonance, Hz, and damping, 1/s, at which a healthy signal would ring at `warmer` K above the model's temperature:
    /// that of the channel where its own level is known, `own` (features relative to the model's ring), else of all.
    pub fn healthy_ring(&self, warmer: f64, own: Option<Vector4<f64>>) -> [f64; 2] {
        let (poles, model) = (self.model.identification.poles, &self.model);
        let own = own.unwrap_or_default();
        [
            poles.frequency_hz * (own[2] + warmer * model.frequency_per_k).exp(),
            poles.damping_per_s * (own[1] + warmer * model.damping_per_k).exp(),
        ]
    }

    /// The same of a signal in closed form, to second order. `deviation`: at the signal's drive and temperature,
    /// N, counts. `None`: detection knows no sensitivities, or the result is not finite.
    pub fn ring_in_closed_form(
        &self,
        deviation: &[f64],
        drive: f64,
        warmer: f64,
    ) -> Option<[f64; 2]> {
        let features = self.detector.as_ref()?.own_features(deviation, drive);
        // they are relative to the model's ring at the signal's temperature
        let ring = self.healthy_ring(warmer, Some(features));
        ring.iter().all(|v| v.is_finite()).then_some(ring)
    }

    /// Isolation's, detection's, or one that is made now and kept. `None`: the model does not ring.
    fn fitter(&self) -> Option<&RingFitter> {
        let of_methods = self.rings().or_else(|| self.detector.as_ref().map(|of| of.fitter()));
        of_methods.or_else(|| self.own_fitter.get_or_init(|| self.model.fitter().ok()).as_ref())
    }
}
