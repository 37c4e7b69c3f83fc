//! Settings of fault detection: `pipeline.toml` section `[detect]`, with its defaults and the check
//! of its values. `pipeline.toml` explains each key to users.

use crate::ranges::{check, check_between};
use serde::{Deserialize, Serialize};

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DetectMethod {
    /// The distance along the model's sensitivities, and what lies beside the ring.
    #[default]
    Sensitivity,
    /// The energy of the FD filter's residual, thesis e(r).
    ResidualEnergy,
    /// The largest absolute sample of that residual, thesis §3-2.
    ResidualMaximum,
}

/// How the threshold is learned from signals that are all known to be healthy.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ThresholdMethod {
    /// As the tail quantile at `false_alarm_rate`, which holds with `confidence`.
    #[default]
    Quantile,
    /// As in thesis (3-4): mu * max(e_h).
    Max,
}

/// Denominator of the FD filter, thesis §3-2-1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Denominator {
    /// Method I: a marginally stable pair at the healthy resonance, or at `oscillations`.
    #[default]
    Resonance,
    /// Method II: the eigenvalues of the identified model of the class `fault`.
    Eigenvalues,
    /// Method III: numerator enhancement, for the class `fault` ([`super::numerator`]).
    Enhanced,
    /// (3-3b) as a linear programme ([`super::linear_programme`]) for the class `fault`.
    Lp,
}

/// n_o, in periods of the healthy ring, that reproduces the misses of the thesis's Table 4-1.
pub const THESIS_OSCILLATIONS_OF_RING: f64 = 1.12;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DetectSettings {
    pub method: DetectMethod,
    pub threshold: ThresholdMethod,
    /// Share of healthy signals that may be flagged, for `quantile` and for windows.
    pub false_alarm_rate: f64,
    /// Probability, over the sampling of channels, that the realised rate stays below that.
    pub confidence: f64,
    pub mu: f64,
    pub denominator: Denominator,
    /// The fault class that all denominators but `resonance` are made for.
    pub fault: String,
    /// Oscillations n_o within a signal, for method I's pair; absent: by `oscillations_of_ring`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub oscillations: Option<f64>,
    /// n_o in periods of the healthy ring, that is n_o over f0 T; absent: 1, at the resonance.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub oscillations_of_ring: Option<f64>,
    /// The other poles of method I, 1/s, as positive numbers p for poles at -p. Together with the
    /// pair they fix the filter's degree, with every method.
    pub other_poles_per_s: Vec<f64>,
}

impl Default for DetectSettings {
    fn default() -> Self {
        DetectSettings {
            method: DetectMethod::Sensitivity,
            threshold: ThresholdMethod::Quantile,
            false_alarm_rate: 7e-4,
            confidence: 0.95,
            mu: 1.0,
            denominator: Denominator::Resonance,
            fault: "SDN".into(),
            oscillations: None,
            oscillations_of_ring: None,
            other_poles_per_s: vec![2e5, 2e5],
        }
    }
}

impl DetectSettings {
    pub fn check(&self) -> Result<(), String> {
        let open = |key: &str, v: f64, below: f64| check_between(key, v, 0.0, below);
        open("false_alarm_rate", self.false_alarm_rate, 0.25)?;
        check("confidence", self.confidence, 0.5..=0.999, "0.5 to 0.999")?;
        open("mu", self.mu, 1e6)?;
        open("oscillations", self.oscillations.unwrap_or(1.0), 1e6)?;
        open("oscillations_of_ring", self.oscillations_of_ring.unwrap_or(1.0), 1e3)?;
        if self.oscillations.is_some() && self.oscillations_of_ring.is_some() {
            return Err("oscillations beside oscillations_of_ring: both say n_o; give one".into());
        }
        if !(1..=8).contains(&self.other_poles_per_s.len()) {
            let n = self.other_poles_per_s.len();
            return Err(format!(
                "other_poles_per_s has {n} poles: give 1 to 8 (the observable order is 3, \
                 the marginal pair counts two)"
            ));
        }
        self.other_poles_per_s.iter().try_for_each(|&p| open("other_poles_per_s", p, 1e12))
    }
}
