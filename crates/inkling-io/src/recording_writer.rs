//! Writes bursts as a recording; `simulate` and `convert` write recordings this way.
//!
//! In: bursts in the order that the file is to have. Out: an MCAP file with a topic for each
//! printhead, under its final name once [`RecordingWriter::finish`] was called. The same bursts and
//! options give the same bytes.

use super::burst_codec::{FILE_DESCRIPTOR_SET, SCHEMA_NAME, encode, topic};
use super::damage::RecordingError;
use super::mcap_file::{McapFile, Schema};
use super::mcap_records::{MESSAGE_HEADER, RECORD_HEADER};
use inkling_core::burst::Burst;
pub use inkling_core::burst::Compression;
use std::path::Path;

const SCHEMA: Schema = Schema(SCHEMA_NAME, FILE_DESCRIPTOR_SET);
/// Usual size of a chunk in bytes before compression: small, so that damage costs little, and large
/// enough to compress well.
pub const COMPACT_CHUNK_BYTES: u64 = 256 << 10;
/// Bytes of a message record before its data. Channel records, which begin a chunk, are counted
/// roughly by it, too.
const MESSAGE_HEAD_BYTES: u64 = (RECORD_HEADER + MESSAGE_HEADER) as u64;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WriterOptions {
    pub compression: Compression,
    /// A chunk ends before it becomes larger than this, unless a single message is larger. `None`: messages
    /// stand outside chunks and are never compressed.
    pub chunk_bytes: Option<u64>,
}

impl Default for WriterOptions {
    /// Chunks of the usual size, compressed by lz4.
    fn default() -> WriterOptions {
        WriterOptions { compression: Compression::Lz4, chunk_bytes: Some(COMPACT_CHUNK_BYTES) }
    }
}

pub struct RecordingWriter {
    file: McapFile,
    chunk_bytes: Option<u64>,
    /// Bytes, about, of the records in the chunk that is being filled.
    in_chunk: u64,
}

impl RecordingWriter {
    pub fn create(path: &Path, options: WriterOptions) -> Result<RecordingWriter, RecordingError> {
        let WriterOptions { compression, chunk_bytes } = options;
        let compression = match compression {
            Compression::None => None,
            Compression::Lz4 => Some(mcap::Compression::Lz4),
            Compression::Zstd => Some(mcap::Compression::Zstd),
        };
        let options = mcap::WriteOptions::new()
            .compression(compression)
            .use_chunks(chunk_bytes.is_some())
            .chunk_size(chunk_bytes);
        let mut file = McapFile::create(path, options)?;
        file.define(SCHEMA)?;
        let in_chunk = FILE_DESCRIPTOR_SET.len() as u64 + 64;
        Ok(RecordingWriter { file, chunk_bytes, in_chunk })
    }

    /// Appends a burst. `log_time_ns` is when it was recorded, ns since 1970; MCAP has no earlier times.
    pub fn write(&mut self, burst: &Burst, log_time_ns: u64) -> Result<(), RecordingError> {
        let topic = topic(&burst.printhead);
        if !self.file.has(&topic) {
            self.file.add(&topic, SCHEMA)?;
            self.in_chunk += topic.len() as u64 + MESSAGE_HEAD_BYTES;
        }
        let message = encode(burst);
        let bytes = message.len() as u64 + MESSAGE_HEAD_BYTES;
        if self.chunk_bytes.is_some_and(|most| self.in_chunk > 0 && self.in_chunk + bytes > most) {
            self.file.end_chunk()?;
            self.in_chunk = 0;
        }
        self.in_chunk += bytes;
        self.file.write(&topic, log_time_ns, &message)
    }

    pub fn finish(self) -> Result<(), RecordingError> {
        self.file.finish()
    }
}
