//! The file of baselines: what is remembered of printheads and channels from recording to recording
//! ([`Memory`]), as JSON (`schemas/baseline.md`). `inkling replay --baseline` reads it when a run begins, and
//! replaces it after each recording that was judged.
//!
//! The file belongs to one design, and to one run at a time. Nothing locks it, but
//! [`BaselineFile::prepare`] refuses if another run has changed it meanwhile, so that run's work is not
//! overwritten. What another run writes between that and [`BaselineFile::replace`] is overwritten.

use super::digest::in_words;
use super::part_file::{self, CompleteFile};
use super::{printable, regular_file, result_file};
use inkling_core::state::Memory;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use thiserror::Error;
use xxhash_rust::xxh3::xxh3_128;

/// Most bytes that are read. A channel that was heard on several days takes some 650 bytes, so this is enough
/// for some 800 000 channels.
const MOST_BYTES: u64 = 1 << 29;

/// Why baselines could not be read or written.
#[derive(Debug, Error)]
pub enum BaselineFileError {
    #[error("{path}: cannot be read: {source}")]
    Read { path: PathBuf, source: std::io::Error },
    #[error("{path}: cannot be written: {source}")]
    Write { path: PathBuf, source: std::io::Error },
    #[error(
        "{path}: another run wrote this file meanwhile, or removed it; it was left as it is. Runs that \
         share a baseline file must follow each other: run this one again"
    )]
    Changed { path: PathBuf },
    #[error(
        "{path}: no baselines{what}; `inkling replay --baseline` makes them: name a file that it wrote, or one that is \
         not there yet"
    )]
    NotBaselines { path: PathBuf, what: String },
    #[error(
        "{path}: these baselines were learned with another design ({found}, not {design}): \
         give another file, or the design they belong to"
    )]
    OtherDesign { path: PathBuf, found: String, design: String },
}

/// A file of baselines, known by its content when it was read or written last.
#[derive(Debug)]
pub struct BaselineFile {
    path: PathBuf,
    /// Hash of its bytes; `None`: there was no file.
    hash: Option<u128>,
}

/// New baselines, complete on disk in a file beside the old one, which [`BaselineFile::replace`] gives the
/// old one's name. If they are dropped before, that file is removed.
#[derive(Debug)]
pub struct Prepared {
    file: CompleteFile,
    /// Hash of its bytes.
    hash: u128,
}

impl Prepared {
    /// Digest of the new file.
    pub fn digest(&self) -> String {
        in_words(self.hash)
    }
}

impl BaselineFile {
    /// Digest of the file when it was read or written last; `None`: there was none.
    pub fn digest(&self) -> Option<String> {
        self.hash.map(in_words)
    }

    /// Removes files of new baselines that killed runs have left beside this file, without its name.
    pub fn sweep(&self) {
        let name = self.path.file_name().unwrap_or_default().to_string_lossy();
        let dir = self.path.parent().filter(|p| !p.as_os_str().is_empty());
        part_file::sweep(dir.unwrap_or(Path::new(".")), |of| of == name);
    }

    /// Reads and checks the baselines; if there is no file yet, they are empty. `design`: the digest of the
    /// design that recordings are judged by, `None` if there is none. Baselines of another design are
    /// refused.
    pub fn read(
        path: &Path,
        design: Option<&str>,
    ) -> Result<(BaselineFile, Memory), BaselineFileError> {
        let mut file = BaselineFile { path: path.into(), hash: None };
        let Some(text) = file.bytes()? else {
            return Ok((file, Memory::new(design.map(str::to_owned))));
        };
        file.hash = Some(xxh3_128(&text));
        let not = |what: String| {
            let what = result_file::instead_or(path, "baselines", &what);
            BaselineFileError::NotBaselines { path: path.into(), what }
        };
        let baselines =
            Memory::from_json(&text).map_err(|what| not(printable::line(&what, 200)))?;
        if baselines.design.as_deref() != design {
            let words = |digest: Option<&str>| digest.unwrap_or("none").to_owned();
            return Err(BaselineFileError::OtherDesign {
                path: path.into(),
                found: words(baselines.design.as_deref()),
                design: words(design),
            });
        }
        Ok((file, baselines))
    }

    /// Prepares new baselines, and replaces the file by them at once.
    pub fn write(&mut self, baselines: &Memory) -> Result<(), BaselineFileError> {
        let prepared = self.prepare(baselines)?;
        self.replace(prepared)
    }

    /// Writes new baselines to a file beside this one, which stays as it is. It is an error if this file is
    /// no longer as it was read or written last. What can fail for want of room fails here, before the
    /// journal says that the recording is finished.
    pub fn prepare(&self, baselines: &Memory) -> Result<Prepared, BaselineFileError> {
        let failed = |source| BaselineFileError::Write { path: self.path.clone(), source };
        let mut text = serde_json::to_string(baselines).map_err(|e| failed(e.into()))?;
        text.push('\n');
        let complete = part_file::completed(&self.path, text.as_bytes()).map_err(failed)?;
        // another run may have replaced the file since it was read
        if self.bytes()?.as_deref().map(xxh3_128) != self.hash {
            return Err(BaselineFileError::Changed { path: self.path.clone() });
        }
        Ok(Prepared { file: complete, hash: xxh3_128(text.as_bytes()) })
    }

    /// Replaces the file by what was prepared. Whether the file was changed since is not looked at again.
    pub fn replace(&mut self, prepared: Prepared) -> Result<(), BaselineFileError> {
        let failed = |source| BaselineFileError::Write { path: self.path.clone(), source };
        prepared.file.name().map_err(failed)?;
        self.hash = Some(prepared.hash);
        part_file::sync_directory_of(&self.path).map_err(failed)
    }

    /// The file's bytes; `None`: there is no file.
    fn bytes(&self) -> Result<Option<Vec<u8>>, BaselineFileError> {
        match regular_file::read(&self.path, MOST_BYTES) {
            Ok(bytes) => Ok(Some(bytes)),
            Err(e) if e.kind() == ErrorKind::NotFound => Ok(None),
            Err(source) => Err(BaselineFileError::Read { path: self.path.clone(), source }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_another_run_wrote_meanwhile_is_not_overwritten() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("b.json");
        let design = Some("xxh3:1");
        let (mut one, baselines) = BaselineFile::read(&path, design).unwrap();
        let (mut other, _) = BaselineFile::read(&path, design).unwrap();
        one.write(&baselines).unwrap();
        one.write(&baselines).unwrap();
        let refused = other.write(&baselines).unwrap_err().to_string();
        assert!(refused.contains("b.json") && refused.contains("another run"), "{refused}");
        let (mut later, _) = BaselineFile::read(&path, design).unwrap();
        later.write(&baselines).unwrap();
        std::fs::remove_file(&path).unwrap();
        assert!(later.write(&baselines).is_err());
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
        assert!(
            BaselineFile::read(dir.path(), design).unwrap_err().to_string().contains("not a file")
        );
    }
}
