//! One recording through the six stages: how its models come to be, run, check, and only then name the files.

use super::episode_announcer::EpisodeAnnouncer;
use super::episodes::{EpisodeReport, Finished};
use super::identified::Identified;
use super::job::{EpisodeEvent, Replay, Watch};
use super::learner::Learner;
use super::learning::{Learning, MOST_REORDER_NS, USUAL_REORDER_NS};
use super::metadata::{self, Document};
use super::models::Models;
use super::moved::Moved;
use super::not_judged::{self, Finishing, NotJudged};
use super::pacer::{Paced, Pacer};
use super::schedule::{Refusal, Schedule};
use super::survey::survey;
use super::tally::{Counts, Tally};
use super::timings::{PhaseTiming, Phases, StageTiming};
use super::wiring::{Streamed, Table, Wiring};
use super::{Control, PipelineError, rotation};
use crate::io::damage::Damage;
use crate::io::episode_table::EpisodeWriter;
use crate::io::journal::{Outcome, Stamp};
use crate::io::labels_file;
use crate::io::part_file::{self, CompleteFile};
use crate::io::part_tables::PartTables;
use crate::io::recording::Recording;
use crate::io::stored;
use crate::io::summary_file;
use crate::io::verdict_arrays::VerdictArrays;
use crate::io::verdict_table::VerdictWriter;
use crate::settings::Pace;
use crate::state::Memory;
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

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
    /// Printheads of which nothing was judged, or the recording, if less than half of it was.
    pub not_judged: Vec<NotJudged>,
    /// Topics that look like bursts and are read by nothing, if nobody knows that they are.
    pub unread: Vec<NotJudged>,
    /// Printheads of which a warning says that all channels moved together beyond the bounds.
    pub moved_beyond: Vec<Arc<str>>,
    /// Printhead and what to know about its verdicts.
    pub warnings: Vec<(Arc<str>, String)>,
    /// What was learned of temperature from the recording itself, in words by printhead.
    pub learned_temperature: Vec<(String, String)>,
    pub models: usize,
    pub seconds: f64,
    pub verdicts: PathBuf,
    pub episodes: EpisodeReport,
    /// How the pace was kept, where there was one.
    pub paced: Option<Paced>,
    /// How its models came to be.
    pub identified: Identified,
    /// Where the time went, one after the other.
    pub phases: Vec<PhaseTiming>,
    /// Where that of the stages went, side by side.
    pub timings: Vec<StageTiming>,
    /// With `--baseline`: what is remembered for the next recording.
    pub baselines: Option<Memory>,
    /// It was followed until that was enough, and nobody had closed it.
    pub cut_off: bool,
    /// Of a recording whose rows stay in memory.
    pub arrays: Option<VerdictArrays>,
    /// Why parts of the table, of a run that followed the recording, could not be removed.
    pub parts_left: Option<std::io::Error>,
}

impl RecordingReport {
    /// The worst that happened to it.
    pub fn outcome(&self) -> Outcome {
        match self {
            _ if !self.not_judged.is_empty() => Outcome::NotJudged,
            _ if !self.damage.is_empty() => Outcome::Damaged,
            _ if !self.tally.counts.rejected.is_empty() => Outcome::Damaged,
            _ if !self.refusals.is_empty() => Outcome::WindowRefused,
            _ => Outcome::Judged,
        }
    }

