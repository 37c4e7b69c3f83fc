//! Channels' own baselines over a recording: by which of them it is judged, and what is remembered after it.
//!
//! In: the baselines remembered, what was heard. Out: [`InUse`], by which the recording is judged, and the baselines
//! for the next one. Only with `--baseline`.
//!
//! Judged by: what was remembered; where nothing was, what the channel said in the printhead's first
//! window (`identify.first`), from its end on. What the recording says later counts for the next one
//! only, so that a verdict depends on no order, chunking or thread.
//!
//! All of the recording says whether a printhead's baselines are used in any of it ([`Told::is_estranged`]). That they
//! are not is rare: signals are judged by them as they flow ([`super::hearing`], [`super::first_windows`]), and where
//! the end refuses them, or the order of the file does not allow it, all is gone through again in passes of their own
//! ([`super::heard_before`]), with the same baselines.

use super::PipelineError;
use crate::burst::Burst;
use crate::design::Own;
use crate::design::{
    Baselines, Design, Heard, Judge, MOST_CHANNELS, OwnChannels, PrintheadBaselines,
};
use crate::isolate::physics_density::FaultCurves;
use crate::settings::Settings;
use nalgebra::Matrix4;
use std::collections::{BTreeMap, HashMap};
use std::sync::{Arc, PoisonError, RwLock};

/// Baselines that a recording is judged by.
#[derive(Debug, Default)]
pub struct InUse {
    printheads: RwLock<HashMap<Arc<str>, OfPrinthead>>,
}

#[derive(Debug, Default)]
struct OfPrinthead {
    remembered: Option<Arc<OwnChannels>>,
    /// From the end of the first window on, ns, if that taught new channels.
    later: Option<(i64, Arc<OwnChannels>)>,
}

impl InUse {
    /// A printhead's at a time.
    pub fn at(&self, printhead: &str, t_ns: i64) -> Option<Arc<OwnChannels>> {
        let printheads = self.printheads.read().unwrap_or_else(PoisonError::into_inner);
        let of = printheads.get(printhead)?;
        let later = of.later.as_ref().filter(|(from_ns, _)| *from_ns <= t_ns);
        later.map(|(_, own)| own).or(of.remembered.as_ref()).cloned()
    }

    /// Of a burst's row.
    pub fn of(&self, burst: &Burst, row: u32) -> Option<Own> {
        let channel = burst.first_channel.checked_add(row)?;
        self.at(&burst.printhead, burst.t_acq_ns)?.of(channel)
    }

    fn set(&self, printhead: &Arc<str>, set: impl FnOnce(&mut OfPrinthead)) {
        let mut printheads = self.printheads.write().unwrap_or_else(PoisonError::into_inner);
        set(printheads.entry(printhead.clone()).or_default());
    }

    /// The baselines of a printhead are not used.
    pub fn refuse(&self, printhead: &Arc<str>) {
        self.set(printhead, |of| *of = OfPrinthead::default());
    }

    /// Channels that had none before the first window.
    fn learned(&self) -> usize {
        let printheads = self.printheads.read().unwrap_or_else(PoisonError::into_inner);
        let of = |of: &OfPrinthead| {
            let remembered = of.remembered.as_ref().map_or(0, |own| own.channels());
            of.later.as_ref().map_or(0, |(_, own)| own.channels().saturating_sub(remembered))
        };
        printheads.values().map(of).sum()
    }
}

/// What was remembered before a recording, and what makes baselines of it.
#[derive(Debug)]
pub struct Remembered<'a> {
    baselines: &'a Baselines,
    curves: Option<Arc<FaultCurves>>,
    false_alarm_rate: f64,
    window_ns: i64,
}

