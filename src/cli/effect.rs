//! Refuses settings given by `--set` that cannot take effect, with what to do instead. Settings files are not
//! checked in this way, as a file serves every command and may hold settings that this one does not read.

use super::exit::Failure;
use crate::settings::{Settings, keys};
use inkling_core::design::{Design, DetectSettings};
use inkling_core::detect::{Denominator, DetectMethod, ThresholdMethod};
use inkling_core::isolate::IsolateMethod;

/// The command whose settings are checked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// `detects`: whether it detects by the settings, as there is no design. `names`: whether there is a
    /// design with classes.
    Replay {
        detects: bool,
        names: bool,
    },
    Train,
    /// `detects`: whether it tells what a filter would see (`--detectability`).
    Identify {
        detects: bool,
    },
    Critique,
}

const COMMON_CHANGE: &str = "identify.common_change";

/// Settings of `[isolate]` that only training reads.
const OF_TRAINING: [&str; 7] = [
    "matching_share",
    "pulse_s",
    "waveform",
    "delay_s",
    "guess_sd",
    "unlabelled_classes",
    "physics",
];

/// Refuses the first key of `set` (KEY=VALUE) that the command does not read. `settings`: the settings with
/// all of `set` applied.
pub fn check(set: &[String], settings: &Settings, command: Command) -> Result<(), Failure> {
    for key in keys(set) {
        if let Some(why) = why_unread(key, settings, command) {
            return Err(Failure::usage(format!("--set {key}: has no effect here: {why}")));
        }
    }
    Ok(())
}

/// Refuses `identify.common_change` given by `--set` if it has no effect: a common change of all channels can
/// only be seen through the sensitivities of a ring. `settings`: the settings with the design's detection.
pub fn check_common_change(
    set: &[String],
    settings: &Settings,
    design: Option<&Design>,
) -> Result<(), Failure> {
    if !keys(set).any(|key| key == COMMON_CHANGE) {
        return Ok(());
    }
    if !settings.input.baseline.is_empty() {
        return Err(Failure::usage(format!(
            "--set {COMMON_CHANGE}: has no effect here: with --baseline what all channels have in common is \
             followed anyway, and kept in that file"
        )));
    }
    if !settings.identify.common_change {
        return Ok(());
    }
    let why = match settings.detect.method {
        _ if design.is_some_and(|design| design.extension.is_some()) => {
            "the design has a critique's extension, which is not moved"
        }
        DetectMethod::Sensitivity => return Ok(()),
        _ => "it needs detect.method = \"sensitivity\"",
    };
    Err(Failure::usage(format!("--set {COMMON_CHANGE}=true: has no effect here: {why}")))
}

/// Why a command does not read a key; `None` if it does. The order of the cases matters: the first that fits
/// decides.
fn why_unread(key: &str, settings: &Settings, command: Command) -> Option<&'static str> {
    // section.name, where deeper parts of the key do not matter
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
        // a critique trains a design with these settings, and one line of settings may serve training and
        // judging alike
        ("isolate", Command::Critique) => None,
        ("isolate", Command::Train) => match name {
            "matching_share" if isolation != IsolateMethod::ModelMatching => {
                Some("it is of isolate.method = \"model-matching\" alone")
            }
            "waveform" | "pulse_s" | "delay_s" if isolation != IsolateMethod::Posterior => {
                Some("it is of isolate.method = \"posterior\" alone")
            }
            _ => None,
        },
        ("detect", Command::Replay { detects: true, .. }) => {
            without_labels(name, &settings.detect).or_else(|| by_detection(name, &settings.detect))
        }
        // with a design `replay` itself compares these settings with the design's, and accepts equal ones
        ("detect", Command::Replay { .. }) => None,
        ("detect", Command::Identify { detects }) => match name {
            "oscillations"
            | "oscillations_of_ring"
            | "other_poles_per_s"
            | "false_alarm_rate"
            | "confidence"
                if detects =>
            {
                None
            }
            _ => Some(
                "`identify` detects nothing; with --detectability it reads oscillations, other_poles_per_s, false_alarm_rate and confidence",
            ),
        },
        ("detect", _) => by_detection(name, &settings.detect),
        ("report", Command::Replay { .. }) if matches!(name, "rows" | "pitch") => {
            Some("it is of `inkling report` alone")
        }
        ("output", Command::Replay { names: false, .. }) if name == "weights" => {
            Some("without a design with fault classes there are no weights; give --design")
        }
        ("input", _) if matches!(name, "" | "rails" | "dialect") => None,
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

/// Settings of `[detect]` without effect in a replay without a design, where no faults are labelled.
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

/// Settings of `[detect]` that the chosen denominator or threshold does not read.
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

/// Settings of `[isolate]` that the chosen method does not read.
fn by_isolation(name: &str, method: IsolateMethod) -> Option<&'static str> {
    use IsolateMethod::{Neighbours, Posterior, ResidualMatching};
    match name {
        "signal" if ![ResidualMatching, Neighbours].contains(&method) => {
            Some("it is of isolate.method = \"residual-matching\" and \"neighbours\" alone")
        }
        "neighbours" if method != Neighbours => {
            Some("it is of isolate.method = \"neighbours\" alone")
        }
        "priors" if method != Posterior => Some("it is of isolate.method = \"posterior\" alone"),
        _ => None,
    }
}
