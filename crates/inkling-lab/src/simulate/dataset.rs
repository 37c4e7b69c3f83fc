//! Simulates sets of signals, each signal from another channel. In: `[dataset]`. Out: the recordings `train`,
//! `test`, `calibration` as bursts of one printhead, and a label per faulty channel.
//!
//! After thesis §4-1: training and test set, drawn separately, hold healthy signals and as many of one fault
//! class as of another, shuffled. The steps: draw the truth of each signal (class and severity),
//! number the channels on from set to set (so that one labels file covers all sets), and, when a burst is
//! asked for, sense one signal for each truth. [`super::thesis_form`] makes its sets here, too.

use super::draws::{Purpose, part, stream};
use super::scenario::{Physics, RecordingOptions};
use super::sensor::{Channel, NOMINAL_DRIVE_V, NOMINAL_TEMPERATURE_C, Sensor};
use super::simulated::{SimulatedRecording, burst_of, healthy_everywhere};
use inkling_core::burst::Burst;
use inkling_core::labels::{Channels, Label};
use inkling_core::model::faults;
use rand::RngExt;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use std::sync::Arc;

/// The printhead of all sets.
pub const PRINTHEAD: &str = "dataset";
/// Number of channels in a burst.
const CHANNELS_PER_BURST: usize = 450;
/// Time from one burst of a set to the next, ns.
const BURST_INTERVAL_NS: i64 = 1_000_000_000;

/// What is true of one signal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Truth {
    /// Index into the scenario's fault classes; `None`: healthy.
    pub class: Option<usize>,
    /// Severity in the class's unit; 0 of a healthy signal, NaN in a scenario that knows no severities.
    pub severity: f64,
}

impl Truth {
    const HEALTHY: Truth = Truth { class: None, severity: 0.0 };
}

/// One set of signals, each of another channel. Channels are numbered on from set to set.
pub(super) struct Set {
    /// Stem of the recording's file name.
    pub stem: &'static str,
    /// Number of its random streams (`draws::part`).
    pub part: u32,
    /// The truth of each signal.
    pub truths: Vec<Truth>,
}

/// A training and a test set, drawn separately and shuffled. The array holds the numbers of healthy signals, of
/// signals per fault class, and of classes; `severity` draws that of a signal of a class.
pub(super) fn train_and_test(
    seed: u64,
    [healthy, per_fault, classes]: [usize; 3],
    severity: impl Fn(usize, &mut ChaCha8Rng) -> f64,
) -> Vec<Set> {
    let set = |(stem, part)| {
        let mut rng = stream(seed, Purpose::Truth, part);
        let mut truths = vec![Truth::HEALTHY; healthy];
        for class in 0..classes {
            let draw = || Truth { class: Some(class), severity: severity(class, &mut rng) };
            truths.extend(std::iter::repeat_with(draw).take(per_fault));
        }
        truths.shuffle(&mut rng);
        Set { stem, part, truths }
    };
    [("train", part::TRAIN), ("test", part::TEST)].map(set).into()
}

/// The sets that the scenario asks for; severities are uniform in the ranges of their classes.
fn sets(physics: &Physics, seed: u64) -> Vec<Set> {
    let Some(dataset) = &physics.dataset else { return Vec::new() };
    let ranges = physics.severity_ranges();
    let severity = |class: usize, rng: &mut ChaCha8Rng| {
        let [low, high] = ranges[class].1;
        low + (high - low) * rng.random::<f64>()
    };
    let numbers = [dataset.healthy, dataset.per_fault, ranges.len()];
    let mut sets = train_and_test(seed, numbers, severity);
    if dataset.calibration_test > 0 {
        let mut rng = stream(seed, Purpose::Truth, part::CALIBRATION);
        // the calibration set has faulty signals only, of classes drawn at random
        let draw = |_| {
            let class = rng.random_range(0..ranges.len());
            Truth { class: Some(class), severity: severity(class, &mut rng) }
        };
        let truths = (0..dataset.calibration_test).map(draw).collect();
        sets.push(Set { stem: "calibration", part: part::CALIBRATION, truths });
    }
    sets
}

