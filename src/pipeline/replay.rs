//! One recording through the six stages: wire, run, join, check, and only then name the files.

use super::baseline::{self, InUse};
use super::episodes::{EpisodeReport, EpisodeTap, Finished};
use super::in_flight::InFlight;
use super::schedule::{Refusal, Schedule};
use super::spares::Spares;
use super::stages::{self, BlockQueue, Pacer};
use super::survey::survey;
use super::tally::Tally;
use super::timings::{StageTiming, Timings};
use super::warmth::Warmth;
use super::windows::Learner;
use super::{Control, PipelineError, metadata};
use crate::design::{Baselines, Design, categories};
use crate::io::digest::Digest;
use crate::io::episode_table;
use crate::io::journal::Stamp;
use crate::io::part_file::{self, CompleteFile, PartFile};
use crate::io::recording::{Damage, Recording};
use crate::io::stored;
use crate::io::verdict_table::{self, TableOptions, VerdictWriter};
use crate::labels::Labels;
use crate::settings::{IdentifyMode, Pace, Settings, TimestampUnit};
use crossbeam_channel::bounded;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread::{self, ScopedJoinHandle};
use std::time::{Duration, Instant};

/// Batches between two stages.
const QUEUE: usize = 4;
/// Blocks between reader and writer, per worker of a parallel stage: one at work, one waiting. More
/// would only be further from the processor's caches.
const BLOCKS_PER_WORKER: usize = 2;
/// Bytes between reader and writer.
const MOST_BYTES: u64 = 64 << 20;

/// What a run of replay shares over its recordings; as JSON it says all that others need to judge them alike.
#[derive(Clone, Serialize, Deserialize)]
pub struct Replay {
    pub settings: Settings,
    pub design: Option<Design>,
    /// Of the design file.
    pub design_digest: Option<String>,
    pub labels: Option<Labels>,
    /// Healthy windows as spans of time, ns.
    pub spans: Vec<(i64, i64)>,
    /// With `--baseline`: what is remembered of the channels.
    pub baselines: Option<Baselines>,
}

impl Replay {
    pub fn classes(&self) -> Vec<String> {
        self.design.as_ref().map(Design::class_names).unwrap_or_default()
    }

    /// Workers of a stage: its own setting, else `replay.threads`, else the machine's cores.
    fn workers(&self, of_stage: usize) -> usize {
        match (of_stage, self.settings.replay.threads) {
            (0, 0) => thread::available_parallelism().map_or(1, usize::from),
            (0, threads) => threads,
            (workers, _) => workers,
        }
    }
}

/// What is said of a finished recording.
#[derive(Debug)]
pub struct RecordingReport {
    pub name: String,
    /// Of the recording, as it was read.
    pub digest: String,
    pub stamp: Stamp,
    pub tally: Tally,
    pub damage: Vec<Damage>,
    pub refusals: Vec<Refusal>,
    /// Printhead and what to know about its verdicts.
    pub warnings: Vec<(Arc<str>, String)>,
    /// What was learned of temperature from the recording itself, in words by printhead.
    pub learned_temperature: Vec<(String, String)>,
    pub models: usize,
    pub seconds: f64,
    pub verdicts: PathBuf,
    pub episodes: EpisodeReport,
    /// How far behind the recorded pace it ever was.
    pub behind: Option<Duration>,
    /// Where the time went, stage by stage.
    pub timings: Vec<StageTiming>,
    /// With `--baseline`: what is remembered for the next recording.
    pub baselines: Option<Baselines>,
}

impl RecordingReport {
    /// Everything in the recording was read and judged, every window learned.
    pub fn is_whole(&self) -> bool {
        self.damage.is_empty() && self.tally.counts.rejected.is_empty() && self.refusals.is_empty()
    }
}

/// Judges one recording: verdicts to `verdicts`, the summary beside it.
pub fn replay(
    replay: &Replay,
    recording: &Recording,
    verdicts: &Path,
    control: &Control,
) -> Result<RecordingReport, PipelineError> {
    let may_learn = replay.design.is_some();
    match judge(replay, recording, verdicts, may_learn, control) {
        Err(PipelineError::NeedsTemperature) => {}
        done => return done,
    }
    let Some((knowing, learned)) = replay.learn_temperature(recording, control)? else {
        return judge(replay, recording, verdicts, false, control);
    };
    let replay = Replay { design: Some(knowing), ..replay.clone() };
    let mut report = judge(&replay, recording, verdicts, false, control)?;
    report.learned_temperature = learned;
    Ok(report)
}

