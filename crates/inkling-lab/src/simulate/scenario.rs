//! Scenario files: one struct for each table of the TOML file, with the file's names and units.
//! `scenario/read.rs` makes a [`Scenario`] from TOML, and `scenario/checks.rs` makes sure that it can be
//! simulated.
//!
//! There are two kinds: `physics` (default; channels of thesis (2-2), faults, print runs) and `classes` (the
//! data set of thesis §4-1). `_us` in a name means microseconds, `_c` degrees Celsius, `_v` volts.

mod checks;
mod read;

pub(super) use checks::require;

use inkling_core::burst::Compression;
use inkling_core::fault::CLASSES;
use inkling_core::model::{Actuation, InkChannel, Waveform};
use serde::{Deserialize, Deserializer, Serialize};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Version (`schema`) of the scenario files that this program reads.
const SCHEMA: i64 = 1;

#[derive(Debug, thiserror::Error)]
pub enum ScenarioError {
    #[error("the scenario is not readable:\n{0}")]
    Toml(#[from] toml::de::Error),
    #[error("the scenario has schema {found}, this program reads `schema = 1`")]
    Schema { found: String },
    #[error("`{key}`: {why}")]
    Value { key: String, why: String },
}

impl ScenarioError {
    pub(super) fn value(key: &str, why: impl Into<String>) -> ScenarioError {
        ScenarioError::Value { key: key.to_owned(), why: why.into() }
    }
}

/// A scenario that was checked.
#[derive(Clone, Debug)]
pub struct Scenario {
    /// The seed that the file asks for; a caller may use another.
    pub seed: Option<u64>,
    pub recording: RecordingOptions,
    pub kind: Kind,
}

/// What a scenario simulates. Shared by pointer, since each recording that is being made keeps a copy.
#[derive(Clone, Debug)]
pub enum Kind {
    Physics(Arc<Physics>),
    Classes(Arc<Classes>),
}

/// `[recording]`: how a recording is written, and when it begins. It never changes the samples themselves.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RecordingOptions {
    pub compression: Compression,
    /// Time of the first burst, ns since the epoch; the file has `start`, a time in RFC 3339.
    #[serde(rename = "start", deserialize_with = "rfc_3339")]
    pub start_ns: i64,
}

impl Default for RecordingOptions {
    fn default() -> RecordingOptions {
        RecordingOptions {
            compression: Compression::Zstd,
            start_ns: 1_735_718_400_000_000_000, // 2025-01-01T08:00:00Z
        }
    }
}

/// Reads a time in RFC 3339 as ns since the epoch.
fn rfc_3339<'de, D: Deserializer<'de>>(deserializer: D) -> Result<i64, D::Error> {
    let text = String::deserialize(deserializer)?;
    let time = chrono::DateTime::parse_from_rfc3339(&text);
    time.ok().and_then(|t| t.timestamp_nanos_opt()).ok_or_else(|| {
        let example = "\"2025-01-01T08:00:00Z\"";
        serde::de::Error::custom(format!("{text:?} is not an RFC 3339 time such as {example}"))
    })
}

/// `kind = "physics"`: channels of thesis (2-2) and what happens to them.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Physics {
    #[serde(rename = "schema")]
    _schema: i64,
    #[serde(rename = "kind")]
    _kind: Option<String>,
    seed: Option<u64>,
    #[serde(default)]
    recording: RecordingOptions,
    /// Nominal rates at 25 °C.
    pub channel: InkChannel,
    pub spread: Spread,
    pub shot: Shot,
    pub acquisition: Acquisition,
    pub temperature: Temperature,
    pub drive: Drive,
    /// Severities of each fault class that occurs, by the class's name.
    #[serde(default)]
    pub fault: BTreeMap<String, FaultRange>,
    pub dataset: Option<Dataset>,
    pub print_run: Option<PrintRun>,
    /// What a print run records with `simulate --hide`; absent: the default, which records no covariates.
    pub hidden: Option<HiddenRun>,
}

