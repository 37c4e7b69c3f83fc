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
    Identify,
    Critique,
}

impl Command<'_> {
    fn in_words(self) -> &'static str {
        match self {
            Command::Replay(None) => "`inkling replay` without --design",
            Command::Replay(Some(_)) => "`inkling replay` by this design",
            Command::Train => "`inkling train`",
            Command::Identify => "`inkling identify`",
            Command::Critique => "`inkling critique`",
        }
    }

    /// Whether faults are named, or a design is trained that names them.
    fn names(self) -> bool {
        match self {
            Command::Replay(by) => by.is_some_and(|design| !design.class_names().is_empty()),
            Command::Train | Command::Critique => true,
            Command::Identify => false,
        }
    }
}

/// Refuses the first key of `set` (KEY=VALUE each) that the command does not read. `settings`: those with all
/// of `set` applied, as the method that one key chooses decides whether another key is read; for `replay`
/// their `[detect]` is the design's if there is a design.
pub fn check(set: &[String], settings: &Settings, command: Command) -> Result<(), Failure> {
    let mut unread = keys(set).filter_map(|key| Some((unread(&key, settings, command)?, key)));
    let Some((by, key)) = unread.next() else { return Ok(()) };
    let (all, command) = (serde_json::to_value(settings).unwrap_or_default(), command.in_words());
    let what = match by {
        None => format!("on {command}: leave it out"),
        Some(by) => {
            let value = all.pointer(&format!("/{}", by.replace('.', "/"))).unwrap_or_default();
            format!("on {command} with {by} = {value}: leave it out, or change that")
        }
    };
    Err(Failure::usage(format!("--set {key}: has no effect here, {what}")))
}

/// `None`: the command reads the key. Else the setting of which another value would have it read; none if the
/// command or the design alone decides. The order of the cases matters: the first that fits decides, and the
/// last ones are what is left of a section or of a command.
fn unread(key: &str, settings: &Settings, command: Command) -> Option<Option<&'static str>> {
    use Command::{Identify, Replay, Train};
    use Denominator::{Eigenvalues, Resonance};
    use IsolateMethod::{Neighbours, Posterior, ResidualMatching};
    const NEVER: Option<Option<&str>> = Some(None);
    let unless = |is_read: bool, by: &'static str| (!is_read).then_some(Some(by));
    // `section.name` decides, whatever follows it (`isolate.priors.SDN`); the name is empty where the key is
    // a whole section
    let (section, rest) = key.split_once('.').unwrap_or((key, ""));
    let name = rest.split('.').next().unwrap_or_default();
    let (isolate, detect) = (settings.isolate.method, &settings.detect);
    let by_max = detect.threshold == ThresholdMethod::Max;
    let is_sensitivity = detect.method == DetectMethod::Sensitivity;
    match (section, name, command) {
        ("isolate", _, _) if !command.names() => NEVER,
        // A replay has what came of these in its design; it compares `isolate.classes` with the design's itself.
        (
            "isolate",
            "pulse_s" | "waveform" | "delay_s" | "guess_sd" | "unlabelled_classes" | "physics",
            Replay(_),
        ) => NEVER,
        ("isolate", "signal", Replay(_)) => {
            unless(matches!(isolate, ResidualMatching | Neighbours), "isolate.method")
        }
        ("isolate", "neighbours", Replay(_)) => unless(isolate == Neighbours, "isolate.method"),
        ("isolate", "priors", Replay(_))
        | ("isolate", "waveform" | "pulse_s" | "delay_s", Train) => {
            unless(isolate == Posterior, "isolate.method")
        }
        // What only judging reads is accepted in training, so that all three commands can be given the same --set.
        ("isolate", ..) => None,

        ("detect", _, Identify) => NEVER,
        // with a design `replay` itself compares these settings with the design's, and accepts equal ones
        ("detect", _, Replay(Some(_))) => None,
        // Without labelled faults no filter can be learned from them. A filter then serves detection alone; in
        // training its residuals can also serve isolation, whatever detects.
        ("detect", "denominator", Replay(_)) if detect.denominator != Resonance => NEVER,
        ("detect", "oscillations" | "oscillations_of_ring" | "other_poles_per_s", Replay(_))
            if is_sensitivity =>
        {
            Some(Some("detect.method"))
        }
        ("detect", "oscillations" | "oscillations_of_ring", _) => {
            unless(detect.denominator != Eigenvalues, "detect.denominator")
        }
        // this filter is not made for one fault
        ("detect", "fault", _) => unless(detect.denominator != Resonance, "detect.denominator"),
        ("detect", "mu", _) => unless(by_max, "detect.threshold"),
        ("detect", "false_alarm_rate" | "confidence", _) => unless(!by_max, "detect.threshold"),
        ("detect", ..) => None,

        // With --baseline what channels have in common is followed anyway. A common change is measured along the
        // sensitivities of the ring, and an extension's decay and covariates may hold it already. `false` only says
        // what then happens anyway, and passes.
        ("identify", "common_change", Replay(design)) => match settings.input.baseline.as_str() {
            "" if !settings.identify.common_change => None,
            "" if design.is_some_and(|of| of.extension.is_some()) => NEVER,
            "" => unless(is_sensitivity, "detect.method"),
            _ => Some(Some("input.baseline")),
        },
        ("output", "weights", Replay(_)) if !command.names() => NEVER,
        (_, _, Replay(_)) => None,
        ("input", "" | "rails" | "dialect", _) => None,
        ("identify", "" | "grey_box" | "geometry", _) => None,
        ("identify", "least_agreeing", Identify) => None,
        _ => NEVER,
    }
}
