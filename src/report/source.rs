//! The recordings that a report covers: those with verdicts, and those that have none.
//! `cli/results.rs` makes both from what lies in the directories that the user named.

use serde_json::Value;

/// A recording with verdicts, as described by its summary, or by the metadata of its verdicts if it has none.
#[derive(Clone, Debug, Default)]
pub struct Source {
    /// Path of the recording, relative to what the user named.
    pub name: String,
    /// The summary's JSON document; null if there is none.
    pub document: Value,
    /// Files that are missing beside the verdicts: `episodes`, `summary`.
    pub missing: Vec<&'static str>,
}

impl Source {
    /// Number of places where the recording is damaged.
    pub fn damaged_places(&self) -> u64 {
        self.document["damage"]["places"].as_u64().unwrap_or(0)
    }

    pub fn has_episodes(&self) -> bool {
        !self.missing.contains(&"episodes")
    }
}

/// A recording that has no verdicts.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct LostRecording {
    pub name: String,
    /// Why there are no verdicts.
    pub why: String,
}
