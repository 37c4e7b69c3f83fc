//! Writes an MCAP file that gets its name once it is whole. `recording_writer.rs` and
//! `annotation_writer.rs` write through it.
//!
//! In: protobuf messages with their topics, schemas and times. Out: an MCAP file in which each
//! topic is one channel, whose messages are numbered from 0. The same messages give the same bytes
//! on every machine.

use super::burst_codec::MESSAGE_ENCODING;
use super::damage::RecordingError;
use super::file_error::FileError;
use super::part_file::PartFile;
use mcap::records::MessageHeader;
use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};

type Writer = mcap::Writer<BufWriter<File>>;

/// A protobuf schema: the message's full name, and the compiled FileDescriptorSet that defines it.
pub(super) struct Schema(pub &'static str, pub &'static [u8]);

#[derive(Clone, Copy)]
struct Channel {
    id: u16,
    messages: u32,
}

pub(super) struct McapFile {
    writer: Writer,
    part: PartFile,
    path: PathBuf,
    channels: HashMap<String, Channel>,
}

impl McapFile {
    pub fn create(path: &Path, options: mcap::WriteOptions) -> Result<McapFile, RecordingError> {
        let (part, file) = PartFile::create(path).map_err(FileError::unwritten(path))?;
        let writer = options
            .library("inkling")
            .compression_threads(0) // same bytes on every machine: the default is a thread per core
            .create(BufWriter::with_capacity(1 << 16, file))
            .map_err(|e| unwritten(path, e))?;
        Ok(McapFile { writer, part, path: path.to_path_buf(), channels: HashMap::new() })
    }

    pub fn topics(&self) -> usize {
        self.channels.len()
    }

    pub fn has(&self, topic: &str) -> bool {
        self.channels.contains_key(topic)
    }

    /// Defines a schema, and gives its id. A schema that was defined before has the same id.
    pub fn define(&mut self, Schema(name, descriptors): Schema) -> Result<u16, RecordingError> {
        let id = self.writer.add_schema(name, MESSAGE_ENCODING, descriptors);
        id.map_err(|e| self.failed(e))
    }

    pub fn add(&mut self, topic: &str, schema: Schema) -> Result<(), RecordingError> {
        let schema_id = self.define(schema)?;
        let no_metadata = BTreeMap::new();
        let id = self.writer.add_channel(schema_id, topic, MESSAGE_ENCODING, &no_metadata);
        let id = id.map_err(|e| self.failed(e))?;
        self.channels.insert(topic.to_owned(), Channel { id, messages: 0 });
        Ok(())
    }

    /// Appends a message to a topic that was defined (a panic if it was not).
    pub fn write(&mut self, topic: &str, time_ns: u64, data: &[u8]) -> Result<(), RecordingError> {
        let channel = self.channels.get_mut(topic).expect("the topic was added");
        let header = MessageHeader {
            channel_id: channel.id,
            sequence: channel.messages,
            log_time: time_ns,
            publish_time: time_ns,
        };
        channel.messages = channel.messages.wrapping_add(1);
        self.writer.write_to_known_channel(&header, data).map_err(|e| self.failed(e))
    }

    pub fn end_chunk(&mut self) -> Result<(), RecordingError> {
        self.writer.flush().map_err(|e| self.failed(e))
    }

    pub fn finish(mut self) -> Result<(), RecordingError> {
        self.writer.finish().map_err(|e| self.failed(e))?;
        let McapFile { writer, part, path, .. } = self;
        let failed = FileError::unwritten(&path);
        let file = writer.into_inner().into_inner().map_err(|e| failed(e.into_error()))?;
        Ok(part.finish(&file).map_err(failed)?)
    }

    fn failed(&self, source: mcap::McapError) -> RecordingError {
        unwritten(&self.path, source)
    }
}

/// An error of the mcap crate, with the file's name. An error of the file system is kept as such, so that a full disk
/// is recognised.
fn unwritten(path: &Path, source: mcap::McapError) -> RecordingError {
    let source = match source {
        mcap::McapError::Io(source) => source,
        // a record that is written cannot fail but by the file system, and the crate hides its error in this one
        mcap::McapError::Parse(source) => io::Error::other(source.to_string()),
        source => io::Error::other(source.to_string()),
    };
    FileError::unwritten(path)(source).into()
}
