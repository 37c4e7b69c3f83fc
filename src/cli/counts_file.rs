//! What a report needs of the verdicts of a recording, kept beside its summary: `.<stem>.counts`. Reading the verdicts of a
//! year again on each night would take longer than the night's own work; the counts take as long as there are
//! recordings.
//!
//! In: [`RecordingCounts`] from `results`. Out: the same on a later run, as long as the verdicts, the episodes and the
//! times that were put right are those of then ([`Key`]). Nothing else rests on these files: one that is missing or
//! damaged costs time alone, so nothing is told of it. One that cannot be written is an error as of any result: a
//! later run then leaves the same files as an undisturbed one.

use crate::report::RecordingCounts;
use inkling_core::episodes::Episode;
use inkling_io::digest::of_bytes;
use inkling_io::file_error::FileError;
use inkling_io::objects::in_object_store;
use inkling_io::{parquet_file, part_file, regular_file, stored, summary_file};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// To be raised whenever verdicts would be counted otherwise within one version of inkling.
const VERSION: u32 = 3;
/// Most bytes that are read.
const MOST_BYTES: u64 = 256 << 20;

/// What counts are of.
pub struct Key {
    path: PathBuf,
    digest: String,
}

impl Key {
    /// `verdicts`: the table; `document`: the recording's summary. `None` where no counts are kept: in object stores.
    pub fn of(
        verdicts: &Path,
        episodes: &[Episode],
        document: &Value,
    ) -> Result<Option<Key>, FileError> {
        if in_object_store(verdicts) {
            return Ok(None);
        }
        // a table that was written anew with other values has another footer; the time of its last change says less,
        // since a copy has another one
        let footer = regular_file::open(verdicts)
            .and_then(|table| parquet_file::footer(&table, MOST_BYTES))
            .map_err(FileError::unread(verdicts))?;
        let times = &document["wrong_times"];
        let all = json!([
            env!("CARGO_PKG_VERSION"),
            VERSION,
            stored::bytes(verdicts),
            of_bytes(&footer),
            episodes,
            times
        ]);
        // beside the summary: a directory of tables that is read as one data set holds nothing else
        let summary = summary_file::path_beside(verdicts);
        let name = summary.file_name().unwrap_or_default().to_string_lossy();
        let stem = name.strip_suffix(".summary.json").unwrap_or(&name);
        let path = summary.with_file_name(format!(".{stem}.counts"));
        Ok(Some(Key { path, digest: of_bytes(all.to_string().as_bytes()) }))
    }

    /// The counts that are kept; `None`: there are none.
    pub fn read(&self) -> Option<RecordingCounts> {
        let text = regular_file::read_text(&self.path, MOST_BYTES).ok()?;
        let (head, counts) = text.split_once('\n')?;
        if head != self.head(counts) {
            return None;
        }
        serde_json::from_str(counts).ok()
    }

    pub fn keep(&self, counts: &RecordingCounts) -> Result<(), FileError> {
        let failed = FileError::unwritten(&self.path);
        let counts = match serde_json::to_string(counts) {
            Ok(counts) => counts,
            Err(e) => return Err(failed(e.into())),
        };
        let text = format!("{}\n{counts}", self.head(&counts));
        part_file::write(&self.path, text.as_bytes()).map_err(failed)
    }

    /// The first line: what the counts are of, and their own digest.
    fn head(&self, counts: &str) -> String {
        format!("inkling counts {} {}", self.digest, of_bytes(counts.as_bytes()))
    }
}
