//! Counts what there is in a recording, whoever wrote it: sizes of messages and rates. `inkling
//! inspect` shows these counts, and the proposal of a dialect (`dialect::guess`) begins with the
//! schema and the first message of a channel.
//!
//! In: messages as a counting `BlockReader` meets them. Out: a [`TopicSummary`] for each MCAP
//! channel, sorted by topic. Memory is bounded whatever the file: ids have 16 bits, and first
//! messages are kept only up to the limits below. A topic has several channels if several programs
//! wrote to it.

pub use super::channels::MessageKind;
use super::channels::{Channel, Channels, KnownSchema};
use super::dialect::plan::{ChannelDescription, Schema};
use super::mcap_records::MessageHeader;
use super::printable;
use bytes::Bytes;
use std::collections::HashMap;
use std::sync::Arc;

/// Most bytes of all first messages together that are kept.
const MOST_KEPT_BYTES: usize = 64 << 20;
/// Most messages after the first one of a channel that are kept.
const MOST_NEXT: usize = 2;
/// Most bytes of a schema that is told.
const MOST_SCHEMA_BYTES: usize = 1 << 20;

/// The messages of one MCAP channel, counted, and how they are written.
#[derive(Clone, Debug, Default)]
pub struct TopicSummary {
    pub topic: String,
    pub message_encoding: String,
    pub schema_name: String,
    pub schema_encoding: String,
    /// The whole schema, if it is small enough.
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
    pub first_message: Option<Bytes>,
    /// The two after it, at most: the first alone may be cut or of another kind.
    pub next_messages: Vec<Bytes>,
    pub kind: MessageKind,
}

#[derive(Debug, Default)]
pub(super) struct Census {
    /// By id, of channels that have had a message; described as they were at the first.
    counted: HashMap<u16, TopicSummary>,
    /// Bytes of the first messages that are kept.
    kept: usize,
}

impl TopicSummary {
    /// Of a channel that has had no message so far.
    fn without_messages(channel: &Channel, schema: Option<&KnownSchema>) -> TopicSummary {
        let name_of = |of: fn(&Schema) -> &String| {
            schema.map_or(String::new(), |schema| of(&schema.of).clone())
        };
        let small = |schema: &&KnownSchema| {
            schema.whole && schema.of.data.len() + schema.of.name.len() <= MOST_SCHEMA_BYTES
        };
        TopicSummary {
            topic: channel.topic.clone(),
            message_encoding: channel.message_encoding.clone(),
            schema_name: name_of(|schema| &schema.name),
            schema_encoding: name_of(|schema| &schema.encoding),
            schema: schema.filter(small).map(|schema| schema.of.clone()),
            without_schema: channel.schema_id == 0,
            smallest: u64::MAX,
            first_ns: u64::MAX,
            ..TopicSummary::default()
        }
    }

    /// The channel for whoever plans how to read its messages. `None`: the schema is too large.
    pub fn written(&self) -> Option<ChannelDescription<'_>> {
        let known = self.without_schema || self.schema.is_some();
        known.then(|| ChannelDescription {
            topic: &self.topic,
            message_encoding: &self.message_encoding,
            schema: self.schema.as_deref(),
        })
    }

    /// The encodings of its messages and of its schema, if that is another one, such as `cdr, ros2msg`.
    pub fn encoding(&self) -> String {
        const MOST_OF_A_NAME: usize = 120;
        let short = |text: &str| printable::line(text, MOST_OF_A_NAME);
        let [message, schema] = [&self.message_encoding, &self.schema_encoding].map(|of| short(of));
        match schema == message || self.without_schema {
            true => message,
            false => format!("{message}, {schema}"),
        }
    }

    /// Messages per second, by log times. `None`: fewer than two messages, or all at one time.
    pub fn rate_hz(&self) -> Option<f64> {
        let seconds = self.last_ns.saturating_sub(self.first_ns) as f64 / 1e9;
        (self.messages > 1 && seconds > 0.0).then(|| (self.messages - 1) as f64 / seconds)
    }
}

impl Census {
    /// `channels`: with the message's channel among them.
    pub(super) fn see_message(
        &mut self,
        header: MessageHeader,
        channels: &Channels,
        to: &MessageKind,
        message: Bytes,
    ) {
        let Some((channel, schema)) = channels.described(header.channel_id) else { return };
        let new = || TopicSummary::without_messages(channel, schema);
        let summary = self.counted.entry(header.channel_id).or_insert_with(new);
        if summary.messages == 0 {
            summary.kind = to.clone();
        }
        if summary.messages <= MOST_NEXT as u64 && self.kept + message.len() <= MOST_KEPT_BYTES {
            self.kept += message.len();
            let kept = Bytes::copy_from_slice(&message);
            match summary.messages {
                0 => summary.first_message = Some(kept),
                _ => summary.next_messages.push(kept),
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
        self.counted.values().filter(|summary| fits(summary)).count()
    }

    /// Summaries of all channels that have messages or are defined, in the order of their topics.
    pub fn topics(mut self, channels: &Channels) -> Vec<TopicSummary> {
        let summary = |id: u16| {
            let without = |(channel, schema)| TopicSummary::without_messages(channel, schema);
            self.counted.remove(&id).or_else(|| channels.described(id).map(without))
        };
        let mut topics: Vec<TopicSummary> = (0..=u16::MAX).filter_map(summary).collect();
        // of channels with one topic the order of their ids stays
        topics.sort_by(|a, b| a.topic.cmp(&b.topic));
        topics
    }
}
