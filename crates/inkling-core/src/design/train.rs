//! Training: from labelled signals to a design.
//!
//! In, from `inkling train` and whoever trains again: a [`TrainingSet`], settings. Out: a
//! [`Design`], and warnings in words. The order:
//! 1. the learned part of the FD filter, for every `detect.denominator` but method I;
//! 2. the healthy models, one per printhead and one of all together (`learn`);
//! 3. the fault classes: mean deviations of the labelled signals (`fault_class`);
//! 4. with `isolate.method` = `posterior` the physics, and the classes that it adds (`cold_start`);
//! 5. the posterior over all classes, and what is typical of each class (`typical`).

use super::channel_levels::ChannelLevels;
use super::training_set::{FittedSignal, TrainingSet, examples};
use super::{
    Design, DetectSettings, FaultClass, HealthyModel, IsolateSettings, LearnSettings,
    LearnedFilter, Result, VERSION, cold_start, typical,
};
use crate::burst::Beside;
use crate::detect::Denominator;
use crate::fault;
use crate::identify::GreyBoxSettings;
use crate::identify::SignalSet;
use crate::isolate::IsolateMethod;
use crate::isolate::fault_curve::Conditions;
use crate::isolate::physics_density::{Comparison, FaultCurves};
use crate::isolate::posterior::Posterior;
use crate::isolate::stacking::Examples;
use crate::numbers::LITTLE;
use nalgebra::Matrix4;
use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, OnceLock};

impl Design {
    /// Also returns warnings in words. An error if there is no pooled model, or if the chosen
    /// filter has no labelled faults to learn from.
    pub fn train(
        set: &TrainingSet,
        grey_box: &GreyBoxSettings,
        detect: &DetectSettings,
        isolate: &IsolateSettings,
    ) -> Result<(Design, Vec<String>)> {
        let settings = LearnSettings {
            grey_box,
            detect,
            least_agreeing: None,
            sample_period_s: set.sample_period_s,
            filter: None,
        };

        let filter = match detect.denominator {
            Denominator::Resonance => None,
            _ => Some(learned_filter(set, settings)?),
        };
        let settings = LearnSettings { filter: filter.as_ref(), ..settings };
        let (mut design, mut warnings) = Design::of_healthy(set, settings)?;

        design.classes = learn_classes(&design, set, isolate, settings, &mut warnings);
        warnings.extend(set.faulty.iter().filter_map(of_one_channel));
        if isolate.method == IsolateMethod::Posterior {
            design.physics = cold_start::physics(&design, set, grey_box, isolate)?;
            warnings.extend(cold_start::unsized_classes(&design));
            if isolate.unlabelled_classes {
                cold_start::add_classes(&mut design, isolate);
            }
        }

        // classes may drop out in `yield_to_own_classes`, so `typical` comes last
        in_table_order(&mut design.classes);
        if !design.classes.is_empty() {
            design.posterior = learn_posterior(&design, set)?.map(Arc::new);
            warnings.extend(yield_to_own_classes(&mut design, set, isolate)?);
            design.typical = typical::learn(&design, set)?.map(Arc::new);
            if design.posterior.is_none() {
                warnings.push(
                    "no posterior: a class has too few signals that ring; \
                     isolate.method = \"residual-matching\" works without it"
                        .into(),
                );
            }
        }
        design.check()?;
        warnings.extend(design.odd_channels(&set.healthy));
        warnings.extend(design.gain_steps(&set.healthy));
        Ok((design, warnings))
    }

