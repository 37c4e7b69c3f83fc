//! Settings of evidence over time: `pipeline.toml` section `[episodes]`.

use serde::{Deserialize, Serialize};

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct EpisodeSettings {
    /// Episodes without a fault per million healthy signals, that the evidence must rule out.
    pub false_per_million: f64,
    /// Signals of a printhead that wait for earlier ones, at most.
    pub reorder_signals: usize,
}

impl Default for EpisodeSettings {
    fn default() -> Self {
        EpisodeSettings { false_per_million: 0.1, reorder_signals: 65_536 }
    }
}

impl EpisodeSettings {
    /// Says which key is wrong, if one is.
    pub fn check(&self) -> Result<(), String> {
        if !(1e-6..=1e4).contains(&self.false_per_million) {
            return Err(format!(
                "false_per_million = {:?}: must lie between 1e-6 and 1e4",
                self.false_per_million
            ));
        }
        if !(1..=1 << 24).contains(&self.reorder_signals) {
            let most = 1 << 24;
            return Err(format!("reorder_signals = {}: give 1 to {most}", self.reorder_signals));
        }
        Ok(())
    }

    /// ln of the likelihood ratio that raises an episode: a CUSUM of it exceeds h on healthy signals
    /// at most every e^h-th time (Lorden 1971).
    pub fn evidence_bound(&self) -> f64 {
        (1e6 / self.false_per_million).ln()
    }
}
