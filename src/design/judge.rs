//! The judge: a healthy model and the fault classes, made ready to judge signals. Every batch carries the one that
//! its signals are judged by.

use super::detector::{Detection, Scratch, SensitivityDetector, ring_of};
use super::lanes::Lanes;
use super::own_channel::Own;
use super::{Design, DesignError, Extension, FaultModel, HealthyModel, IsolateSettings, Statistic};
use crate::burst::Burst;
use crate::detect::key_numbers::Spectrum;
use crate::identify::reservoir::relative_drive;
use crate::isolate::appearance::UnknownSignal;
use crate::isolate::fault_curve::Conditions;
use crate::isolate::neighbours::Neighbours;
use crate::isolate::physics_density::{Comparison, FaultCurves};
use crate::isolate::posterior::Posterior;
use crate::isolate::severity::Severity;
use crate::isolate::typical::{RingMisfit, Typical};
use crate::isolate::{
    Decision, DecisionRule, IsolateMethod, IsolateSignal, MAX_CLASSES, SignatureMatrix, Simplex,
    model_matching,
};
use crate::model::beside_ring::BesideRing;
use crate::model::ring::Ring;
use crate::model::ring_fit::{Fit, Products, RingFitter};
use crate::verdict::{Appearance, Test};
use nalgebra::Vector2;
use std::sync::Arc;

/// The result of a signal's detection, as it is written.
#[derive(Clone, Copy, Debug)]
pub struct Tested {
    pub test: Test,
    pub statistic: f64,
    pub threshold: f64,
    /// The misfit over the healthy mean ([`crate::detect::misfit`]); NaN: not known.
    pub misfit: f64,
}

impl Tested {
    /// e <= threshold is healthy, thesis f after (3-4).
    pub fn is_flagged(&self) -> bool {
        self.statistic > self.threshold
    }
}

/// Identifies a judge within a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct JudgeKey {
    index: u16,
    moves: u32,
}

/// Judges signals by one model. Built once per model, shared by all workers.
#[derive(Debug)]
pub struct Judge {
    /// Its place in the metadata's `models`.
    pub index: u16,
    /// How often it was adapted to a common change, see [`Judge::moved`].
    pub(super) moves: u32,
    pub model: HealthyModel,
    pub reference_v: Option<f64>,
    /// Detection of many signals at once, in f32; without it [`Judge::detect`] judges each signal.
    pub lanes: Option<Lanes>,
    /// What a critique found missing in the model: subtracted from every signal first.
    pub(super) extension: Option<Extension>,
    /// With `detect.method` = `sensitivity`.
    pub(super) detector: Option<SensitivityDetector>,
    /// With `detect.method` = `practice`.
    pub(super) spectrum: Option<Spectrum>,
    pub(super) isolating: Option<Isolating>,
}

#[derive(Clone, Debug)]
pub(super) struct Isolating {
    pub(super) isolator: Arc<Isolator>,
    signal: IsolateSignal,
    rule: DecisionRule,
    /// With `isolate.method` = `posterior`.
    curves: Option<Arc<FaultCurves>>,
    /// The healthy ring that the curves were made for.
    physics_ring: Option<Ring>,
}

/// Isolation by a fitted ring's features.
#[derive(Debug)]
pub(super) struct RingClassifier {
    pub(super) posterior: Arc<Posterior>,
    pub(super) fitter: RingFitter,
    /// Of each class.
    pub(super) priors: Vec<f64>,
    /// How healthy features change with temperature, per K.
    pub(super) per_k: [f64; 4],
    pub(super) beside: BesideRing,
    pub(super) typical: Option<Arc<Typical>>,
}

/// `isolate.method`, ready for this model.
#[derive(Debug)]
pub(super) enum Isolator {
    /// Posterior of the classes from a fitted ring's features.
    Posterior(Box<RingClassifier>),
    /// thesis §3-3-2: F^T R with the filter r = F d, so that (F^T R)^T d = R^T r.
    ResidualMatching(SignatureMatrix, Simplex),
    /// thesis §3-3-1: per class its identified model, if it has one.
    ModelMatching(Vec<Option<FaultModel>>),
    /// thesis §4-3-1
    Neighbours(Neighbours),
}

