//! The values that were found in a message, before they are a burst: numbers, texts, arrays and
//! samples, the same for all encodings.
//!
//! The walks of `protobuf.rs`, `ros.rs` and `json.rs` fill [`SlotValues`]; `decoder.rs` takes the
//! values out, slot by slot. Samples stay where they lie in the message if their bytes are what a
//! burst needs (int16 or float32, little-endian, or bytes whose format the dialect says); otherwise
//! they are gathered number by number ([`Gathered`]), up to a bound.

use super::wanted::Slot;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use bytes::Bytes;
use inkling_core::burst::Format;
use std::collections::BTreeMap;

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
    pub const NAMED: [(Element, &'static str, &'static str); 10] = [
        (Element::I8, "i1", "int8"),
        (Element::U8, "u1", "uint8"),
        (Element::I16, "i2", "int16"),
        (Element::U16, "u2", "uint16"),
        (Element::I32, "i4", "int32"),
        (Element::U32, "u4", "uint32"),
        (Element::I64, "i8", "int64"),
        (Element::U64, "u8", "uint64"),
        (Element::F32, "f4", "float32"),
        (Element::F64, "f8", "float64"),
    ];

    pub fn bytes(self) -> usize {
        match self {
            Element::I8 | Element::U8 => 1,
            Element::I16 | Element::U16 => 2,
            Element::I32 | Element::U32 | Element::F32 => 4,
            Element::I64 | Element::U64 | Element::F64 => 8,
        }
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

impl Number {
    pub fn parse(text: &str) -> Option<Number> {
        let whole = text.parse().map(Number::Integer);
        whole.or_else(|_| text.parse().map(Number::Float)).ok()
    }

    /// The number as f64; whole numbers of more than 53 bits are rounded.
    pub fn float(self) -> f64 {
        match self {
            Number::Integer(i) => i as f64,
            Number::Float(x) => x,
        }
    }

    /// The number as a whole number; `None` where it has a fraction, or is a float of magnitude
    /// 1e18 or more, where f64 is far from exact.
    pub fn integer(self) -> Option<i128> {
        match self {
            Number::Integer(i) => Some(i),
            Number::Float(x) => (x.fract() == 0.0 && x.abs() < 1e18).then_some(x as i128),
        }
    }
}

/// Samples that are gathered number by number. They are kept as int16 as long as all numbers are int16, and
/// become float32 with the first one that is not, because a burst has one format.
#[derive(Clone, Debug)]
pub struct Gathered {
    pub bytes: Vec<u8>,
    pub format: Format,
    most_bytes: usize,
    /// Whether there were more numbers than the bound allows. Those are not kept.
    pub too_many: bool,
}

impl Gathered {
    pub fn new(most_bytes: u64) -> Gathered {
        let most_bytes = usize::try_from(most_bytes).unwrap_or(usize::MAX);
        Gathered { bytes: Vec::new(), format: Format::S16Le, most_bytes, too_many: false }
    }

    /// Adds a number. One that is beyond the bound is not kept, and neither is any after it.
    pub fn push(&mut self, x: f64) {
        if self.too_many || self.bytes.len() + self.format.bytes() > self.most_bytes {
            self.too_many = true;
            return;
        }
        if self.format == Format::S16Le {
            let whole = x as i16;
            if f64::from(whole) == x {
                return self.bytes.extend(whole.to_le_bytes());
            }
            // the first number that is no int16: all that was gathered becomes float32, in twice
            // the bytes
            if self.bytes.len() * 2 + 4 > self.most_bytes {
                self.too_many = true;
                return;
            }
            self.bytes = self.floats().flat_map(f32::to_le_bytes).collect();
            self.format = Format::F32Le;
        }
        self.bytes.extend((x as f32).to_le_bytes());
    }

    fn floats(&self) -> impl Iterator<Item = f32> {
        samples(&self.bytes, self.format).map(|x| x as f32)
    }
}

pub fn samples(of: &[u8], format: Format) -> impl Iterator<Item = f64> {
    let element = match format {
        Format::S16Le => Element::I16,
        Format::F32Le => Element::F32,
    };
    element.numbers(of, false)
}

/// Why nothing could be read from a message.
#[derive(Debug)]
pub enum ReadError {
    /// The message is not what its schema says, or it is no JSON. It becomes a rejected row.
    Malformed,
    /// A field of a JSON message is not what the dialect says.
    Unfit(String),
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

    fn gathered(&self, most_bytes: u64) -> Gathered {
        let mut all = Gathered::new(most_bytes);
        self.numbers().for_each(|x| all.push(x));
        all
    }
}

#[derive(Clone, Debug)]
pub enum Value {
    Number(Number),
    Text(String),
    Array(Array),
    Gathered(Gathered),
}

/// The values that a message has for the slots of a dialect. If a slot's path occurs several times in the
/// message, the last value counts, as in protobuf; parts of an array are joined, because protobuf may write
/// an array in parts.
#[derive(Debug, Default)]
pub struct SlotValues {
    values: BTreeMap<Slot, Value>,
    /// Bound on the bytes of samples that are gathered.
    most_bytes: u64,
}

impl SlotValues {
    pub fn new(most_bytes: u64) -> SlotValues {
        SlotValues { values: BTreeMap::new(), most_bytes }
    }

    pub fn set(&mut self, slot: Slot, value: Value) {
        self.values.insert(slot, value);
    }

    pub fn take(&mut self, slot: Slot) -> Option<Value> {
        self.values.remove(&slot)
    }

    pub fn number(&mut self, slot: Slot) -> Option<Number> {
        self.take(slot)?.number()
    }

    /// Takes the numbers that a slot has so far, to be added to and set again.
    pub fn gathered(&mut self, slot: Slot) -> Gathered {
        match self.take(slot) {
            Some(Value::Gathered(all)) => all,
            Some(Value::Array(array)) => array.gathered(self.most_bytes),
            _ => Gathered::new(self.most_bytes),
        }
    }

    pub fn append(&mut self, slot: Slot, array: Array) {
        let value = match self.values.contains_key(&slot) {
            false => Value::Array(array),
            true => {
                let mut all = self.gathered(slot);
                array.numbers().for_each(|x| all.push(x));
                Value::Gathered(all)
            }
        };
        self.set(slot, value);
    }
}

pub fn is_base64(text: &str) -> bool {
    BASE64.decode(text).is_ok()
}

pub struct Samples {
    pub bytes: Bytes,
    pub format: Format,
    pub too_many: bool,
}

impl Value {
    /// The value as a number. A text counts if it is one, because JSON has integers of 64 bits and
    /// not-a-number as text.
    pub fn number(&self) -> Option<Number> {
        match self {
            Value::Number(number) => Some(*number),
            Value::Text(text) => Number::parse(text),
            Value::Array(_) | Value::Gathered(_) => None,
        }
    }

    /// The value as samples, not copied where they lie in the message as a burst has them. `format`
    /// is that of bytes or base64 text; `None`: bytes are numbers of one byte each.
    pub fn samples(self, format: Option<Format>, most_bytes: u64) -> Option<Samples> {
        let whole = |bytes: Bytes, format| {
            let too_many = bytes.len() as u64 > most_bytes;
            Some(Samples { bytes, format, too_many })
        };
        let all = match self {
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
                    Some(format) => return whole(array.bytes, format),
                    None => array.gathered(most_bytes),
                }
            }
            Value::Gathered(all) => all,
            Value::Text(text) => return whole(BASE64.decode(text).ok()?.into(), format?),
            Value::Number(_) => return None,
        };
        Some(Samples { bytes: all.bytes.into(), format: all.format, too_many: all.too_many })
    }

    /// The value as one number or several; a text gives none. Of an array that has more than `most`
    /// numbers not all are converted, but more than `most`, so that the caller can tell. Numbers
    /// that were gathered come all.
    pub fn floats(self, most: usize) -> Vec<f32> {
        match self {
            Value::Number(number) => vec![number.float() as f32],
            Value::Array(array) => array.gathered((most as u64 + 1) * 4).floats().collect(),
            Value::Gathered(all) => all.floats().collect(),
            Value::Text(_) => Vec::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_stay_int16_until_one_is_not() {
        let mut all = Gathered::new(100);
        [1.0, -32768.0, 32767.0].into_iter().for_each(|x| all.push(x));
        assert_eq!((all.format, all.bytes.len()), (Format::S16Le, 6));
        all.push(0.5);
        all.push(f64::NAN);
        assert_eq!((all.format, all.bytes.len()), (Format::F32Le, 20));
        let floats: Vec<f32> = all.floats().collect();
        assert_eq!(floats[..4], [1.0, -32768.0, 32767.0, 0.5]);
        assert!(floats[4].is_nan());
        (0..100).for_each(|_| all.push(0.5));
        assert!(all.too_many && all.bytes.len() == 100);
        assert_eq!(Gathered::new(0).floats().count(), 0);
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
