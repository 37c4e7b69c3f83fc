//! The section `[episodes]` of `pipeline.toml`: its defaults and its checks.

use crate::ranges::check;
use serde::{Deserialize, Serialize};

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct EpisodeSettings {
    /// How many episodes without a fault a million healthy signals may give at most.
    pub false_per_million: f64,
    /// At most so many signals of a printhead wait for earlier ones.
    pub reorder_signals: usize,
}

impl Default for EpisodeSettings {
    fn default() -> Self {
        EpisodeSettings { false_per_million: 0.1, reorder_signals: 65_536 }
    }
}

impl EpisodeSettings {
    pub fn check(&self) -> Result<(), String> {
        check("false_per_million", self.false_per_million, 1e-6..=1e4, "1e-6 to 1e4")?;
        let most = 1 << 24;
        check("reorder_signals", self.reorder_signals, 1..=most, &format!("1 to {most}"))
    }

    /// The bound h on the evidence, ln of a likelihood ratio: on healthy signals a CUSUM of log
    /// likelihood ratios reaches h at most once in e^h signals on average (Lorden 1971).
    pub fn evidence_bound(&self) -> f64 {
        (1e6 / self.false_per_million).ln()
    }
}
