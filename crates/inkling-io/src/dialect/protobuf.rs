//! Reads protobuf: a recording's FileDescriptorSet becomes a [`Shape`], and a path is followed in the
//! bytes of a message.
//!
//! In, from `plan.rs`: the schema, once ([`message_type`], [`shape`]); then each message, and the
//! paths that are wanted of it ([`ProtobufMessage`]). Out: [`Value`]s.
//!
//! `prost-reflect` decodes the schema, but not the messages. Its `DynamicMessage` keeps each number
//! of a list as a value of 56 bytes, where the message has one byte or two: a message of 64 MiB would
//! take some 4 GB, and samples that are packed integers would be read at half the rate of production.
//! Each field of a oneof also makes it pass over all others, hours for a schema of 100 000. So a
//! message is scanned on the wire (key, value, key, value) for the field that a path names; other
//! fields are passed over by their length, and bytes and packed numbers are not copied.

use super::path::Step;
use super::shape::{Base, Count, Field, MessageType, Shape};
use super::value::{Array, Element, Gathered, Number, Value};
use crate::thrift::zigzag;
use crate::unpanicked::unpanicked;
use bytes::Bytes;
use prost::DecodeError;
use prost::encoding::{DecodeContext, WireType, decode_key, decode_varint, skip_field};
use prost_reflect::{DescriptorPool, FieldDescriptor, Kind, MessageDescriptor};
use std::collections::HashMap;

/// The library panics on some sets that contradict themselves; such a set is an error here.
pub fn message_type(descriptors: &[u8], name: &str) -> Result<MessageDescriptor, String> {
    let pool = unpanicked(|| DescriptorPool::decode(descriptors))
        .ok_or_else(|| format!("its schema {name} is a FileDescriptorSet that contradicts itself"))?
        .map_err(|e| format!("its schema {name} is no FileDescriptorSet that can be read: {e}"))?;
    pool.get_message_by_name(name)
        .ok_or_else(|| format!("its schema's FileDescriptorSet has no message {name}"))
}

pub fn shape(root: &MessageDescriptor) -> Shape {
    let mut found = NumberedTypes::default();
    found.number(root.clone());
    let mut types = Vec::new();
    // fields of a type may bring in further types, which are appended and so come later
    while let Some(message) = found.messages.get(types.len()).cloned() {
        let fields = message.fields().map(|of| found.field(&of)).collect();
        types.push(MessageType { name: message.full_name().to_owned(), fields });
    }
    Shape { types }
}

/// A type has one number however often it is used, so types may contain themselves.
#[derive(Default)]
struct NumberedTypes {
    messages: Vec<MessageDescriptor>,
    numbers: HashMap<String, usize>,
}

impl NumberedTypes {
    fn number(&mut self, message: MessageDescriptor) -> usize {
        let next = self.messages.len();
        let number = *self.numbers.entry(message.full_name().to_owned()).or_insert(next);
        if number == next {
            self.messages.push(message);
        }
        number
    }

    fn field(&mut self, of: &FieldDescriptor) -> Field {
        let kind = of.kind();
        let base = match &kind {
            Kind::Bool => Base::Bool,
            Kind::String => Base::Text,
            Kind::Bytes => Base::Bytes,
            Kind::Message(_) if of.is_map() || of.is_group() => Base::Closed,
            Kind::Message(inside) => Base::Message(self.number(inside.clone())),
            number => Base::Number(element(number).unwrap_or(Element::I64)),
        };
        let type_name = match &kind {
            _ if of.is_map() => "map".to_owned(),
            _ if of.is_group() => "group".to_owned(),
            Kind::Message(inside) => inside.full_name().to_owned(),
            Kind::Enum(names) => names.full_name().to_owned(),
            scalar => format!("{scalar:?}").to_lowercase(),
        };
        let count = if of.is_list() { Count::Counted } else { Count::One };
        Field { name: of.name().to_owned(), type_name, base, count }
    }
}

/// A message whose fields follow each other to its end.
#[derive(Debug)]
pub struct ProtobufMessage {
    of: MessageDescriptor,
    bytes: Bytes,
}

/// A field on the wire: a value, or a part of a list.
struct Piece<'m> {
    number: u32,
    wire: WireType,
    /// Without the length that stands before them.
    bytes: &'m [u8],
}

fn next_piece<'m>(rest: &mut &'m [u8]) -> Result<Piece<'m>, DecodeError> {
    let (number, wire) = decode_key(rest)?;
    let start = *rest;
    skip_field(wire, number, rest, DecodeContext::default())?;
    let mut bytes = &start[..start.len() - rest.len()];
    if wire == WireType::LengthDelimited {
        decode_varint(&mut bytes)?;
    }
    Ok(Piece { number, wire, bytes })
}

/// The pieces of a message in their order, to its end or to the first that is an error.
fn pieces(mut rest: &[u8]) -> impl Iterator<Item = Result<Piece<'_>, DecodeError>> {
    std::iter::from_fn(move || {
        let piece = (!rest.is_empty()).then(|| next_piece(&mut rest))?;
        if piece.is_err() {
            rest = &[];
        }
        Some(piece)
    })
}

/// What was met of a field in a message.
struct Met<'m> {
    count: u32,
    /// The last piece, or that of the index.
    last: Option<Piece<'m>>,
}

