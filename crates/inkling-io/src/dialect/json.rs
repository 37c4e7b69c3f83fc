//! JSON messages, read as they come: what is not wanted is passed over, numbers of arrays are gathered
//! without a tree of values, so that memory stays near the message's own size.

use super::fields::{FieldInfo, Kind, MOST_DEPTH, NANOSECONDS, SECONDS};
use super::path::FieldPath;
use super::value::{Gathered, Number, SlotValues, Value};
use super::wanted::{At, Field, Slot, Then, Wanted};
use base64::Engine as _;
use serde::de::{self, DeserializeSeed, IgnoredAny, MapAccess, SeqAccess, Visitor};
use std::fmt;

/// Fields that are looked at to say what there is; bytes of a message that it is taken from.
const MOST_FIELDS: usize = 400;
const MOST_SAMPLE_BYTES: usize = 8 << 20;

pub fn want(wanted: &mut Wanted<String>, path: &FieldPath, slot: Slot) {
    let way: Vec<At<String>> =
        path.steps().iter().map(|step| At { key: step.name.clone(), index: step.index }).collect();
    wanted.want(&way, slot);
}

/// Walks one message. An error: it is no JSON, or a field is not what is wanted there.
pub fn walk(
    message: &[u8],
    wanted: &Wanted<String>,
    values: &mut SlotValues,
    most_bytes: u64,
) -> Result<(), serde_json::Error> {
    let mut json = serde_json::Deserializer::from_slice(message);
    Object { wanted, values, most_bytes }.deserialize(&mut json)?;
    json.end()
}

struct Object<'a> {
    wanted: &'a Wanted<String>,
    values: &'a mut SlotValues,
    most_bytes: u64,
}

impl<'de> DeserializeSeed<'de> for Object<'_> {
    type Value = ();
    fn deserialize<D: de::Deserializer<'de>>(self, d: D) -> Result<(), D::Error> {
        d.deserialize_map(self)
    }
}

impl<'de> Visitor<'de> for Object<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("an object")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<(), A::Error> {
        let Object { wanted, values, most_bytes } = self;
        while let Some(key) = map.next_key::<String>()? {
            let fields: Vec<&Field<String>> =
                wanted.fields.iter().filter(|field| field.at.key == key).collect();
            match fields.is_empty() {
                true => drop(map.next_value::<IgnoredAny>()?),
                false => {
                    map.next_value_seed(Fields { fields, index: true, values, most_bytes })?;
                }
            }
        }
        Ok(())
    }
}

/// Wanted fields that share a place. `index`: those with one are still to be looked for.
struct Fields<'a, 'w> {
    fields: Vec<&'w Field<String>>,
    index: bool,
    values: &'a mut SlotValues,
    most_bytes: u64,
}

impl Fields<'_, '_> {
    fn slots(&self) -> impl Iterator<Item = Slot> {
        self.fields.iter().filter_map(|field| match field.then {
            Then::Take(slot) if !self.index || field.at.index.is_none() => Some(slot),
            _ => None,
        })
    }

    fn number<E: de::Error>(self, number: Number) -> Result<(), E> {
        for slot in self.slots().collect::<Vec<_>>() {
            self.values.set(slot, Value::Number(number));
        }
        Ok(())
    }
}

