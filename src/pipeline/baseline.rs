//! Channels' own baselines over a recording: learned in a pass before the stages, used by them.
//!
//! In: the baselines remembered, a recording, its schedule. Out: [`InUse`], by which the recording is
//! judged, and the baselines for the next one. Only with `--baseline`.
//!
//! Judged by: what was remembered; where nothing was, what the channel said in the printhead's first
//! window (`identify.first`), from its end on. What the recording says later counts for the next one
//! only, so that a verdict depends on no order, chunking or thread.
//!
//! A pass of its own, since all of the recording says whether a printhead's baselines are used in any of it
//! (`Told::is_estranged`): its first verdicts depend on its last signals. In the stream they would be
//! given by baselines that its end refuses.

use super::batches::Assigned;
use super::schedule::{Assignment, Schedule};
use super::statistics::Statistics;
use super::{Control, PipelineError, visit};
use crate::burst::{Acquisition, Burst};
use crate::design::{
    Baselines, Design, Detection, Heard, MOST_CHANNELS, Own, OwnChannels, PrintheadBaselines,
    Workspace,
};
use crate::io::recording::Recording;
use crate::settings::Settings;
use crate::verdict::{Reason, unusable_signal};
use nalgebra::Matrix4;
use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

/// Baselines that a recording is judged by.
#[derive(Debug)]
pub struct InUse {
    printheads: HashMap<Arc<str>, OwnChannels>,
    /// Channels known from before, learned in the first window, heard in all, beyond the limit.
    pub remembered: usize,
    pub learned: usize,
    pub heard: usize,
    pub beyond: u64,
    /// Printheads whose baselines are not used, and why.
    pub refused: Vec<(Arc<str>, String)>,
}

impl InUse {
    /// For the summary of a recording.
    pub fn summary(&self) -> serde_json::Value {
        serde_json::json!({
            "channels_remembered": self.remembered,
            "channels_learned_in_the_first_window": self.learned,
            "channels_heard": self.heard,
            "signals_of_channels_beyond_the_limit": self.beyond,
        })
    }

    /// Of a burst's row.
    pub fn of(&self, burst: &Burst, row: u32) -> Option<Own> {
        let channel = burst.first_channel.checked_add(row)?;
        self.printheads.get(&burst.printhead)?.of(channel, burst.t_acq_ns)
    }

    /// Whether a channel of a printhead has a baseline at a time.
    pub fn knows(&self, printhead: &str, channel: u32, t_ns: i64) -> bool {
        self.printheads.get(printhead).is_some_and(|of| of.knows(channel, t_ns))
    }

    /// Judges again by its own baseline every signal that has one.
    pub fn sharpen(
        &self,
        assigned: &Assigned,
        statistics: &mut Statistics,
        statistic: &mut [Result<Detection, Reason>],
    ) {
        let mut first = 0;
        for (acquisition, judge) in assigned.read.batch.acquisitions.iter().zip(&assigned.judges) {
            let rows = first..first + acquisition.rows();
            first = rows.end;
            let (Acquisition::Usable(burst), Ok(judge)) = (acquisition, judge) else { continue };
            if judge.detector().is_none() || !self.printheads.contains_key(&burst.printhead) {
                continue;
            }
            for (row, of_row) in statistic[rows].iter_mut().enumerate() {
                if let (Ok(of_all), Some(own)) = (*of_row, self.of(burst, row as u32)) {
                    let of_own = statistics.of_own(judge, burst, row, own);
                    *of_row = of_own.map(|of_own| Detection { ring: of_own.ring, ..of_all });
                }
            }
        }
    }
}

/// First usable burst of every printhead, ns.
pub fn starts(
    recording: &Recording,
    control: &Control,
) -> Result<BTreeMap<Arc<str>, i64>, PipelineError> {
    let mut starts: BTreeMap<Arc<str>, i64> = BTreeMap::new();
    visit::all(recording, control, |burst| {
        let t = burst.t_acq_ns;
        if let Some(first) = starts.get_mut(&burst.printhead) {
            *first = t.min(*first);
        } else if starts.len() < super::survey::MOST_GROUPS {
            starts.insert(burst.printhead.clone(), t);
        }
    })?;
    Ok(starts)
}

/// A printhead's baselines are not used where so many of its signals that look like a healthy channel
/// do not look like their own: it is another head, or something drifted that the models do not know.
/// Some slightly dried nozzles are far less.
const MOST_ESTRANGED: f64 = 0.2;

/// What a recording says of a printhead.
#[derive(Default)]
struct Told {
    heard: Heard,
    /// Of a fit.
    noise: Matrix4<f64>,
    /// Signals near all channels whose channel has a baseline, and those of them that are far from it.
    near: u64,
    estranged: u64,
}

impl Told {
    fn is_estranged(&self) -> bool {
        self.estranged as f64 > MOST_ESTRANGED * self.near as f64
    }
}

/// What judges a recording, and what is remembered after it.
pub struct Learned {
    pub in_use: InUse,
    pub next: Baselines,
}

type HeardOf = BTreeMap<Arc<str>, Told>;