impl<'m> Met<'m> {
    /// `None`: the bytes are no message, or a value is of another type than the field.
    fn of(message: &'m [u8], field: &FieldDescriptor, step: &Step) -> Option<Met<'m>> {
        let (number, due) = (field.number(), field.kind().wire_type());
        let mut met = Met { count: 0, last: None };
        for piece in pieces(message) {
            let piece = piece.ok()?;
            if piece.number != number {
                continue;
            }
            // a list of numbers may come packed or not, whatever the schema says
            let is_packed = field.is_list() && piece.wire == WireType::LengthDelimited;
            if piece.wire != due && !is_packed {
                return None;
            }
            // in a list of texts, bytes or messages an index counts the pieces
            let is_counted = due == WireType::LengthDelimited;
            if step.index.is_none_or(|index| !is_counted || index == met.count) {
                met.last = Some(piece);
            }
            met.count = met.count.saturating_add(1);
        }
        Some(met)
    }
}

fn number_or_other<'m>(number: Option<Number>) -> Value<'m> {
    number.map_or(Value::Other, Value::Number)
}

impl ProtobufMessage {
    /// `None`: the bytes are no message.
    pub fn new(of: &MessageDescriptor, bytes: &Bytes) -> Option<ProtobufMessage> {
        let is_message = pieces(bytes).all(|piece| piece.is_ok());
        is_message.then(|| ProtobufMessage { of: of.clone(), bytes: bytes.clone() })
    }

    /// The value to which a path leads; `None` where the message leaves it out. If the field occurs
    /// several times and is no list, the last value counts, as protobuf has it.
    pub fn find(&self, path: &[Step]) -> Option<Value<'_>> {
        self.find_in(&self.of, &self.bytes, path)
    }

    fn find_in<'m>(
        &'m self,
        of: &MessageDescriptor,
        message: &'m [u8],
        path: &[Step],
    ) -> Option<Value<'m>> {
        let (step, rest) = path.split_first()?;
        let field = of.get_field_by_name(&step.name)?;
        let Some(met) = Met::of(message, &field, step) else { return Some(Value::Other) };
        let last = met.last?;
        let (kind, number) = (field.kind(), field.number());
        let parts = pieces(message).filter_map(Result::ok).filter(move |p| p.number == number);
        Some(match (&kind, rest) {
            (Kind::Message(_), []) => Value::Other,
            (Kind::Message(inside), _) if field.is_list() => {
                self.find_in(inside, last.bytes, rest)?
            }
            // the parts of a message are merged
            (Kind::Message(inside), _) => {
                parts.filter_map(|part| self.find_in(inside, part.bytes, rest)).last()?
            }
            (Kind::String, _) => str::from_utf8(last.bytes).map_or(Value::Other, Value::Text),
            (Kind::Bytes, _) => Value::Array(self.array(Element::U8, last.bytes)),
            _ if field.is_list() => match (element(&kind), step.index) {
                (_, Some(index)) => {
                    let mut numbers = parts.flat_map(|part| numbers(&kind, part.bytes));
                    number_or_other(numbers.nth(index as usize)?)
                }
                // numbers of fixed width are taken as they lie, if they do not come in parts
                (Some(element), None) if met.count == 1 && element.fill(last.bytes) => {
                    Value::Array(self.array(element, last.bytes))
                }
                _ => gathered(&kind, parts).map_or(Value::Other, Value::Numbers),
            },
            _ => number_or_other(next_number(&kind, &mut { last.bytes })),
        })
    }

    /// An array of the message's own bytes, without a copy.
    fn array(&self, element: Element, bytes: &[u8]) -> Array {
        Array { element, big_endian: false, bytes: self.bytes.slice_ref(bytes) }
    }
}

/// All numbers of a list; `None` where there is none.
fn gathered<'m>(kind: &Kind, parts: impl Iterator<Item = Piece<'m>>) -> Option<Gathered> {
    let mut all = Gathered::default();
    for Piece { bytes: mut rest, .. } in parts {
        while !rest.is_empty() {
            all.push(match kind {
                // most samples, without the way over a number of 128 bits
                Kind::Sint32 | Kind::Sint64 => zigzag(decode_varint(&mut rest).ok()?) as f64,
                Kind::Int32 | Kind::Int64 => decode_varint(&mut rest).ok()? as i64 as f64,
                _ => next_number(kind, &mut rest)?.float(),
            });
        }
    }
    Some(all)
}

/// The numbers side by side in a piece; `None` where there is none, and no more of it.
fn numbers<'m>(kind: &'m Kind, mut rest: &'m [u8]) -> impl Iterator<Item = Option<Number>> + 'm {
    std::iter::from_fn(move || {
        let number = (!rest.is_empty()).then(|| next_number(kind, &mut rest))?;
        if number.is_none() {
            rest = &[];
        }
        Some(number)
    })
}

fn next_number(kind: &Kind, rest: &mut &[u8]) -> Option<Number> {
    if let Some(element) = element(kind) {
        let (one, after) = rest.split_at_checked(element.bytes())?;
        *rest = after;
        return element.read(one, false);
    }
    let bits = decode_varint(rest).ok()?;
    Some(Number::Integer(match kind {
        Kind::Sint32 | Kind::Sint64 => i128::from(zigzag(bits)),
        Kind::Uint32 | Kind::Uint64 => i128::from(bits),
        _ => i128::from(bits as i64),
    }))
}

/// The type of numbers of fixed width; `None` of those that take as many bytes as they need.
fn element(kind: &Kind) -> Option<Element> {
    match kind {
        Kind::Double => Some(Element::F64),
        Kind::Float => Some(Element::F32),
        Kind::Fixed32 => Some(Element::U32),
        Kind::Fixed64 => Some(Element::U64),
        Kind::Sfixed32 => Some(Element::I32),
        Kind::Sfixed64 => Some(Element::I64),
        _ => None,
    }
}
