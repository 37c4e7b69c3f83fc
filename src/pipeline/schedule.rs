//! The schedule holds the models of a run by their numbers, and makes their judges when they are needed.
//!
//! In: models, the design's first and then those that windows give, from `learning` ([`Schedule::add`]). Out:
//! the judge of a model ([`Schedule::judge`]), and for the metadata all models. A number is what the verdict
//! table has in its column `model`. Which model judges when stands in a [`Timeline`], one for each group.
//!
//! A judge takes several times the memory of its model, and a recording may have thousands of models. So judges
//! are made when a burst asks for them, and dropped when none has asked for a while.

use super::groups::{MOST_GROUPS, of_printhead};
use super::{PipelineError, Result};
use inkling_core::burst::Burst;
use inkling_core::design::{Design, HealthyModel, IsolateSettings, Judge};
use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

/// After so many new judges (or one for each group, if more) those that no burst asked for are dropped.
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

/// The numbers of the models of one group, each after the time from which on it judges, ns, ascending; the
/// first one also judges everything before its start.
#[derive(Clone, Debug, Default)]
pub struct Timeline(pub Vec<(i64, u16)>);

impl Timeline {
    pub fn enter(&mut self, from_ns: i64, number: u16) {
        // windows given as spans may end in any order
        let at = self.0.partition_point(|(before_ns, _)| *before_ns <= from_ns);
        self.0.insert(at, (from_ns, number));
    }

    /// The number of the model that judges at `t_ns`: the last one whose window had ended, and before the first
    /// window's end the first one. `None`: there are no models.
    pub fn at(&self, t_ns: i64) -> Option<u16> {
        let next = self.0.partition_point(|(from_ns, _)| *from_ns <= t_ns);
        self.0.get(next.saturating_sub(1)).map(|(_, number)| *number)
    }
}

#[derive(Debug)]
struct ScheduledModel {
    model: Arc<HealthyModel>,
    /// Drive voltage at which the model expects its signals, V; `None`: not known.
    reference_v: Option<f64>,
    /// `None`: no burst has asked yet, or not for long.
    judge: Option<Arc<Judge>>,
    /// Whether a burst asked for it since unused judges were last dropped.
    asked: bool,
}

#[derive(Debug)]
pub struct Schedule<'a> {
    pub(super) design: Option<&'a Design>,
    pooled: Option<Arc<HealthyModel>>,
    settings: &'a IsolateSettings,
    /// The number of the design's own model by printhead; used for groups that need no windows.
    by_name: HashMap<Arc<str>, u16>,
    models: Vec<ScheduledModel>,
    /// Number of judges made since unused ones were last dropped.
    new: usize,
    /// The windows that gave no model; complete when the learning is over.
    pub refusals: Vec<Refusal>,
    /// Sample period, s, and samples of the first burst of each printhead that does not fit the design.
    sampled_otherwise: BTreeMap<Arc<str>, (f64, u32)>,
}

impl<'a> Schedule<'a> {
    pub fn new(design: Option<&'a Design>, settings: &'a IsolateSettings) -> Result<Schedule<'a>> {
        let mut schedule = Schedule {
            design,
            pooled: design.map(|design| Arc::new(design.pooled.clone())),
            settings,
            by_name: HashMap::new(),
            models: Vec::new(),
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

    pub fn models(&self) -> impl ExactSizeIterator<Item = (&HealthyModel, Option<f64>)> {
        self.models.iter().map(|of| (&*of.model, of.reference_v))
    }

    /// Warnings by printhead: the window was too small for the stated false alarm rate.
    pub fn wide_thresholds(&self) -> Vec<(Arc<str>, String)> {
        let wide = |of: &ScheduledModel| {
            let what = of.model.threshold.wide_in_words()?;
            Some((of.model.printhead.as_deref().unwrap_or_default().into(), what))
        };
        self.models.iter().filter_map(wide).collect()
    }

    /// Adds a model, and returns its number, which counts from 0 on. An error if there are more than 2^16.
    pub fn add(&mut self, model: Arc<HealthyModel>, reference_v: Option<f64>) -> Result<u16> {
        let most = u64::from(u16::MAX);
        let number = u16::try_from(self.models.len())
            .map_err(|_| PipelineError::TooManyWindows { windows: most + 1, most })?;
        self.models.push(ScheduledModel { model, reference_v, judge: None, asked: false });
        Ok(number)
    }

    /// The judge of a model, made now if there is none. `groups`: number of groups that have models.
    pub fn judge(&mut self, number: u16, groups: usize) -> Result<Arc<Judge>> {
        let ScheduledModel { model, reference_v, judge, asked } =
            &mut self.models[usize::from(number)];
        *asked = true;
        if let Some(judge) = judge {
            return Ok(judge.clone());
        }
        let new = Judge::new(number, model.clone(), *reference_v, self.design, self.settings)?;
        let new = judge.insert(Arc::new(new)).clone();
        self.new += 1;
        if self.new > MANY_NEW.max(groups) {
            // the judges that no burst asked for since the last time; they may be made again
            for of in &mut self.models {
                of.judge = of.judge.take().filter(|_| of.asked);
                of.asked = false;
            }
            self.new = 0;
        }
        Ok(new)
    }

    pub fn model_of(&self, printhead: &str) -> Option<u16> {
        self.by_name.get(printhead).copied()
    }

    /// The design's own model of a printhead, or else its pooled one; `None`: there is no design.
    pub fn reference_of(&self, printhead: &str) -> Option<Arc<HealthyModel>> {
        let own = self.model_of(printhead).map(|number| &self.models[usize::from(number)].model);
        own.or(self.pooled.as_ref()).cloned()
    }

    /// Whether a burst is sampled as the design is; without a design every burst fits.
    pub fn fits(&self, burst: &Burst) -> bool {
        let samples = burst.samples_per_channel as usize;
        self.design.is_none_or(|design| design.fits(burst.sample_period_s, samples))
    }

    pub fn note_sampling(&mut self, burst: &Burst) {
        let sampled = (burst.sample_period_s, burst.samples_per_channel);
        of_printhead(&mut self.sampled_otherwise, &burst.printhead, MOST_GROUPS, || sampled);
    }

    /// How the bursts of a printhead and the design's are sampled; `None`: no difference was noted.
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
}
