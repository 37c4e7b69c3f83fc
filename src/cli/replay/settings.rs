//! By what a replay judges: the settings, the design, labels and baselines that its options and its
//! settings file name.
//!
//! In: the options ([`Args`]). Out: the settings and the design ([`with_design`]), then what a
//! recording is judged by ([`load`]). Settings that cannot take effect are refused.
//!
//! Settings come from more places than [`Settings::load`] knows: what the design keeps of its
//! training counts as overrides that come before the user's own, and the design's `[detect]`
//! replaces all others.

use super::args::Args;
use crate::cli::account::RUN_NAME;
use crate::cli::acknowledge::ACKNOWLEDGED_NAME;
use crate::cli::effect::{self, Command};
use crate::cli::exit::Failure;
use crate::cli::night::{NIGHT_NAME, PAGE_NAME};
use crate::cli::report_page::ACCOUNT_NAME;
use crate::pipeline::Replay;
use crate::pipeline::resume::means_of;
use crate::settings::{IdentifyMode, Preset, Settings, keys};
use inkling_core::design::Design;
use inkling_core::detect::ThresholdMethod;
use inkling_core::isolate::IsolateMethod;
use inkling_io::baseline_file::BaselineFile;
use inkling_io::journal::{JOURNAL_NAME, Means};
use inkling_io::{design_file, digest, labels_file};
use std::path::{Path, PathBuf};

/// The settings file that is read if no recording is named.
const PIPELINE_TOML: &str = "pipeline.toml";

/// A design, and the digest of its file, by which the journal tells one design from another.
pub type DesignAndDigest = (Design, String);

/// The settings, and the design that they name; `None`: they name none. Settings that the design
/// keeps from its training apply unless the command line says otherwise. So the settings are made
/// twice: once to learn which design they name, and again with what that design keeps.
pub fn with_design(args: &Args) -> Result<(Settings, Option<DesignAndDigest>), Failure> {
    let asked = settings(args, &[])?;
    if !asked.input.design.is_empty() {
        let read = design_file::read(Path::new(&asked.input.design))?;
        return Ok((settings_by(args, &read.0)?, Some(read)));
    }
    // without a design windows give the models, unless somebody asks for what is not there
    let is_asked = args.identify.is_some() || keys(&args.set).any(|key| key == "identify.mode");
    if is_asked && asked.identify.mode == IdentifyMode::Design {
        return Err(Failure::usage(
            "--identify design: there is no design: give --design FILE (`inkling train` makes one)",
        ));
    }
    Ok((asked, None))
}

/// The settings that the command line asks for, without those that the design keeps.
pub fn settings_of(args: &Args) -> Result<Settings, Failure> {
    settings(args, &[])
}

/// The settings together with those that the design keeps from its training. With a preset these
/// are not used: the preset says them all.
fn settings_by(args: &Args, design: &Design) -> Result<Settings, Failure> {
    if args.preset.is_some() || design.chosen.is_empty() {
        return settings(args, &[]);
    }
    // values in TOML syntax, tables in one line
    let in_toml = |value| toml::Value::try_from(value).map_or(String::new(), |v| v.to_string());
    let kept = design.chosen.iter().map(|(key, value)| format!("{key}={}", in_toml(value)));
    settings(args, &kept.collect::<Vec<String>>())
}

