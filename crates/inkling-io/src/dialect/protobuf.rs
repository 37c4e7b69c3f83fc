//! Protobuf messages by the recording's own descriptors.
//!
//! Paths are resolved once to field numbers; a message is then walked on the wire, so that what is not
//! wanted is passed over by its length and samples are not copied.

use super::fields::{FieldInfo, Kind, MOST_DEPTH, NANOSECONDS, SECONDS};
use super::path::FieldPath;
use super::value::{Element, Malformed, Number, SlotValues, Value};
use super::wanted::{At, Field, Slot, Then, Wanted};
use crate::unpanicked::unpanicked;
use prost_reflect::{DescriptorPool, FieldDescriptor, Kind as Proto, MessageDescriptor};
use std::ops::Range;

/// Fields that are looked at to say what there is.
const MOST_FIELDS: usize = 400;
/// Groups within groups that are passed over.
const MOST_GROUPS: usize = 64;
/// Wanted fields of one message: there are no more slots.
const MOST_WANTED: usize = Slot::COUNT * 2;

/// What the wire knows a field by.
#[derive(Clone, Debug, PartialEq)]
pub struct Key {
    number: u32,
    scalar: Scalar,
    list: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Scalar {
    /// Two's complement of 64 bits.
    Signed,
    Unsigned,
    ZigZag,
    Fixed(Element),
    Text,
    Bytes,
    Message,
}

pub fn message(descriptors: &[u8], name: &str) -> Result<MessageDescriptor, String> {
    let pool = unpanicked(|| DescriptorPool::decode(descriptors))
        .ok_or_else(|| format!("its schema {name} is a FileDescriptorSet that contradicts itself"))?
        .map_err(|e| format!("its schema {name} is no FileDescriptorSet that can be read: {e}"))?;
    pool.get_message_by_name(name)
        .ok_or_else(|| format!("its schema's FileDescriptorSet has no message {name}"))
}

/// What there is.
pub fn fields(message: &MessageDescriptor) -> Vec<FieldInfo> {
    let mut found = Vec::new();
    list(message, "", 0, &mut found);
    found
}

fn list(message: &MessageDescriptor, before: &str, depth: usize, found: &mut Vec<FieldInfo>) {
    for field in message.fields() {
        if found.len() >= MOST_FIELDS {
            return;
        }
        let info = info(&field, format!("{before}{}", field.name()));
        let inside = match field.kind() {
            Proto::Message(inside) if info.kind == Kind::Message && depth < MOST_DEPTH => inside,
            _ => {
                found.push(info);
                continue;
            }
        };
        let index = if info.list { "[0]" } else { "" };
        list(&inside, &format!("{}{index}.", info.path), depth + 1, found);
    }
}

fn info(field: &FieldDescriptor, path: String) -> FieldInfo {
    let (kind, type_name) = match field.kind() {
        Proto::Bool => (Kind::Bool, "bool".into()),
        Proto::Float => (Kind::Float, "float".into()),
        Proto::Double => (Kind::Float, "double".into()),
        Proto::String => (Kind::Text, "string".into()),
        Proto::Bytes => (Kind::Bytes, "bytes".into()),
        Proto::Message(of) => {
            let kind = if time_fields(&of).is_some() { Kind::Time } else { Kind::Message };
            (kind, of.full_name().to_owned())
        }
        Proto::Enum(of) => (Kind::Integer, of.full_name().to_owned()),
        number => (Kind::Integer, format!("{number:?}").to_lowercase()),
    };
    FieldInfo { path, kind, list: field.is_list(), type_name }
}

/// Its seconds and nanoseconds, if that is what a message has.
fn time_fields(message: &MessageDescriptor) -> Option<[FieldDescriptor; 2]> {
    let of = |names: &[&str]| names.iter().find_map(|name| message.get_field_by_name(name));
    let whole = |field: &FieldDescriptor| scalar(field).is_some_and(|s| !s.is_text_or_message());
    let both = [of(&SECONDS)?, of(&NANOSECONDS)?];
    both.iter().all(|field| whole(field) && !field.is_list()).then_some(both)
}

impl Scalar {
    fn is_text_or_message(self) -> bool {
        matches!(self, Scalar::Text | Scalar::Bytes | Scalar::Message)
    }
}

fn scalar(field: &FieldDescriptor) -> Option<Scalar> {
    Some(match field.kind() {
        Proto::Double => Scalar::Fixed(Element::F64),
        Proto::Float => Scalar::Fixed(Element::F32),
        Proto::Int32 | Proto::Int64 | Proto::Enum(_) => Scalar::Signed,
        Proto::Uint32 | Proto::Uint64 | Proto::Bool => Scalar::Unsigned,
        Proto::Sint32 | Proto::Sint64 => Scalar::ZigZag,
        Proto::Fixed32 => Scalar::Fixed(Element::U32),
        Proto::Fixed64 => Scalar::Fixed(Element::U64),
        Proto::Sfixed32 => Scalar::Fixed(Element::I32),
        Proto::Sfixed64 => Scalar::Fixed(Element::I64),
        Proto::String => Scalar::Text,
        Proto::Bytes => Scalar::Bytes,
        Proto::Message(_) if field.is_group() => return None,
        Proto::Message(_) => Scalar::Message,
    })
}

fn key(field: &FieldDescriptor) -> Result<Key, String> {
    let scalar = scalar(field).ok_or_else(|| format!("{} is a group", field.name()))?;
    Ok(Key { number: field.number(), scalar, list: field.is_list() })
}

/// Adds a path to what is wanted; gives what kind of array the samples are, if fixed.
pub fn want(
    wanted: &mut Wanted<Key>,
    root: &MessageDescriptor,
    path: &FieldPath,
    slot: Slot,
) -> Result<FieldInfo, String> {
    let mut message = root.clone();
    let mut way: Vec<At<Key>> = Vec::new();
    let (last, before) = path.steps().split_last().ok_or("an empty path")?;
    let enter = |message: &MessageDescriptor, name: &str| {
        message
            .get_field_by_name(name)
            .ok_or_else(|| format!("{} has no field \"{name}\"", message.full_name()))
    };
    for step in before {
        let field = enter(&message, &step.name)?;
        let inside = match field.kind() {
            Proto::Message(inside) if !field.is_map() => inside,
            _ => return Err(format!("\"{step}\" has no fields of its own")),
        };
        step.check_on_the_way(field.is_list())?;
        way.push(At { key: key(&field)?, index: step.index });
        message = inside;
    }
    let field = enter(&message, &last.name)?;
    if field.is_map() {
        return Err(format!("\"{}\" is a map", last.name));
    }
    let mut info = info(&field, path.to_string());
    last.check_index(info.list)?;
    info.list &= last.index.is_none();
    info.can_be(slot)?;
    way.push(At { key: key(&field)?, index: last.index });
    match (slot, field.kind()) {
        (Slot::Time, Proto::Message(time)) => {
            let Some([seconds, nanos]) = time_fields(&time) else { return Ok(info) };
            wanted.want_time(&way, [key(&seconds)?, key(&nanos)?]);
        }
        _ => wanted.want(&way, slot),
    }
    Ok(info)
}

/// Walks one message.
pub fn walk(
    message: &[u8],
    wanted: &Wanted<Key>,
    values: &mut SlotValues,
    most_bytes: u64,
) -> Result<(), Malformed> {
    Walk { message, most_bytes, values }.inside(0..message.len(), wanted)
}

struct Walk<'m> {
    message: &'m [u8],
    most_bytes: u64,
    values: &'m mut SlotValues,
}

