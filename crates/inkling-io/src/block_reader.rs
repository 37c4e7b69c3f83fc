//! Decodes blocks of a recording into acquisitions. Each worker thread has a reader of its own.
//!
//! In: a [`Block`] (from `scan.rs`), by [`BlockReader::load`]. Out: its acquisitions in file order
//! and the damage that was met, by [`BlockReader::next_piece`], in pieces of bounded size. Callers
//! are the read stage (`src/pipeline/stages.rs`) and whoever looks through a recording (`inspect`,
//! `train`).
//!
//! Steps: `chunk_loader` reads, decompresses and verifies the block; its records are met one by
//! one; a schema or channel record is learned; a message is routed by its channel (`channels.rs`)
//! to `burst_codec` (our own messages), to `dialect::decoder` (messages of other loggers), or
//! passed over. A chunk that has a checksum (other than 0) is used only after it was verified. The
//! bursts of a chunk share one buffer; no sample is copied.
//!
//! Definitions in the recording's summary have precedence over those in blocks.

use super::Limits;
use super::block::{Block, BlockKind, ReadBlock};
use super::burst_codec::{BurstDecoder, unread};
use super::census::{Census, TopicSummary};
use super::channels::{Channels, MessageKind, RecordError, Route};
use super::chunk_loader::ChunkLoader;
use super::damage::Damage;
use super::dialect::decoder::{DialectDecoder, Times};
use super::mcap_records::{
    ChannelRecord, MESSAGE_HEADER, MessageHeader, RECORD_HEADER, SchemaRecord, message_header, op,
    record_at,
};
use super::source::Source;
use bytes::Bytes;
use inkling_core::burst::Acquisition;
use inkling_core::verdict::Reason;
use std::collections::BTreeMap;
use std::sync::Arc;

#[derive(Debug, Default)]
pub struct Piece {
    pub acquisitions: Vec<Acquisition>,
    /// Damage of the block that was met up to here.
    pub damage: Vec<Damage>,
    pub last: bool,
}

pub struct BlockReader {
    loader: ChunkLoader,
    decoder: BurstDecoder,
    dialects: DialectDecoder,
    /// The schemas and channels that the recording's summary defines.
    upfront: Arc<Channels>,
    /// These, and what blocks have defined so far. If the summary names all channels, each block
    /// begins with those of the summary alone, so that it gives the same result whichever worker
    /// reads it.
    channels: Arc<Channels>,
    /// Whether the summary names all channels that have messages.
    known_upfront: bool,
    /// The empty name, for topics that name no printhead.
    no_printhead: Arc<str>,
    open: Option<OpenBlock>,
    /// Counts what goes by, if somebody asked for it.
    census: Option<Census>,
}

/// The schemas and channels that blocks have defined, to be handed to the next reader.
#[derive(Clone, Debug)]
pub struct Definitions(Arc<Channels>);

#[derive(Debug)]
struct OpenBlock {
    block: Block,
    /// Its records. They are whole, except the last one if the block was too large to be read.
    records: Bytes,
    at: usize,
    /// Damage that was met and that no piece has told yet.
    damage: Vec<Damage>,
    /// How often records were of no use, by reason. It becomes damage with the last piece.
    lost: BTreeMap<RecordError, u64>,
}

impl BlockReader {
    pub(super) fn new(
        source: Arc<Source>,
        limits: Limits,
        upfront: Arc<Channels>,
        known_upfront: bool,
    ) -> BlockReader {
        BlockReader {
            loader: ChunkLoader::new(source, limits),
            decoder: BurstDecoder::new(limits),
            dialects: DialectDecoder::new(limits),
            channels: Arc::new(Channels::on_top_of(upfront.clone())),
            upfront,
            known_upfront,
            no_printhead: Arc::from(""),
            open: None,
            census: None,
        }
    }

    /// The same reader, which also knows what the blocks that other readers read before have
    /// defined. This has an effect only if the summary does not name all channels.
    pub fn knowing(mut self, definitions: Option<&Definitions>) -> BlockReader {
        if let Some(Definitions(channels)) = definitions.filter(|_| !self.known_upfront) {
            self.channels = channels.clone();
        }
        self
    }

