//! A block: the part of a recording that one worker decodes at a time, so that several workers
//! decode one recording side by side. `scan.rs` finds the blocks and `block_reader.rs` decodes
//! them.

use bytes::Bytes;

/// What kind of records a block consists of (MCAP records at the top level of the file).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BlockKind {
    /// One chunk record.
    Chunk,
    /// A run of schemas, channels and messages outside chunks.
    Messages,
}

/// Where a block lies in the file. Its bytes are read later, by the worker that decodes it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Block {
    pub index: u64,
    /// Offset of its first record in the file.
    pub offset: u64,
    /// Length of the block in the file, headers of its records included.
    pub bytes: u64,
    /// How many bytes more it takes in memory, where it is compressed: as many as its chunk claims
    /// to hold. Nothing is decompressed beyond that claim.
    pub decompressed_bytes: u64,
    pub kind: BlockKind,
}

impl Block {
    /// Bytes of memory that the block takes at most while its bursts are judged.
    pub fn held_bytes(&self) -> u64 {
        self.bytes + self.decompressed_bytes
    }
}

/// The bytes of a block as they stand in the file (of one that is too large only its head:
/// `chunk_loader::bytes_to_read`), read ahead by `digest.rs`, which reads the whole file for its
/// checksum anyway.
#[derive(Clone, Debug)]
pub struct ReadBlock {
    pub bytes: Bytes,
    /// CRC-32 of the records in a chunk without compression, if the digest's pass has computed it;
    /// else `None`, and the worker computes it.
    pub crc: Option<u32>,
}
