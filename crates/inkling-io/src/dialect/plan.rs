//! Resolves a dialect's paths in a recording's own schema, once for each channel, or says that they
//! lead nowhere.
//!
//! In: a [`Dialect`], and how the recording describes the channel ([`ChannelDescription`]). Out: a
//! [`Plan`], by which `decoder.rs` makes a burst of each message.
//! Schemas of protobuf and ROS are known beforehand, so wrong paths are found when the plan is made;
//! JSON has no schema, so its first message is checked instead ([`Plan::check_message`]).
//!
//! Layers: `Reading` knows the schema; `Plan` adds the dialect and the printhead's name.

use super::fields::{FieldInfo, Kind, Slot, listed};
use super::message::Message;
use super::path::FieldPath;
use super::protobuf::ProtobufMessage;
use super::ros::RosMessage;
use super::settings::{Dialect, Key, Part, TimeSource};
use super::shape::Shape;
use super::value::{Number, Value};
use super::{json, protobuf, ros_definition};
use crate::printable;
use crate::time_column::TimeUnit;
use bytes::Bytes;
use inkling_core::burst::Format;
use inkling_core::verdict::Reason;
use prost_reflect::MessageDescriptor;
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

/// How messages of one channel are decoded, and which fields they have.
#[derive(Debug)]
pub enum Reading {
    Protobuf(MessageDescriptor, Shape),
    Ros(Arc<Shape>),
    /// Has no schema: only a message tells what fields there are.
    Json,
}

/// Message encodings that are read, for an error.
const ENCODINGS: &str = "protobuf, json, cdr with ros2msg";

impl Reading {
    /// Parses the schema of a channel.
    pub fn of(written: &ChannelDescription) -> Result<Reading, String> {
        let name = written.message_encoding;
        let schema =
            written.schema.ok_or_else(|| format!("messages of encoding {name} without a schema"));
        Ok(match name {
            "json" => Reading::Json,
            "protobuf" => {
                let Schema { name, data, .. } = schema?;
                let root = protobuf::message_type(data, name)?;
                let shape = protobuf::shape(&root);
                Reading::Protobuf(root, shape)
            }
            "cdr" => {
                let Schema { name, encoding, data } = schema?;
                if encoding != "ros2msg" {
                    let found = printable::cell(encoding);
                    return Err(format!("cdr messages are read by ros2msg, not by {found:?}"));
                }
                Reading::Ros(Arc::new(ros_definition::shape(data, name)?))
            }
            other => {
                let other = printable::cell(other);
                let what = format!("messages of encoding {other:?} are not read");
                return Err(format!("{what}; read are {ENCODINGS}"));
            }
        })
    }

    /// The message types of the schema; `None` of JSON, which has no schema.
    fn shape(&self) -> Option<&Shape> {
        match self {
            Reading::Protobuf(_, shape) => Some(shape),
            Reading::Ros(shape) => Some(shape),
            Reading::Json => None,
        }
    }

    /// The fields that there are: by the schema, or of JSON those of `message`.
    pub fn fields(&self, message: &Message) -> Vec<FieldInfo> {
        match (self.shape(), message) {
            (_, Message::Json(message)) => json::fields(message),
            (shape, _) => shape.map_or(Vec::new(), Shape::fields),
        }
    }

    /// Decodes a message. The error is the reason of the rejected row that it becomes: it is not what
    /// its schema says, or it has too many values.
    pub fn decode(&self, message: &Bytes) -> Result<Message, Reason> {
        match self {
            Reading::Protobuf(root, _) => {
                ProtobufMessage::new(root, message).map(Message::Protobuf)
            }
            Reading::Ros(shape) => RosMessage::new(message, shape).map(Message::Ros),
            Reading::Json => return json::decode(message).map(Message::Json),
        }
        .ok_or(Reason::Undecodable)
    }

