//! The current practice as a baseline: thresholds for each class on the key numbers of signals
//! ([`super::key_numbers`]), thesis §4-2 and §4-3.
//!
//! In: the signals of a set. Out to `measure`: whether a signal is faulty, and which class the
//! thresholds name; `key_figures` draws the key numbers. The manufacturer's thresholds are set by
//! hand and not published. Here they are learned: for each class the range of dominant frequency
//! and damping of its training signals.

use super::datasets::each;
use super::key_numbers::{KeyNumbers, KeyRange, Spectrum};
use inkling_core::design::TrainingSet;
use inkling_core::fault::HEALTHY;
use std::collections::BTreeMap;

/// State and key numbers (dominant amplitude, damping and frequency) of each signal of a set.
pub fn key_numbers(set: &TrainingSet) -> Vec<(&str, KeyNumbers)> {
    let spectrum = Spectrum::new(set.samples, set.sample_period_s);
    each(set).map(|(state, y)| (state, spectrum.key_numbers(&y))).collect()
}

/// The thresholds: for each class a range of frequency and one of damping.
pub struct Thresholds<'a> {
    ranges: BTreeMap<&'a str, KeyRange>,
}

impl<'a> Thresholds<'a> {
    /// Learns the range of every class from its training signals: of the healthy ones all, so that
    /// few healthy signals are flagged; of a fault the middle 98 %, so that outliers do not widen
    /// its range.
    pub fn learn(numbers: &[(&'a str, KeyNumbers)]) -> Thresholds<'a> {
        let mut by_state: BTreeMap<&str, Vec<&KeyNumbers>> = BTreeMap::new();
        numbers.iter().for_each(|(state, k)| by_state.entry(state).or_default().push(k));
        let range = |(state, own): (&'a str, Vec<&KeyNumbers>)| {
            let cut = if state == HEALTHY { 0.0 } else { 0.01 };
            Some((state, KeyRange::of(own.iter().copied(), cut)?))
        };
        Thresholds { ranges: by_state.into_iter().filter_map(range).collect() }
    }

    /// Whether a signal lies outside the healthy range in frequency or damping.
    pub fn is_faulty(&self, k: &KeyNumbers) -> bool {
        self.ranges.get(HEALTHY).is_some_and(|range| range.distance(k) > 1.0)
    }

    /// The fault class that `known` accepts in whose range the signal lies, the nearest by half-widths.
    pub fn name(&self, k: &KeyNumbers, known: impl Fn(&str) -> bool) -> Option<&'a str> {
        self.ranges
            .iter()
            .filter(|(name, _)| **name != HEALTHY && known(name))
            .map(|(name, range)| (range.distance(k), *name))
            .filter(|(distance, _)| *distance <= 1.0)
            .min_by(|p, q| p.0.total_cmp(&q.0))
            .map(|(_, name)| name)
    }
}
