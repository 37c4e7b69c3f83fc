//! Healthy windows to models: averaging and identification, thesis §3-1, before the stages run.
//!
//! In: a survey, the settings, the design if there is one. Out: a [`Schedule`]. A window's signals
//! are a bounded sample that does not depend on the file's order; windows are taken a few at a time,
//! so memory is bounded whatever the recording's length. A fault that grows slowly must not be
//! learned as healthy: a model that drifted too far from the design's is refused.

use super::schedule::{Refusal, Schedule, Timeline};
use super::survey::{Group, GroupKey, Survey};
use super::{Control, PipelineError, visit};
use crate::burst::Burst;
use crate::design::{Design, HealthyModel, LearnSettings};
use crate::fault::HEALTHY;
use crate::identify::reservoir::Reservoir;
use crate::io::recording::Recording;
use crate::labels::Labels;
use crate::settings::{IdentifyMode, Settings};
use crate::verdict::{Reason, unusable_signal};
use std::collections::{BTreeMap, HashSet};

/// Bytes of signals that are held at a time while windows are learned.
pub(super) const HELD_BYTES: usize = 96 << 20;
/// Signals of a window that are held whatever their length.
const FEWEST_HELD: usize = 64;
/// Of the average's size, what the model must explain for anything to ring at all, per cent.
const LEAST_FIT_PERCENT: f64 = 50.0;
/// Signals that differ by more than this share of what is expected have no healthy signal in common.
const MOST_SCATTER: f64 = 0.5;

fn ns(seconds: f64) -> i64 {
    (seconds * 1e9) as i64
}

/// The threshold follows a window's median statistic up to this factor; beyond, something else than
/// the ink has changed, and nothing would be found.
const MOST_RATIO: f64 = 4.0;

/// A span of one group's time, half-open.
#[derive(Clone, Copy, Debug)]
struct Window {
    group: usize,
    from_ns: i64,
    to_ns: i64,
}

/// What windows are learned from and with.
pub struct Learner<'a> {
    pub settings: &'a Settings,
    pub design: Option<&'a Design>,
    pub labels: Option<&'a Labels>,
    /// Spans from the settings, if they were given.
    pub spans: Vec<(i64, i64)>,
}