/// `may_learn`: what temperature does can still be learned from the recording.
fn judge(
    replay: &Replay,
    recording: &Recording,
    verdicts: &Path,
    may_learn: bool,
    control: &Control,
) -> Result<RecordingReport, PipelineError> {
    let started = Instant::now();
    let isolate = &replay.settings.isolate;
    let design_schedule = || match &replay.design {
        Some(design) => Schedule::of_design(design, isolate),
        None => Ok(Schedule::default()),
    };
    let windows = || -> Result<Schedule, PipelineError> {
        let learner = Learner {
            settings: &replay.settings,
            design: replay.design.as_ref(),
            labels: replay.labels.as_ref(),
            spans: replay.spans.clone(),
        };
        let survey = survey(recording, learner.every_ns(), control)?;
        learner.learn(recording, &survey, design_schedule()?, control)
    };
    let as_designed =
        replay.design.is_some() && replay.settings.identify.mode == IdentifyMode::Design;
    let schedule = if as_designed { design_schedule()? } else { windows()? };

    let run = |schedule: &Schedule| {
        let learned = learn_baselines(replay, recording, schedule, control)?;
        let in_use = learned.as_ref().map(|(in_use, _)| in_use);
        let streamed = stream(replay, recording, schedule, in_use, (verdicts, may_learn), control)?;
        Ok((streamed, learned))
    };
    let (schedule, (streamed, learned)) = match run(&schedule) {
        // a printhead that the design does not know: its windows decide
        Err(PipelineError::NeedsSurvey) => {
            let schedule = windows()?;
            let done = run(&schedule)?;
            (schedule, done)
        }
        done => (schedule, done?),
    };
    let Streamed { mut tally, writer, episodes, scan_damage, behind, timings, digest, warmth } =
        streamed;
    let mut warnings = warmth.warnings();
    warnings.extend(schedule.wide_thresholds());

    let counts = &tally.counts;
    let judged_and_rejected = counts.judged + counts.rejected.values().sum::<u64>();
    if counts.signals != judged_and_rejected || writer.rows() != counts.signals {
        return Err(PipelineError::RowsLost { found: counts.signals, written: writer.rows() });
    }
    let mut damage = recording.damage.clone();
    damage.extend(scan_damage);
    damage.append(&mut tally.damage);
    damage.extend(digest.damage);
    damage.extend(recording.missing(counts.bursts));
    damage.extend(recording.changed());
    damage.sort_by_key(|d| (d.from_byte, d.to_byte));
    if counts.bursts == 0 {
        let (others, recording) = (recording.others.clone(), recording.path.display().to_string());
        return Err(PipelineError::NoBursts { recording, others, damage });
    }

    let document = metadata::document(replay, recording, &digest.text, &schedule, counts);
    control.check()?;
    let text = document.to_string();
    let seconds = started.elapsed().as_secs_f64();
    let mut summary =
        summary(document, recording, &damage, &schedule, seconds, counts.signals, behind);
    summary["timings"] = json!(timings);
    if let Some((in_use, _)) = &learned {
        warnings.extend(in_use.refused.iter().cloned());
        summary["baseline"] = json!({
            "channels_remembered": in_use.remembered,
            "channels_learned_in_the_first_window": in_use.learned,
            "channels_heard": in_use.heard,
            "signals_of_channels_beyond_the_limit": in_use.beyond,
        });
    }
    summary["warnings"] = warnings
        .iter()
        .map(|(printhead, what)| json!({"printhead": &**printhead, "what": what}))
        .collect();
    let Finished { report: episodes, table } = episodes;
    summary["episodes"] = json!(episodes.counts);
    // all are complete on disk before any gets its name
    name_all([
        table.complete(text.clone())?,
        writer.complete(text)?,
        complete_summary(verdicts, &summary)?,
    ])?;
    Ok(RecordingReport {
        name: recording.name.clone(),
        digest: digest.text,
        stamp: recording.stamp,
        damage,
        refusals: schedule.refusals,
        warnings,
        learned_temperature: Vec::new(),
        models: schedule.judges.len(),
        seconds,
        verdicts: verdicts.to_path_buf(),
        episodes,
        behind,
        timings,
        tally,
        baselines: learned.map(|(_, next)| next),
    })
}

