//! Resolves a dialect's paths in a recording's own schema, once for each channel, or says that they
//! lead nowhere.
//!
//! In: a [`Dialect`], and how the recording describes the channel ([`ChannelDescription`]). Out: a
//! [`Plan`], which finds in each message the values that a burst is made of ([`Plan::find`]).
//! Schemas of protobuf and ROS are known beforehand, so wrong paths are found when the plan is made;
//! JSON has no schema, so its first message is checked instead ([`Plan::check_message`]).
//!
//! Layers: `Reading` knows the schema and which fields are wanted; `Plan` adds the dialect's
//! constants and the printhead's name.

use super::fields::{FieldInfo, Kind, due, listed};
use super::path::FieldPath;
use super::ros_definition::{self, Flavour};
use super::settings::{Dialect, Key, Part, Source};
use super::shape::Shape;
use super::value::{Number, ReadError, SlotValues, Value, is_base64};
use super::wanted::{Slot, Wanted};
use super::{json, protobuf, ros};
use crate::printable;
use bytes::Bytes;
use inkling_core::burst::Format;
use std::sync::Arc;

/// A schema record of a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Schema {
    pub name: String,
    pub encoding: String,
    pub data: Vec<u8>,
}

/// How a recording describes a channel's messages.
#[derive(Clone, Copy, Debug)]
pub struct ChannelDescription<'a> {
    pub topic: &'a str,
    pub message_encoding: &'a str,
    pub schema: Option<&'a Schema>,
}

#[derive(Clone, Debug)]
enum Encoding {
    Protobuf(Arc<Shape>),
    Ros(Flavour, Arc<Shape>),
    /// Has no schema: only a message tells what fields there are.
    Json,
}

/// How messages of one channel are read, and which of their fields are wanted.
#[derive(Clone, Debug)]
pub struct Reading {
    encoding: Encoding,
    wanted: Wanted,
}

/// Message encodings that are read, for an error.
const ENCODINGS: &str = "protobuf, json, cdr with ros2msg, ros1 with ros1msg";

impl Encoding {
    /// The message types of the schema; `None` of JSON, which has no schema.
    fn shape(&self) -> Option<&Shape> {
        match self {
            Encoding::Protobuf(shape) | Encoding::Ros(_, shape) => Some(shape),
            Encoding::Json => None,
        }
    }
}

impl Reading {
    /// Parses the schema of a channel; nothing is wanted of its messages yet.
    pub fn of(written: &ChannelDescription) -> Result<Reading, String> {
        let name = written.message_encoding;
        let schema =
            written.schema.ok_or_else(|| format!("messages of encoding {name} without a schema"));
        let ros = |flavour: Flavour, schema: &Schema| {
            let due = flavour.schema_encoding();
            if schema.encoding != due {
                let found = printable::cell(&schema.encoding);
                return Err(format!("{name} messages are read by {due}, not by {found:?}"));
            }
            let shape = ros_definition::shape(&schema.data, &schema.name, flavour)?;
            Ok(Encoding::Ros(flavour, Arc::new(shape)))
        };
        let encoding = match name {
            "json" => Encoding::Json,
            "protobuf" => {
                let Schema { name, data, .. } = schema?;
                Encoding::Protobuf(Arc::new(protobuf::shape(data, name)?))
            }
            "cdr" => ros(Flavour::Ros2, schema?)?,
            "ros1" => ros(Flavour::Ros1, schema?)?,
            other => {
                let other = printable::cell(other);
                let what = format!("messages of encoding {other:?} are not read");
                return Err(format!("{what}; read are {ENCODINGS}"));
            }
        };
        Ok(Reading { encoding, wanted: Wanted::default() })
    }

    /// The fields that there are: by the schema, or of JSON those of `message`.
    pub fn fields(&self, message: Option<&[u8]>) -> Vec<FieldInfo> {
        match self.encoding.shape() {
            Some(shape) => shape.fields(),
            None => message.map(json::fields).unwrap_or_default(),
        }
    }

    /// Gives a description of the field if there is a schema, `None` in JSON.
    fn want(&mut self, path: &FieldPath, slot: Slot) -> Result<Option<FieldInfo>, String> {
        match self.encoding.shape() {
            Some(shape) => shape.want(&mut self.wanted, path, slot).map(Some),
            None => {
                self.wanted.want(path.steps(), slot);
                Ok(None)
            }
        }
    }

    fn find(&self, message: &Bytes, most_bytes: u64) -> Result<SlotValues, ReadError> {
        let mut values = SlotValues::new(most_bytes);
        match &self.encoding {
            Encoding::Protobuf(shape) => protobuf::walk(message, shape, &self.wanted, &mut values),
            Encoding::Ros(flavour, shape) => {
                ros::walk(message, *flavour, shape, &self.wanted, &mut values)
            }
            Encoding::Json => json::walk(message, &self.wanted, &mut values),
        }?;
        Ok(values)
    }

    pub fn look(
        &self,
        message: &Bytes,
        path: &str,
        slot: Slot,
        most_bytes: u64,
    ) -> Option<SlotValues> {
        let mut reading = self.clone();
        reading.want(&FieldPath::try_from(path.to_owned()).ok()?, slot).ok()?;
        reading.find(message, most_bytes).ok()
    }
}

#[derive(Debug)]
pub struct Plan {
    pub dialect: Arc<Dialect>,
    reading: Reading,
    /// The pattern of the printhead's name, with the parts of the topic put in.
    pub name: Vec<Part>,
}

