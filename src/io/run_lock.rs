//! One run at a time in a directory of results.
//!
//! The lock is the system's, on an open file: it ends with the process that holds it, however that
//! ends. The file stays; it says who held it last.

use super::journal;
use super::objects::in_object_store;
use std::fs::{File, TryLockError};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use thiserror::Error;

pub const LOCK_NAME: &str = ".inkling.lock";

#[derive(Debug, Error)]
pub enum LockError {
    #[error(
        "{dir}: {held} writes here: two runs must not share a directory. Wait for it, end it, or give \
         another --out"
    )]
    Held { dir: PathBuf, held: String },
    #[error("{path}: cannot be written: {source}")]
    Write { path: PathBuf, source: std::io::Error },
}

/// Held until it is dropped, or its process ends.
#[derive(Debug)]
pub struct RunLock {
    _file: Option<File>,
    /// The file system, or an object store, knows no locks: a second run would not be noticed.
    pub blind: bool,
}

impl RunLock {
    /// Makes the directory where there is none.
    pub fn take(dir: &Path) -> Result<RunLock, LockError> {
        if in_object_store(dir) {
            return Ok(RunLock { _file: None, blind: true });
        }
        let path = dir.join(LOCK_NAME);
        let failed = |source| LockError::Write { path: path.clone(), source };
        std::fs::create_dir_all(dir)
            .map_err(|source| LockError::Write { path: dir.into(), source })?;
        let mut file = File::options()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .open(&path)
            .map_err(failed)?;
        let blind = match file.try_lock() {
            Ok(()) => false,
            Err(TryLockError::WouldBlock) => {
                return Err(LockError::Held { dir: dir.into(), held: holder(&mut file) });
            }
            Err(TryLockError::Error(_)) => true,
        };
        let said = format!("process {} since {}\n", std::process::id(), journal::now());
        // what it says helps people only: the lock holds without it, and on a full disk, too
        let _ = file.set_len(0).and_then(|()| file.write_all(said.as_bytes()));
        Ok(RunLock { _file: Some(file), blind })
    }
}

/// What the holder wrote of itself.
fn holder(file: &mut File) -> String {
    let mut said = String::new();
    let read = file.take(200).read_to_string(&mut said).is_ok();
    match said.trim() {
        said if read && !said.is_empty() => format!("another run of inkling ({said})"),
        _ => "another run of inkling".into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_second_is_refused_with_the_first_named_until_the_first_ends() {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("new");
        let first = RunLock::take(&out).unwrap();
        let refused = RunLock::take(&out).unwrap_err().to_string();
        let me = format!("process {} since 2", std::process::id());
        assert!(refused.contains(&me) && refused.contains("--out"), "{refused}");
        drop(first);
        assert!(!RunLock::take(&out).unwrap().blind);
    }
}
