//! Writes a file that gets its name only when it is complete: every result is written through this.
//!
//! The steps: [`PartFile::create`] opens a file of another name beside the final one; the caller
//! writes to the handle; [`PartFile::complete`] has all bytes on disk; [`CompleteFile::name`]
//! renames the file. A file that is dropped before is removed. Files that belong together are all
//! completed before the first of them gets its name.
//!
//! Until then a file is called `.<name>.<process>-<number>.part`, a name of its own, so that two
//! runs into one directory never write into one file. While it is written it is locked, and a lock
//! ends with the process that holds it. So a file that a killed run left behind is known by having
//! no lock, and can be removed ([`sweep`]).
//!
//! An object of a store is written to a temporary file, which is sent where a file would be
//! renamed.

use super::objects::{self, in_object_store};
use std::collections::BTreeSet;
use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, BufWriter, IntoInnerError, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;

/// How many names are tried. A name can be taken only by a file that an ended process with the same
/// number has left behind.
const MOST_NAMES: u32 = 1000;

/// Number of the next file that this process begins.
static NUMBER: AtomicU64 = AtomicU64::new(0);
/// The files that this process has begun and not finished.
static UNFINISHED: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

fn unfinished() -> MutexGuard<'static, BTreeSet<PathBuf>> {
    UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Removes all files that this process has begun and not finished, for one that ends at once.
pub fn remove_unfinished() {
    for part in unfinished().iter() {
        let _ = fs::remove_file(part); // as where one is dropped
    }
}

#[derive(Debug)]
pub struct PartFile {
    path: PathBuf,
    place: Place,
    /// The thread, if any, that has the bytes flushed so far written to disk.
    syncing: Option<JoinHandle<io::Result<()>>>,
}

/// Where the bytes lie until the file has its name.
#[derive(Debug)]
enum Place {
    /// In a file beside the final one.
    Beside {
        part: PathBuf,
        /// The same open file once more: it keeps the lock until the file has its name.
        lock: Option<File>,
        /// Whether the file has its name, so that there is nothing to remove.
        finished: bool,
    },
    /// In a file without a name, to be sent to an object store.
    Unnamed(File),
}

impl PartFile {
    /// Creates a file beside `path` (or beside the file that a link at `path` leads to), and the
    /// directories above it.
    pub fn create(path: &Path) -> io::Result<(PartFile, File)> {
        if in_object_store(path) {
            objects::check(path)?;
            let file = objects::temporary()?;
            let place = Place::Unnamed(file.try_clone()?);
            return Ok((PartFile { path: path.into(), place, syncing: None }, file));
        }
        let path = &followed(path);
        if fs::metadata(path).is_ok_and(|kind| !kind.is_file() && !kind.is_dir()) {
            let what = "it is a device or a pipe, and a file would take its place";
            return Err(io::Error::new(io::ErrorKind::InvalidInput, what));
        }
        let name = path.file_name().ok_or(io::ErrorKind::InvalidInput)?;
        if path.is_dir() {
            return Err(io::ErrorKind::IsADirectory.into()); // renaming would fail, after all the work
        }
        if let Some(parent) = path.parent().filter(|p| !p.as_os_str().is_empty()) {
            fs::create_dir_all(parent)?;
        }
        let mut taken = io::Error::from(io::ErrorKind::AlreadyExists);
        for _ in 0..MOST_NAMES {
            let number = NUMBER.fetch_add(1, Ordering::Relaxed);
            // programs that read a directory as one table pass over names that begin with a point
            let mut part = OsString::from(".");
            part.push(name);
            part.push(format!(".{}-{number}.part", std::process::id()));
            let part = path.with_file_name(part);
            match File::create_new(&part) {
                Ok(file) => {
                    unfinished().insert(part.clone());
                    // if the file system knows no locks, files of killed runs stay
                    let lock = file.try_lock().ok().and_then(|()| file.try_clone().ok());
                    let path = path.to_path_buf();
                    let place = Place::Beside { part, lock, finished: false };
                    return Ok((PartFile { path, place, syncing: None }, file));
                }
                Err(e) if e.kind() == io::ErrorKind::AlreadyExists => taken = e,
                Err(e) => return Err(e),
            }
        }
        Err(taken)
    }

    /// Completes the file and gives it its name, on disk. `file` is the handle that was written to, flushed.
    pub fn finish(self, file: &File) -> io::Result<()> {
        self.complete(file)?.name_on_disk()
    }

    /// Begins writing what was flushed so far to disk, so that less is left to wait for at the end.
    pub fn sync_early(&mut self) -> io::Result<()> {
        let Place::Beside { lock: Some(file), .. } = &self.place else { return Ok(()) };
        if self.syncing.as_ref().is_some_and(|thread| !thread.is_finished()) {
            return Ok(());
        }
        let file = file.try_clone()?;
        self.synced_early()?;
        self.syncing = std::thread::Builder::new().spawn(move || file.sync_data()).ok();
        Ok(())
    }

    /// The result of `sync_early`'s thread must not be lost: the system reports a failed write once
    /// per open file, and the thread's handle is the same open file.
    fn synced_early(&mut self) -> io::Result<()> {
        let Some(thread) = self.syncing.take() else { return Ok(()) };
        thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    }

    /// Has all bytes written to disk, so that what can fail for want of room fails here.
    pub fn complete(mut self, file: &File) -> io::Result<CompleteFile> {
        self.synced_early()?;
        file.sync_all()?; // or a power cut may leave the name with no bytes
        Ok(CompleteFile(self))
    }

    /// Completes a file that was written through a buffer; the buffer is flushed first.
    pub fn complete_buffered(self, file: BufWriter<File>) -> io::Result<CompleteFile> {
        self.complete(&file.into_inner().map_err(IntoInnerError::into_error)?)
    }