/// A fit to noise alone explains less than this, in noise variances: two linear and two searched parameters
/// explain some 20 at most.
const NOISE_ALONE: f64 = 40.0;

/// Whether a fit explains more than it would of noise alone. `noise`: of one sample, counts.
fn is_ring(fit: &Fit, noise: f64) -> bool {
    fit.square - fit.misfit > NOISE_ALONE * noise * noise
}

/// A signal is no ring if its fit leaves more than this share of its energy, noise apart: a half, not tuned.
const MOST_LEFT: f64 = 0.5;

/// Where the best class is rejected as not typical, classes of less weight than this are not considered either.
const LITTLE: f64 = 0.05;

/// The result of a signal's isolation.
pub type Isolation = Decision;

/// Buffers of a judge, one set per thread, and results beside the decision.
#[derive(Debug, Default)]
pub struct Workspace {
    residual: Vec<f64>,
    projection: Vec<f64>,
    products: Products,
    detector: Scratch,
    /// Weight of each class, for the signal last isolated.
    pub weights: Vec<f64>,
    /// ln damping and ln frequency of the ring last fitted for isolation, relative to the healthy model's and
    /// corrected to its temperature; `None`: none was fitted.
    pub ring: Option<[f64; 2]>,
    /// Severity of the signal last isolated, if its category was named.
    pub severity: Option<Severity>,
    /// Its mean square misfit over the noise's; NaN: no ring was fitted.
    pub misfit: f64,
    ln_densities: Vec<f64>,
    physics: Comparison,
    /// To be set for the signal isolated next: [`Judge::warmer`], K.
    pub warmer: f64,
    /// To be set for the signal judged next, with `--baseline`: its channel's baseline, if there is one.
    pub own: Option<Own>,
}

impl Judge {
    /// `design`: its fault classes, if there is one; without, whatever passes stays undecided.
    /// `reference_v`: the drive voltage at which the model expects its signals.
    pub fn new(
        index: u16,
        model: HealthyModel,
        reference_v: Option<f64>,
        design: Option<&Design>,
        settings: &IsolateSettings,
    ) -> Result<Judge, DesignError> {
        let isolating = match design {
            Some(design) if !design.classes.is_empty() => Some(Isolating {
                isolator: Arc::new(Isolator::new(&model, design, settings)?),
                signal: settings.signal,
                rule: DecisionRule::new(&design.class_names(), settings.certainty)?,
                physics_ring: design.physics.as_ref().map(|physics| physics.ring),
                curves: match settings.method {
                    IsolateMethod::Posterior => design.curves(),
                    _ => None,
                },
            }),
            _ => None,
        };
        let detector = match &model.sensitivity {
            None => None,
            Some(sensitivity) => {
                let misfit = model.misfit.as_ref();
                Some(model.detector(sensitivity.clone(), misfit)?)
            }
        };
        let extension = design.and_then(|design| design.extension.clone());
        // detection in lanes expects one shape per burst; with an extension each signal has its own
        let lanes = if extension.is_none() { Lanes::of(&model) } else { None };
        let spectrum = match model.statistic {
            Some(Statistic::Practice(_)) => {
                Some(Spectrum::new(model.expected.len(), model.generator.dt_s))
            }
            _ => None,
        };
        Ok(Judge {
            index,
            moves: 0,
            reference_v,
            model,
            lanes,
            extension,
            detector,
            spectrum,
            isolating,
        })
    }

    pub fn key(&self) -> JudgeKey {
        JudgeKey { index: self.index, moves: self.moves }
    }

    /// Relative drive of a burst: its drive voltage over the reference, the scale of its expected signal.
    pub fn drive(&self, burst: &Burst) -> f64 {
        relative_drive(burst.drive_voltage_v.unwrap_or(f64::NAN), self.reference_v)
    }