    /// What is wrong with a message that cannot be decoded.
    pub fn wrong(&self, message: &[u8]) -> String {
        let schema = match self {
            Reading::Json => {
                let e = serde_json::from_slice::<serde::de::IgnoredAny>(message).err();
                let what = e.map_or(String::new(), |e| printable::of_parser(&e));
                return format!("no JSON: {what}");
            }
            Reading::Protobuf(root, _) => root.full_name(),
            Reading::Ros(shape) => &shape.types[0].name,
        };
        format!("its {} bytes are no {}", message.len(), printable::cell(schema))
    }
}

#[derive(Debug)]
pub struct Plan {
    pub dialect: Arc<Dialect>,
    pub reading: Reading,
    /// The pattern of the printhead's name, with the parts of the topic put in.
    pub name: Vec<Part>,
    /// Of a field such as `t_us`: ns of the unit that its name says.
    pub time_unit_ns: Option<i64>,
}

impl Plan {
    pub fn new(dialect: &Arc<Dialect>, written: &ChannelDescription) -> Result<Plan, String> {
        let reading = Reading::of(written)?;
        let name = name(dialect, written.topic)?;
        for key in dialect.paths() {
            let Some(shape) = reading.shape() else { break };
            let checked = shape.field(key.value);
            let checked = checked.and_then(|field| check_field(&field, key.slot, dialect.format));
            checked.map_err(|what| key.wrong(&what, &shape.fields()))?;
        }
        let time_unit_ns = match &dialect.time {
            TimeSource::Path(path) => path.steps().last().and_then(|step| unit_ns(&step.name)),
            TimeSource::LogTime | TimeSource::PublishTime => None,
        };
        Ok(Plan { dialect: dialect.clone(), reading, name, time_unit_ns })
    }

    /// Whether a field that is missing in a message is an error.
    pub fn names_every_field(&self) -> bool {
        matches!(self.reading, Reading::Json)
    }

    /// Checks the paths of a JSON dialect against a message. The error says which key is wrong.
    pub fn check_message(&self, message: &Bytes) -> Result<(), String> {
        let message = self.names_every_field().then(|| json::decode(message).ok()).flatten();
        let Some(message) = message else {
            return Ok(()); // if it is no JSON it becomes a rejected row; the paths may be right
        };
        for key in self.dialect.paths() {
            let checked = check_json(&message, &key, self.dialect.format);
            checked.map_err(|what| key.wrong(&what, &json::fields(&message)))?;
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

/// Whether a field can be what a key asks for.
fn check_field(field: &FieldInfo, slot: Slot, format: Option<Format>) -> Result<(), String> {
    field.can_be(slot)?;
    match slot {
        Slot::Samples => check_format(format, field.kind == Kind::Bytes, &field.type_name),
        _ => Ok(()),
    }
}

/// Whether the value to which a key's path leads in a JSON message can be what the key asks for.
fn check_json(
    message: &serde_json::Value,
    key: &Key<FieldPath>,
    format: Option<Format>,
) -> Result<(), String> {
    match (key.slot, json::find(message, key.value.steps())) {
        (slot, None) if slot.is_optional() => Ok(()),
        // also a text that looks like a number, and a whole number that is written as 1.0
        (Slot::Text, Some(value))
            if matches!(value, Value::Text(_))
                || value.number().and_then(Number::integer).is_some() =>
        {
            Ok(())
        }
        // samples in base64, however few there are
        (Slot::Samples, Some(value @ Value::Text(_))) if value.is_base64() => {
            check_format(format, true, "text")
        }
        // no text is read as these, also where it looks like a number
        (Slot::Idle | Slot::Neighbours, Some(Value::Text(_))) => {
            Err("is text, not a number or an array of numbers".into())
        }
        (Slot::Channels | Slot::SamplesPerChannel | Slot::FirstChannel, Some(value))
            if value.number().and_then(Number::integer).is_none() =>
        {
            Err("is not a whole number".into())
        }
        _ => check_field(&json::field(message, key.value)?, key.slot, format),
    }
}

/// The unit that a field of times is named for, ns; minutes and more are more often something else.
pub(super) fn unit_ns(field: &str) -> Option<i64> {
    let unit = TimeUnit::in_name(field).ok().flatten()?;
    (1.0..=1e9).contains(&unit.ns).then_some(unit.ns as i64)
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
