//! What is wrong with a recording: [`Damage`] to a part of it, or a [`RecordingError`] if none of it can be
//! used.
//!
//! Damage is no error: the rest of the recording is judged, and the summary lists the damage.

use super::file_error::FileError;
use std::path::PathBuf;
use thiserror::Error;

/// A byte range of a recording that could not be used, or could not be vouched for.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Damage {
    pub from_byte: u64,
    /// Exclusive. Equal to `from_byte`: something is missing there.
    pub to_byte: u64,
    /// What is wrong, in words for the user.
    pub what: String,
}

/// Adds damage to a list that stays small whatever the file: damage that repeats side by side becomes one
/// range, and beyond the bound the last range stands for all further ones.
pub fn note(list: &mut Vec<Damage>, damage: Damage) {
    // a hostile file may have damage at every byte
    const MOST: usize = 10_000;
    let full = list.len() >= MOST;
    match list.last_mut() {
        Some(last) if last.what == damage.what && last.to_byte == damage.from_byte => {
            last.to_byte = damage.to_byte;
        }
        Some(last) if full => {
            last.to_byte = last.to_byte.max(damage.to_byte);
            last.what = "more damage than is listed one by one".into();
        }
        _ => list.push(damage),
    }
}

/// Why a recording could not be read or written. The messages say what to do.
#[derive(Debug, Error)]
pub enum RecordingError {
    #[error(transparent)]
    File(#[from] FileError),
    #[error("{path}: cannot be written as MCAP: {source}")]
    Mcap { path: PathBuf, source: mcap::McapError },
    #[error("{path}: not a file; give an MCAP file, a directory or a glob pattern")]
    NotAFile { path: PathBuf },
    #[error("{path}: empty file (0 bytes); the recording was never written")]
    Empty { path: PathBuf },
    #[error(
        "{path}: not an MCAP file (it begins with {begins}); inkling reads MCAP, and `inkling convert` makes one from CSV, Parquet, Arrow or NumPy"
    )]
    NotMcap { path: PathBuf, begins: String },
    #[error("{path}: MCAP of another version ({begins}); inkling reads version 0")]
    OtherVersion { path: PathBuf, begins: String },
    #[error(
        "{path}: {what} while it was followed: what was told of it belongs to no one recording; follow it again, \
         or replay it when it is closed"
    )]
    NotTheSame { path: PathBuf, what: String },
    #[error("{path}: a recording holds {} printheads at most; give fewer at once", u16::MAX)]
    TooManyPrintheads { path: PathBuf },
    /// A dialect fits the recording's channels and cannot read them.
    #[error("{path}: {what}")]
    Dialect { path: PathBuf, what: String },
}