    /// Temperature of a burst above the model's, K; 0 where it is unknown or has no effect.
    pub fn warmer(&self, burst: &Burst) -> f64 {
        self.model.warmer(burst.temperature_c.unwrap_or(f64::NAN))
    }

    /// Turns a signal of a burst, as acquired, into its deviation from `expected` (of that burst); counts.
    pub fn deviate(&self, burst: &Burst, row: usize, expected: &[f64], signal: &mut [f64]) {
        self.take_off_extension(burst, row, signal);
        signal.iter_mut().zip(expected).for_each(|(y, e)| *y -= e);
    }

    /// Subtracts what a critique found missing in the model from a signal of a burst, counts.
    pub fn take_off_extension(&self, burst: &Burst, row: usize, signal: &mut [f64]) {
        if let Some(extension) = &self.extension {
            extension.take_off(burst, row, self.reference_v, signal);
        }
    }

    /// The expected signal y_hat of a burst, N, counts.
    pub fn expect(&self, burst: &Burst, out: &mut [f64]) {
        self.model.expect(self.drive(burst), burst.temperature_c.unwrap_or(f64::NAN), out);
    }

    /// The detection statistics of a signal. `deviation`: from the expected signal, N, counts; `drive`: relative.
    pub fn detect(&self, deviation: &[f64], drive: f64, work: &mut Workspace) -> Detection {
        let Some(detector) = &self.detector else {
            let ring = self.of_residual(deviation, drive, &mut work.residual);
            return Detection { ring, unexplained: f64::NAN };
        };
        match &work.own {
            None => detector.detect(deviation, drive, &mut work.detector),
            Some(own) => {
                let distance = detector.statistic_of_own(deviation, drive, own, &mut work.detector);
                let ring = distance * (self.model.threshold.value / own.gate).min(1.0);
                Detection { ring, unexplained: f64::NAN }
            }
        }
    }

    /// The statistic of all methods but `sensitivity`. `signal`: buffer.
    fn of_residual(&self, deviation: &[f64], drive: f64, signal: &mut Vec<f64>) -> f64 {
        let HealthyModel { expected, statistic, .. } = &self.model;
        match (statistic, &self.spectrum) {
            (Some(Statistic::Practice(range)), Some(spectrum)) => {
                signal.clear();
                signal.extend(expected.iter().zip(deviation).map(|(e, d)| e + d / drive));
                range.distance(&spectrum.key_numbers(signal))
            }
            (Some(Statistic::ResidualMaximum), _) => self.model.residual_maximum(deviation, signal),
            _ => self.model.residual_energy(deviation, signal),
        }
    }

    /// Whether a signal fails the first test, along the ring.
    pub fn is_faulty_ring(&self, detection: Detection) -> bool {
        self.model.threshold.is_faulty(detection.ring)
    }

    /// The test whose statistic is larger relative to its threshold.
    pub fn test(&self, detection: Detection) -> Tested {
        let Detection { ring, unexplained } = detection;
        let threshold = self.model.threshold.value;
        let along = match (&self.detector, &self.spectrum) {
            (None, None) => Test::Energy,
            _ => Test::Ring,
        };
        let of_ring = Tested { test: along, statistic: ring, threshold, misfit: f64::NAN };
        let Some(misfit) = &self.model.misfit else { return of_ring };
        let (statistic, relative) = (misfit.statistic(unexplained), misfit.relative(unexplained));
        let beside = misfit.threshold.value;
        // false for NaN
        match statistic * threshold > ring * beside {
            true => Tested { test: Test::Misfit, statistic, threshold: beside, misfit: relative },
            false => Tested { misfit: relative, ..of_ring },
        }
    }

    /// With `detect.method` = `sensitivity`; computes the features that channels' baselines consist of.
    pub fn detector(&self) -> Option<&SensitivityDetector> {
        self.detector.as_ref()
    }

    pub fn can_isolate(&self) -> bool {
        self.isolating.is_some()
    }