    /// What the blocks so far have defined, for a reader that goes on from here; `None` if the
    /// summary names all channels, so that nothing need be handed on.
    pub fn definitions(&self) -> Option<Definitions> {
        (!self.known_upfront).then(|| Definitions(self.channels.clone()))
    }

    /// The same reader, which also counts the messages of every channel; see [`BlockReader::topics`].
    pub fn counting(mut self) -> BlockReader {
        self.census = Some(Census::default());
        self
    }

    /// Numbers of the dialects that read channels of the summary or of the blocks so far (or of the last
    /// block, if the summary names all channels).
    pub(super) fn dialects_met(&self) -> Vec<usize> {
        self.channels.dialects_used()
    }

    /// How many channels that a dialect fits have had a message so far; 0 unless messages are counted.
    pub(super) fn foreign_seen(&self) -> usize {
        self.census.as_ref().map_or(0, Census::foreign)
    }

    /// The channels so far with the messages that went by; none if nothing was counted.
    pub fn topics(self) -> Vec<TopicSummary> {
        self.census.map(|census| census.topics(&self.channels)).unwrap_or_default()
    }

    pub fn read(&mut self, block: &Block) -> Piece {
        self.load(block);
        self.next_piece(usize::MAX).unwrap_or_default()
    }

    /// Reads the block into memory and verifies it; [`BlockReader::next_piece`] then gives what is in it. A
    /// block that cannot be read is damage in its only piece.
    pub fn load(&mut self, block: &Block) {
        self.load_read(block, None);
    }

    /// The same, with the bytes that [`Recording::digester`](super::recording::Recording::digester) has read,
    /// if it has read them.
    pub fn load_read(&mut self, block: &Block, read: Option<ReadBlock>) {
        if self.known_upfront {
            self.channels = Arc::new(Channels::on_top_of(self.upfront.clone()));
        }
        let (records, damage) = match self.loader.load(block, read) {
            Ok(records) => (records, Vec::new()),
            Err(what) => (Bytes::new(), vec![damage_of(block, what)]),
        };
        let block = *block;
        self.open = Some(OpenBlock { block, records, at: 0, damage, lost: BTreeMap::new() });
    }

    /// The next acquisitions of the loaded block, until they have at least `max_rows` rows
    /// (channels, one row of the verdict table each) or the block ends. `None` after the last
    /// piece. Every loaded block has at least one piece; the last one may be empty.
    pub fn next_piece(&mut self, max_rows: usize) -> Option<Piece> {
        let mut open = self.open.take()?;
        let mut piece = Piece::default();
        let mut rows = 0;
        while rows < max_rows {
            if open.at >= open.records.len() {
                piece.last = true;
                break;
            }

            // a record that does not end in the buffer ends the block
            let Some(record) = record_at(&open.records, open.at) else {
                self.read_unfinished(&mut open, &mut piece);
                piece.last = true;
                break;
            };
            open.at = record.to;
            let body = &open.records[record.from..record.to];

            let outcome = match record.opcode {
                op::MESSAGE => match message_header(body) {
                    None => Err(RecordError::ShortMessage),
                    Some(header) => self.channels.route(header.channel_id).map(|to| {
                        let data = record.from + MESSAGE_HEADER..record.to;
                        if let Some(census) = &mut self.census {
                            let message = open.records.slice(data.clone());
                            census.see_message(header, &self.channels, &to.to, message);
                        }
                        if let Some(mut acquisition) = self.decode(to, header, &open.records, data)
                        {
                            if let Acquisition::Usable(burst) = &mut acquisition {
                                burst.topic = header.channel_id;
                            }
                            rows += acquisition.rows();
                            piece.acquisitions.push(acquisition);
                        }
                    }),
                },
                op::SCHEMA => self.define_schema(body),
                op::CHANNEL => self.define_channel(body),
                _ => Ok(()), // of no use here, or of a later version of the format
            };
            // a record of no use is counted only: the block goes on with the next record
            if let Err(lost) = outcome {
                *open.lost.entry(lost).or_default() += 1;
            }
        }

        piece.damage.append(&mut open.damage);
        if piece.last {
            piece.damage.extend(losses(&open.block, &open.lost));
        } else {
            self.open = Some(open);
        }
        Some(piece)
    }

