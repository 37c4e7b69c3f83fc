//! ROS messages, by the definitions in the recording: ROS 1's own encoding and CDR (ROS 2).
//!
//! Neither says what is where, so a message is walked from its first field to its last; arrays of
//! numbers are passed over at once.

use super::fields::{FieldInfo, Kind, MOST_DEPTH, NANOSECONDS, SECONDS};
use super::path::FieldPath;
use super::ros_definition::{Base, Count, Definitions, Flavour, RosField};
use super::value::{Element, Malformed, SlotValues, Value};
use super::wanted::{At, Slot, Then, Wanted};
use std::ops::Range;

const MOST_FIELDS: usize = 400;
/// Bytes before a CDR message: how it is written.
const ENCAPSULATION: usize = 4;
/// Bytes after the last field that a writer may fill up with.
const MOST_PADDING: usize = 8;

/// What there is.
pub fn fields(definitions: &Definitions) -> Vec<FieldInfo> {
    let mut found = Vec::new();
    list(definitions, 0, "", 0, &mut found);
    found
}

fn list(of: &Definitions, message: usize, before: &str, depth: usize, found: &mut Vec<FieldInfo>) {
    for field in &of.types[message].fields {
        if found.len() >= MOST_FIELDS {
            return;
        }
        let info = info(of, field, format!("{before}{}", field.name));
        match field.base {
            Base::Message(inside) if info.kind == Kind::Message && depth < MOST_DEPTH => {
                let index = if info.list { "[0]" } else { "" };
                list(of, inside, &format!("{}{index}.", info.path), depth + 1, found);
            }
            _ => found.push(info),
        }
    }
}

fn info(of: &Definitions, field: &RosField, path: String) -> FieldInfo {
    let many = field.count != Count::One;
    let (kind, list) = match field.base {
        Base::Bool => (Kind::Bool, many),
        Base::Number(Element::U8) if many => (Kind::Bytes, false),
        Base::Number(Element::F32 | Element::F64) => (Kind::Float, many),
        Base::Number(_) => (Kind::Integer, many),
        Base::Text => (Kind::Text, many),
        Base::Time { .. } => (Kind::Time, many),
        Base::Message(inside) if time_fields(of, inside).is_some() => (Kind::Time, many),
        Base::Message(_) => (Kind::Message, many),
    };
    let word = field.type_name.split('[').next().unwrap_or_default();
    let type_name = if kind == Kind::Bytes { "uint8[]" } else { word };
    FieldInfo { path, kind, list, type_name: type_name.to_owned() }
}

/// Places of seconds and nanoseconds, if that is what a message has.
fn time_fields(of: &Definitions, message: usize) -> Option<[usize; 2]> {
    let fields = &of.types[message].fields;
    let whole = |f: &RosField| {
        matches!(f.base, Base::Number(e) if !matches!(e, Element::F32 | Element::F64))
            && f.count == Count::One
    };
    let find = |names: &[&str]| fields.iter().position(|f| names.contains(&&*f.name) && whole(f));
    Some([find(&SECONDS)?, find(&NANOSECONDS)?])
}

