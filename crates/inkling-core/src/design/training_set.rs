//! Labelled signals, and the features of the rings that are fitted to them.
//!
//! In, from `pipeline/collect.rs`: signals by label and printhead. Out: [`TrainingSet`], which
//! training reads and cross-validation divides; and `examples`, the features (ln amplitude, ln
//! damping, ln frequency, phase) of a class's signals for the posterior's densities.

use super::{Extension, HealthyModel, Result};
use crate::fault::HEALTHY;
use crate::identify::SignalSet;
use crate::isolate::stacking::Examples;
use crate::model::ring_fit::Features;
use nalgebra::{DMatrix, DVector, Vector4};
use std::collections::BTreeMap;

/// Labelled signals of one sample period and length.
#[derive(Debug, Default)]
pub struct TrainingSet {
    pub sample_period_s: f64,
    pub samples: usize,
    pub drive_voltage_v: Option<f64>,
    /// Healthy signals by printhead.
    pub healthy: BTreeMap<String, SignalSet>,
    /// Faulty signals by class, then printhead.
    pub faulty: BTreeMap<String, BTreeMap<String, SignalSet>>,
    /// Number of signals seen, by label, or by the reason for those that were not collected.
    pub signals: BTreeMap<String, u64>,
    /// It was subtracted from the signals already.
    pub extension: Option<Extension>,
}

impl TrainingSet {
    /// All signals, each set with its state (`healthy` or a class) and its printhead.
    pub fn sets(&self) -> impl Iterator<Item = (&str, &str, &SignalSet)> {
        let states = std::iter::once((HEALTHY, &self.healthy));
        let states = states.chain(self.faulty.iter().map(|(name, sets)| (name.as_str(), sets)));
        states.flat_map(|(state, sets)| {
            sets.iter().map(move |(printhead, signals)| (state, printhead.as_str(), signals))
        })
    }

    /// The signals whose indices `keep` returns for a state, a printhead and its signals of that
    /// state, without the extension. A class or printhead without any is left out.
    pub fn with(&self, mut keep: impl FnMut(&str, &str, &SignalSet) -> Vec<usize>) -> TrainingSet {
        let mut part = TrainingSet {
            sample_period_s: self.sample_period_s,
            samples: self.samples,
            drive_voltage_v: self.drive_voltage_v,
            ..TrainingSet::default()
        };
        for (state, printhead, signals) in self.sets() {
            let kept = signals.select(&keep(state, printhead, signals));
            if kept.is_empty() {
                continue;
            }
            *part.signals.entry(state.into()).or_default() += kept.len() as u64;
            match state {
                HEALTHY => part.healthy.insert(printhead.into(), kept),
                fault => {
                    part.faulty.entry(fault.into()).or_default().insert(printhead.into(), kept)
                }
            };
        }
        part
    }
}

/// A signal that a ring fits.
pub(super) struct FittedSignal {
    /// Index of its printhead's set.
    pub set: usize,
    /// Its number among the signals of the set that a ring fits.
    pub rank: usize,
    pub channel: u32,
    /// Relative to the printhead's ring.
    pub features: Vector4<f64>,
}

/// Features of a class's signals, and the covariance (4 x 4) of a fit's noise at their mean, with
/// several printheads of the last one. `sets`: signals with the model of their printhead;
/// `counted`: the features from the level that they shall be counted from, `None`: left out.
pub(super) fn examples(
    sets: &[(&HealthyModel, &SignalSet)],
    counted: impl Fn(FittedSignal) -> Option<Vector4<f64>>,
) -> Result<Option<Examples>> {
    let (mut features, mut noise) = (Vec::new(), None);
    for (k, &(model, set)) in sets.iter().enumerate() {
        let found = model.fitted(set)?;
        if found.is_empty() {
            continue; // no signal of this printhead rings
        }
        let sum = found.iter().fold(Vector4::zeros(), |sum, (_, x)| sum + x);
        let at: Features = (sum / found.len() as f64).into();
        noise = model.fitter()?.noise_covariance(&at, model.noise).or(noise);
        let counted = |(rank, &(i, features)): (usize, &(usize, Vector4<f64>))| {
            let of = FittedSignal { set: k, rank, channel: set.channel[i], features };
            Some(DVector::from_row_slice(counted(of)?.as_slice()))
        };
        features.extend(found.iter().enumerate().filter_map(counted));
    }
    let enough = !features.is_empty();
    let noise = noise.filter(|_| enough).map(|of| DMatrix::from_column_slice(4, 4, of.as_slice()));
    Ok(noise.map(|noise| Examples::new(features, noise)))
}
