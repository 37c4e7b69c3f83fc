//! `inkling replay`: the main job.

use super::exit::{Exit, Failure, unless_reader_gone};
use super::progress::{Progress, interruptible};
use super::report::{self, printable};
use crate::design::Design;
use crate::io::baseline_file::BaselineFile;
use crate::io::inputs::Input;
use crate::io::recording::Recording;
use crate::io::{Limits, design_file, inputs, labels_file, outputs};
use crate::isolate::IsolateMethod;
use crate::pipeline::{self, Control, PipelineError, RecordingReport, Replay};
use crate::settings::{Pace, Preset, Settings};
use chrono::DateTime;
use clap::ValueEnum;
use std::path::{Path, PathBuf};

/// The settings file that is read where no recording is named.
const PIPELINE_TOML: &str = "pipeline.toml";

#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum PresetArg {
    Thesis,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum IdentifyArg {
    Design,
    Windows,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum PaceArg {
    Recorded,
    Max,
}

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  inkling replay
      the recordings, the design and the output that ./pipeline.toml names
  inkling replay night.mcap --design design.json --out verdicts
      judged by the design's models as they are
  inkling replay 'logs/2026-*/*.mcap' --design design.json --identify windows
      identified again on each recording's healthy windows, so that slow drift is followed
  inkling replay night.mcap --set identify.every=\"5 min\" --set output.weights=true
      without a design: detected, not named; any setting of pipeline.toml by --set

Where recordings are named, ./pipeline.toml is not read unless --config names it.")]
pub struct Args {
    /// Files, directories (searched for *.mcap) or glob patterns
    recordings: Vec<String>,
    /// Where verdicts go [default: verdicts]
    #[arg(long, value_name = "DIR")]
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
    #[arg(long, value_enum)]
    identify: Option<IdentifyArg>,
    /// Any setting of pipeline.toml, repeatable
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Choices that belong together; --set wins over them
    #[arg(long, value_enum)]
    preset: Option<PresetArg>,
    /// Replay at the recorded speed, or as fast as possible [default: max]
    #[arg(long, value_enum)]
    pace: Option<PaceArg>,
    /// Workers per parallel stage [default: the machine's cores]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Say where the time went, stage by stage
    #[arg(long)]
    timings: bool,
}

pub fn run(args: Args) -> Result<Exit, Failure> {
    let settings = settings(&args)?;
    let inputs = inputs::find_recordings(&settings.input.recordings).map_err(Failure::new)?;
    let out = PathBuf::from(&settings.output.dir);
    outputs::check_directory(&out).map_err(Failure::new)?;
    inputs::refuse_shared_verdicts(&out, &inputs).map_err(Failure::usage)?;
    let (mut replay, mut baseline_file) = load(settings)?;

    let control = interruptible();
    let inputs = match &replay.baselines {
        Some(_) => by_start(inputs, &control),
        None => inputs,
    };
    let total = inputs.iter().filter_map(|i| i.path.metadata().ok()).map(|m| m.len()).sum();
    let progress = Progress::new(inputs.len(), total);
    let (mut done, mut failed, mut whole) = (0, Vec::new(), true);
    for input in &inputs {
        let judged = Recording::open(&input.path, Limits::default()).map_err(Into::into).and_then(
            |recording: Recording| {
                let verdicts = inputs::verdict_path(&out, input);
                progress.during(&recording.name, recording.bytes, &control, || {
                    pipeline::replay(&replay, &recording, &verdicts, &control)
                })
            },
        );
        match judged {
            Ok(mut report) => {
                done += 1;
                if let Some(baselines) = report.baselines.take() {
                    if let Some(file) = &mut baseline_file {
                        file.write(&baselines).map_err(Failure::new)?;
                    }
                    replay.baselines = Some(baselines);
                }
                whole &= report.is_whole();
                warn(&report, &progress);
                if args.timings {
                    say_timings(&report, &progress);
                }
                // whoever stopped reading still wants the other recordings' verdicts
                unless_reader_gone(report::print(&report, &mut std::io::stdout().lock()))?;
            }
            Err(PipelineError::Interrupted) => return Err(PipelineError::Interrupted.into()),
            Err(e) if inputs.len() == 1 => return Err(e.into()),
            Err(e) => {
                progress.say(&format!("inkling: {e}"));
                failed.push(input.path.display().to_string());
            }
        }
    }
    if done == 0 {
        return Err(Failure::new(format!("none of {} recordings could be judged", inputs.len())));
    }
    if !failed.is_empty() {
        progress.say(&format!(
            "inkling: {} of {} recordings failed: {}",
            failed.len(),
            inputs.len(),
            failed.join(", ")
        ));
    }
    Ok(if whole && failed.is_empty() { Exit::Done } else { Exit::Incomplete })
}

/// In the order of their first bursts; those that cannot be read last, where they fail.
fn by_start(mut inputs: Vec<Input>, control: &Control) -> Vec<Input> {
    let start = |input: &Input| {
        let recording = Recording::open(&input.path, Limits::default()).ok()?;
        pipeline::baseline::starts(&recording, control).ok()?.into_values().min()
    };
    if inputs.len() > 1 {
        inputs.sort_by_cached_key(|input| start(input).unwrap_or(i64::MAX));
    }
    inputs
}

fn warn(report: &RecordingReport, progress: &Progress) {
    const MOST: usize = 10;
    for refusal in report.refusals.iter().take(MOST) {
        let from = DateTime::from_timestamp_nanos(refusal.from_ns);
        progress.say(&format!(
            "warning: {}: window of {} at {}: {}",
            report.name,
            printable(&refusal.printhead),
            from.format("%Y-%m-%d %H:%M:%S"),
            refusal.why
        ));
    }
    for (printhead, what) in report.learned_temperature.iter().take(MOST) {
        progress.say(&format!(
            "{}: {}: the design does not know what temperature does, this recording does: {what}",
            report.name,
            printable(printhead)
        ));
    }
    for (printhead, what) in report.warnings.iter().take(MOST) {
        progress.say(&format!("warning: {}: {}: {what}", report.name, printable(printhead)));
    }
    for damage in report.damage.iter().take(MOST) {
        progress.say(&format!(
            "warning: {}: bytes {} to {}: {}",
            report.name, damage.from_byte, damage.to_byte, damage.what
        ));
    }
    let more = [report.refusals.len(), report.warnings.len(), report.damage.len()]
        .map(|n| n.saturating_sub(MOST))
        .iter()
        .sum::<usize>();
    if more > 0 {
        progress.say(&format!("warning: {}: {more} more, all in its summary.json", report.name));
    }
}

fn say_timings(report: &RecordingReport, progress: &Progress) {
    progress.say(&format!(
        "{:9} {:>7} {:>8} {:>9} {:>9} {:>9} {:>6}",
        "stage", "workers", "batches", "busy s", "starved s", "blocked s", "queue"
    ));
    for s in &report.timings {
        progress.say(&format!(
            "{:9} {:>7} {:>8} {:>9.2} {:>9.2} {:>9.2} {:>6.1}",
            s.stage, s.workers, s.batches, s.busy_s, s.starved_s, s.blocked_s, s.queue_fill
        ));
    }
}

fn settings(args: &Args) -> Result<Settings, Failure> {
    let here = Path::new(PIPELINE_TOML);
    let file = match &args.config {
        Some(file) => Some(file.as_path()),
        None if args.recordings.is_empty() && here.is_file() => Some(here),
        None => None,
    };
    let mut overrides = Vec::new();
    if args.design.is_some() {
        overrides.push("identify.mode=design".into()); // the default; --set wins over it
    }
    overrides.extend(args.set.iter().cloned());
    let mut text = |key: &str, value: &Path| {
        overrides.push(format!("{key}={}", toml::Value::String(value.to_string_lossy().into())));
    };
    if let Some(out) = &args.out {
        text("output.dir", out);
    }
    if let Some(design) = &args.design {
        text("input.design", design);
    }
    if let Some(baseline) = &args.baseline {
        text("input.baseline", baseline);
    }
    match args.identify {
        Some(IdentifyArg::Design) => overrides.push("identify.mode=design".into()),
        Some(IdentifyArg::Windows) => overrides.push("identify.mode=windows".into()),
        None => {}
    }
    let preset = args.preset.map(|PresetArg::Thesis| Preset::Thesis);
    let mut settings = Settings::load(file, preset, &overrides)?;
    if !args.recordings.is_empty() {
        settings.input.recordings.clone_from(&args.recordings);
    }
    match args.pace {
        Some(PaceArg::Recorded) => settings.replay.pace = Pace::Recorded,
        Some(PaceArg::Max) => settings.replay.pace = Pace::Max,
        None => {}
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

fn load(mut settings: Settings) -> Result<(Replay, Option<BaselineFile>), Failure> {
    let (mut design, mut design_digest) = (None, None);
    if !settings.input.design.is_empty() {
        let (read, digest): (Design, String) =
            design_file::read(Path::new(&settings.input.design)).map_err(Failure::new)?;
        // models learned on windows must be of the design's kind
        settings.detect = read.detect.clone();
        (design, design_digest) = (Some(read), Some(digest));
    }
    if settings.isolate.method == IsolateMethod::Posterior {
        let classes = design.as_ref().map(Design::class_names).unwrap_or_default();
        settings.isolate.prior_weights(&classes).map_err(Failure::usage)?;
    }
    let labels = match settings.identify.labels.as_str() {
        "" => None,
        path => Some(labels_file::read(Path::new(path)).map_err(Failure::new)?),
    };
    let spans = settings
        .identify
        .spans
        .iter()
        .map(|[from, to]| {
            let ns = |text: &str| {
                DateTime::parse_from_rfc3339(text)
                    .ok()
                    .and_then(|t| t.timestamp_nanos_opt())
                    .ok_or_else(|| {
                        Failure::usage(format!("identify.spans: \"{text}\" is not RFC 3339"))
                    })
            };
            let (from_ns, to_ns) = (ns(from)?, ns(to)?);
            if from_ns >= to_ns {
                return Err(Failure::usage(format!(
                    "identify.spans: [\"{from}\", \"{to}\"] ends before it begins"
                )));
            }
            Ok((from_ns, to_ns))
        })
        .collect::<Result<_, Failure>>()?;
    let (baseline_file, baselines) = match settings.input.baseline.as_str() {
        "" => (None, None),
        path => BaselineFile::read(Path::new(path), design_digest.as_deref())
            .map(|(file, baselines)| (Some(file), Some(baselines)))
            .map_err(Failure::new)?,
    };
    Ok((Replay { settings, design, design_digest, labels, spans, baselines }, baseline_file))
}
