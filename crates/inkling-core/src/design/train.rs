//! Training: from labelled signals to a design.
//!
//! In: a [`TrainingSet`], settings; from `inkling train`, and from whoever trains again (`inkling
//! thesis`, a critique's extended design, `detectable`). Out: a [`Design`], and warnings in words.
//! The order:
//!
//! 1. the learned part of the FD filter, where `detect.denominator` is a method that learns from
//!    faults;
//! 2. the healthy models, one per printhead and one of all together (`learn`);
//! 3. the fault classes: mean deviations of the labelled signals (`fault_class`);
//! 4. with `isolate.method` = `posterior` the physics, and the classes that the physics adds
//!    (`cold_start`);
//! 5. the posterior over all classes, and what is typical of each class (`typical`).

use super::channel_levels::ChannelLevels;
use super::training_set::{From, TrainingSet, examples};
use super::{
    Design, DesignError, DetectSettings, FaultClass, HealthyModel, IsolateSettings, LearnSettings,
    LearnedFilter, VERSION, cold_start, typical,
};
use crate::detect::Denominator;
use crate::fault;
use crate::identify::GreyBoxSettings;
use crate::identify::averaging::SignalSet;
use crate::isolate::IsolateMethod;
use crate::isolate::fault_curve::Conditions;
use crate::isolate::physics_density::{Comparison, FaultCurves};
use crate::isolate::posterior::Posterior;
use crate::isolate::stacking::Examples;
use crate::numbers::tuned::little;
use nalgebra::Matrix4;
use std::collections::BTreeMap;
use std::sync::{Arc, OnceLock};

impl Design {
    /// Learns a model of every printhead and of all together, and a class of every fault label.
    /// Also returns warnings in words: what could not be learned, and which labels look wrong. An
    /// error if there is no pooled model, or if the chosen filter has no labelled faults to learn
    /// from.
    pub fn train(
        set: &TrainingSet,
        grey_box: &GreyBoxSettings,
        detect: &DetectSettings,
        isolate: &IsolateSettings,
    ) -> Result<(Design, Vec<String>), DesignError> {
        // `least_agreeing` is `None`: labels say which signals are healthy.
        let settings = LearnSettings {
            grey_box,
            detect,
            least_agreeing: None,
            sample_period_s: set.sample_period_s,
            filter: None,
        };

        // The healthy models. Every denominator but method I's is learned from faults first.
        let (mut design, mut warnings) = if detect.denominator == Denominator::Resonance {
            Design::of_healthy(set, settings)?
        } else {
            let filter = learned_filter(set, settings)?;
            let settings = LearnSettings { filter: Some(&filter), ..settings };
            let (design, warnings) = Design::of_healthy(set, settings)?;
            (Design { filter: Some(filter), ..design }, warnings)
        };

        // Fault classes: those with labelled signals, then those that the physics adds to them.
        design.classes = learn_classes(&design, set, isolate, settings, &mut warnings);
        if isolate.method == IsolateMethod::Posterior {
            design.physics = cold_start::physics(&design, set, grey_box, isolate)?;
            if isolate.unlabelled_classes {
                cold_start::add_classes(&mut design, isolate);
            }
        }

        // What is learned of all classes together. Classes may drop out in `yield_to_own_classes`,
        // hence the bounds of what is typical, one per class, come last.
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
        Ok((design, warnings))
    }

