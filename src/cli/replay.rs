//! `inkling replay`: judges recordings. This file turns options and settings into a plan and the means of
//! judging; `batch` does the work.
//!
//! In: the options of the command line ([`Args`]), the settings file, the design, labels and
//! baselines that they name, and the journal of earlier runs in the directory of results. Out: the
//! exit status; `batch` writes the results.
//!
//! The order (`judged_by`): everything that can be wrong is checked; the lock is taken; the plan is
//! made (what is judged, what is skipped); what killed runs left is removed; the recordings are
//! judged. So a mistake is told before anything is written. `--dry-run` ends after the plan.
//!
//! Settings come from more places than [`Settings::load`] knows: what the design keeps of its
//! training counts as overrides that come before the user's own, and the design's `[detect]`
//! replaces all others.

use super::account::{Account, RUN_NAME, Row};
use super::batch::Batch;
use super::collected::checked_dialects;
use super::effect::{self, Command};
use super::exit::{Exit, Failure};
use super::follow::{self, FollowJudge};
use super::judge::{Detail, Judge, ReplayJudge, Run};
use super::live;
use super::plan::{self, PlannedRecording, Planner};
use super::progress::{Progress, interruptible};
use crate::pipeline::Replay;
use crate::pipeline::resume::{Resume, means_of};
use crate::settings::{IdentifyMode, Pace, Preset, Settings, keys};
use chrono::DateTime;
use inkling_core::design::Design;
use inkling_core::detect::ThresholdMethod;
use inkling_core::isolate::IsolateMethod;
use inkling_io::baseline_file::BaselineFile;
use inkling_io::file_error::FileError;
use inkling_io::inputs::Input;
use inkling_io::journal::{JOURNAL_NAME, Journal, JournalWriter, Means};
use inkling_io::outputs::{self, ResultFile};
use inkling_io::run_lock::{LOCK_NAME, RunLock, ToJudge};
use inkling_io::{design_file, digest, inputs, labels_file, layout};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The settings file that is read if no recording is named.
const PIPELINE_TOML: &str = "pipeline.toml";
/// The values of `--preset`.
pub const PRESETS: [&str; 1] = ["thesis"];

// The `///` of the fields below are the help text of the options, and no comments.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  inkling replay
      the recordings, the design and the output that ./pipeline.toml names
  inkling replay night.mcap --design design.json --out verdicts
      judged by the design's models as they are
  inkling replay 'logs/2026-*/*.mcap' --design design.json --identify windows
      identified again on each recording's healthy windows, so that slow drift
      is followed
  inkling replay night.mcap --set identify.every=\"5 min\"
      without a design: detected, not named; any setting of pipeline.toml by
      --set

  inkling replay archive/ --design design.json --out verdicts --layout date \\
      --quiet
      every night: what is finished is skipped, journal.jsonl and run.json say
      what became of each
  inkling replay now.mcap --design design.json --follow
      while it is being written: faults as they are found
  inkling replay now.mcap --design design.json --follow --serve 127.0.0.1:8080
      and a page of it in a browser, /metrics for Prometheus, /faults.json
  inkling replay now.mcap --design design.json --follow --rotate 10min
      and every ten minutes a table of the rows so far, to be opened by others

