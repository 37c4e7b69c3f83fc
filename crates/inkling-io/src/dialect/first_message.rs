//! The first message of a channel as a proposal of a dialect looks at it (`guess.rs`): what its fields
//! hold, and what samples they would give.
//!
//! In: a decoded message and its fields. Out: numbers, texts and [`MessageSamples`], field
//! by field; fields as the user is shown them ([`ShownField`]).

use super::fields::{FieldInfo, Kind, Slot};
use super::message::{Message, date_of};
use super::path::FieldPath;
use super::plan::{Reading, unit_ns};
use super::value::{self, Number, Value};
use crate::printable;
use bytes::Bytes;
use chrono::{DateTime, SecondsFormat};
use inkling_core::burst::Format;
use inkling_core::verdict::Reason;

/// A first message that is larger is not looked at: 4096 channels of 1024 samples of int16.
pub const MOST_MESSAGE_BYTES: usize = 8 << 20;
/// A message with fewer numbers than these is no burst.
const FEWEST_SAMPLES: usize = 32;
/// At most so many fields are tried as samples.
const MOST_CANDIDATES: usize = 32;
/// Bound on the bytes of samples that are made of the first message. It is four times the message,
/// because a number of one byte (in an array of int8) may become a float32 of four.
const MOST_LOOKED_AT: u64 = MOST_MESSAGE_BYTES as u64 * 4;

#[derive(Clone, Debug, serde::Serialize)]
pub struct ShownField {
    pub path: String,
    #[serde(rename = "type")]
    pub type_name: String,
    /// Of a field with several elements, how many; of bytes, how many bytes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub length: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub value: Option<String>,
}

/// The samples that one field of the first message would give.
pub struct MessageSamples {
    /// Length of the field as the user sees it: bytes of a field of bytes, else numbers.
    pub length: usize,
    /// If the field is a list of lists, how many inner lists it has.
    pub outer: Option<usize>,
    pub numbers: Vec<f64>,
    /// The guessed format of a field of bytes; `None` for arrays of numbers, whose type is known.
    pub format: Option<Format>,
}

pub struct FirstMessage {
    message: Message,
    pub fields: Vec<FieldInfo>,
}

impl FirstMessage {
    /// The error is that of [`Reading::decode`].
    pub fn of(reading: &Reading, message: &Bytes) -> Result<FirstMessage, Reason> {
        let message = reading.decode(message)?;
        Ok(FirstMessage { fields: reading.fields(&message), message })
    }

    pub fn shown(&self, field: &FieldInfo) -> ShownField {
        let several = field.list || field.kind == Kind::Bytes;
        let samples = several.then(|| self.samples(field)).flatten();
        let value = if several { None } else { self.value(field) };
        let length = samples.map(|samples| samples.length);
        ShownField { path: field.path.clone(), type_name: field.typed(), length, value }
    }

    /// The samples that this field would give. `None`: it cannot be read as samples.
    pub fn samples(&self, field: &FieldInfo) -> Option<MessageSamples> {
        let is_bytes = field.kind == Kind::Bytes;
        // bytes are read as int16 first; if they look more like float32, they are read as float32
        let written = is_bytes.then_some(Format::S16Le);
        let samples = self.find(&field.path)?.samples(written, MOST_LOOKED_AT)?;
        let bytes = &samples.bytes;
        let format = match is_bytes && bytes.len().is_multiple_of(4) && look_like_floats(bytes) {
            true => Format::F32Le,
            false => samples.format,
        };
        let numbers: Vec<f64> = value::samples(bytes, format).collect();
        Some(MessageSamples {
            length: if is_bytes { bytes.len() } else { numbers.len() },
            outer: field.rows,
            numbers,
            format: is_bytes.then_some(format),
        })
    }

    /// The field with the most numbers, and these; `None`: no field has enough for a burst.
    pub fn likely_samples(&self) -> Option<(&FieldInfo, MessageSamples)> {
        let fields = self.fields.iter().filter(|field| field.can_be(Slot::Samples).is_ok());
        let tried = fields.take(MOST_CANDIDATES).filter_map(|of| Some((of, self.samples(of)?)));
        let most = tried.max_by_key(|(_, samples)| samples.numbers.len());
        most.filter(|(_, samples)| samples.numbers.len() >= FEWEST_SAMPLES)
    }

    pub fn value(&self, field: &FieldInfo) -> Option<String> {
        match (field.kind, self.find(&field.path)?) {
            (Kind::Integer | Kind::Float, value) => Some(value.number()?.to_string()),
            (Kind::Text | Kind::Time, Value::Text(text)) => Some(printable::cell(text)),
            (Kind::Time, _) => {
                let path = FieldPath::try_from(field.path.clone()).ok()?;
                let time = DateTime::from_timestamp_nanos(self.message.time_ns(&path)?);
                Some(time.to_rfc3339_opts(SecondsFormat::Nanos, true))
            }
            _ => None,
        }
    }

    /// Whether samples lie in an array of messages, of which the next one has as many, or in a field beside another one of
    /// that length whose name has another number (`ch0`, `ch1`): a path leads to one alone.
    pub fn is_one_of_several(&self, field: &FieldInfo) -> bool {
        let next = FieldInfo { path: field.path.replacen("[0]", "[1]", 1), ..field.clone() };
        let length = |of: &FieldInfo| self.samples(of).map(|samples| samples.length);
        let is_as_long = |of: &FieldInfo| length(of).is_some() && length(of) == length(field);
        let is_digit = |c: char| c.is_ascii_digit();
        let is_alike = |of: &FieldInfo| {
            let [of, own] = [of, field].map(|of| of.path.replace(is_digit, ""));
            own.len() < field.path.len() && of == own
        };
        let mut beside = self.fields.iter().filter(|of| of.path != field.path && of.is_numbers());
        next.path != field.path && is_as_long(&next)
            || beside.any(|of| is_alike(of) && is_as_long(of))
    }

    pub fn number(&self, path: &str) -> Option<f64> {
        Some(self.find(path)?.number()?.float())
    }

    /// The date that the number at `path` is, ns since 1970; `None`: it is none.
    pub fn date(&self, path: &str) -> Option<i64> {
        let own = path.rsplit('.').next().unwrap_or_default();
        date_of(self.find(path)?.number()?, unit_ns(own))
    }

    /// All numbers of an array.
    pub fn numbers(&self, path: &str) -> Option<Vec<f64>> {
        let field = self.fields.iter().find(|field| field.path == path)?;
        Some(self.samples(field)?.numbers)
    }

    pub fn text(&self, path: &str) -> Option<String> {
        match self.find(path)? {
            Value::Text(text) => Some(text.to_owned()),
            _ => None,
        }
    }

    /// A whole number of more than 0.
    pub fn count(&self, path: &str) -> Option<usize> {
        let n = self.find(path)?.number().and_then(Number::integer)?;
        usize::try_from(n).ok().filter(|n| *n > 0)
    }

    fn find(&self, path: &str) -> Option<Value<'_>> {
        self.message.find(&FieldPath::try_from(path.to_owned()).ok()?)
    }
}

/// Whether bytes look like float32 rather than int16: more than 19 of 20 are, as floats, zero or of
/// a magnitude that samples have (1e-6 to 1e7).
fn look_like_floats(bytes: &[u8]) -> bool {
    let all = bytes.as_chunks::<4>().0;
    let usual = all.iter().filter(|b| {
        let x = f32::from_le_bytes(**b).abs();
        x == 0.0 || (1e-6..1e7).contains(&x)
    });
    usual.count() * 20 > all.len() * 19
}