/// Adds a path to what is wanted.
pub fn want(
    wanted: &mut Wanted<usize>,
    definitions: &Definitions,
    path: &FieldPath,
    slot: Slot,
) -> Result<FieldInfo, String> {
    let mut message = 0;
    let mut way = Vec::new();
    let (last, before) = path.steps().split_last().ok_or("an empty path")?;
    let enter = |message: usize, name: &str| {
        let of = &definitions.types[message];
        let place = of.fields.iter().position(|field| field.name == name);
        place
            .map(|place| (place, &of.fields[place]))
            .ok_or_else(|| format!("{} has no field \"{name}\"", of.name))
    };
    for step in before {
        let (place, field) = enter(message, &step.name)?;
        let Base::Message(inside) = field.base else {
            return Err(format!("\"{step}\" has no fields of its own"));
        };
        step.check_on_the_way(field.count != Count::One)?;
        way.push(At { key: place, index: step.index });
        message = inside;
    }
    let (place, field) = enter(message, &last.name)?;
    let mut info = info(definitions, field, path.to_string());
    last.check_index(field.count != Count::One)?;
    match (last.index, info.kind) {
        (None, _) => {}
        (Some(_), Kind::Bytes) => info.kind = Kind::Integer,
        (Some(_), _) => info.list = false,
    }
    info.can_be(slot)?;
    way.push(At { key: place, index: last.index });
    match (slot, field.base) {
        (Slot::Time, Base::Message(time)) => {
            let places = time_fields(definitions, time).ok_or("is no time")?;
            wanted.want_time(&way, places);
        }
        _ => wanted.want(&way, slot),
    }
    Ok(info)
}

/// Walks one message.
pub fn walk(
    message: &[u8],
    definitions: &Definitions,
    wanted: &Wanted<usize>,
    values: &mut SlotValues,
) -> Result<(), Malformed> {
    let (at, (big_endian, widest)) = match definitions.flavour {
        Flavour::Ros1 => (0, (false, 1)),
        Flavour::Ros2 => (
            ENCAPSULATION,
            match message.get(..2).ok_or(Malformed)? {
                [0, 0] => (true, 8),
                [0, 1] => (false, 8),
                [0, 6] => (true, 4),
                [0, 7] => (false, 4),
                _ => return Err(Malformed), // with parameters or delimiters: not what ROS writes
            },
        ),
    };
    let mut walk = Walk { definitions, message, values, at, origin: at, widest, big_endian };
    walk.message_of(0, Some(wanted))?;
    let left = message.len().checked_sub(walk.at).ok_or(Malformed)?;
    let most = if definitions.flavour == Flavour::Ros1 { 0 } else { MOST_PADDING };
    if left > most { Err(Malformed) } else { Ok(()) }
}

struct Walk<'m> {
    definitions: &'m Definitions,
    message: &'m [u8],
    values: &'m mut SlotValues,
    at: usize,
    /// Where alignment counts from.
    origin: usize,
    /// The largest alignment; 1: there is none.
    widest: usize,
    big_endian: bool,
}