    /// The metadata's document, and how it went.
    fn summary(&self, document: &mut Map<String, Value>, recording: &Recording) {
        let mut say = |key: &str, value: Value| document.insert(key.into(), value);
        say("damage", json!(self.damage));
        say("expected", json!(recording.expected));
        say("refused_windows", json!(self.refusals));
        say("not_judged", json!(self.not_judged));
        say("unread", json!(self.unread));
        say("identified", json!(self.identified));
        let rates = json!({
            "seconds": self.seconds,
            "signals_per_s": self.tally.counts.signals as f64 / self.seconds,
            "bytes_per_s": recording.bytes as f64 / self.seconds,
            "paced_bursts": self.paced.map(|paced| paced.bursts),
            "behind_s": self.paced.map(|paced| paced.behind.as_secs_f64()),
        });
        say("rates", rates);
        say("phases", json!(self.phases));
        say("timings", json!(self.timings));
        let warning = |(printhead, what): &(Arc<str>, String)| json!({"printhead": &**printhead, "what": what});
        say("warnings", self.warnings.iter().map(warning).collect());
        say("episodes", json!(self.episodes.counts));
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
    let verdicts = Some(verdicts);
    let pacer = &Mutex::new(Pacer::new(replay.settings.replay.pace));
    let run = Run { replay, recording, verdicts, control, may_learn, watch: None, pacer };
    run.judge_knowing(&mut Phases::new(recording.opening))
}

/// The same without files: the report has the rows ([`RecordingReport::arrays`]).
pub fn judge(
    replay: &Replay,
    recording: &Recording,
    control: &Control,
) -> Result<RecordingReport, PipelineError> {
    let may_learn = replay.design.is_some();
    let pacer = &Mutex::new(Pacer::new(Pace::Max));
    let run = Run { replay, recording, verdicts: None, control, may_learn, watch: None, pacer };
    run.judge_knowing(&mut Phases::new(recording.opening))
}

/// The same of a recording that is being written ([`Recording::follow`]), until it is closed or
/// `control.enough`. What its models need the whole of is told then: its tables are always those of a replay.
pub fn follow(
    replay: &Replay,
    recording: &Recording,
    verdicts: &Path,
    control: &Control,
    watch: &Watch,
) -> Result<RecordingReport, PipelineError> {
    let announcer = Mutex::new(EpisodeAnnouncer::default());
    let announce = |event: EpisodeEvent| {
        let mut announcer = announcer.lock().unwrap_or_else(PoisonError::into_inner);
        match event {
            EpisodeEvent::Raised(episode) => announcer.announce(episode, watch.episode),
            other => (watch.episode)(other),
        }
    };
    let once = &Watch { episode: &announce, ..*watch };
    let report = followed(replay, recording, verdicts, control, once)?;
    let mut announcer = announcer.into_inner().unwrap_or_else(PoisonError::into_inner);
    announcer.settle(&report.episodes, watch.episode);
    Ok(report)
}

fn followed(
    replay: &Replay,
    recording: &Recording,
    verdicts: &Path,
    control: &Control,
    watch: &Watch,
) -> Result<RecordingReport, PipelineError> {
    if watch.rotation.is_some() {
        rotation::make_room(verdicts, recording)?;
    }
    let (may_learn, mut phases) = (replay.design.is_some(), Phases::new(recording.opening));
    let to = Some(verdicts);
    let pacer = &Mutex::new(Pacer::new(Pace::Max)); // the recorder sets it
    let run =
        Run { replay, recording, verdicts: to, control, may_learn, watch: Some(watch), pacer };
    let why = match run.judge(&mut phases) {
        Err(PipelineError::NeedsTemperature) => {
            "what was told is by models that do not know what temperature does; now it is judged again, with \
             what the recording tells of it"
                .to_owned()
        }
        Err(e @ PipelineError::NeedsTwoPasses(_)) => {
            format!("{e}; what is found is told when the recording is closed")
        }
        Err(e @ PipelineError::Recording(_)) => {
            recording.check_same()?;
            return Err(e);
        }
        done => return done,
    };
    control.set_abandoned(false);
    (watch.note)(&why);
    if watch.rotation.is_some() {
        rotation::remove(verdicts, recording)?; // what is in them is judged again
    }
    phases.time("wait", || {
        let mut blocks = recording.blocks();
        while control.next_block(recording, &mut blocks)?.is_some() {}
        Ok::<(), PipelineError>(())
    })?;
    let recording = &recording.closed(&replay.settings.input.dialects())?;
    Run { recording, ..run }.judge_knowing(&mut phases)
}

/// One recording on its way to its files.
#[derive(Clone, Copy)]
pub(super) struct Run<'a> {
    pub replay: &'a Replay,
    pub recording: &'a Recording,
    /// `None`: nothing is written.
    pub verdicts: Option<&'a Path>,
    pub control: &'a Control,
    /// What temperature does can still be learned from the recording.
    pub may_learn: bool,
    pub watch: Option<&'a Watch<'a>>,
    pub pacer: &'a Mutex<Pacer>,
}