impl Learner<'_> {
    /// Fills the timelines of every group that needs windows.
    pub fn learn(
        &self,
        recording: &Recording,
        survey: &Survey,
        mut schedule: Schedule,
        control: &Control,
    ) -> Result<Schedule, PipelineError> {
        let mut models: BTreeMap<usize, Progress> = BTreeMap::new();
        let mut windows = Vec::new();
        for (g, group) in survey.groups.iter().enumerate() {
            if self.needs_windows(group) {
                models.insert(g, Progress::start(self, group));
                windows.extend(self.windows_of(g, group)?);
            }
        }
        windows.sort_by_key(|w| (w.from_ns, w.group));
        for few in windows.chunks(self.at_a_time(survey)) {
            let reservoirs = self.fill(recording, survey, few, control)?;
            for (window, (bursts, reservoir)) in few.iter().zip(reservoirs) {
                if bursts == 0 && self.spans.is_empty() {
                    continue; // nothing was printed then: nothing to learn, nothing to judge by it
                }
                let group = &survey.groups[window.group];
                if let Some(progress) = models.get_mut(&window.group) {
                    progress.take(self, group, *window, reservoir);
                }
            }
        }
        // models are numbered by printhead, not by which came first in the file
        let mut models: Vec<(&Group, Progress)> =
            models.into_iter().map(|(g, progress)| (&survey.groups[g], progress)).collect();
        models.sort_by(|a, b| a.0.key.cmp(&b.0.key));
        for (group, progress) in models {
            progress.finish(self, group, &mut schedule)?;
        }
        schedule.set_surveyed();
        Ok(schedule)
    }

    /// In design mode only printheads that the design does not know are looked at.
    fn needs_windows(&self, group: &Group) -> bool {
        match self.design {
            None => true,
            Some(design) => {
                design.fits(group.sample_period_s, group.key.samples as usize)
                    && (self.settings.identify.mode == IdentifyMode::Windows
                        || design.model_of(&group.key.printhead).is_none())
            }
        }
    }

    fn windows_of(&self, group_index: usize, group: &Group) -> Result<Vec<Window>, PipelineError> {
        let window = |from_ns: i64, to_ns: i64| Window { group: group_index, from_ns, to_ns };
        if !self.spans.is_empty() {
            return Ok(self.spans.iter().map(|&(from, to)| window(from, to)).collect());
        }
        let (first, every) = (ns(self.settings.identify.first), self.every_ns());
        // After a pause, and so after a stray timestamp, windows begin anew with the first burst.
        let mut windows = Vec::new();
        let (mut start, mut after) = (group.first_ns, None);
        for (&bin, &(from, to)) in &group.bins {
            if after != Some(bin) {
                start = from;
            }
            after = Some(bin + 1);
            while start <= to {
                windows.push(window(start, start.saturating_add(first)));
                match start.checked_add(every) {
                    Some(next) => start = next,
                    None => break,
                }
            }
        }
        if windows.is_empty() {
            windows.push(window(group.first_ns, group.first_ns.saturating_add(first)));
        }
        let most = u64::from(u16::MAX) / 2;
        if windows.len() as u64 > most {
            return Err(PipelineError::TooManyWindows { windows: windows.len() as u64, most });
        }
        Ok(windows)
    }

    /// The distance of windows, ns; 0: there is only one, or they are given.
    pub fn every_ns(&self) -> i64 {
        if self.spans.is_empty() { ns(self.settings.identify.every) } else { 0 }
    }

    /// Signals of a window that are kept, at most: long ones are fewer.
    fn most_signals(&self, samples: usize) -> usize {
        let fit = HELD_BYTES / (4 * samples.max(1));
        self.settings.identify.window_signals.min(fit.max(FEWEST_HELD))
    }

    fn at_a_time(&self, survey: &Survey) -> usize {
        let samples = survey.groups.iter().map(|g| g.key.samples as usize).max().unwrap_or(1);
        let each = samples * 4 * self.most_signals(samples);
        (HELD_BYTES / each.max(1)).max(1)
    }

    /// Reads the blocks that touch some windows, once, and samples their usable signals; with each
    /// the number of bursts in it.
    fn fill(
        &self,
        recording: &Recording,
        survey: &Survey,
        windows: &[Window],
        control: &Control,
    ) -> Result<Vec<(u64, Reservoir)>, PipelineError> {
        let mut by_group: BTreeMap<&GroupKey, Vec<usize>> = BTreeMap::new();
        for (i, window) in windows.iter().enumerate() {
            by_group.entry(&survey.groups[window.group].key).or_default().push(i);
        }
        let touches = |&(g, from, to): &(u32, i64, i64)| {
            windows.iter().any(|w| w.group == g as usize && from < w.to_ns && to >= w.from_ns)
        };
        let wanted: HashSet<u64> = survey
            .blocks
            .iter()
            .filter(|(_, spans)| spans.iter().any(touches))
            .map(|(&block, _)| block)
            .collect();
        let mut reservoirs: Vec<Reservoir> = windows
            .iter()
            .map(|w| {
                let samples = survey.groups[w.group].key.samples as usize;
                Reservoir::new(samples, self.most_signals(samples))
            })
            .collect();
        let mut bursts = vec![0; windows.len()];
        visit::bursts(
            recording,
            control,
            |block| wanted.contains(&block),
            |_, burst| {
                for &i in by_group.get(&GroupKey::of(burst)).into_iter().flatten() {
                    if (windows[i].from_ns..windows[i].to_ns).contains(&burst.t_acq_ns) {
                        bursts[i] += 1;
                        offer(self.settings, self.labels, self.design, burst, &mut reservoirs[i]);
                    }
                }
            },
        )?;
        Ok(bursts.into_iter().zip(reservoirs).collect())
    }
}