    /// With warnings: the pooled model judges printheads that have none of their own.
    fn of_healthy(set: &TrainingSet, settings: LearnSettings) -> Result<(Design, Vec<String>)> {
        let (mut models, mut warnings) = (Vec::new(), Vec::new());
        for (name, healthy) in &set.healthy {
            match HealthyModel::learn(healthy, Some(name), None, settings) {
                Ok(model) => models.push(model),
                Err(e) => warnings.push(format!(
                    "printhead {name}: no model of its own ({e}); the pooled one judges it"
                )),
            }
        }

        let pooled = pool(&set.healthy, &models, set.samples);
        let pooled = HealthyModel::learn(&pooled, None, None, settings)?;
        warnings.extend(of_two_kinds(&models));
        warnings.extend(temperature_unknown(&pooled));
        warnings.extend(pooled.apart.map(|share| {
            let (n, threshold) = (pooled.threshold.n_signals, pooled.threshold.value);
            let apart = match (share * n as f64).round() {
                0.0 => String::new(),
                of => format!(", of which {of} lie apart"),
            };
            format!(
                "the threshold, {threshold:.0}, lies far beyond most of the {n} signals labelled healthy{apart}: too few \
                 signals to know their tail, faults among them, or two kinds of channels; label more, and check the labels"
            )
        }));

        let design = Design {
            version: VERSION,
            made_by: format!("inkling {}", env!("CARGO_PKG_VERSION")),
            sample_period_s: set.sample_period_s,
            samples: set.samples,
            drive_voltage_v: set.drive_voltage_v,
            chosen: BTreeMap::new(),
            detect: settings.detect.clone(),
            filter: settings.filter.cloned(),
            signals: set.signals.clone(),
            models,
            pooled,
            classes: Vec::new(),
            extension: set.extension.clone(),
            posterior: None,
            typical: None,
            physics: None,
            curves: OnceLock::new(),
        };
        Ok((design, warnings))
    }

    /// Pairs each printhead's signals with the model that judges them.
    pub(super) fn with_models<'a>(
        &'a self,
        printheads: &'a BTreeMap<String, SignalSet>,
    ) -> Vec<(&'a HealthyModel, &'a SignalSet)> {
        printheads.iter().map(|(name, set)| (self.reference_of(name), set)).collect()
    }
}

/// A class for which the method of isolation lacks something stays in the result, with a warning.
pub(super) fn learn_classes(
    design: &Design,
    set: &TrainingSet,
    isolate: &IsolateSettings,
    settings: LearnSettings,
    warnings: &mut Vec<String>,
) -> Vec<FaultClass> {
    let categories = isolate.physics.categories();
    let learn = |(name, printheads): (&String, &BTreeMap<String, SignalSet>)| {
        let sets = design.with_models(printheads);
        let mut class = FaultClass::learn(name, categories.of(name), &sets);
        class.of = isolate.classes.get(name).cloned().unwrap_or_default();
        let learned = match isolate.method {
            IsolateMethod::Posterior | IsolateMethod::ResidualMatching => Ok(()),
            IsolateMethod::ModelMatching => class.learn_model(&design.pooled, &sets, settings),
            IsolateMethod::Neighbours => {
                class.keep_examples(&sets);
                Ok(())
            }
        };
        if let Err(e) = learned {
            warnings.push(format!(
                "class {name}: no model of its own ({e}); model matching cannot name it"
            ));
        }
        class
    };
    set.faulty.iter().map(learn).collect()
}

/// Held-out signals of a class are then of the very channel that it was learned from.
fn of_one_channel((class, sets): (&String, &BTreeMap<String, SignalSet>)) -> Option<String> {
    let channels = sets.iter().flat_map(|(name, set)| set.channel.iter().map(move |of| (name, of)));
    let channels: BTreeSet<_> = channels.collect();
    (channels.len() == 1).then(|| {
        format!(
            "class {class}: all of its signals are of one channel, so that what is the fault's and what is the channel's \
             cannot be told apart; label it on others, too"
        )
    })
}

/// Printheads whose resonances differ by more than a tenth have no signal in common.
fn of_two_kinds(models: &[HealthyModel]) -> Option<String> {
    let frequency = |of: &&HealthyModel| of.identification.poles.frequency_hz;
    let by_frequency = |a: &&HealthyModel, b: &&HealthyModel| frequency(a).total_cmp(&frequency(b));
    let lowest = models.iter().min_by(by_frequency)?;
    let highest = models.iter().max_by(by_frequency)?;
    let in_words = |of: &HealthyModel| {
        let name = of.printhead.as_deref().unwrap_or_default();
        format!("{name} ({:.1} kHz)", frequency(&of) / 1e3)
    };
    (frequency(&highest) > (1.0 + LITTLE) * frequency(&lowest)).then(|| {
        format!(
            "printheads {} and {} are of two kinds, so that the model of all together, which judges printheads that the \
             design does not know, is of neither: train a design for each kind",
            in_words(lowest),
            in_words(highest)
        )
    })
}

