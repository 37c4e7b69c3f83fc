//! Refuses settings given by `--set` that cannot take effect, and says what may decide on it: whoever sets
//! something expects it to do something. Settings files are not checked in this way, as one file serves every
//! command, and so holds settings that the command at hand does not read.
//!
//! In: the keys given by `--set`, the settings, and the command. Out: a failure of usage for the first key
//! that is not read. `replay` is checked once its design has been read, the other commands before they read a
//! recording.
//!
//! [`unread`] states what the code of the commands reads; who adds a setting, or reads one in another
//! command, changes it there.

use super::exit::Failure;
use crate::settings::{Settings, keys};
use inkling_core::design::Design;
use inkling_core::detect::{Denominator, DetectMethod, ThresholdMethod};
use inkling_core::isolate::IsolateMethod;

/// The command whose settings are checked, with what decides which of them it reads.
#[derive(Clone, Copy)]
pub enum Command<'a> {
    /// By a design, if there is one. It has been trained with a `[detect]` of its own, which replaces that of the
    /// settings, and only a design can have fault classes to name.
    Replay(Option<&'a Design>),
    Train,
    /// Whether it also computes which faults could be detected (`--detectability`), and so reads some of `[detect]`.
    Identify(bool),
    Critique,
}

impl Command<'_> {
    fn in_words(self) -> &'static str {
        match self {
            Command::Replay(None) => "`inkling replay` without --design",
            Command::Replay(Some(_)) => "`inkling replay` by this design",
            Command::Train => "`inkling train`",
            Command::Identify(false) => "`inkling identify` without --detectability",
            Command::Identify(true) => "`inkling identify --detectability`",
            Command::Critique => "`inkling critique`",
        }
    }

    /// Whether faults are named, or a design is trained that names them.
    fn names(self) -> bool {
        match self {
            Command::Replay(by) => by.is_some_and(|design| !design.class_names().is_empty()),
            Command::Train | Command::Critique => true,
            Command::Identify(_) => false,
        }
    }
}

/// Refuses the first key of `set` (KEY=VALUE each) that the command does not read. `settings`: those with all
/// of `set` applied, as the method that one key chooses decides whether another key is read; for `replay`
/// their `[detect]` is the design's if there is a design.
pub fn check(set: &[String], settings: &Settings, command: Command) -> Result<(), Failure> {
    let mut unread = keys(set).filter_map(|key| Some((unread(&key, settings, command)?, key)));
    let Some((decide, key)) = unread.next() else { return Ok(()) };
    let all = serde_json::to_value(settings).unwrap_or_default();
    let value = |key: &str| all.pointer(&format!("/{}", key.replace('.', "/"))).cloned();
    let each = |key: &&str| format!("{key} = {}", value(key).unwrap_or_default());
    let with = decide.iter().map(each).collect::<Vec<_>>().join(" and ");
    let command = command.in_words();
    let what = match decide.is_empty() {
        true => format!("on {command}: leave it out"),
        false => format!("on {command} with {with}: leave it out, or change that"),
    };
    Err(Failure::usage(format!("--set {key}: has no effect here, {what}")))
}

