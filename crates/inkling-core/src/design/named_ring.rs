//! Isolation by a fitted ring (`isolate.method` = `posterior`): the fault's class, its severity, and whether
//! the signal is of any class.
//!
//! In: a signal, and the ring fitted to it. Out: a decision, and in the [`Workspace`] the weights of the
//! classes, the severity and what else the signal may be. The steps: no ring, no class; the ring's features
//! are compared with the fault curves and with the learned densities; the classes are weighed against each
//! other, then all of them against what is no class; last the misfit beside the ring is compared with what is
//! usual in the best class.

use super::isolator::{Isolator, RingClassifier};
use super::judge::{Isolating, Isolation, Judge};
use super::workspace::Workspace;
use crate::isolate::alternatives::{Weighed, weigh};
use crate::isolate::appearance::UnknownSignal;
use crate::isolate::fault_curve::Conditions;
use crate::isolate::physics_density::FaultCurves;
use crate::isolate::tuned::no_class;
use crate::model::ring_fit::{Fit, RingFitter};
use crate::verdict::Appearance;
use nalgebra::{Vector2, Vector4};

/// A signal is said to be of no class if the probability of any class is below this, as a test at the usual 5 %
/// would. What may be a class's as well as, say, a stiffer actuator's is undecided between the two.
const OF_NONE: f64 = 0.05;

/// Whether a fit explains more of a signal than it would of noise alone. `noise`: standard deviation of one
/// sample, counts.
///
/// A damped cosine explains of noise alone what the largest of some hundred values of chi-squared with two
/// degrees of freedom is, one for each frequency: 2 ln(100 / p) is exceeded with probability p.
pub(super) fn is_ring(fit: &Fit, noise: f64) -> bool {
    /// 2 ln(100 / p) of noise that counts as a ring once in five million times.
    const NOISE_ALONE: f64 = 40.0;
    fit.square - fit.misfit > NOISE_ALONE * noise * noise
}

impl Judge {
    /// The fitter of rings for isolation, the phase free; `None`: the method of isolation fits no rings.
    pub fn rings(&self) -> Option<&RingFitter> {
        match &*self.isolating.as_ref()?.isolator {
            Isolator::Posterior(of) => Some(&of.rings.fitter),
            _ => None,
        }
    }

    /// Corrects a signal, counts, to the reference drive and temperature.
    pub fn at_reference(&self, y: &mut [f64], drive: f64, warmer: f64) {
        let scale = 1.0 / drive;
        y.iter_mut().for_each(|y| *y *= scale);
        self.model.warm(-warmer, y);
    }

    /// [`Judge::isolate`] for a signal whose ring was fitted already. `fit`: to the signal per unit drive, at
    /// its own temperature; `signal`: writes that signal, counts, and is only called if the misfit beside the
    /// ring is needed. `None`: the method fits no rings.
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

        // the noise of a signal per unit drive
        let noise = self.model.noise_beside() / drive;
        let Some(fit) = fit.filter(|fit| is_ring(fit, noise)) else {
            return Some(Isolation::of_no_ring());
        };

        let warmer = work.warmer;
        work.misfit = fit.misfit / (noise * noise * self.model.expected.len() as f64);
        let Workspace { weights, of_any, alternative, ring, physics, own, ln_densities, .. } = work;
        let features = &classifier.features(fit, warmer);
        *ring = Some([features[1], features[2]]);
        // Where the channel's own level is known, its features are compared with curves about that level.
        let of_own = own.as_ref().and_then(|own| own.curves.as_ref().zip(Some(&own.baseline)));
        let curves = of_own.map(|(curves, _)| curves).or(curves.as_ref());

