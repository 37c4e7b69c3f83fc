//! A file, or an object of a store, read by offset. No shared cursor, so workers may read side by side; never
//! mapped into memory, since a mapped file that shrinks kills the process.

use super::objects::{Object, in_object_store};
use super::regular_file;
use super::stamp::Stamp;
use std::fs::File;
use std::io;
use std::path::Path;

#[derive(Debug)]
pub struct Source {
    held: Held,
    stamp: Stamp,
}

#[derive(Debug)]
enum Held {
    File(File),
    Object(Object),
}

impl Source {
    /// An error of kind `InvalidInput` where it is no regular file.
    pub fn open(path: &Path) -> io::Result<Source> {
        if in_object_store(path) {
            let object = Object::open(path)?;
            return Ok(Source { stamp: object.stamp_then(), held: Held::Object(object) });
        }
        let file = regular_file::open(path)?;
        Ok(Source { stamp: Stamp::of(&file.metadata()?), held: Held::File(file) })
    }

    /// Length when it was opened.
    pub fn bytes(&self) -> u64 {
        self.stamp.bytes
    }

    /// When it was opened.
    pub fn stamp_then(&self) -> Stamp {
        self.stamp
    }

    /// As it is now.
    pub fn stamp(&self) -> io::Result<Stamp> {
        match &self.held {
            Held::File(file) => Ok(Stamp::of(&file.metadata()?)),
            Held::Object(object) => object.stamp(),
        }
    }

    /// Fills `buffer` from `offset`; what ends before is an error.
    pub fn read_at(&self, offset: u64, buffer: &mut [u8]) -> io::Result<()> {
        match &self.held {
            Held::File(file) => read_file_at(file, offset, buffer),
            Held::Object(object) => object.read_at(offset, buffer),
        }
    }
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
