//! In: TOML. Out: a checked [`Scenario`].

use super::{Classes, Kind, Physics, PhysicsFile, SCHEMA, Scenario, ScenarioError, checks};
use serde::Deserialize;
use std::sync::Arc;

impl Scenario {
    /// Reads and checks a scenario.
    pub fn from_toml(text: &str) -> Result<Scenario, ScenarioError> {
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
            "physics" => Scenario::from_physics(toml::from_str(text)?)?,
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
                return Err(ScenarioError::Value { key: "kind".to_owned(), why });
            }
        };
        checks::check(&scenario)?;
        Ok(scenario)
    }

    fn from_physics(file: PhysicsFile) -> Result<Scenario, ScenarioError> {
        let channel = match (file.channel, file.geometry) {
            (Some(channel), None) => channel,
            (None, Some(geometry)) => geometry.ink_channel(),
            _ => {
                let why = "give either [channel] or [geometry], one of them".to_owned();
                return Err(ScenarioError::Value { key: "channel".to_owned(), why });
            }
        };
        let physics = Physics {
            channel,
            spread: file.spread,
            shot: file.shot,
            acquisition: file.acquisition,
            temperature: file.temperature,
            drive: file.drive,
            fault: file.fault,
            dataset: file.dataset,
            print_run: file.print_run,
            hidden: file.hidden,
        };
        let kind = Kind::Physics(Arc::new(physics));
        Ok(Scenario { seed: file.seed, recording: file.recording, kind })
    }
}