    /// Isolates the fault of a signal, thesis §3-3. `deviation`: from the expected signal, N, counts; `drive`:
    /// relative, which scales the classes' deviations as it scales the signal. `None`: no class fits.
    pub fn isolate(
        &self,
        deviation: &[f64],
        drive: f64,
        work: &mut Workspace,
    ) -> Option<Isolation> {
        let Isolating { isolator, signal, rule, .. } = self.isolating.as_ref()?;
        if let Isolator::Posterior(classifier) = &**isolator {
            let fitter = &classifier.fitter;
            // the signal itself, scaled to the reference drive
            self.model.per_drive(deviation, drive, work.warmer, &mut work.residual);
            let signal = std::mem::take(&mut work.residual);
            let fit = fitter.fit(&signal, true, &mut work.products);
            let copy = |y: &mut Vec<f64>| y.clone_from(&signal);
            let isolation = self.isolate_ring(fit.as_ref(), drive, copy, work);
            work.residual = signal;
            return isolation;
        }
        (work.severity, work.ring, work.misfit) = (None, None, f64::NAN);
        let Workspace { residual, projection, weights, .. } = work;
        let classes = rule.category_of.len();
        weights.clear();
        weights.resize(classes, 0.0);
        projection.resize(classes, 0.0);
        let compared = |residual: &mut Vec<f64>| {
            residual.resize(deviation.len(), 0.0);
            match signal {
                IsolateSignal::Residual => self.model.residual(deviation, residual),
                IsolateSignal::Deviation => residual.copy_from_slice(deviation),
            }
            residual.iter_mut().for_each(|r| *r /= drive);
        };
        // lengths agree by construction; a residual that is not finite gives no decision
        match &**isolator {
            Isolator::Posterior(_) => return None, // handled above
            Isolator::ResidualMatching(adjoint, simplex) => {
                // c = R^T r = (F^T R)^T d: the residual itself is not needed
                adjoint.project(deviation, projection);
                projection.iter_mut().for_each(|c| *c /= drive);
                simplex.solve(projection, weights).ok()?;
            }
            Isolator::Neighbours(neighbours) => {
                compared(residual);
                neighbours.weigh(residual, weights).ok()?;
            }
            Isolator::ModelMatching(models) => {
                // a class without a model fits nothing
                for (energy, model) in projection.iter_mut().zip(models) {
                    *energy = model
                        .as_ref()
                        .map(|m| (m.energy(deviation, drive, residual), m.bound))
                        .filter(|(energy, bound)| energy <= bound)
                        .map_or(f64::INFINITY, |(energy, _)| energy);
                }
                let best = model_matching::best_class(projection, &[f64::MAX; MAX_CLASSES])?;
                weights[usize::from(best)] = 1.0;
            }
        }
        Some(rule.decide(weights).certain_of_class(weights))
    }
}

