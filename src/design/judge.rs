//! A healthy model and the fault classes as they meet a signal: what rides with every batch.

use super::detector::{Detection, Scratch, SensitivityDetector};
use super::isolator::Isolator;
use super::lanes::Lanes;
use super::own_channel::Own;
use super::{Design, DesignError, Extension, HealthyModel, IsolateSettings, Statistic};
use crate::burst::Burst;
use crate::detect::key_numbers::Spectrum;
use crate::identify::reservoir::relative_drive;
use crate::isolate::physics_density::{Comparison, FaultCurves};
use crate::isolate::severity::Severity;
use crate::isolate::{
    Decision, DecisionRule, IsolateMethod, IsolateSignal, MAX_CLASSES, model_matching,
};
use crate::model::ring::Ring;
use crate::model::ring_fit::Products;
use crate::verdict::Test;
use std::sync::Arc;

/// What is written of a signal's detection.
#[derive(Clone, Copy, Debug)]
pub struct Tested {
    pub test: Test,
    pub statistic: f64,
    pub threshold: f64,
    /// Unexplained mean square over the healthy one's; NaN: not known.
    pub misfit: f64,
}

impl Tested {
    /// e <= threshold is healthy, thesis f after (3-4).
    pub fn is_flagged(&self) -> bool {
        self.statistic > self.threshold
    }
}

/// Tells the judges of a run apart.
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
    /// How often it was moved, see [`Judge::moved`].
    pub(super) moves: u32,
    pub model: HealthyModel,
    pub reference_v: Option<f64>,
    /// Detection of many signals at once; where there is none, [`Judge::detect`] does the work.
    pub lanes: Option<Lanes>,
    /// What signals are taken without.
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
    pub(super) rule: DecisionRule,
    /// With `isolate.method` = `posterior`.
    pub(super) curves: Option<Arc<FaultCurves>>,
    /// The healthy ring that the curves were made for.
    pub(super) physics_ring: Option<Ring>,
}

/// What isolation says of one signal.
pub type Isolation = Decision;

/// Scratch of one worker.
#[derive(Debug, Default)]
pub struct Workspace {
    pub(super) residual: Vec<f64>,
    projection: Vec<f64>,
    pub(super) products: Products,
    detector: Scratch,
    /// Per class, of the signal last isolated.
    pub weights: Vec<f64>,
    /// ln of damping and of frequency over the healthy model's, of the ring last fitted by the
    /// posterior, at the model's drive and temperature; `None`: none was fitted.
    pub ring: Option<[f64; 2]>,
    /// Of the signal last isolated, if its category was named.
    pub severity: Option<Severity>,
    /// Mean square that its ring leaves over the noise's; NaN: not fitted.
    pub misfit: f64,
    pub(super) ln_densities: Vec<f64>,
    pub(super) physics: Comparison,
    /// Of the signal next isolated, see [`Judge::warmer`]. K.
    pub warmer: f64,
    /// With `--baseline`: of the channel whose signal is next, if it is known.
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
        // lanes know what is expected of a burst; an extension asks for each signal
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

    /// Scale of what is expected of a burst: its drive voltage over the reference.
    pub fn drive(&self, burst: &Burst) -> f64 {
        relative_drive(burst.drive_voltage_v.unwrap_or(f64::NAN), self.reference_v)
    }

    /// How much warmer than the model a burst was, as far as that matters. K.
    pub fn warmer(&self, burst: &Burst) -> f64 {
        self.model.warmer(burst.temperature_c.unwrap_or(f64::NAN))
    }

    /// The deviation of a burst's signal from what is expected of it. `expected`: of the burst;
    /// `signal`: as it was acquired. Counts.
    pub fn deviate(&self, burst: &Burst, row: usize, expected: &[f64], signal: &mut [f64]) {
        self.take_off_extension(burst, row, signal);
        signal.iter_mut().zip(expected).for_each(|(y, e)| *y -= e);
    }

    /// Takes what a critique found off a burst's signal, counts.
    pub fn take_off_extension(&self, burst: &Burst, row: usize, signal: &mut [f64]) {
        if let Some(extension) = &self.extension {
            extension.take_off(burst, row, self.reference_v, signal);
        }
    }

    /// y_hat of a burst, counts.
    pub fn expect(&self, burst: &Burst, out: &mut [f64]) {
        self.model.expect(self.drive(burst), burst.temperature_c.unwrap_or(f64::NAN), out);
    }

    /// What is compared with the thresholds. `deviation`: of a signal from what is expected, counts.
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

    /// The one statistic of all methods but `sensitivity`. `signal`: scratch.
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

    /// Whether it fails along its ring, too.
    pub fn is_faulty_ring(&self, detection: Detection) -> bool {
        self.model.threshold.is_faulty(detection.ring)
    }

    /// The test that a signal is nearer to failing, or fails by more.
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
        // a comparison that NaN fails
        match statistic * threshold > ring * beside {
            true => Tested { test: Test::Misfit, statistic, threshold: beside, misfit: relative },
            false => Tested { misfit: relative, ..of_ring },
        }
    }

    /// With `detect.method` = `sensitivity`: what a channel's baseline is made of.
    pub fn detector(&self) -> Option<&SensitivityDetector> {
        self.detector.as_ref()
    }

    pub fn can_isolate(&self) -> bool {
        self.isolating.is_some()
    }

    /// Thesis §3-3 on the deviation of a signal from what is expected, counts; `drive` scales what
    /// classes look like as it scales the signal. `None`: it looks like no class.
    pub fn isolate(
        &self,
        deviation: &[f64],
        drive: f64,
        work: &mut Workspace,
    ) -> Option<Isolation> {
        let Isolating { isolator, signal, rule, .. } = self.isolating.as_ref()?;
        if let Isolator::Posterior(of_rings) = &**isolator {
            let fitter = &of_rings.fitter;
            // the ring as it would be at the reference drive and temperature
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
        // lengths agree by construction; a residual that is no number says nothing
        match &**isolator {
            Isolator::Posterior(_) => return None, // see above
            Isolator::ResidualMatching(adjoint, simplex) => {
                // c = R^T r = (F^T R)^T d: without the residual itself
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
