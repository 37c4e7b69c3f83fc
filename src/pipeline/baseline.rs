//! Channels' own baselines over a recording: learned in a pass before the stages, used by them.
//!
//! In: the baselines remembered, a recording, its schedule. Out: [`InUse`], by which the recording is
//! judged, and the baselines for the next one. Only with `--baseline`.
//!
//! Judged by: what was remembered; where nothing was, what the channel said in the printhead's first
//! window (`identify.first`), from its end on. What the recording says later counts for the next one
//! only, so that a verdict depends on no order, chunking or thread.

use super::schedule::{Assignment, Schedule};
use super::stages::Assigned;
use super::statistics::Statistics;
use super::{Control, PipelineError, visit};
use crate::burst::{Acquisition, Burst};
use crate::design::{Baselines, Design, Heard, MOST_CHANNELS, Own, OwnChannels, Workspace};
use crate::io::recording::Recording;
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
}

impl InUse {
    /// Of a burst's row.
    pub fn of(&self, burst: &Burst, row: u32) -> Option<Own> {
        let channel = burst.first_channel.checked_add(row)?;
        self.printheads.get(&burst.printhead)?.of(channel, burst.t_acq_ns)
    }

    /// Judges again by its own baseline every signal that has one.
    pub fn sharpen(
        &self,
        assigned: &Assigned,
        statistics: &mut Statistics,
        statistic: &mut [Result<f64, Reason>],
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
                if let (Ok(_), Some(own)) = (&of_row, self.of(burst, row as u32)) {
                    *of_row = statistics.of_own(judge, burst, row, own);
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
    visit::bursts(
        recording,
        control,
        |_| true,
        |_, burst| {
            let t = burst.t_acq_ns;
            if let Some(first) = starts.get_mut(&burst.printhead) {
                *first = t.min(*first);
            } else if starts.len() < super::survey::MOST_GROUPS {
                starts.insert(burst.printhead.clone(), t);
            }
        },
    )?;
    Ok(starts)
}

/// Learns from a recording. `window_ns`: length of the first window. With a design that has no
/// sensitivities nothing is learned.
pub fn learn(
    remembered: &Baselines,
    recording: &Recording,
    schedule: &Schedule,
    design: Option<&Design>,
    (rails, window_ns): ([f64; 2], i64),
    control: &Control,
) -> Result<(InUse, Baselines), PipelineError> {
    let starts = starts(recording, control)?;
    let mut heard: BTreeMap<Arc<str>, (Heard, Matrix4<f64>)> = BTreeMap::new();
    let mut room = MOST_CHANNELS.saturating_sub(remembered.channels());
    let (mut signal, mut expected, mut work) = (Vec::new(), Vec::new(), Workspace::default());
    let mut unknown = false;
    let owns: HashMap<&str, OwnChannels> = remembered
        .printheads
        .iter()
        .map(|(name, known)| (name.as_str(), OwnChannels::new(known, |_| i64::MIN, None)))
        .collect();
    visit::bursts(
        recording,
        control,
        |_| true,
        |_, burst| {
            let judge = match schedule.assign(burst) {
                Assignment::Judge(judge) => judge,
                Assignment::Survey => {
                    unknown = true;
                    return;
                }
                Assignment::Reject(_) => return,
            };
            let (Some(detector), Some(&start)) = (judge.detector(), starts.get(&burst.printhead))
            else {
                return;
            };
            let (of_printhead, noise) = heard.entry(burst.printhead.clone()).or_default();
            *noise = *detector.own_noise();
            let known = owns.get(&*burst.printhead);
            let (n, drive) = (burst.samples_per_channel as usize, judge.drive(burst));
            signal.resize(n, 0.0);
            expected.resize(n, 0.0);
            judge.expect(burst, &mut expected);
            let in_window = burst.t_acq_ns < start.saturating_add(window_ns);
            for row in 0..burst.channels {
                let Some(channel) = burst.first_channel.checked_add(row) else { break };
                burst.copy_signal(row as usize, &mut signal);
                if unusable_signal(&signal, rails).is_some() {
                    continue;
                }
                signal.iter_mut().zip(&expected).for_each(|(y, e)| *y -= e);
                // far from all channels, or from what this one was: not healthy
                work.own = None;
                let mut statistic = judge.statistic(&signal, drive, &mut work);
                work.own = known.and_then(|known| known.of(channel, burst.t_acq_ns));
                if work.own.is_some() {
                    statistic = statistic.max(judge.statistic(&signal, drive, &mut work));
                }
                let healthy = statistic <= judge.model.threshold.value;
                let features = detector.own_features(&signal, drive);
                of_printhead.take(channel, &features, drive, healthy, in_window, &mut room);
            }
        },
    )?;
    if unknown {
        return Err(PipelineError::NeedsSurvey);
    }
    let (mut next, mut printheads) = (remembered.clone(), HashMap::new());
    let (mut learned, mut channels, mut beyond) = (0, 0, 0);
    let curves = design.and_then(Design::curves);
    for (name, (heard, noise)) in &heard {
        let judging = remembered.with_first_window(name, heard, noise);
        let known = remembered.printheads.get(&**name);
        let is_new =
            |channel: u32| known.is_none_or(|known| !known.channels.contains_key(&channel));
        let start = starts.get(name).copied().unwrap_or(i64::MIN);
        let from = |channel: u32| match is_new(channel) {
            true => start.saturating_add(window_ns),
            false => i64::MIN,
        };
        learned += judging.channels.keys().filter(|&&channel| is_new(channel)).count();
        channels += heard.channels();
        beyond += heard.beyond;
        printheads.insert(name.clone(), OwnChannels::new(&judging, from, curves.as_deref()));
        next.learn(name, heard, noise);
    }
    let remembered = remembered.channels();
    Ok((InUse { printheads, remembered, learned, heard: channels, beyond }, next))
}