/// Learns from a recording, in two passes: what the first window says of channels that are not
/// remembered, then what all of it says, judged by both. With a design that has no sensitivities
/// nothing is learned.
pub fn learn(
    remembered: &Baselines,
    recording: &Recording,
    schedule: &Schedule,
    design: Option<&Design>,
    settings: &Settings,
    control: &Control,
) -> Result<Learned, PipelineError> {
    let starts = starts(recording, control)?;
    let window_ns = (settings.identify.first * 1e9) as i64;
    let end = |printhead: &str| {
        starts.get(printhead).map_or(i64::MAX, |start| start.saturating_add(window_ns))
    };
    let known = |name: &Arc<str>, judging: &PrintheadBaselines| {
        let known = remembered.printheads.get(&**name);
        let from = |channel: u32| match known {
            Some(known) if known.channels.contains_key(&channel) => i64::MIN,
            _ => end(name),
        };
        let curves = design.and_then(Design::curves);
        OwnChannels::new(judging, from, curves.as_deref(), settings.detect.false_alarm_rate)
    };
    let mut owns: HashMap<Arc<str>, OwnChannels> = remembered
        .printheads
        .iter()
        .map(|(name, of_name)| {
            let name: Arc<str> = name.as_str().into();
            (name.clone(), known(&name, of_name))
        })
        .collect();
    let pass = Pass { recording, schedule, rails: settings.input.rails, control };
    let room = MOST_CHANNELS.saturating_sub(remembered.channels());
    let first = pass.hear(&owns, room, |burst| burst.t_acq_ns < end(&burst.printhead))?;
    for (name, told) in &first {
        let judging = remembered.with_first_window(name, &told.heard, &told.noise);
        owns.insert(name.clone(), known(name, &judging));
    }
    let all = pass.hear(&owns, room, |_| true)?;

    let mut next = remembered.clone();
    let (mut learned, mut heard, mut beyond) = (0, 0, 0);
    let mut refused = Vec::new();
    for (name, told) in &all {
        heard += told.heard.channels();
        beyond += told.heard.beyond;
        if told.is_estranged() {
            owns.remove(name);
            refused.push((name.clone(), estranged(told)));
        } else {
            next.learn(name, &told.heard, &told.noise);
        }
    }
    for (name, own) in &owns {
        let known = remembered.printheads.get(&**name).map_or(0, |known| known.channels.len());
        learned += own.channels().saturating_sub(known);
    }
    // of the recording's own printheads: what is known of others says nothing about it
    let own = starts.keys().filter_map(|name| remembered.printheads.get(&**name));
    let remembered = own.map(|known| known.channels.len()).sum();
    let in_use = InUse { printheads: owns, remembered, learned, heard, beyond, refused };
    Ok(Learned { in_use, next })
}

fn estranged(told: &Told) -> String {
    format!(
        "its channels' own baselines are not used, nor brought up to date: {:.0} % of the signals that \
         look healthy do not look like their own channel. Another printhead of that name (then give \
         it a baseline file of its own), or a drift that the models do not know, such as temperature",
        100.0 * told.estranged as f64 / told.near as f64
    )
}

struct Pass<'a> {
    recording: &'a Recording,
    schedule: &'a Schedule,
    rails: [f64; 2],
    control: &'a Control,
}

impl Pass<'_> {
    /// Takes the bursts that `want` chooses. A signal is healthy if it is near all channels, and near
    /// its own baseline where there is one.
    fn hear(
        &self,
        owns: &HashMap<Arc<str>, OwnChannels>,
        mut room: usize,
        want: impl Fn(&Burst) -> bool,
    ) -> Result<HeardOf, PipelineError> {
        let mut heard = HeardOf::new();
        let (mut signal, mut expected, mut work) = (Vec::new(), Vec::new(), Workspace::default());
        let mut unknown = false;
        visit::all(self.recording, self.control, |burst| {
            if !want(burst) {
                return;
            }
            let judge = match self.schedule.assign(burst) {
                Assignment::Judge(judge) => judge,
                Assignment::Survey => return unknown = true,
                Assignment::Reject(_) => return,
            };
            let Some(detector) = judge.detector() else { return };
            let told = heard.entry(burst.printhead.clone()).or_default();
            told.noise = *detector.own_noise();
            let own = owns.get(&burst.printhead);
            let (n, drive) = (burst.samples_per_channel as usize, judge.drive(burst));
            signal.resize(n, 0.0);
            expected.resize(n, 0.0);
            judge.expect(burst, &mut expected);
            for row in 0..burst.channels {
                let Some(channel) = burst.first_channel.checked_add(row) else { break };
                burst.copy_signal(row as usize, &mut signal);
                if unusable_signal(&signal, self.rails).is_some() {
                    continue;
                }
                judge.deviate(burst, row as usize, &expected, &mut signal);
                work.own = None;
                let found = judge.detect(&signal, drive, &mut work);
                if judge.test(found).is_flagged() {
                    continue; // what no ring explains tells nothing of a channel's ring
                }
                let mut statistic = found.ring;
                // whatever its time: what is learned later was not judged by it
                work.own = own.and_then(|own| own.of(channel, i64::MAX));
                let threshold = judge.model.threshold.value;
                if work.own.is_some() && statistic <= threshold {
                    statistic = statistic.max(judge.detect(&signal, drive, &mut work).ring);
                    told.near += 1;
                    told.estranged += u64::from(statistic > threshold);
                }
                let healthy = statistic <= threshold;
                let features = detector.own_features(&signal, drive);
                told.heard.take(channel, &features, drive, healthy, &mut room);
            }
        })?;
        if unknown { Err(PipelineError::NeedsSurvey) } else { Ok(heard) }
    }
}
