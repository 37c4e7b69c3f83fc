//! Which model judges which burst.

use super::PipelineError;
use super::survey::{GroupKey, MOST_GROUPS};
use inkling_core::burst::Burst;
use inkling_core::design::{Design, HealthyModel, IsolateSettings, Judge, same_period};
use inkling_core::verdict::Reason;
use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

/// So many judges are made, one for each printhead if they are more, before those that nobody asked for meanwhile are
/// let go.
const MANY_NEW: usize = 64;

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

/// The time from which on a model judges, ns, and the model's number.
#[derive(Clone, Copy, Debug)]
pub struct ModelStart {
    pub t_ns: i64,
    pub number: u16,
}

/// The models of one group over time, the first from the beginning on.
#[derive(Clone, Debug, Default)]
pub struct Timeline(Vec<ModelStart>);

impl Timeline {
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    pub fn enter(&mut self, start: ModelStart) {
        // windows given as spans may end in any order
        let at = self.0.partition_point(|before| before.t_ns <= start.t_ns);
        self.0.insert(at, start);
    }

    /// Causal: the last model whose window had ended; before the first one's end, the first.
    pub fn at(&self, t_ns: i64) -> Option<u16> {
        let next = self.0.partition_point(|start| start.t_ns <= t_ns);
        self.0.get(next.saturating_sub(1)).map(|start| start.number)
    }
}

/// Who judges a burst.
#[derive(Clone, Copy, Debug)]
pub enum Assignment {
    Model(u16),
    Reject(Reason),
    /// Only windows can tell.
    Survey,
}

/// A model of the schedule, with the judge made of it, for as long as bursts ask for one.
#[derive(Debug)]
struct ScheduledModel {
    model: Arc<HealthyModel>,
    reference_v: Option<f64>,
    judge: Option<Arc<Judge>>,
    /// ModelStart judges were last let go.
    asked: bool,
}

/// All models of a run. A judge takes several times the memory of its model, and most are never asked again: they
/// are made when a burst asks, and kept while bursts do.
#[derive(Debug)]
pub struct Schedule<'a> {
    design: Option<&'a Design>,
    settings: &'a IsolateSettings,
    timelines: HashMap<GroupKey, Result<Timeline, Reason>>,
    /// By printhead, of the design; used where there is no timeline.
    by_name: HashMap<Arc<str>, u16>,
    surveyed: bool,
    models: Vec<ScheduledModel>,
    new: usize,
    pub refusals: Vec<Refusal>,
    /// Sample period and samples of the first burst of each printhead that is sampled otherwise than the design.
    sampled_otherwise: BTreeMap<Arc<str>, (f64, u32)>,
}

/// A model with its number and reference voltage, as the metadata of tables describe it.
#[derive(Clone, Copy, Debug)]
pub struct NumberedModel<'a> {
    pub number: u16,
    pub model: &'a HealthyModel,
    pub reference_v: Option<f64>,
}

