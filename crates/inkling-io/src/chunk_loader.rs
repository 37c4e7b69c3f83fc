//! The bytes of a block become its records: read, uncompressed and verified.
//!
//! In: a [`Block`], or its bytes. Out: the records in it. Used by readers of blocks, and by the scan when it
//! searches for chunks.

use super::Limits;
use super::block::{Block, BlockKind, ReadBlock};
use super::buffers::Buffers;
use super::decompress::Decompressor;
use super::mcap_records::{ChunkHeader, MESSAGE_HEADER, RECORD_HEADER};
use super::source::Source;
use bytes::Bytes;
use std::fmt;
use std::sync::Arc;

/// Loads blocks. It checks every size before it allocates, and a chunk's checksum before it gives anything
/// away.
pub(super) struct ChunkLoader {
    source: Arc<Source>,
    pub(super) limits: Limits,
    decompressor: Decompressor,
    buffers: Buffers,
}

impl fmt::Debug for ChunkLoader {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ChunkLoader").field("limits", &self.limits).finish_non_exhaustive()
    }
}

/// How many bytes of a block are read: all of them, but only the head of a block that is beyond the limit.
pub(super) fn bytes_to_read(block: &Block, limits: &Limits) -> u64 {
    /// Enough for a chunk's header with a compression whose name is not absurd.
    const CHUNK_HEAD_BYTES: u64 = 1 << 10;
    match block.kind {
        _ if block.bytes <= limits.record_bytes => block.bytes,
        BlockKind::Chunk => CHUNK_HEAD_BYTES,
        BlockKind::Messages => (RECORD_HEADER + MESSAGE_HEADER) as u64,
    }
}

/// Where in a chunk record its records lie. `None`: they are compressed, or the chunk is malformed.
pub(super) fn records_of(chunk: &[u8]) -> Option<std::ops::Range<usize>> {
    let header = ChunkHeader::parse(chunk.get(RECORD_HEADER..)?)?;
    let from = RECORD_HEADER + header.header_bytes as usize; // within the record
    let to = from.checked_add(usize::try_from(header.compressed_size).ok()?)?;
    (header.compression.is_empty() && to <= chunk.len()).then_some(from..to)
}

impl ChunkLoader {
    pub(super) fn new(source: Arc<Source>, limits: Limits) -> ChunkLoader {
        let (decompressor, buffers) = (Decompressor::default(), Buffers::default());
        ChunkLoader { source, limits, decompressor, buffers }
    }

    /// The records of a block. `read` has the bytes of [`bytes_to_read`], if somebody has read them already.
    /// An error says what is wrong with the block.
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

    /// The records of a chunk. `crc` is the checksum of its [`records_of`], if somebody has computed it
    /// already.
    fn unpack(&mut self, read: &Bytes, crc: Option<u32>) -> Result<Bytes, String> {
        let body = read.get(RECORD_HEADER..).unwrap_or_default();
        let chunk = ChunkHeader::parse(body).ok_or("chunk header is malformed")?;
        let from = RECORD_HEADER as u64 + chunk.header_bytes;
        let within = (read.len() as u64).saturating_sub(from);
        // all sizes are only claims until they are compared with what is there
        if chunk.compressed_size > within {
            return Err(format!("chunk claims {} bytes, beyond {within}", chunk.compressed_size));
        }
        if chunk.uncompressed_size > self.limits.chunk_bytes {
            return Err(format!(
                "chunk claims {} bytes uncompressed, beyond the limit of {}",
                chunk.uncompressed_size, self.limits.chunk_bytes
            ));
        }
        let packed = read.slice(from as usize..(from + chunk.compressed_size) as usize);
        let records = if chunk.compression.is_empty() {
            if chunk.compressed_size != chunk.uncompressed_size {
                return Err("chunk without compression, whose two sizes differ".into());
            }
            packed
        } else {
            let mut records = self.buffers.take(chunk.uncompressed_size as usize);
            self.decompressor
                .decompress(chunk.compression, &packed, &mut records)
                .map_err(|e| format!("chunk cannot be decompressed: {e}"))?;
            self.buffers.freeze(records)
        };
        // 0 means that the writer took no checksum
        if chunk.uncompressed_crc != 0 {
            let crc = crc.unwrap_or_else(|| crc32fast::hash(&records));
            if crc != chunk.uncompressed_crc {
                let expected = chunk.uncompressed_crc;
                return Err(format!(
                    "chunk's checksum is {crc:08x}, not {expected:08x} as recorded"
                ));
            }
        }
        Ok(records)
    }
}
