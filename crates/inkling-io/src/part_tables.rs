//! Parts of the verdict table of a recording that is being written: provisional, each a table by itself, until the
//! table has its name.
//!
//! In: where the table will be, and of which recording. Out: `<stem>.parts/00001.parquet`, `00002.parquet`, ...: not
//! called `*.verdicts.parquet`, so that whoever searches for tables meets no row twice. A part says in its metadata
//! how its recording begins; what does not say so of the recording at hand is somebody else's, and stays.

use super::objects::in_object_store;
use super::recording::Recording;
use super::{digest, part_file, stored, verdict_reader};
use serde::{Deserialize, Serialize};
use std::fs;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

/// What a part's metadata have under this key tells it from a table.
pub const PART_KEY: &str = "part";
/// What of a recording tells it from others.
const MOST_BEGINNING_BYTES: u64 = 1 << 20;

/// How a recording begins: while it grows it has no digest, but its first bytes stay.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Beginning {
    pub bytes: u64,
    /// Of these bytes.
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
        // of a recording that was cut off what is whole counts; a part may have seen more of the file
        let there = recording.source.stamp()?.bytes.min(MOST_BEGINNING_BYTES);
        Ok(self.bytes <= there && Beginning::read(recording, self.bytes)? == *self)
    }
}

/// Where the parts of a recording's table are.
#[derive(Clone, Debug)]
pub struct PartTables {
    pub dir: PathBuf,
}

impl PartTables {
    /// `<stem>.verdicts.parquet` -> `<stem>.parts/`
    pub fn beside(verdicts: &Path) -> PartTables {
        PartTables { dir: stored::beside(verdicts, "parts") }
    }

    /// Parts are numbered from 1 on.
    pub fn path(&self, number: u32) -> PathBuf {
        self.dir.join(format!("{number:05}.parquet"))
    }

    /// Removes those of this recording, what killed runs left unfinished of any, and the directory if nothing
    /// else is in it. Whatever else has a part's name stays: the first of these.
    pub fn remove_of(&self, recording: &Recording) -> io::Result<Option<PathBuf>> {
        if in_object_store(&self.dir) {
            return Ok(None); // none are written there
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

    /// The directory, unless something is in it.
    pub fn remove_empty(&self) {
        let _ = fs::remove_dir(&self.dir); // what is in it keeps it
    }
}

/// `00001.parquet`
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
