//! Refuses settings given by `--set` that cannot take effect, and says which command, method or option they
//! belong to: whoever sets something expects it to do something. Settings files are not checked in this way,
//! as one file serves every command, and so holds settings that the command at hand does not read.
//!
//! In: the keys given by `--set`, the settings, and the command. Out: a failure of usage for the first key
//! that is not read. `replay` is checked once its design has been read, the other commands before they read a
//! recording.
//!
//! The rules (`why_unread`) state what the code of the commands reads; who adds a setting, or reads
//! one in another command, changes them here.

use super::exit::Failure;
use crate::settings::{Settings, keys};
use inkling_core::design::{Design, DetectSettings};
use inkling_core::detect::{Denominator, DetectMethod, ThresholdMethod};
use inkling_core::isolate::IsolateMethod;

/// The command whose settings are checked, with what decides which of them it reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// `detects`: whether it detects as `[detect]` says: without a design. A design has been trained with a
    /// `[detect]` of its own, which replaces this one. `names`: whether there are fault classes to name,
    /// which only a design holds.
    Replay {
        detects: bool,
        names: bool,
    },
    Train,
    /// `detects`: whether it also computes which faults could be detected (`--detectability`), and so reads
    /// some of `[detect]`.
    Identify {
        detects: bool,
    },
    Critique,
}

/// Whether channels are judged about what all channels of a printhead have in common. For `replay`
/// [`check_common_change`] decides whether that has an effect, and not [`why_unread`], as it depends on the
/// design, too.
const COMMON_CHANGE: &str = "identify.common_change";

/// Settings of `[isolate]` that are read where a design is trained, by `train` and by a critique; `replay`
/// has what came of them in its design. `isolate.classes` is not among them: `replay` itself compares it with
/// the design's.
const OF_TRAINING: [&str; 7] = [
    "matching_share",
    "pulse_s",
    "waveform",
    "delay_s",
    "guess_sd",
    "unlabelled_classes",
    "physics",
];

/// Settings of `[detect]` that `identify --detectability` reads.
const OF_DETECTABILITY: [&str; 5] =
    ["oscillations", "oscillations_of_ring", "other_poles_per_s", "false_alarm_rate", "confidence"];

/// Refuses the first key of `set` (KEY=VALUE each) that the command does not read. `settings`: those with all
/// of `set` applied, as the method that one key chooses decides whether another key is read.
pub fn check(set: &[String], settings: &Settings, command: Command) -> Result<(), Failure> {
    for key in keys(set) {
        if let Some(why) = why_unread(&key, settings, command) {
            return Err(Failure::usage(format!("--set {key}: has no effect here: {why}")));
        }
    }
    Ok(())
}

/// Refuses `identify.common_change` given by `--set` to `replay` if it has no effect. Beside `--baseline` no
/// value has: the head's level is followed in any case. Elsewhere `true` has none where the model cannot
/// follow a common change of all channels, which is measured along the sensitivities of the ring; `false`
/// only says what then happens anyway, and passes. `settings`: those of `replay`, their `[detect]` being the
/// design's if there is a design.
pub fn check_common_change(
    set: &[String],
    settings: &Settings,
    design: Option<&Design>,
) -> Result<(), Failure> {
    if !keys(set).any(|key| key == COMMON_CHANGE) {
        return Ok(());
    }
    let (value, why) = match settings.detect.method {
        _ if !settings.input.baseline.is_empty() => (
            "",
            "with --baseline what all channels have in common is followed anyway, and kept in that file",
        ),
        _ if !settings.identify.common_change => return Ok(()),
        // the extension's decay and covariates may hold the same change already
        _ if design.is_some_and(|design| design.extension.is_some()) => {
            ("=true", "the design has a critique's extension, which is not moved")
        }
        DetectMethod::Sensitivity => return Ok(()),
        _ => ("=true", "it needs detect.method = \"sensitivity\""),
    };
    Err(Failure::usage(format!("--set {COMMON_CHANGE}{value}: has no effect here: {why}")))
}

