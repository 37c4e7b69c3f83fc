//! Checks the places where results will go, before any work is done for them, and removes the files
//! of an earlier run.
//!
//! Called by the verbs in `src/cli` at their beginning. The rule: a result may replace an earlier
//! result of the same kind, and nothing else. Most results say in themselves who made them
//! ([`ResultFile`]); a file that does not say it is taken for somebody else's, unless it is empty
//! or lies beside a result that does. Of objects in a store only the name and the credentials are
//! checked.

use super::file_error::FileError;
use super::objects::{self, in_object_store};
pub use super::result_file::ResultFile;
use super::{regular_file, result_file, stored};
use std::io::ErrorKind;
use std::path::Path;

/// Number of bytes by which a file is taken to hold nothing.
const LOOKED_AT: u64 = 4096;

/// The place must be a directory, which may have to be made, or a prefix in an object store.
pub fn check_place(path: &Path) -> Result<(), FileError> {
    match in_object_store(path) {
        true => check_object(path),
        false => check_directory(path),
    }
}

fn check_object(path: &Path) -> Result<(), FileError> {
    objects::check(path).map_err(|e| FileError::failed(path, e.to_string()))
}

/// Refuses a directory where no results can be: if a file has its name, or if it lies in an object store (for
/// verbs that write only to disks).
pub fn check_directory(path: &Path) -> Result<(), FileError> {
    if in_object_store(path) {
        return Err(FileError::mistaken(
            path,
            "this verb writes a directory of files, not of objects: write it to one, and copy that (aws s3 \
             sync, gcloud storage rsync, azcopy)",
        ));
    }
    // if it is not there yet, the nearest directory above decides
    match path.ancestors().find(|p| p.symlink_metadata().is_ok()) {
        Some(there) if !there.is_dir() => Err(FileError::mistaken(
            there,
            "is a file, and results go into a directory: give another name",
        )),
        _ => Ok(()),
    }
}

/// Refuses a directory, and a file that is no earlier result of this kind or cannot be looked into.
pub fn check_file(path: &Path, kind: ResultFile) -> Result<(), FileError> {
    if in_object_store(path) {
        return check_object(path);
    }
    if path.is_dir() {
        let what = "is a directory, and the result is a file: give its name";
        return Err(FileError::mistaken(path, what));
    }
    // nothing is lost: it is empty, or holds nothing but zeros, as files do after a power failure
    let is_void = |start: Vec<u8>| start.iter().all(|byte| *byte == 0);
    let is_empty = || path.is_file() && regular_file::start(path, LOOKED_AT).is_ok_and(is_void);
    match ResultFile::of(path) {
        Ok(there) if there == Some(kind) || is_empty() || result_file::is_cut(path) => {}
        Err(e) if e.kind() == ErrorKind::NotFound => {}
        Err(e) if e.kind() != ErrorKind::NotADirectory => {
            let what = format!("cannot be looked into, so nothing is written there: {e}");
            return Err(FileError::mistaken(path, what));
        }
        Err(_) => {} // a part of the path is no directory, which is told below
        Ok(_) => return Err(of_another(path, kind)),
    }
    path.parent().map_or(Ok(()), check_directory)
}

fn of_another(path: &Path, kind: ResultFile) -> FileError {
    let what = format!("is there already, and is no {kind}: give another name, or remove it");
    FileError::mistaken(path, what)
}

/// Refuses a directory in which one of the `files` that a run will write is somebody else's. Files
/// of the kind `Companion` ("mute" here) do not say who made them; they count as an earlier run's
/// if another of the files is that run's.
pub fn check_files<'a>(
    dir: &Path,
    files: impl IntoIterator<Item = (&'a str, ResultFile)>,
) -> Result<(), FileError> {
    check_directory(dir)?;
    // files that tell who made them are checked first
    let is_mute = |file: &(&str, ResultFile)| file.1 == ResultFile::Companion;
    let (mute, telling): (Vec<_>, Vec<_>) = files.into_iter().partition(is_mute);
    telling.iter().try_for_each(|(name, kind)| check_file(&dir.join(name), *kind))?;
    match telling.iter().any(|(name, kind)| is_earlier(&dir.join(name), *kind)) {
        true => Ok(()),
        false => mute.iter().try_for_each(|(name, kind)| check_file(&dir.join(name), *kind)),
    }
}

/// Whether an earlier run wrote a result of this kind there. A file that is empty says nothing of who made it.
fn is_earlier(path: &Path, kind: ResultFile) -> bool {
    matches!(ResultFile::of(path), Ok(Some(there)) if there == kind)
}

/// Removes an earlier run's files in the given order: the caller names first the file that says
/// that the others are complete, then all files that the new run might not write again.
pub fn remove_earlier(dir: &Path, names: &[&str]) -> Result<(), FileError> {
    for path in names.iter().map(|name| dir.join(name)) {
        stored::remove(&path).map_err(|e| {
            FileError::failed(&path, format!("an earlier run's file cannot be removed: {e}"))
        })?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::assert_refused;

    #[test]
    fn what_does_not_say_who_made_it_is_known_by_what_lies_beside_it() {
        let dir = tempfile::tempdir().unwrap();
        let files =
            || check_files(dir.path(), [("m", ResultFile::Models), ("n", ResultFile::Companion)]);
        files().unwrap();
        std::fs::write(dir.path().join("n"), "somebody's").unwrap();
        assert_refused(files(), &["n: is there already, and is no file of an earlier run"]);
        std::fs::write(dir.path().join("m"), "").unwrap();
        files().unwrap_err(); // an empty file tells nothing
        std::fs::write(dir.path().join("m"), "{\"models\": []}").unwrap();
        files().unwrap();
    }

    #[test]
    fn what_holds_nothing_may_be_replaced() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("run.json");
        let cut = b"{\n  \"version\": 2,\n  \"inkling\": \"0.2.0\",\n  \"totals\": {";
        let of_others = b"{\n  \"version\": 2,\n  \"totals\": {";
        for (bytes, may) in [
            (&b""[..], true),
            (&[0; 900], true),
            (cut, true),
            (of_others, false),
            (b"\0\0x", false),
            (b"x", false),
        ] {
            std::fs::write(&path, bytes).unwrap();
            assert_eq!(check_file(&path, ResultFile::Run).is_ok(), may, "{bytes:?}");
        }
    }
}
