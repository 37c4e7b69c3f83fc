//! A dialect meets a recording's own schema: paths are resolved once, or said to lead nowhere.

use super::fields::{FieldInfo, Kind, listed};
use super::path::FieldPath;
use super::ros_definition::{Definitions, Flavour};
use super::settings::{Dialect, Part, Source, TimeSource};
use super::value::{Number, SlotValues, Value};
use super::wanted::{Slot, Wanted};
use super::{json, protobuf, ros};
use crate::printable;
use inkling_core::burst::Format;
use prost_reflect::MessageDescriptor;
use std::sync::Arc;

/// A schema of a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Schema {
    pub name: String,
    pub encoding: String,
    pub data: Vec<u8>,
}

/// What a channel's messages are, as its recording says.
#[derive(Clone, Copy, Debug)]
pub struct Written<'a> {
    pub topic: &'a str,
    pub message_encoding: &'a str,
    pub schema: Option<&'a Schema>,
}

/// How messages of one channel are read, and what is wanted of them.
#[derive(Clone, Debug)]
pub enum Reading {
    Protobuf(MessageDescriptor, Wanted<protobuf::Key>),
    Json(Wanted<String>),
    Ros(Arc<Definitions>, Wanted<usize>),
}

/// Message encodings that are read.
const ENCODINGS: &str = "protobuf, json, cdr with ros2msg, ros1 with ros1msg";

impl Reading {
    /// So far nothing is wanted.
    pub fn of(written: &Written) -> Result<Reading, String> {
        let schema = || {
            written.schema.ok_or_else(|| {
                format!("messages of encoding {} without a schema", written.message_encoding)
            })
        };
        let encoding = written.message_encoding;
        let definitions = |of: &Schema, flavour| {
            let definitions = Definitions::parse(&of.data, &of.name, flavour)?;
            Ok(Reading::Ros(Arc::new(definitions), Wanted::nothing()))
        };
        match encoding {
            "json" => Ok(Reading::Json(Wanted::nothing())),
            "protobuf" => {
                let schema = schema()?;
                let message = protobuf::message(&schema.data, &schema.name)?;
                Ok(Reading::Protobuf(message, Wanted::nothing()))
            }
            "cdr" | "ros1" => {
                let (due, flavour) = match encoding {
                    "cdr" => ("ros2msg", Flavour::Ros2),
                    _ => ("ros1msg", Flavour::Ros1),
                };
                let schema = schema()?;
                match schema.encoding == due {
                    true => definitions(schema, flavour),
                    false => {
                        let found = printable::cell(&schema.encoding);
                        Err(format!("{encoding} messages are read by {due}, not by {found:?}"))
                    }
                }
            }
            other => {
                let other = printable::cell(other);
                Err(format!("messages of encoding {other:?} are not read; read are {ENCODINGS}"))
            }
        }
    }

    /// What there is; of JSON only a message tells.
    pub fn fields(&self, message: Option<&[u8]>) -> Vec<FieldInfo> {
        match self {
            Reading::Protobuf(message, _) => protobuf::fields(message),
            Reading::Ros(definitions, _) => ros::fields(definitions),
            Reading::Json(_) => message.map(json::fields).unwrap_or_default(),
        }
    }

    /// Wants what a path leads to; gives what that is, if the schema says it.
    fn want(&mut self, path: &FieldPath, slot: Slot) -> Result<Option<FieldInfo>, String> {
        match self {
            Reading::Protobuf(message, wanted) => {
                protobuf::want(wanted, message, path, slot).map(Some)
            }
            Reading::Ros(definitions, wanted) => {
                ros::want(wanted, definitions, path, slot).map(Some)
            }
            Reading::Json(wanted) => {
                json::want(wanted, path, slot);
                Ok(None)
            }
        }
    }

    /// What a message says; `None`: it cannot be decoded.
    fn find(&self, message: &[u8], most_bytes: u64) -> Option<SlotValues> {
        let mut values = SlotValues::default();
        match self {
            Reading::Protobuf(_, wanted) => {
                protobuf::walk(message, wanted, &mut values, most_bytes).ok()?;
            }
            Reading::Json(wanted) => json::walk(message, wanted, &mut values, most_bytes).ok()?,
            Reading::Ros(definitions, wanted) => {
                ros::walk(message, definitions, wanted, &mut values).ok()?;
            }
        }
        Some(values)
    }

