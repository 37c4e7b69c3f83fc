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

/// A recording that has no verdicts.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct LostRecording {
    pub name: String,
    /// Why there are no verdicts.
    pub why: String,
}
