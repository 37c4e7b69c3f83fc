//! The judge: a healthy model and the fault classes of a design, made ready to judge signals.
//!
//! The pipeline makes one judge per model, and every batch carries the judge of each of its bursts.
//! In the filter stage a judge turns a signal into its deviation from the expected signal
//! ([`Judge::deviate`]), and that, N, counts, with the relative drive into detection statistics
//! ([`Judge::detect`]). The gate compares these with thresholds ([`Judge::test`]). In the isolate
//! stage flagged signals get an [`Isolation`] ([`Judge::isolate`]), with a [`Workspace`].

use super::detector::{Detection, SensitivityDetector};
use super::isolator::Isolator;
use super::own_channel::OwnChannels;
use super::workspace::Workspace;
use super::{Design, Extension, HealthyModel, IsolateSettings, Isolation, Result};
use crate::burst::Burst;
use crate::detect::lane_sensitivity::LaneSensitivity;
use crate::fault::Naming;
use crate::identify::reservoir::relative_drive;
use crate::isolate::physics_density::FaultCurves;
use crate::isolate::{IsolateMethod, IsolateSignal};
use crate::model::ring::Ring;
use crate::model::ring_fit::RingFitter;
use crate::verdict::Test;
use std::sync::{Arc, OnceLock};

/// A signal's detection statistics compared with their thresholds, for the verdict table.
#[derive(Clone, Copy, Debug)]
pub struct Tested {
    pub test: Test,
    /// The statistic of `test`, and its threshold in the same unit.
    pub statistic: f64,
    pub threshold: f64,
    /// The misfit over the mean misfit of healthy signals, whichever test decided; NaN: not known.
    pub misfit: f64,
}

impl Tested {
    /// Equal to the threshold is healthy, as by f of thesis §3-2, after (3-4).
    pub fn is_flagged(&self) -> bool {
        self.statistic > self.threshold
    }
}

#[derive(Clone, Copy, Debug)]
pub struct Thresholds {
    /// What the first test is called in the verdict table.
    pub along: Test,
    pub of_ring: f64,
    /// Threshold of the second test; NaN: there is none.
    pub beside: f64,
}

/// Identifies a judge within a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct JudgeKey {
    index: u16,
    moves: u32,
}

/// Judges signals by one model; all workers share it. [`Judge::moved`] makes others of the model.
#[derive(Debug)]
pub struct Judge {
    /// The index of the judge's model in `models` of the verdict table's metadata.
    pub index: u16,
    /// Number of the move that made this judge, over all judges of the run; 0: not moved.
    pub(super) moves: u32,
    pub model: Arc<HealthyModel>,
    /// Drive voltage at which the model expects its signals, V.
    pub reference_v: Option<f64>,
    /// Distances of many signals at once, in f32; what it does not settle, [`Judge::detect`] does.
    pub(super) lanes: Option<LaneSensitivity>,
    pub(super) extension: Option<Extension>,
    pub(super) detector: Option<SensitivityDetector>,
    /// For [`Judge::ring_of`] where neither detection nor isolation has one.
    pub(super) own_fitter: OnceLock<Option<RingFitter>>,
    /// What names faults; `None`: there is no design, or it has no classes.
    pub(super) isolating: Option<Isolating>,
}

#[derive(Clone, Debug)]
pub(super) struct Isolating {
    pub(super) isolator: Arc<Isolator>,
    /// Whether residual matching and neighbours compare signals' residuals or their deviations.
    signal: IsolateSignal,
    pub(super) rule: Naming,
    pub(super) curves: Option<Arc<FaultCurves>>,
    /// The healthy ring about which the curves were computed.
    pub(super) physics_ring: Option<Ring>,
    /// Noise that the curves were computed for, over this model's, both as they affect a ring's
    /// fit: half the noise is as good as twice the drive.
    pub(super) noise_ratio: f64,
}
impl Judge {
    /// `design`: its fault classes (without, whatever is flagged stays undecided).
    pub fn new(
        index: u16,
        model: Arc<HealthyModel>,
        reference_v: Option<f64>,
        design: Option<&Design>,
        settings: &IsolateSettings,
    ) -> Result<Judge> {
        let isolating = |design: &Design| -> Result<Isolating> {
            let physics = design.physics.as_ref();
            let is_posterior = settings.method == IsolateMethod::Posterior;
            Ok(Isolating {
                isolator: Arc::new(Isolator::new(&model, design, settings)?),
                signal: settings.signal,
                rule: Naming::new(&design.fault_classes(), settings.certainty),
                physics_ring: physics.map(|physics| physics.ring),
                noise_ratio: physics.map_or(1.0, |physics| physics.noise / model.noise_of_fits()),
                curves: if is_posterior { design.curves() } else { None },
            })
        };
        let with_classes = design.filter(|design| !design.classes.is_empty());
        let isolating = with_classes.map(isolating).transpose()?;
        // what detects: the method is known by which parts the model has
        let detector = model.sensitivity.clone().map(|sensitivity| {
            SensitivityDetector::new(&model, sensitivity, model.misfit.as_ref())
        });
        let detector = detector.transpose()?;
        let extension = design.and_then(|design| design.extension.clone());
        // with an extension the expected signal differs from signal to signal of a burst
        let lanes = if extension.is_none() { model.lanes() } else { None };
        Ok(Judge {
            index,
            moves: 0,
            reference_v,
            model,
            lanes,
            extension,
            detector,
            own_fitter: OnceLock::new(),
            isolating,
        })
    }

