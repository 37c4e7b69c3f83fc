//! Bursts to a recording.
//!
//! In: bursts in file order. Out: an MCAP file under its final name once [`RecordingWriter::finish`]
//! was called; the same bursts and options give the same bytes.

use super::burst_codec::{FILE_DESCRIPTOR_SET, MESSAGE_ENCODING, SCHEMA_NAME, encode, topic};
use super::damage::RecordingError;
use super::part_file::PartFile;
use crate::burst::Burst;
use mcap::records::MessageHeader;
use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;
use std::sync::Arc;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Compression {
    None,
    Lz4,
    Zstd,
}

/// Small, so that damage costs little; large enough to compress well.
pub const COMPACT_CHUNK_BYTES: u64 = 256 << 10;
/// Of a record before its body; what begins a chunk (schemas and channels) is less than the rest.
const RECORD_HEADER_BYTES: u64 = 9 + 22;

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
    // Some until finished or dropped.
    writer: Option<mcap::Writer<BufWriter<File>>>,
    part: Option<PartFile>,
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
        let options = mcap_options(options);
        let (part, file) = PartFile::create(path)
            .map_err(|source| RecordingError::Write { path: path.to_path_buf(), source })?;
        let mcap_failed = |source| RecordingError::Mcap { path: path.to_path_buf(), source };
        let buffered = BufWriter::with_capacity(1 << 16, file);
        let mut writer = options.create(buffered).map_err(mcap_failed)?;
        let schema_id = writer
            .add_schema(SCHEMA_NAME, MESSAGE_ENCODING, FILE_DESCRIPTOR_SET)
            .map_err(mcap_failed)?;
        Ok(RecordingWriter {
            writer: Some(writer),
            part: Some(part),
            schema_id,
            chunk_bytes,
            in_chunk: FILE_DESCRIPTOR_SET.len() as u64 + 64,
            channels: HashMap::new(),
        })
    }

    /// Appends a burst. `log_time_ns` is when it was recorded; MCAP knows no time before 1970.
    pub fn write(&mut self, burst: &Burst, log_time_ns: u64) -> Result<(), RecordingError> {
        self.try_write(burst, log_time_ns).map_err(|source| self.failed(source))
    }

    fn try_write(&mut self, burst: &Burst, log_time_ns: u64) -> Result<(), mcap::McapError> {
        let Some(writer) = &mut self.writer else {
            return Err(mcap::McapError::AttemptedWriteAfterFailure);
        };
        let (channel_id, sequence) = match self.channels.get_mut(&burst.printhead) {
            Some(channel) => channel,
            None => {
                let topic = topic(&burst.printhead);
                let none = BTreeMap::new();
                let id = writer.add_channel(self.schema_id, &topic, MESSAGE_ENCODING, &none)?;
                self.in_chunk += topic.len() as u64 + RECORD_HEADER_BYTES;
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
        let bytes = message.len() as u64 + RECORD_HEADER_BYTES;
        if self.chunk_bytes.is_some_and(|most| self.in_chunk > 0 && self.in_chunk + bytes > most) {
            writer.flush()?;
            self.in_chunk = 0;
        }
        self.in_chunk += bytes;
        writer.write_to_known_channel(&header, &message)
    }

    /// Completes the recording and gives it its name.
    pub fn finish(mut self) -> Result<(), RecordingError> {
        let finished = match &mut self.writer {
            Some(writer) => writer.finish().map(drop),
            None => Err(mcap::McapError::AttemptedWriteAfterFailure),
        };
        finished.map_err(|source| self.failed(source))?;
        let (Some(writer), Some(part)) = (self.writer.take(), self.part.take()) else {
            return Ok(()); // unreachable: both are there until finish or drop
        };
        let path = part.path().to_path_buf();
        let failed = |source| RecordingError::Write { path: path.clone(), source };
        let file = writer.into_inner().into_inner().map_err(|e| failed(e.into_error()))?;
        part.finish(&file).map_err(failed)
    }

    fn failed(&self, source: mcap::McapError) -> RecordingError {
        let path = self.part.as_ref().map(|p| p.path().to_path_buf()).unwrap_or_default();
        match source {
            mcap::McapError::Io(source) => RecordingError::Write { path, source },
            source => RecordingError::Mcap { path, source },
        }
    }
}

impl Drop for RecordingWriter {
    fn drop(&mut self) {
        // Not finished: without into_inner the mcap writer would write its summary first.
        if let Some(writer) = self.writer.take() {
            writer.into_inner();
        }
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
