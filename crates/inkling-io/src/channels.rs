//! Schemas and channels by id, as far as they matter to us, and where a channel's messages go.

use super::burst_codec::{MESSAGE_ENCODING, SCHEMA_NAME, topic_printhead};
use super::dialect::plan::{Plan, Schema, Written};
use super::dialect::{Dialects, Fits};
use super::mcap_records::{ChannelRecord, SchemaRecord};
use std::collections::HashMap;
use std::fmt;
use std::sync::{Arc, OnceLock};

/// What becomes of a channel's messages.
#[derive(Clone, Debug, Default)]
pub enum Becomes {
    /// They are `inkling.Burst`.
    Bursts,
    /// A dialect makes bursts of them.
    Foreign(Arc<Plan>),
    /// A dialect fits and cannot read them: why.
    Unread(Arc<str>),
    /// Named `inkling.Burst`, of another encoding than protobuf: they count, and cannot be decoded.
    OtherEncoding,
    #[default]
    Nothing,
}

/// Where the messages of a channel go.
#[derive(Clone, Debug)]
pub(super) struct Route {
    pub to: Becomes,
    /// The printhead that the channel's topic names.
    pub printhead: Option<Arc<str>>,
}

/// Why a record inside a block is of no use.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Lost {
    UnknownChannel(u16),
    UnknownSchema { channel: u16, schema: u16 },
    ShortMessage,
    Malformed(&'static str),
    Redefined(&'static str, u16),
}

impl fmt::Display for Lost {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Lost::UnknownChannel(id) => write!(f, "message on channel {id}, which is not defined"),
            Lost::UnknownSchema { channel, schema } => {
                write!(f, "message on channel {channel}, whose schema {schema} is not defined")
            }
            Lost::ShortMessage => write!(f, "message shorter than its header"),
            Lost::Malformed(what) => write!(f, "malformed {what} record"),
            Lost::Redefined(what, id) => {
                write!(f, "{what} {id} defined again as another; the first definition holds")
            }
        }
    }
}

/// The schemas and channels that are defined so far. There are no more than ids, and what dialects need of them has at most
/// [`MOST_KEPT_BYTES`].
#[derive(Clone, Debug, Default)]
pub(super) struct Channels {
    dialects: Dialects,
    schemas: HashMap<u16, KnownSchema>,
    channels: HashMap<u16, Channel>,
    /// Bytes of schemas, topics and encodings that are kept for dialects.
    kept: usize,
}

/// Schemas and channels beyond are not kept, and so read by no dialect.
const MOST_KEPT_BYTES: usize = 64 << 20;

#[derive(Clone, Debug, PartialEq, Eq)]
struct KnownSchema {
    /// Whether it is the schema of bursts.
    bursts: bool,
    /// All of it, where a dialect may need it and there was room.
    whole: Option<Arc<Schema>>,
}

#[derive(Clone, Debug)]
struct Channel {
    schema_id: u16,
    protobuf: bool,
    printhead: Option<Arc<str>>,
    /// The dialects that its topic fits.
    fits: Fits,
    /// What those dialects need to know of it: where there are any, and there was room for it.
    foreign: Option<Foreign>,
}

/// A channel whose topic some dialects fit.
#[derive(Clone, Debug)]
struct Foreign {
    topic: Arc<str>,
    message_encoding: Arc<str>,
    /// Which dialect reads it, and how: known once its schema is.
    plan: OnceLock<NumberedPlan>,
}

/// How a dialect reads a channel, with the dialect's number.
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

    /// Whether a record defines the same channel, as far as that matters to us.
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

    /// How many bytes are kept for dialects.
    fn kept(&self) -> usize {
        self.foreign.as_ref().map_or(0, |of| of.topic.len() + of.message_encoding.len())
    }
}

/// The dialects that a channel's topic fits; a topic or an encoding that is very long fits none.
fn fits(record: ChannelRecord<'_>, dialects: &Dialects) -> Fits {
    const MOST_BYTES: usize = 4096;
    match record.topic.len().max(record.message_encoding.len()) <= MOST_BYTES {
        true => dialects.of_topic(record.topic),
        false => Fits::default(),
    }
}

/// The printhead that a channel's topic names. A name is taken only up to some length, so that 65,536 channels stay
/// small.
fn printhead(record: ChannelRecord<'_>) -> Option<&str> {
    const MOST_BYTES: usize = 256;
    topic_printhead(record.topic).filter(|name| name.len() <= MOST_BYTES)
}

impl Channels {
    pub(super) fn new(dialects: &Dialects) -> Channels {
        Channels { dialects: dialects.clone(), ..Channels::default() }
    }

    /// Nothing defined, with the same dialects.
    pub(super) fn without_any(&self) -> Channels {
        Channels::new(&self.dialects)
    }

    /// Of several definitions of a schema the first holds.
    pub(super) fn define_schema(&mut self, record: SchemaRecord<'_>) -> Result<(), Lost> {
        let SchemaRecord { id, name, encoding, data } = record;
        if let Some(before) = self.schemas.get(&id) {
            let same = before.is(record);
            return if same { Ok(()) } else { Err(Lost::Redefined("schema", id)) };
        }
        let bytes = name.len() + encoding.len() + data.len();
        let keep = !self.dialects.is_empty() && self.kept + bytes <= MOST_KEPT_BYTES;
        self.kept += if keep { bytes } else { 0 };
        let whole = keep.then(|| {
            let (name, encoding) = (name.to_owned(), encoding.to_owned());
            Arc::new(Schema { name, encoding, data: data.to_vec() })
        });
        self.schemas.insert(id, KnownSchema { bursts: name == SCHEMA_NAME, whole });
        Ok(())
    }

