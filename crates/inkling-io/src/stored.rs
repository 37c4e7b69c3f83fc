//! What lies under a name, be that a file's or an object's: whether, since when, how large; gone, renamed.

use super::objects::{self, in_object_store};
use super::stamp::Stamp;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

/// Where `--layout hive` puts verdict tables, below a directory of results; others have directories like it.
pub const HIVE: &str = "verdicts";
/// What a directory of a day begins with there.
pub const DAY: &str = "day=";

/// What else is told of a recording: `<stem>.verdicts.parquet` -> `<stem>.<ending>`; of `verdicts/day=.../` in a
/// directory of its own kind, `episodes/day=.../`.
pub fn beside(verdicts: &Path, ending: &str) -> PathBuf {
    let name = verdicts.file_name().unwrap_or_default().to_string_lossy();
    let stem = name.strip_suffix(".verdicts.parquet").unwrap_or(&name);
    let file = format!("{stem}.{ending}");
    match hive(verdicts) {
        Some((out, day)) => {
            out.join(ending.split('.').next().unwrap_or(ending)).join(day).join(file)
        }
        None => verdicts.with_file_name(file),
    }
}

/// The directory of results, and the day's, of a table that lies as `--layout hive` puts it.
fn hive(verdicts: &Path) -> Option<(&Path, &str)> {
    let day = verdicts.parent()?;
    let kind = day.parent()?;
    let name = day.file_name()?.to_str()?;
    let is_hive = name.starts_with(DAY) && kind.file_name()? == HIVE;
    Some((kind.parent()?, name)).filter(|_| is_hive)
}

/// Of a file or an object as it is now.
pub fn stamp(path: &Path) -> io::Result<Stamp> {
    match in_object_store(path) {
        true => objects::stamp(path),
        false => Ok(Stamp::of(&path.metadata()?)),
    }
}

/// Whether there is a file, or an object; what cannot be asked is not there.
pub fn is_file(path: &Path) -> bool {
    match in_object_store(path) {
        true => objects::stamp(path).is_ok(),
        false => path.is_file(),
    }
}

/// Whether there is anything of that name.
pub fn exists(path: &Path) -> bool {
    if in_object_store(path) { is_file(path) } else { path.exists() }
}

/// 0: it is not there.
pub fn bytes(path: &Path) -> u64 {
    stamp(path).map_or(0, |stamp| stamp.bytes)
}

/// What is not there need not be removed.
pub fn remove(path: &Path) -> io::Result<()> {
    let removed = match in_object_store(path) {
        true => objects::remove(path),
        false => std::fs::remove_file(path),
    };
    removed.or_else(|e| if e.kind() == ErrorKind::NotFound { Ok(()) } else { Err(e) })
}

/// Of an object: a copy, then the object itself goes.
pub fn rename(from: &Path, to: &Path) -> io::Result<()> {
    if in_object_store(from) { objects::rename(from, to) } else { std::fs::rename(from, to) }
}
