//! Loads a block: reads its bytes, and gives the MCAP records in it.
//!
//! In, from `block_reader.rs`, or from `scan.rs`, which tries whether a chunk verifies: a
//! [`Block`], and its bytes if the digest's pass (`digest.rs`) has read them already. Out: the
//! bytes of the records. Those of a chunk are decompressed, and verified if the chunk has a
//! checksum; those outside chunks are handed on as they are, since only the checksum of the whole
//! data section covers them ([`super::digest`]). Why a block cannot be used is said in a sentence,
//! which the block reader makes damage of.

use super::Limits;
use super::block::{Block, BlockKind, ReadBlock};
use super::decompress::Decompressor;
use super::mcap_records::{ChunkHeader, MESSAGE_HEADER, RECORD_HEADER};
use super::source::Source;
use bytes::{Bytes, BytesMut};
use std::collections::VecDeque;
use std::sync::Arc;

pub(super) struct ChunkLoader {
    source: Arc<Source>,
    pub(super) limits: Limits,
    decompressor: Decompressor,
    buffers: Buffers,
}

/// How many bytes of a block are read: all of them, or only its head if the block is larger than
/// [`Limits::record_bytes`].
pub(super) fn bytes_to_read(block: &Block, limits: &Limits) -> u64 {
    /// Enough for the header of a chunk record: 9 bytes of any record, 40 of a chunk, and the name of the
    /// compression, a few letters.
    const CHUNK_HEAD_BYTES: u64 = 1 << 10;
    match block.kind {
        _ if block.bytes <= limits.record_bytes => block.bytes,
        BlockKind::Chunk => CHUNK_HEAD_BYTES,
        BlockKind::Messages => (RECORD_HEADER + MESSAGE_HEADER) as u64,
    }
}

/// Where in the bytes of a chunk record the records inside it lie, counted from its first byte.
/// `None`: they are compressed, the header is malformed, or `chunk` ends before they do.
pub(super) fn records_of(chunk: &[u8]) -> Option<std::ops::Range<usize>> {
    let header = ChunkHeader::parse(chunk.get(RECORD_HEADER..)?)?;
    let from = RECORD_HEADER + header.header_bytes as usize;
    let to = from.checked_add(usize::try_from(header.compressed_size).ok()?)?;
    (header.compression.is_empty() && to <= chunk.len()).then_some(from..to)
}

impl ChunkLoader {
    pub(super) fn new(source: Arc<Source>, limits: Limits) -> ChunkLoader {
        let (decompressor, buffers) = (Decompressor::default(), Buffers::default());
        ChunkLoader { source, limits, decompressor, buffers }
    }

    /// The records of a block, or a sentence on why there are none. `read`: as many of its bytes as
    /// [`bytes_to_read`] says, if they were read before. Of a message larger than [`Limits::record_bytes`] only the
    /// head is given; the block reader makes `too_large` of it.
    pub(super) fn load(&mut self, block: &Block, read: Option<ReadBlock>) -> Result<Bytes, String> {
        let ReadBlock { bytes: read, crc } = match read {
            Some(read) => read,
            None => {
                let mut buffer = self.buffers.take(bytes_to_read(block, &self.limits) as usize);
                self.source
                    .read_at(block.offset, &mut buffer)
                    .map_err(|e| format!("block cannot be read: {e}"))?;
                ReadBlock { bytes: self.buffers.freeze(buffer), crc: None }
            }
        };
        match block.kind {
            BlockKind::Messages => Ok(read),
            BlockKind::Chunk => self.unpack(&read, crc),
        }
    }

    /// The records inside a chunk record. `crc`: their checksum, if the digest's pass has computed
    /// it, which it does only for chunks without compression ([`records_of`]).
    fn unpack(&mut self, read: &Bytes, crc: Option<u32>) -> Result<Bytes, String> {
        let body = read.get(RECORD_HEADER..).unwrap_or_default();
        let header = ChunkHeader::parse(body).ok_or("chunk header is malformed")?;
        let ChunkHeader { compression, compressed_size, uncompressed_size, .. } = header;
        let from = RECORD_HEADER as u64 + header.header_bytes;
        let within = (read.len() as u64).saturating_sub(from);
        // all sizes are only claims until they are compared with what is there
        if compressed_size > within {
            return Err(format!("chunk claims {compressed_size} bytes, beyond {within}"));
        }
        let most = self.limits.chunk_bytes;
        if uncompressed_size > most {
            let what =
                format!("{uncompressed_size} bytes uncompressed, beyond the limit of {most}");
            return Err(format!("chunk claims {what}"));
        }
        let packed = read.slice(from as usize..(from + compressed_size) as usize);

        // records without compression stay where they were read: no copy
        let records = if compression.is_empty() {
            if compressed_size != uncompressed_size {
                return Err("chunk without compression, whose two sizes differ".into());
            }
            packed
        } else {
            let mut records = self.buffers.take(uncompressed_size as usize);
            self.decompressor
                .decompress(compression, &packed, &mut records)
                .map_err(|e| format!("chunk cannot be decompressed: {e}"))?;
            self.buffers.freeze(records)
        };

        // MCAP writes 0 where there is no checksum
        let expected = header.uncompressed_crc;
        if expected == 0 {
            return Ok(records);
        }
        match crc.unwrap_or_else(|| crc32fast::hash(&records)) {
            crc if crc == expected => Ok(records),
            crc => Err(format!("chunk's checksum is {crc:08x}, not {expected:08x} as recorded")),
        }
    }
}

/// Memory for chunks that is used again, so that a long recording allocates little.
///
/// A buffer is taken, filled, and frozen: from then on bursts share it as `Bytes`. A further reference to it is kept
/// here. Once that is the only one (all bursts of the chunk are done with), the buffer can be taken again. Each
/// `ChunkLoader` has a set of its own, and so has the digester.
#[derive(Debug, Default)]
pub(super) struct Buffers {
    given: VecDeque<Bytes>,
}

impl Buffers {
    /// Larger buffers are not kept: bounded memory is worth a few page faults for each huge chunk.
    const KEPT_BYTES: usize = 8 << 20;
    const KEPT: usize = 24;

    /// A buffer of exactly `bytes` bytes, whose content is undefined (old bytes or zeros).
    pub(super) fn take(&mut self, bytes: usize) -> BytesMut {
        // free buffers, the last one given out first: the processor's cache may still hold it
        let free = self.given.iter().enumerate().rev().filter(|(_, b)| b.is_unique());
        // The smallest buffer that is large enough, as growing one fills it with zeros first. Too
        // small buffers come last; one is taken out, and replaced below unless its capacity, which
        // may exceed its length, suffices.
        let free = free.min_by_key(|(_, b)| if b.len() < bytes { usize::MAX } else { b.len() });
        let free = free.map(|(i, _)| i).and_then(|i| self.given.remove(i));
        match free.and_then(|b| b.try_into_mut().ok()) {
            Some(mut buffer) if buffer.capacity() >= bytes => {
                buffer.resize(bytes, 0);
                buffer
            }
            _ => BytesMut::zeroed(bytes),
        }
    }

    pub(super) fn freeze(&mut self, buffer: BytesMut) -> Bytes {
        let frozen = buffer.freeze();
        if frozen.len() <= Self::KEPT_BYTES {
            self.given.push_back(frozen.clone());
            if self.given.len() > Self::KEPT {
                self.given.pop_front();
            }
        }
        frozen
    }
}
