//! The values that were found in a message, before they are a burst: numbers, texts, arrays and
//! samples, the same for all encodings.
//!
//! `protobuf.rs`, `ros.rs` and `json.rs` find them, by paths; `decoder.rs` asks for them as what
//! they should be. Samples stay where they lie in the message if their bytes are what a
//! burst needs (int16 or float32, little-endian, or bytes whose format the dialect says); otherwise
//! they are gathered number by number ([`Gathered`]), up to a bound.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use bytes::Bytes;
use inkling_core::burst::Format;
use std::fmt;

/// The type of a number of fixed width, as it lies in a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Element {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl Element {
    /// By the names that definitions of ROS use.
    pub const NAMED: [(Element, &'static str); 10] = [
        (Element::I8, "int8"),
        (Element::U8, "uint8"),
        (Element::I16, "int16"),
        (Element::U16, "uint16"),
        (Element::I32, "int32"),
        (Element::U32, "uint32"),
        (Element::I64, "int64"),
        (Element::U64, "uint64"),
        (Element::F32, "float32"),
        (Element::F64, "float64"),
    ];

    pub fn bytes(self) -> usize {
        match self {
            Element::I8 | Element::U8 => 1,
            Element::I16 | Element::U16 => 2,
            Element::I32 | Element::U32 | Element::F32 => 4,
            Element::I64 | Element::U64 | Element::F64 => 8,
        }
    }

    /// Whether these bytes are whole numbers of this type.
    pub fn fill(self, bytes: &[u8]) -> bool {
        bytes.len().is_multiple_of(self.bytes())
    }

    pub fn read(self, bytes: &[u8], big_endian: bool) -> Option<Number> {
        let mut eight = [0; 8];
        let of = bytes.get(..self.bytes())?;
        for (i, byte) in of.iter().enumerate() {
            eight[if big_endian { of.len() - 1 - i } else { i }] = *byte;
        }
        let bits = u64::from_le_bytes(eight);
        Some(match self {
            Element::I8 => Number::Integer((bits as i8).into()),
            Element::U8 => Number::Integer((bits as u8).into()),
            Element::I16 => Number::Integer((bits as i16).into()),
            Element::U16 => Number::Integer((bits as u16).into()),
            Element::I32 => Number::Integer((bits as i32).into()),
            Element::U32 => Number::Integer((bits as u32).into()),
            Element::I64 => Number::Integer((bits as i64).into()),
            Element::U64 => Number::Integer(bits.into()),
            Element::F32 => Number::Float(f32::from_bits(bits as u32).into()),
            Element::F64 => Number::Float(f64::from_bits(bits)),
        })
    }

    /// All numbers of an array. Bytes behind the last whole number are ignored.
    pub fn numbers(self, of: &[u8], big_endian: bool) -> impl Iterator<Item = f64> {
        let each = of.chunks_exact(self.bytes());
        each.filter_map(move |one| self.read(one, big_endian)).map(Number::float)
    }
}

/// A number in a message. i128 holds all whole numbers of 64 bits, with and without sign.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Number {
    /// Written without a fraction.
    Integer(i128),
    Float(f64),
}

impl fmt::Display for Number {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Number::Integer(i) => i.fmt(f),
            Number::Float(x) => x.fmt(f),
        }
    }
}

impl Number {
    pub fn parse(text: &str) -> Option<Number> {
        let whole = text.parse().map(Number::Integer);
        whole.or_else(|_| text.parse().map(Number::Float)).ok()
    }

    /// The number as f64; whole numbers of more than 53 bits are rounded.
    pub fn float(self) -> f64 {
        match self {
            // a cast from i128 takes several times as long
            Number::Integer(i) => i64::try_from(i).map_or(i as f64, |i| i as f64),
            Number::Float(x) => x,
        }
    }

    /// The number as a whole number; `None` where it has a fraction, or is a float of magnitude 1e18 or more. So a time
    /// in ns since 1970 that was written as a float, and is rounded to 256 ns, is refused, and one in µs is not.
    pub fn integer(self) -> Option<i128> {
        match self {
            Number::Integer(i) => Some(i),
            Number::Float(x) => (x.fract() == 0.0 && x.abs() < 1e18).then_some(x as i128),
        }
    }
}

/// Most bytes after which nothing more is gathered, those of the largest burst. Where its last number makes float32 of
/// all, they are twice as many.
const MOST_GATHERED_BYTES: usize = 256 << 20;

/// Samples as a burst has them.
pub struct Samples {
    pub bytes: Bytes,
    pub format: Format,
    /// Whether there were more than the bound allows; then `bytes` may lack some, and are not to be used.
    pub too_many: bool,
}

/// Samples that are gathered number by number. They are kept as int16 as long as all numbers are
/// int16, and become float32 with the first one that is not, because a burst has one format.
#[derive(Default)]
pub struct Gathered {
    bytes: Vec<u8>,
    format: Format,
    /// Whether there were more numbers than the bound allows; then not all are kept.
    too_many: bool,
}

impl Gathered {
    /// `None` where something that is no number stands among them.
    pub fn of(numbers: impl Iterator<Item = Option<f64>>) -> Option<Gathered> {
        let mut all = Gathered::default();
        for x in numbers {
            all.push(x?);
        }
        Some(all)
    }