/// The settings from file, preset, design and options, from the weakest to the strongest: the
/// settings file, `--preset`, what the design keeps, `--set`, then the options that have a key of
/// their own. `kept`: what the design keeps, as `KEY=VALUE`. A run without any recording is
/// refused.
fn settings(args: &Args, kept: &[String]) -> Result<Settings, Failure> {
    // ./pipeline.toml is only read where no recordings are named
    let here = Path::new(PIPELINE_TOML);
    let file = match &args.config {
        Some(file) => Some(file.as_path()),
        None if args.recordings.is_empty() && here.is_file() => Some(here),
        None => None,
    };

    // of several values for a key the last one wins, so the strongest come last
    let mut overrides = kept.to_vec();
    overrides.extend(args.set.iter().cloned());
    for (option, key, value) in with_keys(args)? {
        let Some(value) = value else { continue };
        // one of the two would have no effect
        if keys(&args.set).any(|set| set == key) {
            return Err(Failure::usage(format!(
                "--set {key}: {option} says that already, and would win: give one of the two"
            )));
        }
        // a list of recordings would stand in every sentence about settings
        if key != RECORDINGS {
            overrides.push(format!("{key}={value}"));
        }
    }
    let preset = args.preset.as_ref().map(|_| Preset::Thesis); // the only one, as clap has checked
    let mut settings = Settings::load(file, preset, &overrides)?;
    if !args.recordings.is_empty() {
        settings.input.recordings.clone_from(&args.recordings);
    }
    if settings.input.recordings.is_empty() {
        return Err(Failure::usage(format!(
            "no recordings: name files, directories or patterns, or run where a {PIPELINE_TOML} \
             names them in {RECORDINGS}"
        )));
    }
    Ok(settings)
}

const RECORDINGS: &str = "input.recordings";

/// The options that have a key of their own, and their values where they are given.
type WithKeys = [(&'static str, &'static str, Option<toml::Value>); 8];

fn with_keys(args: &Args) -> Result<WithKeys, Failure> {
    let path = |path: &Option<PathBuf>| {
        let text = path.as_ref().map(|path| {
            let what = "a name that is not UTF-8, which cannot be kept in results: rename it";
            let wrong = || Failure::usage(format!("{}: {what}", path.display()));
            path.to_str().map(toml::Value::from).ok_or_else(wrong)
        });
        text.transpose()
    };
    let word = |word: &Option<String>| word.as_deref().map(toml::Value::from);
    let recordings = Some(&args.recordings).filter(|all| !all.is_empty());
    Ok([
        ("--out", "output.dir", path(&args.out)?),
        ("--design", "input.design", path(&args.design)?),
        ("--baseline", "input.baseline", path(&args.baseline)?),
        ("--pace", "replay.pace", args.pace.and_then(|pace| toml::Value::try_from(pace).ok())),
        ("--identify", "identify.mode", word(&args.identify)),
        ("--layout", "output.layout", word(&args.layout)),
        ("--threads", "replay.threads", args.threads.map(|n| i64::from(n).into())),
        ("the command line", RECORDINGS, recordings.map(|all| all.clone().into())),
    ])
}

/// Reads labels and baselines, and puts the means of judging together. `read`: the design, if there
/// is one; its settings of detection replace those of the command line. Returns how to judge, the
/// baseline file with `--baseline`, and for the journal the means in digests.
pub fn load(
    mut settings: Settings,
    read: Option<DesignAndDigest>,
    args: &Args,
) -> Result<(Replay, Option<BaselineFile>, Means), Failure> {
    let (design, design_digest) = read.unzip();
    if let Some(design) = &design {
        // models identified on windows must detect as the design does
        let mut keys = keys(&args.set);
        let is_given =
            args.preset.is_some() || keys.any(|key| key.split('.').next() == Some("detect"));
        if is_given && settings.detect != design.detect {
            return Err(Failure::usage(format!(
                "{}: its detection was fixed when it was trained; detect.* by --set or --preset has no \
                 effect beside it: train again with the same --set or --preset, or leave it out",
                settings.input.design
            )));
        }
        settings.detect = design.detect.clone();
    }
    check(&settings, args, design.as_ref())?;

    // labels that say which signals of windows are healthy; the digest tells later runs whether
    // they changed
    let labels_path =
        Some(&settings.identify.labels).filter(|path| !path.is_empty()).map(Path::new);
    let labels = labels_path.map(labels_file::read).transpose()?;
    let labels_digest = labels_path.map(|path| {
        let digest = digest::of_file(path, |_| Ok::<_, std::io::Error>(()));
        digest.map_err(|e| Failure::new(format!("{}: {e}", path.display())))
    });
    let labels_digest = labels_digest.transpose()?;

    // a baseline file of another design, or one that is not there yet, gives empty baselines
    let (baseline_file, baselines) = match settings.input.baseline.as_str() {
        "" => (None, None),
        path if Path::new(path)
            .file_name()
            .is_some_and(|name| OF_RUNS.iter().any(|of| name == *of)) =>
        {
            return Err(Failure::usage(format!(
                "input.baseline = {path:?}: runs write a file of that name themselves; give the state another one"
            )));
        }
        path => BaselineFile::read(Path::new(path), design_digest.as_deref())
            .map(|(file, baselines)| (Some(file), Some(baselines)))?,
    };
    let replay =
        Replay { settings, design, design_digest, labels, baselines, replaced: Vec::new() };
    let means = means_of(&replay, labels_digest);
    Ok((replay, baseline_file, means))
}