Where recordings are named, ./pipeline.toml is not read unless --config names it.")]
pub struct Args {
    /// Files, directories (searched for *.mcap) or glob patterns
    recordings: Vec<String>,
    /// Where verdicts go [default: verdicts]
    #[arg(short, long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Settings file
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Design, from `inkling train`
    #[arg(long, value_name = "FILE")]
    design: Option<PathBuf>,
    /// Channels' own healthy baselines: read if the file is there, brought up to date at the end;
    /// recordings are then judged in the order of their start times
    #[arg(long, value_name = "FILE")]
    baseline: Option<PathBuf>,
    /// Judge by the design's models as they are, or identify again on healthy windows
    /// [default: design where --design is given, else windows]
    #[arg(long, value_parser = ["design", "windows"])]
    identify: Option<String>,
    /// Any setting of pipeline.toml, repeatable
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Choices that belong together; --set wins over them
    #[arg(long, value_parser = PRESETS)]
    preset: Option<String>,
    /// As fast as possible (max), at the recorded speed (recorded), or so many signals per second [default: max]
    #[arg(long)]
    pace: Option<Pace>,
    /// Workers per parallel stage [default: the machine's cores]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Say where the time went, stage by stage
    #[arg(long)]
    timings: bool,
    /// Where below --out: the tree below a directory is kept, by day of the first burst, flat, or each kind of table
    /// as one data set (verdicts/day=2026-11-01/)
    /// [default: tree]
    #[arg(long, value_parser = ["tree", "date", "flat", "hive"])]
    layout: Option<String>,
    /// Judge again what is finished
    #[arg(long)]
    force: bool,
    /// Exit by what earlier runs told of recordings that are skipped, too: damage is otherwise news once
    #[arg(long)]
    strict: bool,
    /// Say what would be done and why, and do nothing
    #[arg(long)]
    dry_run: bool,
    /// Recognise finished recordings by their content, not by size and time of change
    #[arg(long)]
    verify: bool,
    /// Write `<stem>.annotations.mcap` beside the verdicts: episodes as log lines, a moving picture of each
    /// printhead, faulty channels burst by burst; for Foxglove, Lichtblick and Rerun
    #[arg(long)]
    annotate: bool,
    /// Watch one recording that is being written: tell of episodes as they are raised, until it is closed
    /// or Ctrl-C; then write what any replay of it would
    #[arg(long)]
    follow: bool,
    /// With --follow: put the rows also into parts, `<stem>.parts/00001.parquet` and so on, each closed after so
    /// much recording time (10min, 1h) and from then on a table; they go when the recording is closed
    #[arg(long, value_name = "SPAN", value_parser = follow::span)]
    rotate: Option<Duration>,
    /// With --follow: a page of what is known so far at http://ADDRESS/ (127.0.0.1:8080), /metrics for Prometheus and
    /// /faults.json; other machines are served with a token alone
    #[arg(long, value_name = "ADDRESS")]
    serve: Option<String>,
    /// Who looks must know what is in this file
    #[arg(long, value_name = "FILE")]
    serve_token: Option<PathBuf>,
    /// One JSON line per recording and one for the run, instead of text
    #[arg(long)]
    json: bool,
}

/// Judges recordings in this process: the verb `replay` of the command line.
pub fn run(args: Args) -> Result<Exit, Failure> {
    judged_by(args, None)
}

/// Has recordings judged by other processes that see the same files: the fleet (`fleet/`) calls
/// this with a `judge` that hands recordings out. Those processes decide on their own pace and
/// threads, so `--pace` and `--threads` are refused here, and so is `--follow`.
pub fn run_elsewhere(args: Args, judge: &mut dyn Judge) -> Result<Exit, Failure> {
    let why = "has no effect here: whoever judges the recordings decides on it";
    match (&args.threads, &args.pace, args.follow) {
        (Some(_), ..) => Err(Failure::usage(format!("--threads: {why}"))),
        (_, Some(_), _) => Err(Failure::usage(format!("--pace: {why}"))),
        (.., true) => Err(Failure::usage("--follow: whoever writes the recording is not here")),
        _ => judged_by(args, Some(judge)),
    }
}