/// With `--baseline`, in a pass of its own.
fn learn_baselines(
    replay: &Replay,
    recording: &Recording,
    schedule: &Schedule,
    control: &Control,
) -> Result<Option<(InUse, Baselines)>, PipelineError> {
    let Some(remembered) = &replay.baselines else { return Ok(None) };
    let window_ns = (replay.settings.identify.first * 1e9) as i64;
    let how = (&replay.settings, window_ns);
    baseline::learn(remembered, recording, schedule, replay.design.as_ref(), how, control).map(Some)
}

struct Streamed {
    tally: Tally,
    writer: VerdictWriter,
    episodes: Finished,
    scan_damage: Vec<Damage>,
    behind: Option<Duration>,
    timings: Vec<StageTiming>,
    digest: Digest,
    warmth: Warmth,
}

/// Wires the six stages, runs them, joins them.
fn stream(
    replay: &Replay,
    recording: &Recording,
    schedule: &Schedule,
    baselines: Option<&InUse>,
    (verdicts, may_learn): (&Path, bool),
    control: &Control,
) -> Result<Streamed, PipelineError> {
    let settings = &replay.settings;
    let classes = replay.classes();
    let category_names = categories(&classes);
    let timestamp_unit = match settings.output.timestamps {
        TimestampUnit::Ns => verdict_table::TimestampUnit::Ns,
        TimestampUnit::Us => verdict_table::TimestampUnit::Us,
    };
    let beside = episode_table::path_beside(verdicts);
    let mut episodes = EpisodeTap::create(replay, schedule, baselines, &beside, timestamp_unit)?;
    let mut writer = VerdictWriter::create(
        verdicts,
        TableOptions {
            classes: classes.clone(),
            categories: category_names,
            weights: settings.output.weights,
            timestamp_unit,
        },
    )?;
    let (mut tally, mut warmth) = (Tally::new(classes), Warmth::new(may_learn));
    let mut pacer = (settings.replay.pace == Pace::Recorded).then(Pacer::new);
    let stages = &settings.replay;
    let (filters, isolators) = (replay.workers(stages.filters), replay.workers(stages.isolators));
    // without channels known upfront, and at the recorded pace, blocks are read one after another
    let one_reader = pacer.is_some() || !recording.channels_known_upfront();
    let readers = if one_reader { 1 } else { replay.workers(stages.readers) };
    let queue = BlockQueue::new(recording);
    let in_flight = InFlight::new(BLOCKS_PER_WORKER * (readers + filters + isolators), MOST_BYTES);
    let (timings, spares) = (Timings::default(), Spares::default());
    let names = ["reader", "identify", "filter", "gate", "isolate", "writer"];
    names.iter().for_each(|stage| timings.expect(stage));
    control.bytes_read.store(0, Ordering::Relaxed);

    thread::scope(|scope| {
        let (to_identify, from_reader) = bounded(QUEUE);
        let (to_filter, from_identify) = bounded(QUEUE);
        let (to_gate, from_filter) = bounded(QUEUE);
        let (to_isolate, from_gate) = bounded(QUEUE);
        let (to_writer, from_isolate) = bounded(QUEUE);
        let (queue, in_flight, pacer) = (&queue, &in_flight, &mut pacer);
        let (timings, spares, warmth) = (&timings, &spares, &mut warmth);
        let mut running: Vec<(&'static str, ScopedJoinHandle<Result<(), PipelineError>>)> =
            Vec::new();
        let mut pacer = pacer.as_mut();
        for _ in 0..readers {
            let (out, pacer) = (to_identify.clone(), pacer.take());
            running.push((
                "reader",
                scope.spawn(move || {
                    let clock = timings.clock("reader");
                    stages::read(recording, queue, in_flight, pacer, control, clock, out)
                }),
            ));
        }
        drop(to_identify);
        running.push((
            "identify",
            scope.spawn(move || {
                let clock = timings.clock("identify");
                stages::identify(schedule, warmth, clock, from_reader, to_filter)
            }),
        ));
        for _ in 0..filters {
            let (input, out) = (from_identify.clone(), to_gate.clone());
            let rails = settings.input.rails;
            running.push((
                "filter",
                scope.spawn(move || {
                    let clock = timings.clock("filter");
                    stages::filter(rails, baselines, spares, clock, input, out)
                }),
            ));
        }
        drop((from_identify, to_gate));
        running.push((
            "gate",
            scope.spawn(move || {
                stages::gate(spares, timings.clock("gate"), from_filter, to_isolate)
            }),
        ));
        for _ in 0..isolators {
            let (input, out) = (from_gate.clone(), to_writer.clone());
            running.push((
                "isolate",
                scope.spawn(move || {
                    let clock = timings.clock("isolate");
                    stages::isolate(settings, baselines, spares, clock, input, out)
                }),
            ));
        }
        drop((from_gate, to_writer));

        let put = |judged: &mut stages::Judged| {
            episodes.add(judged)?;
            Ok(writer.write(&judged.columns)?)
        };
        let clock = timings.clock("writer");
        let written =
            stages::write(clock, from_isolate, in_flight, control, (&mut tally, spares), put);
        // whoever waits for room in flight must not wait for a writer that is gone
        in_flight.close();
        let mut outcome = written;
        for (stage, handle) in running {
            let ended = handle.join().unwrap_or(Err(PipelineError::Panicked(stage)));
            if outcome.is_ok() {
                outcome = ended;
            }
        }
        outcome
    })?;
    let behind = pacer.map(|p| p.behind);
    let ((scan_damage, digest), timings) = (queue.finish(control)?, timings.stages());
    let episodes = episodes.finish()?;
    Ok(Streamed { tally, writer, episodes, scan_damage, behind, timings, digest, warmth })
}

fn summary(
    mut document: Value,
    recording: &Recording,
    damage: &[Damage],
    schedule: &Schedule,
    seconds: f64,
    signals: u64,
    behind: Option<Duration>,
) -> Value {
    document["damage"] = json!(damage);
    document["expected"] = json!(recording.expected);
    document["refused_windows"] = json!(schedule.refusals);
    document["rates"] = json!({
        "seconds": seconds,
        "signals_per_s": signals as f64 / seconds,
        "bytes_per_s": recording.bytes as f64 / seconds,
        "behind_s": behind.map(|b| b.as_secs_f64()),
    });
    document
}

/// `<stem>.verdicts.parquet` -> `<stem>.summary.json`.
pub fn summary_path(verdicts: &Path) -> PathBuf {
    let name = verdicts.file_name().unwrap_or_default().to_string_lossy();
    let stem = name.strip_suffix(".verdicts.parquet").unwrap_or(&name);
    verdicts.with_file_name(format!("{stem}.summary.json"))
}

fn complete_summary(verdicts: &Path, summary: &Value) -> Result<CompleteFile, PipelineError> {
    let path = summary_path(verdicts);
    let failed = |source| PipelineError::Write { path: path.clone(), source };
    let mut text = serde_json::to_string_pretty(summary).map_err(|e| failed(e.into()))?;
    text.push('\n');
    let (part, mut file) = PartFile::create(&path).map_err(failed)?;
    std::io::Write::write_all(&mut file, text.as_bytes()).map_err(failed)?;
    part.complete(&file).map_err(failed)
}

/// An earlier run's files go before the first of these gets its name: at no instant do tables of two
/// runs lie side by side.
fn name_all(files: [CompleteFile; 3]) -> Result<(), PipelineError> {
    let failed = |path: &Path, source| PipelineError::Write { path: path.into(), source };
    for file in files.iter().rev() {
        stored::remove(file.path()).map_err(|e| failed(file.path(), e))?;
    }
    let last = files[2].path().to_path_buf();
    for file in files {
        let path = file.path().to_path_buf();
        file.name().map_err(|e| failed(&path, e))?;
    }
    part_file::sync_directory_of(&last).map_err(|e| failed(&last, e))
}