/// Offers a burst's usable signals, with labels those that are labelled healthy; without what the design's
/// extension says is in them.
pub(super) fn offer(
    settings: &Settings,
    labels: Option<&Labels>,
    design: Option<&Design>,
    burst: &Burst,
    reservoir: &mut Reservoir,
) {
    let mut signal = vec![0.0; burst.samples_per_channel as usize];
    for row in 0..burst.channels {
        let channel = burst.first_channel + row;
        let healthy = |labels: &Labels| {
            labels
                .at(&burst.printhead, channel, burst.t_acq_ns)
                .is_some_and(|label| label.state == HEALTHY)
        };
        if labels.is_some_and(|labels| !healthy(labels)) {
            continue;
        }
        burst.copy_signal(row as usize, &mut signal);
        if unusable_signal(&signal, settings.input.rails).is_none() {
            let voltage = burst.drive_voltage_v.unwrap_or(f64::NAN);
            let temperature = burst.temperature_c.unwrap_or(f64::NAN);
            if let Some(design) = design {
                design.take_off_extension(burst, row as usize, &mut signal);
            }
            reservoir.offer(burst.t_acq_ns, channel, &signal, voltage, temperature);
        }
    }
}

/// Whether a window's signals agree with the healthy model that was learned from them: noise has no
/// model, and a mixture of healthy and faulty channels has one that is nobody's.
fn agree_with(model: &HealthyModel) -> Result<(), String> {
    let fit = model.identification.fit_percent;
    // a fit that is no number is refused too
    if !matches!(fit.partial_cmp(&LEAST_FIT_PERCENT), Some(o) if o.is_ge()) {
        return Err(format!(
            "the model explains {fit:.0} % of the average signal, {LEAST_FIT_PERCENT} % are needed: \
             nothing rings in this window"
        ));
    }
    let expected = model.expected.iter().map(|y| y * y).sum::<f64>() / model.expected.len() as f64;
    let scatter = (model.scatter.powi(2) - model.noise.powi(2)).max(0.0);
    if scatter > MOST_SCATTER.powi(2) * expected {
        return Err(format!(
            "the signals differ from each other by {:.0} % of the expected signal: no healthy signal \
             that most of them have in common; choose another window or give labels",
            100.0 * (scatter / expected).sqrt()
        ));
    }
    Ok(())
}

/// How far a group has come with its windows.
struct Progress {
    /// What drift is measured from, and what passes on temperature response and tail.
    reference: Option<HealthyModel>,
    /// The printhead has a model of its own in the design.
    known: bool,
    reference_v: Option<f64>,
    accepted: Vec<HealthyModel>,
    first_refused: bool,
    seen: usize,
    refusals: Vec<Refusal>,
}

impl Progress {
    fn start(learner: &Learner, group: &Group) -> Progress {
        let own = learner.design.and_then(|d| d.model_of(&group.key.printhead));
        let reference = own.or_else(|| learner.design.map(|d| &d.pooled)).cloned();
        Progress {
            known: own.is_some(),
            reference,
            reference_v: learner.design.and_then(|d| d.drive_voltage_v),
            accepted: Vec::new(),
            first_refused: false,
            seen: 0,
            refusals: Vec::new(),
        }
    }

    fn take(&mut self, learner: &Learner, group: &Group, window: Window, reservoir: Reservoir) {
        let first = self.seen == 0;
        self.seen += 1;
        match self.model(learner, group, reservoir) {
            Ok(mut model) => {
                model.valid_from_ns = Some(window.to_ns);
                if self.reference.is_none() {
                    self.reference = Some(model.clone());
                }
                self.accepted.push(model);
            }
            Err(why) => {
                self.first_refused |= first;
                self.refusals.push(Refusal {
                    printhead: group.key.printhead.to_string(),
                    from_ns: window.from_ns,
                    to_ns: window.to_ns,
                    why,
                });
            }
        }
    }