/// The whole run: checks everything, plans, and judges. Mistakes in options and settings are found before
/// anything is written. `elsewhere`: who judges the recordings; `None`: this process does.
fn judged_by(args: Args, elsewhere: Option<&mut dyn Judge>) -> Result<Exit, Failure> {
    // 1. settings, options, recordings and places of results: all that may be wrong is looked at
    // first
    let mut account = Account::new(args.strict);
    let (settings, design) = with_design(&args)?;
    if args.follow {
        follow::check(&settings, args.dry_run)?;
    }
    let out = PathBuf::from(&settings.output.dir);
    follow::check_rotation(args.rotate, args.follow, &out)?;
    let serve = live::check(args.serve.as_deref(), args.serve_token.as_deref(), args.follow)?;
    let first = settings.input.recordings[0].clone(); // `settings` refuses a run without one

    // names that lead to no recording do not stop the run: they become rows of the account (`lost`)
    let found = inputs::find_each_recording(&settings.input.recordings)?;
    outputs::check_place(&out)?;
    for (name, kind) in [(RUN_NAME, ResultFile::Account), (JOURNAL_NAME, ResultFile::Journal)] {
        outputs::check_file(&out.join(name), kind)?;
    }

    // the journal says where earlier results lie, and which recordings need not be opened
    let journal_path = out.join(JOURNAL_NAME);
    let unreadable = |e| Failure::new(format!("{}: cannot be read: {e}", journal_path.display()));
    let journal = || Journal::read(&out).map_err(unreadable);
    let before = journal()?;
    let is_known = |input: &Input| !args.force && plan::is_known(input, &before, &settings);
    let dialects = checked_dialects(&settings, &found.inputs, is_known)?;
    let placed = plan::place(found.inputs, settings.output.layout, &before, &dialects);
    layout::refuse_shared(&placed).map_err(Failure::usage)?;

    // `replay`: how to judge; `means`: the same in digests, by which the journal tells what is
    // finished
    let (replay, baseline_file, means) = load(settings, design, &args)?;
    let lost: Vec<Row> = found.lost.iter().map(plan::lost).collect();

    // 2. the lock, which keeps other runs from the same directory
    let control = if args.follow { follow::until_enough() } else { interruptible() };
    let mut lock = match args.dry_run {
        true => None,
        false => Some(RunLock::take(&out).map_err(Failure::new)?),
    };
    // the journal is read again, since another run may have written to it before the lock was taken
    let journal = journal()?;
    let looking = Progress::new(1, 0);
    if lock.as_ref().is_some_and(|lock| lock.blind) {
        let out = out.display();
        looking.say(&format!("warning: {out}: no locks here: a second run would not be noticed"));
    }

    // 3. the plan: which recordings are to be judged, in which order
    let resume = Resume {
        out: &out,
        journal: &journal,
        means: &means,
        with_baselines: baseline_file.is_some(),
        force: args.force,
        verify: args.verify,
    };
    // recordings that are handed out to others need their printheads, to keep those of one together
    let planner = Planner {
        printheads: elsewhere.is_some(),
        resume,
        dialects: &dialects,
        progress: &looking,
        control: &control,
    };
    let mut planned = planner.plan(placed)?;
    if let Some(file) = &baseline_file {
        planned = planner.chain(planned, &file.digest())?;
    }
    if args.dry_run {
        return plan::print(&planned, &lost, args.json);
    }
    if let Some(lock) = &mut lock {
        let to_judge: Vec<ToJudge> =
            plan::to_judge(&planned).map(PlannedRecording::noted).collect();
        lock.plan(&to_judge).map_err(FileError::unwritten(&out.join(LOCK_NAME)))?;
    }

    // 4. what killed runs left is removed, and the journal opened
    account.rows = lost;
    plan::sweep(&planned, &out);
    baseline_file.iter().for_each(BaselineFile::sweep);
    let bytes = plan::to_judge(&planned).filter_map(|this| Some(this.placed.source.stamp?.bytes));
    let progress = Progress::new(plan::to_judge(&planned).count(), bytes.sum());
    let writer = JournalWriter::open(&out).map_err(FileError::unwritten(&journal_path))?;

    // 5. the judge, and the live view; then the batch judges everything
    let live = serve.map(|place| live::start(place, &first, &control)).transpose()?;
    live.iter()
        .try_for_each(|live| follow::tell_address(live.place.address, args.json, &progress))?;
    let mut watching = FollowJudge { json: args.json, rotate: args.rotate, live };
    // a single recording is reported in full, and no table over all recordings follows
    let alone = planned.len() == 1 && found.lost.is_empty();
    let run = Run {
        out: &out,
        replay,
        means: &means,
        dialects: &dialects,
        detail: if alone { Detail::All } else { Detail::Line },
        force: args.force,
        progress: &progress,
        control: &control,
    };
    let batch = Batch {
        judge: match elsewhere {
            Some(judge) => judge,
            None if args.follow => &mut watching,
            None => &mut ReplayJudge,
        },
        run,
        baseline_file,
        journal: writer,
        account,
        json: args.json,
        timings: args.timings,
        annotate: args.annotate,
        alone,
        failures: 0,
    };
    let ended = batch.run(&planned);
    lock.into_iter().for_each(RunLock::over);
    ended
}

/// A design, and the digest of its file, by which the journal tells one design from another.
pub type Read = (Design, String);