impl<'a> Run<'a> {
    /// Learns what temperature does first, if that turns out to matter.
    fn judge_knowing(&self, phases: &mut Phases) -> Result<RecordingReport, PipelineError> {
        let Run { replay, recording, control, .. } = *self;
        let learned = match self.judge(phases) {
            Err(PipelineError::NeedsTemperature) => {
                phases.time("temperature", || replay.learn_temperature(recording, control))?
            }
            done => return done,
        };
        let run = Run { may_learn: false, ..*self };
        let Some((knowing, learned)) = learned else { return run.judge(phases) };
        let replay = Replay { design: Some(knowing), ..replay.clone() };
        let mut report = Run { replay: &replay, ..run }.judge(phases)?;
        report.learned_temperature = learned;
        Ok(report)
    }

    pub(super) fn judge(&self, phases: &mut Phases) -> Result<RecordingReport, PipelineError> {
        let learner = self.learner();
        if let Some(why) = self.why_two_passes(&learner) {
            return match self.recording.is_growing() {
                true => Err(PipelineError::NeedsTwoPasses(why)),
                false => self.judge_in_two_passes(why, phases),
            };
        }
        match self.learn_in_stream(&learner, phases) {
            Err(PipelineError::NeedsTwoPasses(why)) if !self.recording.is_growing() => {
                self.judge_in_two_passes(why, phases)
            }
            done => self.finish(done?, Identified::in_stream(&learner), phases),
        }
    }

    pub(super) fn judge_in_two_passes(
        &self,
        why: String,
        phases: &mut Phases,
    ) -> Result<RecordingReport, PipelineError> {
        let learner = self.learner();
        let streamed = self.learn_before(&learner, phases)?;
        self.finish(streamed, Identified::before(&learner, why), phases)
    }