/// What runs write beside the results, and no state.
const OF_RUNS: [&str; 6] =
    [RUN_NAME, ACCOUNT_NAME, NIGHT_NAME, PAGE_NAME, ACKNOWLEDGED_NAME, JOURNAL_NAME];

/// Checks that the settings fit the design and its classes. What cannot take effect is refused,
/// since whoever set it expects an effect.
fn check(settings: &Settings, args: &Args, design: Option<&Design>) -> Result<(), Failure> {
    check_declared(settings, design)?;
    let classes = design.map(Design::class_names).unwrap_or_default();
    effect::check(&args.set, settings, Command::Replay(design))?;
    check_threshold(settings, design)?;
    if let Some(design) = design.filter(|_| !classes.is_empty()) {
        design.check_method(settings.isolate.method).map_err(Failure::usage)?;
    }
    settings.report.check_actions(classes.iter().map(String::as_str)).map_err(Failure::usage)?;
    if settings.isolate.method == IsolateMethod::Posterior {
        settings.isolate.prior_weights(&classes).map_err(Failure::usage)?;
    }
    Ok(())
}

/// Refuses own classes that the design does not have: only training makes classes.
fn check_declared(settings: &Settings, design: Option<&Design>) -> Result<(), Failure> {
    let of_design = design.map(|design| design.classes.as_slice()).unwrap_or_default();
    let mut declared = settings.isolate.classes.iter();
    let is_new = |(name, of): &(&String, &Vec<String>)| {
        !of_design.iter().any(|class| class.name == **name && class.of == **of)
    };
    let Some((name, _)) = declared.find(is_new) else { return Ok(()) };
    let [why, what] = match design {
        Some(_) => ["the design was trained without it", "train again with these settings"],
        None => ["there is no design", "train with these settings, then give the design"],
    };
    Err(Failure::usage(format!(
        "isolate.classes.\"{name}\": {why}, and only training makes classes: {what}"
    )))
}

/// Refuses the threshold `max` for windows without labels: the largest statistic of a window is then perhaps
/// that of a faulty channel.
fn check_threshold(settings: &Settings, design: Option<&Design>) -> Result<(), Failure> {
    // with labels, or with a design's own threshold, only healthy signals count
    let is_max = settings.detect.threshold == ThresholdMethod::Max;
    let by_windows = design.is_none() || settings.identify.mode == IdentifyMode::Windows;
    if !is_max || !by_windows || !settings.identify.labels.is_empty() {
        return Ok(());
    }
    let design = match design {
        Some(_) => "judge by the design's own threshold (--identify design), ",
        None => "train a design on labelled recordings with the same settings, ",
    };
    Err(Failure::usage(format!(
        "detect.threshold = \"max\": the largest statistic of a healthy window, and nobody says who is healthy in it: a \
         faulty channel's own would be the threshold. {design}say who is healthy (--set identify.labels=labels.csv), or \
         take --set detect.threshold=quantile"
    )))
}

/// How a design in memory is to judge by these arguments: for bursts in memory (`cli/called.rs`),
/// where nothing is planned or written. The recordings that `args` names are not read.
pub fn judging(args: Args, read: DesignAndDigest) -> Result<Replay, Failure> {
    let mut settings = settings_by(&args, &read.0)?;
    settings.input.design = "the design".into(); // what sentences call it
    Ok(load(settings, Some(read), &args)?.0)
}