    fn model(
        &mut self,
        learner: &Learner,
        group: &Group,
        reservoir: Reservoir,
    ) -> Result<HealthyModel, String> {
        let identify = &learner.settings.identify;
        if learner.design.is_none() && self.reference_v.is_none() {
            let (sum, n) = reservoir.voltage_sum();
            self.reference_v = (n > 0).then(|| sum / n as f64);
        }
        let set = reservoir.into_set(self.reference_v);
        let settings = LearnSettings {
            grey_box: &identify.grey_box,
            detect: &learner.settings.detect,
            least_agreeing: learner.labels.is_none().then_some(identify.least_agreeing),
            sample_period_s: group.sample_period_s,
            filter: learner.design.as_ref().and_then(|design| design.filter.as_ref()),
        };
        let printhead = Some(&*group.key.printhead);
        let model = HealthyModel::learn(&set, printhead, self.reference.as_ref(), settings)
            .map_err(|e| e.to_string())?;
        if learner.labels.is_none() {
            agree_with(&model)?;
        }
        if let Some(reference) = &self.reference {
            let (frequency, damping) = reference.drift_to(&model);
            for (what, drift, most) in [
                ("frequency", frequency, identify.max_frequency_drift),
                ("damping", damping, identify.max_damping_drift),
            ] {
                // a drift that is no number is refused too
                if !matches!(drift.abs().partial_cmp(&most), Some(o) if o.is_le()) {
                    return Err(format!(
                        "{what} {:+.2} % from the reference model, beyond \
                         identify.max_{what}_drift = {:.2} %: a slow fault or another ink; \
                         the last accepted model stays",
                        100.0 * drift,
                        100.0 * most
                    ));
                }
            }
            let ratio = model.median_statistic / reference.median_statistic;
            if learner.design.is_some() && !(1.0 / MOST_RATIO..=MOST_RATIO).contains(&ratio) {
                return Err(format!(
                    "healthy signals lie {ratio:.3} times as far from the model as in the \
                     reference: another amplitude or another noise; the last accepted model stays"
                ));
            }
        }
        Ok(model)
    }

    /// Puts the group's models on the schedule.
    fn finish(
        self,
        learner: &Learner,
        group: &Group,
        schedule: &mut Schedule,
    ) -> Result<(), PipelineError> {
        schedule.refusals.extend(self.refusals);
        let isolate = &learner.settings.isolate;
        let mut timeline: Timeline = Vec::new();
        let agrees = !self.accepted.is_empty();
        if learner.settings.identify.mode == IdentifyMode::Design && learner.design.is_some() {
            // the printhead is unknown to the design: its pooled model, if the windows agree
            if let (true, Some(pooled)) = (agrees, self.reference) {
                timeline.push((
                    i64::MIN,
                    schedule.add(pooled, self.reference_v, learner.design, isolate)?,
                ));
            }
        } else {
            if self.first_refused
                && self.known
                && let Some(judge) = schedule.judge_of(&group.key.printhead)
            {
                timeline.push((i64::MIN, judge));
            }
            for model in self.accepted {
                let from = model.valid_from_ns.unwrap_or(i64::MIN);
                timeline
                    .push((from, schedule.add(model, self.reference_v, learner.design, isolate)?));
            }
        }
        timeline.sort_by_key(|(from, _)| *from); // windows given as spans may end in any order
        let nobody =
            if learner.design.is_some() { Reason::DesignMismatch } else { Reason::NoModel };
        let timeline = if timeline.is_empty() { Err(nobody) } else { Ok(timeline) };
        schedule.set(group.key.clone(), timeline);
        Ok(())
    }
}
