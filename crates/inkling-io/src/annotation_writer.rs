//! Writes what a run found as messages beside the recording, in `<stem>.annotations.mcap` (`replay
//! --annotate`), for viewers such as Foxglove.
//!
//! In, from `src/cli/annotate.rs`: lines of a log (an episode was raised, or has ended), pictures
//! of printheads as PNG, and states of single channels, each with its time in ns since 1970. Out:
//! an MCAP file, compressed by lz4, with messages of `foxglove.Log`, `foxglove.CompressedImage` and
//! `inkling.ChannelState` (`schemas/`). It has a provisional name until `finish` gives it its own.
//!
//! Topics: `/inkling/log`; `/inkling/<printhead>/map`; `/inkling/<printhead>/channel/<number>`.
//! MCAP has no time before 1970: the log time of an older message is 0, while the timestamp inside
//! the message stays true.

pub use wire::inkling::ChannelState;

use super::burst_codec::timestamp;
use super::damage::RecordingError;
use super::mcap_file::{McapFile, Schema};
use super::stored;
use prost::Message as _;
use std::path::{Path, PathBuf};

/// Generated from the schemas of annotations (`tests/wire.rs`).
mod wire {
    #![allow(clippy::all, missing_docs)]
    pub mod foxglove {
        include!("wire/foxglove.rs");
    }
    pub mod inkling {
        include!("wire/channel_state.rs");
    }
}

/// The compiled schemas (a protobuf FileDescriptorSet) of all messages that this file writes.
const FILE_DESCRIPTOR_SET: &[u8] = include_bytes!("wire/annotations.fds");
pub const LOG_TOPIC: &str = "/inkling/log";
/// At most so many topics, because MCAP numbers channels by 16 bits. Messages of further topics are left out.
const MOST_TOPICS: usize = 60_000;

/// How much a line of the log matters: the levels of `foxglove.Log` that annotations use.
#[derive(Clone, Copy, Debug, PartialEq, Eq, prost::Enumeration)]
pub enum Level {
    Unknown = 0,
    Info = 2,
    Warning = 3,
}

pub struct AnnotationWriter {
    file: McapFile,
}

/// The annotations that belong to a verdict table: `<stem>.verdicts.parquet` gives `<stem>.annotations.mcap`.
pub fn path_beside(verdicts: &Path) -> PathBuf {
    stored::beside(verdicts, "annotations.mcap")
}

impl AnnotationWriter {
    pub fn create(path: &Path) -> Result<AnnotationWriter, RecordingError> {
        let options = mcap::WriteOptions::new().compression(Some(mcap::Compression::Lz4));
        Ok(AnnotationWriter { file: McapFile::create(path, options)? })
    }

    /// Writes a line of the log; `name` is the printhead.
    pub fn log(
        &mut self,
        t_ns: i64,
        level: Level,
        name: &str,
        message: &str,
    ) -> Result<(), RecordingError> {
        let line = wire::foxglove::Log {
            timestamp: Some(timestamp(t_ns)),
            level: level.into(),
            message: message.into(),
            name: name.into(),
            file: String::new(),
            line: 0,
        };
        self.write(LOG_TOPIC, "foxglove.Log", t_ns, &line.encode_to_vec())
    }

    pub fn image(
        &mut self,
        t_ns: i64,
        printhead: &str,
        png: Vec<u8>,
    ) -> Result<(), RecordingError> {
        let image = wire::foxglove::CompressedImage {
            timestamp: Some(timestamp(t_ns)),
            frame_id: printhead.into(),
            data: png.into(),
            format: "png".into(),
        };
        let topic = format!("/inkling/{printhead}/map");
        self.write(&topic, "foxglove.CompressedImage", t_ns, &image.encode_to_vec())
    }

    /// Writes the state of a watched channel at one burst.
    pub fn state(
        &mut self,
        t_ns: i64,
        printhead: &str,
        state: ChannelState,
    ) -> Result<(), RecordingError> {
        let topic = format!("/inkling/{printhead}/channel/{}", state.channel);
        let message = ChannelState { timestamp: Some(timestamp(t_ns)), ..state };
        self.write(&topic, "inkling.ChannelState", t_ns, &message.encode_to_vec())
    }

    /// Writes a message; the first one on a topic defines the topic.
    fn write(
        &mut self,
        topic: &str,
        schema: &'static str,
        t_ns: i64,
        data: &[u8],
    ) -> Result<(), RecordingError> {
        if !self.file.has(topic) {
            if self.file.topics() >= MOST_TOPICS {
                return Ok(());
            }
            self.file.add(topic, Schema(schema, FILE_DESCRIPTOR_SET))?;
        }
        // the log time of MCAP has no sign
        self.file.write(topic, u64::try_from(t_ns).unwrap_or(0), data)
    }

    pub fn finish(self) -> Result<(), RecordingError> {
        self.file.finish()
    }
}
