//! A file read by offset. No shared cursor, so workers may read side by side; never mapped into
//! memory, since a mapped file that shrinks kills the process.

use super::journal::Stamp;
use std::fs::File;
use std::io;

#[derive(Debug)]
pub struct Source {
    file: File,
    bytes: u64,
}

impl Source {
    pub fn new(file: File, bytes: u64) -> Source {
        Source { file, bytes }
    }

    /// Length when it was opened.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Of the file as it is now.
    pub fn stamp(&self) -> io::Result<Stamp> {
        Ok(Stamp::of(&self.file.metadata()?))
    }

    /// Fills `buffer` from `offset`; a file that ends before is an error.
    #[cfg(unix)]
    pub fn read_at(&self, offset: u64, buffer: &mut [u8]) -> io::Result<()> {
        std::os::unix::fs::FileExt::read_exact_at(&self.file, buffer, offset)
    }

    /// Fills `buffer` from `offset`; a file that ends before is an error.
    #[cfg(windows)]
    pub fn read_at(&self, mut offset: u64, mut buffer: &mut [u8]) -> io::Result<()> {
        while !buffer.is_empty() {
            match std::os::windows::fs::FileExt::seek_read(&self.file, buffer, offset) {
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
}