    /// Learns a schema, unless the summary or an earlier block has defined the same id.
    fn define_schema(&mut self, body: &[u8]) -> Result<(), RecordError> {
        let schema = SchemaRecord::parse(body).ok_or(RecordError::Malformed("schema"))?;
        let known = self.channels.known_schema(schema);
        known.unwrap_or_else(|| Arc::make_mut(&mut self.channels).define_schema(schema))
    }

    /// Learns a channel, in the same way as a schema.
    fn define_channel(&mut self, body: &[u8]) -> Result<(), RecordError> {
        let channel = ChannelRecord::parse(body).ok_or(RecordError::Malformed("channel"))?;
        let known = self.channels.known_channel(channel);
        known.unwrap_or_else(|| Arc::make_mut(&mut self.channels).define_channel(channel))
    }

    /// The acquisition that a message is; `None` if its channel carries no bursts. A message that
    /// should be a burst and cannot be read is an unusable acquisition, and so a rejected row.
    fn decode(
        &mut self,
        route: Route,
        header: MessageHeader,
        records: &Bytes,
        data: std::ops::Range<usize>,
    ) -> Option<Acquisition> {
        let [log_time_ns, publish_ns] =
            [header.log_time, header.publish_time].map(|t| i64::try_from(t).unwrap_or(i64::MAX));
        let topic = route.printhead.as_ref().unwrap_or(&self.no_printhead);
        match route.to {
            MessageKind::Nothing => None,
            MessageKind::Foreign(plan) => {
                let times = Times { log_ns: log_time_ns, publish_ns };
                Some(self.dialects.decode(&plan, records.slice(data), times, topic))
            }
            MessageKind::Bursts => {
                Some(self.decoder.decode(records.slice(data), log_time_ns, topic))
            }
            MessageKind::OtherEncoding | MessageKind::Unread(_) => {
                Some(Acquisition::Unusable(unread(log_time_ns, topic, Reason::Undecodable)))
            }
        }
    }

    /// A record that does not end in the buffer is either a single message beyond the limit, of
    /// which only the head was read (an unusable acquisition, `too_large`), or its length is wrong
    /// (broken framing inside a chunk), and then the rest of the block is lost and becomes damage.
    fn read_unfinished(&mut self, open: &mut OpenBlock, piece: &mut Piece) {
        let head = open.records.get(open.at + RECORD_HEADER..);
        let too_large = open.block.bytes > self.loader.limits.record_bytes
            && open.block.kind == BlockKind::Messages;
        match head.filter(|_| too_large).and_then(message_header) {
            Some(header) => match self.channels.route(header.channel_id) {
                Ok(Route { to: MessageKind::Nothing, .. }) => {}
                Ok(Route { printhead, .. }) => {
                    let log_time_ns = i64::try_from(header.log_time).unwrap_or(i64::MAX);
                    let topic = printhead.as_ref().unwrap_or(&self.no_printhead);
                    let unusable = unread(log_time_ns, topic, Reason::TooLarge);
                    piece.acquisitions.push(Acquisition::Unusable(unusable));
                }
                Err(lost) => open.damage.push(damage_of(&open.block, lost.to_string())),
            },
            None => {
                let what = format!(
                    "record at byte {} of {} in the block does not end in it; what follows is lost",
                    open.at,
                    open.records.len()
                );
                open.damage.push(damage_of(&open.block, what));
            }
        }
    }
}

/// The records of a block that were of no use, as damage.
fn losses(block: &Block, lost: &BTreeMap<RecordError, u64>) -> Vec<Damage> {
    // reasons beyond these are counted together
    const NAMED: usize = 16;
    let named = lost.iter().take(NAMED).map(|(lost, n)| match n {
        1 => lost.to_string(),
        n => format!("{n} times: {lost}"),
    });
    let more = lost.len().saturating_sub(NAMED);
    let unnamed: u64 = lost.values().skip(NAMED).sum();
    let rest = (more > 0).then(|| format!("{unnamed} more records lost for {more} more reasons"));
    named.chain(rest).map(|what| damage_of(block, what)).collect()
}

/// Damage at a block. Its range is the whole block, also where only one record is lost: places
/// inside a compressed chunk are no places in the file.
fn damage_of(block: &Block, what: String) -> Damage {
    Damage { from_byte: block.offset, to_byte: block.offset + block.bytes, what }
}
