//! The section `[report]` of `pipeline.toml`: what to do for each category of fault. `fault` asks for
//! the action.

use serde::{Deserialize, Deserializer, Serialize};
use std::collections::{BTreeMap, BTreeSet};

/// Most characters of an action.
const LONGEST_ACTION: usize = 200;

/// The settings of the report.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ReportSettings {
    /// What to do, by category of the fault, or by reason if no category is certain.
    #[serde(deserialize_with = "over_defaults")]
    pub actions: BTreeMap<String, String>,
}

impl Default for ReportSettings {
    fn default() -> ReportSettings {
        ReportSettings { actions: default_actions() }
    }
}

/// The actions unless the user sets others.
fn default_actions() -> BTreeMap<String, String> {
    [
        ("dried_nozzle", "pre-fire"),
        ("blocked_nozzle", "wipe"),
        ("air_bubble", "purge"),
        ("empty_channel", "refill"),
        ("no_ring", "check the cable"),
        ("unknown_fault", "inspect"),
        ("uncertain", "inspect"),
    ]
    .map(|(of, what)| (of.to_owned(), what.to_owned()))
    .into()
}

/// Reads the actions that are given; all others keep their defaults.
fn over_defaults<'de, D: Deserializer<'de>>(d: D) -> Result<BTreeMap<String, String>, D::Error> {
    let mut actions = default_actions();
    actions.extend(BTreeMap::<String, String>::deserialize(d)?);
    Ok(actions)
}

impl ReportSettings {
    /// Checks the length of each action; the error names the key that is wrong.
    pub fn check(&self) -> Result<(), String> {
        for (of, action) in &self.actions {
            let letters = action.chars().count();
            if action.trim().is_empty() || letters > LONGEST_ACTION {
                return Err(format!(
                    "actions.{of}: say what to do, in 1 to {LONGEST_ACTION} letters"
                ));
            }
        }
        Ok(())
    }

    /// Checks that each action belongs to a category or a reason. `own`: categories of own classes.
    pub fn check_actions<'a>(&self, own: impl IntoIterator<Item = &'a str>) -> Result<(), String> {
        let mut known: BTreeSet<String> = default_actions().into_keys().collect();
        known.extend(own.into_iter().map(str::to_owned));
        match self.actions.keys().find(|key| !known.contains(*key)) {
            None => Ok(()),
            Some(unknown) => Err(format!(
                "report.actions.{unknown}: no category and no reason of that name; there are {}",
                known.into_iter().collect::<Vec<_>>().join(", ")
            )),
        }
    }

    /// The action for a category or a reason, or else that of `uncertain`.
    pub fn action(&self, key: &str) -> &str {
        self.actions.get(key).or(self.actions.get("uncertain")).map_or("inspect", String::as_str)
    }
}
