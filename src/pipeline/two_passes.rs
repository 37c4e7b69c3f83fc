//! Learns models from healthy windows in passes before the stages run, which asks nothing of the file's order;
//! the models, numbers and refusals are those of [`super::learning`].
//!
//! In: a recording that is complete, from `replay`. Out: the models, in a schedule ([`Learning::learn_before`]).
//!
//! 1. Survey: one pass over all bursts finds when each printhead printed. A window is a span of the bursts' own
//!    times t_a, with which the log times of a chunk index need not agree.
//! 2. The windows are placed by these times (`placing`), as in the stream. For that the first and last time in
//!    each bin suffice: a bin is as long as windows are apart.
//! 3. A few windows at a time, so that memory is bounded, only the blocks that touch them are read again, and
//!    each window's signals are sampled. The sample does not depend on the file's order.
//! 4. The models are learned in the order of the windows' begins, and numbered in that of their ends.

use super::learning::Learning;
use super::tally::widen;
use super::timings::Phases;
use super::visit::Pass;
use super::window_rules::{HELD_BYTES, Window};
use super::{PipelineError, Result};
use inkling_core::burst::Burst;
use std::collections::{BTreeMap, HashMap, HashSet};

/// Maximum number of bins over all groups: about as many windows would be more than there are numbers (2^16).
const MOST_BINS: usize = 1 << 18;

#[derive(Default)]
struct Survey {
    /// Times of the first and last burst in every bin that holds some ([`super::placing`]).
    bins: BTreeMap<(usize, i64), (i64, i64)>,
    /// By block index: the groups in the block and the spans of their times.
    blocks: HashMap<u64, BTreeMap<usize, (i64, i64)>>,
}

impl Learning<'_> {
    pub fn learn_before(&mut self, pass: Pass, phases: &mut Phases) -> Result<()> {
        let survey = phases.time("survey", || self.survey(pass))?;
        phases.time("windows", || {
            let mut windows = self.place_all(&survey)?;
            // a few windows at a time, in the order of time: each pass reads only the blocks that touch them
            windows.sort_by_key(|w| (w.from_ns, w.group));
            let mut entries = Vec::new();
            for few in windows.chunks(self.at_a_time()) {
                self.fill(few, &survey, pass)?;
                entries.extend(self.learn_from(|_| true));
            }
            self.enter(entries)?;
            self.close();
            Ok(())
        })
    }

    fn survey(&mut self, pass: Pass) -> Result<Survey> {
        let mut survey = Survey::default();
        let Survey { bins, blocks } = &mut survey;
        // windows that the settings give have no placing: their bursts share one bin
        pass.all(|block, burst| {
            let Some(group) = self.number_of(burst) else { return };
            let t_ns = burst.t_acq_ns;
            let bin = self.groups[group].placing.as_ref().map_or(0, |placing| placing.bin(t_ns));
            if bins.len() < MOST_BINS {
                widen(bins.entry((group, bin)).or_insert((t_ns, t_ns)), t_ns);
            }
            let of_block = blocks.entry(block).or_default();
            widen(of_block.entry(group).or_insert((t_ns, t_ns)), t_ns);
        })?;

        let (windows, most) = (bins.len(), u64::from(u16::MAX));
        match windows < MOST_BINS {
            true => Ok(survey),
            false => Err(PipelineError::TooManyWindows { windows: windows as u64, most }),
        }
    }

    fn place_all(&mut self, survey: &Survey) -> Result<Vec<Window>> {
        let given = self.groups.iter_mut().flat_map(|group| group.open.drain(..));
        let mut windows: Vec<Window> = given.map(|open| open.window).collect();
        for (&(group, _), &(first_ns, last_ns)) in &survey.bins {
            let Some(placing) = &mut self.groups[group].placing else { continue };
            for t_ns in [first_ns, last_ns] {
                placing.reach(t_ns, |from_ns, to_ns| {
                    windows.push(Window { group, from_ns, to_ns });
                })?;
            }
        }
        Ok(windows)
    }

    /// How many windows may be held at a time, each as large as one of the longest signals may be.
    fn at_a_time(&self) -> usize {
        // samples are held as f32, 4 bytes each
        let samples = self.groups.iter().map(|group| group.key.samples as usize).max().unwrap_or(1);
        let each = samples * 4 * self.replay.most_signals(samples);
        (HELD_BYTES / each.max(1)).max(1)
    }

    /// Opens some windows, and reads the blocks that touch them, once, to sample their usable signals.
    fn fill(&mut self, windows: &[Window], survey: &Survey, pass: Pass) -> Result<()> {
        windows.iter().for_each(|window| self.groups[window.group].open(self.replay, *window));
        let touches = |(&group, &(from, to)): (&usize, &(i64, i64))| {
            windows.iter().any(|w| w.group == group && from < w.to_ns && to >= w.from_ns)
        };
        let of_windows = survey.blocks.iter().filter(|(_, spans)| spans.iter().any(touches));
        let wanted: HashSet<u64> = of_windows.map(|(&block, _)| block).collect();
        let sample = |_, burst: &Burst| {
            if let Some(group) = self.number_of(burst) {
                self.sample(group, burst);
            }
        };
        pass.bursts(|block| wanted.contains(&block), sample)?;
        Ok(())
    }
}
