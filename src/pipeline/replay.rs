//! The ways to judge a recording: into files ([`replay`]), in memory ([`judge`]), and while it is being written
//! ([`follow`]). The recording goes through the six stages (`wiring`).
//!
//! Episodes of a recording that is being written are announced, each once, and again when it has changed
//! ([`EpisodeAnnouncer`]).

use super::episodes::EpisodeReport;
use super::pacer::Pacer;
use super::recording_report::RecordingReport;
use super::run::{EpisodeEvent, Replay, Run, Watch};
use super::{Control, PipelineError, Result, locked};
use crate::settings::Pace;
use inkling_core::episodes::Episode;
use inkling_io::recording::Recording;
use std::collections::HashMap;
use std::path::Path;
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
    run.judge()
}

/// Judges one recording at full speed without writing files: the report holds the rows
/// ([`RecordingReport::arrays`]).
pub fn judge(replay: &Replay, recording: &Recording, control: &Control) -> Result<RecordingReport> {
    let run = Run { replay, recording, verdicts: None, control, watch: None, pacer: None };
    run.judge()
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
    // announcements come as bursts do and the table is in the order of time, so they may differ: each episode is
    // announced once, and corrected when the table is finished
    let announce = |event: EpisodeEvent| match event {
        EpisodeEvent::Raised(episode) => locked(&announcer).announce(episode, watch.episode),
        other => (watch.episode)(other),
    };

    let announcing = &Watch { episode: &announce, ..*watch };
    let pacer = None; // the recorder sets the pace
    let run = Run {
        replay,
        recording,
        verdicts: Some(verdicts),
        control,
        watch: Some(announcing),
        pacer,
    };
    let report = run.judge().map_err(|e| match e {
        // that the file has shrunk, or another one has taken its place, comes first
        PipelineError::Recording(e) => recording.check_same().err().unwrap_or(e).into(),
        other => other,
    })?;
    let mut announcer = announcer.into_inner().unwrap_or_else(PoisonError::into_inner);
    announcer.settle(&report.episodes, watch.episode);
    Ok(report)
}

impl Run<'_> {
    /// Sends the recording through the stages, and makes its report and its files.
    fn judge(&self) -> Result<RecordingReport> {
        let started = Instant::now();
        let results = self.through_stages()?;
        self.report(results, started)
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