    pub fn key(&self) -> JudgeKey {
        JudgeKey { index: self.index, moves: self.moves }
    }

    /// The lanes, if the burst's signals have the model's number of samples.
    pub fn lanes_for(&self, burst: &Burst) -> Option<&LaneSensitivity> {
        let n = burst.samples_per_channel as usize;
        self.lanes.as_ref().filter(|lanes| lanes.samples() == n)
    }

    /// 1 where one of the two voltages is not known.
    pub fn drive(&self, burst: &Burst) -> f64 {
        relative_drive(burst.drive_voltage_v.unwrap_or(f64::NAN), self.reference_v)
    }

    /// Temperature of a burst above the model's, K; 0 where it is unknown or has no effect.
    pub fn warmer(&self, burst: &Burst) -> f64 {
        self.model.warmer(burst.temperature_c.unwrap_or(f64::NAN))
    }

    /// `signal`: row `row` of a burst as acquired, N, counts; becomes its deviation.
    pub fn deviate(&self, burst: &Burst, row: usize, expected: &[f64], signal: &mut [f64]) {
        self.take_off(burst, row, signal);
        signal.iter_mut().zip(expected).for_each(|(y, e)| *y -= e);
    }

    /// Takes the offset and what the extension says off a signal as acquired, N, counts.
    pub fn take_off(&self, burst: &Burst, row: usize, signal: &mut [f64]) {
        if self.model.offset != 0.0 {
            signal.iter_mut().for_each(|y| *y -= self.model.offset);
        }
        if let Some(extension) = &self.extension {
            extension.take_off(burst, row, self.reference_v, signal);
        }
    }

    /// Writes the expected signal of a burst, without the extension; N, counts.
    pub fn expect(&self, burst: &Burst, out: &mut [f64]) {
        self.model.expect(self.drive(burst), burst.temperature_c.unwrap_or(f64::NAN), out);
    }

    /// The detection statistics of a signal in f64: the reference of the filter stage. `deviation`:
    /// from the expected signal, N, counts. Only `sensitivity` has a second test.
    pub fn detect(&self, deviation: &[f64], drive: f64, work: &mut Workspace) -> Detection {
        match &self.detector {
            Some(detector) => detector.detect(deviation, drive, &mut work.residual),
            None => Detection { ring: self.model.of_residual(deviation), unexplained: f64::NAN },
        }
    }

    /// The first test's statistic at the squared `distance` from the channel's own level: beyond
    /// its threshold where the distance is beyond [`OwnChannels::gate`] or the level is off (`off`).
    pub fn of_own(&self, distance: f64, channels: &OwnChannels, off: f64) -> f64 {
        let threshold = self.model.threshold.value;
        threshold * (distance / channels.gate(threshold)).max(off)
    }

    pub fn thresholds(&self) -> Thresholds {
        Thresholds {
            // residual energy and maximum are called `energy`, distances `ring`
            along: match self.detector {
                Some(_) => Test::Ring,
                None => Test::Energy,
            },
            of_ring: self.model.threshold.value,
            beside: self.model.misfit.as_ref().map_or(f64::NAN, |misfit| misfit.threshold.value),
        }
    }

    /// The test that decides: the one whose statistic is larger relative to its threshold; the
    /// first test if there is no second one or the misfit is NaN.
    pub fn test(&self, detection: Detection) -> Tested {
        let Detection { ring, unexplained } = detection;
        let Thresholds { along, of_ring: threshold, .. } = self.thresholds();
        let of_ring = Tested { test: along, statistic: ring, threshold, misfit: f64::NAN };
        let Some(misfit) = &self.model.misfit else { return of_ring };
        let (statistic, relative) = (misfit.statistic(unexplained), misfit.relative(unexplained));
        let beside = misfit.threshold.value;
        // statistic / beside > ring / threshold, without divisions; false if the misfit is NaN
        match statistic * threshold > ring * beside {
            true => Tested { test: Test::Misfit, statistic, threshold: beside, misfit: relative },
            false => Tested { misfit: relative, ..of_ring },
        }
    }

    /// `None` with other methods than `sensitivity`.
    pub fn detector(&self) -> Option<&SensitivityDetector> {
        self.detector.as_ref()
    }

    pub fn can_isolate(&self) -> bool {
        self.isolating.is_some()
    }

    /// Isolates the fault of a signal, thesis §3-3, by [`Workspace::warmer`] and
    /// [`Workspace::own`]; [`Workspace::weights`] is written. `None`: there are no classes; or,
    /// with a method that fits no rings, none fits or the residual is not finite.
    pub fn isolate(
        &self,
        deviation: &[f64],
        drive: f64,
        work: &mut Workspace,
    ) -> Option<Isolation> {
        let Isolating { isolator, signal, rule, .. } = self.isolating.as_ref()?;
        if let Isolator::Posterior(classifier) = &**isolator {
            let fitter = &classifier.rings.fitter;
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
        isolator.weigh((deviation, drive), (&self.model, *signal), work)?;
        let weights = &work.weights;
        // these methods know no alternatives to the classes
        Some(rule.decide(weights, 1.0).certain_of_class(weights))
    }
}
