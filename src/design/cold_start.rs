//! What the physics says of faults before one was seen, and what labelled severities add to it.
//!
//! In: the healthy models and signals, a guess of rates and actuation, labelled faults. Out:
//! [`FaultPhysics`], from which severities and the densities of unlabelled classes follow. thesis §2-2.

use super::detector::ring_of;
use super::train::examples;
use super::{Design, DesignError, HealthyModel, IsolateSettings, TrainingSet};
use crate::identify::GreyBoxSettings;
use crate::identify::averaging::SignalSet;
use crate::isolate::fault_curve::Healthy;
use crate::isolate::fault_physics::{FaultPhysics, Look};
use crate::model::ring_fit::{Columns, RingFitter};
use crate::model::{Actuation, InkChannel, faults};
use nalgebra::Vector4;
use std::collections::{BTreeMap, BTreeSet};

/// Healthy signals of a printhead that are fitted to see how channels differ, at most.
const MOST_HEALTHY: usize = 4096;
/// Labelled signals of a class and printhead that correct the rates, at most.
const MOST_LOOKS: usize = 512;

/// `None`: the healthy signals do not ring, or are too few to tell how channels differ.
pub(super) fn physics(
    design: &Design,
    set: &TrainingSet,
    grey_box: &GreyBoxSettings,
    isolate: &IsolateSettings,
) -> Result<Option<FaultPhysics>, DesignError> {
    let GreyBoxSettings { a_per_s2, b_per_s2, g_per_s, d_per_s, .. } = *grey_box;
    let channel = InkChannel { a_per_s2, b_per_s2, g_per_s, d_per_s };
    let actuation = Actuation { pulse_s: isolate.pulse_s, delay_s: isolate.delay_s };
    let guess = Healthy { channel, actuation };
    let model = &design.pooled;
    let sampling = (design.sample_period_s, design.samples);
    let ring = ring_of(&model.identification)?;
    let Some(mut physics) = FaultPhysics::new(guess, isolate.guess_sd, ring, model.noise) else {
        return Ok(None);
    };

    let few: BTreeMap<String, SignalSet> =
        set.healthy.iter().map(|(name, all)| (name.clone(), first(all, MOST_HEALTHY))).collect();
    let channels: BTreeSet<(&str, u32)> = few
        .iter()
        .flat_map(|(name, set)| set.channel.iter().map(move |&c| (name.as_str(), c)))
        .collect();
    let looks = few.values().flat_map(|set| &set.drive);
    let weaker = looks.clone().map(|s| 1.0 / (s * s)).sum::<f64>() / looks.count().max(1) as f64;
    let learned = examples(&design.with_models(&few), true)?.and_then(|healthy| {
        let noise = healthy.noise * weaker;
        physics.learn_spread(&healthy.features, &noise, channels.len(), sampling)
    });
    if learned.is_none() {
        return Ok(None);
    }

    let mut looks = Vec::new();
    for (class, printheads) in &set.faulty {
        if faults::change(class).is_none() {
            continue;
        }
        for (model, signals) in design.with_models(printheads) {
            looks.extend(sized(class, model, &first(signals, MOST_LOOKS))?);
        }
    }
    if !looks.is_empty() {
        let before = physics.clone();
        // rates that ring no more: the labels do not fit the physics at all
        if physics.learn_rates(guess, isolate.guess_sd, &looks, sampling).is_none() {
            physics = before;
        }
    }
    Ok(Some(physics))
}

fn first(set: &SignalSet, most: usize) -> SignalSet {
    set.select(&(0..set.len().min(most)).collect::<Vec<_>>())
}

/// The signals whose severity is labelled, fitted.
fn sized(class: &str, model: &HealthyModel, set: &SignalSet) -> Result<Vec<Look>, DesignError> {
    let known: Vec<usize> = (0..set.len()).filter(|&i| set.severity[i].is_finite()).collect();
    let set = set.select(&known);
    let fitter =
        RingFitter::new(ring_of(&model.identification)?, model.generator.dt_s, set.samples);
    let mut looks_of: BTreeMap<u32, f64> = BTreeMap::new();
    set.channel.iter().for_each(|&c| *looks_of.entry(c).or_default() += 1.0);
    let (mut looks, mut columns, mut i) = (Vec::new(), Columns::default(), 0);
    model.each_deviation(&set, |deviation, drive| {
        let signal: Vec<f64> =
            model.expected.iter().zip(deviation).map(|(e, d)| e + d / drive).collect();
        if let Some(fit) = fitter.fit(&signal, true, &mut columns) {
            looks.push(Look {
                class: class.into(),
                severity: set.severity[i],
                features: Vector4::from(fit.features.coordinates()),
                drive,
                weight: 1.0 / looks_of[&set.channel[i]],
            });
        }
        i += 1;
    });
    Ok(looks)
}
