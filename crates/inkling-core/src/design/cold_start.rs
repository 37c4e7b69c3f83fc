//! Learning the physics of faults for a design: what is predicted before any fault was labelled,
//! and what labelled signals correct.
//!
//! In, from `train`: the healthy models and signals, a guess of rates and actuation from the
//! settings, labelled faults. Out: [`FaultPhysics`], from which severities and the densities of
//! unlabelled classes follow, and these classes. thesis (2-2), §2-2. The steps:
//! 1. The guessed channel is scaled in time to the measured healthy ring.
//! 2. Healthy features, less the noise of their fits, tell how channels differ (`spread`).
//! 3. Labelled faults of known kinds correct the rates.
//! 4. Labelled faults tell how far the laws lie off them, and how severities are distributed in each
//!    class. A user's own class with labelled sizes gets a law that says nothing, to be learned alone.

use super::training_set::examples;
use super::{Design, FaultClass, HealthyModel, IsolateSettings, Result, TrainingSet};
use crate::fault;
use crate::identify::GreyBoxSettings;
use crate::identify::SignalSet;
use crate::isolate::fault_physics::{FaultPhysics, LabelledFault};
use crate::isolate::fault_simulator::ActuatedChannel;
use crate::isolate::physics_density::LabelledSeverities;
use crate::isolate::tuned;
use crate::model::faults::Law;
use crate::model::ring::Ring;
use crate::model::{Actuation, Waveform};
use nalgebra::Vector4;
use std::collections::{BTreeMap, BTreeSet};

/// Pulse and delay of the actuation, s, where nobody gave them, for a channel that rings at the
/// frequency of the guess `identify.grey_box`; for others scaled in proportion to the period.
const PULSE_S: f64 = 9e-6;
const DELAY_S: f64 = 6e-6;
/// At most so many healthy signals of a printhead tell how channels differ.
const MOST_HEALTHY: usize = 4096;
/// At most so many labelled signals of a class and printhead correct rates and severities.
const MOST_LOOKS: usize = 512;

/// `None`: the guessed channel does not ring, or the healthy signals do not tell how channels
/// differ. An error if an identified model does not ring, or if the waveform is not possible.
pub(super) fn physics(
    design: &Design,
    set: &TrainingSet,
    grey_box: &GreyBoxSettings,
    isolate: &IsolateSettings,
) -> Result<Option<FaultPhysics>> {
    let model = &design.pooled;
    let sampling = (design.sample_period_s, design.samples);
    let ring = model.ring()?;

    let guess = scaled_guess(grey_box, isolate, ring.frequency_hz)?;
    let Some(mut physics) = FaultPhysics::new(guess, isolate.guess_sd, ring, model.noise) else {
        return Ok(None);
    };
    physics.laws = isolate.physics.clone();
    for (name, printheads) in &set.faulty {
        if let Some(range) = labelled_range(printheads)
            && design.classes.iter().any(|class| class.name == *name && class.of.is_empty())
            && physics.laws.law(name).is_none()
        {
            physics.laws.add_sizes(name, range);
        }
    }

    // Step 2. Features are per unit drive, so weakly driven signals have more noise: `weaker` is the
    // mean factor on the noise's variance.
    let few: BTreeMap<String, SignalSet> =
        set.healthy.iter().map(|(name, all)| (name.clone(), all.first(MOST_HEALTHY))).collect();
    let channels: BTreeSet<(&str, u32)> = few
        .iter()
        .flat_map(|(name, set)| set.channel.iter().map(move |&c| (name.as_str(), c)))
        .collect();
    let drives = few.values().flat_map(|set| &set.drive);
    let weaker = drives.clone().map(|s| 1.0 / (s * s)).sum::<f64>() / drives.count().max(1) as f64;
    let learned =
        examples(&design.with_models(&few), |of| Some(of.features))?.and_then(|healthy| {
            let noise = healthy.noise * weaker;
            physics.learn_spread(&healthy.features, &noise, channels.len(), sampling)
        });
    if learned.is_none() {
        return Ok(None);
    }

    // Step 3. Classes that stand for no law, or for laws of several kinds, tell nothing of the rates.
    let mut labelled = Vec::new();
    for (name, printheads) in &set.faulty {
        let Some(class) = design.classes.iter().find(|class| class.name == *name) else { continue };
        let class = class.class();
        let Some(kind) = physics.laws.one_kind(&class.of) else { continue };
        let own = physics.laws.law(kind).filter(|law| law.changes_nothing());
        let is_size =
            |size: f64| own.is_none_or(|law| (law.range[0]..=law.range[1]).contains(&size));
        for (model, signals) in design.with_models(printheads) {
            let mut few = signals.first(MOST_LOOKS);
            few.severity
                .iter_mut()
                .filter(|size| !is_size(**size))
                .for_each(|size| *size = f64::NAN);
            labelled.extend(labelled_faults((name, kind), model, &ring, &few)?);
        }
    }
    if !labelled.is_empty() {
        // if a channel of the corrected rates would not ring, the labels do not fit the physics
        let before = physics.clone();
        if physics.learn_rates(guess, isolate.guess_sd, &labelled, sampling).is_none() {
            physics = before;
        }
    }

    physics.learn_discrepancies(&labelled, sampling);
    let mut sizes: BTreeMap<String, Vec<(f64, f64)>> = BTreeMap::new();
    for LabelledFault { class, severity, weight, .. } in labelled {
        sizes.entry(class).or_default().push((severity, weight));
    }
    let seen = |(class, of)| (class, LabelledSeverities::new(of));
    physics.seen = sizes.into_iter().map(seen).filter(|(_, of)| of.n > 0.0).collect();
    Ok(Some(physics))
}

