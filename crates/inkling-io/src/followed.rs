//! Reads a recording that is still being written, for `replay --follow`.
//!
//! In: a path, and a flag by which the caller says that it is enough. Out: a [`Recording`] whose
//! blocks come as soon as they are whole ([`Recording::next_block`], which waits for them), until
//! the footer is there or the flag is set; then the recording as a whole ([`Recording::closed`]).
//! Only files can be followed: an object of a store appears when it is complete.
//!
//! The file is looked at every 20 ms (polling). If it shrinks or another file takes its place, that
//! is an error, so that no verdicts mix two recordings.

use super::Limits;
use super::block::Block;
use super::damage::{Damage, RecordingError};
use super::dialect::Dialects;
use super::file_error::FileError;
use super::growth::{Growth, locked};
use super::mcap_records::MAGIC;
use super::recording::{Recording, check_magic, magic, open_source};
use super::scan::Blocks;
use super::stamp::Stamp;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex};
use std::task::Poll;
use std::time::Duration;

/// Time between two looks at a file that did not grow.
const LOOK_EVERY: Duration = Duration::from_millis(20);

impl Recording {
    /// Opens a file that is being written, after waiting for its first bytes.
    pub fn follow(
        path: &Path,
        limits: Limits,
        dialects: &Dialects,
        enough: Arc<AtomicBool>,
    ) -> Result<Recording, RecordingError> {
        let source = Arc::new(open_source(path)?);
        let (over, ends) = (Mutex::new(false), Arc::default());
        let growth = Growth { enough, over, ends, closed: false };
        loop {
            let magic = magic(path, &source)?;
            // the magic bytes are there, or cannot come any more: the check below passes or fails
            // for good
            if magic.len() == MAGIC.len() || !MAGIC.starts_with(&magic) || growth.is_enough() {
                check_magic(path, &magic)?;
                break;
            }
            std::thread::sleep(LOOK_EVERY);
            source.grow().map_err(FileError::unread(path))?;
        }
        let mut recording =
            Recording::of_source(path, source, limits, dialects)?.unindexed(dialects);
        recording.growth = Some(growth);
        Ok(recording)
    }

    pub fn is_growing(&self) -> bool {
        self.growth.as_ref().is_some_and(|growth| !growth.closed)
    }

    pub fn next_block<E: From<RecordingError>>(
        &self,
        blocks: &mut Blocks,
        check: impl Fn() -> Result<(), E>,
    ) -> Result<Option<Result<Block, Damage>>, E> {
        loop {
            let over = self.growth.as_ref().is_none_or(|growth| *locked(&growth.over));
            match blocks.poll() {
                Poll::Ready(found) => return Ok(found),
                // `over` was read before the blocks were looked at, so nothing came in between
                Poll::Pending if over => {
                    blocks.close();
                    return Ok(None);
                }
                Poll::Pending => {}
            }
            check()?;
            if !self.grow()? {
                std::thread::sleep(LOOK_EVERY);
            }
        }
    }

    /// Takes in what was written since the last look. Gives whether another look at the blocks is
    /// worth it at once.
    fn grow(&self) -> Result<bool, RecordingError> {
        let Some(growth) = &self.growth else { return Ok(true) };
        // one reader looks at a time, and once the recording is over nobody looks any more
        let mut over = locked(&growth.over);
        *over |= growth.is_enough();
        if *over {
            return Ok(true);
        }
        let (before, now) = self.source.grow().map_err(FileError::unread(&self.path))?;
        self.check_file(before, now)?;
        Ok(now > before)
    }

    /// The recording that was followed, opened again as a whole: with the summary that its writer
    /// wrote last, or cut off where the caller had enough.
    pub fn closed(&self, dialects: &Dialects) -> Result<Recording, RecordingError> {
        let source = self.source.clone();
        let now = source.stamp().map_err(FileError::unread(&self.path))?;
        self.check_file(source.bytes(), now.bytes)?;
        let mut closed = Recording::of_source(&self.path, source, self.limits, dialects)?;
        closed.stamp = Stamp { bytes: closed.bytes, ..now };
        (closed.opening, closed.label) = (self.opening, self.label.clone());
        if let Some(growth) = &self.growth {
            if growth.is_enough() && !closed.is_indexed() {
                closed.damage.clear(); // it has no end because the caller ended it
            }
            let (enough, ends) = (growth.enough.clone(), growth.ends.clone());
            closed.growth = Some(Growth { enough, over: Mutex::new(true), ends, closed: true });
        }
        Ok(closed)
    }

    /// Whether the recording was cut off because the caller had enough before its writer closed it.
    pub fn is_cut_off(&self) -> bool {
        let is_enough = self.growth.as_ref().is_some_and(|growth| growth.is_enough());
        is_enough && !self.is_indexed()
    }

    /// Refuses a file that is no longer the one that was read; a read that failed may have failed for that
    /// reason.
    pub fn check_same(&self) -> Result<(), RecordingError> {
        let now = self.source.stamp().map_err(FileError::unread(&self.path))?;
        self.check_file(self.source.bytes(), now.bytes)
    }

    /// Refuses a file that shrank from `before` to `now` bytes, or whose name another file has
    /// taken.
    fn check_file(&self, before: u64, now: u64) -> Result<(), RecordingError> {
        let what = match self.source.lies_at(&self.path) {
            _ if now < before => format!("shrank from {before} to {now} bytes"),
            // if nothing lies under its name, the file may have been renamed; it is read on
            Ok(true) | Err(_) => return Ok(()),
            Ok(false) => "was replaced by another file".into(),
        };
        let what = format!(
            "{what} while it was followed: what was told of it belongs to no one recording; follow it again, \
             or replay it when it is closed"
        );
        Err(FileError::failed(&self.path, what).into())
    }
}
