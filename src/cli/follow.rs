//! `inkling replay --follow`: judges a recording while it is being written, and tells episodes as
//! they are raised.
//!
//! In: the settings, which are checked here for `replay` ([`check`]). Out: [`FollowJudge`], the judge
//! that is asked for the only recording of the run. It hands functions to `pipeline::follow`, which
//! calls them with episodes and rows as the recording grows; they print, and tell the live view
//! (`live`). When the recording is closed, its files are those of any replay.

use super::exit::{Failure, unless_reader_gone};
use super::judge::{Judge, Judged, NotJudged, Run};
use super::live::Live;
use super::output;
use super::progress::{Progress, handle_interrupts};
use super::report::printable;
use crate::pipeline::{self, Control, EpisodeEvent, Watch};
use crate::report::clock;
use crate::settings::{Pace, Settings};
use inkling_core::verdict::Verdicts;
use inkling_io::job::Job;
use inkling_io::objects::in_object_store;
use inkling_io::recording::Recording;
use inkling_io::{Limits, printable};
use serde_json::json;
use std::net::SocketAddr;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::Ordering;

/// Refuses settings that cannot take effect on a recording that is being written, with what to do instead.
pub fn check(settings: &Settings, dry_run: bool) -> Result<(), Failure> {
    let input = &settings.input;
    let why = match input.recordings.as_slice() {
        _ if dry_run => "--dry-run does nothing, and --follow waits: leave one of them out",
        _ if settings.replay.pace != Pace::Max => {
            "the recorder sets the pace: leave --pace (replay.pace) out"
        }
        _ if settings.output.layout.is_by_day() => {
            "the day of the first burst is not known before it is written: choose --layout tree"
        }
        [one] if is_one_file(one) => return Ok(()),
        _ => "name the one recording file that is being written, on this machine",
    };
    Err(Failure::usage(format!("--follow: {why}")))
}

/// Whether a name is that of a file, there already or not; an object in a store appears when it is complete.
fn is_one_file(name: &str) -> bool {
    let path = Path::new(name);
    let is_pattern = !path.exists() && name.contains(['*', '?', '[', '{']);
    !(is_pattern || path.is_dir() || in_object_store(path))
}

/// A control for which the first Ctrl-C means that the recording is to be judged as far as it goes, and later
/// ones interrupt.
pub fn until_enough() -> Arc<Control> {
    handle_interrupts(|control| !control.enough.swap(true, Ordering::Relaxed))
}

/// Judges a recording in this process while it is being written.
pub struct FollowJudge {
    /// Whether events are told as JSON lines.
    pub json: bool,
    /// The live view, if there is one.
    pub live: Option<Arc<Live>>,
}

impl Judge for FollowJudge {
    fn judge(&mut self, run: &Run, _: usize, job: &Job) -> Result<Judged, NotJudged> {
        let (label, verdicts) = (&job.label(), job.verdicts_in(run.out));

        // if the reader of the output is gone, the tables are still written; another error is only
        // told
        let print = |printed: std::io::Result<()>| {
            if let Err(failure) = unless_reader_gone(printed) {
                run.progress.fail(&failure.message);
            }
        };

        // what the pipeline calls while it judges: everything goes to the output and to the live
        // view
        let state = || self.live.iter().map(|live| &live.state);
        let episode = |event: EpisodeEvent| {
            print(tell(label, event, self.json));
            state().for_each(|state| state.take_episode(event));
        };
        let rows = |of: &Verdicts| state().for_each(|state| state.take_rows(of));
        let rows: Option<&(dyn Fn(&Verdicts) + Sync)> = self.live.is_some().then_some(&rows);
        let watch = Watch { episode: &episode, rows };

        // judge until the recording is closed or Ctrl-C says that it is enough (`until_enough`)
        let report = run.progress.during(label, None, run.control, || {
            let enough = run.control.enough.clone();
            let mut recording =
                Recording::follow(&job.input.path, Limits::default(), run.dialects, enough)?;
            recording.label.clone_from(label);
            pipeline::follow(&run.replay, &recording, &verdicts, run.control, &watch)
        });
        self.live.iter().for_each(|live| live.end());
        Ok(Judged::of(report?, job, run.means, run.out, run.detail))
    }
}

/// Tells the address of the live view (`--serve`), as an event or as a message.
pub fn tell_address(address: SocketAddr, json: bool, progress: &Progress) -> Result<(), Failure> {
    if json {
        let event = json!({ "event": "serving", "address": address.to_string() });
        return unless_reader_gone(output::event(&event));
    }
    progress.say(&format!("to be looked at on http://{address}/"));
    Ok(())
}

/// Tells an episode when it is raised, revised or withdrawn: as a line, or as JSON with the keys of the table of
/// episodes.
fn tell(recording: &str, event: EpisodeEvent, json: bool) -> std::io::Result<()> {
    let (episode, mark) = match event {
        EpisodeEvent::Ended(_) => return Ok(()), // the table says it
        EpisodeEvent::Raised(now) => (now, ""),
        EpisodeEvent::Revised { now, .. } => (now, "revised: "),
        EpisodeEvent::Withdrawn(before) => (before, "revised: no episode, told as: "),
    };
    let text = || {
        let (raised, head) = (clock(episode.raised_at_ns), printable(&episode.printhead));
        let explanation = printable::line(&episode.explanation, 1000);
        format!("{raised}  {head:<20}  {mark}{explanation}")
    };
    output::tell(json, || output::episode_event(recording, event), text)
}
