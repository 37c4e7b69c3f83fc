//! What fields there are, in words; and which of them can be what.

use super::wanted::Slot;

/// Fields of a schema that a message names, and how deep they are looked for.
const MOST_LISTED: usize = 40;
pub const MOST_DEPTH: usize = 5;

/// Names of what a time is made of.
pub const SECONDS: [&str; 3] = ["seconds", "sec", "secs"];
pub const NANOSECONDS: [&str; 4] = ["nanos", "nanosec", "nsecs", "nsec"];

/// What a field is, as far as a burst is made of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Bool,
    Integer,
    Float,
    Text,
    Bytes,
    /// Seconds and nanoseconds.
    Time,
    Message,
}

/// A field of a schema: its path, what it is, and the schema's own word for that.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FieldInfo {
    pub path: String,
    pub kind: Kind,
    /// Several of it.
    pub list: bool,
    pub type_name: String,
}

impl FieldInfo {
    /// Whether it can be what a slot asks for; if not, what it is and what can.
    pub fn can_be(&self, slot: Slot) -> Result<(), String> {
        use Kind::*;
        let (good, what) = match slot {
            Slot::Samples => (
                matches!((self.kind, self.list), (Bytes, false) | (Integer | Float, true)),
                "bytes or an array of numbers",
            ),
            Slot::Channels | Slot::SamplesPerChannel | Slot::FirstChannel => {
                (matches!((self.kind, self.list), (Integer | Float, false)), "a whole number")
            }
            Slot::Period | Slot::Temperature | Slot::Voltage => {
                (matches!((self.kind, self.list), (Integer | Float, false)), "a number")
            }
            Slot::Time => (
                matches!((self.kind, self.list), (Integer | Float | Time, false)),
                "ns as an integer, s as a float, or a message of seconds and nanoseconds",
            ),
            Slot::Seconds | Slot::Nanoseconds => {
                (self.kind == Integer && !self.list, "a whole number")
            }
            Slot::Idle => (matches!(self.kind, Integer | Float), "a number or an array of numbers"),
            Slot::Neighbours => {
                (matches!(self.kind, Integer | Bytes), "a whole number, an array of such, or bytes")
            }
            Slot::Text(_) => (
                matches!((self.kind, self.list), (Text | Integer, false)),
                "text or a whole number",
            ),
        };
        match good {
            true => Ok(()),
            false => {
                let many = if self.list { "[]" } else { "" };
                Err(format!("is {}{many}, not {what}", self.type_name))
            }
        }
    }
}

/// `header.stamp (time), wave.data (bytes)`.
pub fn listed(fields: &[FieldInfo]) -> String {
    let named: Vec<String> = fields
        .iter()
        .filter(|field| field.kind != Kind::Message)
        .take(MOST_LISTED)
        .map(|field| {
            let many = if field.list { "[]" } else { "" };
            format!("{} ({}{many})", field.path, field.type_name)
        })
        .collect();
    let more = fields.len().saturating_sub(MOST_LISTED);
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    match named.is_empty() {
        true => "none".into(),
        false => crate::printable::line(&(named.join(", ") + &more), 2000),
    }
}
