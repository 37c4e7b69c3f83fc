//! Opens a recording, which is an MCAP file, and answers what is asked of it as a whole. Everything
//! that judges, trains or inspects begins here.
//!
//! In: a path, limits, dialects. Out: a [`Recording`]. It gives its blocks in file order
//! ([`Recording::blocks`]), readers that decode blocks ([`Recording::reader`]), and a digester; and
//! it knows what its own statistics and checksums say.
//!
//! Opening reads the first bytes (the magic) and the summary at the end (`mcap_summary.rs`). Reading
//! never relies on the chunk index: the order in the file is the order of the verdicts, and a file
//! without a summary gives the same bursts.

pub use super::mcap_summary::OtherChannel;

use super::Limits;
use super::block_reader::BlockReader;
use super::channels::Channels;
use super::damage::{Damage, RecordingError};
use super::dialect::Dialects;
use super::digest::{Digest, Digester};
use super::file_error::FileError;
use super::growth::Growth;
use super::mcap_records::{MAGIC, RecordHeader, op};
use super::mcap_summary::Summary;
use super::objects::in_object_store;
use super::scan::Blocks;
use super::source::Source;
use super::stamp::Stamp;
use super::unread_file;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

#[derive(Debug)]
pub struct Recording {
    pub path: PathBuf,
    pub name: String,
    /// The recording's name for people: its path below the directory that was asked for, or its
    /// file name if whoever opens it knows no more.
    pub label: String,
    pub bytes: u64,
    /// Size and time of change when it was opened.
    pub stamp: Stamp,
    pub opening: Duration,
    /// How many burst messages the recording's own statistics say there are.
    pub expected: Option<u64>,
    /// Channels that carry no bursts: the first 64 of those that the summary names.
    pub others: Vec<OtherChannel>,
    /// Topics of bursts that have no message, by the statistics: what was to be recorded of them is not there.
    pub silent: Vec<String>,
    /// Damage that was found when the recording was opened; blocks and the digest add more later.
    pub damage: Vec<Damage>,
    pub(super) source: Arc<Source>,
    pub(super) limits: Limits,
    /// Set if the recording is, or was, followed while it is being written.
    pub(super) growth: Option<Growth>,
    pub(super) channels: Arc<Channels>,
    /// Whether the summary names every channel. Then any number of readers may take blocks in any
    /// order; otherwise one reader must take all blocks, in order. What a block gives is the same
    /// either way.
    pub channels_known_upfront: bool,
    /// First byte after the data section, if the file's end says so.
    pub(super) data_end: Option<u64>,
    /// The greatest time by which a chunk begins before the end of one that precedes it in the file, by the
    /// chunk index and in log times, ns. `None`: the file does not say. Whoever sorts bursts by time must
    /// wait that long.
    pub disorder_ns: Option<u64>,
    /// Whether its chunks are in no order of time, by the chunk index.
    pub is_shuffled: bool,
}

impl Recording {
    /// Opens a recording without dialects: only `inkling.Burst` is read.
    pub fn open(path: &Path, limits: Limits) -> Result<Recording, RecordingError> {
        Recording::open_with(path, limits, &Dialects::default())
    }

    /// Opens a recording. It is an error if the path is no MCAP file, or if a dialect fits a
    /// channel and cannot read it. A missing or broken summary is damage only.
    pub fn open_with(
        path: &Path,
        limits: Limits,
        dialects: &Dialects,
    ) -> Result<Recording, RecordingError> {
        let started = Instant::now();
        let source = open_source(path)?;
        check_magic(path, &magic(path, &source)?)?;
        let mut recording = Recording::of_source(path, Arc::new(source), limits, dialects)?;
        recording.opening = started.elapsed();
        Ok(recording)
    }

    pub(super) fn of_source(
        path: &Path,
        source: Arc<Source>,
        limits: Limits,
        dialects: &Dialects,
    ) -> Result<Recording, RecordingError> {
        let mut damage = Vec::new();
        let summary = Summary::read(&source, dialects).unwrap_or_else(|found| {
            damage.push(found);
            Summary::new(dialects)
        });
        if let Some(what) = summary.unread() {
            return Err(RecordingError::Dialect { path: path.to_path_buf(), what });
        }
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        Ok(Recording {
            path: path.to_path_buf(),
            label: name.clone(),
            name,
            bytes: source.bytes(),
            stamp: source.stamp_then(),
            opening: Duration::ZERO,
            expected: summary.expected(),
            disorder_ns: summary.disorder_ns(),
            is_shuffled: summary.is_shuffled(),
            others: summary.others(),
            silent: summary.silent(),
            damage,
            source,
            limits,
            growth: None,
            channels_known_upfront: summary.complete(),
            channels: Arc::new(summary.channels),
            data_end: summary.data_end,
        })
    }

    /// The same recording, as if nothing were known of its end: channels become known with the blocks. A file
    /// that is being written has no end that could be relied on.
    pub(super) fn unindexed(self, dialects: &Dialects) -> Recording {
        let channels = Arc::new(Channels::new(dialects));
        Recording {
            expected: None,
            others: Vec::new(),
            silent: Vec::new(),
            damage: Vec::new(),
            channels,
            channels_known_upfront: false,
            data_end: None,
            disorder_ns: None,
            is_shuffled: false,
            ..self
        }
    }

