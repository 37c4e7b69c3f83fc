//! The error of readers and writers of files: labels, tables, designs, baselines, results.
//! (Recordings have an error of their own, in `damage.rs`, of which this one is a part.) `src/cli`
//! turns it into a message and an exit status.

use std::io;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Why a file cannot be read, written or used. The variants differ in who has to do something about
/// it, which decides on the exit status (`src/cli/exit.rs`).
#[derive(Debug, Error)]
pub enum FileError {
    #[error("{path}: cannot be read: {source}")]
    Read { path: PathBuf, source: io::Error },
    #[error("{path}: cannot be written: {source}")]
    Write { path: PathBuf, source: io::Error },
    /// Whoever named the file, or wrote it, made a mistake.
    #[error("{place}: {what}")]
    Mistaken { place: String, what: String },
    /// Nobody need have made a mistake: the content is damaged, another run is in the way, or a disk or a
    /// store refuses.
    #[error("{place}: {what}")]
    Failed { place: String, what: String },
}

impl FileError {
    pub fn unread(path: &Path) -> impl Fn(io::Error) -> FileError + Copy {
        |source| FileError::Read { path: path.into(), source }
    }

    pub fn unwritten(path: &Path) -> impl Fn(io::Error) -> FileError + Copy {
        |source| FileError::Write { path: path.into(), source }
    }

    pub(super) fn mistaken(path: &Path, what: impl Into<String>) -> FileError {
        FileError::Mistaken { place: path.display().to_string(), what: what.into() }
    }

    pub(super) fn failed(path: &Path, what: impl Into<String>) -> FileError {
        FileError::Failed { place: path.display().to_string(), what: what.into() }
    }
}

/// A line of a file, as a place in errors. Lines count from 1.
pub(super) fn line_of(path: &Path, line: u64) -> String {
    format!("{}, line {line}", path.display())
}
