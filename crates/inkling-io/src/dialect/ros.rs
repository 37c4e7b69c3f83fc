//! Walks messages of ROS 2 (CDR) by the definitions in the recording.
//!
//! In, from `plan.rs`: a message, its shape (`ros_definition.rs`), and paths. Out: [`Value`]s. CDR
//! does not say where a field lies, so a message is walked from its first field to its last for each
//! path; arrays of numbers are passed over at once. Texts and arrays of variable length have their
//! length before them, in 4 bytes, and each number is aligned to its own width.

use super::path::Step;
use super::shape::{Base, Count, Field, Shape};
use super::value::{Array, Element, Value};
use bytes::Bytes;
use std::ops::Range;
use std::sync::Arc;

/// Bytes at the beginning of a message that say how it is written: order of bytes and version.
const ENCAPSULATION: usize = 4;
/// Most bytes behind a message's last field that count as padding; more mean that the definition is
/// not that of the message.
const MOST_PADDING: usize = 8;

/// A message that is as long as its definition says.
#[derive(Debug)]
pub struct RosMessage {
    bytes: Bytes,
    shape: Arc<Shape>,
    big_endian: bool,
    /// The largest alignment in bytes.
    widest: usize,
}

impl RosMessage {
    /// `None`: the message is shorter or longer than its definition says.
    pub fn new(bytes: &Bytes, shape: &Arc<Shape>) -> Option<RosMessage> {
        // The first two bytes say the order of bytes and the version. The second version (6, 7)
        // aligns numbers of 8 bytes to 4 bytes only.
        let (big_endian, widest) = match bytes.get(..2)? {
            [0, 0] => (true, 8),
            [0, 1] => (false, 8),
            [0, 6] => (true, 4),
            [0, 7] => (false, 4),
            _ => return None, // has parameters or delimiters, which ROS never writes
        };
        let message = RosMessage { bytes: bytes.clone(), shape: shape.clone(), big_endian, widest };
        let end = message.walk(&[])?.at;
        // what is left behind the last field must be padding
        (bytes.len().checked_sub(end)? <= MOST_PADDING).then_some(message)
    }

    /// The value to which a path leads; `None` where an array ends before it.
    pub fn find(&self, path: &[Step]) -> Option<Value<'_>> {
        self.walk(path)?.found
    }

    fn walk(&self, path: &[Step]) -> Option<Walk<'_>> {
        let mut walk = Walk { of: self, at: ENCAPSULATION, found: None };
        walk.message(0, path)?;
        Some(walk)
    }
}

struct Walk<'m> {
    of: &'m RosMessage,
    at: usize,
    /// What the path leads to, once it was met.
    found: Option<Value<'m>>,
}

impl<'m> Walk<'m> {
    /// Passes over a message; `path` is what is wanted in it, empty where nothing is.
    fn message(&mut self, number: usize, path: &[Step]) -> Option<()> {
        let fields = &self.of.shape.types[number].fields;
        if fields.is_empty() {
            return self.take(1, 1).map(drop); // one byte is written for a message without fields
        }
        for field in fields {
            let is_on_path = path.first().is_some_and(|step| step.name == field.name);
            self.field(field, if is_on_path { path } else { &[] })?;
        }
        Some(())
    }

    fn field(&mut self, field: &Field, path: &[Step]) -> Option<()> {
        let count = match field.count {
            Count::One => 1,
            Count::Fixed(n) => n,
            Count::Counted => self.count()?,
        };
        // numbers are passed over at once whatever the count
        match field.base {
            Base::Bool => return self.numbers(field, Element::U8, count, path),
            Base::Number(element) => return self.numbers(field, element, count, path),
            Base::Message(_) | Base::Text | Base::Bytes | Base::Closed => {}
        }
        // other elements have lengths of their own, so each must be passed over by itself
        for index in 0..count {
            let wanted = path.split_first();
            let wanted = wanted.filter(|(step, _)| step.index.unwrap_or(0) == index);
            match field.base {
                Base::Message(of) => {
                    if let Some((_, [])) = wanted {
                        self.found = Some(Value::Other);
                    }
                    self.message(of, wanted.map_or(&[], |(_, rest)| rest))?;
                }
                _ => {
                    let text = self.text()?;
                    if wanted.is_some() {
                        self.found = Some(str::from_utf8(text).map_or(Value::Other, Value::Text));
                    }
                }
            }
        }
        Some(())
    }

    fn numbers(
        &mut self,
        field: &Field,
        element: Element,
        count: u32,
        path: &[Step],
    ) -> Option<()> {
        if count == 0 {
            return Some(()); // an array without elements is not aligned
        }
        let at = self.take((count as usize).checked_mul(element.bytes())?, element.bytes())?;
        let Some(step) = path.first() else { return Some(()) };
        self.found = match step.index {
            None if field.is_several() => {
                let bytes = self.of.bytes.slice(at);
                Some(Value::Array(Array { element, big_endian: self.of.big_endian, bytes }))
            }
            index => {
                let from = index.unwrap_or(0) as usize * element.bytes();
                let one = self.of.bytes[at].get(from..);
                one.and_then(|one| element.read(one, self.of.big_endian)).map(Value::Number)
            }
        };
        Some(())
    }

    fn count(&mut self) -> Option<u32> {
        let at = self.take(4, 4)?;
        let number = Element::U32.read(&self.of.bytes[at], self.of.big_endian)?;
        u32::try_from(number.integer()?).ok()
    }

    /// Passes over a text. It ends with a zero byte, which its length counts; the zero is cut off.
    fn text(&mut self) -> Option<&'m [u8]> {
        let n = self.count()? as usize;
        let at = self.take(n, 1)?;
        let text = &self.of.bytes[at];
        Some(text.strip_suffix(&[0]).unwrap_or(text))
    }

    /// Passes over `bytes` bytes, which begin at the next multiple of `align` behind the
    /// encapsulation; gives their place. `None` if the message ends before.
    fn take(&mut self, bytes: usize, align: usize) -> Option<Range<usize>> {
        let align = align.min(self.of.widest);
        let from = self.at + (self.at - ENCAPSULATION).wrapping_neg() % align;
        let to = from.checked_add(bytes).filter(|to| *to <= self.of.bytes.len());
        self.at = to?;
        Some(from..self.at)
    }
}
