//! Models and judges moved to where a printhead's channels are now (ink warms up, a supply sags).
//!
//! In, from `pipeline/moved_judge.rs`: a judge with its model as it was learned, the *change*:
//! how far ln amplitude, ln damping, ln frequency and phase of all channels have moved since, as
//! [`crate::state`] follows them, and the recorded temperature. Out: a judge whose model has ring, expected signal and
//! sensitivities shifted by the change and to the temperature. Thresholds, healthy covariances and fault classes stay.
//!
//! The temperature response of a model is a line, added to every signal alike. Of a channel that rings otherwise than
//! the model does it says too little: 7 K off the reference, where frequency has moved by .8 %, a channel whose
//! frequency lies .7 % beside the others' seems to be damped 3 % more. A model that is moved to the temperature reads
//! such a channel rightly; and as it moves logarithms, it is right farther out where temperature acts exponentially, as
//! it does on viscosity.
//!
//! Also the way back: a signal's features relative to the healthy mean, from which the state
//! estimates the change ([`Judge::features`]), and what it must know of a judge ([`Judge::kind`]).

use super::detector::SensitivityDetector;
use super::isolator::{Isolator, RingClassifier};
use super::tuned;
use super::{HealthyModel, Judge, Workspace};
use crate::model::ring::Ring;
use crate::model::ring_fit::Features;
use crate::state::{Features as Change, Kind};
use nalgebra::Matrix4;
use std::f64::consts::TAU;
use std::sync::{Arc, OnceLock};

impl HealthyModel {
    /// The same model after a common change of all channels, at `warmer` K above its reference temperature; the
    /// identified channel and the filter stay as they were learned. `None`: nothing rings there, or its sensitivities
    /// are dependent.
    fn moved(&self, by: Change, warmer: f64) -> Option<HealthyModel> {
        let (ring, fitter) = (self.ring().ok()?, self.fitter().ok()?);
        let per_k = self.features_per_k(&fitter);
        let there = Features::from(by + warmer * per_k);
        let size = there.ln_amplitude.exp();
        // A gain enlarges noise, and what rings leave, by as much as the rings. A larger drive that was not recorded does
        // not: there the test becomes somewhat less sensitive. Of a quieter head the noise may be as it was.
        let louder = size.max(1.0);

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

        // The expected signal is the moved ring (the first sensitivity, by ln amplitude) plus the
        // leftover, which grows with the ring's amplitude.
        let tangent = fitter.tangent(&there);
        moved.expected = tangent.column(0).iter().copied().collect();
        moved.leftover.iter_mut().for_each(|left| *left *= size);
        moved.expected.iter_mut().zip(&moved.leftover).for_each(|(y, left)| *y += left);
        moved.sensitivity = match &self.sensitivity {
            Some(of) => Some(of.moved(&tangent.columns(0, 3).into_owned(), louder)?),
            None => None,
        };

        moved.misfit = moved.misfit.map(|of| of.louder(louder));

        // what temperature does to the ring it does from there on; what it does beside the ring stays
        if let Some(response) = &mut moved.temperature_response {
            let there = tangent * per_k;
            for (k, beside) in self.beside_per_k(&fitter).into_iter().enumerate() {
                moved.expected[k] += warmer * beside;
                response[k] = there[k] + beside;
            }
            moved.moved_k = warmer;
        }
        Some(moved)
    }

    /// Amplitude in counts, damping in 1/s, frequency in Hz and phase in rad of the model's ring.
    pub fn ring_numbers(&self) -> Option<[f64; 4]> {
        let ring = self.ring().ok()?;
        Some([ring.amplitude, ring.damping_per_s, ring.frequency_hz, ring.phase_rad])
    }

    /// The features of this model's ring relative to another's, corrected to the same temperature.
    pub fn features_from(&self, other: &HealthyModel) -> Option<Change> {
        let from = ring_from(self.ring_numbers()?, other.ring_numbers()?);
        let warmer = match (self.temperature_c, other.temperature_c) {
            (Some(here), Some(there)) => here - there,
            _ => 0.0,
        };
        let per_k = other.features_per_k(&other.fitter().ok()?);
        Some(from - warmer * per_k)
    }
}

