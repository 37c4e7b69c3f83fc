//! Bursts to a recording.
//!
//! In: bursts in file order. Out: an MCAP file under its final name once [`RecordingWriter::finish`]
//! was called; the same bursts and options give the same bytes.

use super::burst_codec::{FILE_DESCRIPTOR_SET, MESSAGE_ENCODING, SCHEMA_NAME, encode, topic};
use super::damage::RecordingError;
use super::mcap_file::McapFile;
use super::mcap_records::{MESSAGE_HEADER, RECORD_HEADER};
use inkling_core::burst::Burst;
use mcap::records::MessageHeader;
use std::collections::{BTreeMap, HashMap};
use std::path::Path;
use std::sync::Arc;

/// Small, so that damage costs little; large enough to compress well.
pub const COMPACT_CHUNK_BYTES: u64 = 256 << 10;
/// Of a message before its data; what begins a chunk (schemas and channels) is less than the rest.
const MESSAGE_HEAD_BYTES: u64 = (RECORD_HEADER + MESSAGE_HEADER) as u64;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Compression {
    Zstd,
    Lz4,
    None,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WriterOptions {
    pub compression: Compression,
    /// A chunk ends before it is larger, where a message is not so by itself. `None`: messages outside
    /// chunks, never compressed.
    pub chunk_bytes: Option<u64>,
}

impl Default for WriterOptions {
    fn default() -> WriterOptions {
        WriterOptions { compression: Compression::Lz4, chunk_bytes: Some(COMPACT_CHUNK_BYTES) }
    }
}

pub struct RecordingWriter {
    file: McapFile,
    schema_id: u16,
    chunk_bytes: Option<u64>,
    /// Of records in the chunk at hand.
    in_chunk: u64,
    /// Channel id and next sequence number by printhead.
    channels: HashMap<Arc<str>, (u16, u32)>,
}

impl RecordingWriter {
    pub fn create(path: &Path, options: WriterOptions) -> Result<RecordingWriter, RecordingError> {
        let chunk_bytes = options.chunk_bytes;
        let mut file = McapFile::create(path, mcap_options(options))?;
        let schema_id = file
            .with(|writer| writer.add_schema(SCHEMA_NAME, MESSAGE_ENCODING, FILE_DESCRIPTOR_SET))?;
        Ok(RecordingWriter {
            file,
            schema_id,
            chunk_bytes,
            in_chunk: FILE_DESCRIPTOR_SET.len() as u64 + 64,
            channels: HashMap::new(),
        })
    }

    /// Appends a burst. `log_time_ns` is when it was recorded; MCAP knows no time before 1970.
    pub fn write(&mut self, burst: &Burst, log_time_ns: u64) -> Result<(), RecordingError> {
        self.file.with(|writer| {
            let (channel_id, sequence) = match self.channels.get_mut(&burst.printhead) {
                Some(channel) => channel,
                None => {
                    let topic = topic(&burst.printhead);
                    let none = BTreeMap::new();
                    let id = writer.add_channel(self.schema_id, &topic, MESSAGE_ENCODING, &none)?;
                    self.in_chunk += topic.len() as u64 + MESSAGE_HEAD_BYTES;
                    self.channels.entry(burst.printhead.clone()).or_insert((id, 0))
                }
            };
            let header = MessageHeader {
                channel_id: *channel_id,
                sequence: *sequence,
                log_time: log_time_ns,
                publish_time: log_time_ns,
            };
            *sequence = sequence.wrapping_add(1);
            let message = encode(burst);
            let bytes = message.len() as u64 + MESSAGE_HEAD_BYTES;
            if self
                .chunk_bytes
                .is_some_and(|most| self.in_chunk > 0 && self.in_chunk + bytes > most)
            {
                writer.flush()?;
                self.in_chunk = 0;
            }
            self.in_chunk += bytes;
            writer.write_to_known_channel(&header, &message)
        })
    }

    /// Completes the recording and gives it its name.
    pub fn finish(self) -> Result<(), RecordingError> {
        self.file.finish()
    }
}

fn mcap_options(options: WriterOptions) -> mcap::WriteOptions {
    mcap::WriteOptions::new()
        .library("inkling")
        .compression(match options.compression {
            Compression::None => None,
            Compression::Lz4 => Some(mcap::Compression::Lz4),
            Compression::Zstd => Some(mcap::Compression::Zstd),
        })
        // Same bytes on every machine: the default is a thread per core.
        .compression_threads(0)
        .use_chunks(options.chunk_bytes.is_some())
        .chunk_size(options.chunk_bytes)
}