/// The settings, and the design that they name; `None`: they name none. Settings that the design
/// keeps from its training apply unless the command line says otherwise. So the settings are made
/// twice: once to learn which design they name, and again with what that design keeps.
fn with_design(args: &Args) -> Result<(Settings, Option<Read>), Failure> {
    let asked = settings(args, &[])?;
    if asked.input.design.is_empty() {
        if asked.identify.mode == IdentifyMode::Design {
            let said = match args.identify {
                Some(_) => "--identify design",
                None => "identify.mode = \"design\"",
            };
            return Err(Failure::usage(format!(
                "{said}: there is none: give --design FILE (`inkling train` makes one)"
            )));
        }
        return Ok((asked, None));
    }
    let read: Read = design_file::read(Path::new(&asked.input.design))?;
    Ok((settings_by(args, &read.0)?, Some(read)))
}

/// The settings together with those that the design keeps from its training. With a preset the
/// settings that the design keeps are not used: the preset says them all.
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
    refuse_said_twice(args)?;

    // ./pipeline.toml is only read where no recordings are named
    let here = Path::new(PIPELINE_TOML);
    let file = match &args.config {
        Some(file) => Some(file.as_path()),
        None if args.recordings.is_empty() && here.is_file() => Some(here),
        None => None,
    };

    // of several values for a key the last one wins, so the strongest come last
    let mut overrides = kept.to_vec();
    if args.design.is_some() {
        overrides.push("identify.mode=design".into()); // the default; --set wins over it
    }
    overrides.extend(args.set.iter().cloned());
    for (key, value) in [
        ("output.dir", &args.out),
        ("input.design", &args.design),
        ("input.baseline", &args.baseline),
    ] {
        let Some(value) = value else { continue };
        let Some(text) = value.to_str() else {
            return Err(Failure::usage(format!(
                "{}: a name that is not UTF-8, which cannot be kept in results: rename it",
                value.display()
            )));
        };
        overrides.push(format!("{key}={}", toml::Value::String(text.into())));
    }
    overrides.extend(args.identify.as_ref().map(|mode| format!("identify.mode={mode}")));
    overrides.extend(args.layout.as_ref().map(|layout| format!("output.layout={layout}")));
    let preset = args.preset.as_ref().map(|_| Preset::Thesis); // the only one, as clap has checked
    let mut settings = Settings::load(file, preset, &overrides)?;

    // these have types of their own, and are set without being written as text before
    if !args.recordings.is_empty() {
        settings.input.recordings.clone_from(&args.recordings);
    }
    if let Some(pace) = args.pace {
        settings.replay.pace = pace;
    }
    if let Some(threads) = args.threads {
        settings.replay.threads = threads.into();
    }
    if settings.input.recordings.is_empty() {
        return Err(Failure::usage(format!(
            "no recordings: name files, directories or patterns, or run where a {PIPELINE_TOML} \
             names them in input.recordings"
        )));
    }
    Ok(settings)
}

/// Refuses a setting that both an option and `--set` give, since one of the two would have no effect.
fn refuse_said_twice(args: &Args) -> Result<(), Failure> {
    let said = [
        ("--out", "output.dir", args.out.is_some()),
        ("--design", "input.design", args.design.is_some()),
        ("--baseline", "input.baseline", args.baseline.is_some()),
        ("--pace", "replay.pace", args.pace.is_some()),
        ("--identify", "identify.mode", args.identify.is_some()),
        ("--layout", "output.layout", args.layout.is_some()),
        ("--threads", "replay.threads", args.threads.is_some()),
        ("the command line", "input.recordings", !args.recordings.is_empty()),
    ];
    let is_set = |key: &str| keys(&args.set).any(|set| set == key);
    match said.iter().find(|(_, key, is_given)| *is_given && is_set(key)) {
        Some((option, key, _)) => Err(Failure::usage(format!(
            "--set {key}: {option} says that already, and would win: give one of the two"
        ))),
        None => Ok(()),
    }
}