/// `None`: the command reads the key. Else the settings of which another value would have it read; none if the
/// command or the design alone decides. The order of the cases matters: the first that fits decides, and the
/// last ones are what is left of a section or of a command.
fn unread(key: &str, settings: &Settings, command: Command) -> Option<&'static [&'static str]> {
    use Command::{Identify, Replay, Train};
    use Denominator::{Eigenvalues, Resonance};
    use IsolateMethod::{ModelMatching, Neighbours, Posterior, ResidualMatching};
    const NO_SETTING: &[&str] = &[];
    const BY_ISOLATION: &[&str] = &["isolate.method"];
    const BY_DENOMINATOR: &[&str] = &["detect.denominator"];
    let unless = |is_read: bool, decide| (!is_read).then_some(decide);
    // `section.name` decides, whatever follows it (`isolate.priors.SDN`); the name is empty where the key is
    // a whole section
    let (section, rest) = key.split_once('.').unwrap_or((key, ""));
    let name = rest.split('.').next().unwrap_or_default();
    let (isolate, detect) = (settings.isolate.method, &settings.detect);
    let by_max = detect.threshold == ThresholdMethod::Max;
    match (section, name, command) {
        ("isolate", _, _) if !command.names() => Some(NO_SETTING),
        // A replay has what came of these in its design; it compares `isolate.classes` with the design's itself.
        (
            "isolate",
            "matching_share" | "pulse_s" | "waveform" | "delay_s" | "guess_sd"
            | "unlabelled_classes" | "physics",
            Replay(_),
        ) => Some(NO_SETTING),
        ("isolate", "signal", Replay(_)) => {
            unless(matches!(isolate, ResidualMatching | Neighbours), BY_ISOLATION)
        }
        ("isolate", "neighbours", Replay(_)) => unless(isolate == Neighbours, BY_ISOLATION),
        ("isolate", "priors", Replay(_)) => unless(isolate == Posterior, BY_ISOLATION),
        ("isolate", "matching_share", Train) => unless(isolate == ModelMatching, BY_ISOLATION),
        ("isolate", "waveform" | "pulse_s" | "delay_s", Train) => {
            unless(isolate == Posterior, BY_ISOLATION)
        }
        // What only judging reads is accepted in training, so that all three commands can be given the same --set.
        ("isolate", ..) => None,

        (
            "detect",
            "oscillations"
            | "oscillations_of_ring"
            | "other_poles_per_s"
            | "false_alarm_rate"
            | "confidence",
            Identify(detects),
        ) => unless(detects, NO_SETTING),
        ("detect", _, Identify(_)) => Some(NO_SETTING),
        // with a design `replay` itself compares these settings with the design's, and accepts equal ones
        ("detect", _, Replay(Some(_))) => None,
        // Without labelled faults no filter can be learned from them. A filter then serves detection alone; in
        // training its residuals can also serve isolation, whatever detects.
        ("detect", "denominator", Replay(_)) => unless(detect.denominator == Resonance, NO_SETTING),
        ("detect", "oscillations" | "oscillations_of_ring" | "other_poles_per_s", Replay(_))
            if detect.method == DetectMethod::Sensitivity =>
        {
            Some(&["detect.method"])
        }
        ("detect", "oscillations" | "oscillations_of_ring", _) => {
            unless(detect.denominator != Eigenvalues, BY_DENOMINATOR)
        }
        // this filter is not made for one fault
        ("detect", "fault", _) => unless(detect.denominator != Resonance, BY_DENOMINATOR),
        ("detect", "mu", _) => unless(by_max, &["detect.threshold"]),
        ("detect", "false_alarm_rate" | "confidence", _) => unless(!by_max, &["detect.threshold"]),
        ("detect", ..) => None,

        // With --baseline what channels have in common is followed anyway. A common change is measured along the
        // sensitivities of the ring, and an extension's decay and covariates may hold it already. `false` only says
        // what then happens anyway, and passes.
        ("identify", "common_change", Replay(_)) if !settings.input.baseline.is_empty() => {
            Some(&["input.baseline"])
        }
        ("identify", "common_change", Replay(_)) if !settings.identify.common_change => None,
        ("identify", "common_change", Replay(Some(design))) if design.extension.is_some() => {
            Some(NO_SETTING)
        }
        ("identify", "common_change", Replay(_)) => {
            unless(detect.method == DetectMethod::Sensitivity, &["detect.method"])
        }
        ("output", "weights", Replay(_)) => unless(command.names(), NO_SETTING),
        (_, _, Replay(_)) => None,
        ("input", "" | "rails" | "dialect", _) => None,
        ("identify", "" | "grey_box" | "geometry", _) => None,
        ("identify", "least_agreeing", Identify(_)) => None,
        _ => Some(NO_SETTING),
    }
}
