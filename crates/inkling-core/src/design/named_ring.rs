//! Isolation by a fitted ring (`isolate.method` = `posterior`): the fault's class, its severity,
//! and whether the signal is of any class.
//!
//! In, from the isolate stage (`pipeline/isolator.rs`) or [`Judge::isolate`]: a signal, and the
//! ring fitted to it. Out: an [`Isolation`], and further results in the [`Workspace`]. The steps of
//! [`Judge::isolate_ring`]:
//! 1. Without a ring that explains it the signal is of no class.
//! 2. The ring's features (ln amplitude, ln damping, ln frequency, phase) are compared with the
//!    fault curves of the physics and with the learned densities.
//! 3. The classes are weighed against each other by Bayes' rule, then all of them together against
//!    what is no class (another gain, clock or delay, a contrast of the physics, any ring).
//! 4. A signal that leaves more beside its ring than is usual in the best class is no ring of it.
//! 5. The severity of the named class, or of the candidate, is read off the class's fault curve.

use super::detector::is_ring;
use super::isolator::{Isolator, RingClassifier};
use super::judge::{Isolating, Judge};
use super::{Isolation, workspace::Workspace};
use crate::isolate::alternatives::{AlternativePosterior, weigh};
use crate::isolate::appearance::UnknownSignal;
use crate::isolate::fault_curve::Conditions;
use crate::isolate::physics_density::FaultCurves;
use crate::isolate::tuned::NO_CLASS;
use crate::model::ring_fit::{Fit, RingFitter};
use crate::verdict::Appearance;
use nalgebra::{Vector2, Vector4};

/// A signal of which nothing is named is said to be of no class if the probability of all classes
/// together is below this, as a test at the usual 5 % would. Above, it stays undecided.
const OF_NONE: f64 = 0.05;

impl Judge {
    /// The fitter of rings for isolation; `None`: the method of isolation fits no rings.
    pub fn rings(&self) -> Option<&RingFitter> {
        match &*self.isolating.as_ref()?.isolator {
            Isolator::Posterior(of) => Some(&of.rings.fitter),
            _ => None,
        }
    }

    /// Corrects a signal, N, counts, to the reference drive and temperature. `drive`: the signal's,
    /// relative; `warmer`: its temperature above the model's, K.
    pub fn at_reference(&self, y: &mut [f64], drive: f64, warmer: f64) {
        let scale = 1.0 / drive;
        y.iter_mut().for_each(|y| *y *= scale);
        self.model.warm(-warmer, y);
    }

