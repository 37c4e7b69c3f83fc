//! The lock of a directory of results: one run of `replay` at a time.
//!
//! The lock is the system's lock on an open file (`.inkling.lock`), so it ends with the process
//! that holds it, however that process ends. The file itself stays. Its first line says who held
//! the lock last; while a run is under way, the further lines say which recordings it is to judge
//! (one JSON object each). So a report of the results that a killed run left behind can say that
//! they are incomplete ([`unfinished`]).

use super::file_error::FileError;
use super::objects::in_object_store;
use super::{journal, regular_file};
use serde::{Deserialize, Serialize};
use std::fs::{File, TryLockError};
use std::io::{BufRead, BufReader, Read, Seek, Write};
use std::path::Path;

/// Name of the file in the directory of results.
pub const LOCK_NAME: &str = ".inkling.lock";
/// Most bytes of the file that are read; a million recordings take less.
const MOST_BYTES: u64 = 1 << 30;

#[derive(Debug)]
pub struct RunLock {
    /// The open file that is locked; `None` in an object store.
    file: Option<File>,
    /// The first line of the file: who holds the lock since when.
    said: String,
    /// Whether there is no lock, because the file system or the object store knows none: then a
    /// second run would not be noticed. The caller warns.
    pub blind: bool,
}

impl RunLock {
    /// Locks a directory, which is made if there is none.
    pub fn take(dir: &Path) -> Result<RunLock, FileError> {
        if in_object_store(dir) {
            return Ok(RunLock { file: None, said: String::new(), blind: true });
        }
        let path = dir.join(LOCK_NAME);
        std::fs::create_dir_all(dir).map_err(FileError::unwritten(dir))?;
        let mut file = File::options()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .open(&path)
            .map_err(FileError::unwritten(&path))?;
        let blind = match file.try_lock() {
            Ok(()) => false,
            Err(TryLockError::WouldBlock) => {
                let what = "writes here: two runs must not share a directory. Wait for it, end it, or give another --out";
                return Err(FileError::failed(dir, format!("{} {what}", holder(&mut file))));
            }
            Err(TryLockError::Error(_)) => true,
        };
        let said = format!("process {} since {}\n", std::process::id(), journal::now());
        // the text only helps people: the lock holds without it, on a full disk, too
        let _ = say(&mut file, &said);
        Ok(RunLock { file: Some(file), said, blind })
    }

    pub fn plan(&mut self, recordings: &[ToJudge]) -> std::io::Result<()> {
        let Some(file) = &mut self.file else { return Ok(()) };
        let mut text = self.said.clone();
        for recording in recordings {
            text += &serde_json::to_string(recording)?;
            text.push('\n');
        }
        say(file, &text)
    }

    /// Removes the list of recordings: the run has told of each what became of it.
    pub fn over(mut self) {
        if let Some(file) = &mut self.file {
            let _ = say(file, &self.said); // if this fails, the run looks like one that was killed
        }
    }
}

fn say(file: &mut File, text: &str) -> std::io::Result<()> {
    file.set_len(0)?;
    file.rewind()?;
    file.write_all(text.as_bytes())
}

/// A recording that a run is to judge.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ToJudge {
    pub recording: String,
    /// The recording's path, absolute and without links.
    pub path: String,
}

/// A run that has not ended, or was killed, and what it was to judge.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Unfinished {
    /// When the run began, RFC 3339.
    pub since: String,
    pub recordings: Vec<ToJudge>,
}

/// The run in this directory that is under way or was killed.
pub fn unfinished(dir: &Path) -> Option<Unfinished> {
    let text = regular_file::read_text(&dir.join(LOCK_NAME), MOST_BYTES).ok()?;
    let mut lines = text.lines();
    let since = lines.next()?.split_once(" since ")?.1.to_owned();
    let recordings: Vec<ToJudge> =
        lines.filter_map(|line| serde_json::from_str(line).ok()).collect();
    (!recordings.is_empty()).then_some(Unfinished { since, recordings })
}

fn holder(file: &mut File) -> String {
    let mut said = String::new();
    let read = BufReader::new(file.take(200)).read_line(&mut said).is_ok();
    match said.trim() {
        said if read && !said.is_empty() => format!("another run of inkling ({said})"),
        _ => "another run of inkling".into(),
    }
}
