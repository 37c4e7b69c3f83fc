//! Isolation by a fitted ring: its class, its severity, and whether it is of any class.

use super::isolator::{Isolator, RingClassifier};
use super::judge::{Isolating, Isolation, Judge};
use super::tuned;
use super::workspace::Workspace;
use crate::isolate::alternatives::{Weighed, weigh};
use crate::isolate::appearance::UnknownSignal;
use crate::isolate::fault_curve::Conditions;
use crate::isolate::physics_density::FaultCurves;
use crate::isolate::tuned::any_ring;
use crate::model::ring_fit::{Fit, RingFitter};
use crate::verdict::Appearance;
use nalgebra::{Vector2, Vector4};

/// Whether a fit explains more than it would of noise alone. `noise`: of one sample, counts.
pub(super) fn is_ring(fit: &Fit, noise: f64) -> bool {
    fit.square - fit.misfit > tuned::noise_alone() * noise * noise
}

impl Judge {
    /// The fitter of rings for isolation, the phase free; `None`: the method fits none.
    pub fn rings(&self) -> Option<&RingFitter> {
        match &*self.isolating.as_ref()?.isolator {
            Isolator::Posterior(of) => Some(&of.fitter),
            _ => None,
        }
    }

    /// Corrects a signal, counts, to the reference drive and temperature.
    pub fn at_reference(&self, y: &mut [f64], drive: f64, warmer: f64) {
        let scale = 1.0 / drive;
        y.iter_mut().for_each(|y| *y *= scale);
        if let Some(response) = self.model.temperature_response.as_ref().filter(|_| warmer != 0.0) {
            y.iter_mut().zip(response).for_each(|(y, slope)| *y -= warmer * slope);
        }
    }

    /// [`Judge::isolate`] for a signal whose ring was fitted already. `fit`: to the signal per unit drive, at its
    /// own temperature; `signal`: writes that signal, counts. `None`: the method fits no rings.
    pub fn isolate_ring(
        &self,
        fit: Option<&Fit>,
        drive: f64,
        signal: impl FnOnce(&mut Vec<f64>),
        work: &mut Workspace,
    ) -> Option<Isolation> {
        work.forget();
        work.fit = fit.copied();
        let Isolating { isolator, rule, curves, physics_ring, quieter, .. } =
            self.isolating.as_ref()?;
        let Isolator::Posterior(classifier) = &**isolator else { return None };
        let RingClassifier { posterior, priors, .. } = &**classifier;
        let noise = self.model.noise_beside() / drive;
        let Some(fit) = fit.filter(|fit| is_ring(fit, noise)) else {
            return Some(Isolation::of_no_ring());
        };
        let warmer = work.warmer;
        work.misfit = fit.misfit / (noise * noise * self.model.expected.len() as f64);
        let Workspace { weights, of_any, alternative, ring, physics, own, ln_densities, .. } = work;
        let features = &classifier.features(fit, warmer);
        *ring = Some([features[1], features[2]]);
        let of_own = own.as_ref().and_then(|own| own.curves.as_ref().zip(Some(&own.baseline)));
        let curves = of_own.map(|(curves, _)| curves).or(curves.as_ref());
        let physics_ring = physics_ring.map(|ring| self.model.ring_from(&ring, warmer));
        let conditions = Conditions {
            // twice the noise is half the drive
            drive: drive * quieter,
            changed: curves.zip(physics_ring).map_or(Vector2::zeros(), |(c, r)| c.changed(r)),
            baseline: of_own.map(|(_, baseline)| baseline),
        };
        physics.ln_densities.clear();
        physics.ln_alternatives.clear();
        if let Some(curves) = curves {
            curves.compare(features, conditions, physics);
        }
        weights.clear();
        weights.resize(rule.category_of.len(), 0.0);
        let from_own = of_own.map(|(_, baseline)| Vector4::from(*features) - baseline);
        let of_own = posterior.of_own().zip(from_own.as_ref().map(Vector4::as_slice));
        let (posterior, place) = of_own.unwrap_or((posterior, features));
        posterior.weigh(place, &physics.ln_densities, priors, ln_densities, weights);
        let none = curves.map_or(any_ring(), |curves| curves.of_no_class());
        let Weighed { of_any: known, alternative: likely } =
            weigh(features, ln_densities, priors, (&physics.ln_alternatives, none));
        let decision = rule.decide(weights, known);
        *of_any = known;
        let best = weights.iter().copied().fold(0.0, f64::max) * known;
        let as_likely = likely.filter(|(_, p)| *p >= Appearance::AS_WELL * best);
        let twin = |of: &FaultCurves| {
            let class = usize::from(decision.candidate?);
            of.twin(&physics.ln_alternatives, *physics.ln_densities.get(class)?)
        };
        if let Some(curves) = curves
            && let Some(number) = as_likely.map(|(number, _)| number).or_else(|| twin(curves))
        {
            let x = from_own.unwrap_or(Vector4::from(*features));
            let frequency_hz = self.model.identification.poles.frequency_hz;
            let what = curves.alternative(number);
            *alternative = Some(what.appearance(x.as_slice(), frequency_hz));
        }
        let Some(best) = decision.candidate.map(usize::from) else { return Some(decision) };
        // the misfit beside the ring is at most that of the fit, which is known already
        let most = classifier.typical.as_ref().map_or(f64::INFINITY, |of| of.misfit[best]);
        if work.misfit > most {
            signal(&mut work.residual);
            let Workspace { residual, beside, .. } = work;
            classifier.beside_ring(residual, fit, &self.model, noise, beside);
            work.misfit = beside.iter().map(|v| v * v).sum::<f64>() / beside.len() as f64;
            if classifier.beyond_class(beside, fit, &self.model, noise, best) > most {
                work.weights.clear();
                work.alternative = None;
                return Some(Isolation::of_no_ring());
            }
        }
        if decision.is_uncertain() && known < tuned::of_none() {
            return Some(decision.of_unknown_fault());
        }
        let Workspace { weights, severity, physics, .. } = work;
        let sized = curves.zip(rule.sized(&decision, weights));
        *severity = sized.and_then(|(of, k)| of.severity(k, weights, physics));
        Some(decision)
    }