/// Isolation by fitted rings.
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
        (work.severity, work.ring, work.misfit) = (None, None, f64::NAN);
        work.weights.clear();
        let Isolating { isolator, rule, curves, physics_ring, .. } = self.isolating.as_ref()?;
        let Isolator::Posterior(classifier) = &**isolator else { return None };
        let RingClassifier { posterior, priors, per_k, typical, .. } = &**classifier;
        let noise = self.model.noise_beside() / drive;
        let Some(fit) = fit.filter(|fit| is_ring(fit, noise)) else {
            return Some(Isolation::of_no_ring());
        };
        let warmer = work.warmer;
        work.misfit = fit.misfit / (noise * noise * self.model.expected.len() as f64);
        let Workspace { weights, ring, physics, own, ln_densities, .. } = work;
        let mut features = fit.features.coordinates();
        features.iter_mut().zip(per_k).for_each(|(x, slope)| *x -= warmer * slope);
        *ring = Some([features[1], features[2]]);
        let features = &features;
        let of_own = own.as_ref().and_then(|own| own.curves.as_ref().zip(Some(&own.baseline)));
        let curves = of_own.map(|(curves, _)| curves).or(curves.as_ref());
        let physics_ring = physics_ring.map(|ring| self.model.ring_from(&ring, warmer));
        let conditions = Conditions {
            drive,
            changed: curves.zip(physics_ring).map_or(Vector2::zeros(), |(c, r)| c.changed(r)),
            baseline: of_own.map(|(_, baseline)| baseline),
        };
        physics.ln_densities.clear();
        if let Some(curves) = curves {
            curves.compare(features, conditions, physics);
        }
        weights.clear();
        weights.resize(rule.category_of.len(), 0.0);
        posterior.weigh(features, &physics.ln_densities, priors, ln_densities, weights);
        let decision = rule.decide(weights);
        let Some(best) = decision.candidate.map(usize::from) else { return Some(decision) };
        if let Some(typical) = typical {
            let most = typical.misfit[best];
            // the misfit beside the ring is at most that of the fit, which is known already
            if work.misfit > most {
                signal(&mut work.residual);
                let misfits = classifier.misfits(&work.residual, fit, self, noise, best);
                work.misfit = misfits.all;
                if misfits.beyond_class > most {
                    work.weights.clear();
                    return Some(Isolation::of_no_ring());
                }
            }
        }
        let Workspace { weights, severity, physics, ln_densities, .. } = work;
        let from_curves =
            |k| curves.map_or(f64::INFINITY, |of| of.distance(k, features, conditions, physics));
        let is_typical = |k| posterior.is_typical(k, ln_densities[k], || from_curves(k));
        if !is_typical(best) {
            // the best class is rejected: is another plausible one typical?
            let other = |k: usize| weights[k] > LITTLE && is_typical(k);
            return Some(match (0..weights.len()).any(other) {
                true => decision.unnamed(),
                false => decision.of_unknown_fault(),
            });
        }
        let sized = curves.zip(rule.sized(&decision, weights));
        *severity = sized.and_then(|(of, k)| of.severity(k, weights, physics));
        Some(decision)
    }
}

/// Mean square misfit of a signal beside its ring, over the noise's: all of it, and beyond what is usual in a class
/// ([`Typical::misfit_of`]).
struct RelativeMisfit {
    all: f64,
    beyond_class: f64,
}

impl RingClassifier {
    /// `y`: per unit drive, N, counts; `noise`: standard deviation of one of its samples, counts.
    fn misfits(
        &self,
        y: &[f64],
        fit: &Fit,
        judge: &Judge,
        noise: f64,
        class: usize,
    ) -> RelativeMisfit {
        let fit = self.fitter.fit_from(y, &fit.features, true).unwrap_or(*fit);
        let shape = &judge.model.leftover;
        let mut left = self.beside.misfit_without(&self.fitter, y, &fit.features, shape);
        let size = fit.features.ln_amplitude.exp();
        left.iter_mut().for_each(|v| *v /= noise);
        let all = left.iter().map(|v| v * v).sum::<f64>() / left.len() as f64;
        // the class's variances hold at the reference drive's noise: scale the amplitude to the signal's own
        let beyond_class = self.typical.as_ref().map_or(all, |typical| {
            let size = size * judge.relative_noise(noise);
            typical.misfit_of(RingMisfit { values: &left, size }, class)
        });
        RelativeMisfit { all, beyond_class }
    }
}

impl Judge {
    /// Whether a flagged signal is no ring, where no classes are known. `y`: per unit drive, N, counts.
    pub fn is_no_ring(&self, y: &[f64], drive: f64, work: &mut Workspace) -> bool {
        let Some(detector) = &self.detector else { return false };
        let noise = self.model.noise_beside() / drive;
        let of_noise = y.len() as f64 * noise * noise;
        let fit = detector.fitter().fit(y, true, &mut work.products);
        let explains = |fit: Fit| fit.misfit - of_noise <= MOST_LEFT * (fit.square - of_noise);
        !fit.is_some_and(|fit| is_ring(&fit, noise) && explains(fit))
    }

