//! A recording that a report is of.

use serde_json::Value;

/// A recording, as its summary (or else its verdicts' metadata) tells of it.
#[derive(Clone, Debug, Default)]
pub struct Source {
    /// Below what was named.
    pub name: String,
    /// The contract's document; null: there is none.
    pub document: Value,
    /// What is missing beside the verdicts: `episodes`, `summary`.
    pub missing: Vec<&'static str>,
}

/// A recording that has no verdicts.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct LostRecording {
    pub name: String,
    /// Why there are none.
    pub why: String,
}