fn temperature_unknown(pooled: &HealthyModel) -> Option<String> {
    let reference = pooled.temperature_c.filter(|_| pooled.temperature_response.is_none())?;
    Some(format!(
        "what temperature does was not learned: it hardly varied about {reference:.1} °C, or had no effect. \
         Healthy signals at several temperatures would tell; without, `replay` follows what all \
         channels of a printhead do alike"
    ))
}

/// The learned part of the FD filter. Faults are deviations from healthy models, so models with
/// method I's filter are learned first. An error if no signal has the label that is needed.
fn learned_filter(set: &TrainingSet, settings: LearnSettings) -> Result<LearnedFilter> {
    let by_resonance =
        DetectSettings { denominator: Denominator::Resonance, ..settings.detect.clone() };
    let first = LearnSettings { detect: &by_resonance, ..settings };
    let name = &settings.detect.fault;
    let Some(faulty) = set.faulty.get(name) else {
        let known = set.faulty.keys().map(String::as_str).collect::<Vec<_>>().join(", ");
        return Err(format!(
            "detect.fault = \"{name}\": no signal is labelled so (labelled faults: {known})"
        )
        .into());
    };
    let (design, _) = Design::of_healthy(set, first)?;
    let sets = design.with_models(faulty);
    let healthy = (&design.pooled, &pool(&set.healthy, &design.models, set.samples));
    let class = FaultClass::learn(name, fault::category(name), &sets);
    LearnedFilter::learn(healthy, &class, &sets, settings)
}

/// Learns the class densities of a ring's features, from labelled signals and from the physics,
/// twice: for channels of which nothing is known, with each signal moved to another channel's
/// level; and with features counted from a channel's known level. `None`: a class has neither.
pub(super) fn learn_posterior(design: &Design, set: &TrainingSet) -> Result<Option<Posterior>> {
    // the channels' healthy levels on every printhead; `None`: its channels are too few
    let mut levels = BTreeMap::new();
    for (name, signals) in &set.healthy {
        levels.insert(name, ChannelLevels::learn(design.reference_of(name), signals)?);
    }

    // Features of each class's signals: as of any channel, and from the own channel's level.
    let of_class = |class: &FaultClass| -> Result<(Option<Examples>, Option<Examples>)> {
        let Some(sets) = set.faulty.get(&class.name) else { return Ok((None, None)) };
        let of_each: Vec<_> = sets.keys().map(|name| levels.get(name)?.as_ref()).collect();
        let sets = design.with_models(sets);
        let any = |of: FittedSignal| {
            let level =
                |levels: &ChannelLevels| levels.elsewhere(of.channel, of.rank, &of.features);
            Some(of_each[of.set].map_or(of.features, level))
        };
        let own = |of: FittedSignal| Some(of.features - of_each[of.set]?.at(of.channel)?);
        Ok((examples(&sets, any)?, examples(&sets, own)?))
    };
    let (of_any, of_own) =
        design.classes.iter().map(of_class).collect::<Result<(Vec<_>, Vec<_>)>>()?;

    let physics = design.physics.as_ref();
    let curves = physics
        .map(|of| of.curves(&design.fault_classes(), design.sample_period_s, design.samples));
    let Some(posterior) = posterior_of(&of_any, curves.as_ref()) else { return Ok(None) };

    // Densities about a channel's own level need every labelled class to have signals of channels
    // with a level. The curves are of one channel whose baseline rests on the most signals, without
    // scatter from drop to drop.
    let are_known = of_any.iter().zip(&of_own).all(|(any, own)| any.is_none() || own.is_some());
    let about_own = || match &curves {
        Some(curves) => {
            let own = curves.of_one_channel(&Matrix4::zeros(), ChannelLevels::MOST as f64)?;
            posterior_of(&of_own, Some(&own))
        }
        None => posterior_of(&of_own, None),
    };
    Ok(Some(posterior.with_own(are_known.then(about_own).flatten())))
}

