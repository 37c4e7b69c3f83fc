//! Where results go: checked before any work is done for them, and freed of an earlier run's files.

use super::mcap_records::MAGIC;
use super::objects::{self, in_object_store};
use super::{regular_file, stored};
use serde::de::IgnoredAny;
use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};
use thiserror::Error;

#[derive(Debug, Error)]
pub enum OutputError {
    #[error("{path}: is a file, and results go into a directory: give another name")]
    IsAFile { path: PathBuf },
    #[error("{path}: is a directory, and the result is a file: give its name")]
    IsADirectory { path: PathBuf },
    #[error("{path}: is there already, and is no {kind}: give another name, or remove it")]
    OfAnother { path: PathBuf, kind: ResultFile },
    #[error("{path}: {source}")]
    InObjectStore { path: PathBuf, source: std::io::Error },
    #[error(
        "{path}: this verb writes a directory of files, not of objects: write it to one, and copy that (aws s3 sync, \
         gcloud storage rsync, azcopy)"
    )]
    FilesAlone { path: PathBuf },
    #[error("{path}: an earlier run's file cannot be removed: {source}")]
    Stays { path: PathBuf, source: std::io::Error },
}

/// Refuses a place for results that cannot be one: a directory, or a prefix of an object store.
pub fn check_place(path: &Path) -> Result<(), OutputError> {
    match in_object_store(path) {
        true => check_object(path),
        false => check_directory(path),
    }
}

fn check_object(path: &Path) -> Result<(), OutputError> {
    let failed = |source| OutputError::InObjectStore { path: path.into(), source };
    objects::check(path).map_err(failed)
}

/// Refuses a directory for results that cannot be one.
pub fn check_directory(path: &Path) -> Result<(), OutputError> {
    if in_object_store(path) {
        return Err(OutputError::FilesAlone { path: path.into() });
    }
    // of what is not there yet, the nearest directory above decides
    match path.ancestors().find(|p| p.symlink_metadata().is_ok()) {
        Some(there) if !there.is_dir() => Err(OutputError::IsAFile { path: there.into() }),
        _ => Ok(()),
    }
}

/// A result that is one file. An earlier one may be replaced; what is none belongs to somebody else.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ResultFile {
    Design,
    Models,
    Page,
    Recording,
    Table,
}

impl std::fmt::Display for ResultFile {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.write_str(match self {
            ResultFile::Design => "design",
            ResultFile::Models => "file of identified models",
            ResultFile::Page => "HTML page",
            ResultFile::Recording => "MCAP recording",
            ResultFile::Table => "Parquet table",
        })
    }
}

impl ResultFile {
    /// Whether a file's content may be an earlier result of this kind; an empty one holds nothing that could be lost.
    fn may_be(self, content: &[u8]) -> bool {
        let holds = |key: &str| {
            let object = serde_json::from_slice::<BTreeMap<String, IgnoredAny>>(content);
            object.is_ok_and(|object| object.contains_key(key))
        };
        content.is_empty()
            || match self {
                ResultFile::Design => holds("sample_period_s"),
                ResultFile::Models => holds("models"),
                ResultFile::Page => content.starts_with(b"<!doctype html>"),
                ResultFile::Recording => content.starts_with(MAGIC),
                ResultFile::Table => content.starts_with(b"PAR1"),
            }
    }
}

/// Refuses a name for a result that cannot be a file's, or is that of a file of another kind.
pub fn check_file(path: &Path, kind: ResultFile) -> Result<(), OutputError> {
    if in_object_store(path) {
        return check_object(path);
    }
    if path.is_dir() {
        return Err(OutputError::IsADirectory { path: path.into() });
    }
    // of pages, recordings and tables the first bytes tell
    let most = if matches!(kind, ResultFile::Design | ResultFile::Models) { u64::MAX } else { 64 };
    let mut content = Vec::new();
    let there = regular_file::open(path).and_then(|file| file.take(most).read_to_end(&mut content));
    if there.is_ok() && !kind.may_be(&content) {
        return Err(OutputError::OfAnother { path: path.into(), kind });
    }
    path.parent().map_or(Ok(()), check_directory)
}

/// Removes an earlier run's files from a directory, in this order: first the one that says that the
/// others are complete, then all that might not be written again.
pub fn remove_earlier(dir: &Path, names: &[&str]) -> Result<(), OutputError> {
    for path in names.iter().map(|name| dir.join(name)) {
        stored::remove(&path).map_err(|source| OutputError::Stays { path, source })?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_earlier_result_is_replaced_and_nothing_else_is() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("there");
        use ResultFile::*;
        let earlier: [(&[u8], Option<ResultFile>); 7] = [
            (b"{\"version\": 1, \"sample_period_s\": 1e-6}", Some(Design)),
            (b"{\"models\": []}", Some(Models)),
            (b"<!doctype html>\n<html>", Some(Page)),
            (b"\x89MCAP0\r\n...", Some(Recording)),
            (b"PAR1...", Some(Table)),
            (b"printhead,channel,from,to,state,severity\n", None),
            (b"{\"version\": 2, \"heads\": {}}", None),
        ];
        for (content, of) in earlier {
            std::fs::write(&path, content).unwrap();
            for kind in [Design, Models, Page, Recording, Table] {
                assert_eq!(check_file(&path, kind).is_ok(), of == Some(kind), "{of:?} {kind}");
            }
        }
    }

    #[test]
    fn files_are_no_directories_and_directories_no_files() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        std::fs::write(at("file"), "").unwrap();
        assert!(check_directory(&at("new/below")).is_ok() && check_directory(dir.path()).is_ok());
        let check_file = |path: &Path| check_file(path, ResultFile::Page);
        assert!(check_file(&at("file")).is_ok() && check_file(&at("new/file")).is_ok());
        assert!(
            check_file(Path::new("here")).is_ok() && check_directory(Path::new("here")).is_ok()
        );
        for refused in [check_directory(&at("file")), check_directory(&at("file/below"))] {
            let message = refused.unwrap_err().to_string();
            assert!(message.contains("is a file") && !message.contains("below"), "{message}");
        }
        assert!(check_file(dir.path()).is_err() && check_file(&at("file/below")).is_err());
    }

    #[test]
    fn earlier_files_go_others_stay() {
        let dir = tempfile::tempdir().unwrap();
        for name in ["a", "b", "c"] {
            std::fs::write(dir.path().join(name), "").unwrap();
        }
        remove_earlier(dir.path(), &["b", "missing", "a"]).unwrap();
        let left: Vec<_> = std::fs::read_dir(dir.path()).unwrap().collect();
        assert_eq!(left.len(), 1);
        remove_earlier(&dir.path().join("nowhere"), &["a"]).unwrap();
    }
}