impl<'a> Remembered<'a> {
    pub fn new(
        baselines: &'a Baselines,
        design: Option<&Design>,
        settings: &Settings,
    ) -> Remembered<'a> {
        Remembered {
            baselines,
            curves: design.and_then(Design::curves),
            false_alarm_rate: settings.detect.false_alarm_rate,
            window_ns: (settings.identify.first * 1e9) as i64,
        }
    }

    /// End of the first window of a printhead whose first burst is then, ns.
    pub fn end_ns(&self, start_ns: i64) -> i64 {
        start_ns.saturating_add(self.window_ns)
    }

    /// Channels that may still be met.
    pub fn room(&self) -> usize {
        MOST_CHANNELS.saturating_sub(self.baselines.channels())
    }

    /// Whether all of a burst's channels are remembered.
    pub fn knows(&self, burst: &Burst) -> bool {
        self.baselines.printheads.get(&*burst.printhead).is_some_and(|of| {
            let to = burst.first_channel.saturating_add(burst.channels);
            of.channels.range(burst.first_channel..to).count() == burst.channels as usize
        })
    }

    fn own(&self, of: &PrintheadBaselines) -> Arc<OwnChannels> {
        Arc::new(OwnChannels::new(of, self.curves.as_deref(), self.false_alarm_rate))
    }

    /// A printhead is met.
    pub fn begin(&self, printhead: &Arc<str>, in_use: &InUse) {
        let known = self.baselines.printheads.get(&**printhead).map(|of| self.own(of));
        in_use.set(printhead, |of| of.remembered = known);
    }

    /// Its first window is over, in which this was told.
    pub fn end(&self, printhead: &Arc<str>, end_ns: i64, told: &Told, in_use: &InUse) {
        let known = self.baselines.printheads.get(&**printhead).map_or(0, |of| of.channels.len());
        let judging = self.baselines.with_first_window(printhead, &told.heard, &told.noise);
        if judging.channels.len() > known {
            let own = self.own(&judging);
            in_use.set(printhead, |of| of.later = Some((end_ns, own)));
        }
    }

    /// What all of a recording told; printheads whose baselines are not used are no longer in use.
    pub fn learn(&self, told: &HeardOf, in_use: &InUse) -> Learned {
        let mut learned = Learned {
            next: self.baselines.clone(),
            remembered: 0,
            learned: 0,
            heard: 0,
            beyond: 0,
            refused: Vec::new(),
        };
        for (name, told) in told {
            learned.heard += told.heard.channels();
            learned.beyond += told.heard.beyond;
            // of the recording's own printheads: what is known of others says nothing about it
            let known = self.baselines.printheads.get(&**name);
            learned.remembered += known.map_or(0, |known| known.channels.len());
            if told.is_estranged() {
                in_use.refuse(name);
                learned.refused.push((name.clone(), estranged(told)));
            } else {
                learned.next.learn(name, &told.heard, &told.noise);
            }
        }
        learned.learned = in_use.learned();
        learned
    }
}

/// A printhead's baselines are not used where so many of its signals that look like a healthy channel
/// do not look like their own: it is another head, or something drifted that the models do not know.
/// Some slightly dried nozzles are far less.
const MOST_ESTRANGED: f64 = 0.2;

/// What a recording says of a printhead.
#[derive(Debug, Default)]
pub struct Told {
    pub heard: Heard,
    /// Of a fit by the last of its models.
    noise: Matrix4<f64>,
    model: u16,
    /// Signals near all channels whose channel has a baseline, and those of them that are far from it.
    pub near: u64,
    pub estranged: u64,
}

impl Told {
    /// A signal was judged by it. `noise`: of its fits.
    pub fn meet(&mut self, judge: &Judge, noise: &Matrix4<f64>) {
        if judge.index >= self.model {
            (self.model, self.noise) = (judge.index, *noise);
        }
    }

    /// What was told elsewhere.
    pub fn add(&mut self, other: &Told) {
        self.heard.add(&other.heard);
        if other.model >= self.model {
            (self.model, self.noise) = (other.model, other.noise);
        }
        self.near += other.near;
        self.estranged += other.estranged;
    }

    fn is_estranged(&self) -> bool {
        self.estranged as f64 > MOST_ESTRANGED * self.near as f64
    }
}

/// By printhead.
pub type HeardOf = BTreeMap<Arc<str>, Told>;

/// What is remembered after a recording.
#[derive(Debug)]
pub struct Learned {
    pub next: Baselines,
    /// Channels known from before, learned in the first window, heard in all, beyond the limit.
    remembered: usize,
    learned: usize,
    heard: usize,
    beyond: u64,
    /// Printheads whose baselines are not used, and why.
    pub refused: Vec<(Arc<str>, String)>,
}

impl Learned {
    /// For the summary of a recording.
    pub fn summary(&self) -> serde_json::Value {
        serde_json::json!({
            "channels_remembered": self.remembered,
            "channels_learned_in_the_first_window": self.learned,
            "channels_heard": self.heard,
            "signals_of_channels_beyond_the_limit": self.beyond,
        })
    }

    /// Why what was judged in the stream must be judged again.
    pub fn must_judge_again(&self, room: usize) -> Result<(), PipelineError> {
        let why = match self.refused.first() {
            Some((printhead, _)) => format!(
                "its end says that the channels' baselines of {} are not to be used",
                crate::io::printable::line(printhead, 64)
            ),
            None if self.heard > room => "it has more channels than baselines are kept of".into(),
            None => return Ok(()),
        };
        Err(PipelineError::NeedsTwoPasses(why))
    }
}

fn estranged(told: &Told) -> String {
    format!(
        "its channels' own baselines are not used, nor brought up to date: {:.0} % of the signals that \
         look healthy do not look like their own channel. Another printhead of that name (then give \
         it a baseline file of its own), or a drift that the models do not know, such as temperature",
        100.0 * told.estranged as f64 / told.near as f64
    )
}
