//! Judges the labelled signals of each class twice: by the design itself, and by designs that were learned without
//! these signals (cross-validation).
//!
//! In, from `inkling train`: a design and the signals that it was trained on. Out: a
//! [`ClassReview`] per labelled class: how many of its signals are flagged, how many are named, and
//! what the others would be called instead. `train` prints it, and refuses a design with a class
//! that would hardly be named.
//!
//! The cross-validation has two folds, divided by channel, since signals of one channel are alike and would give the
//! answer away. (A class with a single channel is divided signal by signal.) Each fold is judged by classes, posterior and
//! bounds of what is typical that were learned from the other one. Healthy models, filter and physics stay those of all
//! signals: they know no labels of faults.

use super::train::{learn_classes, learn_posterior};
use super::{
    Design, IsolateSettings, Judge, LearnSettings, Result, TrainingSet, Workspace, typical,
};
use crate::fault::HEALTHY;
use crate::identify::GreyBoxSettings;
use crate::isolate::Likeness;
use crate::isolate::severity::Severity;
use crate::numbers::{FEW, LITTLE};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, OnceLock};

const FOLDS: usize = 2;
/// At most so many signals of a class and printhead are judged, the first ones.
const MOST_SIGNALS: usize = 1024;

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Judged {
    pub signals: usize,
    pub detected: usize,
    /// Flagged signals by the class that they are named with certainty.
    pub named: BTreeMap<String, usize>,
    /// Flagged signals that no ring explains.
    pub no_ring: usize,
    /// Flagged signals by the class of largest weight, whether named or not.
    pub most_like: BTreeMap<String, usize>,
    /// Named signals with a labelled size and one of their own, and those of them whose 95 % interval holds the label.
    pub sized: usize,
    pub sized_right: usize,
}

#[derive(Clone, Debug)]
pub struct ClassReview {
    pub name: String,
    /// Number of signals that the labels gave the class, whether judged here or not.
    pub labelled: u64,
    /// Whether the physics or a declaration knows the class, so that it can be named without labels.
    pub is_known: bool,
    /// By the design itself.
    pub trained_on: Judged,
    /// Flagged signals of other classes that are most like this one, by their true class.
    pub taken_in: BTreeMap<String, usize>,
    /// By designs that were learned without them; of the folds from which the class could be learned.
    pub held_out: Judged,
}

/// A signal that is labelled with a fault.
struct LabelledSignal<'a> {
    /// N samples, counts.
    deviation: &'a [f64],
    /// Over the model's reference drive.
    drive: f64,
    class: &'a str,
    /// In the unit of the class; NaN: not labelled.
    size: f64,
}

impl Judged {
    pub fn named(&self, class: &str) -> usize {
        self.named.get(class).copied().unwrap_or(0)
    }

    /// The name, other than `class`, that the most signals get, and their number.
    pub fn mistaken_for(&self, class: &str) -> Option<(&str, usize)> {
        most(&self.named, class)
    }

    /// Judges one more signal and counts what comes of it. `names`: those of the judge's classes.
    fn count(&mut self, judge: &Judge, of: LabelledSignal, names: &[String], work: &mut Workspace) {
        let LabelledSignal { deviation, drive, class, size } = of;
        self.signals += 1;
        let found = judge.detect(deviation, drive, work);
        if !judge.test(found).is_flagged() {
            return;
        }
        self.detected += 1;
        let Some(isolation) = judge.isolate(deviation, drive, work) else { return };
        self.no_ring += usize::from(isolation.likeness == Likeness::NoRing);
        let named = isolation.fault.and_then(|k| names.get(usize::from(k)));
        let is_sized = size.is_finite() && named.is_some_and(|name| name == class);
        if let Some(Severity { value, sd }) = work.severity.filter(|_| is_sized) {
            self.sized += 1;
            self.sized_right += usize::from((value - size).abs() <= 1.96 * sd);
        }
        for (counts, class) in
            [(&mut self.named, isolation.fault), (&mut self.most_like, isolation.candidate)]
        {
            if let Some(name) = class.and_then(|k| names.get(usize::from(k))) {
                *counts.entry(name.clone()).or_default() += 1;
            }
        }
    }
}

