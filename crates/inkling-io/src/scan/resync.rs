//! Goes on after broken framing, at the next chunk that has a checksum and verifies.
//!
//! In, from `scan.rs`: where the framing broke. Out: [`Damage`] up to that chunk, or to the end. Chunks hold nearly all
//! data, and can be recognised by themselves.

use super::{Blocks, CHUNK_HEADER_BYTES};
use crate::block::{Block, BlockKind};
use crate::chunk_loader::ChunkLoader;
use crate::damage::Damage;
use crate::mcap_records::{ChunkHeader, MAGIC, RECORD_HEADER, RecordHeader, op};

/// After broken framing, places that look like chunks are tried.
const MAX_FAILED_RESYNCS: usize = 256;

impl Blocks {
    /// Where the next chunk begins, from `from` on, that has a checksum which verifies. Every byte
    /// that could be a chunk's opcode is looked at: a plausible header first, which is cheap, then
    /// the whole chunk is loaded. `None`: there is none, or too many were tried in vain.
    fn find_chunk(&mut self, from: u64) -> std::io::Result<Option<u64>> {
        let mut loader = ChunkLoader::new(self.source.clone(), self.limits);
        let (mut at, end) = (from, self.end());
        while at < end {
            let window = self.peek(at, 1)?;
            let Some(i) = window.iter().position(|&b| b == op::CHUNK) else {
                at += window.len() as u64;
                continue;
            };
            at += i as u64;
            let chunk_bytes = self.limits.chunk_bytes;
            let bytes = self.peek(at, (RECORD_HEADER + CHUNK_HEADER_BYTES) as u64)?;
            let found = RecordHeader::parse(bytes).and_then(|record| {
                let next = at.checked_add(RECORD_HEADER as u64)?.checked_add(record.body_bytes)?;
                let body = &bytes[RECORD_HEADER..];
                let header = ChunkHeader::plausible(body, record.body_bytes, chunk_bytes)?;
                (next <= end && header.uncompressed_crc != 0).then_some(next - at)
            });

            if let Some(bytes) = found {
                let kind = BlockKind::Chunk;
                let block = Block { index: 0, offset: at, bytes, decompressed_bytes: 0, kind };
                if loader.load(&block, None).is_ok() {
                    return Ok(Some(at));
                }
                self.failed_resyncs += 1;
                if self.failed_resyncs >= MAX_FAILED_RESYNCS {
                    return Ok(None);
                }
            }
            at += 1;
        }
        Ok(None)
    }

    fn verifies(&self, chunk: &Block) -> bool {
        ChunkLoader::new(self.source.clone(), self.limits).load(chunk, None).is_ok()
    }

    /// The damage is the range from `self.at` to the next chunk that verifies, or to the end.
    pub(super) fn resync(&mut self, what: String) -> Damage {
        let from = self.known_until.max(MAGIC.len() as u64).min(self.at.saturating_add(1));
        // a recorder that died in a chunk and was started again appended to it: the chunk's length is not to be believed
        let before = self.last_chunk.take().filter(|of| of.offset + of.bytes == self.at);
        let from = before.filter(|of| !self.verifies(of)).map_or(from, |of| of.offset + 1);
        let to_byte = match self.find_chunk(from) {
            Ok(Some(chunk)) => chunk,
            Ok(None) | Err(_) => {
                self.done = true;
                self.end()
            }
        };
        // the chunk may lie before `self.at`, inside a record that was stepped over
        let from_byte = self.at.min(to_byte);
        self.at = to_byte;
        self.known_until = to_byte;
        Damage { from_byte, to_byte, what }
    }
}
