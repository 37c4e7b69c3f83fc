//! A file that exists only in memory, as a list of pieces whose bytes others share.
//!
//! `memory_recording.rs` builds one from bursts whose samples the caller holds; `source.rs` reads
//! it by offset like a file. So arrays are read like a recording and no sample is copied
//! beforehand.

use bytes::Bytes;
use std::io;

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