/// `None`: a class has neither examples nor a curve.
fn posterior_of(examples: &[Option<Examples>], curves: Option<&FaultCurves>) -> Option<Posterior> {
    let learned = || Posterior::learn(&examples.iter().cloned().collect::<Option<Vec<_>>>()?);
    let Some(curves) = curves else { return learned() };

    // learned densities and curves are mixed with weights that predict held-out examples best
    let has_curve: Vec<bool> = (0..examples.len()).map(|k| !curves.class(k).is_empty()).collect();
    let of_class = |class: &Option<Examples>| -> Vec<Vec<f64>> {
        let features = class.iter().flat_map(|class| &class.features);
        features.map(|x| ln_densities(curves, x.as_slice())).collect()
    };
    let by_physics: Vec<_> = examples.iter().map(of_class).collect();
    Posterior::stack(examples, &by_physics, &has_curve).or_else(learned)
}

/// The ln density of four features in each class by the physics' curves, at the reference drive.
fn ln_densities(curves: &FaultCurves, x: &[f64]) -> Vec<f64> {
    let mut compared = Comparison::default();
    curves.compare(x, Conditions::as_made(), &mut compared);
    compared.ln_densities
}

/// Removes classes that the physics alone knows and that take more than the share `little` of the
/// posterior of a user's own class's signals: probably the same fault under another name.
fn yield_to_own_classes(
    design: &mut Design,
    set: &TrainingSet,
    isolate: &IsolateSettings,
) -> Result<Vec<String>> {
    let mut messages = Vec::new();
    let is_own =
        |class: &FaultClass| class.of.is_empty() && isolate.physics.law(&class.name).is_none();
    let own = design.classes.iter().filter(|class| is_own(class));
    let own: Vec<String> = own.map(|class| class.name.clone()).collect();
    for (name, printheads) in set.faulty.iter().filter(|(name, _)| own.contains(name)) {
        let (Some(posterior), Some(curves)) = (&design.posterior, design.curves()) else { break };
        let sets = design.with_models(printheads);
        let Some(examples) = examples(&sets, |of| Some(of.features))? else { continue };

        // `taken`: the posterior weight of each class under equal priors, summed over the signals
        let classes = design.classes.len();
        let (priors, mut taken) = (vec![1.0; classes], vec![0.0; classes]);
        let mut weights = vec![0.0; classes];
        for x in examples.features.iter().map(|x| x.as_slice()) {
            let by_physics = ln_densities(&curves, x);
            posterior.weigh(x, &by_physics, &priors, &mut Vec::new(), &mut weights);
            taken.iter_mut().zip(&weights).for_each(|(t, w)| *t += w);
        }

        let of_all = examples.features.len() as f64;
        let takes = |k: usize| design.classes[k].n_signals == 0 && taken[k] > LITTLE * of_all;
        let gone: Vec<String> =
            (0..classes).filter(|&k| takes(k)).map(|k| design.classes[k].name.clone()).collect();
        if gone.is_empty() {
            continue;
        }

        design.classes.retain(|class| !gone.contains(&class.name));
        design.curves = OnceLock::new();
        design.posterior = learn_posterior(design, set)?.map(Arc::new);
        messages.push(format!(
            "{}: known by physics only, and what {name} looks like: left out. Label signals of it to \
             tell the two apart",
            gone.join(", ")
        ));
    }
    Ok(messages)
}

fn in_table_order(classes: &mut [FaultClass]) {
    let place = |name: &str| fault::CLASSES.iter().position(|c| *c == name).unwrap_or(usize::MAX);
    classes.sort_by(|a, b| place(&a.name).cmp(&place(&b.name)).then(a.name.cmp(&b.name)));
}

/// In one set, about zero; channel numbers are raised by 2^20 times the printhead's index.
fn pool(
    healthy: &BTreeMap<String, SignalSet>,
    models: &[HealthyModel],
    samples: usize,
) -> SignalSet {
    let mut all = SignalSet::new(samples);
    for (p, (name, set)) in healthy.iter().enumerate() {
        let of = models.iter().find(|model| model.printhead.as_deref() == Some(name));
        let set = match of.map_or(0.0, |model| model.offset) {
            0.0 => Cow::Borrowed(set),
            offset => Cow::Owned(set.less(offset)),
        };
        for i in 0..set.len() {
            let channel = (p as u32).wrapping_mul(1 << 20).wrapping_add(set.channel[i]);
            all.push(set.signal(i), set.drive[i], &Beside { channel, ..set.beside(i) });
        }
    }
    all
}
