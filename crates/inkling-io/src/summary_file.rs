//! Reads a recording's summary for reports: `<stem>.summary.json` beside its verdicts, or else the
//! document in the metadata of the verdict table.
//!
//! In: a path. Out: JSON with the few keys that a report tells (`OF_RECORDING`, of each model
//! `OF_MODEL`, of the damage its number and first place), so that a report over thousands of
//! recordings fits into memory. The pipeline writes summaries (`src/pipeline/finish.rs`);
//! `schemas/summary.md` describes them.

use super::regular_file::{self, if_there};
use super::verdict_reader::document_of;
use super::verdict_table::TableError;
use super::{digest, printable, stored};
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};

/// The models of a long recording and all damage that a summary lists take less.
const MOST_BYTES: u64 = 64 << 20;
const OF_RECORDING: [&str; 10] = [
    "recording",
    "counts",
    "expected",
    "classes",
    "not_judged",
    "unread",
    "odd_times",
    "wrong_times",
    "head_changes",
    "moved_together",
];
const OF_MODEL: [&str; 4] = ["printhead", "valid_from", "temperature_c", "poles"];

/// The summary that belongs to a verdict table: `<stem>.verdicts.parquet` gives `<stem>.summary.json`.
pub fn path_beside(verdicts: &Path) -> PathBuf {
    stored::beside(verdicts, "summary.json")
}

pub fn read(path: &Path) -> Result<Option<Value>, String> {
    let failed = |what: String| format!("{}: {what}", path.display());
    let there = if_there(regular_file::read(path, MOST_BYTES));
    let bytes = there.map_err(|e| failed(format!("cannot be read: {e}")))?;
    let Some(bytes) = bytes else { return Ok(None) };
    let document: Value = serde_json::from_slice(&bytes)
        .map_err(|e| failed(format!("is no summary: {}", printable::of_parser(&e))))?;
    let not_an_object = || failed("is no summary: not an object".into());
    reported(document).map(Some).ok_or_else(not_an_object)
}

/// Null if there is no metadata document.
pub fn of_table(verdicts: &Path) -> Result<Value, TableError> {
    Ok(reported(document_of(verdicts)?).unwrap_or_default())
}

/// `None`: the document is no object.
fn reported(mut document: Value) -> Option<Value> {
    if !document.is_object() {
        return None;
    }
    let mut kept: Map<String, Value> =
        OF_RECORDING.iter().map(|key| ((*key).to_owned(), taken(&mut document, key))).collect();
    // by what it was judged, in short
    let by = json!([document["design"], document["settings"]]);
    kept.insert("by".into(), json!(digest::of_bytes(by.to_string().as_bytes())));
    kept.insert("has_design".into(), json!(document["design"].is_string()));
    kept.insert("settings".into(), json!({"detect": document["settings"]["detect"]}));
    let list = |document: &mut Value, key| match taken(document, key) {
        Value::Array(list) => list,
        _ => Vec::new(),
    };
    let damage = list(&mut document, "damage");
    let first = damage.first().map(|of| of["what"].clone());
    kept.insert("damage".into(), json!({"places": damage.len(), "first": first}));
    let model = |mut model: Value| {
        let of = OF_MODEL.map(|key| (key.to_owned(), taken(&mut model, key)));
        Value::Object(of.into_iter().collect())
    };
    let models = list(&mut document, "models").into_iter().filter(Value::is_object).map(model);
    kept.insert("models".into(), models.collect());
    Some(Value::Object(kept))
}

fn taken(of: &mut Value, key: &str) -> Value {
    of.get_mut(key).map(Value::take).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::assert_refused;

    #[test]
    fn what_is_told_stays_and_any_json_is_borne() {
        let whole = json!({"counts": {"bursts": 3}, "damage": [{"what": "x"}], "rates": [1],
            "models": [{"printhead": "p", "poles": {"frequency_hz": 1.0}, "covariance": [1]}, 3],
            "settings": {"detect": {"mu": 1.0}, "isolate": {}}});
        let kept = reported(whole).unwrap();
        assert_eq!(kept["counts"]["bursts"], 3);
        let model = json!({"printhead": "p", "valid_from": null,
            "temperature_c": null, "poles": {"frequency_hz": 1.0}});
        assert_eq!(kept["models"], json!([model]));
        assert_eq!(kept["damage"], json!({"places": 1, "first": "x"}));
        assert_eq!(kept["settings"], json!({"detect": {"mu": 1.0}}));
        assert!(kept.get("rates").is_none());
        for bad in [json!([1, 2]), json!(3), json!(null)] {
            assert_eq!(reported(bad), None);
        }
    }

    #[test]
    fn no_summary_is_none_and_a_damaged_one_an_error() {
        let dir = tempfile::tempdir().unwrap();
        let path = path_beside(&dir.path().join("a.verdicts.parquet"));
        assert!(path.ends_with("a.summary.json"));
        assert_eq!(read(&path), Ok(None));
        for wrong in ["{", "[]", "3", "null"] {
            std::fs::write(&path, wrong).unwrap();
            assert_refused(read(&path), &["is no summary"]);
        }
    }
}
