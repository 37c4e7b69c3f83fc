//! What the physics says of faults before one was seen.
//!
//! In: the healthy models and signals, the actuation. Out: [`FaultPhysics`], from which severities and
//! the densities of unlabelled classes follow. thesis §2-2; labels sharpen it (`train`).

use super::detector::ring_of;
use super::train::examples;
use super::{Design, DesignError, IsolateSettings, TrainingSet};
use crate::identify::averaging::SignalSet;
use crate::isolate::fault_curve::{Bench, Healthy};
use crate::isolate::severity::{FaultPhysics, spread_of_channels};
use crate::model::Actuation;
use crate::model::ring_fit::RingFitter;
use std::collections::{BTreeMap, BTreeSet};

/// Healthy signals of a printhead that are fitted to see how channels differ, at most.
const MOST_SIGNALS: usize = 4096;

/// `None`: the healthy signals are too few to tell how channels differ.
pub(super) fn physics(
    design: &Design,
    set: &TrainingSet,
    isolate: &IsolateSettings,
) -> Result<Option<FaultPhysics>, DesignError> {
    let model = &design.pooled;
    let (dt_s, samples, noise) = (design.sample_period_s, design.samples, model.noise);
    let ring = ring_of(&model.identification)?;
    let fitter = RingFitter::new(ring, dt_s, samples);
    let channel = model.identification.channel;
    let actuation = Actuation { pulse_s: isolate.pulse_s, delay_s: isolate.delay_s };
    let healthy = Healthy { channel, actuation };
    let few: BTreeMap<String, SignalSet> = set
        .healthy
        .iter()
        .map(|(name, signals)| {
            let some: Vec<usize> = (0..signals.len().min(MOST_SIGNALS)).collect();
            (name.clone(), signals.select(&some))
        })
        .collect();
    let channels: BTreeSet<(&str, u32)> = few
        .iter()
        .flat_map(|(name, set)| set.channel.iter().map(move |&c| (name.as_str(), c)))
        .collect();
    let slope = Bench::new(&fitter, healthy, true, noise, dt_s, samples)
        .and_then(|mut bench| bench.point("SDN", 0.0))
        .map(|none| none.slope);
    let features = examples(&design.with_models(&few), true)?;
    let (Some(slope), Some(features)) = (slope, features) else { return Ok(None) };
    let looks = few.values().flat_map(|set| &set.drive);
    let weaker = looks.clone().map(|s| 1.0 / (s * s)).sum::<f64>() / looks.count().max(1) as f64;
    let noise_covariance = features.noise * weaker;
    let spread = spread_of_channels(&slope, &features.features, &noise_covariance, channels.len());
    Ok(spread.map(|spread| FaultPhysics { channel, actuation, ring, noise, spread }))
}
