//! What a replay is asked to do ([`Replay`] for all recordings, [`Run`] for one), and who is told of its results
//! while it runs ([`Watch`]). Types only: `replay` and `wiring` act on them.

use super::Control;
use super::pacer::Pacer;
use crate::settings::Settings;
use inkling_core::design::Design;
use inkling_core::episodes::Episode;
use inkling_core::fault::Class;
use inkling_core::labels::Labels;
use inkling_core::side_by_side::cores;
use inkling_core::state::{Memory, Replaced};
use inkling_core::verdict::Verdicts;
use inkling_io::recording::Recording;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Mutex;

/// What a run of replay has in common over its recordings; as JSON all that another process needs for it.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Replay {
    pub settings: Settings,
    /// The design; `None`: models come from windows alone, and nothing is named.
    pub design: Option<Design>,
    pub design_digest: Option<String>,
    /// Labels that say which signals of windows are healthy; `None`: those that agree are.
    pub labels: Option<Labels>,
    /// With `--baseline`: what is remembered of heads and channels from the recordings before; `None`: nothing is,
    /// and channels are not judged about levels of their own.
    pub baselines: Option<Memory>,
    /// Channels and printheads that somebody has acknowledged as replaced: they begin anew.
    #[serde(default)]
    pub replaced: Vec<Replaced>,
}

impl Replay {
    pub fn classes(&self) -> Vec<String> {
        self.design.as_ref().map(Design::class_names).unwrap_or_default()
    }

    pub fn fault_classes(&self) -> Vec<Class> {
        self.design.as_ref().map(Design::fault_classes).unwrap_or_default()
    }

    /// Lets what was replaced begin anew, before a recording that begins at `at_ns` (`None`: nobody knows when) is
    /// judged.
    pub fn begin_recording(&mut self, at_ns: Option<i64>) {
        if let Some((baselines, at_ns)) = self.baselines.as_mut().zip(at_ns) {
            baselines.begin_anew(&self.replaced, at_ns);
        }
    }

    /// Number of workers of a stage that may have several: `replay.threads`, or the machine's cores.
    pub(super) fn workers(&self) -> usize {
        match self.settings.replay.threads {
            0 => cores(),
            threads => threads,
        }
    }
}

#[derive(Clone, Copy)]
pub struct Run<'a> {
    pub replay: &'a Replay,
    pub recording: &'a Recording,
    /// Path of the verdict table; `None`: its rows stay in memory, and episodes are only listed.
    pub verdicts: Option<&'a Path>,
    pub control: &'a Control,
    pub watch: Option<&'a Watch<'a>>,
    /// Decides when bursts are handed on; `None`: at once.
    pub pacer: Option<&'a Mutex<Pacer>>,
}

/// Functions that are called while a recording that is still being written is judged.
pub struct Watch<'a> {
    /// Called when an episode was raised, or has changed.
    pub episode: &'a (dyn Fn(EpisodeEvent) + Sync),
    /// Called with rows when they are written.
    pub rows: Option<&'a (dyn Fn(&Verdicts) + Sync)>,
}

#[derive(Clone, Copy, Debug)]
pub enum EpisodeEvent<'a> {
    Raised(&'a Episode),
    /// It now has another name or another time of being raised than when it was announced.
    Revised {
        now: &'a Episode,
        before: &'a Episode,
    },
    Ended(&'a Episode),
    /// It was announced, but the finished table has no such episode.
    Withdrawn(&'a Episode),
}