/// The labels of the scenario's sets.
pub(super) fn labels(physics: &Physics, seed: u64) -> Vec<Label> {
    let ranges = physics.severity_ranges();
    let class = |truth: &Truth| truth.class.map(|i| (ranges[i].0.clone(), Some(truth.severity)));
    labels_of(&sets(physics, seed), class)
}

/// The labels of sets: a `*` row that says healthy, then a row per faulty channel. `state`: the class and the
/// severity of a truth that is not healthy.
pub(super) fn labels_of(
    sets: &[Set],
    state: impl Fn(&Truth) -> Option<(String, Option<f64>)>,
) -> Vec<Label> {
    let healthy = sets.first().map(|_| healthy_everywhere(PRINTHEAD));
    let faulty = sets.iter().flat_map(|set| &set.truths).zip(0..).filter_map(|(truth, channel)| {
        let ((state, severity), channel) = (state(truth)?, Channels::One(channel));
        Some(Label { channel, state, severity, ..healthy_everywhere(PRINTHEAD) })
    });
    healthy.into_iter().chain(faulty).collect()
}

/// The recordings of sets, not yet made. `common`: what all bursts have in common. `sense` is called once for
/// each set with its part, and returns the function that appends the counts of one signal of a given truth.
pub(super) fn recordings_of<S>(
    sets: Vec<Set>,
    options: &RecordingOptions,
    common: Burst,
    sense: impl Fn(u32) -> S,
) -> Vec<SimulatedRecording>
where
    S: FnMut(&Truth, &mut Vec<i16>) + Send + 'static,
{
    let common = Burst { printhead: PRINTHEAD.into(), ..common };
    let (mut next_burst, mut next_channel) = (0, 0);
    let record = |set: Set| {
        // bursts, and so their times, are counted on from set to set, as channels are
        let bursts = set.truths.len().div_ceil(CHANNELS_PER_BURST);
        let (first_burst, first_channel) = (next_burst, next_channel);
        next_burst += bursts;
        next_channel += set.truths.len();
        let (start_ns, mut sense, common) = (options.start_ns, sense(set.part), common.clone());
        let acquire = move |i: usize| {
            let from = i * CHANNELS_PER_BURST;
            let to = set.truths.len().min(from + CHANNELS_PER_BURST);
            let mut counts = Vec::new();
            set.truths[from..to].iter().for_each(|truth| sense(truth, &mut counts));
            let beside = Burst {
                t_acq_ns: start_ns + (first_burst + i) as i64 * BURST_INTERVAL_NS,
                first_channel: (first_channel + from) as u32,
                ..common.clone()
            };
            burst_of(beside, &counts)
        };
        let (stem, options) = (set.stem.to_owned(), options.clone());
        SimulatedRecording { stem, bursts: Box::new((0..bursts).map(acquire)), options }
    };
    sets.into_iter().map(record).collect()
}

/// The recordings of the scenario's sets, sensed at nominal drive and temperature.
pub(super) fn recordings(
    physics: &Arc<Physics>,
    options: &RecordingOptions,
    seed: u64,
) -> Vec<SimulatedRecording> {
    let common = Burst {
        sample_period_s: physics.acquisition.sample_period_s(),
        samples_per_channel: physics.acquisition.samples as u32,
        temperature_c: Some(NOMINAL_TEMPERATURE_C),
        drive_voltage_v: Some(NOMINAL_DRIVE_V),
        ..Burst::default()
    };
    recordings_of(sets(physics, seed), options, common, |part| {
        let physics = physics.clone();
        let ranges = physics.severity_ranges();
        let mut spread = stream(seed, Purpose::Spread, part);
        let mut sensor = Sensor::new(&physics, seed, part);
        move |truth: &Truth, counts: &mut Vec<i16>| {
            let Channel { rates, gain } = Channel::draw(&physics, &mut spread);
            let faulty =
                truth.class.and_then(|i| faults::apply(&ranges[i].0, truth.severity, &rates));
            sensor.sense(&faulty.unwrap_or(rates), gain, NOMINAL_DRIVE_V, counts);
        }
    })
}
