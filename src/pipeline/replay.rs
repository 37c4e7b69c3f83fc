//! The ways to judge a recording: into files ([`replay`]), in memory ([`judge`]), and while it is being written
//! ([`follow`]). The recording goes through the six stages (`wiring`).
//!
//! One pass is tried first (`Run::judge`): models are learned from windows while the signals flow. That needs
//! bursts about in the order of their times. If the chunk index says otherwise, or a burst comes too late, the
//! models are learned in passes of their own before the stages start. The tables are the same. A recording that
//! is being written cannot be read twice: it is judged again when it is closed.
//!
//! Episodes of such a recording are announced, each once, and again when it has changed
//! ([`EpisodeAnnouncer`]).

use super::episodes::EpisodeReport;
use super::learning::{Learning, MOST_REORDER_NS, USUAL_REORDER_NS};
use super::models::Models;
use super::pacer::Pacer;
use super::recording_report::RecordingReport;
use super::run::{EpisodeEvent, Replay, Run, Watch};
use super::schedule::Schedule;
use super::timings::Phases;
use super::visit::Pass;
use super::window_rules::Identified;
use super::wiring::StageResults;
use super::{Control, PipelineError, Result, locked};
use crate::settings::Pace;
use inkling_core::episodes::Episode;
use inkling_io::recording::Recording;
use std::collections::HashMap;
use std::path::Path;
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

pub fn replay(
    replay: &Replay,
    recording: &Recording,
    verdicts: &Path,
    control: &Control,
) -> Result<RecordingReport> {
    let verdicts = Some(verdicts);
    let pace = replay.settings.replay.pace;
    let pacer = Mutex::new(Pacer::new(pace));
    let pacer = (pace != Pace::Max).then_some(&pacer);
    let run = Run { replay, recording, verdicts, control, watch: None, pacer };
    run.judge(&mut Phases::new(recording.opening))
}

/// Judges one recording at full speed without writing files: the report holds the rows
/// ([`RecordingReport::arrays`]).
pub fn judge(replay: &Replay, recording: &Recording, control: &Control) -> Result<RecordingReport> {
    let run = Run { replay, recording, verdicts: None, control, watch: None, pacer: None };
    run.judge(&mut Phases::new(recording.opening))
}

/// Judges a recording that is being written ([`Recording::follow`]), until it is closed or `control.enough` is
/// set. Its tables are always those of a replay.
pub fn follow(
    replay: &Replay,
    recording: &Recording,
    verdicts: &Path,
    control: &Control,
    watch: &Watch,
) -> Result<RecordingReport> {
    let announcer = Mutex::new(EpisodeAnnouncer::default());
    // the table may say otherwise than what was announced: an episode is announced once, and corrected
    let announce = |event: EpisodeEvent| match event {
        EpisodeEvent::Raised(episode) => locked(&announcer).announce(episode, watch.episode),
        other => (watch.episode)(other),
    };

    let once = &Watch { episode: &announce, ..*watch };
    let pacer = None; // the recorder sets the pace
    let run =
        Run { replay, recording, verdicts: Some(verdicts), control, watch: Some(once), pacer };
    let report = followed(run)?;
    let mut announcer = announcer.into_inner().unwrap_or_else(PoisonError::into_inner);
    announcer.settle(&report.episodes, watch.episode);
    Ok(report)
}

/// Judges a recording while it grows. Where its models need two passes, waits and judges it again.
fn followed(run: Run) -> Result<RecordingReport> {
    let Run { recording, control, .. } = run;
    let mut phases = Phases::new(recording.opening);
    let why = match run.judge(&mut phases) {
        Err(e @ PipelineError::NeedsTwoPasses(_)) => {
            format!("{e}; what is found is told when the recording is closed")
        }
        Err(e @ PipelineError::Recording(_)) => {
            // that the file has shrunk, or another one has taken its place, comes first
            recording.check_same()?;
            return Err(e);
        }
        done => return done,
    };

    // the end of the stages has made readers stop waiting for more: allow that again
    control.abandoned.store(false, Ordering::Relaxed);
    run.watch.iter().for_each(|watch| (watch.note)(&why));
    phases.time("wait", || {
        let mut blocks = recording.blocks();
        while control.next_block(recording, &mut blocks)?.is_some() {}
        Ok::<(), PipelineError>(())
    })?;

    // closed: now it is opened as a whole, and judged like any other recording
    let recording = &recording.closed(&run.replay.settings.input.dialects())?;
    Run { recording, ..run }.judge(&mut phases)
}

impl<'a> Run<'a> {
    /// Judges the recording in one pass where its order allows that, else in two, which is an error for a
    /// recording that is still being written.
    pub fn judge(&self, phases: &mut Phases) -> Result<RecordingReport> {
        let why = match self.why_two_passes() {
            Some(why) => why,
            None => match self.stream(self.learning()?, phases) {
                // a burst came too late for the windows that were learned, or they hold too much
                Err(PipelineError::NeedsTwoPasses(why)) => why,
                done => return self.report(done?, Identified::by(self.replay, None), phases),
            },
        };
        match self.recording.is_growing() {
            true => Err(PipelineError::NeedsTwoPasses(why)),
            false => self.judge_in_two_passes(why, phases),
        }
    }

