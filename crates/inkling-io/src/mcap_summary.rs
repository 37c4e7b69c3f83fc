//! Reads what the end of an MCAP file says of the whole: the footer, and the summary section that
//! the footer points to.
//!
//! In: the bytes of a recording. Out: a `Summary`: schemas, channels, statistics and chunk index.
//! If one of them is missing or not sound, nothing of them is used, and that is damage.

use super::channels::{Channels, MessageKind, Route};
use super::damage::Damage;
use super::dialect::Dialects;
use super::mcap_records::{
    ChannelRecord, ChunkSpan, FOOTER_BYTES, MAGIC, SchemaRecord, Statistics, footer, op, record_at,
    statistics,
};
use super::printable;
use super::source::Source;
use std::collections::BTreeMap;

/// Only so many channels without bursts are named one by one.
const MOST_NAMED: usize = 64;
/// At most so many characters of a name are shown.
pub(super) const MOST_OF_A_NAME: usize = 200;

/// A channel that carries no bursts.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OtherChannel {
    pub topic: String,
    pub schema: String,
    pub message_encoding: String,
    pub messages: Option<u64>,
}

#[derive(Debug, Default)]
pub(super) struct Summary {
    pub(super) channels: Channels,
    /// The ids of the channels, each once, in the order of their definitions.
    channel_ids: Vec<u16>,
    statistics: Option<Statistics>,
    chunks: Vec<ChunkSpan>,
    /// First byte after the data section.
    pub(super) data_end: Option<u64>,
}

impl Summary {
    pub(super) fn new(dialects: &Dialects) -> Summary {
        Summary { channels: Channels::new(dialects), ..Summary::default() }
    }

    pub(super) fn read(source: &Source, dialects: &Dialects) -> Result<Summary, Damage> {
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
        summary
            .parse(&section)
            .ok_or_else(|| damage(start, "summary: its records are malformed"))?;
        Ok(summary)
    }

    /// The first reason why a dialect cannot read a channel that it fits.
    pub(super) fn unread(&self) -> Option<String> {
        self.channel_ids.iter().find_map(|&id| match self.channels.route(id) {
            Ok(Route { to: MessageKind::Unread(why), .. }) => Some(why.to_string()),
            _ => None,
        })
    }

    pub(super) fn others(&self) -> Vec<OtherChannel> {
        let counts = self.statistics.as_ref().map(|s| &s.channel_message_counts);
        let line = |text| printable::line(text, MOST_OF_A_NAME);
        let other = |&id: &u16| {
            let (channel, schema) =
                self.channels.described(id).filter(|_| !self.channels.carries_bursts(id))?;
            Some(OtherChannel {
                topic: line(&channel.topic),
                schema: schema.map_or(String::new(), |schema| line(&schema.of.name)),
                message_encoding: line(&channel.message_encoding),
                messages: counts.and_then(|counts| counts.get(&id).copied()),
            })
        };
        self.channel_ids.iter().filter_map(other).take(MOST_NAMED).collect()
    }

    /// See `Recording::silent`. A recorder that connects again defines a topic once more, so that of several channels of
    /// a topic one alone may have the messages.
    pub(super) fn silent(&self) -> Vec<String> {
        let Some(counts) = self.statistics.as_ref().map(|s| &s.channel_message_counts) else {
            return Vec::new();
        };
        if self.expected().is_none() {
            return Vec::new(); // the counts by channel are optional
        }
        let mut messages: BTreeMap<&str, u64> = BTreeMap::new();
        for id in self.channel_ids.iter().filter(|&&id| self.channels.carries_bursts(id)) {
            if let Some((channel, _)) = self.channels.described(*id) {
                *messages.entry(&channel.topic).or_default() +=
                    counts.get(id).copied().unwrap_or(0);
            }
        }
        let silent = messages.into_iter().filter(|(_, n)| *n == 0).take(MOST_NAMED);
        silent.map(|(topic, _)| printable::line(topic, MOST_OF_A_NAME)).collect()
    }

    /// Whether every channel of the file is known, and what it carries.
    pub(super) fn complete(&self) -> bool {
        self.statistics.as_ref().is_some_and(|s| s.channel_count as usize == self.channel_ids.len())
            && self.channel_ids.iter().all(|&id| self.channels.route(id).is_ok())
    }

    /// See `Recording::disorder_ns`: the chunks in the order of the file, each against the latest
    /// end before it.
    pub(super) fn disorder_ns(&self) -> Option<u64> {
        let chunks = self.chunks_that_hold_messages();
        let mut latest = chunks.first()?.from_ns;
        let mut disorder = 0;
        for chunk in chunks {
            disorder = disorder.max(latest.saturating_sub(chunk.from_ns));
            latest = latest.max(chunk.to_ns);
        }
        Some(disorder)
    }

    /// See `Recording::is_shuffled`. A clock that was set back, once or a few times, leaves chunks in order but there
    /// (a chunk within which it was set counts twice); nobody sets it more often, or at half of all chunks.
    pub(super) fn is_shuffled(&self) -> bool {
        const MUCH_NS: u64 = 2_000_000_000;
        const MOST_STEPS: usize = 8;
        let chunks = self.chunks_that_hold_messages();
        let goes_back =
            |pair: &&[&ChunkSpan]| pair[0].to_ns.saturating_sub(pair[1].from_ns) > MUCH_NS;
        let steps = chunks.windows(2).filter(goes_back).count();
        steps > MOST_STEPS || (steps > 3 && 2 * steps >= chunks.len() - 1)
    }

    fn chunks_that_hold_messages(&self) -> Vec<&ChunkSpan> {
        let mut chunks: Vec<&ChunkSpan> =
            self.chunks.iter().filter(|chunk| chunk.to_ns > 0).collect();
        chunks.sort_by_key(|chunk| chunk.offset);
        chunks
    }

    /// See `Recording::expected`: the sum of the counts of the channels that carry bursts.
    pub(super) fn expected(&self) -> Option<u64> {
        let statistics = self.statistics.as_ref().filter(|_| self.complete())?;
        let counts = &statistics.channel_message_counts;
        let counted = counts.values().try_fold(0, |sum: u64, n| sum.checked_add(*n));
        if counted != Some(statistics.message_count) {
            return None; // the counts by channel are optional
        }
        let bursts = counts.iter().filter(|(id, _)| self.channels.carries_bursts(**id));
        Some(bursts.map(|(_, n)| n).sum())
    }

    fn parse(&mut self, section: &[u8]) -> Option<()> {
        let mut at = 0;
        while at < section.len() {
            let record = record_at(section, at)?;
            let body = &section[record.from..record.to];
            match record.opcode {
                op::SCHEMA => self.channels.define_schema(SchemaRecord::parse(body)?).ok()?,
                op::CHANNEL => {
                    let channel = ChannelRecord::parse(body)?;
                    if self.channels.known_channel(channel).is_none() {
                        self.channel_ids.push(channel.id);
                    }
                    self.channels.define_channel(channel).ok()?;
                }
                op::STATISTICS => self.statistics = Some(statistics(body)?),
                op::CHUNK_INDEX => self.chunks.extend(ChunkSpan::parse(body)),
                _ => {}
            }
            at = record.to;
        }
        Some(())
    }
}
