//! A schema, whatever its encoding, as a list of message types that refer to each other by number;
//! and paths resolved in it.
//!
//! In: shapes that `protobuf.rs` and `ros_definition.rs` make of a recording's schemas, and the
//! paths of a dialect (from `plan.rs`). Out: the tree of wanted fields ([`Wanted`]) with each
//! field's place in its type, so that messages are walked without comparing names; and lists of
//! fields for errors. JSON has no schema and no shape: only its messages can tell whether a path
//! leads anywhere.

use super::fields::{FieldInfo, Kind, MOST_DEPTH, MOST_FIELDS, NANOSECONDS, SECONDS};
use super::path::{FieldPath, Step};
use super::value::Element;
use super::wanted::{Slot, Wanted};

/// The message types of a schema. Number 0 is the type of the message itself.
#[derive(Clone, Debug)]
pub struct Shape {
    pub types: Vec<MessageType>,
}

/// A message type with its fields in the order of the definition.
#[derive(Clone, Debug, Default)]
pub struct MessageType {
    pub name: String,
    pub fields: Vec<Field>,
    /// Whether a message of this type takes no bytes, whatever its fields are. Only ROS 1 has such
    /// types; a count of a billion elements of such a type must not be walked one by one.
    pub empty: bool,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Field {
    pub name: String,
    /// The schema's own word for the type of one element, for errors and lists.
    pub type_name: String,
    pub base: Base,
    pub count: Count,
    /// The field's number in protobuf; 0 in ROS, which goes by the order of the fields.
    pub number: u32,
}

/// The type of one element of a field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Base {
    Bool,
    Number(Element),
    /// A whole number in as many bytes as it needs, seven bits a byte (protobuf).
    Varint(Sign),
    Text,
    Bytes,
    /// Another message, by the number of its type.
    Message(usize),
    /// A map or a group of protobuf: no path leads into it.
    Closed,
}

/// How the bits of a varint are a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sign {
    /// Two's complement of 64 bits.
    Signed,
    Unsigned,
    /// 0, −1, 1, −2 and so on are 0, 1, 2, 3.
    ZigZag,
}

/// Who says how many elements a field has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Count {
    One,
    /// An array of a length that the schema says.
    Fixed(u32),
    /// An array of a length that the message says.
    Counted,
}

impl Field {
    pub fn is_several(&self) -> bool {
        self.count != Count::One
    }
}

impl Shape {
    /// All fields, those within messages too, up to `MOST_FIELDS` and down to `MOST_DEPTH`.
    pub fn fields(&self) -> Vec<FieldInfo> {
        let mut found = Vec::new();
        self.list(0, "", 0, &mut found);
        found
    }

    /// Lists the fields of a message type; `before` is the path that leads to it, with its dot.
    fn list(&self, message: usize, before: &str, depth: usize, found: &mut Vec<FieldInfo>) {
        for field in &self.types[message].fields {
            if found.len() >= MOST_FIELDS {
                return;
            }
            let info = self.info(field, format!("{before}{}", field.name), field.is_several());
            match field.base {
                Base::Message(inside) if info.kind == Kind::Message && depth < MOST_DEPTH => {
                    let index = if info.list { "[0]" } else { "" };
                    self.list(inside, &format!("{}{index}.", info.path), depth + 1, found);
                }
                _ => found.push(info),
            }
        }
    }

    fn info(&self, field: &Field, path: String, list: bool) -> FieldInfo {
        let kind = match field.base {
            Base::Number(Element::U8) if list => {
                return FieldInfo::new(path, Kind::Bytes, false, "uint8[]");
            }
            Base::Number(Element::F32 | Element::F64) => Kind::Float,
            Base::Number(_) | Base::Varint(_) => Kind::Integer,
            Base::Bool => Kind::Bool,
            Base::Text => Kind::Text,
            Base::Bytes => Kind::Bytes,
            Base::Message(inside) if self.time_places(inside).is_some() => Kind::Time,
            Base::Message(_) | Base::Closed => Kind::Message,
        };
        FieldInfo::new(path, kind, list, &field.type_name)
    }

    /// The places of the fields for seconds and nanoseconds, if a message type has both.
    fn time_places(&self, message: usize) -> Option<[usize; 2]> {
        let fields = &self.types[message].fields;
        let is_whole = |field: &Field| match field.base {
            Base::Varint(_) => !field.is_several(),
            Base::Number(of) => !matches!(of, Element::F32 | Element::F64) && !field.is_several(),
            _ => false,
        };
        let find = |names: &[&str]| {
            fields.iter().position(|field| names.contains(&&*field.name) && is_whole(field))
        };
        Some([find(&SECONDS)?, find(&NANOSECONDS)?])
    }

    fn place(&self, message: usize, name: &str) -> Result<usize, String> {
        let of = &self.types[message];
        let place = of.fields.iter().position(|field| field.name == name);
        place.ok_or_else(|| format!("{} has no field \"{name}\"", of.name))
    }

    /// The error says at which step the path ends, or why the field cannot be what the slot asks
    /// for. Of a time that is a message its two fields are added instead.
    pub fn want(
        &self,
        wanted: &mut Wanted,
        path: &FieldPath,
        slot: Slot,
    ) -> Result<FieldInfo, String> {
        let (last, before) = path.steps().split_last().ok_or("an empty path")?;
        // every step but the last must lead into a message
        let (mut message, mut way) = (0, Vec::new());
        for step in before {
            let place = self.place(message, &step.name)?;
            let field = &self.types[message].fields[place];
            let Base::Message(inside) = field.base else {
                return Err(format!("\"{step}\" has no fields of its own"));
            };
            step.check_on_the_way(field.is_several())?;
            way.push(step.at(place));
            message = inside;
        }

        // the last step is the field itself: all of its elements, or the one that the index picks
        let place = self.place(message, &last.name)?;
        let field = &self.types[message].fields[place];
        last.check_index(field.is_several())?;
        let list = field.is_several() && last.index.is_none();
        let info = self.info(field, path.to_string(), list);
        info.can_be(slot)?;
        way.push(last.at(place));
        match (slot, field.base) {
            (Slot::Time, Base::Message(time)) => self.want_time(wanted, &way, time)?,
            _ => wanted.want(&way, slot),
        }
        Ok(info)
    }

    /// `way` leads to the message of seconds and nanoseconds.
    fn want_time(&self, wanted: &mut Wanted, way: &[Step], time: usize) -> Result<(), String> {
        let places = self.time_places(time).ok_or("is no time")?;
        for (place, slot) in places.into_iter().zip([Slot::Seconds, Slot::Nanoseconds]) {
            let name = self.types[time].fields[place].name.clone();
            wanted.want(&[way, &[Step { name, place, index: None }]].concat(), slot);
        }
        Ok(())
    }
}
