//! Reads the bytes of a recording by offset, wherever they lie: in a file, an object of a store, or
//! memory.
//!
//! `recording.rs` opens a source; scan, block readers and digester share it. There is no shared
//! cursor, so workers may read side by side. A file is never mapped into memory, since a mapped
//! file that shrinks kills the process.

use super::objects::{Object, in_object_store};
use super::regular_file;
use super::stamp::Stamp;
use bytes::Bytes;
use std::fs::{File, Metadata};
use std::io;
use std::path::Path;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};

#[derive(Debug)]
pub struct Source {
    storage: Storage,
    /// Size and time of change when the source was opened.
    stamp: Stamp,
    /// How many bytes count: more and more if the file is being written ([`Source::grow`]).
    bytes: AtomicU64,
    /// The first error of the disk or the store. Whoever met it went on without what was to be read, as if the
    /// recording were damaged, which it may not be.
    failed: OnceLock<(io::ErrorKind, String)>,
}

#[derive(Debug)]
enum Storage {
    File(File),
    Object(Object),
    Memory(Pieces),
}

impl Source {
    pub fn open(path: &Path) -> io::Result<Source> {
        if in_object_store(path) {
            let object = Object::open(path)?;
            return Ok(Source::new(object.stamp_then(), Storage::Object(object)));
        }
        let file = regular_file::open(path)?;
        Ok(Source::new(Stamp::of(&file.metadata()?), Storage::File(file)))
    }

    pub fn in_memory(pieces: Pieces) -> Source {
        let stamp = Stamp { bytes: pieces.bytes(), modified_ns: None };
        Source::new(stamp, Storage::Memory(pieces))
    }

    fn new(stamp: Stamp, storage: Storage) -> Source {
        Source { storage, stamp, bytes: AtomicU64::new(stamp.bytes), failed: OnceLock::new() }
    }

    /// The source's length: when it was opened, or as far as it has grown or was cut since.
    pub fn bytes(&self) -> u64 {
        self.bytes.load(Ordering::Acquire)
    }

    /// Takes in what was written to the file since the last look; gives the length before and now.
    pub fn grow(&self) -> io::Result<(u64, u64)> {
        // a file that shrank keeps its length here; reading beyond its end is an error then
        let (before, now) = (self.bytes(), self.stamp()?.bytes);
        if now > before {
            self.bytes.store(now, Ordering::Release);
        }
        Ok((before, now))
    }

    pub fn cut(&self, bytes: u64) {
        self.bytes.store(bytes, Ordering::Release);
    }

    /// Whether the path still leads to the opened file.
    pub fn lies_at(&self, path: &Path) -> io::Result<bool> {
        match &self.storage {
            Storage::File(file) => is_same(&file.metadata()?, &path.metadata()?),
            Storage::Object(_) | Storage::Memory(_) => Ok(true),
        }
    }

    pub fn stamp_then(&self) -> Stamp {
        self.stamp
    }

    /// The source's size and time of change now; of an object the server is asked.
    pub fn stamp(&self) -> io::Result<Stamp> {
        match &self.storage {
            Storage::File(file) => Ok(Stamp::of(&file.metadata()?)),
            Storage::Object(object) => object.stamp(),
            Storage::Memory(_) => Ok(self.stamp),
        }
    }

    /// Fills `buffer` with the bytes from `offset` on; a source that ends before is an error.
    pub fn read_at(&self, offset: u64, buffer: &mut [u8]) -> io::Result<()> {
        let read = match &self.storage {
            Storage::File(file) => read_file_at(file, offset, buffer),
            Storage::Object(object) => object.read_at(offset, buffer),
            Storage::Memory(pieces) => pieces.read_at(offset, buffer),
        };
        // a source that is shorter than it says of itself is damaged
        if let Err(e) = &read
            && e.kind() != io::ErrorKind::UnexpectedEof
        {
            let _ = self.failed.set((e.kind(), e.to_string())); // the first one stays
        }
        read
    }

    /// An error if the disk or the store has ever refused to give bytes.
    pub fn check_read(&self) -> io::Result<()> {
        self.failed.get().map_or(Ok(()), |(kind, what)| Err(io::Error::new(*kind, what.clone())))
    }
}

/// A file that exists only in memory, as a list of pieces whose bytes others share: so arrays are read like a
/// recording (`memory_recording.rs`), and no sample is copied beforehand.
#[derive(Debug, Default)]
pub struct Pieces {
    /// Each piece with the offset at which it begins; none is empty.
    pieces: Vec<(u64, Bytes)>,
    /// Bytes of all pieces together, which is where the next piece begins.
    bytes: u64,
}

impl Pieces {
    /// Appends a piece; an empty one is left out.
    pub fn push(&mut self, piece: Bytes) {
        let (begins, length) = (self.bytes, piece.len() as u64);
        if length > 0 {
            self.pieces.push((begins, piece));
            self.bytes += length;
        }
    }

    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Fills `buffer` with the bytes from `offset` on. It is an error if there are fewer bytes.
    pub fn read_at(&self, offset: u64, mut buffer: &mut [u8]) -> io::Result<()> {
        let ends_before = |(begins, piece): &(u64, Bytes)| begins + piece.len() as u64 <= offset;
        let mut at = offset;
        for (begins, piece) in &self.pieces[self.pieces.partition_point(ends_before)..] {
            if buffer.is_empty() {
                break;
            }
            let from = &piece[(at - begins) as usize..];
            let (now, later) = buffer.split_at_mut(from.len().min(buffer.len()));
            now.copy_from_slice(&from[..now.len()]);
            at += now.len() as u64;
            buffer = later;
        }
        if buffer.is_empty() { Ok(()) } else { Err(io::ErrorKind::UnexpectedEof.into()) }
    }
}

/// Whether two files are the same, by device and number.
#[cfg(unix)]
fn is_same(a: &Metadata, b: &Metadata) -> io::Result<bool> {
    use std::os::unix::fs::MetadataExt;
    Ok((a.dev(), a.ino()) == (b.dev(), b.ino()))
}

/// Whether two files are the same. Windows tells no number here, so two files that were created at
/// the same time (to 100 ns) are taken for one.
#[cfg(windows)]
fn is_same(a: &Metadata, b: &Metadata) -> io::Result<bool> {
    use std::os::windows::fs::MetadataExt;
    Ok(a.creation_time() == b.creation_time())
}

#[cfg(unix)]
fn read_file_at(file: &File, offset: u64, buffer: &mut [u8]) -> io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, buffer, offset)
}

#[cfg(windows)]
fn read_file_at(file: &File, mut offset: u64, mut buffer: &mut [u8]) -> io::Result<()> {
    while !buffer.is_empty() {
        match std::os::windows::fs::FileExt::seek_read(file, buffer, offset) {
            Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
            Ok(n) => {
                buffer = &mut buffer[n..];
                offset += n as u64;
            }
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            Err(e) => return Err(e),
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_read_like_the_whole() {
        let mut pieces = Pieces::default();
        for piece in ["ab", "", "c", "defg"] {
            pieces.push(Bytes::from_static(piece.as_bytes()));
        }
        for from in 0..=7 {
            for to in from..=7 {
                let mut read = vec![0; to - from];
                pieces.read_at(from as u64, &mut read).unwrap();
                assert_eq!(read, b"abcdefg"[from..to]);
            }
            assert!(pieces.read_at(from as u64, &mut vec![0; 8 - from]).is_err());
        }
    }
}
