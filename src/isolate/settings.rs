//! Settings of fault isolation: `pipeline.toml` section `[isolate]`.

use serde::{Deserialize, Serialize};

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum IsolateMethod {
    /// Thesis §3-3-2: mixture weights phi on the simplex of mean residuals.
    #[default]
    ResidualMatching,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct IsolateSettings {
    pub method: IsolateMethod,
    /// Isolate only what passed the detection; false: every signal, as thesis Tables 4-3ff.
    pub gate: bool,
    /// Least weight of the named class (or category).
    pub certainty: f64,
}

impl Default for IsolateSettings {
    fn default() -> Self {
        IsolateSettings { method: IsolateMethod::ResidualMatching, gate: true, certainty: 0.8 }
    }
}

impl IsolateSettings {
    /// Says which key is wrong, if one is.
    pub fn check(&self) -> Result<(), String> {
        if (0.0..=1.0).contains(&self.certainty) {
            Ok(())
        } else {
            Err(format!("certainty = {}: must lie between 0 and 1", self.certainty))
        }
    }
}