/// The name with the largest count, except one name, and that count.
fn most<'a>(counts: &'a BTreeMap<String, usize>, except: &str) -> Option<(&'a str, usize)> {
    let others = counts.iter().filter(|(name, _)| *name != except);
    others.max_by_key(|(_, n)| **n).map(|(name, n)| (name.as_str(), *n))
}

impl ClassReview {
    /// Why hardly a signal of the class would be named; `None`: some would, or few signals tell. It is so where only
    /// labels know the class, and fewer than one in ten ([`LITTLE`]) of the signals that it was learned from gets its name.
    pub fn why_hardly_named(&self) -> Option<String> {
        let Judged { signals, detected, no_ring, ref most_like, .. } = self.trained_on;
        let named = self.trained_on.named(&self.name);
        let is_hardly = !self.is_known && signals >= FEW && named as f64 <= LITTLE * signals as f64;
        if !is_hardly {
            return None;
        }
        Some(if detected == 0 {
            format!("none of its {signals} signals differs from healthy ones by more than these do")
        } else if 2 * no_ring > detected {
            format!(
                "{no_ring} of its {detected} detected signals do not ring, and a fault is named by how it \
                 rings; such signals are told as `no_ring`, the sensor's or the acquisition's"
            )
        } else {
            let (like, n) = most(most_like, &self.name)?;
            // Two names for one fault take each other's signals, so both directions are counted: at least `FEW`, and as
            // many as a quarter of the flagged ones (somewhat arbitrary). With fewer the signals are most like their own
            // class, and will be named when more are labelled.
            let back = self.taken_in.get(like).copied().unwrap_or(0);
            if n + back < FEW || 4 * (n + back) < detected {
                return None;
            }
            format!(
                "{n} of its {detected} detected signals look more like {like}, and {back} of that class more like it"
            )
        })
    }

    /// Whether most of its labelled sizes are not those that its signals show, although the design knows the labels.
    pub fn is_sized_otherwise(&self) -> bool {
        let Judged { sized, sized_right, .. } = self.trained_on;
        sized >= FEW && 2 * sized_right < sized
    }

    pub fn is_hardly_detected(&self) -> bool {
        2 * self.trained_on.detected < self.trained_on.signals
    }
}

impl Design {
    pub fn review_classes(
        &self,
        set: &TrainingSet,
        grey_box: &GreyBoxSettings,
        isolate: &IsolateSettings,
    ) -> Result<Vec<ClassReview>> {
        let few = first_of(set);
        let mut trained_on = BTreeMap::new();
        judge_all(self, &few, isolate, &mut trained_on)?;

        // Held-out signals of a class that could not be learned without the fold are not counted.
        let mut held_out = BTreeMap::new();
        for fold in 0..FOLDS {
            let learned_from = part_of(set, |of| of != fold);
            let Some(without) = self.learned_from(&learned_from, grey_box, isolate)? else {
                continue;
            };
            let names = without.class_names();
            let mut part = part_of(&few, |of| of == fold);
            part.faulty.retain(|name, _| names.contains(name));
            judge_all(&without, &part, isolate, &mut held_out)?;
        }

        let review = |(name, of): (&String, &Judged)| {
            let class = self.classes.iter().find(|class| class.name == *name);
            let stands_for = class.map(|class| class.class().of).unwrap_or_default();
            let others = trained_on.iter().filter(|(other, _)| *other != name);
            let taken =
                |(other, of): (&String, &Judged)| Some((other.clone(), *of.most_like.get(name)?));
            ClassReview {
                name: name.clone(),
                labelled: set.signals.get(name).copied().unwrap_or(0),
                is_known: stands_for.iter().any(|of| isolate.physics.law(of).is_some()),
                trained_on: of.clone(),
                taken_in: others.filter_map(taken).collect(),
                held_out: held_out.remove(name).unwrap_or_default(),
            }
        };
        Ok(trained_on.iter().map(review).collect())
    }

