//! Which model judges which burst.

use super::PipelineError;
use super::survey::GroupKey;
use crate::burst::Burst;
use crate::design::{Design, HealthyModel, IsolateSettings, Judge, same_period};
use crate::verdict::Reason;
use std::collections::HashMap;
use std::sync::Arc;

/// A healthy window that gave no model, and why; stands in summary.json and on the terminal.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Refusal {
    pub printhead: String,
    pub from_ns: i64,
    pub to_ns: i64,
    pub why: String,
    /// Its model lies beyond the bounds of `identify.max_damping_drift` and `max_frequency_drift`.
    #[serde(skip)]
    pub drifted: bool,
}

/// The judges of one group over time, the first from the beginning on.
pub type Timeline = Vec<(i64, Arc<Judge>)>;

#[derive(Debug)]
pub enum Assignment<'a> {
    Judge(&'a Arc<Judge>),
    Reject(Reason),
    /// Only windows can tell.
    Survey,
}

/// Fixed before the stages start, asked by them for every burst.
#[derive(Debug, Default)]
pub struct Schedule {
    timelines: HashMap<GroupKey, Result<Timeline, Reason>>,
    /// By printhead, of the design; used where there is no timeline.
    by_name: HashMap<Arc<str>, Arc<Judge>>,
    /// What bursts of the design must have: sample period and samples.
    sampling: Option<(f64, usize)>,
    surveyed: bool,
    pub judges: Vec<Arc<Judge>>,
    pub refusals: Vec<Refusal>,
}

impl Schedule {
    /// By printhead: windows too small for the stated rate, whose thresholds lie further out for it.
    pub fn wide_thresholds(&self) -> Vec<(Arc<str>, String)> {
        let wide = |judge: &Arc<Judge>| {
            let what = judge.model.threshold.wide_in_words()?;
            Some((judge.model.printhead.as_deref().unwrap_or_default().into(), what))
        };
        self.judges.iter().filter_map(wide).collect()
    }

    /// The design's models as they are.
    pub fn of_design(
        design: &Design,
        settings: &IsolateSettings,
    ) -> Result<Schedule, PipelineError> {
        let mut schedule = Schedule {
            sampling: Some((design.sample_period_s, design.samples)),
            ..Schedule::default()
        };
        for model in &design.models {
            let judge =
                schedule.add(model.clone(), design.drive_voltage_v, Some(design), settings)?;
            if let Some(name) = &model.printhead {
                schedule.by_name.insert(name.as_str().into(), judge);
            }
        }
        Ok(schedule)
    }

    /// A new judge, next in the list of models.
    pub fn add(
        &mut self,
        model: HealthyModel,
        reference_v: Option<f64>,
        design: Option<&Design>,
        settings: &IsolateSettings,
    ) -> Result<Arc<Judge>, PipelineError> {
        let most = u64::from(u16::MAX);
        let index = u16::try_from(self.judges.len())
            .map_err(|_| PipelineError::TooManyWindows { windows: most + 1, most })?;
        let judge = Arc::new(Judge::new(index, model, reference_v, design, settings)?);
        self.judges.push(judge.clone());
        Ok(judge)
    }

    /// From a time on (ns) another model judges the signals of a group.
    pub fn enter(&mut self, key: &GroupKey, from_ns: i64, judge: Arc<Judge>) {
        let entry = self.timelines.entry(key.clone()).or_insert_with(|| Ok(Timeline::new()));
        if let Ok(timeline) = entry {
            // windows given as spans may end in any order
            let at = timeline.partition_point(|(from, _)| *from <= from_ns);
            timeline.insert(at, (from_ns, judge));
        }
    }

    /// All windows were learned: `groups` without a model are judged by nobody, for that reason, and what has
    /// neither windows nor a name in the design has no model.
    pub fn close<'a>(
        &mut self,
        groups: impl Iterator<Item = &'a GroupKey>,
        mut refusals: Vec<Refusal>,
        nobody: Reason,
    ) {
        for key in groups {
            self.timelines.entry(key.clone()).or_insert(Err(nobody));
        }
        let order = |r: &Refusal| (r.printhead.clone(), r.from_ns, r.to_ns, r.why.clone());
        refusals.sort_by_cached_key(order);
        self.refusals = refusals;
        self.surveyed = true;
    }

    pub fn judge_of(&self, printhead: &str) -> Option<Arc<Judge>> {
        self.by_name.get(printhead).cloned()
    }

    /// Whether a burst is sampled as the design is.
    pub fn fits(&self, burst: &Burst) -> bool {
        self.sampling.is_none_or(|(period, samples)| {
            same_period(period, burst.sample_period_s)
                && samples == burst.samples_per_channel as usize
        })
    }

    /// Of a group, as far as it is known.
    pub fn timeline(&self, key: &GroupKey) -> Timeline {
        self.timelines.get(key).and_then(|of| of.as_ref().ok()).cloned().unwrap_or_default()
    }

    pub fn assign(&self, burst: &Burst) -> Assignment<'_> {
        if !self.fits(burst) {
            return Assignment::Reject(Reason::DesignMismatch);
        }
        match self.timelines.get(&GroupKey::of(burst)) {
            Some(Ok(timeline)) => match at(timeline, burst.t_acq_ns) {
                Some(judge) => Assignment::Judge(judge),
                None => Assignment::Reject(Reason::NoModel),
            },
            Some(Err(reason)) => Assignment::Reject(*reason),
            None => match self.by_name.get(&burst.printhead) {
                Some(judge) => Assignment::Judge(judge),
                None if self.surveyed => Assignment::Reject(Reason::NoModel),
                None => Assignment::Survey,
            },
        }
    }
}

/// Causal: the last model whose window had ended; before the first one's end, the first.
pub fn at(timeline: &Timeline, t_ns: i64) -> Option<&Arc<Judge>> {
    let next = timeline.partition_point(|(from, _)| *from <= t_ns);
    timeline.get(next.saturating_sub(1)).map(|(_, judge)| judge)
}
