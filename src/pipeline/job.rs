//! What a replay is asked to do.

use super::Control;
use super::pacer::Pacer;
use crate::settings::{Pace, Settings};
use inkling_core::design::Design;
use inkling_core::episodes::Episode;
use inkling_core::fault::Class;
use inkling_core::labels::Labels;
use inkling_core::side_by_side::cores;
use inkling_core::state::Memory;
use inkling_core::verdict::Verdicts;
use inkling_io::recording::Recording;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

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
    /// With `--baseline`: what is remembered of heads and channels.
    pub baselines: Option<Memory>,
}

impl Replay {
    pub fn classes(&self) -> Vec<String> {
        self.design.as_ref().map(Design::class_names).unwrap_or_default()
    }

    /// The same, and what they stand for.
    pub fn fault_classes(&self) -> Vec<Class> {
        self.design.as_ref().map(Design::fault_classes).unwrap_or_default()
    }

    /// Workers of a stage: its own setting, else `replay.threads`, else the machine's cores.
    pub(super) fn workers(&self, of_stage: usize) -> usize {
        match (of_stage, self.settings.replay.threads) {
            (0, 0) => cores(),
            (0, threads) => threads,
            (workers, _) => workers,
        }
    }
}

/// One recording on its way to its files.
#[derive(Clone, Copy)]
pub struct Run<'a> {
    pub replay: &'a Replay,
    pub recording: &'a Recording,
    /// Where the table will be; `None`: nothing is written, its rows stay in memory, episodes are only listed.
    pub verdicts: Option<&'a Path>,
    pub control: &'a Control,
    pub watch: Option<&'a Watch<'a>>,
    pub pacer: &'a Mutex<Pacer>,
}

impl<'a> Run<'a> {
    pub fn pacer(&self) -> MutexGuard<'_, Pacer> {
        self.pacer.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Where bursts are handed on at a pace.
    pub fn paced(&self) -> Option<&'a Mutex<Pacer>> {
        (self.replay.settings.replay.pace != Pace::Max).then_some(self.pacer)
    }
}

/// Who hears of a recording while it is written.
pub struct Watch<'a> {
    /// An episode was raised, or has changed.
    pub episode: &'a (dyn Fn(EpisodeEvent) + Sync),
    /// Something else is to be known.
    pub note: &'a (dyn Fn(&str) + Sync),
    /// Rows as they are written.
    pub rows: Option<&'a (dyn Fn(&Verdicts) + Sync)>,
    /// Parts of the table are closed meanwhile.
    pub rotation: Option<Rotation<'a>>,
}

/// What happened to an episode of a recording that is followed.
#[derive(Clone, Copy, Debug)]
pub enum EpisodeEvent<'a> {
    Raised(&'a Episode),
    /// It has another name, or was raised at another time, than it was announced with.
    Revised {
        now: &'a Episode,
        before: &'a Episode,
    },
    /// It is over.
    Ended(&'a Episode),
    /// It was announced, and the table has no such episode.
    Withdrawn(&'a Episode),
}

/// A part of the table every so often.
#[derive(Clone, Copy)]
pub struct Rotation<'a> {
    /// Of recording time.
    pub every: Duration,
    /// A part has its name.
    pub closed: &'a (dyn Fn(&ClosedPart) + Sync),
}

/// A part of the table that can be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ClosedPart {
    /// From 1 on.
    pub number: u32,
    pub path: PathBuf,
    pub rows: u64,
    /// t_a of its earliest and its latest burst.
    pub from_ns: i64,
    pub to_ns: i64,
}