/// Why a command does not read a key; `None` if it does. The order of the cases matters: the first that fits
/// decides, and the last ones are what is left of a section or of a command.
fn why_unread(key: &str, settings: &Settings, command: Command) -> Option<&'static str> {
    // `section.name` decides, whatever follows it (`isolate.priors.SDN`); the name is empty where the key is
    // a whole section
    let (section, rest) = key.split_once('.').unwrap_or((key, ""));
    let name = rest.split('.').next().unwrap_or_default();
    let isolation = settings.isolate.method;
    match (section, command) {
        ("isolate", Command::Replay { names: false, .. }) => {
            Some("without a design with fault classes nothing is named; give --design")
        }
        ("isolate", Command::Replay { .. }) if OF_TRAINING.contains(&name) => {
            Some("it is part of the design; train with it")
        }
        ("isolate", Command::Replay { .. }) => by_isolation(name, isolation),
        ("isolate", Command::Train) if OF_TRAINING.contains(&name) => by_isolation(name, isolation),
        // A critique trains a design with these settings. Settings that only judging reads are
        // accepted here, so that the same --set can be given to all three commands.
        ("isolate", Command::Critique | Command::Train) => None,
        ("detect", Command::Replay { detects: true, .. }) => {
            without_labels(name, &settings.detect).or_else(|| by_detection(name, &settings.detect))
        }
        // with a design `replay` itself compares these settings with the design's, and accepts equal ones
        ("detect", Command::Replay { .. }) => None,
        ("detect", Command::Identify { detects: true }) if OF_DETECTABILITY.contains(&name) => None,
        ("detect", Command::Identify { .. }) => Some(
            "`identify` detects nothing; with --detectability it reads oscillations, oscillations_of_ring, other_poles_per_s, false_alarm_rate and confidence",
        ),
        // `train`, and the design that a critique trains
        ("detect", _) => by_detection(name, &settings.detect),
        ("report", Command::Replay { .. }) if matches!(name, "rows" | "pitch") => {
            Some("it is of `inkling report` alone")
        }
        ("output", Command::Replay { names: false, .. }) if name == "weights" => {
            Some("without a design with fault classes there are no weights; give --design")
        }
        // every command reads these
        ("input", _) if matches!(name, "" | "rails" | "dialect") => None,
        // `replay` reads all that is left, the others read some of `[identify]` and nothing else
        (_, Command::Replay { .. }) => None,
        ("identify", _) if matches!(name, "" | "grey_box" | "geometry") => None,
        ("identify", Command::Identify { .. }) if name == "least_agreeing" => None,
        ("identify", Command::Identify { .. }) => {
            Some("one model is identified, on all that is healthy")
        }
        ("identify", _) => Some("healthy windows are of `inkling replay` alone"),
        ("isolate", Command::Identify { .. }) => Some("`identify` names nothing"),
        _ => Some("it is of `inkling replay` and `report`"),
    }
}

/// Why a setting of `[detect]` has no effect in a replay without a design; `None` if it has one. No faults
/// are labelled there, so no filter can be learned from them; and nothing is named, so that a filter serves
/// detection alone, and only by a method that uses its residual. In training the filter's residuals can also
/// serve isolation, whatever detects.
fn without_labels(name: &str, detect: &DetectSettings) -> Option<&'static str> {
    let has_residual = !matches!(detect.method, DetectMethod::Sensitivity | DetectMethod::Practice);
    match name {
        "denominator" if detect.denominator != Denominator::Resonance => {
            Some("that filter is learned from labelled faults; `inkling train` with it")
        }
        "oscillations" | "oscillations_of_ring" | "other_poles_per_s" if !has_residual => {
            Some("it is of detect.method = \"residual-energy\" and \"residual-maximum\" alone")
        }
        _ => None,
    }
}

/// Why a setting of `[detect]` is not read beside the chosen denominator of the FD filter, or the chosen kind
/// of threshold; `None` if it is.
fn by_detection(name: &str, detect: &DetectSettings) -> Option<&'static str> {
    use Denominator::{Eigenvalues, Resonance, Searched};
    let is_max = detect.threshold == ThresholdMethod::Max;
    match (name, detect.denominator) {
        ("oscillations" | "oscillations_of_ring", Eigenvalues | Searched) => Some(
            "it is of detect.denominator = \"resonance\", \"enhanced\", \"lp\" and \"appendix-a\" alone",
        ),
        ("fault", Resonance | Searched) => Some(
            "it is of detect.denominator = \"eigenvalues\", \"enhanced\", \"lp\" and \"appendix-a\" alone, which are made \
             for one fault",
        ),
        ("mu", _) if !is_max => Some("it is of detect.threshold = \"max\" alone"),
        ("false_alarm_rate" | "confidence", _) if is_max => {
            Some("it is of detect.threshold = \"quantile\" alone")
        }
        _ => None,
    }
}

/// Why a setting of `[isolate]` is not read beside the chosen method of isolation; `None` if it is.
fn by_isolation(name: &str, method: IsolateMethod) -> Option<&'static str> {
    use IsolateMethod::{ModelMatching, Neighbours, Posterior, ResidualMatching};
    match name {
        "signal" if ![ResidualMatching, Neighbours].contains(&method) => {
            Some("it is of isolate.method = \"residual-matching\" and \"neighbours\" alone")
        }
        "neighbours" if method != Neighbours => {
            Some("it is of isolate.method = \"neighbours\" alone")
        }
        "matching_share" if method != ModelMatching => {
            Some("it is of isolate.method = \"model-matching\" alone")
        }
        "priors" | "waveform" | "pulse_s" | "delay_s" if method != Posterior => {
            Some("it is of isolate.method = \"posterior\" alone")
        }
        _ => None,
    }
}
