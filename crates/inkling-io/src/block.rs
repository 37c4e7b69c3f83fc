//! A part of a recording that one worker decodes at a time.

use bytes::Bytes;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BlockKind {
    /// One chunk record.
    Chunk,
    /// A run of schemas, channels and messages outside chunks.
    Messages,
}

/// What one worker decodes at a time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Block {
    /// Place among the blocks, from 0; restores the order after parallel decoding.
    pub index: u64,
    /// Of its first record, in the file.
    pub offset: u64,
    pub bytes: u64,
    pub kind: BlockKind,
}

/// A block's bytes.
#[derive(Clone, Debug)]
pub struct ReadBlock {
    pub bytes: Bytes,
    /// Checksum of a chunk's uncompressed records, where the data section's went over them.
    pub crc: Option<u32>,
}