    /// Of several definitions of a channel the first holds.
    pub(super) fn define_channel(&mut self, record: ChannelRecord<'_>) -> Result<(), Lost> {
        if let Some(before) = self.channels.get(&record.id) {
            let same = before.is(record, &self.dialects);
            return if same { Ok(()) } else { Err(Lost::Redefined("channel", record.id)) };
        }
        let room = MOST_KEPT_BYTES.saturating_sub(self.kept);
        let channel = Channel::of(record, &self.dialects, room);
        self.kept += channel.kept();
        self.channels.insert(record.id, channel);
        Ok(())
    }

    pub(super) fn agrees_with_schema(&self, record: SchemaRecord<'_>) -> bool {
        self.schemas.get(&record.id).is_some_and(|known| known.is(record))
    }

    pub(super) fn agrees_with_channel(&self, record: ChannelRecord<'_>) -> bool {
        self.channels.get(&record.id).is_some_and(|known| known.is(record, &self.dialects))
    }

    pub(super) fn knows_channel(&self, id: u16) -> bool {
        self.channels.contains_key(&id)
    }

    pub(super) fn route(&self, channel_id: u16) -> Result<Route, Lost> {
        self.route_with(self, channel_id)
    }

    pub(super) fn route_with(
        &self,
        more_schemas: &Channels,
        channel_id: u16,
    ) -> Result<Route, Lost> {
        let channel = self.channels.get(&channel_id).ok_or(Lost::UnknownChannel(channel_id))?;
        let id = channel.schema_id;
        let known = [&self.schemas, &more_schemas.schemas];
        let schema = match known.iter().find_map(|schemas| schemas.get(&id)) {
            _ if id == 0 => None, // without a schema
            Some(schema) => Some(schema),
            None => return Err(Lost::UnknownSchema { channel: channel_id, schema: id }),
        };
        let bursts = schema.is_some_and(|schema| schema.bursts);
        let planned = || channel.planned(&self.dialects, schema).map(|planned| &planned.plan);
        let to = match bursts && channel.protobuf {
            true => Becomes::Bursts,
            false => match planned() {
                Some(Ok(plan)) => Becomes::Foreign(plan.clone()),
                Some(Err(why)) => Becomes::Unread(why.clone()),
                None if bursts => Becomes::OtherEncoding,
                None => Becomes::Nothing,
            },
        };
        Ok(Route { to, printhead: channel.printhead.clone() })
    }

    pub(super) fn carries_bursts(&self, channel_id: u16) -> bool {
        self.route(channel_id).is_ok_and(|route| !matches!(route.to, Becomes::Nothing))
    }

    /// The numbers of the dialects that read channels, one for each such channel in the order of their ids.
    pub(super) fn dialects_used(&self) -> Vec<usize> {
        let number = |id: u16| {
            self.route(id).ok()?; // which makes the plan
            Some(self.channels.get(&id)?.foreign.as_ref()?.plan.get()?.number)
        };
        (0..=u16::MAX).filter_map(number).collect()
    }
}

impl KnownSchema {
    /// Whether a record defines the same schema, as far as that matters to us.
    fn is(&self, record: SchemaRecord<'_>) -> bool {
        self.bursts == (record.name == SCHEMA_NAME)
            && self.whole.as_ref().is_none_or(|whole| {
                (&*whole.name, &*whole.encoding, &*whole.data)
                    == (record.name, record.encoding, record.data)
            })
    }
}

impl Channel {
    /// The dialect that reads it, if one does.
    fn planned(&self, dialects: &Dialects, schema: Option<&KnownSchema>) -> Option<&NumberedPlan> {
        let foreign = self.foreign.as_ref()?;
        if let Some(planned) = foreign.plan.get() {
            return Some(planned);
        }
        let whole = match schema {
            Some(schema) => Some(schema.whole.as_deref()?), // too large to be kept
            None => None,
        };
        let number = dialects.first(self.fits, whole.map(|schema| schema.name.as_str()))?;
        let written = Written {
            topic: &foreign.topic,
            message_encoding: &foreign.message_encoding,
            schema: whole,
        };
        let plan = dialects.plan(number, &written).map(Arc::new).map_err(Arc::from);
        Some(foreign.plan.get_or_init(|| NumberedPlan { number, plan }))
    }
}

#[cfg(test)]
mod tests {
    use super::super::dialect::settings::Dialect;
    use super::*;

    fn any() -> Dialects {
        let dialect: Dialect = serde_json::from_value(serde_json::json!({
            "topic": "**", "samples": "data", "channels": 2, "period_s": 1e-6, "printhead": "p"
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
        assert_eq!(kept(&any()), 3);
        assert_eq!(kept(&Dialects::default()), 0, "nobody needs them");
    }

    #[test]
    fn what_was_not_kept_for_want_of_room_may_be_defined_again() {
        let record = |topic| ChannelRecord { id: 7, schema_id: 0, topic, message_encoding: "json" };
        for kept in [0, MOST_KEPT_BYTES - 1] {
            let mut channels = Channels { kept, ..Channels::new(&any()) };
            channels.define_channel(record("/a")).unwrap();
            assert_eq!(channels.channels[&7].foreign.is_some(), kept == 0);
            channels.define_channel(record("/a")).unwrap();
            assert!(channels.agrees_with_channel(record("/a")));
            assert!(!channels.agrees_with_channel(ChannelRecord { schema_id: 1, ..record("/a") }));
        }
    }
}
