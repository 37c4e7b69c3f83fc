//! The recordings that a report covers: those with verdicts, and those that have none.
//! `cli/results.rs` makes both from what lies in the directories that the user named.

use super::acknowledged;
use super::words::thousands;
use serde_json::Value;

/// Most characters of the text about a recording's damage or loss.
pub const MOST_OF_DAMAGE: usize = 200;

/// A recording with verdicts, as described by its summary, or by the metadata of its verdicts if it has none.
#[derive(Clone, Debug, Default)]
pub struct Source {
    /// Path of the recording, relative to what the user named.
    pub name: String,
    /// The summary's JSON document; null if there is none.
    pub document: Value,
    /// The note of whoever acknowledged that its damage is known.
    pub known: Option<String>,
    /// Files that are missing beside the verdicts: `episodes`, `summary`.
    pub missing: Vec<&'static str>,
}

impl Source {
    /// Number of places where the recording is damaged.
    pub fn damaged_places(&self) -> u64 {
        self.document["damage"]["places"].as_u64().unwrap_or(0)
    }

    /// Whether nothing of the recording is damaged, unread or missing.
    pub fn is_whole(&self) -> bool {
        let tells_of = |key: &str| self.document[key].as_array().is_some_and(|of| !of.is_empty());
        self.flaws().is_empty() && !tells_of("not_judged") && !tells_of("unread")
    }

    pub fn has_episodes(&self) -> bool {
        !self.missing.contains(&"episodes")
    }

    /// What is wrong with the data of the recording, in words; empty if nothing is.
    pub fn flaws(&self) -> String {
        let counts = &self.document["counts"];
        let rejected = counts["rejected"].as_object().into_iter().flatten();
        let rejected =
            rejected.filter_map(|(why, n)| Some(format!("{} {why}", thousands(n.as_u64()?))));
        let mut parts: Vec<String> = rejected.collect();
        if let Some((expected, found)) =
            self.document["expected"].as_u64().zip(counts["bursts"].as_u64())
            && expected > found
        {
            parts.push(format!("{} of {} bursts found", thousands(found), thousands(expected)));
        }
        let first = self.document["damage"]["first"].as_str().unwrap_or_default();
        let first: String = first.chars().take(MOST_OF_DAMAGE).collect();
        match self.damaged_places() {
            0 => {}
            1 => parts.push(format!("damaged: {first}")),
            n => parts.push(format!("damaged in {} places: {first}", thousands(n))),
        }
        parts.extend(self.missing.iter().map(|what| format!("no {what} file")));
        let known = self.known.as_deref().filter(|_| !parts.is_empty());
        parts.extend(known.map(acknowledged::in_words));
        parts.join("; ")
    }
}

/// A recording that has no verdicts.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct LostRecording {
    pub name: String,
    /// Why there are no verdicts.
    pub why: String,
    /// Whether somebody has acknowledged it, so that it is no news.
    #[serde(skip)]
    pub known: bool,
}

impl LostRecording {
    /// A loss that nobody has acknowledged.
    pub fn new(name: impl Into<String>, why: impl Into<String>) -> LostRecording {
        LostRecording { name: name.into(), why: why.into(), known: false }
    }
}
