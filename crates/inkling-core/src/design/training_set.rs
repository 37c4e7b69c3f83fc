//! Labelled signals, and the features of the rings that are fitted to them.
//!
//! In, from the collecting of recordings by their labels (`pipeline/collect.rs`): signals by label
//! and printhead. Out: [`TrainingSet`], which training reads and cross-validation divides.
//! `examples` turns a class's signals into the features (ln amplitude, ln damping, ln frequency,
//! phase) that the densities of the posterior are learned from; `From` says which level the
//! features are counted from.

use super::channel_levels::ChannelLevels;
use super::{DesignError, Extension, HealthyModel};
use crate::fault::HEALTHY;
use crate::identify::averaging::SignalSet;
use crate::isolate::stacking::Examples;
use crate::model::ring_fit::Features;
use nalgebra::{DMatrix, DVector, Vector4};
use std::collections::BTreeMap;

/// Labelled signals of one sample period and length; their drives are relative to
/// `drive_voltage_v`.
#[derive(Debug, Default)]
pub struct TrainingSet {
    pub sample_period_s: f64,
    /// Number N of samples per signal.
    pub samples: usize,
    /// The reference drive voltage, V; `None`: no drive was recorded.
    pub drive_voltage_v: Option<f64>,
    /// Healthy signals by printhead.
    pub healthy: BTreeMap<String, SignalSet>,
    /// Faulty signals by class, then printhead.
    pub faulty: BTreeMap<String, BTreeMap<String, SignalSet>>,
    /// Number of signals seen, by label, or by the reason for those that were not collected. They
    /// may be more than are held here, which is a sample.
    pub signals: BTreeMap<String, u64>,
    /// What a critique found missing in the models. It was subtracted from the signals already.
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

    /// The same set with some of the signals, without the extension. `keep` gets a state, a
    /// printhead and its signals of that state, and returns the indices of the signals to keep. A
    /// class or printhead without any signal left is left out, and `signals` counts those that are
    /// kept.
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

/// The level that the features of labelled signals are counted from. The slices hold, for each
/// printhead in the order of the signals' sets, its channels' levels, if they are known.
#[derive(Clone, Copy, Debug)]
pub(super) enum From<'a> {
    /// The printhead's level: the features stay as they are.
    Head,
    /// The printhead's level, with each signal moved as if it were of another of the printhead's
    /// channels. Where levels are not known the signal stays as it is.
    AnyChannel(&'a [Option<&'a ChannelLevels>]),
    /// The level of the signal's own channel. Signals of channels without one are left out.
    OwnChannel(&'a [Option<&'a ChannelLevels>]),
}

impl From<'_> {
    /// Features `x` of a signal, counted from the level that `self` says. `k`: index of the
    /// signal's printhead; `i`: number of the signal among those of its set that a ring fits;
    /// `channel`: the signal's. `None`: the signal is left out.
    fn moved(self, k: usize, i: usize, channel: u32, x: &Vector4<f64>) -> Option<Vector4<f64>> {
        match self {
            From::Head => Some(*x),
            From::AnyChannel(of) => {
                Some(of[k].map_or(*x, |levels| levels.elsewhere(channel, i, x)))
            }
            From::OwnChannel(of) => Some(x - of[k]?.at(channel)?),
        }
    }
}

/// Features of a class's signals, and the covariance (4 x 4) of a fit's noise at the mean of the
/// features. `sets`: the class's signals, each set with the healthy model of its printhead. With
/// several printheads the noise is that of the last one that gives a covariance. `None`: no signal
/// is left. An error if a model does not ring.
pub(super) fn examples(
    sets: &[(&HealthyModel, &SignalSet)],
    from: From,
) -> Result<Option<Examples>, DesignError> {
    let (mut features, mut noise) = (Vec::new(), None);
    for (k, (model, set)) in sets.iter().enumerate() {
        let found = model.fitted(set)?;
        if found.is_empty() {
            continue; // no signal of this printhead rings
        }
        let sum = found.iter().fold(Vector4::zeros(), |sum, (_, x)| sum + x);
        let at: Features = (sum / found.len() as f64).into();
        noise = model.fitter()?.noise_covariance(&at, model.noise).or(noise);
        let moved = |(rank, (i, x)): (usize, &(usize, Vector4<f64>))| {
            Some(DVector::from_row_slice(from.moved(k, rank, set.channel[*i], x)?.as_slice()))
        };
        features.extend(found.iter().enumerate().filter_map(moved));
    }
    let enough = !features.is_empty();
    let noise = noise.filter(|_| enough).map(|of| DMatrix::from_column_slice(4, 4, of.as_slice()));
    Ok(noise.map(|noise| Examples::new(features, noise)))
}
