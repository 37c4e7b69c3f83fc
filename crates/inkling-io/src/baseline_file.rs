//! Baselines, that is what is remembered of printheads and channels from recording to recording ([`Memory`]),
//! as a file of JSON (`schemas/baseline.md`). It is read when a run begins, and replaced after each
//! recording.
//!
//! The file belongs to one design, and to one run at a time: if another run has changed it meanwhile, that
//! run's work is not overwritten.

use super::digest::in_words;
use super::file_error::FileError;
use super::part_file::{self, CompleteFile};
use super::{printable, regular_file, result_file};
use inkling_core::state::Memory;
use std::path::{Path, PathBuf};
use xxhash_rust::xxh3::xxh3_128;

/// Most bytes that are read; a million channels take some 200 MB.
const MOST_BYTES: u64 = 1 << 29;

/// A file of baselines, known by its content when it was read or written last.
#[derive(Debug)]
pub struct BaselineFile {
    path: PathBuf,
    /// Digest of its text; `None`: there was no file.
    text: Option<u128>,
}

/// New baselines, complete on disk, but still without the file's name.
#[derive(Debug)]
pub struct Prepared {
    file: CompleteFile,
    text: u128,
}

impl Prepared {
    /// Digest of the new text.
    pub fn digest(&self) -> String {
        in_words(self.text)
    }
}

impl BaselineFile {
    /// Digest of the file when it was read or written last; `None`: there was none.
    pub fn digest(&self) -> Option<String> {
        self.text.map(in_words)
    }

    /// Removes what killed runs have left beside the file.
    pub fn sweep(&self) {
        let name = self.path.file_name().unwrap_or_default().to_string_lossy();
        let dir = self.path.parent().filter(|p| !p.as_os_str().is_empty());
        part_file::sweep(dir.unwrap_or(Path::new(".")), |of| of == name);
    }

    /// Reads and checks the baselines of a design; there need not be a file yet. `design` is the design's
    /// digest.
    pub fn read(path: &Path, design: Option<&str>) -> Result<(BaselineFile, Memory), FileError> {
        let mut file = BaselineFile { path: path.into(), text: None };
        let Some(text) = file.text()? else {
            return Ok((file, Memory::new(design.map(str::to_owned))));
        };
        file.text = Some(xxh3_128(&text));
        let not = |what: String| {
            let what = result_file::instead_or(path, "baselines", &what);
            let what = format!(
                "no baselines{what}; `inkling replay --baseline` makes them: name a file that it wrote, or one \
                 that is not there yet"
            );
            FileError::mistaken(path, what)
        };
        let baselines =
            Memory::from_json(&text).map_err(|what| not(printable::line(&what, 200)))?;
        if baselines.design.as_deref() != design {
            let [found, due] =
                [baselines.design.as_deref(), design].map(|digest| digest.unwrap_or("none"));
            return Err(FileError::mistaken(
                path,
                format!(
                    "these baselines were learned with another design ({found}, not {due}): give another file, \
                     or the design they belong to"
                ),
            ));
        }
        Ok((file, baselines))
    }

    /// Replaces the file. It is an error if the file is no longer the one that was read.
    pub fn write(&mut self, baselines: &Memory) -> Result<(), FileError> {
        let prepared = self.prepare(baselines)?;
        self.replace(prepared)
    }

    /// Writes new baselines without replacing the file yet. What can fail for want of room fails here, before
    /// any result of the recording has its name.
    pub fn prepare(&self, baselines: &Memory) -> Result<Prepared, FileError> {
        let failed = FileError::unwritten(&self.path);
        let mut text = serde_json::to_string(baselines).map_err(|e| failed(e.into()))?;
        text.push('\n');
        let complete = part_file::completed(&self.path, text.as_bytes()).map_err(failed)?;
        // another run may have replaced the file since it was read
        if self.text()?.as_deref().map(xxh3_128) != self.text {
            return Err(FileError::failed(
                &self.path,
                "another run wrote this file meanwhile, or removed it; it was left as it is. Runs that share a \
                 baseline file must follow each other: run this one again",
            ));
        }
        Ok(Prepared { file: complete, text: xxh3_128(text.as_bytes()) })
    }

    /// Replaces the file by what was prepared.
    pub fn replace(&mut self, prepared: Prepared) -> Result<(), FileError> {
        let failed = FileError::unwritten(&self.path);
        prepared.file.name().map_err(failed)?;
        self.text = Some(prepared.text);
        part_file::sync_directory_of(&self.path).map_err(failed)
    }

    /// The file's bytes; `None`: there is no file.
    fn text(&self) -> Result<Option<Vec<u8>>, FileError> {
        let there = regular_file::if_there(regular_file::read(&self.path, MOST_BYTES));
        there.map_err(FileError::unread(&self.path))
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
