//! The judge: a healthy model and the fault classes of a design, made ready to judge signals.
//!
//! The pipeline makes one judge per model, and every batch carries the judge of each of its bursts.
//! In the filter stage a judge turns a signal into its deviation from the expected signal
//! ([`Judge::deviate`]), and the deviation, N, counts, with the relative drive into detection
//! statistics ([`Judge::detect`]). The gate compares these with thresholds ([`Judge::test`]) and
//! flags the signal or not. In the isolate stage a flagged signal gets an [`Isolation`]
//! ([`Judge::isolate`]): the decision is returned, the weights of the fault classes and further
//! results stand in the [`Workspace`].
//!
//! The work itself is done in `detector` (first half) and `isolator`, `named_ring` (second half).

use super::detector::{Detection, SensitivityDetector};
use super::isolator::Isolator;
use super::lanes::Lanes;
use super::own_channel::{OwnBaseline, OwnChannels};
use super::workspace::Workspace;
use super::{Design, DesignError, Extension, HealthyModel, IsolateSettings, Statistic};
use crate::burst::Burst;
use crate::detect::key_numbers::Spectrum;
use crate::detect::sensitivity::Sensitivity;
use crate::fault::Naming;
use crate::identify::reservoir::relative_drive;
use crate::isolate::physics_density::FaultCurves;
use crate::isolate::{Decision, IsolateMethod, IsolateSignal};
use crate::model::ring::Ring;
use crate::model::ring_fit::RingFitter;
use crate::verdict::Test;
use std::sync::{Arc, OnceLock};

/// A signal's detection statistics ([`Detection`]) compared with their thresholds, as it is written
/// to the verdict table: the test that decided, and its two numbers.
#[derive(Clone, Copy, Debug)]
pub struct Tested {
    /// The test that decided.
    pub test: Test,
    /// The statistic of `test`, and the threshold that the statistic is compared with, in the same
    /// unit.
    pub statistic: f64,
    pub threshold: f64,
    /// The misfit divided by the mean misfit of healthy signals ([`crate::detect::misfit`]),
    /// whichever test decided; NaN: not known.
    pub misfit: f64,
}

impl Tested {
    /// Whether the statistic exceeds its threshold. A signal whose statistic equals the threshold
    /// is healthy, as by f of thesis §3-2, after (3-4).
    pub fn is_flagged(&self) -> bool {
        self.statistic > self.threshold
    }
}

/// The thresholds of a judge's tests.
#[derive(Clone, Copy, Debug)]
pub struct Thresholds {
    /// What the first test, whose statistic is [`Detection::ring`], is called in the verdict table.
    pub along: Test,
    /// Threshold of the first test, also if the method's statistic is no distance along the ring.
    pub of_ring: f64,
    /// Threshold of the second test; NaN: there is none.
    pub beside: f64,
}

/// Identifies a judge within a run, by [`Judge::index`] and the number of the move that made the
/// judge.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct JudgeKey {
    index: u16,
    moves: u32,
}

/// Judges signals by one model. All workers share a judge. If all channels of a printhead change
/// alike, the printhead gets another judge of the same model, which was moved with the channels
/// ([`Judge::moved`]).
#[derive(Debug)]
pub struct Judge {
    /// The index of the judge's model in `models` of the verdict table's metadata.
    pub index: u16,
    /// Number of the move that made this judge ([`Judge::moved`]), counted from 1 over all judges
    /// of the run; 0: the model is as it was learned.
    pub(super) moves: u32,
    pub model: Arc<HealthyModel>,
    /// Drive voltage at which the model expects its signals, V; `None`: not known.
    pub reference_v: Option<f64>,
    /// Detection of many signals at once, in f32. Signals that this does not settle are computed in
    /// f64, as by [`Judge::detect`]; `None`: all signals are.
    pub lanes: Option<Lanes>,
    /// What a critique found missing in the model, as a further part of the expected signal;
    /// `None`: nothing.
    pub(super) extension: Option<Extension>,
    /// The detector of `detect.method` = `sensitivity`; `None` with the other methods.
    pub(super) detector: Option<SensitivityDetector>,
    /// The Fourier transform by which `detect.method` = `practice` computes a signal's key numbers:
    /// dominant amplitude, damping and frequency ([`crate::detect::key_numbers`]). `None` with the
    /// other methods.
    pub(super) spectrum: Option<Spectrum>,
    /// The fitter of rings for [`Judge::ring_of`], made when it is first asked for, where neither
    /// detection nor isolation has one. `None` inside: the model does not ring.
    pub(super) told: OnceLock<Option<RingFitter>>,
    /// What names faults; `None`: there is no design, or it has no classes.
    pub(super) isolating: Option<Isolating>,
}

