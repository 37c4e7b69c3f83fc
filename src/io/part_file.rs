//! A file that gets its name only when it is complete.
//!
//! Written as `<name>.part`; renamed by [`PartFile::finish`], removed if dropped before.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

#[derive(Debug)]
pub struct PartFile {
    path: PathBuf,
    part: PathBuf,
    finished: bool,
}

impl PartFile {
    /// Creates `<path>.part`, and the directories above it.
    pub fn create(path: &Path) -> io::Result<(PartFile, File)> {
        let mut name = path.file_name().ok_or(io::ErrorKind::InvalidInput)?.to_os_string();
        name.push(".part");
        let part = path.with_file_name(name);
        if let Some(parent) = path.parent().filter(|p| !p.as_os_str().is_empty()) {
            fs::create_dir_all(parent)?;
        }
        let file = File::create(&part)?;
        Ok((PartFile { path: path.to_path_buf(), part, finished: false }, file))
    }

    /// Gives the file its name. `file` is the handle that was written to, flushed.
    pub fn finish(mut self, file: &File) -> io::Result<()> {
        file.sync_all()?; // else a power cut may leave an empty file under the final name
        fs::rename(&self.part, &self.path)?;
        self.finished = true;
        Ok(())
    }

    pub fn path(&self) -> &Path {
        &self.path
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
