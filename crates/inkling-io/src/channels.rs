//! Knows the schemas and channels of a recording, and says what becomes of a channel's messages:
//! bursts of our own, bursts by a dialect, or nothing.
//!
//! MCAP names a channel in each message by a number (16 bits), which a channel record defines
//! earlier in the file; that record refers to a schema record by another number. In: those records,
//! from readers of blocks and of the summary. Out: the [`Route`] of a channel id, and how a channel
//! is [described](Channels::described).
//!
//! The rule of [`Channels::route`]: schema `inkling.Burst` in protobuf gives bursts; otherwise the
//! first dialect that fits both topic and schema name reads the messages, by a [`Plan`] that is
//! made once; otherwise the messages are passed over.

use super::burst_codec::{MESSAGE_ENCODING, SCHEMA_NAME, topic_printhead};
use super::dialect::Dialects;
use super::dialect::plan::{ChannelDescription, Plan, Schema};
use super::mcap_records::{ChannelRecord, SchemaRecord};
use std::collections::HashMap;
use std::sync::{Arc, OnceLock};
use thiserror::Error;

/// What becomes of a channel's messages.
#[derive(Clone, Debug, Default)]
pub enum MessageKind {
    /// They are `inkling.Burst` in protobuf.
    Bursts,
    /// A dialect makes bursts of them.
    Foreign(Arc<Plan>),
    /// A dialect fits the topic but cannot read the messages; the text says why.
    Unread(Arc<str>),
    /// Their schema is called `inkling.Burst`, but they are not in protobuf.
    OtherEncoding,
    /// They are no bursts, and are passed over.
    #[default]
    Nothing,
}

/// Where the messages of a channel go.
#[derive(Clone, Debug)]
pub(super) struct Route {
    pub to: MessageKind,
    /// The printhead that the channel's topic names, for messages that name none.
    pub printhead: Option<Arc<str>>,
    /// The number of the dialect that fits the channel.
    dialect: Option<usize>,
}