/// What a judge needs to name the fault of a flagged signal.
#[derive(Clone, Debug)]
pub(super) struct Isolating {
    pub(super) isolator: Arc<Isolator>,
    /// Whether residual matching and neighbours compare signals' residuals or their deviations.
    signal: IsolateSignal,
    /// What may be named on the strength of the weights.
    pub(super) rule: Naming,
    /// The classes' curves by the physics, with `isolate.method` = `posterior`.
    pub(super) curves: Option<Arc<FaultCurves>>,
    /// The healthy ring about which the curves were computed; `None`: the design has no physics.
    pub(super) physics_ring: Option<Ring>,
    /// Standard deviation of the noise that the curves were computed for, over that of this model's
    /// noise, both as they affect a ring's fit. The relative drive is multiplied by this number
    /// before the comparison with the curves: the ring of a signal with half the noise is known as
    /// well as that of a signal with twice the drive.
    pub(super) quieter: f64,
}

/// The result of a signal's isolation: the decision, by the name that users of a judge know it by.
pub type Isolation = Decision;

impl Judge {
    /// Makes the judge of a model. `index`: see [`Judge::index`]; `design`: its fault classes, if
    /// there is one (without, whatever is flagged stays undecided); `reference_v`: the drive
    /// voltage at which the model expects its signals.
    pub fn new(
        index: u16,
        model: Arc<HealthyModel>,
        reference_v: Option<f64>,
        design: Option<&Design>,
        settings: &IsolateSettings,
    ) -> Result<Judge, DesignError> {
        // What names faults.
        let isolating = match design {
            Some(design) if !design.classes.is_empty() => Some(Isolating {
                isolator: Arc::new(Isolator::new(&model, design, settings)?),
                signal: settings.signal,
                rule: Naming::new(&design.fault_classes(), settings.certainty),
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
        // What detects: the method is known by which parts the model has.
        let detector = |sensitivity: &Sensitivity| {
            SensitivityDetector::new(&model, sensitivity.clone(), model.misfit.as_ref())
        };
        let detector = model.sensitivity.as_ref().map(detector).transpose()?;
        let extension = design.and_then(|design| design.extension.clone());
        // Lanes compare all signals of a burst with one expected signal. With an extension the
        // expected signal differs from signal to signal, so there are no lanes.
        let lanes = if extension.is_none() { Lanes::of(&model) } else { None };
        let is_practice = matches!(model.statistic, Some(Statistic::Practice(_)));
        let spectrum =
            is_practice.then(|| Spectrum::new(model.expected.len(), model.generator.dt_s));
        Ok(Judge {
            index,
            moves: 0,
            reference_v,
            model,
            lanes,
            extension,
            detector,
            spectrum,
            told: OnceLock::new(),
            isolating,
        })
    }

    /// What tells this judge from the other judges of the run.
    pub fn key(&self) -> JudgeKey {
        JudgeKey { index: self.index, moves: self.moves }
    }

    /// Relative drive of a burst, which scales its expected signal: the burst's drive voltage over
    /// the reference; 1 where one of the two is not known.
    pub fn drive(&self, burst: &Burst) -> f64 {
        relative_drive(burst.drive_voltage_v.unwrap_or(f64::NAN), self.reference_v)
    }

    /// Temperature of a burst above the model's, K; 0 where it is unknown or has no effect.
    pub fn warmer(&self, burst: &Burst) -> f64 {
        self.model.warmer(burst.temperature_c.unwrap_or(f64::NAN))
    }

    /// Turns `signal`, row `row` of a burst as acquired, into its deviation from what is expected:
    /// less `expected`, the burst's expected signal ([`Judge::expect`]), and less the extension;
    /// all N, counts.
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

    /// Writes the expected signal y_hat at a burst's drive and temperature, without the extension;
    /// N, counts.
    pub fn expect(&self, burst: &Burst, out: &mut [f64]) {
        self.model.expect(self.drive(burst), burst.temperature_c.unwrap_or(f64::NAN), out);
    }

    /// The detection statistics of a signal by the model's method, in f64: the reference of the
    /// filter stage. `deviation`: from the expected signal, N, counts; `drive`: relative. Only
    /// `sensitivity` has a second test. The statistic of any other method stands in the result's
    /// `ring`.
    pub fn detect(&self, deviation: &[f64], drive: f64, work: &mut Workspace) -> Detection {
        let Some(detector) = &self.detector else {
            let ring = self.without_distance(deviation, drive, &mut work.residual);
            return Detection { ring, unexplained: f64::NAN };
        };
        detector.detect(deviation, drive, &mut work.residual)
    }

    /// The statistic of the first test for a signal that is judged by its channel's own level.
    /// `distance`: squared distance of the signal's features from that level. The result is
    /// threshold * max(distance / gate, off). So the result exceeds the model's threshold if the
    /// distance exceeds the one for own levels ([`OwnChannels::gate`]), or if the channel's level
    /// itself lies beyond its bound ([`OwnBaseline::off`]), and tables need no second threshold.
    pub fn of_own(&self, distance: f64, channels: &OwnChannels, own: &OwnBaseline) -> f64 {
        let threshold = self.model.threshold.value;
        threshold * (distance / channels.gate(threshold)).max(own.off)
    }

    /// The statistic of every method but `sensitivity`, in the method's unit. `signal`: a buffer,
    /// for the signal or its residual.
    fn without_distance(&self, deviation: &[f64], drive: f64, signal: &mut Vec<f64>) -> f64 {
        match (&self.model.statistic, &self.spectrum) {
            (Some(Statistic::Practice(range)), Some(spectrum)) => {
                // The key numbers are those of the signal itself per unit drive, not of its
                // deviation. The deviation was taken at the signal's temperature, so adding the
                // expected signal at the model's (`warmer` 0) corrects for temperature.
                self.model.per_drive(deviation, drive, 0.0, signal);
                range.distance(&spectrum.key_numbers(signal))
            }
            _ => self.model.of_residual(deviation, signal),
        }
    }

    /// What the statistics of [`Judge::detect`] are compared with.
    pub fn thresholds(&self) -> Thresholds {
        Thresholds {
            // residual energy and residual maximum are called `energy`, distances `ring`
            along: match (&self.detector, &self.spectrum) {
                (None, None) => Test::Energy,
                _ => Test::Ring,
            },
            of_ring: self.model.threshold.value,
            beside: self.model.misfit.as_ref().map_or(f64::NAN, |misfit| misfit.threshold.value),
        }
    }

    /// The test that decides: the one whose statistic is larger relative to its threshold; the
    /// first test if the model has no second one or the misfit is not known (NaN).
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

    /// The detector of `detect.method` = `sensitivity`, which computes the features that channels'
    /// baselines consist of. `None` with the other methods.
    pub fn detector(&self) -> Option<&SensitivityDetector> {
        self.detector.as_ref()
    }

    /// Whether the judge knows fault classes.
    pub fn can_isolate(&self) -> bool {
        self.isolating.is_some()
    }

    /// Isolates the fault of a signal, thesis §3-3. `deviation`: from the expected signal, N,
    /// counts; `drive`: relative, which scales the classes' deviations as it scales the signal. In
    /// `work`, [`Workspace::warmer`] and [`Workspace::own`] are to be set before; the weights of
    /// the classes are written to [`Workspace::weights`]. `None`: the judge knows no classes; or,
    /// with a method that fits no rings, no class fits or the residual is not finite.
    pub fn isolate(
        &self,
        deviation: &[f64],
        drive: f64,
        work: &mut Workspace,
    ) -> Option<Isolation> {
        let Isolating { isolator, signal, rule, .. } = self.isolating.as_ref()?;
        if let Isolator::Posterior(classifier) = &**isolator {
            // The posterior needs a ring fitted to the signal itself per unit drive, at the
            // signal's own temperature, with the phase free (`true`).
            let fitter = &classifier.rings.fitter;
            self.model.per_drive(deviation, drive, work.warmer, &mut work.residual);
            let signal = std::mem::take(&mut work.residual);
            let fit = fitter.fit(&signal, true, &mut work.products);
            let copy = |y: &mut Vec<f64>| y.clone_from(&signal);
            let isolation = self.isolate_ring(fit.as_ref(), drive, copy, work);
            work.residual = signal;
            return isolation;
        }

        // The other methods compare the signal's residual or deviation with those of the classes.
        // The results in `work`, which are of the signal before, are forgotten.
        work.forget();
        work.weights.resize(rule.category_of.len(), 0.0);
        isolator.weigh((deviation, drive), (&self.model, *signal), work)?;
        let weights = &work.weights;
        // These methods know no alternatives to the classes, so the signal is of some class with
        // probability 1.
        Some(rule.decide(weights, 1.0).certain_of_class(weights))
    }
}