/// A field's value on the wire.
enum Wire {
    Varint(u64),
    Fixed(Range<usize>),
    Bytes(Range<usize>),
    Group,
}

impl Walk<'_> {
    fn inside(&mut self, within: Range<usize>, wanted: &Wanted<Key>) -> Result<(), Malformed> {
        let mut seen = [0u32; MOST_WANTED];
        let mut at = within.start;
        while at < within.end {
            let (number, wire) = self.next(&mut at, within.end)?;
            for (field, seen) in wanted.fields.iter().zip(&mut seen) {
                if field.at.key.number == number {
                    self.take(field, &wire, seen)?;
                }
            }
        }
        Ok(())
    }

    fn take(&mut self, field: &Field<Key>, wire: &Wire, seen: &mut u32) -> Result<(), Malformed> {
        let Key { scalar, list, .. } = field.at.key;
        let counted = |seen: &mut u32| {
            let this = field.at.index.is_none_or(|index| index == *seen);
            *seen = seen.saturating_add(1);
            this
        };
        let slot = match &field.then {
            Then::Into(inside) => {
                let Wire::Bytes(at) = wire else { return Err(Malformed) };
                return if counted(seen) { self.inside(at.clone(), inside) } else { Ok(()) };
            }
            Then::Take(slot) => *slot,
        };
        match (scalar, wire) {
            (Scalar::Text, Wire::Bytes(at)) => {
                let text = std::str::from_utf8(&self.message[at.clone()]).map_err(|_| Malformed)?;
                if counted(seen) {
                    self.values.set(slot, Value::Text(text.to_owned()));
                }
            }
            (Scalar::Bytes, Wire::Bytes(at)) => {
                if counted(seen) {
                    self.values.set(slot, Value::Bytes(at.clone()));
                }
            }
            (Scalar::Text | Scalar::Bytes | Scalar::Message, _) => return Err(Malformed),
            // packed, or one of several; all of them are wanted
            (Scalar::Fixed(element), Wire::Bytes(at) | Wire::Fixed(at))
                if list && field.at.index.is_none() =>
            {
                if !at.len().is_multiple_of(element.bytes()) {
                    return Err(Malformed);
                }
                let how = (element, false);
                self.values.numbers(slot, how, at.clone(), self.message, self.most_bytes);
            }
            (_, Wire::Bytes(packed)) if list => {
                let mut at = packed.start;
                while at < packed.end {
                    let number = self.packed(scalar, &mut at, packed.end)?;
                    self.number(field, slot, number, seen);
                }
            }
            (Scalar::Fixed(element), Wire::Fixed(at)) if at.len() == element.bytes() => {
                let number = element.read(&self.message[at.clone()], false).ok_or(Malformed)?;
                self.number(field, slot, number, seen);
            }
            (Scalar::Fixed(_), _) => return Err(Malformed),
            (_, Wire::Varint(bits)) => self.number(field, slot, whole(scalar, *bits), seen),
            _ => return Err(Malformed),
        }
        Ok(())
    }

    /// The next of several in a row.
    fn packed(&self, scalar: Scalar, at: &mut usize, end: usize) -> Result<Number, Malformed> {
        let Scalar::Fixed(element) = scalar else {
            return Ok(whole(scalar, self.varint(at, end)?));
        };
        let from = *at;
        *at = at.saturating_add(element.bytes());
        let of = self.message[..end].get(from..*at).ok_or(Malformed)?;
        element.read(of, false).ok_or(Malformed)
    }

    /// One number: of several, those wanted are gathered.
    fn number(&mut self, field: &Field<Key>, slot: Slot, number: Number, seen: &mut u32) {
        match field.at.index {
            None if field.at.key.list => {
                self.values.push(slot, number.float(), self.message, self.most_bytes);
            }
            Some(index) if index != *seen => {}
            _ => self.values.set(slot, Value::Number(number)),
        }
        *seen = seen.saturating_add(1);
    }

    fn next(&self, at: &mut usize, end: usize) -> Result<(u32, Wire), Malformed> {
        let tag = self.varint(at, end)?;
        let number = u32::try_from(tag >> 3).ok().filter(|n| *n > 0).ok_or(Malformed)?;
        let take = |at: &mut usize, n: u64| {
            let to = usize::try_from(n).ok().and_then(|n| at.checked_add(n));
            let to = to.filter(|to| *to <= end).ok_or(Malformed)?;
            let from = std::mem::replace(at, to);
            Ok(from..to)
        };
        let wire = match tag & 7 {
            0 => Wire::Varint(self.varint(at, end)?),
            1 => Wire::Fixed(take(at, 8)?),
            2 => {
                let length = self.varint(at, end)?;
                Wire::Bytes(take(at, length)?)
            }
            5 => Wire::Fixed(take(at, 4)?),
            3 => {
                self.pass_group(number, at, end)?;
                Wire::Group
            }
            _ => return Err(Malformed),
        };
        Ok((number, wire))
    }

    fn pass_group(&self, number: u32, at: &mut usize, end: usize) -> Result<(), Malformed> {
        let mut open = vec![number];
        while let Some(&innermost) = open.last() {
            let tag = self.varint(at, end)?;
            let step = match tag & 7 {
                0 => {
                    self.varint(at, end)?;
                    0
                }
                1 => 8,
                2 => self.varint(at, end)?,
                5 => 4,
                3 if open.len() < MOST_GROUPS => {
                    open.push((tag >> 3) as u32);
                    0
                }
                4 if tag >> 3 == u64::from(innermost) => {
                    open.pop();
                    0
                }
                _ => return Err(Malformed),
            };
            let to = usize::try_from(step).ok().and_then(|step| at.checked_add(step));
            *at = to.filter(|to| *to <= end).ok_or(Malformed)?;
        }
        Ok(())
    }

    fn varint(&self, at: &mut usize, end: usize) -> Result<u64, Malformed> {
        let mut value = 0u64;
        for shift in (0..64).step_by(7) {
            let byte = *self.message[..end].get(*at).ok_or(Malformed)?;
            *at += 1;
            value |= u64::from(byte & 0x7f) << shift;
            if byte < 0x80 {
                return Ok(value);
            }
        }
        Err(Malformed)
    }
}

fn whole(scalar: Scalar, bits: u64) -> Number {
    Number::Integer(match scalar {
        Scalar::ZigZag => i128::from((bits >> 1) as i64 ^ -((bits & 1) as i64)),
        Scalar::Unsigned => i128::from(bits),
        _ => i128::from(bits as i64),
    })
}
