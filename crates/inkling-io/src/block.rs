//! A block: the part of a recording that one worker decodes at a time. `scan.rs` finds the blocks,
//! `block_reader.rs` decodes them.

use bytes::Bytes;

/// What a block consists of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BlockKind {
    /// One chunk record.
    Chunk,
    /// A run of schemas, channels and messages outside chunks.
    Messages,
}

/// Where a block lies in the file; its bytes are read later, by the worker that decodes it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Block {
    /// Place among the blocks, from 0. It restores the order after several workers decoded blocks side by
    /// side.
    pub index: u64,
    /// Offset of its first record in the file.
    pub offset: u64,
    pub bytes: u64,
    pub kind: BlockKind,
}

/// The bytes of a block.
#[derive(Clone, Debug)]
pub struct ReadBlock {
    pub bytes: Bytes,
    /// Checksum of a chunk's uncompressed records, if it was computed over them already with the checksum of
    /// the data section.
    pub crc: Option<u32>,
}
