//! Who judges: every group (a printhead at one sampling) has one judge, from its first burst to its last.
//!
//! In: bursts in the recording's order, from the identify stage ([`Judges::of`]). Out: the judge of each, or why it
//! has none; for the metadata the models that judge, by number, and the windows that gave none.
//!
//! | | the design knows the printhead | it does not, or there is none |
//! |---|---|---|
//! | `--identify design` | its model | the design's pooled model, if the first window agrees with it; without a design the window's |
//! | `--identify windows` | the first window's model; the design's where the window gives none | the first window's model |
//!
//! The first healthy window of a printhead is averaged and identified (thesis 3-1 and Fig. 3-2) before its first burst
//! is judged: this stage reads on by itself as far as the window reaches (`windows`; `survey` and `sample` say where
//! windows lie and which signals are taken, `healthy_window` makes the model), while the later stages wait. It has a
//! reader of its own, so nothing that waits for it keeps it from going on. What changes afterwards (ink, supply, ageing)
//! is followed by the state of the head alone (`pipeline::head`).

mod healthy_window;
mod sample;
mod survey;
mod windows;

use super::batches::ReadBatch;
use super::groups::{GroupKey, Groups, MOST_GROUPS, of_printhead};
use super::run::Replay;
use super::visit::Pass;
use super::{PipelineError, Result};
use crate::settings::IdentifyMode;
use inkling_core::burst::Burst;
use inkling_core::design::{HealthyModel, Judge};
use inkling_core::verdict::Reason;
use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;
use windows::{Ahead, Learned};

/// A window whose model does not judge, and why; it stands in summary.json and is told on the terminal.
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

/// Who judges a group, or why its signals are rejected. (`Result<Judged>` is an error where the run cannot go on.)
type Judged = Result<Arc<Judge>, Reason>;

#[derive(Debug)]
pub struct Judges<'a> {
    replay: &'a Replay,
    pass: Pass<'a>,
    /// By the group's number; `None`: it was not asked for yet.
    judges: Vec<Option<Judged>>,
    /// What is known of groups that were learned together with another one, and not asked for yet.
    ahead: HashMap<GroupKey, Judged>,
    /// The models, by number: the design's first and in its order (`of_design` relies on that), then those of windows,
    /// with the drive voltage, V, at which each expects its signals; `None`: none was recorded.
    models: Vec<(Arc<HealthyModel>, Option<f64>)>,
    pub refusals: Vec<Refusal>,
    /// Sample period, s, and samples of the first burst of each printhead that does not fit the design.
    sampled_otherwise: BTreeMap<Arc<str>, (f64, u32)>,
}