    pub fn judge_in_two_passes(&self, why: String, phases: &mut Phases) -> Result<RecordingReport> {
        let mut learning = self.learning()?;
        learning.learn_before(self.pass(), phases)?;
        let streamed = self.stream(learning, phases)?;
        self.report(streamed, Identified::by(self.replay, Some(why)), phases)
    }

    fn pass(&self) -> Pass<'a> {
        Pass { recording: self.recording, control: self.control }
    }

    fn learning(&self) -> Result<Learning<'a>> {
        let reorder_ns = self.recording.disorder_ns.unwrap_or_default().max(USUAL_REORDER_NS);
        let reorder_ns = reorder_ns.min(MOST_REORDER_NS) as i64;
        let schedule = Schedule::new(self.replay.design.as_ref(), &self.replay.settings.isolate)?;
        Ok(Learning::new(self.replay, schedule, reorder_ns, self.replay.workers()))
    }

    fn why_two_passes(&self) -> Option<String> {
        let disorder_ns = self.recording.disorder_ns.unwrap_or_default();
        if !self.replay.knows_by_design() && disorder_ns > MOST_REORDER_NS {
            let seconds = disorder_ns as f64 / 1e9;
            return Some(format!(
                "its chunks lie up to {seconds:.1} s out of the order of their times"
            ));
        }

        // in two passes windows are learned in the order of their begins, in the stream in that of their ends
        let mut spans = self.replay.spans.clone();
        spans.sort_unstable();
        let overlap = spans.windows(2).any(|pair| pair[0].1 > pair[1].0);
        overlap.then(|| "the windows of identify.spans overlap".into())
    }

    /// Sends the recording through the stages. The time of a run that is given up is counted apart.
    fn stream(&self, learning: Learning<'a>, phases: &mut Phases) -> Result<StageResults<'a>> {
        let (started, signals) = (Instant::now(), self.control.signals.load(Ordering::Relaxed));
        // bursts that were handed on in an earlier pass are not waited for
        self.pacer.into_iter().for_each(|pacer| locked(pacer).begin());
        let streamed = self.through_stages(Models::new(learning, self.pass()));
        if streamed.is_err() {
            self.control.signals.store(signals, Ordering::Relaxed); // they are judged again
        }
        phases.add(if streamed.is_ok() { "stages" } else { "given up" }, started.elapsed());
        streamed
    }
}

/// Maximum number of episodes that are remembered as announced.
const MOST_ANNOUNCED: usize = 1 << 20;

#[derive(Debug, Default)]
pub struct EpisodeAnnouncer {
    /// By printhead and channel, the episodes as each was last announced.
    announced: HashMap<(Arc<str>, u32), Vec<Episode>>,
    number: usize,
}

impl EpisodeAnnouncer {
    /// Sends an event if an episode is new, or if its name or the time at which it was raised has changed.
    pub fn announce(&mut self, now: &Episode, send: &dyn Fn(EpisodeEvent)) {
        let of_channel = self.announced.entry((now.printhead.clone(), now.channel)).or_default();
        match of_channel.iter_mut().find(|before| is_same(before, now)) {
            Some(before) => {
                if name(before) != name(now) || before.raised_at_ns != now.raised_at_ns {
                    send(EpisodeEvent::Revised { now, before });
                    before.clone_from(now);
                }
            }
            None => {
                send(EpisodeEvent::Raised(now));
                if self.number < MOST_ANNOUNCED {
                    self.number += 1;
                    of_channel.push(now.clone());
                }
            }
        }
    }

    /// Corrects what was announced, where the finished table says otherwise: announces what is new or has changed,
    /// and withdraws what the table does not have, in the order in which it was raised.
    pub fn settle(&mut self, table: &EpisodeReport, send: &dyn Fn(EpisodeEvent)) {
        table.listed.iter().for_each(|episode| self.announce(episode, send));
        if table.counts.episodes > table.listed.len() as u64 {
            return; // those that are not listed here may be what was announced
        }
        let mut gone: Vec<&Episode> = self
            .announced
            .values()
            .flatten()
            .filter(|announced| !table.listed.iter().any(|of| is_same(announced, of)))
            .collect();
        gone.sort_by_key(|of| (of.raised_at_ns, of.printhead.clone(), of.channel));
        gone.into_iter().for_each(|announced| send(EpisodeEvent::Withdrawn(announced)));
    }
}

/// Whether `a` and `b` are states of one episode: raised at the same time, or each while the other was on.
pub fn is_same(a: &Episode, b: &Episode) -> bool {
    let during = |of: &Episode, t_ns: i64| {
        of.began_at_ns <= t_ns && of.ended_at_ns.is_none_or(|end| t_ns < end)
    };
    a.printhead == b.printhead
        && a.channel == b.channel
        && (a.raised_at_ns == b.raised_at_ns
            || during(a, b.raised_at_ns) && during(b, a.raised_at_ns))
}

fn name(of: &Episode) -> (Option<&str>, Option<&str>) {
    (of.category.as_deref(), of.fault.as_deref())
}
