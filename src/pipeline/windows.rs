//! Learns models from healthy windows in passes before the stages run, which asks nothing of the file's
//! order. What is in the order of its times is learned while it is judged ([`super::learning`]); both give
//! the same models, numbers and refusals.
//!
//! In: a survey, the settings, the design if there is one. Out: a [`Schedule`]. The signals of a window are a
//! bounded sample that does not depend on the file's order. Windows are taken a few at a time, so memory is
//! bounded whatever the recording's length.

use super::learner::{HELD_BYTES, Learner, Window, offer};
use super::progress::Progress;
use super::schedule::Schedule;
use super::survey::{Group, GroupKey, Survey};
use super::{Control, PipelineError, visit};
use inkling_core::identify::reservoir::Reservoir;
use inkling_io::recording::Recording;
use std::collections::{BTreeMap, HashSet};

impl Learner<'_> {
    /// Fills the timelines of every group that needs windows.
    pub fn learn<'a>(
        &self,
        recording: &Recording,
        survey: &Survey,
        mut schedule: Schedule<'a>,
        control: &Control,
    ) -> Result<Schedule<'a>, PipelineError> {
        // place the windows of every group that needs some
        let mut models: BTreeMap<usize, Progress> = BTreeMap::new();
        let mut windows = Vec::new();
        for (g, group) in survey.groups.iter().enumerate() {
            if self.needs_windows(&group.key, group.sample_period_s) {
                models.insert(g, Progress::start(self, &group.key));
                windows.extend(self.windows_of(g, group)?);
            }
        }
        // a few windows at a time, in the order of time: each pass reads only the blocks that touch them
        windows.sort_by_key(|w| (w.from_ns, w.group));
        let mut entries = Vec::new();
        for few in windows.chunks(self.at_a_time(survey)) {
            let reservoirs = self.fill(recording, survey, few, control)?;
            for (window, (bursts, reservoir)) in few.iter().zip(reservoirs) {
                if bursts == 0 && self.spans.is_empty() {
                    continue; // nothing was printed then: nothing to learn, nothing to judge by it
                }
                let Group { key, sample_period_s, .. } = &survey.groups[window.group];
                let Some(progress) = models.get_mut(&window.group) else { continue };
                let entry = progress.take(self, (key, *sample_period_s), *window, &reservoir);
                entries.extend(entry.map(|entry| (window.to_ns, key, entry)));
            }
        }
        // models are numbered in the order in which they become valid, whatever came first in the file
        entries.sort_by(|a, b| (a.0, a.1).cmp(&(b.0, b.1)));
        for (_, key, entry) in entries {
            entry.enter(key, &mut schedule)?;
        }

        let refusals = models.values_mut().map(|progress| std::mem::take(&mut progress.refusals));
        let refusals = refusals.flatten().collect();
        let groups = models.keys().map(|&g| &survey.groups[g].key);
        schedule.close(groups, refusals, self.nobody());
        Ok(schedule)
    }

    /// Places the windows of a group: those given by `identify.spans`, or else
    /// one that begins every so often.
    fn windows_of(&self, group_index: usize, group: &Group) -> Result<Vec<Window>, PipelineError> {
        let window = |from_ns: i64, to_ns: i64| Window { group: group_index, from_ns, to_ns };
        if !self.spans.is_empty() {
            return Ok(self.spans.iter().map(|&(from, to)| window(from, to)).collect());
        }
        let (first, every) = (self.first_ns(), self.every_ns());
        // After a pause, and so after a stray timestamp, windows begin anew with the first burst. A pause is
        // at least one empty bin.
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
        // without a distance between windows the survey has no bins, and there is one window
        if windows.is_empty() {
            windows.push(window(group.first_ns, group.first_ns.saturating_add(first)));
        }
        check_number(windows.len())?;
        Ok(windows)
    }

    /// How many windows may be held at a time, each as large as one of the longest signals may be.
    fn at_a_time(&self, survey: &Survey) -> usize {
        // samples are held as f32, 4 bytes each
        let samples = survey.groups.iter().map(|g| g.key.samples as usize).max().unwrap_or(1);
        let each = samples * 4 * self.most_signals(samples);
        (HELD_BYTES / each.max(1)).max(1)
    }

    /// Reads the blocks that touch some of `windows`, once, and samples their usable signals. Returns per
    /// window the number of bursts in it and its sample.
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
        // the blocks that hold bursts of a window's group within the window's time
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

/// An error if one printhead has more windows than half of the model numbers that there are.
pub fn check_number(windows: usize) -> Result<(), PipelineError> {
    let (windows, most) = (windows as u64, u64::from(u16::MAX) / 2);
    if windows > most { Err(PipelineError::TooManyWindows { windows, most }) } else { Ok(()) }
}
