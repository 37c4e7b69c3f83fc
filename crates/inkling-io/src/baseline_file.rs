//! The file of baselines: what is remembered of printheads and channels from recording to recording
//! ([`Memory`]), as JSON (`schemas/baseline.md`). `inkling replay --baseline` reads it when a run
//! begins, and replaces it after each recording that was judged.
//!
//! The file belongs to one design, whose digest it holds, and to one run at a time. The state of another design is of no
//! use: a run puts that file aside and begins anew, since a new design must not stop the nights. Nothing locks
//! it. Instead a [`BaselineFile`] keeps the hash of the bytes that it read or wrote last, and
//! [`BaselineFile::prepare`] and [`BaselineFile::replace`] refuse if the file on disk has another
//! hash by now: so the work of another run is not overwritten. (Two runs that replace the file
//! within the same instant are not noticed.)
//!
//! Replacing has two steps, so that a full disk is noticed before a recording counts as finished:
//! `prepare` writes the new content to a file beside the old one; then the journal says that the
//! recording is finished; then `replace` renames.

use super::digest::in_words;
use super::file_error::FileError;
use super::part_file::{self, CompleteFile};
use super::{printable, regular_file, result_file};
use inkling_core::state::Memory;
use inkling_core::state::memory::MOST_CHANNELS;
use std::path::{Path, PathBuf};
use xxhash_rust::xxh3::xxh3_128;

/// Most bytes that are read: enough for [`MOST_CHANNELS`], as a channel that was heard on several days takes
/// some 650.
const MOST_BYTES: u64 = MOST_CHANNELS as u64 * 1024;

#[derive(Debug)]
pub struct BaselineFile {
    path: PathBuf,
    /// Hash of its bytes; `None`: there was no file.
    hash: Option<u128>,
    /// What is wrong with the file if it belongs to another design: then it counts as not there.
    pub of_another_design: Option<String>,
}

/// New baselines, complete in a file beside the old one; dropping them removes that file.
#[derive(Debug)]
pub struct Prepared {
    file: CompleteFile,
    hash: u128,
}

impl Prepared {
    pub fn digest(&self) -> String {
        in_words(self.hash)
    }
}

impl BaselineFile {
    /// Digest of the file when it was read or written last; `None`: there was none of this design.
    pub fn digest(&self) -> Option<String> {
        self.hash.filter(|_| self.of_another_design.is_none()).map(in_words)
    }

    /// Refuses the file of another design, for callers that may not put it aside.
    pub fn of_this_design(self) -> Result<BaselineFile, FileError> {
        match &self.of_another_design {
            Some(why) => Err(FileError::mistaken(
                &self.path,
                format!(
                    "{why}: remove the file to begin anew, or give the design it belongs to or another file"
                ),
            )),
            None => Ok(self),
        }
    }

    /// Puts the file aside, as `<name>.stale`, and goes on without one.
    pub fn begin_anew(&mut self) -> Result<(), FileError> {
        self.check_unchanged()?;
        let path = part_file::followed(&self.path);
        let mut aside = path.clone().into_os_string();
        aside.push(".stale");
        std::fs::rename(&path, aside).map_err(FileError::unwritten(&self.path))?;
        (self.hash, self.of_another_design) = (None, None);
        Ok(())
    }

    /// Removes the files of prepared baselines that killed runs have left beside this file (or
    /// beside the file that a link at its path leads to).
    pub fn sweep(&self) {
        let path = part_file::followed(&self.path);
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let dir = path.parent().filter(|p| !p.as_os_str().is_empty());
        part_file::sweep(dir.unwrap_or(Path::new(".")), |of| of == name);
    }

    /// Reads and checks the baselines; if there is no file yet, the memory is empty. `design`: the
    /// digest of the design that recordings are judged by, `None` if they are judged without one.
    /// Of another design's file the memory is empty, too ([`BaselineFile::of_another_design`]).
    pub fn read(path: &Path, design: Option<&str>) -> Result<(BaselineFile, Memory), FileError> {
        let mut file = BaselineFile { path: path.into(), hash: None, of_another_design: None };
        let new = || Memory::new(design.map(str::to_owned));
        let Some(text) = file.bytes()? else { return Ok((file, new())) };
        file.hash = Some(xxh3_128(&text));
        let not = |what: String| {
            let what = result_file::instead_or(path, "baselines", &what);
            let what = format!(
                "no baselines{what}; `inkling replay --baseline` makes them: name a file that it wrote, or one \
                 that is not there yet. If this was one, a copy of it goes on, and without the file all begins anew"
            );
            FileError::mistaken(path, what)
        };
        let baselines =
            Memory::from_json(&text).map_err(|what| not(printable::line(&what, 200)))?;
        if baselines.design.as_deref() != design {
            let [found, due] =
                [baselines.design.as_deref(), design].map(|digest| digest.unwrap_or("none"));
            let what =
                format!("these baselines were learned with another design ({found}, not {due})");
            file.of_another_design = Some(what);
            return Ok((file, new()));
        }
        Ok((file, baselines))
    }