    /// What a message has at these paths alone.
    pub fn look(
        &self,
        message: &[u8],
        at: &[(&FieldPath, Slot)],
        most_bytes: u64,
    ) -> Option<SlotValues> {
        let mut reading = self.clone();
        at.iter().try_for_each(|(path, slot)| reading.want(path, *slot).map(drop)).ok()?;
        reading.find(message, most_bytes)
    }
}

/// A dialect, resolved for one channel.
#[derive(Debug)]
pub struct Plan {
    pub dialect: Arc<Dialect>,
    reading: Reading,
    /// Of samples that are bytes.
    pub format: Option<Format>,
    /// The printhead's name, with the topic's parts put in.
    pub name: Vec<Name>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Name {
    Literal(String),
    InSlot(Slot),
}

impl Plan {
    /// An error says what is wrong and what there is.
    pub fn new(dialect: &Arc<Dialect>, written: &Written) -> Result<Plan, String> {
        let mut reading = Reading::of(written)?;
        let name = name(dialect, written.topic)?;
        for (key, path, slot) in paths(dialect) {
            let found = reading.want(path, slot);
            let wrong = |what: String| {
                let there = listed(&reading.fields(None));
                format!("{key} = \"{path}\": {what}; fields that exist: {there}")
            };
            let found = found.map_err(wrong)?;
            if let (Slot::Samples, Some(info)) = (slot, found) {
                check_format(dialect, &info).map_err(wrong)?;
            }
        }
        Ok(Plan { dialect: dialect.clone(), reading, format: dialect.format, name })
    }

    /// What a message says; `None`: it cannot be decoded.
    pub fn find(&self, message: &[u8], most_bytes: u64) -> Option<SlotValues> {
        self.reading.find(message, most_bytes)
    }

    /// In JSON a field that is not there is no zero.
    pub fn names_every_field(&self) -> bool {
        matches!(self.reading, Reading::Json(_))
    }

    /// Of JSON, whose paths only a message can check: what is wrong with them.
    pub fn check_message(&self, message: &[u8], most_bytes: u64) -> Result<(), String> {
        let Reading::Json(wanted) = &self.reading else { return Ok(()) };
        let there = || listed(&json::fields(message));
        let mut values = SlotValues::default();
        match json::walk(message, wanted, &mut values, most_bytes) {
            Ok(()) => {}
            Err(e) if e.is_data() => {
                return Err(format!("its first message: {e}; fields that exist: {}", there()));
            }
            Err(_) => return Ok(()), // no JSON: a row of its own, and nothing about the paths
        }
        for (key, path, slot) in paths(&self.dialect) {
            let optional =
                [Slot::Temperature, Slot::Voltage, Slot::Idle, Slot::Neighbours].contains(&slot);
            let value = match slot {
                Slot::Time => values.take(Slot::Time).or_else(|| values.take(Slot::Seconds)),
                slot => values.take(slot),
            };
            let what = match value {
                Some(value) => check_value(slot, value, self.format).err(),
                None if optional => None,
                None => Some("not in its first message"),
            };
            if let Some(what) = what {
                let there = there();
                return Err(format!("{key} = \"{path}\": {what}; fields that exist: {there}"));
            }
        }
        Ok(())
    }
}

/// Bytes need a format, numbers have their own.
fn check_format(dialect: &Dialect, info: &FieldInfo) -> Result<(), String> {
    match (info.kind == Kind::Bytes, dialect.format) {
        (true, None) => Err("is bytes: say format = \"s16le\" or \"f32le\"".into()),
        (false, Some(_)) => Err(format!(
            "is an array of {}, whose type says how it lies: leave format out",
            info.type_name
        )),
        _ => Ok(()),
    }
}

/// Whether what JSON has at a path can be what is wanted there; if not, what is wrong.
fn check_value(slot: Slot, value: Value, format: Option<Format>) -> Result<(), &'static str> {
    let number = match &value {
        Value::Text(text) => text.parse().ok().map(Number::Float),
        Value::Number(number) => Some(*number),
        _ => None,
    };
    let (good, what) = match slot {
        Slot::Samples => match (&value, format) {
            (Value::Gathered(_), Some(_)) => {
                (false, "is an array of numbers, which say how they lie: leave format out")
            }
            (Value::Decoded(_), None) => {
                (false, "is bytes (base64): say format = \"s16le\" or \"f32le\"")
            }
            _ => (
                matches!(value, Value::Gathered(_) | Value::Decoded(_)),
                "is not bytes or an array of numbers",
            ),
        },
        Slot::Channels | Slot::SamplesPerChannel | Slot::FirstChannel => {
            (number.and_then(Number::integer).is_some(), "is not a whole number")
        }
        Slot::Period | Slot::Temperature | Slot::Voltage => (number.is_some(), "is not a number"),
        Slot::Time => (
            matches!(&value, Value::Number(_))
                || matches!(&value, Value::Text(text) if is_time(text)),
            "is not ns as an integer, s as a float, RFC 3339, or seconds and nanoseconds",
        ),
        Slot::Idle | Slot::Neighbours => {
            (!matches!(value, Value::Text(_)), "is not a number or an array of numbers")
        }
        Slot::Seconds | Slot::Nanoseconds | Slot::Text(_) => (true, ""),
    };
    if good { Ok(()) } else { Err(what) }
}