impl Walk<'_> {
    fn message_of(
        &mut self,
        number: usize,
        wanted: Option<&Wanted<usize>>,
    ) -> Result<(), Malformed> {
        let of = &self.definitions.types[number];
        if of.empty {
            return Ok(());
        }
        if of.fields.is_empty() {
            return self.take(1, 1).map(drop); // ROS 2 puts a byte where there is nothing
        }
        for (place, field) in of.fields.iter().enumerate() {
            let here = wanted.filter(|wanted| wanted.fields.iter().any(|f| f.at.key == place));
            self.field(place, field, here)?;
        }
        Ok(())
    }

    fn field(
        &mut self,
        place: usize,
        field: &RosField,
        wanted: Option<&Wanted<usize>>,
    ) -> Result<(), Malformed> {
        let (count, many) = match field.count {
            Count::One => (1, false),
            Count::Fixed(n) => (n, true),
            Count::Counted => (self.u32()?, true),
        };
        match field.base {
            Base::Number(element) if many => return self.numbers(place, element, count, wanted),
            Base::Bool if many => return self.take(count as usize, 1).map(drop),
            Base::Message(of) if self.definitions.types[of].empty => return Ok(()),
            _ => {}
        }
        for index in 0..count {
            let these = wanted.map(|wanted| (wanted, many.then_some(index)));
            self.one(place, field.base, these)?;
        }
        Ok(())
    }

    /// One value; `wanted` with its index where it is one of several.
    fn one(
        &mut self,
        place: usize,
        base: Base,
        wanted: Option<(&Wanted<usize>, Option<u32>)>,
    ) -> Result<(), Malformed> {
        let here = |index: Option<u32>| At { key: place, index };
        let slots: Vec<Slot> = match wanted {
            Some((wanted, index)) => wanted
                .fields
                .iter()
                .filter_map(|field| match field.then {
                    Then::Take(slot) if field.at == here(index) => Some(slot),
                    _ => None,
                })
                .collect(),
            None => Vec::new(),
        };
        match base {
            Base::Bool => {
                self.take(1, 1)?;
            }
            Base::Number(element) => {
                let at = self.take(element.bytes(), element.bytes())?;
                let number = element.read(&self.message[at], self.big_endian).ok_or(Malformed)?;
                slots.iter().for_each(|slot| self.values.set(*slot, Value::Number(number)));
            }
            Base::Text => {
                let text = self.text()?;
                for slot in slots {
                    let text = std::str::from_utf8(&self.message[text.clone()]);
                    let text = text.map_err(|_| Malformed)?;
                    self.values.set(slot, Value::Text(text.to_owned()));
                }
            }
            Base::Time { signed } => {
                let element = if signed { Element::I32 } else { Element::U32 };
                for slot in [Slot::Seconds, Slot::Nanoseconds] {
                    let at = self.take(4, 4)?;
                    let number = element.read(&self.message[at], self.big_endian);
                    if slots.contains(&Slot::Time) {
                        self.values.set(slot, Value::Number(number.ok_or(Malformed)?));
                    }
                }
            }
            Base::Message(of) => {
                let inside = wanted.and_then(|(wanted, index)| {
                    wanted.fields.iter().find_map(|field| match &field.then {
                        Then::Into(inside) if field.at == here(index) => Some(inside),
                        _ => None,
                    })
                });
                self.message_of(of, inside)?;
            }
        }
        Ok(())
    }

    fn numbers(
        &mut self,
        place: usize,
        element: Element,
        count: u32,
        wanted: Option<&Wanted<usize>>,
    ) -> Result<(), Malformed> {
        if count == 0 {
            return Ok(()); // not even aligned
        }
        let bytes = (count as usize).checked_mul(element.bytes()).ok_or(Malformed)?;
        let at = self.take(bytes, element.bytes())?;
        let here = wanted.iter().flat_map(|w| &w.fields).filter(|field| field.at.key == place);
        for field in here {
            let Then::Take(slot) = field.then else { continue };
            let value = match field.at.index {
                None if element == Element::U8 => Value::Bytes(at.clone()),
                None => Value::Numbers { element, at: at.clone(), big_endian: self.big_endian },
                Some(index) if index < count => {
                    let from = at.start + index as usize * element.bytes();
                    let of = &self.message[from..at.end];
                    Value::Number(element.read(of, self.big_endian).ok_or(Malformed)?)
                }
                Some(_) => continue,
            };
            self.values.set(slot, value);
        }
        Ok(())
    }

    fn u32(&mut self) -> Result<u32, Malformed> {
        let at = self.take(4, 4)?;
        let bytes = self.message[at].first_chunk().copied().ok_or(Malformed)?;
        Ok(if self.big_endian { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) })
    }

    /// Of CDR without the zero at its end.
    fn text(&mut self) -> Result<Range<usize>, Malformed> {
        let n = self.u32()? as usize;
        let at = self.take(n, 1)?;
        let zero =
            self.definitions.flavour == Flavour::Ros2 && self.message[at.clone()].ends_with(&[0]);
        Ok(at.start..at.end - usize::from(zero))
    }

    fn take(&mut self, bytes: usize, align: usize) -> Result<Range<usize>, Malformed> {
        let align = align.min(self.widest);
        let from = self.at + (self.at - self.origin).wrapping_neg() % align;
        let to = from.checked_add(bytes).filter(|to| *to <= self.message.len()).ok_or(Malformed)?;
        self.at = to;
        Ok(from..to)
    }
}
