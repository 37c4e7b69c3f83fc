//! The ways to judge a recording: into files, in memory, and while it is being written.

use super::episode_announcer::EpisodeAnnouncer;
use super::job::{EpisodeEvent, Replay, Watch};
use super::pacer::Pacer;
use super::recording_report::RecordingReport;
use super::run::Run;
use super::timings::Phases;
use super::{Control, PipelineError, rotation};
use crate::settings::Pace;
use inkling_io::recording::Recording;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

/// Judges one recording, and writes its verdicts to `verdicts` and the other results beside them.
pub fn replay(
    replay: &Replay,
    recording: &Recording,
    verdicts: &Path,
    control: &Control,
) -> Result<RecordingReport, PipelineError> {
    let verdicts = Some(verdicts);
    let pacer = &Mutex::new(Pacer::new(replay.settings.replay.pace));
    let run = Run { replay, recording, verdicts, control, watch: None, pacer };
    run.judge(&mut Phases::new(recording.opening))
}

/// Judges one recording without writing files: the report holds the rows ([`RecordingReport::arrays`]).
pub fn judge(
    replay: &Replay,
    recording: &Recording,
    control: &Control,
) -> Result<RecordingReport, PipelineError> {
    let pacer = &Mutex::new(Pacer::new(Pace::Max));
    let run = Run { replay, recording, verdicts: None, control, watch: None, pacer };
    run.judge(&mut Phases::new(recording.opening))
}

/// Judges a recording that is being written ([`Recording::follow`]), until it is closed or `control.enough`
/// is set. Where models need the whole recording, it is judged again when it is closed, so that its tables
/// are always those of a replay.
pub fn follow(
    replay: &Replay,
    recording: &Recording,
    verdicts: &Path,
    control: &Control,
    watch: &Watch,
) -> Result<RecordingReport, PipelineError> {
    let announcer = Mutex::new(EpisodeAnnouncer::default());
    // The recording may be judged twice, and the table may say otherwise than what was announced at once: an
    // episode is announced once, and corrected at the end.
    let announce = |event: EpisodeEvent| {
        let mut announcer = announcer.lock().unwrap_or_else(PoisonError::into_inner);
        match event {
            EpisodeEvent::Raised(episode) => announcer.announce(episode, watch.episode),
            other => (watch.episode)(other),
        }
    };

    let once = &Watch { episode: &announce, ..*watch };
    let pacer = &Mutex::new(Pacer::new(Pace::Max)); // the recorder sets it
    let run =
        Run { replay, recording, verdicts: Some(verdicts), control, watch: Some(once), pacer };
    let report = followed(run, verdicts)?;
    // the table is final: correct what was announced before
    let mut announcer = announcer.into_inner().unwrap_or_else(PoisonError::into_inner);
    announcer.settle(&report.episodes, watch.episode);
    Ok(report)
}

/// Judges a recording while it grows. Where that does not suffice, waits for its end and judges it again.
fn followed(run: Run, verdicts: &Path) -> Result<RecordingReport, PipelineError> {
    let Run { recording, control, .. } = run;
    let is_rotated = run.watch.is_some_and(|watch| watch.rotation.is_some());
    if is_rotated {
        rotation::make_room(verdicts, recording)?;
    }
    let mut phases = Phases::new(recording.opening);
    let why = match run.judge(&mut phases) {
        Err(e @ PipelineError::NeedsTwoPasses(_)) => {
            format!("{e}; what is found is told when the recording is closed")
        }
        Err(e @ PipelineError::Recording(_)) => {
            // if the file has shrunk or another one has taken its place meanwhile, that is the error to tell
            recording.check_same()?;
            return Err(e);
        }
        done => return done,
    };

    // If stages were running, their end has made readers stop waiting for more: allow that again.
    control.set_abandoned(false);
    run.watch.iter().for_each(|watch| (watch.note)(&why));
    if is_rotated {
        rotation::remove(verdicts, recording)?; // what is in them is judged again
    }
    // read on to the end of the recording, without judging anything
    phases.time("wait", || {
        let mut blocks = recording.blocks();
        while control.next_block(recording, &mut blocks)?.is_some() {}
        Ok::<(), PipelineError>(())
    })?;

    // closed: now it can be judged like any other recording
    let recording = &recording.closed(&run.replay.settings.input.dialects())?;
    Run { recording, ..run }.judge(&mut phases)
}