impl Plan {
    pub fn new(dialect: &Arc<Dialect>, written: &ChannelDescription) -> Result<Plan, String> {
        let mut reading = Reading::of(written)?;
        let name = name(dialect, written.topic)?;
        for key in dialect.paths() {
            let checked = reading.want(key.value, key.slot).and_then(|found| match found {
                Some(FieldInfo { kind, type_name, .. }) if key.slot == Slot::Samples => {
                    check_format(dialect.format, kind == Kind::Bytes, &type_name)
                }
                _ => Ok(()),
            });
            checked.map_err(|what| key.wrong(&what, &reading.fields(None)))?;
        }
        Ok(Plan { dialect: dialect.clone(), reading, name })
    }

    /// The values of a burst: those that stand in the message, and the constants of the dialect.
    pub fn find(&self, message: &Bytes, most_bytes: u64) -> Result<SlotValues, ReadError> {
        let mut values = self.reading.find(message, most_bytes)?;
        for number in self.dialect.numbers() {
            // constants are values like those of the message, so that nobody need tell them apart
            if let Source::Constant(x) = number.value {
                values.set(number.slot, Value::Number(Number::Float(*x)));
            }
        }
        Ok(values)
    }

    /// Whether a field that is missing in a message is an error.
    pub fn names_every_field(&self) -> bool {
        matches!(self.reading.encoding, Encoding::Json)
    }

    /// Checks the paths of a JSON dialect against a message. The error says which key is wrong.
    pub fn check_message(&self, message: &Bytes, most_bytes: u64) -> Result<(), String> {
        if !self.names_every_field() {
            return Ok(());
        }
        let mut values = match self.reading.find(message, most_bytes) {
            Ok(values) => values,
            Err(ReadError::Malformed) => return Ok(()), // it becomes a rejected row; the paths may be right
            Err(ReadError::Unfit(what)) => {
                let there = listed(&json::fields(message));
                return Err(format!("its first message: {what}; fields that exist: {there}"));
            }
        };
        for key in self.dialect.paths() {
            // a time may have been found as seconds and nanoseconds
            let value = values.take(key.slot).or_else(|| match key.slot {
                Slot::Time => values.take(Slot::Seconds),
                _ => None,
            });
            let checked = match value {
                Some(value) => check_value(key.slot, &value, self.dialect.format),
                None if key.slot.is_optional() => Ok(()),
                None => Err("not in its first message".into()),
            };
            checked.map_err(|what| key.wrong(&what, &json::fields(message)))?;
        }
        Ok(())
    }
}

impl Key<'_, FieldPath> {
    fn wrong(&self, what: &str, there: &[FieldInfo]) -> String {
        let Key { name, value, .. } = self;
        format!("{name} = \"{value}\": {what}; fields that exist: {}", listed(there))
    }
}

/// Checks the key `format` against the field of the samples: bytes need a format; numbers have a
/// type of their own, and a format beside it would have no effect.
fn check_format(format: Option<Format>, is_bytes: bool, type_name: &str) -> Result<(), String> {
    match (is_bytes, format) {
        (true, None) => Err("is bytes: say format = \"s16le\" or \"f32le\"".into()),
        (false, Some(_)) => Err(format!(
            "is an array of {type_name}, whose type says how it lies: leave format out"
        )),
        _ => Ok(()),
    }
}

/// The counterpart of `FieldInfo::can_be` for messages without a schema.
fn check_value(slot: Slot, value: &Value, format: Option<Format>) -> Result<(), String> {
    let number = value.number();
    let fits = match (slot, value) {
        (Slot::Samples, Value::Gathered(_)) => return check_format(format, false, "numbers"),
        (Slot::Samples, Value::Text(text)) if is_base64(text) => {
            return check_format(format, true, "base64");
        }
        (Slot::Samples, _) => false,
        (Slot::Channels | Slot::SamplesPerChannel | Slot::FirstChannel, _) => {
            number.and_then(Number::integer).is_some()
        }
        (Slot::Period | Slot::Rate | Slot::Temperature | Slot::Voltage, _) => number.is_some(),
        (Slot::Time, Value::Text(text)) => is_time(text),
        // a number or an array, checked further by the decoder
        (Slot::Idle | Slot::Neighbours, Value::Text(_)) => false,
        _ => true,
    };
    if fits { Ok(()) } else { Err(format!("is not {}", due(slot))) }
}

/// Whether a text is a time: a whole number, or RFC 3339 with a zone.
pub(super) fn is_time(text: &str) -> bool {
    text.parse::<i64>().is_ok() || chrono::DateTime::parse_from_rfc3339(text).is_ok()
}

fn name(dialect: &Dialect, topic: &str) -> Result<Vec<Part>, String> {
    let parts: Vec<&str> = topic.trim_start_matches('/').split('/').collect();
    let put_in = |part: &Part| match part {
        Part::Topic(n) => match parts.get(*n) {
            Some(part) => Ok(Part::Literal((*part).to_owned())),
            None => {
                let there: Vec<String> =
                    parts.iter().enumerate().map(|(i, p)| format!("{i}: {p}")).collect();
                let there = printable::line(&there.join(", "), 300);
                Err(format!(
                    "printhead: the topic has no part {{topic.{n}}}; its parts are {there}"
                ))
            }
        },
        part => Ok(part.clone()),
    };
    dialect.printhead.parts.iter().map(put_in).collect()
}
