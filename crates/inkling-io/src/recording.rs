//! Opens a recording, which is an MCAP file, and answers what is asked of it as a whole. Everything
//! that judges, trains or inspects begins here.
//!
//! In: a path, limits, dialects. Out: a [`Recording`]. It gives its blocks in file order
//! ([`Recording::blocks`]), readers that decode blocks ([`Recording::reader`]), and a digester; and
//! it knows what its own statistics and checksums say.
//!
//! Opening reads the first bytes (the magic), the footer at the end, and the summary that the
//! footer points to: schemas, channels, statistics, chunk index (`read_summary`). Reading never
//! relies on the chunk index: the order in the file is the order of the verdicts, and a file
//! without a summary gives the same bursts.

use super::block::Block;
use super::block_reader::BlockReader;
use super::census::{Becomes, Census, TopicSummary};
use super::channels::{Channels, Route};
use super::damage::{Damage, RecordingError};
use super::dialect::Dialects;
use super::dialect::guess::guess;
use super::digest::{Digest, Digester};
use super::file_error::FileError;
use super::growth::Growth;
use super::mcap_records::{
    ChannelRecord, ChunkSpan, FOOTER_BYTES, MAGIC, RecordHeader, SchemaRecord, Statistics, footer,
    op, record_at, statistics,
};
use super::objects::in_object_store;
use super::scan::Blocks;
use super::source::Source;
use super::stamp::Stamp;
use super::{Limits, printable};
use std::collections::BTreeSet;
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
    /// Channels that carry no bursts: the first `MOST_NAMED` of those that the summary names.
    pub others: Vec<Other>,
    /// Damage that was found when the recording was opened; blocks and the digest add more later.
    pub damage: Vec<Damage>,
    pub(super) source: Arc<Source>,
    pub(super) limits: Limits,
    /// Set if the recording is followed while it is being written, or was when it was read; else
    /// `None`.
    pub(super) growth: Option<Growth>,
    /// Schemas and channels by the summary.
    channels: Arc<Channels>,
    /// Whether the summary names every channel. Then any number of readers may take blocks in any
    /// order; otherwise one reader must take all blocks, in order. What a block gives is the same
    /// either way.
    pub channels_known_upfront: bool,
    /// First byte after the data section, if the file's end says so.
    data_end: Option<u64>,
    /// The greatest time by which a chunk begins before the end of one that precedes it in the file, by the
    /// chunk index and in log times, ns. `None`: the file does not say. Whoever sorts bursts by time must
    /// wait that long.
    pub disorder_ns: Option<u64>,
}

/// A channel whose messages look like bursts, and that nothing reads. `replay` warns of it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Unread {
    pub topic: String,
    pub schema: String,
    /// Number of messages by the statistics; `None`: the file does not say.
    pub messages: Option<u64>,
    /// Whether a dialect would read the channel under another topic or schema name: then a name is
    /// probably mistyped.
    pub by_dialect: bool,
}

/// A channel that carries no bursts.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Other {
    pub topic: String,
    pub schema: String,
    pub message_encoding: String,
    pub messages: Option<u64>,
}

