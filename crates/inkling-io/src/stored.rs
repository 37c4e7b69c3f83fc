//! Asks about and changes files and objects of a store alike: whether one is there, its size and
//! time, removing, renaming. Also says where the files that belong to a verdict table lie
//! ([`beside`]).

use super::objects::{self, in_object_store};
use super::regular_file::if_there;
use super::stamp::Stamp;
use std::io;
use std::path::{Path, PathBuf};

/// The directory for verdict tables in the layout `hive`, below the directory of results; other
/// kinds of results have directories of their own beside it.
pub const HIVE: &str = "verdicts";
/// How the name of a day's directory in the layout `hive` begins.
pub const DAY: &str = "day=";

/// The path of a file that belongs to a recording's verdict table: `<stem>.verdicts.parquet` gives
/// `<stem>.<ending>`. In the layout `hive` each kind has a directory of its own: what lies in
/// `verdicts/day=.../` gives `episodes/day=.../`.
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

/// For a table that lies as the layout `hive` puts it: the directory of results, and the name of the day's
/// directory.
fn hive(verdicts: &Path) -> Option<(&Path, &str)> {
    let day = verdicts.parent()?;
    let kind = day.parent()?;
    let name = day.file_name()?.to_str()?;
    let is_hive = name.starts_with(DAY) && kind.file_name()? == HIVE;
    Some((kind.parent()?, name)).filter(|_| is_hive)
}

pub fn stamp(path: &Path) -> io::Result<Stamp> {
    match in_object_store(path) {
        true => objects::stamp(path),
        false => Ok(Stamp::of(&path.metadata()?)),
    }
}

/// Whether there is a file or an object of this name; also `false` if the question fails.
pub fn is_file(path: &Path) -> bool {
    match in_object_store(path) {
        true => objects::stamp(path).is_ok(),
        false => path.is_file(),
    }
}

/// Whether there is anything of this name: a file, a directory or an object.
pub fn exists(path: &Path) -> bool {
    if in_object_store(path) { is_file(path) } else { path.exists() }
}

/// Size in bytes of a file or an object; 0 if it is not there.
pub fn bytes(path: &Path) -> u64 {
    stamp(path).map_or(0, |stamp| stamp.bytes)
}

/// Removes a file or an object. It is no error if it is not there.
pub fn remove(path: &Path) -> io::Result<()> {
    let removed = match in_object_store(path) {
        true => objects::remove(path),
        false => std::fs::remove_file(path),
    };
    if_there(removed).map(drop)
}

/// Renames a file or an object. A store makes a copy of the object and removes the first one.
pub fn rename(from: &Path, to: &Path) -> io::Result<()> {
    if in_object_store(from) { objects::rename(from, to) } else { std::fs::rename(from, to) }
}
