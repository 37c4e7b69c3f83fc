//! What is wrong with a recording: [`Damage`] to a part of it, or a [`RecordingError`] if it cannot
//! be read or written at all.
//!
//! Damage is no error: the rest of the recording is judged, and the recording's summary lists the
//! damage. An error ends the work on that recording.

use super::file_error::FileError;
use std::path::PathBuf;
use thiserror::Error;

/// A range of bytes of a recording in which something could not be used, or was used although a
/// checksum or a count in the recording does not agree with it.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Damage {
    /// Place in the file as it is stored, compressed chunks included.
    pub from_byte: u64,
    /// End of the range, exclusive. Equal to `from_byte`: something is missing there, or the file
    /// was changed while it was read.
    pub to_byte: u64,
    pub what: String,
}

/// Where it is, and what.
impl std::fmt::Display for Damage {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        write!(f, "{}: {}", self.place(), self.what)
    }
}

impl Damage {
    /// The bytes in words.
    pub fn place(&self) -> String {
        match self {
            Damage { from_byte, to_byte, .. } if from_byte == to_byte => format!("byte {to_byte}"),
            Damage { from_byte, to_byte, .. } => format!("bytes {from_byte} to {to_byte}"),
        }
    }
}

pub fn note(list: &mut Vec<Damage>, damage: Damage) {
    // a list has no more entries than these, since a file may be damaged everywhere
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

#[derive(Debug, Error)]
pub enum RecordingError {
    #[error(transparent)]
    File(#[from] FileError),
    /// A dialect of the settings fits a topic of the recording and cannot read its messages.
    #[error("{path}: {what}")]
    Dialect { path: PathBuf, what: String },
}