pub(super) fn is_time(text: &str) -> bool {
    text.parse::<i64>().is_ok() || chrono::DateTime::parse_from_rfc3339(text).is_ok()
}

/// Every path of a dialect: its key, and what is to be found there.
fn paths(dialect: &Dialect) -> Vec<(&'static str, &FieldPath, Slot)> {
    let mut paths = vec![("samples", &dialect.samples, Slot::Samples)];
    let sampling = match dialect.sampling() {
        Some(sampling) => (sampling.key(), Some(sampling.source()), Slot::Period),
        None => ("period_s", None, Slot::Period),
    };
    let sources = [
        ("channels", Some(&dialect.channels), Slot::Channels),
        ("samples_per_channel", dialect.samples_per_channel.as_ref(), Slot::SamplesPerChannel),
        ("first_channel", Some(&dialect.first_channel), Slot::FirstChannel),
        sampling,
        ("temperature", dialect.temperature.as_ref(), Slot::Temperature),
        ("voltage", dialect.voltage.as_ref(), Slot::Voltage),
        ("idle", dialect.idle.as_ref(), Slot::Idle),
        ("neighbours", dialect.neighbours.as_ref(), Slot::Neighbours),
    ];
    for (key, source, slot) in sources {
        paths.extend(source.and_then(Source::path).map(|path| (key, path, slot)));
    }
    if let TimeSource::Path(path) = &dialect.time {
        paths.push(("time", path, Slot::Time));
    }
    let texts = dialect.printhead.paths().zip(0..);
    paths.extend(texts.map(|(path, n)| ("printhead", path, Slot::Text(n))));
    paths
}

fn name(dialect: &Dialect, topic: &str) -> Result<Vec<Name>, String> {
    let parts: Vec<&str> = topic.trim_start_matches('/').split('/').collect();
    let mut texts = 0..;
    let mut name = Vec::new();
    for part in &dialect.printhead.parts {
        name.push(match part {
            Part::Literal(text) => Name::Literal(text.clone()),
            Part::Path(_) => Name::InSlot(Slot::Text(texts.next().unwrap_or_default())),
            Part::Topic(n) => match parts.get(*n) {
                Some(part) => Name::Literal((*part).to_owned()),
                None => {
                    let there: Vec<String> =
                        parts.iter().enumerate().map(|(i, p)| format!("{i}: {p}")).collect();
                    let there = printable::line(&there.join(", "), 300);
                    return Err(format!(
                        "printhead: the topic has no part {{topic.{n}}}; its parts are {there}"
                    ));
                }
            },
        });
    }
    Ok(name)
}
