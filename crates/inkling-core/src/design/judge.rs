//! The judge: a healthy model and the fault classes, made ready to judge signals. Every batch carries the one that
//! its signals are judged by.

use super::detector::{Detection, SensitivityDetector};
use super::isolator::{Compared, Isolator};
use super::lanes::Lanes;
use super::own_channel::{OwnBaseline, OwnChannels};
use super::workspace::Workspace;
use super::{Design, DesignError, Extension, HealthyModel, IsolateSettings, Statistic};
use crate::burst::Burst;
use crate::detect::key_numbers::Spectrum;
use crate::identify::reservoir::relative_drive;
use crate::isolate::physics_density::FaultCurves;
use crate::isolate::{Decision, DecisionRule, IsolateMethod, IsolateSignal};
use crate::model::ring::Ring;
use crate::verdict::Test;
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

/// What the statistics of the tests are compared with.
#[derive(Clone, Copy, Debug)]
pub struct Thresholds {
    /// The first test, and its threshold.
    pub along: Test,
    pub of_ring: f64,
    /// Of the second test; NaN: there is none.
    pub beside: f64,
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
    pub model: Arc<HealthyModel>,
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
    pub(super) rule: DecisionRule,
    /// With `isolate.method` = `posterior`.
    pub(super) curves: Option<Arc<FaultCurves>>,
    /// The healthy ring that the curves were made for.
    pub(super) physics_ring: Option<Ring>,
    /// Noise that the curves were made for, over that of the model's window, in what a ring's fit sees of it.
    pub(super) quieter: f64,
}

/// The result of a signal's isolation.
pub type Isolation = Decision;

impl Judge {
    /// `design`: its fault classes, if there is one; without, whatever passes stays undecided.
    /// `reference_v`: the drive voltage at which the model expects its signals.
    pub fn new(
        index: u16,
        model: Arc<HealthyModel>,
        reference_v: Option<f64>,
        design: Option<&Design>,
        settings: &IsolateSettings,
    ) -> Result<Judge, DesignError> {
        let isolating = match design {
            Some(design) if !design.classes.is_empty() => Some(Isolating {
                isolator: Arc::new(Isolator::new(&model, design, settings)?),
                signal: settings.signal,
                rule: DecisionRule::new(&design.fault_classes(), settings.certainty)?,
                physics_ring: design.physics.as_ref().map(|physics| physics.ring),
                quieter: design
                    .physics
                    .as_ref()
                    .map_or(1.0, |physics| physics.noise / model.noise_of_fits()),
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
        detector.detect(deviation, drive, &mut work.detector)
    }

    /// The first statistic by a channel's own level, from the squared distance from it: beyond the threshold where that
    /// is beyond the levels' own, or where the channel is no longer there.
    pub fn of_own(&self, distance: f64, channels: &OwnChannels, own: &OwnBaseline) -> f64 {
        let threshold = self.model.threshold.value;
        threshold * (distance / channels.gate(threshold)).max(own.off)
    }

    /// The statistic of all methods but `sensitivity`. `signal`: buffer.
    fn of_residual(&self, deviation: &[f64], drive: f64, signal: &mut Vec<f64>) -> f64 {
        let HealthyModel { expected, statistic, .. } = &*self.model;
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

    pub fn thresholds(&self) -> Thresholds {
        Thresholds {
            along: match (&self.detector, &self.spectrum) {
                (None, None) => Test::Energy,
                _ => Test::Ring,
            },
            of_ring: self.model.threshold.value,
            beside: self.model.misfit.as_ref().map_or(f64::NAN, |misfit| misfit.threshold.value),
        }
    }

    /// The test whose statistic is larger relative to its threshold.
    pub fn test(&self, detection: Detection) -> Tested {
        let Detection { ring, unexplained } = detection;
        let Thresholds { along, of_ring: threshold, .. } = self.thresholds();
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
        work.forget();
        work.weights.resize(rule.category_of.len(), 0.0);
        let compared = Compared { model: &self.model, signal: *signal };
        isolator.weigh(deviation, drive, compared, work)?;
        let weights = &work.weights;
        Some(rule.decide(weights, 1.0).certain_of_class(weights))
    }
}
