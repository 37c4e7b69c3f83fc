//! Models and judges adapted to a common change of all channels.
//!
//! In: a model as it was learned, and the change of ln amplitude, ln damping and ln frequency that all channels
//! share since ([`crate::identify::common_change`]). Out: the same model with its ring, expected signal and
//! sensitivities shifted by that. Thresholds, healthy covariances and fault classes stay.

use super::detector::{SensitivityDetector, ring_of};
use super::isolator::{Isolator, RingClassifier};
use super::lanes::Lanes;
use super::{HealthyModel, Judge, Workspace};
use crate::isolate::physics_density::FaultCurves;
use crate::model::beside_ring::BesideRing;
use crate::model::ring::Ring;
use crate::model::ring_fit::{Features, RingFitter};
use nalgebra::{Matrix3, Vector2, Vector3};
use std::sync::Arc;

/// How all channels move together. Rings begin before t_a, so that the phase at t_a turns with damping and frequency: by
/// the physics of the design's curves, where there are any.
#[derive(Clone, Debug)]
pub(super) struct Together {
    /// d phase / d ln damping and d ln frequency, rad.
    turn: Vector2<f64>,
    /// From features to first order, the phase held, to those of rings whose phase turns so.
    from_held: Matrix3<f64>,
}

impl Together {
    pub fn new(detector: &SensitivityDetector, turn: Vector2<f64>) -> Option<Together> {
        let held = detector.phase_held();
        let turned = held.column(3) * Vector3::new(0.0, turn[0], turn[1]).transpose();
        let from_held = (held.fixed_columns::<3>(0) + turned).try_inverse()?;
        Some(Together { turn, from_held })
    }

    /// By the physics, if that is known.
    pub fn of(detector: &SensitivityDetector, curves: Option<&FaultCurves>) -> Option<Together> {
        Together::new(detector, curves.map(FaultCurves::turn).unwrap_or_default())
    }

    /// The ring of a change. `by`: of ln amplitude, ln damping, ln frequency.
    fn there(&self, by: Vector3<f64>) -> Features {
        let [ln_amplitude, ln_damping, ln_frequency] = by.into();
        let phase_rad = self.turn.dot(&Vector2::new(ln_damping, ln_frequency));
        Features { ln_amplitude, ln_damping, ln_frequency, phase_rad }
    }
}

impl HealthyModel {
    /// The same model where all channels have moved alike; what is reported of it, parameters and filter,
    /// stays as it was learned. `None`: nothing rings there.
    fn moved(&self, there: &Features) -> Option<HealthyModel> {
        let ring = ring_of(&self.identification).ok()?;
        let fitter = RingFitter::new(ring, self.generator.dt_s, self.expected.len());
        let size = there.ln_amplitude.exp();
        let ring = Ring {
            amplitude: ring.amplitude * size,
            phase_rad: ring.phase_rad + there.phase_rad,
            damping_per_s: ring.damping_per_s * there.ln_damping.exp(),
            frequency_hz: ring.frequency_hz * there.ln_frequency.exp(),
            ..ring
        };
        let mut moved = self.clone();
        moved.identification.poles.damping_per_s = ring.damping_per_s;
        moved.identification.poles.frequency_hz = ring.frequency_hz;
        moved.identification.output_state = ring.output_state();
        let tangent = fitter.tangent(there);
        // a signal grows with ln A by itself
        moved.expected = tangent.column(0).iter().copied().collect();
        moved.leftover.iter_mut().for_each(|left| *left *= size);
        moved.expected.iter_mut().zip(&moved.leftover).for_each(|(y, left)| *y += left);
        moved.sensitivity = match &self.sensitivity {
            Some(of) => Some(of.moved(&tangent.columns(0, 3).into_owned())?),
            None => None,
        };
        Some(moved)
    }
}

