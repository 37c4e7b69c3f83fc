//! Computes a recording's digest while its blocks are read, so that every byte is read from disk
//! once.
//!
//! The digest (xxh3-128 of the whole file) names a recording's content in the journal and in the
//! metadata of results. In, from the read stage (`src/pipeline/stages.rs`): blocks in file order,
//! by [`Digester::read`]. Out: each block's bytes, for a worker to decode; and at the end, by
//! [`Digester::finish`], a [`Digest`], with the verdict on the data section's checksum (a CRC-32)
//! if the file has one. That checksum is the only one that covers messages outside chunks.
//!
//! What lies between blocks is read and summed up, too. A chunk without compression has a CRC-32 of
//! its own over a part of the same bytes; one pass serves both (`ChunkRecords`).

use super::Limits;
use super::block::{Block, BlockKind, ReadBlock};
use super::chunk_loader::{Buffers, bytes_to_read, records_of};
use super::damage::{Damage, RecordingError};
use super::file_error::FileError;
use super::source::Source;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use xxhash_rust::xxh3::{Xxh3, xxh3_128};

/// The xxh3-128 of a whole recording, and damage if its data section does not agree with the
/// checksum that the file itself holds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Digest {
    /// `xxh3:` and 32 hexadecimal digits.
    pub text: String,
    pub damage: Option<Damage>,
}

/// How digests are written: `xxh3:` and 32 hexadecimal digits.
pub fn in_words(digest: u128) -> String {
    format!("xxh3:{digest:032x}")
}

pub fn of_bytes(bytes: &[u8]) -> String {
    in_words(xxh3_128(bytes))
}

pub fn of_file<E: From<std::io::Error>>(
    path: &Path,
    mut check: impl FnMut(u64) -> Result<(), E>,
) -> Result<String, E> {
    const PART: u64 = 1 << 20;
    let source = Source::open(path)?;
    let mut xxh3 = Xxh3::new();
    let mut part = vec![0; PART as usize];
    let mut at = 0;
    while at < source.bytes() {
        let part = &mut part[..(source.bytes() - at).min(PART) as usize];
        source.read_at(at, part)?;
        check(part.len() as u64)?;
        xxh3.update(part);
        at += part.len() as u64;
    }
    Ok(in_words(xxh3.digest128()))
}

pub struct Digester {
    path: PathBuf,
    source: Arc<Source>,
    limits: Limits,
    buffers: Buffers,
    xxh3: Xxh3,
    crc: crc32fast::Hasher,
    /// The byte at which the data section's checksum ends (it begins at byte 0), and what it should
    /// be. `None`: the file has none.
    data: Option<(u64, u32)>,
    /// The next byte to be read: all before it have been summed up.
    at: u64,
}

impl Digester {
    pub(super) fn new(
        path: PathBuf,
        source: Arc<Source>,
        limits: Limits,
        data: Option<(u64, u32)>,
    ) -> Digester {
        Digester {
            path,
            source,
            limits,
            buffers: Buffers::default(),
            xxh3: Xxh3::new(),
            crc: crc32fast::Hasher::new(),
            data: data.filter(|&(_, crc)| crc != 0),
            at: 0,
        }
    }

    /// The bytes of a block, for [`load_read`](super::block_reader::BlockReader::load_read); `None`
    /// if the digester is beyond the block's begin, so that the worker must read the block itself.
    /// `check` is called before each part between blocks that is read, and an error of `check` ends
    /// the reading.
    pub fn read<E: From<RecordingError>>(
        &mut self,
        block: &Block,
        check: impl FnMut() -> Result<(), E>,
    ) -> Result<Option<ReadBlock>, E> {
        if block.offset < self.at {
            return Ok(None);
        }
        self.pass(block.offset, check)?;
        let buffer = self.buffers.take(bytes_to_read(block, &self.limits) as usize);
        Ok(Some(self.take(buffer, Some(block.kind))?))
    }

    fn pass<E: From<RecordingError>>(
        &mut self,
        to: u64,
        mut check: impl FnMut() -> Result<(), E>,
    ) -> Result<(), E> {
        // so much is read at once where nobody wants the bytes
        const PART: u64 = 1 << 20;
        while self.at < to {
            check()?;
            let buffer = self.buffers.take((to - self.at).min(PART) as usize);
            self.take(buffer, None)?;
        }
        Ok(())
    }