impl<'a> Judges<'a> {
    pub fn new(replay: &'a Replay, pass: Pass<'a>) -> Judges<'a> {
        let of_design = replay.design.iter().flat_map(|design| {
            design.models.iter().map(|model| (Arc::new(model.clone()), design.drive_voltage_v))
        });
        Judges {
            replay,
            pass,
            judges: Vec::new(),
            ahead: HashMap::new(),
            models: of_design.collect(),
            refusals: Vec::new(),
            sampled_otherwise: BTreeMap::new(),
        }
    }

    /// The judge of a burst, or why it is rejected. `number`: of its group among `groups`; `read`: its batch.
    ///
    /// # Errors
    /// The recording cannot be read on, the run is interrupted, or no judge can be made of a model.
    pub fn of(
        &mut self,
        number: usize,
        groups: &Groups,
        burst: &Burst,
        read: &ReadBatch,
    ) -> Result<Judged> {
        if number >= self.judges.len() {
            self.judges.resize(number + 1, None);
        }
        if let Some(known) = &self.judges[number] {
            return Ok(known.clone());
        }
        let found = self.find(groups, burst, read)?;
        Ok(self.judges[number].insert(found).clone())
    }

    /// The judge of a group, at its first burst.
    fn find(&mut self, groups: &Groups, burst: &Burst, read: &ReadBatch) -> Result<Judged> {
        if !self.replay.fits(burst) {
            let sampled = (burst.sample_period_s, burst.samples_per_channel);
            of_printhead(&mut self.sampled_otherwise, &burst.printhead, MOST_GROUPS, || sampled);
            return Ok(Err(Reason::DesignMismatch));
        }
        if !self.replay.needs_window(burst) {
            return self.of_design(&burst.printhead);
        }
        let key = GroupKey::of(burst);
        if !self.ahead.contains_key(&key) {
            self.learn(groups, read)?;
        }
        Ok(self.ahead.remove(&key).unwrap_or(Err(self.replay.nobody())))
    }

    /// Learns the groups that begin in what is read ahead from this batch on, and enters their judges into `ahead`.
    fn learn(&mut self, groups: &Groups, read: &ReadBatch) -> Result<()> {
        let ahead = Ahead::of(self.pass, self.replay.workers(), read);
        let is_new = |burst: &Burst, key: &GroupKey| {
            let is_met = |number: usize| self.judges.get(number).is_some_and(Option::is_some);
            let is_known = groups.get(key).is_some_and(is_met) || self.ahead.contains_key(key);
            self.replay.fits(burst) && self.replay.needs_window(burst) && !is_known
        };
        let found = windows::learn(self.replay, &ahead, is_new)?;
        for learned in found {
            let Learned { key, model, reference_v, refusals } = learned;
            self.refusals.extend(refusals);
            let judge = match model {
                Some(model) => Ok(self.judge(model, reference_v)?),
                // a window that gives no model leaves a printhead that the design knows to the design
                None => self.of_design(&key.printhead)?,
            };
            self.ahead.insert(key, judge);
        }
        // the same list for any number of threads
        let order = |of: &Refusal| (of.printhead.clone(), of.from_ns, of.to_ns, of.why.clone());
        self.refusals.sort_by_cached_key(order);
        Ok(())
    }

    fn judge(&mut self, model: Arc<HealthyModel>, reference_v: Option<f64>) -> Result<Arc<Judge>> {
        self.models.push((model, reference_v));
        self.judge_by(self.models.len() - 1)
    }

    fn judge_by(&self, number: usize) -> Result<Arc<Judge>> {
        let (model, reference_v) = self.models[number].clone();
        let number = u16::try_from(number).map_err(|_| PipelineError::TooManyModels)?;
        let Replay { design, settings, .. } = self.replay;
        let judge = Judge::new(number, model, reference_v, design.as_ref(), &settings.isolate)?;
        Ok(Arc::new(judge))
    }

    /// By the design's own model of a printhead, if it has one.
    fn of_design(&self, printhead: &str) -> Result<Judged> {
        let mut models = self.replay.design.iter().flat_map(|design| &design.models);
        match models.position(|of| of.printhead.as_deref() == Some(printhead)) {
            Some(number) => Ok(Ok(self.judge_by(number)?)),
            None => Ok(Err(self.replay.nobody())),
        }
    }

    pub fn models(&self) -> impl ExactSizeIterator<Item = (&HealthyModel, Option<f64>)> {
        self.models.iter().map(|(model, reference_v)| (&**model, *reference_v))
    }

    /// Sentences on thresholds that lie far out since the window tells little of healthy signals, by printhead. `blind`:
    /// on those that only gross faults exceed, or on the others.
    pub fn wide_thresholds(&self, blind: bool) -> impl Iterator<Item = (Arc<str>, String)> {
        let models = self.models.iter().filter(move |(of, _)| of.threshold.is_blind() == blind);
        models.filter_map(|(of, _)| {
            let printhead = of.printhead.as_deref().unwrap_or_default();
            Some((printhead.into(), of.threshold.wide_in_words()?))
        })
    }

    /// How the bursts of a printhead and the design's are sampled; `None`: no difference was noted.
    pub fn other_sampling(&self, printhead: &str) -> Option<String> {
        let design = self.replay.design.as_ref()?;
        let (period_s, samples) = self.sampled_otherwise.get(printhead)?;
        let us = |period_s: f64| format!("{} µs", (period_s * 1e12).round() / 1e6);
        // whoever writes ns for µs, or kHz for Hz, is off by a power of a thousand
        let thousands = (period_s / design.sample_period_s).log10() / 3.0;
        let is_unit = thousands.round() != 0.0 && (thousands - thousands.round()).abs() < 1e-6;
        let unit = if is_unit { " (of another unit? look at `rate_hz` or `period_s`)" } else { "" };
        Some(format!(
            "sampled every {}{unit} with {samples} samples a signal, the design's every {} with {}",
            us(*period_s),
            us(design.sample_period_s),
            design.samples
        ))
    }
}

impl Replay {
    /// The reason for which the signals of a printhead are rejected if none of its windows gave a model.
    fn nobody(&self) -> Reason {
        if self.design.is_some() { Reason::DesignMismatch } else { Reason::NoModel }
    }

    /// Whether a burst is sampled as the design is; without a design every burst fits.
    fn fits(&self, burst: &Burst) -> bool {
        let samples = burst.samples_per_channel as usize;
        self.design.as_ref().is_none_or(|design| design.fits(burst.sample_period_s, samples))
    }

    /// Whether the design's models judge as they are. Windows then only say whether its pooled model agrees
    /// with a printhead that the design does not know.
    fn knows_by_design(&self) -> bool {
        self.design.is_some() && self.settings.identify.mode == IdentifyMode::Design
    }

    /// Whether the group of a burst is judged by what its window gives. The burst must fit the design ([`Self::fits`]).
    fn needs_window(&self, burst: &Burst) -> bool {
        let known =
            |printhead| self.design.as_ref().is_some_and(|of| of.model_of(printhead).is_some());
        !(self.knows_by_design() && known(&burst.printhead))
    }
}
