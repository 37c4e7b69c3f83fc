//! Describes the fields of a schema in words, for lists and errors, and says which field can be
//! which part of a burst.
//!
//! `shape.rs` and `json.rs` make a [`FieldInfo`] of each field; `plan.rs` asks
//! [`FieldInfo::can_be`] for every path of a dialect, and `guess.rs` asks it to find candidates.

/// At most so many fields are named in an error.
const MOST_LISTED: usize = 40;
pub const MOST_FIELDS: usize = 400;
/// Fields are listed down to this depth of messages within messages, since types may contain themselves.
pub const MOST_DEPTH: usize = 5;

/// Names of the field of seconds in messages that are a time: of protobuf, of ROS 2, and of others.
pub const SECONDS: [&str; 3] = ["seconds", "sec", "secs"];
/// Names of the field of nanoseconds in these time messages.
pub const NANOSECONDS: [&str; 4] = ["nanos", "nanosec", "nsecs", "nsec"];

/// The part of a burst that a field becomes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Slot {
    Samples,
    Channels,
    SamplesPerChannel,
    FirstChannel,
    Period,
    Rate,
    Time,
    Temperature,
    Voltage,
    /// s since the previous actuation.
    Idle,
    /// How many neighbours were actuated with it.
    Neighbours,
    /// A piece of the printhead's name.
    Text,
}

impl Slot {
    /// Whether a JSON message may lack it.
    pub fn is_optional(self) -> bool {
        matches!(self, Slot::Temperature | Slot::Voltage | Slot::Idle | Slot::Neighbours)
    }
}

/// What a field is, as far as that matters to a burst.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Bool,
    Integer,
    Float,
    Text,
    Bytes,
    /// A message of seconds and nanoseconds.
    Time,
    Message,
}

/// A field of a schema: its path, what it is, and the schema's own word for its type.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FieldInfo {
    pub path: String,
    pub kind: Kind,
    pub list: bool,
    /// If a field of a JSON message is a list of lists: how many lists.
    pub rows: Option<usize>,
    pub type_name: String,
}

impl FieldInfo {
    pub fn new(path: String, kind: Kind, list: bool, type_name: &str) -> FieldInfo {
        FieldInfo { path, kind, list, rows: None, type_name: type_name.to_owned() }
    }

    pub fn can_be(&self, slot: Slot) -> Result<(), String> {
        use Kind::*;
        let of = (self.kind, self.list);
        let (fits, due) = match slot {
            Slot::Samples => {
                (self.is_numbers() || of == (Bytes, false), "bytes or an array of numbers")
            }
            Slot::Channels | Slot::SamplesPerChannel | Slot::FirstChannel => {
                (self.is_number(), "a whole number")
            }
            Slot::Period | Slot::Rate | Slot::Temperature | Slot::Voltage => {
                (self.is_number(), "a number")
            }
            Slot::Time => (
                matches!(of, (Integer | Float | Time, false)),
                "ns as an integer, s as a float, a message of seconds and nanoseconds, or in JSON RFC 3339 with a zone",
            ),
            Slot::Idle => (matches!(self.kind, Integer | Float), "a number or an array of numbers"),
            Slot::Neighbours => (
                matches!(self.kind, Integer | Float | Bytes),
                "a number, an array of numbers, or bytes",
            ),
            Slot::Text => (matches!(of, (Text | Integer, false)), "text or a whole number"),
        };
        fits.then_some(()).ok_or_else(|| format!("is {}, not {due}", self.typed()))
    }

    /// Whether it is an array of numbers, or of rows of numbers.
    pub fn is_numbers(&self) -> bool {
        matches!((self.kind, self.list), (Kind::Integer | Kind::Float, true))
    }

    fn is_number(&self) -> bool {
        matches!((self.kind, self.list), (Kind::Integer | Kind::Float, false))
    }

    pub fn typed(&self) -> String {
        format!("{}{}", self.type_name, if self.list { "[]" } else { "" })
    }
}

/// Fields in one line, such as `header.stamp (time), wave.data (bytes)`, at most `MOST_LISTED` of
/// them; "none" if there are none.
pub fn listed(fields: &[FieldInfo]) -> String {
    let named = fields.iter().filter(|field| field.kind != Kind::Message);
    let named: Vec<String> =
        named.map(|field| format!("{} ({})", field.path, field.typed())).collect();
    let shown = named[..named.len().min(MOST_LISTED)].join(", ");
    match named.len().saturating_sub(MOST_LISTED) {
        _ if named.is_empty() => "none".into(),
        0 => crate::printable::line(&shown, 2000),
        more => crate::printable::line(&format!("{shown} and {more} more"), 2000),
    }
}
