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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_cannot_be_is_refused_by_its_key() {
        let with = |false_per_million, reorder_signals| {
            EpisodeSettings { false_per_million, reorder_signals }.check()
        };
        assert_eq!(EpisodeSettings::default().check(), Ok(()));
        assert_eq!(with(1e4, 1).and(with(1e-6, 1 << 24)), Ok(()));
        for rate in [0.0, 1.1e4, f64::NAN] {
            assert!(with(rate, 1).unwrap_err().contains("false_per_million"));
        }
        for signals in [0, (1 << 24) + 1] {
            assert!(with(0.1, signals).unwrap_err().contains("reorder_signals"));
        }
    }

    #[test]
    fn a_thousandth_of_the_rate_asks_for_a_thousand_times_the_likelihood_ratio() {
        let bound =
            |rate| EpisodeSettings { false_per_million: rate, reorder_signals: 1 }.evidence_bound();
        assert!((bound(1e6)).abs() < 1e-12);
        assert!((bound(1e-3) - bound(1.0) - 1000f64.ln()).abs() < 1e-9);
    }
}
