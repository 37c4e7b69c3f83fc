//! Says what becomes of a channel's messages: bursts of our own, bursts by a dialect, or nothing.
//!
//! MCAP names a channel in each message by a number (16 bits), which a channel record defines
//! earlier in the file; that record refers to a schema record by another number. In: those records,
//! from readers of blocks and of the summary. Out: the [`Route`] of a channel id. This file keeps
//! of both kinds of records only what routes need: whether the schema is `inkling.Burst`, which
//! dialects fit, and which printhead the topic names.
//!
//! The rule of [`Channels::route_with`]: schema `inkling.Burst` in protobuf gives bursts; otherwise
//! the first dialect that fits both topic and schema name reads the messages, by a [`Plan`] that is
//! made once; otherwise the messages are passed over.

use super::burst_codec::{MESSAGE_ENCODING, SCHEMA_NAME, topic_printhead};
use super::dialect::plan::{ChannelDescription, Plan, Schema};
use super::dialect::{DialectSet, Dialects};
use super::mcap_records::{ChannelRecord, SchemaRecord};
use std::collections::HashMap;
use std::fmt;
use std::sync::{Arc, OnceLock};

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
}

/// Why a record inside a block is of no use. Its words become damage. Numbers are MCAP's ids; a
/// text says of which kind the record is ("schema" or "channel").
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum RecordError {
    UnknownChannel(u16),
    UnknownSchema { channel: u16, schema: u16 },
    ShortMessage,
    Malformed(&'static str),
    Redefined(&'static str, u16),
}

impl fmt::Display for RecordError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            RecordError::UnknownChannel(id) => {
                write!(f, "message on channel {id}, which is not defined")
            }
            RecordError::UnknownSchema { channel, schema } => {
                write!(f, "message on channel {channel}, whose schema {schema} is not defined")
            }
            RecordError::ShortMessage => write!(f, "message shorter than its header"),
            RecordError::Malformed(what) => write!(f, "malformed {what} record"),
            RecordError::Redefined(what, id) => {
                write!(f, "{what} {id} defined again as another; the first definition holds")
            }
        }
    }
}

/// The schemas and channels that are defined so far, by id.
#[derive(Clone, Debug, Default)]
pub(super) struct Channels {
    dialects: Dialects,
    schemas: HashMap<u16, KnownSchema>,
    channels: HashMap<u16, Channel>,
    /// Bytes of schemas, topics and encodings that are kept for dialects so far.
    kept: usize,
}

/// Bytes of schemas, topics and encodings that are kept for dialects.
const MOST_KEPT_BYTES: usize = 64 << 20;

#[derive(Clone, Debug, PartialEq, Eq)]
struct KnownSchema {
    /// Whether it is called `inkling.Burst`.
    bursts: bool,
    fits: DialectSet,
    /// The whole record, if a dialect may need it and there was room.
    whole: Option<Arc<Schema>>,
}

#[derive(Clone, Debug)]
struct Channel {
    schema_id: u16,
    protobuf: bool,
    printhead: Option<Arc<str>>,
    fits: DialectSet,
    /// What the dialects that fit need to know of the channel. `None`: no dialect fits the topic,
    /// or there was no room for the topic.
    foreign: Option<Foreign>,
}

/// A channel whose topic at least one dialect fits.
#[derive(Clone, Debug)]
struct Foreign {
    topic: Arc<str>,
    message_encoding: Arc<str>,
    /// Which dialect reads the channel, and how.
    plan: OnceLock<NumberedPlan>,
}

/// The dialect that reads a channel, by its number, and how; or why it cannot read it.
#[derive(Clone, Debug)]
struct NumberedPlan {
    number: usize,
    plan: Result<Arc<Plan>, Arc<str>>,
}

impl Channel {
    /// The channel that a record defines. `room`: how many bytes may still be kept for dialects.
    fn of(record: ChannelRecord<'_>, dialects: &Dialects, room: usize) -> Channel {
        let fits = fits(record, dialects);
        let keep = fits.any() && record.topic.len() + record.message_encoding.len() <= room;
        Channel {
            schema_id: record.schema_id,
            protobuf: record.message_encoding == MESSAGE_ENCODING,
            printhead: printhead(record).map(Arc::from),
            fits,
            foreign: keep.then(|| Foreign {
                topic: record.topic.into(),
                message_encoding: record.message_encoding.into(),
                plan: OnceLock::new(),
            }),
        }
    }

