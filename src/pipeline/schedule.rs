//! The schedule says which model judges which burst, and makes the judges of its models when they are needed.

use super::PipelineError;
use super::survey::{GroupKey, MOST_GROUPS};
use inkling_core::burst::Burst;
use inkling_core::design::{Design, HealthyModel, IsolateSettings, Judge, same_period};
use inkling_core::verdict::Reason;
use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

/// So many judges are made (or one for each group, if these are more) before those that no burst asked for
/// meanwhile are dropped.
const MANY_NEW: usize = 64;

/// A healthy window that gave no model, and why; it stands in summary.json and is told on the terminal.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Refusal {
    pub printhead: String,
    pub from_ns: i64,
    pub to_ns: i64,
    pub why: String,
    /// Whether its model lay beyond the bounds of `identify.max_damping_drift` and `max_frequency_drift`.
    #[serde(skip)]
    pub drifted: bool,
}

/// The time from which on a model judges, ns, and that model's number.
#[derive(Clone, Copy, Debug)]
pub struct ModelStart {
    pub t_ns: i64,
    pub number: u16,
}

/// The models of one group over time, ascending; the first one also judges everything before its start.
#[derive(Clone, Debug, Default)]
pub struct Timeline(Vec<ModelStart>);

impl Timeline {
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Inserts a model at its place in time.
    pub fn enter(&mut self, start: ModelStart) {
        // windows given as spans may end in any order
        let at = self.0.partition_point(|before| before.t_ns <= start.t_ns);
        self.0.insert(at, start);
    }

    /// The number of the model that judges at `t_ns`: the last one whose window had ended, so the
    /// choice is causal. Only what lies before the first window's end is judged by the first
    /// model. `None`: there are no models.
    pub fn at(&self, t_ns: i64) -> Option<u16> {
        let next = self.0.partition_point(|start| start.t_ns <= t_ns);
        self.0.get(next.saturating_sub(1)).map(|start| start.number)
    }
}

/// What the schedule says of a burst.
#[derive(Clone, Copy, Debug)]
pub enum Assignment {
    /// The number of the model that judges it.
    Model(u16),
    /// Nobody judges it, for that reason.
    Reject(Reason),
    /// Only windows can tell, and they were not learned yet.
    Survey,
}

/// A model of the schedule, with the judge made of it while bursts ask for it.
#[derive(Debug)]
struct ScheduledModel {
    model: Arc<HealthyModel>,
    reference_v: Option<f64>,
    judge: Option<Arc<Judge>>,
    /// Whether a burst asked for it since unused judges were last dropped.
    asked: bool,
}

/// All models of a run. A judge takes several times the memory of its model, and most are never asked for
/// again: so judges are made when a burst asks for them, and kept while bursts do.
#[derive(Debug)]
pub struct Schedule<'a> {
    design: Option<&'a Design>,
    settings: &'a IsolateSettings,
    /// The models over time by group, or the reason why nobody judges the group.
    timelines: HashMap<GroupKey, Result<Timeline, Reason>>,
    /// The number of the design's own model by printhead; used for groups that have no timeline.
    by_name: HashMap<Arc<str>, u16>,
    /// Whether all windows were learned.
    surveyed: bool,
    models: Vec<ScheduledModel>,
    /// Number of judges made since unused ones were last dropped.
    new: usize,
    pub refusals: Vec<Refusal>,
    /// Sample period, s, and number of samples of the first burst of each printhead that is sampled otherwise
    /// than the design.
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
    /// A schedule with the design's models as they are, if there is a design.
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

    /// All models in the order of their numbers.
    pub fn models(&self) -> impl ExactSizeIterator<Item = NumberedModel<'_>> {
        let numbers = 0..self.models.len() as u16; // add() bounds them
        numbers.zip(&self.models).map(|(number, of)| {
            let ScheduledModel { model, reference_v, .. } = of;
            NumberedModel { number, model, reference_v: *reference_v }
        })
    }

    /// Warnings by printhead: its window was too small for the stated false alarm rate, so
    /// its threshold lies further out.
    pub fn wide_thresholds(&self) -> Vec<(Arc<str>, String)> {
        let wide = |of: &ScheduledModel| {
            let what = of.model.threshold.wide_in_words()?;
            Some((of.model.printhead.as_deref().unwrap_or_default().into(), what))
        };
        self.models.iter().filter_map(wide).collect()
    }

    /// Adds a model, and returns its number.
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

    /// The judge of a model, made now if there is none.
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

    /// Drops the judges that no burst asked for since the last time; should one
    /// ask later, they are made again.
    fn let_go(&mut self) {
        for of in &mut self.models {
            of.judge = of.judge.take().filter(|_| of.asked);
            of.asked = false;
        }
        self.new = 0;
    }

    /// Enters that a model judges the signals of a group from its start on.
    pub fn enter(&mut self, key: &GroupKey, start: ModelStart) {
        let entry = self.timelines.entry(key.clone()).or_insert_with(|| Ok(Timeline::default()));
        if let Ok(timeline) = entry {
            timeline.enter(start);
        }
    }

    /// Notes that all windows were learned. Those of `groups` that have no model are judged by nobody, for
    /// the reason `nobody`; and what has neither windows nor a name in the design has no model from now on.
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

    /// The number of the design's own model of a printhead.
    pub fn model_of(&self, printhead: &str) -> Option<u16> {
        self.by_name.get(printhead).copied()
    }

    /// Whether a burst is sampled as the design is; without a design every burst fits.
    pub fn fits(&self, burst: &Burst) -> bool {
        self.design.is_none_or(|design| {
            same_period(design.sample_period_s, burst.sample_period_s)
                && design.samples == burst.samples_per_channel as usize
        })
    }

    /// Remembers how a burst is sampled, if that does not fit the design and no such
    /// burst of its printhead came before.
    pub fn note_sampling(&mut self, burst: &Burst) {
        let known = self.sampled_otherwise.contains_key(&burst.printhead);
        if !known && self.sampled_otherwise.len() < MOST_GROUPS && !self.fits(burst) {
            let sampled = (burst.sample_period_s, burst.samples_per_channel);
            self.sampled_otherwise.insert(burst.printhead.clone(), sampled);
        }
    }

    /// Says in words how the bursts of a printhead and the design's are sampled;
    /// `None`: no difference was noted.
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

    /// Says who judges a burst: its group's timeline, where there is one, else
    /// the design's model of that name.
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
