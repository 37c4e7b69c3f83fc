//! A schema, whatever its encoding, as a list of message types that refer to each other by number;
//! and paths resolved in it.
//!
//! In: shapes that `protobuf.rs` and `ros_definition.rs` make of a recording's schemas, and the
//! paths of a dialect (from `plan.rs`). Out: what field a path leads to; and lists of fields for
//! errors. JSON has no schema and no shape: only its messages can tell whether a path leads anywhere.

use super::fields::{FieldInfo, Kind, MOST_DEPTH, MOST_FIELDS, NANOSECONDS, SECONDS};
use super::path::FieldPath;
use super::value::Element;

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
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Field {
    pub name: String,
    /// The schema's own word for the type of one element, for errors and lists.
    pub type_name: String,
    pub base: Base,
    pub count: Count,
}

/// The type of one element of a field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Base {
    Bool,
    /// In ROS as it lies in a message; of protobuf it only says whether the number is whole.
    Number(Element),
    Text,
    Bytes,
    /// Another message, by the number of its type.
    Message(usize),
    /// A map or a group of protobuf: no path leads into it.
    Closed,
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
            Base::Number(_) => Kind::Integer,
            Base::Bool => Kind::Bool,
            Base::Text => Kind::Text,
            Base::Bytes => Kind::Bytes,
            Base::Message(inside) if self.is_time(inside) => Kind::Time,
            Base::Message(_) | Base::Closed => Kind::Message,
        };
        FieldInfo::new(path, kind, list, &field.type_name)
    }

    /// Whether a message type has whole numbers of seconds and of nanoseconds.
    fn is_time(&self, message: usize) -> bool {
        let is_whole = |field: &Field| match field.base {
            Base::Number(of) => !matches!(of, Element::F32 | Element::F64) && !field.is_several(),
            _ => false,
        };
        let fields = &self.types[message].fields;
        let has = |names: &[&str]| {
            fields.iter().any(|field| names.contains(&&*field.name) && is_whole(field))
        };
        has(&SECONDS) && has(&NANOSECONDS)
    }

    /// The field to which a path leads; the error says at which step it ends.
    pub fn field(&self, path: &FieldPath) -> Result<FieldInfo, String> {
        let (last, before) = path.steps().split_last().ok_or("an empty path")?;
        // every step but the last must lead into a message
        let mut message = &self.types[0];
        for step in before {
            let field = message.field(&step.name)?;
            let Base::Message(inside) = field.base else {
                return Err(format!("\"{step}\" has no fields of its own"));
            };
            step.check_on_the_way(field.is_several())?;
            message = &self.types[inside];
        }

        // the last step is the field itself: all of its elements, or the one that the index picks
        let field = message.field(&last.name)?;
        last.check_index(field.is_several())?;
        let list = field.is_several() && last.index.is_none();
        Ok(self.info(field, path.to_string(), list))
    }
}

impl MessageType {
    fn field(&self, name: &str) -> Result<&Field, String> {
        let field = self.fields.iter().find(|field| field.name == name);
        field.ok_or_else(|| format!("{} has no field \"{name}\"", self.name))
    }
}