/// Why a record inside a block is of no use. Its words become damage. Numbers are MCAP's ids; a
/// text says of which kind the record is ("schema" or "channel").
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Error)]
pub(super) enum RecordError {
    #[error("message on channel {0}, which is not defined")]
    UnknownChannel(u16),
    #[error("message on channel {channel}, whose schema {schema} is not defined")]
    UnknownSchema { channel: u16, schema: u16 },
    #[error("message shorter than its header")]
    ShortMessage,
    #[error("malformed {0} record")]
    Malformed(&'static str),
    #[error("{0} {1} defined again as another; the first definition holds")]
    Redefined(&'static str, u16),
}

/// The schemas and channels that are defined so far, by id.
#[derive(Clone, Debug, Default)]
pub(super) struct Channels {
    dialects: Dialects,
    /// What was defined before, which holds where an id is defined again.
    before: Option<Arc<Channels>>,
    schemas: HashMap<u16, KnownSchema>,
    channels: HashMap<u16, Arc<Channel>>,
    /// Bytes of schemas that are kept so far.
    kept: usize,
}

/// Bytes of schemas that are kept.
const MOST_KEPT_BYTES: usize = 64 << 20;
/// Most bytes that are kept of a topic, of an encoding, and of the name of a schema that is not kept, so that
/// 65,536 channels and as many schemas stay small.
const MOST_NAME_BYTES: usize = 512;

#[derive(Clone, Debug)]
pub(super) struct KnownSchema {
    pub of: Arc<Schema>,
    /// Whether there was room for it; otherwise `of` has no data.
    pub whole: bool,
}

#[derive(Debug)]
pub(super) struct Channel {
    pub schema_id: u16,
    pub topic: String,
    pub message_encoding: String,
    /// Whether the topic was longer than what is kept of it; no dialect fits such a channel.
    is_cut: bool,
    /// Made when it is asked for and the schema is known.
    route: OnceLock<Route>,
}

impl KnownSchema {
    fn is_bursts(&self) -> bool {
        self.of.name == SCHEMA_NAME
    }
}

impl Channel {
    fn of(record: ChannelRecord<'_>) -> Channel {
        let ChannelRecord { schema_id, topic, message_encoding, .. } = record;
        let is_cut = topic.len() > MOST_NAME_BYTES;
        let (topic, message_encoding) = (shortened(topic), shortened(message_encoding));
        Channel { schema_id, topic, message_encoding, is_cut, route: OnceLock::new() }
    }

    /// The printhead that the topic names; a long name is none.
    fn printhead(&self) -> Option<&str> {
        const MOST_BYTES: usize = 256;
        topic_printhead(&self.topic).filter(|name| name.len() <= MOST_BYTES)
    }

    fn is_protobuf(&self) -> bool {
        // as the registry of MCAP spells it, or as people do
        [MESSAGE_ENCODING, "proto"].iter().any(|of| self.message_encoding.eq_ignore_ascii_case(of))
    }
}

fn shortened(text: &str) -> String {
    text[..text.floor_char_boundary(MOST_NAME_BYTES)].to_owned()
}

impl Channels {
    pub(super) fn new(dialects: &Dialects) -> Channels {
        Channels { dialects: dialects.clone(), ..Channels::default() }
    }

    /// The same, to define more on top, which `before` does not get to know.
    pub(super) fn on_top_of(before: Arc<Channels>) -> Channels {
        Channels { before: Some(before.clone()), ..Channels::new(&before.dialects) }
    }

    fn schema(&self, id: u16) -> Option<&KnownSchema> {
        self.before.as_ref().and_then(|of| of.schema(id)).or_else(|| self.schemas.get(&id))
    }

    fn channel(&self, id: u16) -> Option<&Arc<Channel>> {
        self.before.as_ref().and_then(|of| of.channel(id)).or_else(|| self.channels.get(&id))
    }

    pub(super) fn described(&self, id: u16) -> Option<(&Channel, Option<&KnownSchema>)> {
        let channel = self.channel(id)?;
        Some((channel, self.schema(channel.schema_id).filter(|_| channel.schema_id != 0)))
    }

    /// Defines a schema. If there are several definitions of an id, the first holds, and another one that
    /// differs is an error.
    pub(super) fn define_schema(&mut self, record: SchemaRecord<'_>) -> Result<(), RecordError> {
        if let Some(known) = self.known_schema(record) {
            return known;
        }
        let SchemaRecord { id, name, encoding, data } = record;
        let bytes = name.len() + encoding.len() + data.len();
        let whole = self.kept + bytes <= MOST_KEPT_BYTES;
        let of = match whole {
            true => Schema { name: name.into(), encoding: encoding.into(), data: data.into() },
            false => Schema { name: shortened(name), encoding: shortened(encoding), data: vec![] },
        };
        self.kept += if whole { bytes } else { 0 };
        self.schemas.insert(id, KnownSchema { of: Arc::new(of), whole });
        Ok(())
    }

    /// Defines a channel; several definitions are treated like those of a schema.
    pub(super) fn define_channel(&mut self, record: ChannelRecord<'_>) -> Result<(), RecordError> {
        if let Some(known) = self.known_channel(record) {
            return known;
        }
        self.channels.insert(record.id, Arc::new(Channel::of(record)));
        Ok(())
    }

    /// What was defined before under the schema's id: `Ok` if it is the same schema as far as routes
    /// depend on it, an error if it is another one. `None`: nothing was.
    pub(super) fn known_schema(&self, record: SchemaRecord<'_>) -> Option<Result<(), RecordError>> {
        let SchemaRecord { id, name, encoding, data } = record;
        let KnownSchema { of, whole } = self.schema(id)?;
        let same_content = (&*of.name, &*of.encoding, &*of.data) == (name, encoding, data);
        let same = (of.name == SCHEMA_NAME) == (name == SCHEMA_NAME)
            && (same_content || !whole || self.dialects.is_empty());
        Some(same.then_some(()).ok_or(RecordError::Redefined("schema", id)))
    }

    /// Does for a channel what `known_schema` does for a schema.
    pub(super) fn known_channel(
        &self,
        record: ChannelRecord<'_>,
    ) -> Option<Result<(), RecordError>> {
        let (known, new) = (self.channel(record.id)?, Channel::of(record));
        let fits = |of: &Channel| !of.is_cut && self.dialects.fit_topic(&of.topic);
        let same_names =
            (&known.topic, &known.message_encoding) == (&new.topic, &new.message_encoding);
        let same = (known.schema_id, known.is_protobuf(), known.printhead())
            == (new.schema_id, new.is_protobuf(), new.printhead())
            && (same_names || !fits(known) && !fits(&new));
        Some(same.then_some(()).ok_or(RecordError::Redefined("channel", record.id)))
    }

    /// What becomes of a channel's messages. An error if the channel or its schema is not defined.
    pub(super) fn route(&self, channel_id: u16) -> Result<Route, RecordError> {
        let (channel, schema) =
            self.described(channel_id).ok_or(RecordError::UnknownChannel(channel_id))?;
        if schema.is_none() && channel.schema_id != 0 {
            let schema = channel.schema_id;
            return Err(RecordError::UnknownSchema { channel: channel_id, schema });
        }
        Ok(channel.route.get_or_init(|| self.new_route(channel, schema)).clone())
    }

    fn new_route(&self, channel: &Channel, schema: Option<&KnownSchema>) -> Route {
        // our own messages first, then dialects; the name `inkling.Burst` in another encoding stays
        // an error
        let bursts = schema.is_some_and(KnownSchema::is_bursts);
        let own = bursts && channel.is_protobuf();
        let first = || self.dialects.first(&channel.topic, schema.map(|of| &*of.of.name));
        let dialect = if own || channel.is_cut { None } else { first() };
        let to = match dialect {
            Some(number) => self.foreign(number, channel, schema),
            None if own => MessageKind::Bursts,
            None if bursts => MessageKind::OtherEncoding,
            None => MessageKind::Nothing,
        };
        Route { to, printhead: channel.printhead().map(Arc::from), dialect }
    }

    /// If the dialect that fits cannot read the channel, no further dialect is tried.
    fn foreign(
        &self,
        number: usize,
        channel: &Channel,
        schema: Option<&KnownSchema>,
    ) -> MessageKind {
        if schema.is_some_and(|schema| !schema.whole) {
            let why = format!(
                "input.dialect[{number}] fits a channel that cannot be read: the recording's schemas take more \
                 than {} MiB",
                MOST_KEPT_BYTES >> 20
            );
            return MessageKind::Unread(why.into());
        }
        let written = ChannelDescription {
            topic: &channel.topic,
            message_encoding: &channel.message_encoding,
            schema: schema.map(|schema| &*schema.of),
        };
        match self.dialects.plan(number, &written) {
            Ok(plan) => MessageKind::Foreign(Arc::new(plan)),
            Err(why) => MessageKind::Unread(why.into()),
        }
    }

    /// Whether messages of a channel are bursts or should be, even if they cannot be read.
    pub(super) fn carries_bursts(&self, channel_id: u16) -> bool {
        self.route(channel_id).is_ok_and(|route| !matches!(route.to, MessageKind::Nothing))
    }

    /// One number for each channel that a dialect reads, in the order of the channels' ids.
    pub(super) fn dialects_used(&self) -> Vec<usize> {
        (0..=u16::MAX).filter_map(|id| self.route(id).ok()?.dialect).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::dialect::settings::Dialect;
    use super::*;

    /// A dialect for these topics and this schema, or for any.
    fn dialects(topic: &str, schema: Option<&str>) -> Dialects {
        let dialect: Dialect = serde_json::from_value(serde_json::json!({
            "topic": topic, "schema": schema,
            "samples": "data", "channels": 2, "period_s": 1e-6, "printhead": "p"
        }))
        .unwrap();
        Dialects::new(&[dialect]).unwrap()
    }

    #[test]
    fn schemas_are_kept_up_to_64_mib() {
        let data = vec![0; 20 << 20];
        let mut channels = Channels::default();
        for id in 1..=5 {
            let record = SchemaRecord { id, name: "acme.Wave", encoding: "protobuf", data: &data };
            channels.define_schema(record).unwrap();
        }
        assert_eq!(channels.schemas.len(), 5, "known all the same");
        assert_eq!(channels.schemas.values().filter(|schema| schema.whole).count(), 3);
    }

    #[test]
    fn no_dialect_fits_a_topic_of_which_only_a_part_is_kept() {
        let becomes = |bytes: usize| {
            let mut channels = Channels::new(&dialects("**", None));
            let topic = format!("/{}", "a".repeat(bytes - 1));
            let record =
                ChannelRecord { id: 7, schema_id: 0, topic: &topic, message_encoding: "json" };
            channels.define_channel(record).unwrap();
            channels.route(7).unwrap().to
        };
        assert!(matches!(becomes(MOST_NAME_BYTES), MessageKind::Foreign(_)));
        assert!(matches!(becomes(MOST_NAME_BYTES + 1), MessageKind::Nothing));
    }

    #[test]
    fn a_channel_that_finds_no_room_is_told_of_where_a_dialect_fits_it() {
        let data = vec![0; MOST_KEPT_BYTES];
        let becomes = |name: &str, kept: usize| {
            let dialects = dialects("/a", Some("acme.Wave"));
            let mut channels = Channels { kept, ..Channels::new(&dialects) };
            let schema = SchemaRecord { id: 1, name, encoding: "", data: &data };
            channels.define_schema(schema).unwrap();
            let channel =
                ChannelRecord { id: 7, schema_id: 1, topic: "/a", message_encoding: "json" };
            channels.define_channel(channel).unwrap();
            channels.route(7).unwrap().to
        };
        for kept in [0, MOST_KEPT_BYTES] {
            let told = becomes("acme.Wave", kept);
            assert!(
                matches!(&told, MessageKind::Unread(why) if why.contains("64 MiB")),
                "{told:?}"
            );
            assert!(matches!(becomes("acme.Other", kept), MessageKind::Nothing));
        }
    }
}
