//! Manages the parts of the verdict table of a recording that is still being written (`replay
//! --follow --rotate`): where they lie, whose they are, and their removal. The tables themselves
//! are written by `verdict_table.rs`. Parts are provisional: each is a table by itself, for tools
//! that read while the recording grows, and is removed when the whole table has its name.
//!
//! In: where the whole table will be, and of which recording. Out: paths
//! `<stem>.parts/00001.parquet`, `00002.parquet` and so on. Parts are not called
//! `*.verdicts.parquet`, so that whoever searches for tables meets no row twice. A part says in its
//! metadata how its recording begins ([`Beginning`]); a file that does not say so of the recording
//! at hand belongs to somebody else, and stays.

use super::objects::in_object_store;
use super::recording::Recording;
use super::{digest, part_file, stored, verdict_reader};
use serde::{Deserialize, Serialize};
use std::fs;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

/// Key in the metadata of a part that tells it from a whole table.
pub const PART_KEY: &str = "part";
/// Most bytes at the beginning of a recording by which it is told from others.
const MOST_BEGINNING_BYTES: u64 = 1 << 20;

/// How a recording begins. While it grows it has no digest of the whole, but its first bytes stay the same.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Beginning {
    pub bytes: u64,
    pub digest: String,
}

impl Beginning {
    pub fn of(recording: &Recording) -> io::Result<Beginning> {
        Beginning::read(recording, recording.source.bytes().min(MOST_BEGINNING_BYTES))
    }

    fn read(recording: &Recording, bytes: u64) -> io::Result<Beginning> {
        let mut first = vec![0; bytes as usize];
        recording.source.read_at(0, &mut first)?;
        Ok(Beginning { bytes, digest: digest::of_bytes(&first) })
    }

    fn is_of(&self, recording: &Recording) -> io::Result<bool> {
        // the size of the file now counts, as a part may have seen more than the recording at hand
        let there = recording.source.stamp()?.bytes.min(MOST_BEGINNING_BYTES);
        Ok(self.bytes <= there && Beginning::read(recording, self.bytes)? == *self)
    }
}

#[derive(Clone, Debug)]
pub struct PartTables {
    pub dir: PathBuf,
}

impl PartTables {
    pub fn beside(verdicts: &Path) -> PartTables {
        PartTables { dir: stored::beside(verdicts, "parts") }
    }

    /// The path of a part; parts are numbered from 1 on.
    pub fn path(&self, number: u32) -> PathBuf {
        self.dir.join(format!("{number:05}.parquet"))
    }

    /// Removes the parts of this recording, the unfinished files that killed runs left behind, and
    /// the directory if nothing else is in it.
    pub fn remove_of(&self, recording: &Recording) -> io::Result<Option<PathBuf>> {
        if in_object_store(&self.dir) {
            return Ok(None); // parts are never written to a store
        }
        let entries = match fs::read_dir(&self.dir) {
            Err(e) if matches!(e.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => {
                return Ok(None);
            }
            entries => entries?,
        };
        let mut names = entries.map(|e| Ok(e?.file_name())).collect::<io::Result<Vec<_>>>()?;
        names.sort_unstable();
        let mut removed = part_file::sweep(&self.dir, is_name);
        let mut others = Vec::new();
        for name in names.iter().filter(|name| is_name(&name.to_string_lossy())) {
            let path = self.dir.join(name);
            match is_part_of(&path, recording)? {
                true => {
                    stored::remove(&path)?;
                    removed += 1;
                }
                false => others.push(path),
            }
        }
        if removed > 0 {
            self.remove_empty();
        }
        Ok(others.into_iter().next())
    }

    /// Removes the directory, unless something is in it.
    pub fn remove_empty(&self) {
        let _ = fs::remove_dir(&self.dir); // fails if something is in it, as it should
    }
}

fn is_name(name: &str) -> bool {
    let number = name.strip_suffix(".parquet").unwrap_or_default();
    number.len() >= 5 && number.bytes().all(|b| b.is_ascii_digit())
}

fn is_part_of(path: &Path, recording: &Recording) -> io::Result<bool> {
    if !fs::symlink_metadata(path)?.is_file() {
        return Ok(false); // parts are no links
    }
    let document = verdict_reader::document_of(path);
    let begins = Beginning::deserialize(&document["recording"]["begins"]);
    match begins {
        Ok(begins) if document[PART_KEY].is_object() => begins.is_of(recording),
        _ => Ok(false),
    }
}
