//! What a filter sees of a channel before any fault is labelled, for `inkling identify`.
//!
//! In: an identified model and the healthy signals that it was identified on. Out:
//! [`Detectability`]: how many filters of method I's degree no healthy signal excites (the dimension
//! of the left null space), and the frequencies that method I's filter does not answer; by Monte
//! Carlo (`promise`) how small a fault a design trained on these signals would find, and which
//! classes it would mistake for each other. thesis (3-2), (3-3), §3-2-1.

use super::fd_filter::{by_resonance, with_denominator};
use super::{Design, IsolateSettings, Result, TrainingSet};
use crate::detect::{
    DetectMethod, DetectSettings, ThresholdMethod, blind::blind_ranges, null_space,
};
use crate::identify::GreyBoxSettings;
use crate::identify::SignalSet;
use crate::identify::grey_box::Identification;
use crate::promise::Promise;
use serde::Serialize;
use std::collections::BTreeMap;

/// A filter is blind to a frequency at which its gain is less than this share of its largest, that
/// at the undamped pair, which is some thousand times the gain elsewhere.
const BLIND: f64 = 1e-6;
const STEPS: usize = 8192;

#[derive(Clone, Debug, Serialize)]
pub struct Detectability {
    pub degree: usize,
    /// Number of linearly independent such filters that no healthy signal excites: (3-3a).
    pub nullity: usize,
    /// Ranges (from, to), Hz, of frequencies that the filter is blind to.
    pub blind_hz: Vec<[f64; 2]>,
    /// By sensitivities with a quantile as threshold and the faults that the physics knows. `None`:
    /// a design could not be trained, as on too few signals or on signals that do not ring.
    pub promise: Option<Promise>,
}

impl Detectability {
    /// An error if the channel has no filter of method I. `healthy`: signals of one printhead.
    pub fn of(
        identification: &Identification,
        healthy: &SignalSet,
        dt_s: f64,
        grey_box: &GreyBoxSettings,
        settings: &DetectSettings,
    ) -> Result<Detectability> {
        // by method I, whatever the settings' denominator is
        let channel = identification.channel;
        let denominator = by_resonance(identification, healthy.samples, settings, dt_s)?;
        let degree = denominator.len() - 1;
        let space = null_space::annihilator(&channel.a(), &channel.c(), dt_s, degree)?;
        let nullity = space.n_bar.nrows();
        let filter = with_denominator(&channel, denominator, dt_s)?;
        let blind = blind_ranges(&filter, BLIND, STEPS).into_iter();
        let blind_hz = blind.map(|(from, to)| [from, to]).collect();

        // trained on the healthy signals alone, so its faults are those of the physics
        let set = TrainingSet {
            sample_period_s: dt_s,
            samples: healthy.samples,
            healthy: BTreeMap::from([(String::new(), healthy.clone())]),
            ..TrainingSet::default()
        };
        // of the settings only those of the threshold: what is set for filters is none of this method
        let detect = DetectSettings {
            method: DetectMethod::Sensitivity,
            threshold: ThresholdMethod::Quantile,
            false_alarm_rate: settings.false_alarm_rate,
            confidence: settings.confidence,
            ..DetectSettings::default()
        };
        let isolate = IsolateSettings::default();
        let promise = Design::train(&set, grey_box, &detect, &isolate)
            .ok()
            .map(|(design, _)| design.promise(&isolate))
            .transpose()?
            .flatten();
        Ok(Detectability { degree, nullity, blind_hz, promise })
    }
}
