//! Reads a scenario. In: the text of a TOML file. Out: a checked [`Scenario`], or a [`ScenarioError`] that
//! names the key. The steps: read version and kind; deserialise the rest (which refuses unknown keys); check all
//! values (`checks.rs`).

use super::{Classes, Kind, Physics, SCHEMA, Scenario, ScenarioError, checks};
use serde::Deserialize;
use std::sync::Arc;

impl Scenario {
    /// Reads and checks a scenario (steps in the file's doc). `text`: the TOML file's contents.
    pub fn from_toml(text: &str) -> Result<Scenario, ScenarioError> {
        // version and kind first, since they decide how the rest is read
        #[derive(Deserialize)]
        struct Head {
            schema: Option<toml::Value>,
            kind: Option<String>,
        }
        let head: Head = toml::from_str(text)?;
        if head.schema.as_ref().and_then(toml::Value::as_integer) != Some(SCHEMA) {
            let found = head.schema.map_or_else(|| "missing".to_owned(), |found| found.to_string());
            return Err(ScenarioError::Schema { found });
        }
        let scenario = match head.kind.as_deref().unwrap_or("physics") {
            "physics" => {
                let physics: Physics = toml::from_str(text)?;
                Scenario {
                    seed: physics.seed,
                    recording: physics.recording.clone(),
                    kind: Kind::Physics(Arc::new(physics)),
                }
            }
            "classes" => {
                let classes: Classes = toml::from_str(text)?;
                Scenario {
                    seed: classes.seed,
                    recording: classes.recording.clone(),
                    kind: Kind::Classes(Arc::new(classes)),
                }
            }
            other => {
                let why = format!("{other:?} is neither \"physics\" nor \"classes\"");
                return Err(ScenarioError::value("kind", why));
            }
        };
        checks::check(&scenario)?;
        Ok(scenario)
    }
}