    fn take(
        &mut self,
        mut buffer: bytes::BytesMut,
        kind: Option<BlockKind>,
    ) -> Result<ReadBlock, RecordingError> {
        // small enough for the processor's cache
        const PART: usize = 1 << 16;
        // how many of these bytes the data section's checksum covers: all, none, or the first ones
        let checked = self.data.map_or(0, |(end, _)| end.saturating_sub(self.at));
        let checked = checked.min(buffer.len() as u64) as usize;

        let mut records: Option<ChunkRecords> = None;
        for from in (0..buffer.len()).step_by(PART) {
            let to = (from + PART).min(buffer.len());
            self.source
                .read_at(self.at + from as u64, &mut buffer[from..to])
                .map_err(FileError::unread(&self.path))?;
            if from == 0 && kind == Some(BlockKind::Chunk) && checked == buffer.len() {
                // The header of a chunk lies in its first part. If the chunk has no compression,
                // its records get their own checksum on the way. (Only where the data section's
                // checksum covers the whole chunk: elsewhere the worker computes it.)
                records = records_of(&buffer).map(ChunkRecords::new);
            }
            self.xxh3.update(&buffer[from..to]);
            match &mut records {
                Some(of) => of.take(&buffer[from..to], from, &mut self.crc),
                None => self.crc.update(&buffer[from.min(checked)..to.min(checked)]),
            }
        }
        self.at += buffer.len() as u64;
        let crc = records.map(|of| of.crc.finalize());
        Ok(ReadBlock { bytes: self.buffers.freeze(buffer), crc })
    }

    pub fn finish<E: From<RecordingError>>(
        mut self,
        check: impl FnMut() -> Result<(), E>,
    ) -> Result<Digest, E> {
        self.pass(self.source.bytes(), check)?;
        let crc = self.crc.finalize();
        let damage = self.data.filter(|&(_, expected)| expected != crc).map(|(to_byte, expected)| {
            let what = format!(
                "data section: its checksum is {crc:08x}, not {expected:08x} as recorded; it was changed"
            );
            Damage { from_byte: 0, to_byte, what }
        });
        Ok(Digest { text: in_words(self.xxh3.digest128()), damage })
    }
}

/// The records of a chunk without compression have a checksum of their own. CRC-32 of adjacent
/// ranges can be combined, so these bytes are summed up once for it and for the data section's.
struct ChunkRecords {
    /// Where in the block the records lie.
    range: Range<usize>,
    crc: crc32fast::Hasher,
}

impl ChunkRecords {
    fn new(range: Range<usize>) -> ChunkRecords {
        ChunkRecords { range, crc: crc32fast::Hasher::new() }
    }

    fn take(&mut self, part: &[u8], from: usize, all: &mut crc32fast::Hasher) {
        let Range { start, end } = self.range;
        let within = |at: usize| at.clamp(from, from + part.len()) - from;
        all.update(&part[..within(start)]);
        self.crc.update(&part[within(start)..within(end)]);
        if (from..from + part.len()).contains(&end.saturating_sub(1)) {
            all.combine(&self.crc);
        }
        all.update(&part[within(end)..]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn property_records_in_parts_have_the_checksums_of_the_whole() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(23);
        for _ in 0..500 {
            let before: Vec<u8> = (0..9).map(|_| rng.random()).collect();
            let block: Vec<u8> = (0..rng.random_range(1..300)).map(|_| rng.random()).collect();
            let start = rng.random_range(0..=block.len());
            let end = rng.random_range(start..=block.len());
            let mut all = crc32fast::Hasher::new();
            all.update(&before);
            let mut records = ChunkRecords::new(start..end);
            let part = rng.random_range(1..=block.len());
            for (k, bytes) in block.chunks(part).enumerate() {
                records.take(bytes, k * part, &mut all);
            }
            assert_eq!(records.crc.finalize(), crc32fast::hash(&block[start..end]));
            assert_eq!(all.finalize(), crc32fast::hash(&[before, block].concat()));
        }
    }
}