impl Judge {
    /// The same where all channels have moved alike, as often as `moves` says. `by`: of ln amplitude, ln
    /// damping, ln frequency. `None`: it cannot follow.
    pub fn moved(&self, by: Vector3<f64>, moves: u32) -> Option<Judge> {
        let together = self.together.as_ref()?;
        let model = Arc::new(self.model.moved(&together.there(by))?);
        let (sensitivity, misfit) = (model.sensitivity.clone()?, model.misfit.as_ref());
        let detector = model.detector(sensitivity, misfit).ok()?;
        let together = Together::new(&detector, together.turn);
        let mut isolating = self.isolating.clone();
        if let Some(of) = &mut isolating {
            of.isolator = of.isolator.moved(&model)?;
        }
        Some(Judge {
            lanes: Lanes::of(&model),
            model,
            detector: Some(detector),
            together,
            spectrum: None,
            isolating,
            moves,
            index: self.index,
            reference_v: self.reference_v,
            extension: self.extension.clone(),
        })
    }

    /// Standard deviations of healthy features (ln amplitude, ln damping, ln frequency), noise included.
    /// `None`: what moves all channels cannot be seen by it, or is in an extension.
    pub fn healthy_sd(&self) -> Option<Vector3<f64>> {
        let of = self.model.sensitivity.as_ref().filter(|_| self.extension.is_none())?;
        let from_held = &self.together.as_ref()?.from_held;
        let covariance = from_held * of.healthy_covariance() * from_held.transpose();
        Some(covariance.diagonal().map(f64::sqrt))
    }

    /// ln amplitude, ln damping, ln frequency of a signal from the model's, as if it had moved with all others. `deviation`:
    /// from what is expected, counts. `None`: it has no sensitivities, or the signal holds more than a ring.
    pub fn features(
        &self,
        deviation: &[f64],
        drive: f64,
        work: &mut Workspace,
    ) -> Option<Vector3<f64>> {
        let of = self.model.sensitivity.as_ref()?;
        let detector = self.detector.as_ref()?;
        let features = detector.features_of_ring(deviation, drive, &mut work.residual)?;
        Some(self.together.as_ref()?.from_held * (features - Vector3::from(of.mean)))
    }
}

impl HealthyModel {
    /// ln amplitude, ln damping, ln frequency of its ring from another model's, as if both had been learned at one
    /// temperature. `None`: one of them does not ring.
    pub fn features_from(&self, other: &HealthyModel) -> Option<Vector3<f64>> {
        let [here, there] = [self, other].map(|model| ring_of(&model.identification).ok());
        let (here, there) = (here?, there?);
        let warmer = match (self.temperature_c, other.temperature_c) {
            (Some(here), Some(there)) => here - there,
            _ => 0.0,
        };
        let fitter = RingFitter::new(there, other.generator.dt_s, other.expected.len());
        let per_k = other.features_per_k(&fitter);
        let ratios = [
            here.amplitude / there.amplitude,
            here.damping_per_s / there.damping_per_s,
            here.frequency_hz / there.frequency_hz,
        ];
        Some(Vector3::from_fn(|k, _| ratios[k].ln() - warmer * per_k[k]))
    }
}

impl Isolator {
    /// The same classes relative to a model that was shifted. `None`: it does not ring.
    fn moved(self: &Arc<Isolator>, model: &HealthyModel) -> Option<Arc<Isolator>> {
        // methods that compare deviations need no change
        let Isolator::Posterior(of) = &**self else { return Some(self.clone()) };
        let (ring, dt_s) = (ring_of(&model.identification).ok()?, model.generator.dt_s);
        let samples = model.expected.len();
        let fitter = RingFitter::new(ring, dt_s, samples);
        Some(Arc::new(Isolator::Posterior(Box::new(RingClassifier {
            per_k: model.features_per_k(&fitter),
            fitter,
            beside: BesideRing::new(&ring, dt_s, samples),
            posterior: of.posterior.clone(),
            priors: of.priors.clone(),
            typical: of.typical.clone(),
        }))))
    }
}