impl<'de> DeserializeSeed<'de> for Fields<'_, '_> {
    type Value = ();
    fn deserialize<D: de::Deserializer<'de>>(self, d: D) -> Result<(), D::Error> {
        d.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Fields<'_, '_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("what the dialect says is there")
    }

    fn visit_unit<E: de::Error>(self) -> Result<(), E> {
        Ok(()) // null: not recorded
    }

    fn visit_bool<E: de::Error>(self, _: bool) -> Result<(), E> {
        Err(E::custom("true or false where a dialect wants another value"))
    }

    fn visit_i64<E: de::Error>(self, i: i64) -> Result<(), E> {
        self.number(Number::Integer(i.into()))
    }

    fn visit_u64<E: de::Error>(self, i: u64) -> Result<(), E> {
        self.number(Number::Integer(i.into()))
    }

    fn visit_f64<E: de::Error>(self, x: f64) -> Result<(), E> {
        self.number(Number::Float(x))
    }

    fn visit_str<E: de::Error>(self, text: &str) -> Result<(), E> {
        for slot in self.slots().collect::<Vec<_>>() {
            let value = match slot {
                Slot::Samples => Value::Decoded(
                    base64::engine::general_purpose::STANDARD
                        .decode(text)
                        .map_err(|e| E::custom(format!("samples are no base64: {e}")))?,
                ),
                _ => Value::Text(text.to_owned()),
            };
            self.values.set(slot, value);
        }
        Ok(())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<(), A::Error> {
        let Fields { fields, index, values, most_bytes } = self;
        if !index || fields.iter().all(|field| field.at.index.is_none()) {
            let mut slots = fields.iter().filter_map(|field| match field.then {
                Then::Take(slot) => Some(slot),
                Then::Into(_) => None,
            });
            let slot @ Some(Slot::Samples | Slot::Idle | Slot::Neighbours) = slots.next() else {
                return Err(de::Error::custom("several values where a dialect wants one"));
            };
            let mut gathered = Gathered::new(most_bytes);
            let mut row = None;
            let nested = slot == Some(Slot::Samples);
            while seq
                .next_element_seed(Numbers { to: &mut gathered, row: &mut row, nested })?
                .is_some()
            {}
            if let Some(slot) = slot {
                values.set(slot, Value::Gathered(gathered));
            }
            return Ok(());
        }
        for i in 0u32.. {
            let here: Vec<&Field<String>> =
                fields.iter().copied().filter(|field| field.at.index == Some(i)).collect();
            let more = match here.is_empty() {
                true => seq.next_element::<IgnoredAny>()?.is_some(),
                false => {
                    let at = Fields { fields: here, index: false, values, most_bytes };
                    seq.next_element_seed(at)?.is_some()
                }
            };
            if !more {
                break;
            }
        }
        Ok(())
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<(), A::Error> {
        let Fields { fields, index, values, most_bytes } = self;
        if index && fields.iter().any(|field| field.at.index.is_some()) {
            return Err(de::Error::custom("one object where a dialect wants one of several"));
        }
        for field in fields {
            match &field.then {
                Then::Into(wanted) => return Object { wanted, values, most_bytes }.visit_map(map),
                Then::Take(Slot::Time) => return Time { values }.visit_map(map),
                Then::Take(_) => {}
            }
        }
        Err(de::Error::custom("an object where a dialect wants a value"))
    }
}

/// `{sec, nanosec}` and its like.
struct Time<'a> {
    values: &'a mut SlotValues,
}

impl<'de> Visitor<'de> for Time<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("seconds and nanoseconds")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<(), A::Error> {
        while let Some(key) = map.next_key::<String>()? {
            let slot = match key.as_str() {
                key if SECONDS.contains(&key) => Slot::Seconds,
                key if NANOSECONDS.contains(&key) => Slot::Nanoseconds,
                _ => {
                    map.next_value::<IgnoredAny>()?;
                    continue;
                }
            };
            self.values.set(slot, Value::Number(Number::Integer(map.next_value::<i64>()?.into())));
        }
        Ok(())
    }
}

/// An element of an array of numbers; of samples also a row of them.
struct Numbers<'a> {
    to: &'a mut Gathered,
    /// Length of the rows before.
    row: &'a mut Option<usize>,
    nested: bool,
}

