//! A file that gets its name only when it is complete.
//!
//! Written as `<name>.<process>-<number>.part`, a name of its own, so that two runs into one directory
//! never write into one file; renamed by [`PartFile::finish`], removed if dropped before. Files that
//! belong together are all completed ([`PartFile::complete`]) before the first gets its name.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// Names that are tried: others are leftovers of ended processes of the same number.
const MOST_NAMES: u32 = 1000;

static NUMBER: AtomicU64 = AtomicU64::new(0);

#[derive(Debug)]
pub struct PartFile {
    path: PathBuf,
    part: PathBuf,
    finished: bool,
}

impl PartFile {
    /// Creates a file beside `path`, and the directories above it.
    pub fn create(path: &Path) -> io::Result<(PartFile, File)> {
        let name = path.file_name().ok_or(io::ErrorKind::InvalidInput)?;
        if path.is_dir() {
            return Err(io::ErrorKind::IsADirectory.into()); // renaming would fail after all the work
        }
        if let Some(parent) = path.parent().filter(|p| !p.as_os_str().is_empty()) {
            fs::create_dir_all(parent)?;
        }
        let mut taken = io::Error::from(io::ErrorKind::AlreadyExists);
        for _ in 0..MOST_NAMES {
            let number = NUMBER.fetch_add(1, Ordering::Relaxed);
            let mut name = name.to_os_string();
            name.push(format!(".{}-{number}.part", std::process::id()));
            let part = path.with_file_name(name);
            match File::create_new(&part) {
                Ok(file) => {
                    return Ok((
                        PartFile { path: path.to_path_buf(), part, finished: false },
                        file,
                    ));
                }
                Err(e) if e.kind() == io::ErrorKind::AlreadyExists => taken = e,
                Err(e) => return Err(e),
            }
        }
        Err(taken)
    }

    /// Gives the file its name. `file` is the handle that was written to, flushed.
    pub fn finish(self, file: &File) -> io::Result<()> {
        self.complete(file)?.name()
    }

    /// What can fail for want of room fails here. `file` is the handle that was written to, flushed.
    pub fn complete(self, file: &File) -> io::Result<CompleteFile> {
        file.sync_all()?; // else a power cut may leave an empty file under the final name
        Ok(CompleteFile(self))
    }

    pub fn path(&self) -> &Path {
        &self.path
    }
}

/// Complete on disk; without its name it is removed if dropped.
#[derive(Debug)]
pub struct CompleteFile(PartFile);

impl CompleteFile {
    pub fn name(mut self) -> io::Result<()> {
        fs::rename(&self.0.part, &self.0.path)?;
        self.0.finished = true;
        Ok(())
    }

    pub fn path(&self) -> &Path {
        self.0.path()
    }
}

impl Drop for PartFile {
    fn drop(&mut self) {
        if !self.finished {
            // Nothing can be done about a failure here; a `.part` is never taken for a result.
            let _ = fs::remove_file(&self.part);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    fn names(dir: &Path) -> Vec<String> {
        let entries = fs::read_dir(dir).unwrap().map(|e| e.unwrap().file_name());
        let mut names: Vec<String> = entries.map(|n| n.to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }

    #[test]
    fn two_writers_of_one_name_do_not_meet() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("below/x");
        let (first, mut of_first) = PartFile::create(&path).unwrap();
        let (second, mut of_second) = PartFile::create(&path).unwrap();
        of_first.write_all(b"first").unwrap();
        of_second.write_all(b"2").unwrap();
        assert!(names(&dir.path().join("below")).iter().all(|n| n.ends_with(".part")));
        second.finish(&of_second).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"2");
        first.finish(&of_first).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"first");
        assert_eq!(names(&dir.path().join("below")), ["x"]);
    }

    #[test]
    fn what_is_complete_but_has_no_name_is_removed() {
        let dir = tempfile::tempdir().unwrap();
        let (part, file) = PartFile::create(&dir.path().join("x")).unwrap();
        drop(part.complete(&file).unwrap());
        assert!(names(dir.path()).is_empty());
    }

    #[test]
    fn a_directory_of_that_name_is_refused_before_the_work() {
        let dir = tempfile::tempdir().unwrap();
        fs::create_dir(dir.path().join("x")).unwrap();
        let refused = PartFile::create(&dir.path().join("x")).unwrap_err();
        assert_eq!(refused.kind(), io::ErrorKind::IsADirectory);
        assert_eq!(names(dir.path()), ["x"]);
    }
}