    /// Whether a record defines the same channel again, as far as routes depend on it. Where the
    /// topic was not kept, only the set of dialects that fit it is compared.
    fn is(&self, record: ChannelRecord<'_>, dialects: &Dialects) -> bool {
        let ChannelRecord { schema_id, topic, message_encoding, .. } = record;
        let same_topic = || match &self.foreign {
            Some(kept) => (&*kept.topic, &*kept.message_encoding) == (topic, message_encoding),
            None => self.fits == fits(record, dialects),
        };
        (self.schema_id, self.protobuf, self.printhead.as_deref())
            == (schema_id, message_encoding == MESSAGE_ENCODING, printhead(record))
            && same_topic()
    }

    /// What the first dialect that fits this channel's topic and schema makes of its messages;
    /// nothing if none fits. A dialect that fits and cannot read the channel gives `Unread` with
    /// the reason: no further dialect is tried.
    fn kind(&self, dialects: &Dialects, schema: Option<&KnownSchema>) -> MessageKind {
        let of_schema = schema.map_or_else(|| dialects.of_schema(None), |schema| schema.fits);
        let Some(number) = self.fits.and(of_schema).first() else { return MessageKind::Nothing };

        // without the topic, or without the schema that the channel has, no plan can be made
        let whole = schema.map(|schema| schema.whole.as_deref());
        let (Some(foreign), None | Some(Some(_))) = (&self.foreign, whole) else {
            let why = format!(
                "input.dialect[{number}] fits a channel that cannot be read: the recording's schemas and topics \
                 take more than {} MiB",
                MOST_KEPT_BYTES >> 20
            );
            return MessageKind::Unread(why.into());
        };

        let planned = foreign.plan.get_or_init(|| {
            let written = ChannelDescription {
                topic: &foreign.topic,
                message_encoding: &foreign.message_encoding,
                schema: whole.flatten(),
            };
            let plan = dialects.plan(number, &written).map(Arc::new).map_err(Arc::from);
            NumberedPlan { number, plan }
        });
        match &planned.plan {
            Ok(plan) => MessageKind::Foreign(plan.clone()),
            Err(why) => MessageKind::Unread(why.clone()),
        }
    }

    /// Bytes that are kept of this channel for dialects.
    fn kept(&self) -> usize {
        self.foreign.as_ref().map_or(0, |of| of.topic.len() + of.message_encoding.len())
    }
}

/// The dialects that a channel's topic fits.
fn fits(record: ChannelRecord<'_>, dialects: &Dialects) -> DialectSet {
    const MOST_BYTES: usize = 4096;
    match record.topic.len().max(record.message_encoding.len()) <= MOST_BYTES {
        true => dialects.of_topic(record.topic),
        false => DialectSet::default(),
    }
}

/// The printhead that a channel's topic names. Long names are not taken, so that 65,536 channels stay small.
fn printhead(record: ChannelRecord<'_>) -> Option<&str> {
    const MOST_BYTES: usize = 256;
    topic_printhead(record.topic).filter(|name| name.len() <= MOST_BYTES)
}

impl Channels {
    /// Nothing defined yet; `dialects` are those of the settings.
    pub(super) fn new(dialects: &Dialects) -> Channels {
        Channels { dialects: dialects.clone(), ..Channels::default() }
    }

    /// The same dialects, and nothing defined.
    pub(super) fn without_any(&self) -> Channels {
        Channels::new(&self.dialects)
    }

    /// Defines a schema. If there are several definitions of an id, the first holds, and another one that
    /// differs is an error.
    pub(super) fn define_schema(&mut self, record: SchemaRecord<'_>) -> Result<(), RecordError> {
        if let Some(known) = self.known_schema(record) {
            return known;
        }
        let SchemaRecord { id, name, encoding, data } = record;
        let bytes = name.len() + encoding.len() + data.len();
        let keep = !self.dialects.is_empty() && self.kept + bytes <= MOST_KEPT_BYTES;
        self.kept += if keep { bytes } else { 0 };
        let whole = keep.then(|| {
            let (name, encoding) = (name.to_owned(), encoding.to_owned());
            Arc::new(Schema { name, encoding, data: data.to_vec() })
        });
        let (bursts, fits) = (name == SCHEMA_NAME, self.dialects.of_schema(Some(name)));
        self.schemas.insert(id, KnownSchema { bursts, fits, whole });
        Ok(())
    }

    /// Defines a channel; several definitions are treated like those of a schema.
    pub(super) fn define_channel(&mut self, record: ChannelRecord<'_>) -> Result<(), RecordError> {
        if let Some(known) = self.known_channel(record) {
            return known;
        }
        let room = MOST_KEPT_BYTES.saturating_sub(self.kept);
        let channel = Channel::of(record, &self.dialects, room);
        self.kept += channel.kept();
        self.channels.insert(record.id, channel);
        Ok(())
    }

    /// What was defined before under the schema's id: `Ok` if it is the same schema, an error if it
    /// is another one. `None`: nothing was.
    pub(super) fn known_schema(&self, record: SchemaRecord<'_>) -> Option<Result<(), RecordError>> {
        let same = self.schemas.get(&record.id)?.is(record);
        Some(same.then_some(()).ok_or(RecordError::Redefined("schema", record.id)))
    }