/// Reads labels and baselines, and puts the means of judging together. `read`: the design, if there
/// is one; its settings of detection replace those of the command line. Returns how to judge, the
/// baseline file with `--baseline`, and for the journal the means in digests. `judging` calls this,
/// too, for bursts in memory.
fn load(
    mut settings: Settings,
    read: Option<Read>,
    args: &Args,
) -> Result<(Replay, Option<BaselineFile>, Means), Failure> {
    let (design, design_digest) = read.unzip();
    if let Some(read) = &design {
        // models identified on windows must detect as the design does
        let says_how =
            args.preset.is_some() || keys(&args.set).any(|key| key.starts_with("detect."));
        if says_how && settings.detect != read.detect {
            return Err(Failure::usage(format!(
                "{}: its detection was fixed when it was trained; detect.* by --set or --preset has no \
                 effect beside it: train again with the same --set or --preset, or leave it out",
                settings.input.design
            )));
        }
        settings.detect = read.detect.clone();
    }
    check(&settings, args, design.as_ref())?;

    // labels that say which signals of windows are healthy; the digest tells later runs whether
    // they changed
    let (mut labels, mut labels_digest) = (None, None);
    if !settings.identify.labels.is_empty() {
        let path = Path::new(&settings.identify.labels);
        labels = Some(labels_file::read(path)?);
        let digest = digest::of_file(path, |_| Ok::<_, std::io::Error>(()));
        labels_digest = Some(digest.map_err(|e| Failure::new(format!("{}: {e}", path.display())))?);
    }
    let spans = settings.identify.spans.iter().map(span_ns).collect::<Result<_, Failure>>()?;

    // a baseline file of another design is refused; one that is not there yet gives empty baselines
    let (baseline_file, baselines) = match settings.input.baseline.as_str() {
        "" => (None, None),
        path => BaselineFile::read(Path::new(path), design_digest.as_deref())
            .map(|(file, baselines)| (Some(file), Some(baselines)))?,
    };
    let replay = Replay { settings, design, design_digest, labels, spans, baselines };
    let means = means_of(&replay, labels_digest);
    Ok((replay, baseline_file, means))
}

/// Checks that the settings fit the design and its classes. What cannot take effect is refused,
/// since whoever set it expects an effect.
fn check(settings: &Settings, args: &Args, design: Option<&Design>) -> Result<(), Failure> {
    check_declared(settings, design)?;
    let classes = design.map(Design::class_names).unwrap_or_default();
    let names = !classes.is_empty();
    effect::check(&args.set, settings, Command::Replay { detects: design.is_none(), names })?;
    effect::check_common_change(&args.set, settings, design)?;
    check_threshold(settings, design)?;
    if let Some(design) = design.filter(|_| names) {
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
    let known = |(name, of): &(&String, &Vec<String>)| {
        design.is_some_and(|d| d.classes.iter().any(|c| c.name == **name && c.of == **of))
    };
    let Some((name, _)) = settings.isolate.classes.iter().find(|class| !known(class)) else {
        return Ok(());
    };
    let why = match design {
        Some(_) => {
            "the design was trained without it, and only training makes classes: train again \
                    with these settings"
        }
        None => {
            "there is no design, and only training makes classes: train with these settings, then \
                 give the design"
        }
    };
    Err(Failure::usage(format!("isolate.classes.\"{name}\": {why}")))
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

/// The times of one of `identify.spans`, from and to, ns since the epoch.
fn span_ns([from, to]: &[String; 2]) -> Result<(i64, i64), Failure> {
    let ns = |text: &str| {
        let time = DateTime::parse_from_rfc3339(text).ok().and_then(|t| t.timestamp_nanos_opt());
        time.ok_or_else(|| {
            Failure::usage(format!(
                "identify.spans: \"{text}\" is not RFC 3339: write 2026-01-31T12:00:00Z"
            ))
        })
    };
    let (from_ns, to_ns) = (ns(from)?, ns(to)?);
    match from_ns < to_ns {
        true => Ok((from_ns, to_ns)),
        false => Err(Failure::usage(format!(
            "identify.spans: [\"{from}\", \"{to}\"] ends before it begins"
        ))),
    }
}

/// How a design in memory is to judge by these arguments: for bursts in memory (`cli/called.rs`),
/// where nothing is planned or written. The recordings that `args` names are not read.
pub fn judging(args: Args, read: Read) -> Result<Replay, Failure> {
    let mut settings = settings_by(&args, &read.0)?;
    settings.input.design = "the design".into(); // what sentences call it
    Ok(load(settings, Some(read), &args)?.0)
}
