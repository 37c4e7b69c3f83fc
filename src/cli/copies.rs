//! Finds verdict tables of the same recording, so that a report and a score count its verdicts once.
//!
//! In: the tables of a report or score, each with its metadata. Out: which of them are left out
//! ([`left_out`]). Two tables are of the same recording if their metadata have the same digest of
//! the recording. Another file of the same bursts (compressed otherwise, say) has another digest
//! and counts; of such files a report says that they overlap in time.

use inkling_io::stored;
use inkling_io::verdict_reader::document_of;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;

#[derive(Clone, Copy)]
pub struct Table<'a> {
    pub path: &'a Path,
    pub document: &'a Value,
}

/// For each table, in their order: `None` if it stays, or the sentence to say if it is left out
/// because another table is of the same recording. Of such tables one that can be read stays. Where they were judged
/// by another design or other settings, one by a design stays, and of these the newest; else the one with the most
/// judged signals, and of equal ones the oldest: earlier nights were told by its name.
pub fn left_out(tables: &[Table]) -> Vec<Option<String>> {
    let is_readable = |table: &Table| document_of(table.path).is_ok();
    let made_ns =
        |table: &Table| stored::stamp(table.path).ok().and_then(|stamp| stamp.modified_ns);
    let judged = |table: &Table| table.document["counts"]["judged"].as_u64().unwrap_or_default();
    let has_design = |table: &Table| table.document["has_design"] == true;
    let is_better = |this: &Table, that: &Table| {
        let by_age = match this.document["by"] == that.document["by"] {
            true => judged(this).cmp(&judged(that)).then(made_ns(that).cmp(&made_ns(this))),
            false => (has_design(this), made_ns(this)).cmp(&(has_design(that), made_ns(that))),
        };
        is_readable(this).cmp(&is_readable(that)).then(by_age).is_gt()
    };
    // of each recording the table that stays
    let mut stays: BTreeMap<&str, &Table> = BTreeMap::new();
    for table in tables {
        let Some(digest) = digest(table) else { continue };
        let kept = stays.entry(digest).or_insert(table);
        if !std::ptr::eq(*kept, table) && is_better(table, kept) {
            *kept = table;
        }
    }
    let note = |table: &Table| {
        let kept = stays[digest(table)?];
        let (file, kept_file) = (table.path.display(), kept.path.display());
        let what = "verdicts of a recording that is there already";
        (!std::ptr::eq(kept, table)).then(|| format!("{file}: {what} ({kept_file}): left out"))
    };
    tables.iter().map(note).collect()
}

/// The digest of a table's recording, as its metadata have it.
fn digest<'a>(table: &Table<'a>) -> Option<&'a str> {
    table.document["recording"]["digest"].as_str()
}
