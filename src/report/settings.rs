//! What a report says to do, and how nozzles lie: `pipeline.toml` section `[report]`.

use serde::{Deserialize, Deserializer, Serialize};
use std::collections::{BTreeMap, BTreeSet};

/// Rows of nozzles that a printhead may have.
const MOST_ROWS: u32 = 256;
/// Letters of an action.
const LONGEST_ACTION: usize = 200;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ReportSettings {
    /// Rows of nozzles: channel c lies in row c mod `rows`, at place c / `rows` of it.
    pub rows: u32,
    /// From a nozzle to the next of its row, µm; 0: not known.
    pub pitch: f64,
    /// What to do, by category; where none is certain, by reason.
    #[serde(deserialize_with = "over_defaults")]
    pub actions: BTreeMap<String, String>,
}

impl Default for ReportSettings {
    fn default() -> ReportSettings {
        ReportSettings { rows: 1, pitch: 0.0, actions: default_actions() }
    }
}

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

/// What is not written keeps its default.
fn over_defaults<'de, D: Deserializer<'de>>(d: D) -> Result<BTreeMap<String, String>, D::Error> {
    let mut actions = default_actions();
    actions.extend(BTreeMap::<String, String>::deserialize(d)?);
    Ok(actions)
}

impl ReportSettings {
    /// Says which key is wrong, if one is.
    pub fn check(&self) -> Result<(), String> {
        if !(1..=MOST_ROWS).contains(&self.rows) {
            return Err(format!("rows = {}: give 1 to {MOST_ROWS}", self.rows));
        }
        if !(0.0..=1e6).contains(&self.pitch) {
            return Err(format!(
                "pitch = {:?}: give micrometres, 0 (not known) to 1e6",
                self.pitch
            ));
        }
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

    /// Says which action is of no category and no reason, if one is. `own`: categories of one's own.
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

    /// `key`: a category or a reason; a category of one's own without an action is inspected.
    pub fn action(&self, key: &str) -> &str {
        self.actions.get(key).or(self.actions.get("uncertain")).map_or("inspect", String::as_str)
    }
}