    /// What was defined before under the channel's id: `Ok` if it is the same channel, an error if
    /// it is another one. `None`: nothing was.
    pub(super) fn known_channel(
        &self,
        record: ChannelRecord<'_>,
    ) -> Option<Result<(), RecordError>> {
        let same = self.channels.get(&record.id)?.is(record, &self.dialects);
        Some(same.then_some(()).ok_or(RecordError::Redefined("channel", record.id)))
    }

    /// What becomes of a channel's messages. An error if the channel or its schema is not defined.
    pub(super) fn route(&self, channel_id: u16) -> Result<Route, RecordError> {
        self.route_with(self, channel_id)
    }

    /// Like `route`, but the channel's schema may also be defined in `more_schemas`: the summary
    /// and the blocks complete each other.
    pub(super) fn route_with(
        &self,
        more_schemas: &Channels,
        channel_id: u16,
    ) -> Result<Route, RecordError> {
        let channel =
            self.channels.get(&channel_id).ok_or(RecordError::UnknownChannel(channel_id))?;
        let id = channel.schema_id;
        let known = [&self.schemas, &more_schemas.schemas];
        let schema = match known.iter().find_map(|schemas| schemas.get(&id)) {
            _ if id == 0 => None, // without a schema
            Some(schema) => Some(schema),
            None => return Err(RecordError::UnknownSchema { channel: channel_id, schema: id }),
        };

        // our own messages first, then dialects; the name `inkling.Burst` in another encoding stays
        // an error
        let bursts = schema.is_some_and(|schema| schema.bursts);
        let to = match bursts && channel.protobuf {
            true => MessageKind::Bursts,
            false => match channel.kind(&self.dialects, schema) {
                MessageKind::Nothing if bursts => MessageKind::OtherEncoding,
                kind => kind,
            },
        };
        Ok(Route { to, printhead: channel.printhead.clone() })
    }

    /// Whether messages of a channel are bursts or should be, even if they cannot be read.
    pub(super) fn carries_bursts(&self, channel_id: u16) -> bool {
        self.route(channel_id).is_ok_and(|route| !matches!(route.to, MessageKind::Nothing))
    }

    /// The numbers of the dialects that read channels: one number for each such channel, in the order of the
    /// channels' ids.
    pub(super) fn dialects_used(&self) -> Vec<usize> {
        let number = |id: u16| {
            self.route(id).ok()?; // makes the plan, if there is none yet
            Some(self.channels.get(&id)?.foreign.as_ref()?.plan.get()?.number)
        };
        (0..=u16::MAX).filter_map(number).collect()
    }
}

impl KnownSchema {
    /// Whether a record defines the same schema again, as far as routes depend on it. Of a schema
    /// that was not kept only one thing is compared: whether it is called `inkling.Burst`.
    fn is(&self, record: SchemaRecord<'_>) -> bool {
        self.bursts == (record.name == SCHEMA_NAME)
            && self.whole.as_ref().is_none_or(|whole| {
                (&*whole.name, &*whole.encoding, &*whole.data)
                    == (record.name, record.encoding, record.data)
            })
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
    fn schemas_are_kept_for_dialects_up_to_64_mib() {
        let data = vec![0; 20 << 20];
        let kept = |dialects: &Dialects| {
            let mut channels = Channels::new(dialects);
            for id in 1..=5 {
                let record =
                    SchemaRecord { id, name: "acme.Wave", encoding: "protobuf", data: &data };
                channels.define_schema(record).unwrap();
            }
            assert_eq!(channels.schemas.len(), 5, "known all the same");
            channels.schemas.values().filter(|schema| schema.whole.is_some()).count()
        };
        assert_eq!(kept(&dialects("**", None)), 3);
        assert_eq!(kept(&Dialects::default()), 0, "nobody needs them");
    }

    #[test]
    fn what_was_not_kept_for_want_of_room_may_be_defined_again() {
        let record = |topic| ChannelRecord { id: 7, schema_id: 0, topic, message_encoding: "json" };
        let any = dialects("**", None);
        for kept in [0, MOST_KEPT_BYTES - 1] {
            let mut channels = Channels { kept, ..Channels::new(&any) };
            channels.define_channel(record("/a")).unwrap();
            assert_eq!(channels.channels[&7].foreign.is_some(), kept == 0);
            channels.define_channel(record("/a")).unwrap();
            let other = ChannelRecord { schema_id: 1, ..record("/a") };
            assert_eq!(
                channels.known_channel(other),
                Some(Err(RecordError::Redefined("channel", 7)))
            );
        }
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