    /// A description of a signal that belongs to no class. `y`: per unit drive, N, counts. `None`: the method fits
    /// no rings.
    pub fn appearance(&self, y: &[f64], drive: f64, work: &mut Workspace) -> Option<Appearance> {
        let detector = self.detector.as_ref()?;
        let (fitter, beside) = (detector.fitter(), detector.beside());
        let noise = self.model.noise_beside() / drive;
        let fit = fitter.fit(y, true, &mut work.products);
        let shape = &self.model.leftover;
        let mut left = match &fit {
            Some(fit) => beside.misfit_without(fitter, y, &fit.features, shape),
            None => y.to_vec(),
        };
        left.iter_mut().for_each(|v| *v /= noise);
        let (ring, dt_s) = (fit.map(|fit| fit.features), self.model.generator.dt_s);
        Some(UnknownSignal { signal: y, noise, ring, misfit: &left, dt_s }.appearance())
    }

    /// The relative drive of a signal whose noise per unit drive is `noise`.
    fn relative_noise(&self, noise: f64) -> f64 {
        self.model.noise_beside() / noise
    }
}

impl Isolator {
    fn new(
        model: &HealthyModel,
        design: &Design,
        settings: &IsolateSettings,
    ) -> Result<Isolator, DesignError> {
        // what is compared: the residual of this model's filter, or the deviation itself
        let seen = |deviation: &[f64]| match settings.signal {
            IsolateSignal::Deviation => deviation.to_vec(),
            IsolateSignal::Residual => {
                let mut r = vec![0.0; deviation.len()];
                model.residual(deviation, &mut r);
                r
            }
        };
        design.check_method(settings.method)?;
        match settings.method {
            IsolateMethod::Posterior => {
                let posterior = design
                    .posterior
                    .clone()
                    .ok_or_else(|| DesignError::untrained(settings.method))?;
                let (dt_s, samples) = (model.generator.dt_s, model.expected.len());
                let fitter = RingFitter::new(ring_of(&model.identification)?, dt_s, samples);
                let priors = settings.prior_weights(&design.class_names())?;
                let per_k = model.features_per_k(&fitter);
                let ring = ring_of(&model.identification)?;
                let beside = BesideRing::new(&ring, dt_s, samples);
                let typical = design.typical.clone().map(Arc::new);
                let posterior = Arc::new(posterior);
                let classifier =
                    RingClassifier { posterior, fitter, priors, per_k, beside, typical };
                Ok(Isolator::Posterior(Box::new(classifier)))
            }
            // rho of every class is the residual of its mean deviation, by this model's filter
            IsolateMethod::ResidualMatching => {
                let rho: Vec<Vec<f64>> =
                    design.classes.iter().map(|class| seen(&class.deviation)).collect();
                let columns: Vec<&[f64]> = rho.iter().map(Vec::as_slice).collect();
                let signatures = SignatureMatrix::new(&columns)?;
                let simplex = Simplex::new(&signatures);
                let adjoint: Vec<Vec<f64>> = match settings.signal {
                    IsolateSignal::Deviation => rho,
                    IsolateSignal::Residual => rho.iter().map(|rho| model.adjoint(rho)).collect(),
                };
                let columns: Vec<&[f64]> = adjoint.iter().map(Vec::as_slice).collect();
                Ok(Isolator::ResidualMatching(SignatureMatrix::new(&columns)?, simplex))
            }
            IsolateMethod::ModelMatching => Ok(Isolator::ModelMatching(
                design.classes.iter().map(|c| c.model.clone()).collect(),
            )),
            IsolateMethod::Neighbours => {
                let (mut rows, mut class_of) = (Vec::new(), Vec::new());
                for (k, class) in design.classes.iter().enumerate() {
                    rows.extend(class.examples.iter().map(|e| seen(e)));
                    class_of.resize(rows.len(), k as u16); // check(): at most 32 classes
                }
                let rows: Vec<&[f64]> = rows.iter().map(Vec::as_slice).collect();
                let k = settings.neighbours;
                Ok(Isolator::Neighbours(Neighbours::new(
                    &rows,
                    &class_of,
                    design.classes.len(),
                    k,
                )?))
            }
        }
    }
}