        // The physics: densities of the features along the curves, at the signal's noise and the model's
        // present ring.
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
            curves.compare(features.as_slice(), conditions, physics);
        }

        // The posterior of the classes, from the learned densities and the physics. If densities about a
        // channel's own level were learned, they need the features counted from there.
        weights.clear();
        weights.resize(rule.naming.category_of.len(), 0.0);
        let from_own = of_own.map(|(_, baseline)| features - baseline);
        let of_own = posterior.of_own().zip(from_own.as_ref().map(Vector4::as_slice));
        let (posterior, place) = of_own.unwrap_or((posterior, features.as_slice()));
        posterior.weigh(place, &physics.ln_densities, priors, ln_densities, weights);

        // All classes together against the alternatives that are no class. `known`: the probability of any
        // class.
        let none = curves.map_or(no_class(), |curves| curves.of_no_class());
        let Weighed { of_any: known, alternative: likely } =
            weigh(features.as_slice(), ln_densities, priors, (&physics.ln_alternatives, none));
        let decision = rule.decide(weights, known);
        *of_any = known;

        // An alternative is told beside the best class if it is nearly as likely, or if it is a twin of the
        // class: about as dense by the physics, however rare it is a priori.
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

        // A signal that leaves more beside its ring than is usual in its best class is no ring of that class.
        // The misfit beside the ring is at most that of the fit, which is known already: only if that exceeds
        // the bound, the misfit is computed, first whole, then without what is usual in the class.
        let Some(best) = decision.candidate.map(usize::from) else { return Some(decision) };
        let most = classifier.typical.as_ref().map_or(f64::INFINITY, |of| of.misfit[best]);
        if work.misfit > most {
            signal(&mut work.residual);
            let Workspace { residual, beside, .. } = work;
            *beside = classifier.rings.misfit(residual, &fit.features);
            beside.iter_mut().for_each(|v| *v /= noise);
            work.misfit = beside.iter().map(|v| v * v).sum::<f64>() / beside.len() as f64;
            if classifier.misfit_beyond(beside, fit, &self.model, noise, best) > most {
                work.weights.clear();
                work.alternative = None;
                return Some(Isolation::of_no_ring());
            }
        }

        if decision.is_uncertain() && known < OF_NONE {
            return Some(decision.of_unknown_fault());
        }

        // the severity of the named class, or of the best one of the named category
        let Workspace { weights, severity, physics, .. } = work;
        let sized = curves.zip(rule.sized(&decision, weights));
        *severity = sized.and_then(|(of, k)| of.severity(k, weights, physics));
        Some(decision)
    }

    /// Whether a flagged signal is no ring, for designs without classes, where nothing is isolated. A ring is
    /// what a fit explains beyond noise, leaving no more than half of the energy that is not noise. `y`:
    /// the signal per unit drive, N, counts.
    pub fn is_no_ring(&self, y: &[f64], drive: f64, work: &mut Workspace) -> bool {
        let Some(detector) = &self.detector else { return false };
        let noise = self.model.noise_beside() / drive;
        let of_noise = y.len() as f64 * noise * noise;
        work.fit = detector.fitter().fit(y, true, &mut work.products);
        let explains = |fit: Fit| fit.misfit - of_noise <= 0.5 * (fit.square - of_noise);
        !work.fit.is_some_and(|fit| is_ring(&fit, noise) && explains(fit))
    }

    /// A description of a signal that belongs to no class, made after its isolation. `y`: the signal per unit
    /// drive, N, counts. `None`: the method of detection fits no rings.
    pub fn appearance(&self, y: &[f64], drive: f64, work: &mut Workspace) -> Option<Appearance> {
        let detector = self.detector.as_ref()?;
        let fitter = detector.fitter();
        let noise = self.model.noise_beside() / drive;
        let Workspace { products, fit, beside, .. } = work;
        // The fit of the isolation serves, which was one of the same ring to the same signal.
        let fit = fit.or_else(|| fitter.fit(y, true, products));
        // the misfit in standard deviations of the noise, if isolation has not computed it; of what is no
        // ring it is the whole signal
        if beside.is_empty() {
            match &fit {
                Some(fit) => *beside = detector.rings.misfit(y, &fit.features),
                None => beside.extend(y),
            }
            beside.iter_mut().for_each(|v| *v /= noise);
        }
        let (ring, dt_s) = (fit.map(|fit| fit.features), self.model.generator.dt_s);
        Some(UnknownSignal { signal: y, noise, ring, misfit: beside, dt_s }.appearance())
    }
}