    /// The same design with its classes learned again from `set`; `None`: its signals are too few.
    fn learned_from(
        &self,
        set: &TrainingSet,
        grey_box: &GreyBoxSettings,
        isolate: &IsolateSettings,
    ) -> Result<Option<Design>> {
        let settings = LearnSettings {
            grey_box,
            detect: &self.detect,
            least_agreeing: None,
            sample_period_s: set.sample_period_s,
            filter: self.filter.as_ref(),
        };
        let mut design = Design { curves: OnceLock::new(), ..self.clone() };
        let learned = learn_classes(&design, set, isolate, settings, &mut Vec::new());
        let is_known = |name: &str| isolate.physics.law(name).is_some();

        // A class that the physics or a declaration knows stays as it was, also without labelled signals.
        design.classes.retain(|class| {
            is_known(&class.name) || !class.of.is_empty() || set.faulty.contains_key(&class.name)
        });
        for class in &mut design.classes {
            if let Some(learned) = learned.iter().find(|learned| learned.name == class.name) {
                *class = learned.clone();
            }
        }

        if self.posterior.is_some() {
            design.posterior = learn_posterior(&design, set)?.map(Arc::new);
            design.typical = typical::learn(&design, set)?.map(Arc::new);
        }
        let is_ready = design.check_method(isolate.method).is_ok() && !design.classes.is_empty();
        Ok(is_ready.then_some(design))
    }
}

/// Judges every labelled class's signals and adds to `counts`. If the design lacks what the method
/// of isolation needs, they are only detected.
fn judge_all(
    design: &Design,
    set: &TrainingSet,
    isolate: &IsolateSettings,
    counts: &mut BTreeMap<String, Judged>,
) -> Result<()> {
    let names = design.class_names();
    let by = design.check_method(isolate.method).is_ok().then_some(design);
    let mut work = Workspace::default();
    for (name, printheads) in &set.faulty {
        let judged = counts.entry(name.clone()).or_default();
        for (model, signals) in design.with_models(printheads) {
            let judge = Judge::new(0, model.clone().into(), design.drive_voltage_v, by, isolate)?;
            model.each_deviation(signals, |i, deviation, drive| {
                work.warmer = model.warmer(signals.temperature_c[i]);
                let size = signals.severity[i];
                let signal = LabelledSignal { deviation, drive, class: name, size };
                judged.count(&judge, signal, &names, &mut work);
            });
        }
    }
    Ok(())
}

/// The first `MOST_SIGNALS` faulty signals of each class and printhead, and all healthy ones.
fn first_of(set: &TrainingSet) -> TrainingSet {
    set.with(|state, _, signals| {
        let most = if state == HEALTHY { usize::MAX } else { MOST_SIGNALS };
        (0..signals.len().min(most)).collect()
    })
}

/// The same set with the labelled faults of some folds only. All signals of a channel are in one
/// fold; a class with a single channel is divided signal by signal.
fn part_of(set: &TrainingSet, in_part: impl Fn(usize) -> bool) -> TrainingSet {
    set.with(|state, _, signals| {
        let Some(printheads) = set.faulty.get(state) else { return (0..signals.len()).collect() };
        let channels: BTreeSet<u32> =
            printheads.values().flat_map(|signals| signals.channel.iter().copied()).collect();
        let channels: Vec<u32> = channels.into_iter().collect();
        // the rank of a signal's channel (or the number of the signal) modulo FOLDS is its fold
        let rank = |i: usize| match channels.len() {
            1 => i,
            _ => channels.partition_point(|channel| *channel < signals.channel[i]),
        };
        (0..signals.len()).filter(|&i| in_part(rank(i) % FOLDS)).collect()
    })
}
