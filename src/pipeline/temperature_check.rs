//! Finds printheads that were judged at other temperatures than their models were learned at, by models that
//! do not know what temperature does, and whose channels could not be followed.
//!
//! In: bursts and the judges assigned to them, from the identify stage; at the end the printheads that were
//! followed, from `wiring`. Out: a warning per printhead, to `finish`. What temperature does to all channels of a
//! followed printhead is part of its level.

use super::groups::of_printhead;
use inkling_core::burst::Burst;
use inkling_core::design::Judge;
use inkling_lab::critique::digits::significant;
use std::collections::BTreeMap;
use std::sync::Arc;

/// A difference in temperature up to this, K, is not warned about. One K changes damping by some percent
/// (water-based ink: about 2), which is half of what channels differ by.
const HARMLESS_K: f64 = 1.0;
/// Maximum number of printheads that are checked.
const MOST_PRINTHEADS: usize = 1 << 10;

/// The temperatures of each printhead's bursts, as far as models without a temperature response judge them.
#[derive(Debug, Default)]
pub struct TemperatureCheck {
    by_printhead: BTreeMap<Arc<str>, TemperatureRange>,
}

/// The range of a printhead's temperatures, °C, and how far the farthest lies from its model's, K.
#[derive(Clone, Copy, Debug)]
struct TemperatureRange {
    least: f64,
    most: f64,
    farthest: f64,
}

impl TemperatureCheck {
    pub fn take(&mut self, judge: &Judge, burst: &Burst) {
        let Some(t) = burst.temperature_c.filter(|t| t.is_finite()) else { return };
        if judge.model.temperature_response.is_some() {
            return;
        }
        let off = judge.model.temperature_c.map_or(0.0, |reference| (t - reference).abs());
        let new = || TemperatureRange { least: t, most: t, farthest: off };
        let of = of_printhead(&mut self.by_printhead, &burst.printhead, MOST_PRINTHEADS, new);
        if let Some(range) = of {
            range.least = range.least.min(t);
            range.most = range.most.max(t);
            range.farthest = range.farthest.max(off);
        }
    }

    pub fn forget<'a>(&mut self, followed: impl Iterator<Item = &'a str>) {
        for printhead in followed {
            self.by_printhead.remove(printhead);
        }
    }

    /// Warnings by printhead: where a temperature lay more than `HARMLESS_K` from the model's, or so far from
    /// the middle of the range.
    pub fn warnings(&self) -> Vec<(Arc<str>, String)> {
        let says = |range: &TemperatureRange| {
            format!(
                "judged at {} to {} °C by models that do not know what temperature does, and its channels could \
                 not be followed: expect false alarms",
                significant(range.least, 3),
                significant(range.most, 3)
            )
        };
        let matters = |range: &TemperatureRange| {
            range.farthest.max(0.5 * (range.most - range.least)) > HARMLESS_K
        };
        let of = self.by_printhead.iter().filter(|(_, range)| matters(range));
        of.map(|(name, range)| (name.clone(), says(range))).collect()
    }
}
