//! What a report needs of the verdicts of a recording, kept beside them: `.<stem>.counts`. Reading the verdicts of a
//! year again on each night would take longer than the night's own work; the counts take as long as there are
//! recordings.
//!
//! In: [`RecordingCounts`] from `results`. Out: the same on a later run, as long as the verdicts, the episodes and the
//! times that were put right are those of then ([`Key`]). Nothing else rests on these files: one that is missing, is
//! damaged or cannot be written costs time alone, so nothing is told of it.

use crate::report::RecordingCounts;
use inkling_core::episodes::Episode;
use inkling_io::digest::of_bytes;
use inkling_io::objects::in_object_store;
use inkling_io::{part_file, regular_file, stored};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// To be raised whenever verdicts would be counted otherwise.
const VERSION: u32 = 1;
/// Most bytes that are read.
const MOST_BYTES: u64 = 256 << 20;

/// What counts are of.
pub struct Key {
    path: PathBuf,
    digest: String,
}

impl Key {
    /// `verdicts`: the table; `document`: the recording's summary. `None` where no counts are kept: in object stores.
    pub fn of(verdicts: &Path, episodes: &[Episode], document: &Value) -> Option<Key> {
        if in_object_store(verdicts) {
            return None;
        }
        let stamp = stored::stamp(verdicts).ok()?;
        let times = &document["wrong_times"];
        let all = json!([VERSION, stamp.bytes, stamp.modified_ns?, episodes, times]);
        let name = verdicts.file_name()?.to_string_lossy();
        let stem = name.strip_suffix(".verdicts.parquet").unwrap_or(&name);
        let path = verdicts.with_file_name(format!(".{stem}.counts"));
        Some(Key { path, digest: of_bytes(all.to_string().as_bytes()) })
    }

    /// The counts that are kept; `None`: there are none, or none with maps where these are wanted.
    pub fn read(&self, with_maps: bool) -> Option<RecordingCounts> {
        let text = regular_file::read_text(&self.path, MOST_BYTES).ok()?;
        let (head, counts) = text.split_once('\n')?;
        if head != self.head(counts) {
            return None;
        }
        let counts: RecordingCounts = serde_json::from_str(counts).ok()?;
        (counts.has_maps || !with_maps).then_some(counts)
    }

    pub fn keep(&self, counts: &RecordingCounts) {
        let Ok(counts) = serde_json::to_string(counts) else { return };
        let text = format!("{}\n{counts}", self.head(&counts));
        let _ = part_file::write(&self.path, text.as_bytes()); // as above
    }

    /// The first line: what the counts are of, and their own digest.
    fn head(&self, counts: &str) -> String {
        format!("inkling counts {} {}", self.digest, of_bytes(counts.as_bytes()))
    }
}
