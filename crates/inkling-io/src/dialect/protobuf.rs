//! Reads protobuf: a recording's FileDescriptorSet becomes a [`Shape`], and messages are walked by
//! that shape.
//!
//! In, from `plan.rs`: the schema, once ([`shape`]); then each message with the tree of wanted
//! fields ([`walk`]). Out: [`SlotValues`]. A message is walked on the wire (key, value, key, value,
//! as protobuf's encoding has them), so that fields that are not wanted are passed over by their
//! length and samples are not copied. Only the schema is decoded by a library.

use super::shape::{Base, Count, Field, MessageType, Shape, Sign};
use super::value::{Array, Element, Number, ReadError, SlotValues, Value};
use super::wanted::{Then, Wanted, WantedField};
use crate::unpanicked::unpanicked;
use bytes::Bytes;
use prost::DecodeError;
use prost::encoding::{DecodeContext, WireType, decode_key, decode_varint, skip_field};
use prost_reflect::{DescriptorPool, FieldDescriptor, Kind, MessageDescriptor};
use std::collections::HashMap;

/// The library panics on some sets that contradict themselves; such a set is an error here.
pub fn shape(descriptors: &[u8], name: &str) -> Result<Shape, String> {
    let pool = unpanicked(|| DescriptorPool::decode(descriptors))
        .ok_or_else(|| format!("its schema {name} is a FileDescriptorSet that contradicts itself"))?
        .map_err(|e| format!("its schema {name} is no FileDescriptorSet that can be read: {e}"))?;
    let root = pool
        .get_message_by_name(name)
        .ok_or_else(|| format!("its schema's FileDescriptorSet has no message {name}"))?;

    let mut found = NumberedTypes::default();
    found.number(root);
    let mut types = Vec::new();
    // fields of a type may bring in further types, which are appended and so come later
    while let Some(message) = found.messages.get(types.len()).cloned() {
        let fields = message.fields().map(|of| found.field(&of)).collect();
        types.push(MessageType { name: message.full_name().to_owned(), fields, empty: false });
    }
    Ok(Shape { types })
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
            Kind::Double => Base::Number(Element::F64),
            Kind::Float => Base::Number(Element::F32),
            Kind::Fixed32 => Base::Number(Element::U32),
            Kind::Fixed64 => Base::Number(Element::U64),
            Kind::Sfixed32 => Base::Number(Element::I32),
            Kind::Sfixed64 => Base::Number(Element::I64),
            Kind::Int32 | Kind::Int64 | Kind::Enum(_) => Base::Varint(Sign::Signed),
            Kind::Uint32 | Kind::Uint64 => Base::Varint(Sign::Unsigned),
            Kind::Sint32 | Kind::Sint64 => Base::Varint(Sign::ZigZag),
            Kind::String => Base::Text,
            Kind::Bytes => Base::Bytes,
            Kind::Message(_) if of.is_map() || of.is_group() => Base::Closed,
            Kind::Message(inside) => Base::Message(self.number(inside.clone())),
        };
        let type_name = match &kind {
            _ if of.is_map() => "map".to_owned(),
            _ if of.is_group() => "group".to_owned(),
            Kind::Message(inside) => inside.full_name().to_owned(),
            Kind::Enum(names) => names.full_name().to_owned(),
            scalar => format!("{scalar:?}").to_lowercase(),
        };
        let count = if of.is_list() { Count::Counted } else { Count::One };
        Field { name: of.name().to_owned(), type_name, base, count, number: of.number() }
    }
}

/// Walks one message and puts the values of wanted fields into `values`.
pub fn walk(
    message: &Bytes,
    shape: &Shape,
    wanted: &Wanted,
    values: &mut SlotValues,
) -> Result<(), ReadError> {
    Walk { message, shape, values }.inside(0, message, wanted)
}

struct Walk<'m> {
    message: &'m Bytes,
    shape: &'m Shape,
    values: &'m mut SlotValues,
}

struct WireValue<'m> {
    wire: WireType,
    /// The value's bytes, without the length that stands before them.
    bytes: &'m [u8],
}

impl From<DecodeError> for ReadError {
    fn from(_: DecodeError) -> ReadError {
        ReadError::Malformed
    }
}