/// The sizes that a user's own class may have by its labels, the least one first: beyond the least
/// and the greatest, but for the share of labels that may be wrong, by the mean distance of channels.
/// `None`: no sizes above 0 of three channels.
fn labelled_range(printheads: &BTreeMap<String, SignalSet>) -> Option<[f64; 2]> {
    let mut channels = BTreeSet::new();
    let mut sizes = Vec::new();
    for (name, set) in printheads {
        for (channel, size) in set.channel.iter().zip(&set.severity) {
            if *size > 0.0 {
                channels.insert((name, channel));
                sizes.push(*size);
            }
        }
    }
    sizes.sort_by(f64::total_cmp);
    let wrong = (tuned::WRONG_LABELS * sizes.len() as f64) as usize;
    let (low, high) = (*sizes.get(wrong)?, *sizes.iter().rev().nth(wrong)?);
    let beyond = (high - low) / (channels.len() as f64 - 1.0);
    (channels.len() >= 3 && beyond > 0.0).then(|| [(low - beyond).max(0.1 * low), high + beyond])
}

/// Which labelled classes will have no size, in words.
pub(super) fn unsized_classes(design: &Design) -> Option<String> {
    let laws = &design.physics.as_ref()?.laws;
    let has_none =
        |class: &&FaultClass| class.n_signals > 0 && laws.one_kind(&class.class().of).is_none();
    let names: Vec<&str> =
        design.classes.iter().filter(has_none).map(|class| class.name.as_str()).collect();
    (!names.is_empty()).then(|| {
        format!(
            "no size will be told of {}: labels with different severities above 0 on three channels or more, \
             of faults of one kind, would tell what a size looks like",
            names.join(", ")
        )
    })
}

/// Step 1. Of the settings' channel only the ratios of rates are trusted: it is scaled in time such
/// that it rings at `frequency_hz`, and default durations with it. Durations that were given stay.
fn scaled_guess(
    grey_box: &GreyBoxSettings,
    isolate: &IsolateSettings,
    frequency_hz: f64,
) -> Result<ActuatedChannel> {
    let default = GreyBoxSettings::default();
    let slower = (default.a_per_s2 / default.at_frequency(frequency_hz).a_per_s2).sqrt();
    let (waveform, pulse_s) = match isolate.waveform.is_empty() {
        true => (Waveform::default(), isolate.pulse_s.unwrap_or(PULSE_S * slower)),
        false => Waveform::new(&isolate.waveform)?,
    };
    let delay_s = isolate.delay_s.unwrap_or(DELAY_S * slower);
    let channel = grey_box.at_frequency(frequency_hz).channel();
    Ok(ActuatedChannel { channel, actuation: Actuation { pulse_s, delay_s, waveform } })
}

/// Adds the classes that the physics knows and nobody labelled, or names declared to stand for
/// them, with the mean deviation (for residual matching) in the middle of their severities.
pub(super) fn add_classes(design: &mut Design, isolate: &IsolateSettings) {
    let Some(physics) = &design.physics else { return };
    let categories = isolate.physics.categories();
    let sampling = (design.sample_period_s, design.samples);
    let stands = |class: &&str| !isolate.classes.values().flatten().any(|of| of == class);
    let known = fault::CLASSES.into_iter().chain(isolate.physics.own_classes());
    let plain = known.filter(stands).map(|name| (name, Vec::new()));
    let own = isolate.classes.iter().map(|(name, of)| (name.as_str(), of.clone()));
    for (name, of) in plain.chain(own) {
        if design.classes.iter().any(|class| class.name == name) {
            continue;
        }
        // a declared name gets the deviation of the first of the classes that it stands for
        let like = of.first().map_or(name, String::as_str);
        let middle = physics.laws.law(like).map(Law::middle);
        let deviation = middle.and_then(|s| physics.deviation(like, s, sampling));
        if let Some(deviation) = deviation {
            design.classes.push(FaultClass {
                name: name.into(),
                category: categories.of(name).into(),
                of,
                deviation,
                ..FaultClass::default()
            });
        }
    }
}

/// The labelled signals of a class on one printhead that a ring fits; every channel counts as one.
/// `kind`: the law in whose unit severities are given; `ring`: what the physics is relative to.
fn labelled_faults(
    (class, kind): (&str, &str),
    model: &HealthyModel,
    ring: &Ring,
    set: &SignalSet,
) -> Result<Vec<LabelledFault>> {
    let mut of_channel: BTreeMap<u32, f64> = BTreeMap::new();
    set.channel.iter().for_each(|&c| *of_channel.entry(c).or_default() += 1.0);
    let labelled = |(i, features): (usize, Vector4<f64>)| LabelledFault {
        class: class.into(),
        kind: kind.into(),
        severity: set.severity[i],
        features,
        drive: set.drive[i],
        ring: model.ring_from(ring, model.warmer(set.temperature_c[i])),
        channel: (model.printhead.clone(), set.channel[i]),
        weight: 1.0 / of_channel[&set.channel[i]],
    };
    Ok(model.fitted(set)?.into_iter().map(labelled).collect())
}