/// Bytes of a recording after which the search for what dialects read gives up (roughly, to a
/// block).
const MOST_PEEKED_BYTES: u64 = 64 << 20;
/// Blocks that are looked at in any case, because only a channel's first message says whether paths
/// in JSON lead anywhere. After each further so many blocks it is asked whether that is enough.
const PEEKED_AT_ONCE: u64 = 16;
const MOST_PEEKED_ROWS: usize = 32_768;

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

    /// Opens the recording in a source whose magic bytes were checked already.
    pub(super) fn of_source(
        path: &Path,
        source: Arc<Source>,
        limits: Limits,
        dialects: &Dialects,
    ) -> Result<Recording, RecordingError> {
        let mut damage = Vec::new();
        let summary = read_summary(&source, dialects).unwrap_or_else(|found| {
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
            others: summary.others(),
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
            damage: Vec::new(),
            channels,
            channels_known_upfront: false,
            data_end: None,
            disorder_ns: None,
            ..self
        }
    }

    /// Whether the recording has a footer that could be read, and so an end.
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

    /// Which dialects read something of this recording; `dialects` is how many the settings have.
    /// Only the beginning is looked at: until each channel that a dialect reads has had a message
    /// and, without a summary, every dialect has read something. It is an error if a path of a
    /// dialect leads nowhere in the first message of a channel.
    pub fn dialects_used(&self, dialects: usize) -> Result<DialectsUsed, RecordingError> {
        let wrong = |what: String| RecordingError::Dialect { path: self.path.clone(), what };
        // a summary names all channels, and so all dialects that read something
        let mut used = DialectsUsed { numbers: Vec::new(), all: self.channels_known_upfront };
        used.numbers.extend(self.channels.dialects_used());
        if used.all && used.numbers.is_empty() {
            return Ok(used);
        }

        // the messages at the beginning, asked every 16 blocks whether they suffice
        let reader = self.peek(|block, reader| {
            if block.index == 0 || !block.index.is_multiple_of(PEEKED_AT_ONCE) {
                return false;
            }
            // one number for each channel that a dialect reads
            let met = if used.all { used.numbers.clone() } else { reader.dialects_met() };
            let all = used.all || met.iter().collect::<BTreeSet<_>>().len() >= dialects;
            all && reader.foreign_seen() >= met.len() || block.offset > MOST_PEEKED_BYTES
        });

        // then each channel's first message is checked
        let known = reader.dialects_met();
        for summary in reader.census().map(Census::topics).unwrap_or_default() {
            self.check_first(&summary).map_err(wrong)?;
        }
        used.numbers.extend(known);
        Ok(used)
    }

    /// Reads blocks until `is_enough` says so of the next block, and gives the reader, which has
    /// counted their messages.
    fn peek(&self, is_enough: impl Fn(&Block, &BlockReader) -> bool) -> BlockReader {
        let mut reader = self.reader().counting();
        for block in self.blocks().filter_map(Result::ok) {
            if is_enough(&block, &reader) {
                break;
            }
            reader.load(&block);
            reader.next_piece(MOST_PEEKED_ROWS);
        }
        reader
    }

    /// Channels whose messages look like bursts and that nothing reads, as far as the first 16
    /// blocks tell.
    pub fn unread(&self, dialects: &Dialects) -> Vec<Unread> {
        if self.channels_known_upfront && self.others.is_empty() {
            return Vec::new();
        }
        let reader = self.peek(|block, _| block.index >= PEEKED_AT_ONCE);
        let topics = reader.census().map(Census::topics).unwrap_or_default();
        // the schemas that a dialect reads on other topics: there a topic's pattern may be mistyped
        let read = |summary: &&TopicSummary| matches!(summary.becomes, Becomes::Foreign(_));
        let read: BTreeSet<&str> =
            topics.iter().filter(read).map(|summary| &*summary.schema_name).collect();
        let unread = |summary: &TopicSummary| {
            let (written, message) = (summary.written()?, summary.first_message.as_ref()?);
            guess(&written, message, &[&summary.topic])?;
            let fits =
                dialects.of_topic(&summary.topic).any() || read.contains(&*summary.schema_name);
            let of_it = self.others.iter().find(|other| other.topic == summary.topic);
            Some(Unread {
                topic: printable::line(&summary.topic, Summary::MOST_OF_A_NAME),
                schema: printable::line(&summary.schema_name, Summary::MOST_OF_A_NAME),
                messages: of_it.and_then(|other| other.messages),
                by_dialect: fits
                    && dialects.could_read(&written, message, self.limits.samples_bytes),
            })
        };
        let nothing = topics.iter().filter(|summary| matches!(summary.becomes, Becomes::Nothing));
        nothing.filter_map(unread).collect()
    }

    /// Refuses a channel whose dialect cannot read it.
    fn check_first(&self, summary: &TopicSummary) -> Result<(), String> {
        match (&summary.becomes, &summary.first_message) {
            (Becomes::Unread(why), _) => Err(why.to_string()),
            (Becomes::Foreign(plan), Some(message)) => plan
                .check_message(message, self.limits.samples_bytes)
                .map_err(|what| format!("{}: {what}", printable::line(&summary.topic, 200))),
            _ => Ok(()),
        }
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

    /// The damage if the recording was changed since it was opened: what was read may belong to no
    /// one state of it. `None` if it was not changed, or is followed.
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

    /// A digester, which computes the digest while it reads the blocks, so that every byte is read
    /// once.
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
        let (header, crc) = record.split_at(9);
        let whole = RecordHeader { opcode: op::DATA_END, body_bytes: 4 };
        (RecordHeader::parse(header)? == whole)
            .then(|| crc.first_chunk().map(|crc| (at, u32::from_le_bytes(*crc))))?
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
    let what = match found.len() == MAGIC.len() && found.starts_with(&MAGIC[..5]) {
        _ if found == MAGIC => return Ok(()),
        _ if found.is_empty() => "empty file (0 bytes); the recording was never written".into(),
        true => format!("MCAP of another version (\"{begins}\"); inkling reads version 0"),
        false => format!(
            "not an MCAP file (it begins with \"{begins}\"); inkling reads MCAP, and `inkling convert` \
             makes one from CSV, Parquet, Arrow or NumPy"
        ),
    };
    Err(FileError::failed(path, what))
}

/// Which dialects a recording uses, by their numbers.
#[derive(Clone, Debug)]
pub struct DialectsUsed {
    pub numbers: Vec<usize>,
    /// Whether the recording can use no other dialects.
    pub all: bool,
}

/// What the end of the file says of the whole: the contents of the footer and the summary section.
#[derive(Debug, Default)]
struct Summary {
    channels: Channels,
    /// The ids of the channels, each once, in the order of their definitions.
    channel_ids: Vec<u16>,
    /// Names of the channels and their schemas.
    census: Census,
    statistics: Option<Statistics>,
    chunks: Vec<ChunkSpan>,
    data_end: Option<u64>,
}

impl Summary {
    /// Only so many channels without bursts are named one by one.
    const MOST_NAMED: usize = 64;
    const MOST_OF_A_NAME: usize = 200;

    fn new(dialects: &Dialects) -> Summary {
        Summary { channels: Channels::new(dialects), ..Summary::default() }
    }

    /// The first reason why a dialect cannot read a channel that it fits.
    fn unread(&self) -> Option<String> {
        self.channel_ids.iter().find_map(|&id| match self.channels.route(id) {
            Ok(Route { to: Becomes::Unread(why), .. }) => Some(why.to_string()),
            _ => None,
        })
    }

    /// The first [`Summary::MOST_NAMED`] channels that carry no bursts.
    fn others(&self) -> Vec<Other> {
        let counts = self.statistics.as_ref().map(|s| &s.channel_message_counts);
        let line = |text| printable::line(text, Self::MOST_OF_A_NAME);
        let other = |&id: &u16| {
            let (channel, schema) =
                self.census.channel(id).filter(|_| !self.channels.carries_bursts(id))?;
            Some(Other {
                topic: line(&channel.topic),
                schema: line(schema),
                message_encoding: line(&channel.message_encoding),
                messages: counts.and_then(|counts| counts.get(&id).copied()),
            })
        };
        self.channel_ids.iter().filter_map(other).take(Self::MOST_NAMED).collect()
    }

    /// Whether every channel of the file is known, and what it carries.
    fn complete(&self) -> bool {
        self.statistics.as_ref().is_some_and(|s| s.channel_count as usize == self.channel_ids.len())
            && self.channel_ids.iter().all(|&id| self.channels.route(id).is_ok())
    }

    /// See [`Recording::disorder_ns`]: the chunks in the order of the file, each against the latest
    /// end before it.
    fn disorder_ns(&self) -> Option<u64> {
        let holds_messages = |chunk: &&ChunkSpan| chunk.to_ns > 0;
        let mut chunks: Vec<&ChunkSpan> = self.chunks.iter().filter(holds_messages).collect();
        chunks.sort_by_key(|chunk| chunk.offset);
        let mut latest = chunks.first()?.from_ns;
        let mut disorder = 0;
        for chunk in chunks {
            disorder = disorder.max(latest.saturating_sub(chunk.from_ns));
            latest = latest.max(chunk.to_ns);
        }
        Some(disorder)
    }

    /// See [`Recording::expected`]: the sum of the counts of the channels that carry bursts.
    fn expected(&self) -> Option<u64> {
        let statistics = self.statistics.as_ref().filter(|_| self.complete())?;
        let counts = &statistics.channel_message_counts;
        let counted = counts.values().try_fold(0, |sum: u64, n| sum.checked_add(*n));
        if counted != Some(statistics.message_count) {
            return None; // the counts by channel are optional
        }
        let bursts = counts.iter().filter(|(id, _)| self.channels.carries_bursts(**id));
        Some(bursts.map(|(_, n)| n).sum())
    }
}

/// Reads the footer and the summary section.
fn read_summary(source: &Source, dialects: &Dialects) -> Result<Summary, Damage> {
    /// The index of a file of 20 GB in chunks of 1 MiB takes a few MB.
    const MAX_SUMMARY_BYTES: u64 = 128 << 20;
    let bytes = source.bytes();
    let damage = |from_byte, what: &str| {
        let what = format!("{what}: nothing to check the number of messages against");
        Damage { from_byte, to_byte: bytes, what }
    };
    // 1. the footer: the last record, right before the closing magic bytes
    let cut_short = || damage(bytes, "no footer, the recording was cut short or never closed");
    let tail_bytes = FOOTER_BYTES + MAGIC.len() as u64;
    let footer_at = bytes
        .checked_sub(tail_bytes)
        .filter(|&at| at >= MAGIC.len() as u64)
        .ok_or_else(cut_short)?;
    let unreadable = |e: std::io::Error| damage(footer_at, &format!("summary: {e}"));
    let mut tail = [0; (FOOTER_BYTES as usize) + MAGIC.len()];
    source.read_at(footer_at, &mut tail).map_err(unreadable)?;
    let footer = tail
        .strip_suffix(MAGIC)
        .and_then(|t| record_at(t, 0).filter(|r| r.opcode == op::FOOTER && r.to == t.len()))
        .and_then(|r| footer(&tail[r.from..r.to]))
        .ok_or_else(cut_short)?;

    // 2. the summary section, which ends at the footer. Without one, the checksum covers the footer
    //    alone.
    let start = if footer.summary_start == 0 { footer_at } else { footer.summary_start };
    let length = footer_at
        .checked_sub(start)
        .filter(|&n| n <= MAX_SUMMARY_BYTES && start >= MAGIC.len() as u64)
        .ok_or_else(|| damage(footer_at, "footer: it points nowhere"))?;
    let mut section = vec![0; length as usize];
    source.read_at(start, &mut section).map_err(unreadable)?;
    // 3. the checksum covers the section and the footer up to the checksum itself
    if footer.summary_crc != 0 {
        let mut crc = crc32fast::Hasher::new();
        crc.update(&section);
        crc.update(&tail[..FOOTER_BYTES as usize - 4]);
        if crc.finalize() != footer.summary_crc {
            return Err(damage(start, "summary: its checksum does not agree"));
        }
    }

    // 4. the records; the data section ends where the summary begins
    let mut summary = Summary { data_end: Some(start), ..Summary::new(dialects) };
    parse_summary(&section, &mut summary)
        .ok_or_else(|| damage(start, "summary: its records are malformed"))?;
    Ok(summary)
}

/// Takes the records of the summary section into `summary`.
fn parse_summary(section: &[u8], summary: &mut Summary) -> Option<()> {
    let mut at = 0;
    while at < section.len() {
        let record = record_at(section, at)?;
        let body = &section[record.from..record.to];
        summary.census.see_definition(record.opcode, body);
        match record.opcode {
            op::SCHEMA => summary.channels.define_schema(SchemaRecord::parse(body)?).ok()?,
            op::CHANNEL => {
                let channel = ChannelRecord::parse(body)?;
                if summary.channels.known_channel(channel).is_none() {
                    summary.channel_ids.push(channel.id);
                }
                summary.channels.define_channel(channel).ok()?;
            }
            op::STATISTICS => summary.statistics = Some(statistics(body)?),
            op::CHUNK_INDEX => summary.chunks.extend(ChunkSpan::parse(body)),
            _ => {}
        }
        at = record.to;
    }
    Some(())
}