    /// The healthy part of a design (models and thresholds), without fault classes, and warnings. A
    /// printhead whose signals give no model is judged by the pooled one, and a warning says so.
    fn of_healthy(
        set: &TrainingSet,
        settings: LearnSettings,
    ) -> Result<(Design, Vec<String>), DesignError> {
        // Without a pooled model there is no design; a printhead without a model of its own is no
        // failure.
        let pooled = HealthyModel::learn(&pool(&set.healthy, set.samples), None, None, settings)?;
        let (mut models, mut warnings) = (Vec::new(), Vec::new());
        for (name, healthy) in &set.healthy {
            match HealthyModel::learn(healthy, Some(name), None, settings) {
                Ok(model) => models.push(model),
                Err(e) => warnings.push(format!(
                    "printhead {name}: no model of its own ({e}); the pooled one judges it"
                )),
            }
        }

        // What the pooled model says against the labels or the recordings.
        warnings.extend(temperature_unknown(&pooled));
        warnings.extend(pooled.apart.map(|share| {
            format!(
                "{:.1} % of the signals labelled healthy lie apart from the others, and the threshold \
                 lies beyond them ({:.0}): faults among them, or two kinds of channels; check the labels",
                100.0 * share,
                pooled.threshold.value
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
            filter: None,
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

    /// Pairs each printhead's signals with the model that judges them: its own, or else the pooled
    /// one.
    pub(super) fn with_models<'a>(
        &'a self,
        printheads: &'a BTreeMap<String, SignalSet>,
    ) -> Vec<(&'a HealthyModel, &'a SignalSet)> {
        printheads.iter().map(|(name, set)| (self.reference_of(name), set)).collect()
    }
}

/// Learns a class of every fault label. A class for which the method of isolation lacks something
/// (a model that cannot be identified) stays in the result, with a warning.
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
        if let Err(e) = class.learn_for(isolate, &design.pooled, &sets, settings) {
            warnings.push(format!(
                "class {name}: no model of its own ({e}); model matching cannot name it"
            ));
        }
        class
    };
    set.faulty.iter().map(learn).collect()
}

/// The warning where temperature was recorded and the model does not know its effect.
fn temperature_unknown(pooled: &HealthyModel) -> Option<String> {
    let reference = pooled.temperature_c.filter(|_| pooled.temperature_response.is_none())?;
    Some(format!(
        "what temperature does was not learned: it hardly varied about {reference:.1} °C, or had no effect. \
         Healthy signals at several temperatures would tell; without, replay learns it from recordings \
         in which it varies"
    ))
}

/// The learned part of the FD filter, for every `detect.denominator` but method I, in two steps:
/// first healthy models with method I's filter, since faults are deviations from what these models
/// expect; then the filter, from the faults. An error if no signal has the label that is needed.
fn learned_filter(
    set: &TrainingSet,
    settings: LearnSettings,
) -> Result<LearnedFilter, DesignError> {
    let by_resonance =
        DetectSettings { denominator: Denominator::Resonance, ..settings.detect.clone() };
    let first = LearnSettings { detect: &by_resonance, ..settings };
    // The search looks at all labelled faults, all other methods at the class `detect.fault`.
    let name = &settings.detect.fault;
    let is_search = settings.detect.denominator == Denominator::Searched;
    let faulty: Vec<_> = match is_search {
        true => set.faulty.values().collect(),
        false => set.faulty.get(name).into_iter().collect(),
    };
    if faulty.is_empty() {
        let known: Vec<&str> = set.faulty.keys().map(String::as_str).collect();
        return Err(DesignError::Invalid(match is_search {
            true => "detect.denominator = \"searched\": no signal is labelled faulty".into(),
            false => format!(
                "detect.fault = \"{name}\": no signal is labelled so (labelled faults: {})",
                known.join(", ")
            ),
        }));
    }
    let (design, _) = Design::of_healthy(set, first)?;
    let sets: Vec<_> = faulty.into_iter().flat_map(|faulty| design.with_models(faulty)).collect();
    let healthy = (&design.pooled, &pool(&set.healthy, set.samples));
    if is_search {
        return LearnedFilter::search(healthy, &sets, settings);
    }
    let class = FaultClass::learn(name, fault::category(name), &sets);
    LearnedFilter::learn(healthy, &class, &sets, settings)
}

/// Learns the class densities of a ring's features, from rings fitted to all labelled signals and
/// from the physics as far as that predicts the classes. The densities are learned twice: for
/// channels of which nothing is known, with each labelled signal moved to another channel's level;
/// and for channels whose own level is known, with features counted from that level. `None`: a
/// class has neither enough signals nor a prediction.
pub(super) fn learn_posterior(
    design: &Design,
    set: &TrainingSet,
) -> Result<Option<Posterior>, DesignError> {
    // The channels' healthy levels on every printhead; `None` of a printhead whose channels are too
    // few.
    let mut levels = BTreeMap::new();
    for ((model, signals), name) in
        design.with_models(&set.healthy).into_iter().zip(set.healthy.keys())
    {
        levels.insert(name, ChannelLevels::learn(model, signals)?);
    }

    // Features of each class's signals, both ways: `of_any` as of any channel, `of_own` from the
    // signal's own channel's level. `None` for a class without labelled signals.
    let (mut of_any, mut of_own) = (Vec::new(), Vec::new());
    for class in &design.classes {
        let Some(sets) = set.faulty.get(&class.name) else {
            of_any.push(None);
            of_own.push(None);
            continue;
        };
        // the levels of the printheads on which the class was labelled, in the order of `sets`
        let of_each: Vec<_> = sets.keys().map(|name| levels.get(name)?.as_ref()).collect();
        let sets = design.with_models(sets);
        of_any.push(examples(&sets, From::AnyChannel(&of_each))?);
        of_own.push(examples(&sets, From::OwnChannel(&of_each))?);
    }

    // The densities for channels of which nothing is known.
    let physics = design.physics.as_ref();
    let curves = physics
        .map(|of| of.curves(&design.fault_classes(), design.sample_period_s, design.samples));
    let Some(posterior) = posterior_of(&of_any, curves.as_ref()) else { return Ok(None) };

    // The densities about a channel's own level. They need every labelled class to have signals of
    // channels with a level. The physics' curves are then those of one channel whose baseline is
    // known as from `ChannelLevels::MOST` healthy signals, the most that a level rests on, without
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

/// Learns the densities of classes from labelled signals and from the physics' curves.
/// `of_classes`: the examples of each class, if it has any; `curves`: `None` without physics. The
/// result is `None` if a class has neither examples nor a curve.
fn posterior_of(
    of_classes: &[Option<Examples>],
    curves: Option<&FaultCurves>,
) -> Option<Posterior> {
    let learned = || {
        let all: Option<Vec<Examples>> = of_classes.iter().cloned().collect();
        all.and_then(|all| Posterior::learn(&all))
    };
    let Some(curves) = curves else { return learned() };

    // With physics, the learned densities and those of the curves are stacked (mixed with weights
    // that predict held-out examples best). For that, each example is first compared with the
    // curves. `known`: whether a class has a curve.
    let known: Vec<bool> = (0..of_classes.len()).map(|k| !curves.class(k).is_empty()).collect();
    let mut by_physics: Vec<Vec<Vec<f64>>> = vec![Vec::new(); of_classes.len()];
    for (k, class) in of_classes.iter().enumerate() {
        for x in class.iter().flat_map(|class| &class.features) {
            by_physics[k].push(ln_densities(curves, x.as_slice()));
        }
    }
    Posterior::stack(of_classes, &by_physics, &known).or_else(learned)
}

/// The ln density of four features in each class by the physics' curves, at the reference drive.
fn ln_densities(curves: &FaultCurves, x: &[f64]) -> Vec<f64> {
    let mut compared = Comparison::default();
    curves.compare(x, Conditions::as_made(), &mut compared);
    compared.ln_densities
}

/// Removes classes that are probably the same fault as a user's own class under another name. The
/// own class has labelled signals and stands for no law of the physics; the removed class has no
/// labelled signals, is known by the physics alone, and takes more than the share `little` of
/// the posterior of the own class's signals. Returns a message for each own class that replaced
/// others.
fn yield_to_own_classes(
    design: &mut Design,
    set: &TrainingSet,
    isolate: &IsolateSettings,
) -> Result<Vec<String>, DesignError> {
    let mut said = Vec::new();
    // the names of the user's own classes, of which the physics knows nothing
    let unknown =
        |class: &FaultClass| class.of.is_empty() && isolate.physics.law(&class.name).is_none();
    let own: Vec<String> =
        design.classes.iter().filter(|c| unknown(c)).map(|c| c.name.clone()).collect();
    for (name, printheads) in set.faulty.iter().filter(|(name, _)| own.contains(name)) {
        let (Some(posterior), Some(curves)) = (&design.posterior, design.curves()) else { break };
        let sets = design.with_models(printheads);
        let Some(examples) = examples(&sets, From::Head)? else { continue };

        // The posterior of each signal of the own class, under equal priors. `taken`: the sum over
        // signals of what each class gets.
        let classes = design.classes.len();
        let (mut weights, mut taken) = (vec![0.0; classes], vec![0.0; classes]);
        for x in examples.features.iter().map(|x| x.as_slice()) {
            let (by_physics, priors) = (ln_densities(&curves, x), vec![1.0; classes]);
            posterior.weigh(x, &by_physics, &priors, &mut Vec::new(), &mut weights);
            taken.iter_mut().zip(&weights).for_each(|(t, w)| *t += w);
        }

        // Only classes without labelled signals yield.
        let of_all = examples.features.len() as f64;
        let takes = |k: usize| design.classes[k].n_signals == 0 && taken[k] > little() * of_all;
        let gone: Vec<String> =
            (0..classes).filter(|&k| takes(k)).map(|k| design.classes[k].name.clone()).collect();
        if gone.is_empty() {
            continue;
        }

        // Curves and posterior depend on the classes, so both are made again before the next own
        // class.
        design.classes.retain(|class| !gone.contains(&class.name));
        design.curves = OnceLock::new();
        design.posterior = learn_posterior(design, set)?.map(Arc::new);
        said.push(format!(
            "{}: known by physics only, and what {name} looks like: left out. Label signals of it to \
             tell the two apart",
            gone.join(", ")
        ));
    }
    Ok(said)
}

/// Sorts the thesis's classes in the order of its tables, then a user's own by name.
fn in_table_order(classes: &mut [FaultClass]) {
    let place = |name: &str| fault::CLASSES.iter().position(|c| *c == name).unwrap_or(usize::MAX);
    classes.sort_by(|a, b| place(&a.name).cmp(&place(&b.name)).then(a.name.cmp(&b.name)));
}

/// All printheads' signals in one set. Channel numbers are offset by 2^20 times the printhead's
/// index, so that channels of different printheads are told apart. Labelled severities are not
/// carried over.
fn pool(healthy: &BTreeMap<String, SignalSet>, samples: usize) -> SignalSet {
    let mut all = SignalSet::new(samples);
    for (p, set) in healthy.values().enumerate() {
        for i in 0..set.len() {
            let channel = (p as u32).wrapping_mul(1 << 20).wrapping_add(set.channel[i]);
            all.push(set.signal(i), channel, set.drive[i], set.temperature_c[i]);
        }
    }
    all
}
