//! Counts what there is in a recording, whoever wrote it: channels, schemas, sizes of messages and
//! rates. `inkling inspect` shows these counts, and the proposal of a dialect (`dialect::guess`)
//! begins with the schema and first message that the census keeps.
//!
//! In: records as a counting `BlockReader` meets them. Out: a [`TopicSummary`] for each MCAP
//! channel, sorted by topic. Memory is bounded whatever the file: ids have 16 bits, and schemas and
//! first messages are kept only up to the limits below. A topic has several channels if several
//! programs wrote to it.

pub use super::channels::MessageKind;
use super::dialect::plan::{ChannelDescription, Schema};
use super::mcap_records::{ChannelRecord, MessageHeader, SchemaRecord, op};
use bytes::Bytes;
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::sync::Arc;

/// Most bytes of all schemas and first messages together that are kept.
const MOST_KEPT_BYTES: usize = 64 << 20;
/// Most bytes of one schema or first message that is kept.
const MOST_OF_ONE: usize = 1 << 20;
/// Most bytes that are kept of a topic, a schema's name or an encoding.
const MOST_NAME_BYTES: usize = 4096;

/// The messages of one MCAP channel, counted, and how they are written.
#[derive(Clone, Debug, Default)]
pub struct TopicSummary {
    pub topic: String,
    pub message_encoding: String,
    pub schema_name: String,
    pub schema_encoding: String,
    /// The whole schema, if it was small enough to be kept.
    pub schema: Option<Arc<Schema>>,
    /// Whether the channel has no schema, as channels of JSON may.
    pub without_schema: bool,
    pub messages: u64,
    pub bytes: u64,
    /// Bytes of the smallest and of the largest message; `u64::MAX` and 0 before the first message.
    pub smallest: u64,
    pub largest: u64,
    /// The earliest and the latest log time, ns since 1970.
    pub first_ns: u64,
    pub last_ns: u64,
    /// The first message, if it was small enough to be kept.
    pub first_message: Option<Bytes>,
    pub kind: MessageKind,
}

/// Counts the messages of a recording, channel by channel.
#[derive(Debug, Default)]
pub struct Census {
    schemas: HashMap<u16, SchemaSummary>,
    /// The channels by id, each with the id of its schema.
    channels: HashMap<u16, (u16, TopicSummary)>,
    /// Bytes of the schemas and first messages that are kept.
    kept: usize,
}

/// A schema's name and encoding, and the whole schema if it was small enough to be kept.
#[derive(Clone, Debug)]
struct SchemaSummary {
    name: String,
    encoding: String,
    whole: Option<Arc<Schema>>,
}

impl TopicSummary {
    /// How the channel's messages are written, for whoever plans how to read them. `None`: the
    /// schema was too large to be kept.
    pub fn written(&self) -> Option<ChannelDescription<'_>> {
        // a channel without a schema is known as such
        let known = self.without_schema || self.schema.is_some();
        known.then(|| ChannelDescription {
            topic: &self.topic,
            message_encoding: &self.message_encoding,
            schema: self.schema.as_deref(),
        })
    }

    /// Messages per second, by log times. `None`: fewer than two messages, or all at one time.
    pub fn rate_hz(&self) -> Option<f64> {
        let seconds = self.last_ns.saturating_sub(self.first_ns) as f64 / 1e9;
        (self.messages > 1 && seconds > 0.0).then(|| (self.messages - 1) as f64 / seconds)
    }
}

fn shortened(text: &str) -> String {
    text[..text.floor_char_boundary(MOST_NAME_BYTES)].to_owned()
}

impl Census {
    /// Takes note of a schema or a channel, if the record defines one. If an id is defined several
    /// times, the first definition holds.
    pub(super) fn see_definition(&mut self, opcode: u8, body: &[u8]) {
        match opcode {
            op::SCHEMA => {
                let Some(schema) = SchemaRecord::parse(body) else { return };
                let Entry::Vacant(new) = self.schemas.entry(schema.id) else { return };
                let bytes = schema.data.len() + schema.name.len();
                let keep = bytes <= MOST_OF_ONE && self.kept + bytes <= MOST_KEPT_BYTES;
                let (name, encoding) = (shortened(schema.name), shortened(schema.encoding));
                let whole = keep.then(|| {
                    self.kept += bytes;
                    let data = schema.data.to_vec();
                    Arc::new(Schema { name: name.clone(), encoding: encoding.clone(), data })
                });
                new.insert(SchemaSummary { name, encoding, whole });
            }
            op::CHANNEL => {
                let Some(channel) = ChannelRecord::parse(body) else { return };
                let Entry::Vacant(new) = self.channels.entry(channel.id) else { return };
                let summary = TopicSummary {
                    topic: shortened(channel.topic),
                    message_encoding: shortened(channel.message_encoding),
                    without_schema: channel.schema_id == 0,
                    smallest: u64::MAX,
                    first_ns: u64::MAX,
                    ..TopicSummary::default()
                };
                new.insert((channel.schema_id, summary));
            }
            _ => {}
        }
    }

    /// Counts a message.
    pub(super) fn see_message(&mut self, header: MessageHeader, to: &MessageKind, message: Bytes) {
        let Some((_, summary)) = self.channels.get_mut(&header.channel_id) else { return };
        if summary.messages == 0 {
            summary.kind = to.clone();
            let bytes = message.len();
            if bytes <= MOST_OF_ONE && self.kept + bytes <= MOST_KEPT_BYTES {
                self.kept += bytes;
                summary.first_message = Some(Bytes::copy_from_slice(&message));
            }
        }
        let bytes = message.len() as u64;
        summary.messages += 1;
        summary.bytes = summary.bytes.saturating_add(bytes);
        summary.smallest = summary.smallest.min(bytes);
        summary.largest = summary.largest.max(bytes);
        summary.first_ns = summary.first_ns.min(header.log_time);
        summary.last_ns = summary.last_ns.max(header.log_time);
    }

    /// How many channels have messages and a dialect that fits them, even if the dialect cannot
    /// read them.
    pub(super) fn foreign(&self) -> usize {
        let fits = |summary: &TopicSummary| {
            matches!(summary.kind, MessageKind::Foreign(_) | MessageKind::Unread(_))
        };
        self.channels.values().filter(|(_, summary)| fits(summary)).count()
    }

    /// A channel by its id, and the name of its schema. `None`: there is no channel with that id.
    pub(super) fn channel(&self, id: u16) -> Option<(&TopicSummary, &str)> {
        let (schema, summary) = self.channels.get(&id)?;
        Some((summary, self.schemas.get(schema).map_or("", |schema| &schema.name)))
    }

    /// Summaries of all channels, in the order of their topics.
    pub fn topics(self) -> Vec<TopicSummary> {
        let mut channels: Vec<_> = self.channels.into_iter().collect();
        channels.sort_unstable_by(|(a, (_, x)), (b, (_, y))| (&x.topic, a).cmp(&(&y.topic, b)));
        let summary = |(_, (schema, mut summary)): (u16, (u16, TopicSummary))| {
            if let Some(of) = self.schemas.get(&schema) {
                summary.schema_name.clone_from(&of.name);
                summary.schema_encoding.clone_from(&of.encoding);
                summary.schema.clone_from(&of.whole);
            }
            summary
        };
        channels.into_iter().map(summary).collect()
    }
}