    fn learner(&self) -> Learner<'a> {
        Learner {
            settings: &self.replay.settings,
            design: self.replay.design.as_ref(),
            pooled: self.replay.design.as_ref().map(|design| Arc::new(design.pooled.clone())),
            labels: self.replay.labels.as_ref(),
            spans: self.replay.spans.clone(),
        }
    }

    fn design_schedule(&self) -> Result<Schedule<'a>, PipelineError> {
        Schedule::new(self.replay.design.as_ref(), &self.replay.settings.isolate)
    }

    /// Why windows cannot be learned while the signals flow, as far as is known beforehand.
    fn why_two_passes(&self, learner: &Learner) -> Option<String> {
        let disorder_ns = self.recording.disorder_ns().unwrap_or_default();
        if !learner.knows_by_design() && disorder_ns > MOST_REORDER_NS {
            let seconds = disorder_ns as f64 / 1e9;
            return Some(format!(
                "its chunks lie up to {seconds:.1} s out of the order of their times"
            ));
        }
        let mut spans = learner.spans.clone();
        spans.sort_unstable();
        let overlap = spans.windows(2).any(|pair| pair[0].1 > pair[1].0);
        overlap.then(|| "the windows of identify.spans overlap".into())
    }

    /// The default: windows give models while the signals flow.
    fn learn_in_stream<'l>(
        &'l self,
        learner: &'l Learner<'l>,
        phases: &mut Phases,
    ) -> Result<Streamed<'l>, PipelineError> {
        let reorder_ns = self.recording.disorder_ns().unwrap_or_default().max(USUAL_REORDER_NS);
        let reorder_ns = reorder_ns.min(MOST_REORDER_NS) as i64;
        let (schedule, workers) = (self.design_schedule()?, self.replay.workers(0));
        let learning = Learning::new(learner, schedule, reorder_ns, workers);
        self.stream(Models::learned(learning, self.recording, self.control), phases)
    }

    /// Where the file's order does not allow that: all models before the stages start.
    fn learn_before(
        &self,
        learner: &Learner,
        phases: &mut Phases,
    ) -> Result<Streamed<'a>, PipelineError> {
        let windows = |phases: &mut Phases| -> Result<Schedule<'a>, PipelineError> {
            let (recording, control) = (self.recording, self.control);
            let survey =
                phases.time("survey", || survey(recording, learner.every_ns(), control))?;
            let schedule = self.design_schedule()?;
            phases.time("windows", || learner.learn(recording, &survey, schedule, control))
        };
        if !learner.knows_by_design() {
            let schedule = windows(phases)?;
            return self.stream(Models::Made(schedule), phases);
        }
        match self.stream(Models::Made(self.design_schedule()?), phases) {
            // a printhead that the design does not know: its windows decide
            Err(PipelineError::NeedsSurvey) => {
                let schedule = windows(phases)?;
                self.stream(Models::Made(schedule), phases)
            }
            done => done,
        }
    }

    /// Through the stages; what a run that is given up took is told apart.
    fn stream<'m>(
        &self,
        models: Models<'m>,
        phases: &mut Phases,
    ) -> Result<Streamed<'m>, PipelineError> {
        let (started, signals) = (Instant::now(), self.control.signals.load(Ordering::Relaxed));
        let Run { replay, recording, verdicts, control, watch, .. } = *self;
        // somebody waits: who follows hears what is found all the same
        let may_learn = self.may_learn && !recording.is_growing();
        self.pacer().begin();
        let pacer = (replay.settings.replay.pace != Pace::Max).then_some(self.pacer);
        let wiring = Wiring { replay, recording, verdicts, control, may_learn, watch, pacer };
        let streamed = wiring.stream(models);
        if streamed.is_err() {
            self.control.signals.store(signals, Ordering::Relaxed); // they are judged again
        }
        phases.add(if streamed.is_ok() { "stages" } else { "given up" }, started.elapsed());
        match streamed {
            Ok(of) if self.may_learn && !may_learn && of.temperatures.needs_response() => {
                Err(PipelineError::NeedsTemperature)
            }
            streamed => streamed,
        }
    }

    fn pacer(&self) -> MutexGuard<'_, Pacer> {
        self.pacer.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Checks, and only then gives the files their names.
    fn finish(
        &self,
        streamed: Streamed,
        identified: Identified,
        phases: &mut Phases,
    ) -> Result<RecordingReport, PipelineError> {
        let finishing = Instant::now();
        let Run { replay, recording, verdicts, control, .. } = *self;
        let closed = match recording.is_growing() {
            true => Some(recording.closed(&replay.settings.input.dialects())?),
            false => None,
        };
        let recording = closed.as_ref().unwrap_or(recording);
        let Streamed {
            mut schedule, mut tally, table, episodes, temperatures, moved, memory, ..
        } = streamed;
        let Streamed { scan_damage, timings, digest, .. } = streamed;
        let mut warnings = temperatures.warnings();
        warnings.extend(schedule.wide_thresholds());
        let identify = &replay.settings.identify;
        let told = |moved: &Moved| {
            let named = |what: String| (moved.printhead.clone(), what);
            moved.warnings(identify).into_iter().map(named).collect::<Vec<_>>()
        };
        let of_heads: Vec<(Arc<str>, String)> = moved.iter().flat_map(told).collect();
        let moved_beyond = of_heads.iter().map(|(printhead, _)| printhead.clone()).collect();
        warnings.extend(of_heads);

        let damage = all_damage(recording, scan_damage, &mut tally, digest.damage);
        let counts = &tally.counts;
        check_rows(counts, table.rows())?;
        if counts.bursts == 0 {
            let others = recording.others.clone();
            let recording = recording.path.display().to_string();
            return Err(PipelineError::NoBursts { recording, others, damage });
        }

        if let Some(labels) = &replay.labels {
            labels_file::check(Path::new(&identify.labels), labels, &tally.met())?;
        }
        let refusals = std::mem::take(&mut schedule.refusals);
        let finished = Finishing {
            recording,
            settings: &replay.settings,
            tally: &tally,
            schedule: &schedule,
            refusals: &refusals,
            untimely: &episodes.report.untimely,
            with_design: replay.design.is_some(),
        };
        let mut not_judged = not_judged::not_judged(&finished);
        let (by_dialect, unread): (Vec<_>, Vec<_>) =
            not_judged::unread(&finished).into_iter().partition(|(topic, _)| topic.by_dialect);
        not_judged.extend(by_dialect.into_iter().map(|(_, told)| told));
        let unread: Vec<NotJudged> = unread.into_iter().map(|(_, told)| told).collect();
        let mut document = metadata::document(replay, recording, &digest.text, &schedule, counts);
        control.check()?;
        let place = verdicts.unwrap_or(&recording.path);
        let unwritten =
            |e: serde_json::Error| PipelineError::Write { path: place.into(), source: e.into() };
        let text = document.text().map_err(unwritten)?;
        let of_episodes = document.text_of_episodes().map_err(unwritten)?;
        let Finished { report: episodes, table: episode_table } = episodes;
        let (mut files, mut arrays) = (Vec::new(), None);
        match table {
            Table::Arrays(rows) => arrays = Some(rows.complete(text)),
            Table::File(table) => files = complete_tables(table, text, episode_table, of_episodes)?,
        }
        phases.add("finish", finishing.elapsed());
        let mut report = RecordingReport {
            name: recording.name.clone(),
            digest: digest.text,
            stamp: recording.stamp,
            damage,
            refusals,
            not_judged,
            unread,
            moved_beyond,
            warnings,
            learned_temperature: Vec::new(),
            models: schedule.models().len(),
            seconds: phases.seconds(),
            verdicts: verdicts.map(Path::to_path_buf).unwrap_or_default(),
            episodes,
            paced: (replay.settings.replay.pace != Pace::Max).then(|| self.pacer().kept),
            identified,
            phases: phases.list().to_vec(),
            timings,
            tally,
            baselines: memory,
            cut_off: recording.is_cut_off(),
            arrays,
            parts_left: None,
        };
        report.summary(&mut document.of_run, recording);
        document.of_run.insert("moved_together".into(), json!(moved));
        if let Some(memory) = &report.baselines {
            // what is known of other printheads says nothing of this recording
            let own = memory.printheads.iter();
            let own = own.filter(|(name, _)| report.tally.printheads.contains_key(name.as_str()));
            let channels: usize = own.map(|(_, of)| of.channels.len()).sum();
            let known = json!({ "channels_remembered": channels });
            document.of_run.insert("baseline".to_owned(), known);
        }
        if let Some(verdicts) = verdicts {
            files.push(complete_summary(verdicts, &document)?);
            name_all(files)?;
            // the table holds what they held
            report.parts_left = PartTables::beside(verdicts).remove_of(recording).err();
        }
        Ok(report)
    }
}