impl<'de> DeserializeSeed<'de> for Numbers<'_> {
    type Value = ();
    fn deserialize<D: de::Deserializer<'de>>(self, d: D) -> Result<(), D::Error> {
        d.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Numbers<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a number")
    }

    fn visit_unit<E: de::Error>(self) -> Result<(), E> {
        self.to.push(f64::NAN);
        Ok(())
    }

    fn visit_i64<E: de::Error>(self, i: i64) -> Result<(), E> {
        self.to.push(i as f64);
        Ok(())
    }

    fn visit_u64<E: de::Error>(self, i: u64) -> Result<(), E> {
        self.to.push(i as f64);
        Ok(())
    }

    fn visit_f64<E: de::Error>(self, x: f64) -> Result<(), E> {
        self.to.push(x);
        Ok(())
    }

    fn visit_str<E: de::Error>(self, text: &str) -> Result<(), E> {
        let x = text.parse().map_err(|_| E::custom("text where a number should be"))?;
        self.to.push(x);
        Ok(())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<(), A::Error> {
        let Numbers { to, row, nested } = self;
        if !nested {
            return Err(de::Error::custom("an array where a number should be"));
        }
        let (mut n, mut none) = (0, None);
        while seq.next_element_seed(Numbers { to, row: &mut none, nested: false })?.is_some() {
            n += 1;
        }
        match row.replace(n).is_none_or(|before| before == n) {
            true => Ok(()),
            false => Err(de::Error::custom("rows of different length")),
        }
    }
}

/// What there is in a message.
pub fn fields(message: &[u8]) -> Vec<FieldInfo> {
    let mut found = Vec::new();
    if message.len() > MOST_SAMPLE_BYTES {
        return found;
    }
    if let Ok(value) = serde_json::from_slice::<serde_json::Value>(message) {
        list(&value, "", 0, &mut found);
    }
    found
}

/// Of a list in a message, how many elements.
pub fn length(message: &[u8], path: &str) -> Option<usize> {
    let value: serde_json::Value = serde_json::from_slice(message).ok()?;
    let into = |value: &'_ serde_json::Value, key: &str| -> Option<serde_json::Value> {
        let (name, index) = key.split_once('[').map_or((key, None), |(name, rest)| {
            (name, rest.trim_end_matches(']').parse::<usize>().ok())
        });
        let inside = value.get(name)?;
        index.map_or(Some(inside), |index| inside.get(index)).cloned()
    };
    let at = path.split('.').try_fold(value, |value, key| into(&value, key))?;
    at.as_array().map(Vec::len)
}

fn list(value: &serde_json::Value, path: &str, depth: usize, found: &mut Vec<FieldInfo>) {
    use serde_json::Value as Json;
    if found.len() >= MOST_FIELDS || depth > MOST_DEPTH {
        return;
    }
    let mut add = |kind, list, type_name: &str| {
        found.push(FieldInfo { path: path.into(), kind, list, type_name: type_name.into() });
    };
    match value {
        Json::Object(map) => {
            let has = |names: &[&str]| names.iter().any(|name| map.contains_key(*name));
            if has(&SECONDS) && has(&NANOSECONDS) {
                return add(Kind::Time, false, "time");
            }
            for (key, value) in map {
                let dot = if path.is_empty() { "" } else { "." };
                list(value, &format!("{path}{dot}{key}"), depth + 1, found);
            }
        }
        Json::Array(all) => match all.first() {
            Some(Json::Number(_)) | None => add(Kind::Float, true, "number"),
            Some(Json::Array(_)) => add(Kind::Float, true, "number[]"),
            Some(first) => list(first, &format!("{path}[0]"), depth + 1, found),
        },
        Json::Number(n) if n.is_f64() => add(Kind::Float, false, "number"),
        Json::Number(_) => add(Kind::Integer, false, "whole number"),
        Json::String(text) if long_base64(text) => add(Kind::Bytes, false, "base64"),
        Json::String(_) => add(Kind::Text, false, "text"),
        Json::Bool(_) => add(Kind::Bool, false, "true or false"),
        Json::Null => add(Kind::Text, false, "null"),
    }
}

fn long_base64(text: &str) -> bool {
    text.len() >= 64
        && text.len().is_multiple_of(4)
        && text.bytes().all(|b| b.is_ascii_alphanumeric() || b"+/=".contains(&b))
}