impl Physics {
    /// The fault classes with their ranges, in the thesis's order. A class's index is that in `dataset::Truth`.
    pub fn severity_ranges(&self) -> Vec<(String, [f64; 2])> {
        let range = |class: &&str| Some(((*class).to_owned(), self.fault.get(*class)?.range));
        CLASSES.iter().filter_map(range).collect()
    }
}

/// `[spread]`: how channels differ: relative half-widths of the four rates and of the gain, uniform.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Spread {
    pub a: f64,
    pub b: f64,
    pub g: f64,
    pub d: f64,
    pub gain: f64,
}

/// `[shot]`: how a channel's signals differ from burst to burst: relative standard deviations.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Shot {
    pub gain: f64,
    /// Standard deviation of each component of the acquisition state.
    pub state: f64,
}

/// `[acquisition]`: actuation, sampling and noise.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Acquisition {
    pub pulse_us: f64,
    /// The steps of the pulse: share of `pulse_us` and relative voltage; absent: one rectangle.
    #[serde(default)]
    pub waveform: Waveform,
    /// Time from the end of the pulse to the first sample, at t_a.
    pub delay_us: f64,
    pub sample_period_us: f64,
    pub samples: usize,
    /// Peak of the nominal healthy channel's signal at nominal drive, without noise.
    pub largest_healthy_counts: f64,
    /// Standard deviation of the white noise of a sample.
    pub noise_sd_counts: f64,
}

impl Acquisition {
    pub fn sample_period_s(&self) -> f64 {
        self.sample_period_us * 1e-6
    }

    pub fn actuation(&self) -> Actuation {
        let (pulse_s, delay_s) = (self.pulse_us * 1e-6, self.delay_us * 1e-6);
        Actuation { pulse_s, delay_s, waveform: self.waveform }
    }
}

/// `[temperature]`: ink temperature in print runs, a sine about 25 °C.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Temperature {
    pub swing_c: f64,
    pub period_s: f64,
    /// Relative change of g and d per kelvin above 25 °C.
    pub viscosity_per_k: f64,
}

/// `[drive]`: drive levels, one of which is drawn for each burst, with the probability in `shares`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Drive {
    pub levels_v: Vec<f64>,
    pub shares: Vec<f64>,
}

/// `[fault.CLASS]`: severities of a class, uniform over `range`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FaultRange {
    /// What a severity means and what the fault changes, in words; the simulator does not use them.
    pub severity: Option<String>,
    pub change: Option<String>,
    /// Lowest and highest severity, in the class's unit.
    pub range: [f64; 2],
}

/// `[dataset]`: numbers of signals in the sets.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Dataset {
    /// Healthy signals in the training set, and as many in the test set.
    pub healthy: usize,
    /// Signals of each fault class in the training set, and as many in the test set.
    pub per_fault: usize,
    /// Number of signals, all of them faulty, of a third set for calibration; 0: there is none.
    #[serde(default)]
    pub calibration_test: usize,
}

/// `[print_run]`: printheads, bursts and faults of a run.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PrintRun {
    pub printheads: usize,
    /// A name for each printhead; by default `printhead-1` and so on.
    pub names: Option<Vec<String>>,
    pub channels: usize,
    /// Number of acquisitions of each printhead; every channel is in each of them.
    pub bursts_per_channel: usize,
    pub interval_s: f64,
    /// Share of all channels that get one drawn fault each, 0 to 1.
    #[serde(default)]
    pub faulty_channels: f64,
    /// Faults that the file lists, instead of drawn ones.
    #[serde(default)]
    pub fault: Vec<ExplicitFault>,
}

impl PrintRun {
    /// The name of a printhead, which is given by its number from 0.
    pub fn name(&self, printhead: usize) -> String {
        let own = self.names.as_ref().and_then(|names| names.get(printhead).cloned());
        own.unwrap_or_else(|| format!("printhead-{}", printhead + 1))
    }
}

/// Covariates that a recording with something hidden may hold, in the words of `hidden.recorded`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Recorded {
    Drive,
    Temperature,
    Idle,
    Neighbours,
}