/// Every signal is a row.
fn check_rows(counts: &Counts, written: u64) -> Result<(), PipelineError> {
    let found = counts.signals;
    match counts.judged + counts.rejected.values().sum::<u64>() == found && written == found {
        true => Ok(()),
        false => Err(PipelineError::RowsLost { found, written }),
    }
}

/// By place in the file: what opening it, the scan, reading and the digest found, and what only its end tells.
fn all_damage(
    recording: &Recording,
    of_scan: Vec<Damage>,
    tally: &mut Tally,
    of_digest: Option<Damage>,
) -> Vec<Damage> {
    let mut damage = recording.damage.clone();
    damage.extend(of_scan);
    damage.append(&mut tally.damage);
    damage.extend(of_digest);
    damage.extend(recording.missing(tally.counts.bursts));
    damage.extend(recording.changed());
    damage.sort_by_key(|d| (d.from_byte, d.to_byte));
    damage
}

/// Complete on disk before any file gets its name; the table of verdicts last.
fn complete_tables(
    verdicts: VerdictWriter,
    document: String,
    episodes: Option<EpisodeWriter>,
    of_episodes: String,
) -> Result<Vec<CompleteFile>, PipelineError> {
    std::thread::scope(|both| {
        // each waits for the disk
        let episodes = both.spawn(|| episodes.map(|table| table.complete(of_episodes)).transpose());
        let verdicts = verdicts.complete(document);
        let episodes = episodes.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        Ok(episodes?.into_iter().chain([verdicts?]).collect())
    })
}

fn complete_summary(verdicts: &Path, summary: &Document) -> Result<CompleteFile, PipelineError> {
    let path = summary_file::path_beside(verdicts);
    let failed = |source| PipelineError::Write { path: path.clone(), source };
    let mut text = serde_json::to_string_pretty(summary).map_err(|e| failed(e.into()))?;
    text.push('\n');
    part_file::completed(&path, text.as_bytes()).map_err(failed)
}

/// An earlier run's files go before the first of these gets its name: at no instant do tables of two
/// runs lie side by side.
fn name_all(files: Vec<CompleteFile>) -> Result<(), PipelineError> {
    let failed = |path: &Path, source| PipelineError::Write { path: path.into(), source };
    for file in files.iter().rev() {
        stored::remove(file.path()).map_err(|e| failed(file.path(), e))?;
    }
    let paths: Vec<PathBuf> = files.iter().map(|file| file.path().to_path_buf()).collect();
    for file in files {
        let path = file.path().to_path_buf();
        file.name().map_err(|e| failed(&path, e))?;
    }
    let mut dirs: Vec<&PathBuf> = paths.iter().collect();
    dirs.dedup_by_key(|path| path.parent());
    dirs.iter().try_for_each(|path| part_file::sync_directory_of(path).map_err(|e| failed(path, e)))
}
