//! What was found, as messages beside the recording: `<stem>.annotations.mcap`.
//!
//! In: episodes, pictures of printheads, states of channels, each with its time. Out: an MCAP file with
//! `foxglove.Log`, `foxglove.CompressedImage` and `inkling.ChannelState` messages (`schemas/`), under its
//! name once it is whole. MCAP knows no time before 1970: what is older lies at 0.

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

const FILE_DESCRIPTOR_SET: &[u8] = include_bytes!("wire/annotations.fds");
/// The topic on which episodes are told.
pub const LOG_TOPIC: &str = "/inkling/log";
/// MCAP numbers channels by 16 bits; more topics than this get no messages.
const MOST_TOPICS: usize = 60_000;

/// How much a line of the log matters: those of `foxglove.Log` that annotations use.
#[derive(Clone, Copy, Debug, PartialEq, Eq, prost::Enumeration)]
pub enum Level {
    Unknown = 0,
    Info = 2,
    Warning = 3,
}

pub struct AnnotationWriter {
    file: McapFile,
}

/// `<stem>.verdicts.parquet` -> `<stem>.annotations.mcap`.
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

    /// Writes a printhead's picture at a time, as PNG.
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

    /// Writes the state of a watched channel at one burst; the time of the message is put in here.
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

    /// Writes a message; one on a topic beyond the most that there may be is left out.
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
        self.file.write(topic, u64::try_from(t_ns).unwrap_or(0), data)
    }

    /// Completes the file and gives it its name.
    pub fn finish(self) -> Result<(), RecordingError> {
        self.file.finish()
    }
}