/// `[hidden]`: what a print run records when something is hidden in it (`simulate --hide`).
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HiddenRun {
    pub recorded: Vec<Recorded>,
    /// Times since the previous actuation, drawn for each signal, or that there was none.
    #[serde(default)]
    pub idle_times_us: Vec<f64>,
    /// Healthy scatter from burst to burst in addition to `shot`: relative standard deviations.
    #[serde(default)]
    pub frequency_sd: f64,
    #[serde(default)]
    pub damping_sd: f64,
}

/// `[[print_run.fault]]`: a fault from `from_s` to `to_s` (exclusive), counted from the first burst.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExplicitFault {
    pub printhead: String,
    pub channel: u32,
    pub class: String,
    pub severity: f64,
    /// Severity at `to_s`, reached linearly in time from `severity` at `from_s`; absent: the severity stays.
    pub to_severity: Option<f64>,
    pub from_s: f64,
    pub to_s: f64,
}

/// `kind = "classes"`: sample k of a signal is round(A (e^{-sigma t} cos(2 pi f t + phi0) + rho e^{-lambda
/// t}) + noise) with t = k T/N, where A, sigma, f are uniform in the box of the signal's class
/// (`thesis_form.rs`).
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Classes {
    #[serde(rename = "schema")]
    _schema: i64,
    #[serde(rename = "kind")]
    _kind: Option<String>,
    seed: Option<u64>,
    #[serde(default)]
    recording: RecordingOptions,
    pub comment: Option<String>,
    /// Length of a signal T, and its number of samples N.
    #[serde(rename = "T_us")]
    pub t_us: f64,
    #[serde(rename = "N")]
    pub n: usize,
    /// Phase of the oscillation at t = 0, and amplitude (relative to A) and rate of the slow decay.
    pub phi0_rad: f64,
    pub rho: f64,
    pub lambda_per_s: f64,
    pub noise_sd_counts: f64,
    /// Healthy signals, and signals of each fault class, in the training set, and as many in the test set.
    pub n_healthy: usize,
    pub n_per_fault: usize,
    /// Settings with which the thesis's method I is judged on this set; the simulator does not use them.
    #[serde(rename = "method_I")]
    _method_i: Option<toml::Table>,
    pub classes: ClassBoxes,
}

impl Classes {
    pub fn sample_period_s(&self) -> f64 {
        self.t_us * 1e-6 / self.n as f64
    }

    /// Fault classes and their boxes, the thesis's classes first. A class's index is that in `dataset::Truth`.
    pub fn fault_classes(&self) -> Vec<(String, ClassBox)> {
        let place = |class: &str| CLASSES.iter().position(|c| *c == class).unwrap_or(CLASSES.len());
        let faults = self.classes.faults.iter();
        let mut classes: Vec<_> =
            faults.map(|(name, class)| (name.clone(), class.clone())).collect();
        classes.sort_by_key(|(name, _)| place(name)); // stable, and by name so far
        classes
    }
}

/// The boxes of all classes; fault classes by their names.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct ClassBoxes {
    pub healthy: ClassBox,
    #[serde(flatten)]
    pub faults: BTreeMap<String, ClassBox>,
}

/// The box of a class: the lowest and the highest value of each parameter, which is uniform between them.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClassBox {
    pub amplitude_counts: [f64; 2],
    pub sigma_per_s: [f64; 2],
    pub freq_hz: [f64; 2],
}

#[cfg(test)]
mod tests {
    use super::super::fixtures::{SAMPLE, THESIS, replaced, scenario};
    use super::*;

    #[test]
    fn classes_come_in_the_thesiss_order() {
        let Kind::Classes(classes) = scenario(THESIS).kind else { panic!() };
        let names = classes.fault_classes().into_iter().map(|(name, _)| name);
        assert_eq!(names.collect::<Vec<String>>(), CLASSES);
    }

    #[test]
    fn recording_options_are_read_and_have_defaults() {
        let with =
            |words| scenario(&replaced(SAMPLE, &[("compression = \"zstd\"", words)])).recording;
        assert_eq!(with(""), RecordingOptions::default());
        let all = with("compression = \"lz4\"\nstart = \"1970-01-01T01:00:01+01:00\"");
        let expected = RecordingOptions { compression: Compression::Lz4, start_ns: 1_000_000_000 };
        assert_eq!(all, expected);
    }
}