impl Walk<'_> {
    /// `number` is that of the message's type in the shape.
    fn inside(&mut self, number: usize, bytes: &[u8], wanted: &Wanted) -> Result<(), ReadError> {
        let fields = &self.shape.types[number].fields;
        // for each wanted field, how many elements of it came before: protobuf writes a list as a
        // field that repeats
        let mut seen = vec![0u32; wanted.fields.len()];
        let mut rest = bytes;
        while !rest.is_empty() {
            let (number, wire) = decode_key(&mut rest)?;
            let start = rest;
            skip_field(wire, number, &mut rest, DecodeContext::default())?;
            let mut bytes = &start[..start.len() - rest.len()];
            if wire == WireType::LengthDelimited {
                decode_varint(&mut bytes)?;
            }

            // several paths may want the same field (two elements of one list)
            for (wanted, seen) in wanted.fields.iter().zip(&mut seen) {
                let field = &fields[wanted.at.place];
                if field.number == number {
                    self.take(field, wanted, &WireValue { wire, bytes }, seen)?;
                }
            }
        }
        Ok(())
    }

    fn take(
        &mut self,
        field: &Field,
        wanted: &WantedField,
        piece: &WireValue,
        seen: &mut u32,
    ) -> Result<(), ReadError> {
        // numbers of a list may stand side by side in one piece of bytes ("packed")
        let is_packed = field.is_several() && piece.wire == WireType::LengthDelimited;
        if let Base::Number(_) | Base::Varint(_) = field.base {
            return match is_packed || piece.wire == wire_type(field.base) {
                true => self.numbers(field, wanted, piece.bytes, seen),
                false => Err(ReadError::Malformed),
            };
        }
        if piece.wire != wire_type(field.base) {
            return Err(ReadError::Malformed);
        }

        // texts, bytes and messages: an index counts the occurrences
        let is_this = wanted.at.index.is_none_or(|index| index == *seen);
        *seen = seen.saturating_add(1);
        match (&wanted.then, field.base) {
            _ if !is_this => {}
            (Then::Into(inside), Base::Message(number)) => {
                self.inside(number, piece.bytes, inside)?;
            }
            (Then::Take(slot), Base::Text) => {
                let text = str::from_utf8(piece.bytes).map_err(|_| ReadError::Malformed)?;
                self.values.set(*slot, Value::Text(text.to_owned()));
            }
            (Then::Take(slot), _) => {
                let array = self.array(Element::U8, piece.bytes);
                self.values.set(*slot, Value::Array(array));
            }
            (Then::Into(_), _) => return Err(ReadError::Malformed),
        }
        Ok(())
    }

    /// A list may come packed or not, whatever the schema says; readers must accept both.
    fn numbers(
        &mut self,
        field: &Field,
        wanted: &WantedField,
        mut bytes: &[u8],
        seen: &mut u32,
    ) -> Result<(), ReadError> {
        let Then::Take(slot) = wanted.then else { return Err(ReadError::Malformed) };
        match (wanted.at.index, field.base) {
            // a list of numbers of fixed width is taken without a copy; if it comes in parts, they are joined
            (None, Base::Number(element)) if field.is_several() => {
                if !bytes.len().is_multiple_of(element.bytes()) {
                    return Err(ReadError::Malformed);
                }
                self.values.append(slot, self.array(element, bytes));
            }
            // varints have no fixed width, so they are gathered one by one
            (None, _) if field.is_several() => {
                let mut all = self.values.gathered(slot);
                while !bytes.is_empty() {
                    all.push(next(field.base, &mut bytes)?.float());
                }
                self.values.set(slot, Value::Gathered(all));
            }
            // the last number that is met, as protobuf has it, or the one that the index asks for
            (index, base) => {
                while !bytes.is_empty() {
                    let number = next(base, &mut bytes)?;
                    if index.is_none_or(|index| index == *seen) {
                        self.values.set(slot, Value::Number(number));
                    }
                    *seen = seen.saturating_add(1);
                }
            }
        }
        Ok(())
    }

    /// An array of the message's own bytes, without a copy.
    fn array(&self, element: Element, bytes: &[u8]) -> Array {
        Array { element, big_endian: false, bytes: self.message.slice_ref(bytes) }
    }
}

fn wire_type(base: Base) -> WireType {
    match base {
        Base::Number(element) if element.bytes() == 8 => WireType::SixtyFourBit,
        Base::Number(_) => WireType::ThirtyTwoBit,
        Base::Bool | Base::Varint(_) => WireType::Varint,
        Base::Text | Base::Bytes | Base::Message(_) => WireType::LengthDelimited,
        Base::Closed => WireType::StartGroup,
    }
}

fn next(base: Base, rest: &mut &[u8]) -> Result<Number, ReadError> {
    if let Base::Number(element) = base {
        let (one, after) = rest.split_at_checked(element.bytes()).ok_or(ReadError::Malformed)?;
        *rest = after;
        return element.read(one, false).ok_or(ReadError::Malformed);
    }
    let bits = decode_varint(rest)?;
    Ok(Number::Integer(match base {
        Base::Varint(Sign::ZigZag) => i128::from((bits >> 1) as i64 ^ -((bits & 1) as i64)),
        Base::Varint(Sign::Unsigned) => i128::from(bits),
        _ => i128::from(bits as i64),
    }))
}
