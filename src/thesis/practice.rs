//! The current practice as a baseline: per-class thresholds on the key numbers of signals
//! ([`crate::detect::key_numbers`]), learned on training signals.
//!
//! In: signals. Out: what thresholds say of them (thesis §4-2, §4-3).

use super::data::Signals;
use crate::detect::key_numbers::{KeyNumbers, KeyRange, Spectrum};
use crate::fault::HEALTHY;

/// Of each signal.
pub fn key_numbers(signals: &Signals) -> Vec<KeyNumbers> {
    let spectrum = Spectrum::new(signals.samples, signals.dt_s);
    signals.y.iter().map(|y| spectrum.key_numbers(y)).collect()
}

/// Thresholds per class.
pub struct Thresholds {
    ranges: Vec<(String, KeyRange)>,
}

impl Thresholds {
    /// The range of every class's training signals; of healthy ones all, of faults the middle 98 %.
    pub fn learn(signals: &Signals, numbers: &[KeyNumbers]) -> Thresholds {
        let mut names: Vec<&String> = signals.state.iter().collect();
        names.sort_unstable();
        names.dedup();
        let of_class = |name: &String| {
            let own =
                numbers.iter().zip(&signals.state).filter(|(_, s)| *s == name).map(|(k, _)| k);
            let cut = if name == HEALTHY { 0.0 } else { 0.01 };
            Some((name.clone(), KeyRange::of(own, cut)?))
        };
        Thresholds { ranges: names.into_iter().filter_map(of_class).collect() }
    }

    pub fn is_faulty(&self, k: &KeyNumbers) -> bool {
        self.ranges.iter().any(|(name, range)| name == HEALTHY && range.distance(k) > 1.0)
    }

    /// The class whose range is nearest; `None`: within no range of `known` classes.
    pub fn name(&self, k: &KeyNumbers, known: &[&str]) -> Option<&str> {
        self.ranges
            .iter()
            .filter(|(name, _)| known.contains(&name.as_str()))
            .map(|(name, range)| (range.distance(k), name.as_str()))
            .filter(|(distance, _)| *distance <= 1.0)
            .min_by(|p, q| p.0.total_cmp(&q.0))
            .map(|(_, name)| name)
    }
}