impl<'a> Schedule<'a> {
    /// The design's models as they are, if there is one.
    pub fn new(
        design: Option<&'a Design>,
        settings: &'a IsolateSettings,
    ) -> Result<Schedule<'a>, PipelineError> {
        let (timelines, by_name, models) = (HashMap::new(), HashMap::new(), Vec::new());
        let mut schedule = Schedule {
            design,
            settings,
            timelines,
            by_name,
            surveyed: false,
            models,
            new: 0,
            refusals: Vec::new(),
            sampled_otherwise: BTreeMap::new(),
        };
        for model in design.into_iter().flat_map(|design| &design.models) {
            let reference_v = design.and_then(|design| design.drive_voltage_v);
            let number = schedule.add(Arc::new(model.clone()), reference_v)?;
            if let Some(name) = &model.printhead {
                schedule.by_name.insert(name.as_str().into(), number);
            }
        }
        Ok(schedule)
    }

    /// In the order of their numbers.
    pub fn models(&self) -> impl ExactSizeIterator<Item = NumberedModel<'_>> {
        let numbers = 0..self.models.len() as u16; // add() bounds them
        numbers.zip(&self.models).map(|(number, of)| {
            let ScheduledModel { model, reference_v, .. } = of;
            NumberedModel { number, model, reference_v: *reference_v }
        })
    }

    /// By printhead: windows too small for the stated rate, whose thresholds lie further out for it.
    pub fn wide_thresholds(&self) -> Vec<(Arc<str>, String)> {
        let wide = |of: &ScheduledModel| {
            let what = of.model.threshold.wide_in_words()?;
            Some((of.model.printhead.as_deref().unwrap_or_default().into(), what))
        };
        self.models.iter().filter_map(wide).collect()
    }

    /// A new model; its number.
    pub fn add(
        &mut self,
        model: Arc<HealthyModel>,
        reference_v: Option<f64>,
    ) -> Result<u16, PipelineError> {
        let most = u64::from(u16::MAX);
        let number = u16::try_from(self.models.len())
            .map_err(|_| PipelineError::TooManyWindows { windows: most + 1, most })?;
        self.models.push(ScheduledModel { model, reference_v, judge: None, asked: false });
        Ok(number)
    }

    /// Who judges by a model.
    pub fn judge(&mut self, number: u16) -> Result<Arc<Judge>, PipelineError> {
        let ScheduledModel { model, reference_v, judge, asked } =
            &mut self.models[usize::from(number)];
        *asked = true;
        if let Some(judge) = judge {
            return Ok(judge.clone());
        }
        let new = Judge::new(number, model.clone(), *reference_v, self.design, self.settings)?;
        let new = judge.insert(Arc::new(new)).clone();
        self.new += 1;
        if self.new > MANY_NEW.max(self.timelines.len()) {
            self.let_go();
        }
        Ok(new)
    }

    /// Judges for which no burst asked since the last time are made again if one should.
    fn let_go(&mut self) {
        for of in &mut self.models {
            of.judge = of.judge.take().filter(|_| of.asked);
            of.asked = false;
        }
        self.new = 0;
    }

    /// From then on another model judges the signals of a group.
    pub fn enter(&mut self, key: &GroupKey, start: ModelStart) {
        let entry = self.timelines.entry(key.clone()).or_insert_with(|| Ok(Timeline::default()));
        if let Ok(timeline) = entry {
            timeline.enter(start);
        }
    }

    /// All windows were learned: `groups` without a model are judged by nobody, for that reason, and what has
    /// neither windows nor a name in the design has no model.
    pub fn close<'k>(
        &mut self,
        groups: impl Iterator<Item = &'k GroupKey>,
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

    /// The design's model of a printhead.
    pub fn model_of(&self, printhead: &str) -> Option<u16> {
        self.by_name.get(printhead).copied()
    }

    /// Whether a burst is sampled as the design is.
    pub fn fits(&self, burst: &Burst) -> bool {
        self.design.is_none_or(|design| {
            same_period(design.sample_period_s, burst.sample_period_s)
                && design.samples == burst.samples_per_channel as usize
        })
    }

    /// Remembers how the bursts of a printhead are sampled that the design does not fit.
    pub fn note_sampling(&mut self, burst: &Burst) {
        let known = self.sampled_otherwise.contains_key(&burst.printhead);
        if !known && self.sampled_otherwise.len() < MOST_GROUPS && !self.fits(burst) {
            let sampled = (burst.sample_period_s, burst.samples_per_channel);
            self.sampled_otherwise.insert(burst.printhead.clone(), sampled);
        }
    }

    /// How the bursts of a printhead are sampled, and how the design's are, where that differs.
    pub fn other_sampling(&self, printhead: &str) -> Option<String> {
        let design = self.design?;
        let (period_s, samples) = self.sampled_otherwise.get(printhead)?;
        let us = |period_s: f64| format!("{} µs", (period_s * 1e12).round() / 1e6);
        Some(format!(
            "sampled every {} with {samples} samples a signal, the design's every {} with {}",
            us(*period_s),
            us(design.sample_period_s),
            design.samples
        ))
    }

    pub fn assign(&self, burst: &Burst) -> Assignment {
        if !self.fits(burst) {
            return Assignment::Reject(Reason::DesignMismatch);
        }
        match self.timelines.get(&GroupKey::of(burst)) {
            Some(Ok(timeline)) => match timeline.at(burst.t_acq_ns) {
                Some(number) => Assignment::Model(number),
                None => Assignment::Reject(Reason::NoModel),
            },
            Some(Err(reason)) => Assignment::Reject(*reason),
            None => match self.by_name.get(&burst.printhead) {
                Some(number) => Assignment::Model(*number),
                None if self.surveyed => Assignment::Reject(Reason::NoModel),
                None => Assignment::Survey,
            },
        }
    }
}