    /// The topic of a number ([`Burst::topic`](inkling_core::burst::Burst)); `None`: the summary does not name it.
    pub fn topic(&self, number: u16) -> Option<&str> {
        self.channels.described(number).map(|(channel, _)| channel.topic.as_str())
    }

    pub(super) fn is_indexed(&self) -> bool {
        self.data_end.is_some()
    }

    /// The blocks in file order, found as they are asked for.
    pub fn blocks(&self) -> Blocks {
        let blocks = Blocks::new(self.source.clone(), self.limits, self.data_end);
        match self.growth.as_ref().filter(|growth| !growth.closed) {
            Some(growth) => blocks.growing(growth.ends.clone()),
            None => blocks,
        }
    }

    pub fn reader(&self) -> BlockReader {
        BlockReader::new(
            self.source.clone(),
            self.limits,
            self.channels.clone(),
            self.channels_known_upfront,
        )
    }

    /// The damage if `found` burst messages were read and the statistics say another number.
    pub fn missing(&self, found: u64) -> Option<Damage> {
        let expected = self.expected.filter(|&expected| expected != found)?;
        Some(Damage {
            from_byte: 0,
            to_byte: self.bytes,
            what: format!(
                "{found} burst messages found, the recording's statistics say {expected}"
            ),
        })
    }

    /// What was read of a recording that was changed meanwhile may belong to no one state of it.
    pub fn changed(&self) -> Option<Damage> {
        if self.growth.is_some() {
            return None; // a followed recording is read only as far as it is whole
        }
        let now = self.source.stamp().ok()?;
        let what = match now.bytes.checked_sub(self.bytes) {
            _ if now == self.stamp => return None,
            Some(0) | None => "it was changed while it was read; replay it again".to_owned(),
            Some(more) => {
                format!(
                    "it grew by {more} bytes while it was read; replay it again when it is closed"
                )
            }
        };
        Some(Damage { from_byte: self.bytes, to_byte: now.bytes.max(self.bytes), what })
    }

    /// An error if some of the recording could not be read although it is there: what was found in it is then not
    /// all that it holds, and no damage of its own.
    pub fn check_read(&self) -> Result<(), RecordingError> {
        Ok(self.source.check_read().map_err(FileError::unread(&self.path))?)
    }

    pub fn digester(&self) -> Digester {
        // The DataEnd record is the last of the data section; its checksum does not cover itself.
        let data = self.data_end.and_then(|end| self.data_end_record(end));
        Digester::new(self.path.clone(), self.source.clone(), self.limits, data)
    }

    /// The digest, by one pass over the whole file.
    pub fn digest(&self) -> Result<Digest, RecordingError> {
        self.digester().finish(|| Ok(()))
    }

    /// For the DataEnd record that ends at `end`: where it begins, and the checksum of the data
    /// section in it. `None`: no such record ends there.
    fn data_end_record(&self, end: u64) -> Option<(u64, u32)> {
        let mut record = [0; 13];
        let at = end.checked_sub(record.len() as u64)?;
        self.source.read_at(at, &mut record).ok()?;
        let whole = RecordHeader { opcode: op::DATA_END, body_bytes: 4 };
        let crc = *record.last_chunk()?;
        (RecordHeader::parse(&record)? == whole).then_some((at, u32::from_le_bytes(crc)))
    }
}

pub(super) fn open_source(path: &Path) -> Result<Source, FileError> {
    Source::open(path).map_err(|e| match e.kind() {
        ErrorKind::InvalidInput if !in_object_store(path) => {
            let what = "not a file (a directory, a pipe or a device); give an MCAP file";
            FileError::failed(path, what)
        }
        _ => FileError::unread(path)(e),
    })
}

/// How a source begins: its first bytes, as many as MCAP's magic bytes, or fewer if it is shorter.
pub(super) fn magic(path: &Path, source: &Source) -> Result<Vec<u8>, FileError> {
    let mut magic = vec![0; MAGIC.len().min(source.bytes() as usize)];
    source.read_at(0, &mut magic).map_err(FileError::unread(path))?;
    Ok(magic)
}

/// Refuses a file that does not begin like a recording; the error says what it is instead.
pub(super) fn check_magic(path: &Path, found: &[u8]) -> Result<(), FileError> {
    let begins = found.escape_ascii();
    if let Some(kind) = unread_file::kind(found) {
        return Err(FileError::failed(path, format!("not an MCAP file, but {kind}")));
    }
    let what = match found.len() == MAGIC.len() && found.starts_with(&MAGIC[..5]) {
        _ if found == MAGIC => return Ok(()),
        _ if found.is_empty() => "empty file (0 bytes); the recording was never written".into(),
        // the magic bytes have a CR and a LF to show this
        true if found.starts_with(&MAGIC[..6]) => {
            "an MCAP file that was copied as text, so that bytes which look like the ends of lines were changed (FTP in \
             ASCII mode, git without `*.mcap binary`): copy it again as binary"
                .into()
        }
        true => format!("MCAP of another version (\"{begins}\"); inkling reads version 0"),
        false => format!(
            "not an MCAP file (it begins with \"{begins}\"); inkling reads MCAP, and `inkling convert` \
             makes one from CSV or Parquet"
        ),
    };
    Err(FileError::failed(path, what))
}
