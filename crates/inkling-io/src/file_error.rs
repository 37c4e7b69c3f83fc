//! The error of readers and writers of files: labels, tables, designs, baselines, results.
//! (Recordings have an error of their own, in `damage.rs`, of which this one is a part.) `src/cli`
//! turns it into a message and an exit status.

use inkling_core::labels::nearest;
use std::io;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Why a file cannot be read, written or used. The variants differ in who has to do something about
/// it, which decides on the exit status (`src/cli/exit.rs`).
#[derive(Debug, Error)]
pub enum FileError {
    #[error("{path}: {}", unread_words(path, source))]
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

/// Why a file cannot be read; of one that is not there, which one may be meant.
fn unread_words(path: &Path, source: &io::Error) -> String {
    match source.kind() {
        io::ErrorKind::NotFound => format!("no such file{}", meant(path)),
        _ => format!("cannot be read: {source}"),
    }
}

/// At most so many names of a directory are compared with a name that does not exist.
const MOST_SIBLINGS: usize = 10_000;

/// The end of an error about a missing file, such as `; did you mean night.mcap?`.
pub(super) fn meant(path: &Path) -> String {
    if path.is_symlink() {
        return "; it is a link, and what it leads to is not there".into();
    }
    let beside = path.parent().filter(|dir| !dir.as_os_str().is_empty());
    let there = std::fs::read_dir(beside.unwrap_or(Path::new("."))).into_iter().flatten();
    let there = there.flatten().take(MOST_SIBLINGS);
    let there: Vec<String> =
        there.map(|of| of.file_name().to_string_lossy().into_owned()).collect();
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    match nearest(&name, there.iter().map(String::as_str)).first() {
        Some(near) => format!("; did you mean {}?", path.with_file_name(near).display()),
        None => String::new(),
    }
}

/// A line of a file, as a place in errors. Lines count from 1.
pub(super) fn line_of(path: &Path, line: u64) -> String {
    format!("{}, line {line}", path.display())
}