    /// Whether a flagged signal is no ring, where no classes are known. `y`: per unit drive, N, counts.
    pub fn is_no_ring(&self, y: &[f64], drive: f64, work: &mut Workspace) -> bool {
        let Some(detector) = &self.detector else { return false };
        let noise = self.model.noise_beside() / drive;
        let of_noise = y.len() as f64 * noise * noise;
        work.fit = detector.fitter().fit(y, true, &mut work.products);
        let explains =
            |fit: Fit| fit.misfit - of_noise <= tuned::most_left() * (fit.square - of_noise);
        !work.fit.is_some_and(|fit| is_ring(&fit, noise) && explains(fit))
    }

    /// A description of a signal that belongs to no class, after its isolation. `y`: per unit drive, N, counts.
    /// `None`: the method fits no rings.
    pub fn appearance(&self, y: &[f64], drive: f64, work: &mut Workspace) -> Option<Appearance> {
        let detector = self.detector.as_ref()?;
        let fitter = detector.fitter();
        let noise = self.model.noise_beside() / drive;
        let Workspace { products, fit, beside, .. } = work;
        // a fit of the same ring to the same signal
        let fit = fit.or_else(|| fitter.fit(y, true, products));
        if beside.is_empty() {
            let shape = &self.model.leftover;
            match &fit {
                Some(fit) => {
                    let of = detector.beside();
                    beside.extend(of.misfit_without(fitter, y, &fit.features, shape));
                }
                None => beside.extend(y),
            }
            beside.iter_mut().for_each(|v| *v /= noise);
        }
        let (ring, dt_s) = (fit.map(|fit| fit.features), self.model.generator.dt_s);
        Some(UnknownSignal { signal: y, noise, ring, misfit: beside, dt_s }.appearance())
    }
}
