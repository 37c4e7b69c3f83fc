//! Temperatures at which a model judges without knowing what temperature does.
//!
//! In: bursts and the judges assigned to them. Out: the demand to learn it ([`super::temperature`]) or,
//! where that was tried in vain, a warning per printhead.

use super::PipelineError;
use crate::burst::Burst;
use crate::design::Judge;
use std::collections::BTreeMap;
use std::sync::Arc;

/// A K changes damping by some percent (water-based ink: about 2): half of what channels differ by.
const HARMLESS_K: f64 = 1.0;
/// Printheads that are told apart.
const MOST_PRINTHEADS: usize = 1 << 10;

#[derive(Debug)]
pub struct Warmth {
    /// It may still be learned from the recording.
    may_learn: bool,
    by_printhead: BTreeMap<Arc<str>, Seen>,
}

/// Temperatures of bursts whose model knows no response, and the farthest from that model. °C, K.
#[derive(Clone, Copy, Debug)]
struct Seen {
    least: f64,
    most: f64,
    farthest: f64,
}

impl Warmth {
    pub fn new(may_learn: bool) -> Warmth {
        Warmth { may_learn, by_printhead: BTreeMap::new() }
    }

    pub fn take(&mut self, judge: &Judge, burst: &Burst) -> Result<(), PipelineError> {
        let Some(t) = burst.temperature_c.filter(|t| t.is_finite()) else { return Ok(()) };
        if judge.model.temperature_response.is_some() {
            return Ok(());
        }
        let off = judge.model.temperature_c.map_or(0.0, |reference| (t - reference).abs());
        if let Some(seen) = self.by_printhead.get_mut(&burst.printhead) {
            seen.least = seen.least.min(t);
            seen.most = seen.most.max(t);
            seen.farthest = seen.farthest.max(off);
        } else if self.by_printhead.len() < MOST_PRINTHEADS {
            let seen = Seen { least: t, most: t, farthest: off };
            self.by_printhead.insert(burst.printhead.clone(), seen);
        }
        if self.may_learn && off > HARMLESS_K {
            return Err(PipelineError::NeedsTemperature);
        }
        Ok(())
    }

    /// Whether it should be learned, if it can be.
    pub fn asks(&self) -> bool {
        self.by_printhead.values().any(|seen| seen.farthest > HARMLESS_K)
    }

    /// Printhead and what to know about it.
    pub fn warnings(&self) -> Vec<(Arc<str>, String)> {
        let says = |seen: &Seen| {
            format!(
                "judged at {:.1} to {:.1} °C by models that do not know what temperature does, \
                 and this recording does not tell: expect false alarms",
                seen.least, seen.most
            )
        };
        let matters = |seen: &Seen| seen.farthest.max(0.5 * (seen.most - seen.least)) > HARMLESS_K;
        let of = self.by_printhead.iter().filter(|(_, seen)| matters(seen));
        of.map(|(name, seen)| (name.clone(), says(seen))).collect()
    }
}