    pub fn path(&self) -> &Path {
        &self.path
    }
}

pub fn write(path: &Path, bytes: &[u8]) -> io::Result<()> {
    completed(path, bytes)?.name_on_disk()
}

/// Writes a file of these bytes, complete on disk, but without its name.
pub fn completed(path: &Path, bytes: &[u8]) -> io::Result<CompleteFile> {
    let (part, mut file) = PartFile::create(path)?;
    file.write_all(bytes)?;
    part.complete(&file)
}

/// The path that a link leads to; any other path as it is.
pub(super) fn followed(path: &Path) -> PathBuf {
    match fs::read_link(path) {
        Ok(to) => fs::canonicalize(path).unwrap_or_else(|_| path.with_file_name("").join(to)),
        Err(_) => path.to_path_buf(),
    }
}

/// A file that is complete on disk. If it is dropped without getting its name, it is removed.
#[derive(Debug)]
pub struct CompleteFile(PartFile);

impl CompleteFile {
    /// Gives the file its name: renames it, or sends it to the object store.
    pub fn name(mut self) -> io::Result<()> {
        match &mut self.0.place {
            Place::Unnamed(file) => objects::send(file, &self.0.path),
            Place::Beside { part, finished, .. } => {
                fs::rename(&*part, &self.0.path)?;
                unfinished().remove(part);
                *finished = true;
                Ok(())
            }
        }
    }

    /// Gives the file its name, and waits until the disk has it.
    pub fn name_on_disk(self) -> io::Result<()> {
        let path = self.path().to_path_buf();
        self.name()?;
        sync_directory_of(&path)
    }

    pub fn path(&self) -> &Path {
        self.0.path()
    }
}

impl Drop for PartFile {
    fn drop(&mut self) {
        if let Place::Beside { part, finished: false, .. } = &self.place {
            // Nothing can be done about a failure here; a `.part` is never taken for a result.
            let _ = fs::remove_file(part);
            unfinished().remove(part);
        }
    }
}

/// Writes the directory of `path` to disk after names in it changed, so that a power cut does not undo them.
pub fn sync_directory_of(path: &Path) -> io::Result<()> {
    #[cfg(unix)]
    if !in_object_store(path) {
        let parent = path.parent().filter(|p| !p.as_os_str().is_empty());
        File::open(parent.unwrap_or(Path::new(".")))?.sync_all()?;
    }
    let _ = path; // elsewhere directories cannot be opened
    Ok(())
}

/// Removes from a directory the files that ended processes have left behind.
pub fn sweep(dir: &Path, wanted: impl Fn(&str) -> bool) {
    let Ok(entries) = fs::read_dir(dir) else { return }; // not there yet: nothing to sweep
    for entry in entries.flatten() {
        let name = entry.file_name();
        let dead = final_name(&name.to_string_lossy()).is_some_and(&wanted)
            && entry.file_type().is_ok_and(|kind| kind.is_file())
            && File::open(entry.path()).is_ok_and(|file| file.try_lock().is_ok());
        if dead {
            let _ = fs::remove_file(entry.path()); // a later run tries again
        }
    }
}

/// The final name `x` in `.x.<process>-<number>.part`.
fn final_name(part: &str) -> Option<&str> {
    let (name, owner) = part.strip_prefix('.')?.strip_suffix(".part")?.rsplit_once('.')?;
    let (process, number) = owner.split_once('-')?;
    let digits = |s: &str| !s.is_empty() && s.bytes().all(|b| b.is_ascii_digit());
    (digits(process) && digits(number)).then_some(name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::{names, place};

    #[test]
    fn what_failed_to_be_written_early_is_told_at_the_end() {
        let (dir, path) = place("x");
        let (mut part, file) = PartFile::create(&path).unwrap();
        part.sync_early().unwrap();
        part.synced_early().unwrap();
        part.syncing = Some(std::thread::spawn(|| Err(io::ErrorKind::StorageFull.into())));
        let told = part.complete(&file).unwrap_err();
        assert_eq!(told.kind(), io::ErrorKind::StorageFull);
        assert!(names(dir.path()).is_empty());
    }

    #[cfg(unix)]
    #[test]
    fn a_link_stays_a_link_and_a_device_a_device() {
        let dir = tempfile::tempdir().unwrap();
        let (link, to) = (dir.path().join("latest"), dir.path().join("night"));
        for round in ["not there yet", "there"] {
            let _ = std::os::unix::fs::symlink("night", &link);
            let (part, mut file) = PartFile::create(&link).unwrap();
            file.write_all(round.as_bytes()).unwrap();
            part.finish(&file).unwrap();
            assert_eq!(fs::read(&to).unwrap(), round.as_bytes());
            assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        }
        let refused = PartFile::create(Path::new("/dev/null")).unwrap_err();
        assert!(refused.to_string().contains("device"), "{refused}");
    }

    #[test]
    fn two_writers_of_one_name_do_not_meet() {
        let (dir, path) = place("below/x");
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
    fn leftovers_of_the_dead_are_swept_and_what_is_being_written_stays() {
        let dir = tempfile::tempdir().unwrap();
        let left = ".x.12-0.part x.12-0.part .y.12-0.part .x.part .x.12-a.part .x.1-2.part.gz";
        for name in left.split(' ') {
            fs::write(dir.path().join(name), "").unwrap();
        }
        let (_part, file) = PartFile::create(&dir.path().join("x")).unwrap();
        drop(file); // its name is still to come
        sweep(dir.path(), |name| name == "x");
        let there = names(dir.path());
        assert!(there.len() == 6 && !there.iter().any(|name| name == ".x.12-0.part"), "{there:?}");
        sweep(&dir.path().join("nowhere"), |_| true);
    }
}