    /// [`Judge::isolate`] for a fitted signal. `fit`: to the signal per unit drive, at its own
    /// temperature, the phase free; `signal`: writes that signal, N, counts, if the misfit beside
    /// the ring is needed. `None`: the method fits no rings.
    pub fn isolate_ring(
        &self,
        fit: Option<&Fit>,
        drive: f64,
        signal: impl FnOnce(&mut Vec<f64>),
        work: &mut Workspace,
    ) -> Option<Isolation> {
        work.forget();
        work.fit = fit.copied();
        let Isolating { isolator, rule, curves, physics_ring, noise_ratio, .. } =
            self.isolating.as_ref()?;
        let Isolator::Posterior(classifier) = &**isolator else { return None };
        let RingClassifier { posterior, priors, .. } = &**classifier;

        // Step 1. `noise`: standard deviation of one sample of the signal per unit drive.
        let noise = self.model.noise_beside() / drive;
        let Some(fit) = fit.filter(|fit| is_ring(fit, noise)) else {
            return Some(Isolation::of_no_ring());
        };

        let warmer = work.warmer;
        work.misfit = fit.misfit / (noise * noise * self.model.expected.len() as f64);
        let Workspace { weights, of_any, alternative, physics, own, ln_densities, .. } = work;
        let features = &classifier.features(fit, warmer);

        // Step 2: curves about the own channel's level, where it is known well; or any channel's.
        let of_own = own.as_ref().and_then(|own| own.curves.as_ref().zip(Some(&own.baseline)));
        let curves = of_own.map(|(curves, _)| curves).or(curves.as_ref());

        // `changed` moves the curves from the healthy ring of training to the model's present one
        let physics_ring = physics_ring.map(|ring| self.model.ring_from(&ring, warmer));
        let conditions = Conditions {
            // a signal with twice the noise is known as well as one with half the drive
            drive: drive * noise_ratio,
            changed: curves.zip(physics_ring).map_or(Vector2::zeros(), |(c, r)| c.changed(r)),
            baseline: of_own.map(|(_, baseline)| baseline),
        };
        physics.ln_densities.clear();
        physics.ln_alternatives.clear();
        if let Some(curves) = curves {
            curves.compare(features.as_slice(), conditions, physics);
        }

        // Step 3. Densities about a channel's own level go with features counted from that level.
        weights.clear();
        weights.resize(rule.category_of.len(), 0.0);
        let from_own = of_own.map(|(_, baseline)| features - baseline);
        let of_own = posterior.of_own.as_deref().zip(from_own.as_ref().map(Vector4::as_slice));
        let (posterior, place) = of_own.unwrap_or((posterior, features.as_slice()));
        posterior.weigh(place, &physics.ln_densities, priors, ln_densities, weights);

        // `none`: prior weight of what is no class; `known`: probability of all classes together
        let none = curves.map_or(NO_CLASS, |curves| curves.of_no_class());
        let AlternativePosterior { of_any: known, alternative: likely } =
            weigh(features.as_slice(), ln_densities, priors, (&physics.ln_alternatives, none));
        let decision = rule.decide(weights, known);
        *of_any = known;

        // An alternative is told beside the best class if its probability is at least the share
        // `AS_WELL` of the class's, or if it is a twin: its density by the physics is.
        let best = weights.iter().copied().fold(0.0, f64::max) * known;
        let as_likely = likely.filter(|(_, p)| *p >= Appearance::AS_WELL * best);
        let twin = |of: &FaultCurves| {
            let class = usize::from(decision.candidate?);
            of.twin(&physics.ln_alternatives, *physics.ln_densities.get(class)?)
        };
        if let Some(curves) = curves
            && let Some(number) = as_likely.map(|(number, _)| number).or_else(|| twin(curves))
        {
            let x = from_own.unwrap_or(*features);
            let frequency_hz = self.model.identification.poles.frequency_hz;
            let what = curves.alternative(number);
            *alternative = Some(what.appearance(x.as_slice(), frequency_hz));
        }

        // Step 4: the misfit beside the ring hardly exceeds that of the fit, so it is only computed
        // if the latter is beyond the bound: whole for the table, discounted for the decision.
        let Some(best) = decision.candidate.map(usize::from) else { return Some(decision) };
        if let Some(typical) = &classifier.typical
            && work.misfit > typical.misfit[best]
        {
            signal(&mut work.residual);
            let Workspace { residual, beside, .. } = work;
            *beside = classifier.rings.misfit(residual, &fit.features);
            beside.iter_mut().for_each(|v| *v /= noise);
            work.misfit = beside.iter().map(|v| v * v).sum::<f64>() / beside.len() as f64;
            // amplitude of this ring over the healthy one's, each in units of its own noise
            let size = fit.features.ln_amplitude.exp() * (self.model.noise_beside() / noise);
            if typical.misfit_of(beside, size, best) > typical.misfit[best] {
                work.drop_name();
                return Some(Isolation::of_no_ring());
            }
        }

        if decision.is_uncertain() && known < OF_NONE {
            return Some(decision.of_unknown_fault());
        }

        // Step 5: the severity of the named class, of the best of the named category, or of the candidate.
        let Workspace { weights, severity, physics, .. } = work;
        let sized = curves.zip(rule.sized(&decision, weights));
        *severity = sized.and_then(|(of, k)| of.severity(k, weights, physics));
        Some(decision)
    }

    /// Whether a flagged signal is no ring, for designs without classes: a fit explains no more of
    /// it than of noise, or leaves over half of what is not noise (somewhat arbitrary). `y`: per
    /// unit drive, N, counts. Keeps the fit in `work`.
    pub fn is_no_ring(&self, y: &[f64], drive: f64, work: &mut Workspace) -> bool {
        let Some(detector) = &self.detector else { return false };
        let noise = self.model.noise_beside() / drive;
        let of_noise = y.len() as f64 * noise * noise;
        work.fit = detector.fitter().fit(y, true, &mut work.products);
        let explains = |fit: Fit| fit.misfit - of_noise <= 0.5 * (fit.square - of_noise);
        !work.fit.is_some_and(|fit| is_ring(&fit, noise) && explains(fit))
    }

    /// Describes a signal of no class for an episode's sentence, by the fit and misfit in `work` of
    /// its isolation. `y`: per unit drive, N, counts. `None`: detection fits no rings.
    pub fn appearance(&self, y: &[f64], drive: f64, work: &mut Workspace) -> Option<Appearance> {
        let detector = self.detector.as_ref()?;
        let fitter = detector.fitter();
        let noise = self.model.noise_beside() / drive;
        let Workspace { products, fit, beside, .. } = work;
        let fit = fit.or_else(|| fitter.fit(y, true, products));
        // in standard deviations of the noise; a signal that no ring fits is all misfit
        if beside.is_empty() {
            match &fit {
                Some(fit) => *beside = detector.rings.misfit(y, &fit.features),
                None => beside.extend(y),
            }
            beside.iter_mut().for_each(|v| *v /= noise);
        }
        let (healthy, dt_s) = (&self.model.expected[..], self.model.generator.dt_s);
        Some(UnknownSignal { signal: y, noise, healthy, misfit: beside, dt_s }.appearance())
    }
}