    pub fn write(&mut self, baselines: &Memory) -> Result<(), FileError> {
        let prepared = self.prepare(baselines)?;
        self.replace(prepared)
    }

    /// Writes new baselines to a file beside this one; what can fail for want of room fails here. It is an
    /// error if this file has changed since, or if the new one could not be read again.
    pub fn prepare(&self, baselines: &Memory) -> Result<Prepared, FileError> {
        let channels = baselines.channels();
        if channels > MOST_CHANNELS {
            let what = format!(
                "cannot be written: the state of {channels} channels, and at most {MOST_CHANNELS} are read again; \
                 it was left as it is. Give some of the printheads a file of their own"
            );
            return Err(FileError::failed(&self.path, what));
        }
        let failed = FileError::unwritten(&self.path);
        let mut text = serde_json::to_string(baselines).map_err(|e| failed(e.into()))?;
        text.push('\n');
        let complete = part_file::completed(&self.path, text.as_bytes()).map_err(failed)?;
        self.check_unchanged()?;
        Ok(Prepared { file: complete, hash: xxh3_128(text.as_bytes()) })
    }

    /// Replaces the file by what was prepared. It is an error if another run has changed it since.
    pub fn replace(&mut self, prepared: Prepared) -> Result<(), FileError> {
        let failed = FileError::unwritten(&self.path);
        self.check_unchanged()?;
        prepared.file.name().map_err(failed)?;
        self.hash = Some(prepared.hash);
        part_file::sync_directory_of(&self.path).map_err(failed)
    }

    fn check_unchanged(&self) -> Result<(), FileError> {
        match self.bytes()?.as_deref().map(xxh3_128) == self.hash {
            true => Ok(()),
            false => Err(FileError::failed(
                &self.path,
                "another run wrote this file meanwhile, or removed it; it was left as it is. Runs that share a \
                 baseline file must follow each other: run this one again",
            )),
        }
    }

    fn bytes(&self) -> Result<Option<Vec<u8>>, FileError> {
        let there = regular_file::if_there(regular_file::read(&self.path, MOST_BYTES));
        there.map_err(FileError::unread(&self.path))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::{assert_refused, names, place};
    use inkling_core::state::HeadMemory;

    #[test]
    fn what_could_not_be_read_again_is_not_written() {
        let (dir, path) = place("b.json");
        let (mut file, mut baselines) = BaselineFile::read(&path, None).unwrap();
        let channels = (0..=MOST_CHANNELS as u32).map(|channel| (channel, Default::default()));
        let head = HeadMemory { channels: channels.collect(), ..HeadMemory::default() };
        baselines.printheads.insert("p".into(), head);
        assert_refused(file.write(&baselines), &["b.json", "1048577 channels"]);
        assert!(names(dir.path()).is_empty());
    }

    #[cfg(unix)]
    #[test]
    fn where_a_link_leads_is_swept() {
        let (dir, store) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let link = dir.path().join("latest.json");
        std::os::unix::fs::symlink(store.path().join("b.json"), &link).unwrap();
        let (mut file, baselines) = BaselineFile::read(&link, None).unwrap();
        file.write(&baselines).unwrap();
        std::fs::write(store.path().join(".b.json.12-0.part"), "left behind").unwrap();
        file.sweep();
        assert_eq!(names(store.path()), ["b.json"]);
    }

    #[test]
    fn what_another_run_wrote_meanwhile_is_not_overwritten() {
        let (dir, path) = place("b.json");
        let design = Some("xxh3:1");
        let (mut one, baselines) = BaselineFile::read(&path, design).unwrap();
        let (mut other, _) = BaselineFile::read(&path, design).unwrap();
        let prepared = other.prepare(&baselines).unwrap();
        one.write(&baselines).unwrap();
        one.write(&baselines).unwrap();
        assert_refused(other.replace(prepared), &["b.json", "another run"]);
        assert_refused(other.write(&baselines), &["b.json", "another run"]);
        assert_eq!(names(dir.path()), ["b.json"]);
        let (mut later, _) = BaselineFile::read(&path, design).unwrap();
        later.write(&baselines).unwrap();
        std::fs::remove_file(&path).unwrap();
        assert!(later.write(&baselines).is_err());
        assert!(names(dir.path()).is_empty());
        assert_refused(BaselineFile::read(dir.path(), design), &["not a file"]);
    }
}