impl Judge {
    /// `self` is not a moved judge; `warmer`: K above its model's reference temperature; `moves`: number of moves over
    /// all judges of the run, this one included. `None`: the method knows no sensitivities or nothing rings there.
    pub fn moved(&self, by: Change, warmer: f64, moves: u32) -> Option<Judge> {
        let model = Arc::new(self.model.moved(by, warmer)?);
        let (sensitivity, misfit) = (model.sensitivity.clone()?, model.misfit.as_ref());
        let detector = SensitivityDetector::new(&model, sensitivity, misfit).ok()?;
        let mut isolating = self.isolating.clone();
        if let Some(of) = &mut isolating {
            of.isolator = of.isolator.moved(&model)?;
        }
        Some(Judge {
            lanes: model.lanes(),
            model,
            detector: Some(detector),
            own_fitter: OnceLock::new(),
            isolating,
            moves,
            index: self.index,
            reference_v: self.reference_v,
            extension: self.extension.clone(),
        })
    }

    /// Change of the features of its model's ring per K; 0: not known.
    pub fn features_per_k(&self) -> Change {
        let fitter = self.model.fitter().ok();
        fitter.map(|fitter| self.model.features_per_k(&fitter)).unwrap_or_default()
    }

    /// Standard deviations of healthy signals' features, noise included. `None`: a change cannot be
    /// followed, without sensitivities or with an extension, which already holds such changes.
    pub fn healthy_sd(&self) -> Option<Change> {
        let detector = self.detector.as_ref().filter(|_| self.extension.is_none())?;
        Some(detector.healthy_sd())
    }

    /// What [`crate::state`] must know of a judge. `bounds`: largest relative change of damping and
    /// of frequency. `None`: as [`Judge::healthy_sd`], or the covariances are degenerate.
    pub fn kind(&self, bounds: [f64; 2]) -> Option<Kind> {
        let detector = self.detector.as_ref().filter(|_| self.extension.is_none())?;
        let [damping, frequency] = bounds.map(f64::ln_1p);
        let units = Change::new(1.0, damping, frequency, 1.0);
        let sds = units.component_mul(&Change::from(tuned::LEAP));
        let leap = Matrix4::from_diagonal(&sds.map(|sd| sd * sd));
        let mut kind = Kind::new(detector.own_noise(), &detector.healthy_spread(), &leap)?;
        kind.per_k = kind.covariance(&self.model.channels_per_k.unwrap_or_default().into());
        Some(kind)
    }

    /// The mean of healthy signals' features from the model's ring.
    pub fn healthy_mean(&self) -> Option<Change> {
        let [ln_amplitude, ln_damping, ln_frequency] = self.model.sensitivity.as_ref()?.mean;
        Some(Change::new(ln_amplitude, ln_damping, ln_frequency, 0.0))
    }

    /// Features of a signal relative to the healthy mean. `warmer`: K above the model's temperature; `far`: whether a fit
    /// may be made. `None`: no sensitivities, the signal holds more than a ring, or only a fit would tell.
    pub fn features(
        &self,
        deviation: &[f64],
        (drive, warmer): (f64, f64),
        far: bool,
        work: &mut Workspace,
    ) -> Option<Change> {
        let detector = self.detector.as_ref()?;
        let features =
            detector.features_of_ring(deviation, (drive, warmer), far, &mut work.residual)?;
        Some(features - self.healthy_mean()?)
    }
}

/// The features of the ring `of` relative to the ring `from`, both as
/// [`HealthyModel::ring_numbers`]; the phase difference is wrapped into -pi .. pi.
pub fn ring_from(of: [f64; 4], from: [f64; 4]) -> Change {
    let turned = of[3] - from[3];
    Change::new(
        (of[0] / from[0]).ln(),
        (of[1] / from[1]).ln(),
        (of[2] / from[2]).ln(),
        turned - TAU * (turned / TAU).round(),
    )
}

impl Isolator {
    /// For a model that was moved: features are counted from the moved ring, their densities stay.
    fn moved(self: &Arc<Isolator>, model: &HealthyModel) -> Option<Arc<Isolator>> {
        // The other methods compare deviations from the expected signal and need no change.
        let Isolator::Posterior(of) = &**self else { return Some(self.clone()) };
        let rings = model.rings().ok()?;
        Some(Arc::new(Isolator::Posterior(Box::new(RingClassifier {
            per_k: model.features_per_k(&rings.fitter),
            rings,
            posterior: of.posterior.clone(),
            priors: of.priors.clone(),
            typical: of.typical.clone(),
        }))))
    }
}
