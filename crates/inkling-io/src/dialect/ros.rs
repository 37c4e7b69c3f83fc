//! Walks ROS messages by the definitions in the recording: ROS 1's own encoding, and CDR, which ROS
//! 2 writes.
//!
//! In, from `plan.rs`: a message, its shape (`ros_definition.rs`), and the tree of wanted fields.
//! Out: [`SlotValues`]. Neither encoding says where a field lies, so a message is walked from its
//! first field to its last, even if only one field is wanted; arrays of numbers are passed over at
//! once. Texts and arrays of variable length have their length before them, in 4 bytes. CDR aligns
//! each number to its own width, ROS 1 aligns nothing.

use super::ros_definition::Flavour;
use super::shape::{Base, Count, Field, Shape};
use super::value::{Array, Element, ReadError, SlotValues, Value};
use super::wanted::{Then, Wanted, WantedField};
use bytes::Bytes;
use std::ops::Range;

/// Bytes at the beginning of a CDR message that say how it is written: order of bytes and version.
const ENCAPSULATION: usize = 4;
/// Most bytes behind a CDR message's last field that count as padding; more mean that the
/// definition is not that of the message.
const MOST_PADDING: usize = 8;

/// Walks one message and puts the values of wanted fields into `values`. A message that is shorter
/// or longer than its definition says is malformed.
pub fn walk(
    message: &Bytes,
    flavour: Flavour,
    shape: &Shape,
    wanted: &Wanted,
    values: &mut SlotValues,
) -> Result<(), ReadError> {
    // The first two bytes of CDR say the order of bytes and the version. The second version (6, 7)
    // aligns numbers of 8 bytes to 4 bytes only.
    let (at, big_endian, widest) = match (flavour, message.get(..2)) {
        (Flavour::Ros1, _) => (0, false, 1),
        (Flavour::Ros2, Some([0, 0])) => (ENCAPSULATION, true, 8),
        (Flavour::Ros2, Some([0, 1])) => (ENCAPSULATION, false, 8),
        (Flavour::Ros2, Some([0, 6])) => (ENCAPSULATION, true, 4),
        (Flavour::Ros2, Some([0, 7])) => (ENCAPSULATION, false, 4),
        _ => return Err(ReadError::Malformed), // has parameters or delimiters, which ROS never writes
    };
    let mut walk = Walk { shape, flavour, message, values, at, origin: at, widest, big_endian };
    walk.message_of(0, &wanted.fields)?;
    // what is left behind the last field must be padding
    let left = message.len().checked_sub(walk.at).ok_or(ReadError::Malformed)?;
    let most = if flavour == Flavour::Ros1 { 0 } else { MOST_PADDING };
    if left > most { Err(ReadError::Malformed) } else { Ok(()) }
}

struct Walk<'m> {
    shape: &'m Shape,
    flavour: Flavour,
    message: &'m Bytes,
    values: &'m mut SlotValues,
    at: usize,
    /// The byte from which alignment counts: the first one behind the encapsulation.
    origin: usize,
    /// The largest alignment in bytes; 1: nothing is aligned.
    widest: usize,
    big_endian: bool,
}

impl Walk<'_> {
    fn message_of(&mut self, number: usize, wanted: &[WantedField]) -> Result<(), ReadError> {
        let of = &self.shape.types[number];
        if of.empty {
            return Ok(());
        }
        if of.fields.is_empty() {
            return self.take(1, 1).map(drop); // ROS 2 writes one byte for a message without fields
        }
        for (place, field) in of.fields.iter().enumerate() {
            let here: Vec<&WantedField> =
                wanted.iter().filter(|wanted| wanted.at.place == place).collect();
            self.field(field, &here)?;
        }
        Ok(())
    }

    fn field(&mut self, field: &Field, wanted: &[&WantedField]) -> Result<(), ReadError> {
        let count = match field.count {
            Count::One => 1,
            Count::Fixed(n) => n,
            Count::Counted => self.u32()?,
        };

        // numbers, and messages that take no bytes, are passed over at once whatever the count
        match field.base {
            Base::Bool => return self.numbers(field, Element::U8, count, wanted),
            Base::Number(element) => return self.numbers(field, element, count, wanted),
            Base::Message(of) if self.shape.types[of].empty => return Ok(()),
            _ => {}
        }
        for index in 0..count {
            let index = field.is_several().then_some(index);
            let mut here = wanted.iter().filter(|wanted| wanted.at.index == index);
            if let Base::Message(of) = field.base {
                let inside = here.find_map(|wanted| match &wanted.then {
                    Then::Into(inside) => Some(inside.fields.as_slice()),
                    Then::Take(_) => None,
                });
                self.message_of(of, inside.unwrap_or_default())?;
                continue;
            }
            // elements that are not numbers have lengths of their own, so each must be passed over by itself
            let text = self.text()?;
            for wanted in here {
                let text = str::from_utf8(&self.message[text.clone()]);
                let text = text.map_err(|_| ReadError::Malformed)?.to_owned();
                self.set(wanted, Value::Text(text));
            }
        }
        Ok(())
    }

    fn numbers(
        &mut self,
        field: &Field,
        element: Element,
        count: u32,
        wanted: &[&WantedField],
    ) -> Result<(), ReadError> {
        if count == 0 {
            return Ok(()); // CDR does not align for an array without elements
        }
        let width = element.bytes();
        let bytes = (count as usize).checked_mul(width).ok_or(ReadError::Malformed)?;
        let at = self.take(bytes, width)?;
        for wanted in wanted {
            let value = match wanted.at.index {
                None if field.is_several() => {
                    let bytes = self.message.slice(at.clone());
                    Value::Array(Array { element, big_endian: self.big_endian, bytes })
                }
                index => {
                    let from = index.unwrap_or(0) as usize * width;
                    let one = self.message[at.clone()].get(from..);
                    match one.and_then(|one| element.read(one, self.big_endian)) {
                        Some(number) => Value::Number(number),
                        None => continue, // the array has fewer elements than the index asks for
                    }
                }
            };
            self.set(wanted, value);
        }
        Ok(())
    }

    fn set(&mut self, wanted: &WantedField, value: Value) {
        if let Then::Take(slot) = wanted.then {
            self.values.set(slot, value);
        }
    }

    fn u32(&mut self) -> Result<u32, ReadError> {
        let at = self.take(4, 4)?;
        let bytes = self.message[at].first_chunk().copied().ok_or(ReadError::Malformed)?;
        Ok(if self.big_endian { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) })
    }

    /// Passes over a text and gives its place. CDR ends a text with a zero byte, which its length
    /// counts; the zero is cut off.
    fn text(&mut self) -> Result<Range<usize>, ReadError> {
        let n = self.u32()? as usize;
        let at = self.take(n, 1)?;
        let zero = self.flavour == Flavour::Ros2 && self.message[at.clone()].ends_with(&[0]);
        Ok(at.start..at.end - usize::from(zero))
    }

    /// Passes over `bytes` bytes, which begin at the next multiple of `align` from `origin` where
    /// the encoding aligns; gives their place. An error if the message ends before.
    fn take(&mut self, bytes: usize, align: usize) -> Result<Range<usize>, ReadError> {
        let align = align.min(self.widest);
        let from = self.at + (self.at - self.origin).wrapping_neg() % align;
        let to = from.checked_add(bytes).filter(|to| *to <= self.message.len());
        self.at = to.ok_or(ReadError::Malformed)?;
        Ok(from..self.at)
    }
}