    pub fn push(&mut self, x: f64) {
        if self.bytes.len() >= MOST_GATHERED_BYTES {
            self.too_many = true;
            return;
        }
        if self.format == Format::S16Le {
            let whole = x as i16;
            if f64::from(whole) == x {
                return self.bytes.extend(whole.to_le_bytes());
            }
            // all that was gathered becomes float32, in twice the bytes
            let floats = samples(&self.bytes, Format::S16Le).map(|x| x as f32);
            self.bytes = floats.flat_map(f32::to_le_bytes).collect();
            self.format = Format::F32Le;
        }
        self.bytes.extend((x as f32).to_le_bytes());
    }

    /// As a burst has them; `too_many` with more than these bytes.
    pub fn samples(self, most_bytes: u64) -> Samples {
        let too_many = self.too_many || self.bytes.len() as u64 > most_bytes;
        Samples { bytes: self.bytes.into(), format: self.format, too_many }
    }
}

pub fn samples(of: &[u8], format: Format) -> impl Iterator<Item = f64> {
    let element = match format {
        Format::S16Le => Element::I16,
        Format::F32Le => Element::F32,
    };
    element.numbers(of, false)
}

/// Numbers of fixed width side by side, as they lie in a message. Bytes are an array of U8.
#[derive(Clone, Debug)]
pub struct Array {
    pub element: Element,
    pub big_endian: bool,
    pub bytes: Bytes,
}

impl Array {
    fn numbers(&self) -> impl Iterator<Item = f64> {
        self.element.numbers(&self.bytes, self.big_endian)
    }
}

/// What a path finds in a message.
pub enum Value<'m> {
    Number(Number),
    Text(&'m str),
    Array(Array),
    /// Numbers that do not lie side by side in the message.
    Numbers(Gathered),
    /// A message with fields of its own, or what is not as it should be.
    Other,
}

impl Value<'_> {
    pub fn is_base64(&self) -> bool {
        matches!(self, Value::Text(text) if BASE64.decode(text).is_ok())
    }

    /// The value as a number. A text counts if it is one, because JSON has integers of 64 bits and
    /// not-a-number as text.
    pub fn number(&self) -> Option<Number> {
        match self {
            Value::Number(number) => Some(*number),
            Value::Text(text) => Number::parse(text),
            Value::Array(_) | Value::Numbers(_) | Value::Other => None,
        }
    }

    /// The value as samples, not copied where they lie in the message as a burst has them. `format`
    /// is that of bytes or base64 text; `None`: bytes are numbers of one byte each.
    pub fn samples(self, format: Option<Format>, most_bytes: u64) -> Option<Samples> {
        let whole = |bytes: Bytes, format| {
            let too_many = bytes.len() as u64 > most_bytes;
            Some(Samples { bytes, format, too_many })
        };
        match self {
            Value::Array(array) => {
                // in which format the bytes can be taken as they are, if in any
                let lie = match array.element {
                    Element::U8 => format,
                    _ if array.big_endian => None,
                    Element::I16 => Some(Format::S16Le),
                    Element::F32 => Some(Format::F32Le),
                    _ => None,
                };
                match lie {
                    Some(format) => whole(array.bytes, format),
                    None => Some(Gathered::of(array.numbers().map(Some))?.samples(most_bytes)),
                }
            }
            Value::Numbers(all) => Some(all.samples(most_bytes)),
            Value::Text(text) => whole(BASE64.decode(text).ok()?.into(), format?),
            Value::Number(_) | Value::Other => None,
        }
    }

    /// The value as one number or several; a text gives none. Of an array that has more than `most`
    /// numbers not all are converted, but more than `most`, so that the caller can tell.
    pub fn floats(self, most: usize) -> Vec<f32> {
        match self {
            Value::Number(number) => vec![number.float() as f32],
            Value::Array(array) => array.numbers().take(most + 1).map(|x| x as f32).collect(),
            Value::Numbers(all) => {
                samples(&all.bytes, all.format).take(most + 1).map(|x| x as f32).collect()
            }
            Value::Text(_) | Value::Other => Vec::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_stay_int16_until_one_is_not() {
        let whole = [1.0, -32768.0, 32767.0];
        let gathered = |numbers: &[f64], most: u64| {
            Gathered::of(numbers.iter().copied().map(Some)).unwrap().samples(most)
        };
        let all = gathered(&whole, 100);
        assert_eq!((all.format, all.bytes.len(), all.too_many), (Format::S16Le, 6, false));
        let odd = [1.0, -32768.0, 32767.0, 0.5, f64::NAN];
        let all = gathered(&odd, 20);
        assert_eq!((all.format, all.bytes.len(), all.too_many), (Format::F32Le, 20, false));
        let floats: Vec<f64> = samples(&all.bytes, all.format).collect();
        assert_eq!(floats[..4], odd[..4]);
        assert!(floats[4].is_nan());
        assert!(gathered(&odd, 19).too_many);
        assert!(Gathered::of([Some(1.0), None].into_iter()).is_none());
    }

    /// By hand: 1.5 as f32 is 3f c0 00 00.
    #[test]
    fn elements_are_read_in_both_orders() {
        let read = |element: Element, bytes: &[u8], big| element.read(bytes, big);
        assert_eq!(read(Element::I16, &[0xfe, 0xff], false), Some(Number::Integer(-2)));
        assert_eq!(read(Element::U16, &[1, 2], true), Some(Number::Integer(258)));
        assert_eq!(read(Element::F32, &[0x3f, 0xc0, 0, 0], true), Some(Number::Float(1.5)));
        assert_eq!(read(Element::U64, &[0xff; 8], false), Some(Number::Integer(u64::MAX.into())));
        assert_eq!(read(Element::I8, &[0x80], false), Some(Number::Integer(-128)));
        assert_eq!(read(Element::F64, &[0; 7], false), None);
    }
}
