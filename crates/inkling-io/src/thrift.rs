//! Walks records of Apache Thrift's compact protocol without building anything from them. Parquet's
//! footer and page headers are such records; `parquet_claims.rs` uses this to check them.
//!
//! In: the bytes of a record, and what each field is known to hold ([`Shape`]). Out: whether the
//! fields hold that, and a few numbers that are asked for ([`Walk::wanted`]). Bounds: all lists, sets
//! and maps together may claim only so many elements, and records may be nested only so deep.
//!
//! The parquet crate takes the type of a field that it knows as given, whatever the bytes declare.
//! So a field that declares another type, comes twice or out of order is refused here; otherwise
//! the crate and this walk could read different things.
//!
//! The protocol: a field is a byte with its distance from the field before (4 bits) and its type (4
//! bits), then its value. Types: 1 true, 2 false, 3 byte, 4 to 6 whole numbers, 7 double, 8 bytes,
//! 9 list, 10 set, 11 map, 12 record, 13 UUID.

use std::io::{self, Read};

/// Most levels that are followed: records, and the lists, sets and maps around them.
const MOST_DEPTH: u8 = 64;

const MOST_WANTED: usize = 4;

/// What a field of a record, or an element of a list, is known to hold.
#[derive(Debug)]
pub enum Shape {
    Flag,
    Byte,
    Number,
    /// A number that is asked for, with its place in [`Walk::wanted`]. It must be 0 to 2^31 − 1 and
    /// come at most once.
    Wanted(usize),
    Double,
    Bytes,
    List(&'static Shape),
    /// A record with its fields; the first has the number 1. Fields with other numbers may be of
    /// any type.
    Record(&'static [Shape]),
}

impl Shape {
    /// Whether the type `kind` that the bytes declare is that of the shape.
    fn declared(&self, kind: u8) -> bool {
        match self {
            Shape::Flag => matches!(kind, 1 | 2),
            Shape::Byte => kind == 3,
            Shape::Number | Shape::Wanted(_) => matches!(kind, 4..=6),
            Shape::Double => kind == 7,
            Shape::Bytes => kind == 8,
            Shape::List(_) => kind == 9,
            Shape::Record(_) => kind == 12,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ThriftError {
    /// More is claimed than may be: more elements, lists or maps nested too deep, flags in a list
    /// (which could claim any number), or a wanted number that is negative or above 2^31 − 1.
    ClaimsTooMuch,
    /// The bytes end, or are no such record: a field has another type than is known, fields are out
    /// of order, a field or a wanted number comes twice, or records are nested too deep.
    Malformed,
}

pub struct Walk<R> {
    bytes: R,
    /// Elements that lists, sets and maps together may still claim.
    left: u64,
    /// Bytes that were read.
    pub read: u64,
    /// The numbers that are asked for ([`Shape`]), by their places, as far as they were met.
    pub wanted: [Option<u32>; MOST_WANTED],
}

impl<R: Read> Walk<R> {
    pub fn new(bytes: R, elements: u64) -> Walk<R> {
        Walk { bytes, left: elements, read: 0, wanted: [None; MOST_WANTED] }
    }

    /// Walks the fields of a record. A byte begins each; a distance of 0 in it means that the
    /// field's number follows. A byte of 0 ends the record.
    pub fn fields(&mut self, shapes: &'static [Shape], depth: u8) -> Result<(), ThriftError> {
        if depth > MOST_DEPTH {
            return Err(ThriftError::Malformed);
        }
        let mut last = 0;
        loop {
            let head = self.byte()?;
            if head == 0 {
                return Ok(());
            }
            let field = match head >> 4 {
                0 => i16::try_from(zigzag(self.number()?)).map_err(|_| ThriftError::Malformed)?,
                on => i16::checked_add(last, on.into()).ok_or(ThriftError::Malformed)?,
            };
            // Numbers must increase, so that no field comes twice, which could be read differently.
            if field <= last {
                return Err(ThriftError::Malformed);
            }
            last = field;
            match head & 0xf {
                // a flag has its value in the type; a type that does not fit is refused in `value`
                1 | 2 if shapes.get(field as usize - 1).is_none_or(|s| s.declared(1)) => {}
                kind => self.value(kind, shapes.get(field as usize - 1), depth)?,
            }
        }
    }

    fn value(
        &mut self,
        kind: u8,
        shape: Option<&'static Shape>,
        depth: u8,
    ) -> Result<(), ThriftError> {
        if shape.is_some_and(|shape| !shape.declared(kind)) {
            return Err(ThriftError::Malformed);
        }
        match (kind, shape) {
            (3, _) => self.byte().map(drop),
            (4..=6, Some(&Shape::Wanted(place))) => self.keep(place),
            (4..=6, _) => self.number().map(drop),
            (7, _) => self.pass(8),
            (8, _) => {
                let bytes = self.number()?;
                self.pass(bytes)
            }
            (9 | 10, Some(Shape::List(of))) => self.list(Some(of), depth),
            (9 | 10, _) => self.list(None, depth),
            (11, _) => self.map(depth),
            (12, Some(Shape::Record(fields))) => self.fields(fields, depth + 1),
            (12, _) => self.fields(&[], depth + 1),
            (13, _) => self.pass(16),
            _ => Err(ThriftError::Malformed),
        }
    }

    fn keep(&mut self, place: usize) -> Result<(), ThriftError> {
        let number =
            i32::try_from(zigzag(self.number()?)).map_err(|_| ThriftError::ClaimsTooMuch)?;
        let number = u32::try_from(number).map_err(|_| ThriftError::ClaimsTooMuch)?;
        match self.wanted[place].replace(number) {
            None => Ok(()),
            Some(_) => Err(ThriftError::Malformed),
        }
    }

    /// Walks a list or a set. Its first byte has the number of elements (4 bits; 15: the number
    /// follows) and their type (4 bits). `of`: what the elements are known to hold.
    fn list(&mut self, of: Option<&'static Shape>, depth: u8) -> Result<(), ThriftError> {
        let head = self.byte()?;
        let elements = match head >> 4 {
            _ if head == 0 => return Ok(()), // of nothing, of no type
            15 => self.number()?,
            few => few.into(),
        };
        self.elements(elements, &[(head & 0xf, of)], depth)
    }

    /// Walks a map, which only fields that are not known can be.
    fn map(&mut self, depth: u8) -> Result<(), ThriftError> {
        match self.number()? {
            0 => Ok(()),
            elements => {
                let kinds = self.byte()?;
                self.elements(elements, &[(kinds >> 4, None), (kinds & 0xf, None)], depth)
            }
        }
    }

    /// Walks `number` elements of a list (one kind), or keys and values of a map (two kinds in
    /// turns). A kind is the type and what is known of it.
    fn elements(
        &mut self,
        number: u64,
        kinds: &[(u8, Option<&'static Shape>)],
        depth: u8,
    ) -> Result<(), ThriftError> {
        // The parquet crate skips a flag in a list without reading a byte (the protocol has one),
        // so any number of flags could be claimed: such lists are refused.
        let flags = kinds.iter().any(|(kind, _)| matches!(kind, 1 | 2));
        if number > 0 && (flags || depth >= MOST_DEPTH) {
            return Err(ThriftError::ClaimsTooMuch);
        }
        self.left = self.left.checked_sub(number).ok_or(ThriftError::ClaimsTooMuch)?;
        for _ in 0..number {
            for &(kind, shape) in kinds {
                self.value(kind, shape, depth + 1)?;
            }
        }
        Ok(())
    }

    fn byte(&mut self) -> Result<u8, ThriftError> {
        let mut byte = [0];
        self.bytes.read_exact(&mut byte).map_err(|_| ThriftError::Malformed)?;
        self.read += 1;
        Ok(byte[0])
    }

    /// Reads a whole number (ULEB128: seven bits a byte, the lowest first).
    fn number(&mut self) -> Result<u64, ThriftError> {
        let mut number = 0;
        for place in 0..10 {
            let byte = self.byte()?;
            number |= u64::from(byte & 0x7f) << (7 * place);
            if byte < 0x80 {
                return Ok(number);
            }
        }
        Err(ThriftError::Malformed)
    }

    /// A false length costs no memory: passing ends, with an error, where the bytes do.
    fn pass(&mut self, bytes: u64) -> Result<(), ThriftError> {
        match io::copy(&mut self.bytes.by_ref().take(bytes), &mut io::sink()) {
            Ok(passed) if passed == bytes => {
                self.read += passed;
                Ok(())
            }
            _ => Err(ThriftError::Malformed),
        }
    }
}

/// The signed number that is stored as `written`: 0, −1, 1, −2 are stored as 0, 1, 2, 3.
pub fn zigzag(written: u64) -> i64 {
    (written >> 1) as i64 ^ -((written & 1) as i64)
}

#[cfg(test)]
mod tests {
    use super::ThriftError::{ClaimsTooMuch, Malformed};
    use super::*;

    fn walk(bytes: &[u8], elements: u64, shapes: &'static [Shape]) -> Result<u64, ThriftError> {
        let mut walk = Walk::new(bytes, elements);
        walk.fields(shapes, 0).map(|()| walk.read)
    }

    #[test]
    fn what_is_there_may_be_claimed_and_no_more() {
        // field 1: a list of three numbers; field 2: text; field 3: a record of nothing; the end
        let honest = [0x19, 0x35, 2, 4, 6, 0x18, 2, b'a', b'b', 0x1c, 0, 0];
        assert_eq!(walk(&honest, 3, &[]), Ok(honest.len() as u64));
        assert_eq!(walk(&honest, 2, &[]), Err(ClaimsTooMuch), "all lists together");
        for end in 0..honest.len() {
            assert_eq!(walk(&honest[..end], 3, &[]), Err(Malformed), "cut short");
        }
        // of 2^31 - 1: a list and a set of numbers, the same of records, a map
        let claims = [[0x19, 0xf5], [0x1a, 0xf5], [0x19, 0xfc], [0x1a, 0xfc]];
        for [kind, of] in claims {
            let bytes = [kind, of, 0xff, 0xff, 0xff, 0xff, 7, 0];
            assert_eq!(walk(&bytes, 1 << 20, &[]), Err(ClaimsTooMuch), "{kind:x} of {of:x}");
        }
        let map = [0x1b, 0xff, 0xff, 0xff, 0xff, 7, 0x55, 0];
        assert_eq!(walk(&map, 1 << 20, &[]), Err(ClaimsTooMuch));
        // two booleans take no byte
        assert_eq!(walk(&[0x19, 0x21, 0, 0, 0], 1 << 20, &[]), Err(ClaimsTooMuch));
        // lists in lists, records in records
        assert_eq!(walk(&[0x19].repeat(1000), 1 << 20, &[]), Err(ClaimsTooMuch));
        assert_eq!(walk(&[0x1c].repeat(1000), 1 << 20, &[]), Err(Malformed));
    }

    #[test]
    fn a_field_declares_what_it_is_known_to_hold_and_comes_once_in_its_order() {
        const SHAPES: &[Shape] = &[
            Shape::Number,
            Shape::Flag,
            Shape::List(&Shape::Bytes),
            Shape::Record(&[Shape::Byte]),
        ];
        let honest = [0x15, 1, 0x11, 0x19, 0x18, 1, b'a', 0x1c, 0x13, 9, 0, 0];
        assert_eq!(walk(&honest, 9, SHAPES), Ok(12));
        // the same, each field by its whole number, and another one of any type
        let long = [5, 2, 1, 1, 4, 9, 6, 0x18, 1, b'a', 12, 8, 3, 2, 9, 0, 0x17];
        assert_eq!(walk(&[&long[..], &[0; 9]].concat(), 9, SHAPES), Ok(26));
        let others = [(0, 0x13), (0, 0x11), (2, 0x13), (3, 0x1a), (4, 0x15), (7, 0x18), (8, 0x15)];
        for (at, other) in others {
            let mut bytes = honest;
            bytes[at] = other;
            assert_eq!(walk(&bytes, 9, SHAPES), Err(Malformed), "{other:x} at {at}");
        }
        for (bytes, why) in [
            (&[0x25, 2, 5, 4, 0, 0][..], "field 2 twice"),
            (&[0x25, 2, 5, 2, 0, 0], "1 after 2"),
            (&[5, 0, 0, 0], "0"),
            (&[5, 0xfe, 0xff, 3, 0, 0x15, 0, 0], "2^15"),
            (&[0x10, 0, 0], "an end with a number"),
        ] {
            assert_eq!(walk(bytes, 9, &[]), Err(Malformed), "{why}");
        }
    }

    #[test]
    fn numbers_that_are_asked_for_are_told_where_they_fit() {
        const SHAPES: &[Shape] = &[Shape::Wanted(0), Shape::Wanted(1), Shape::Wanted(0)];
        let mut wanted = Walk::new(&[0x15, 0x80, 2, 0x15, 0, 0][..], 0);
        assert_eq!(wanted.fields(SHAPES, 0), Ok(()));
        assert_eq!([0, 1, 2].map(|place| wanted.wanted[place]), [Some(128), Some(0), None]);
        assert_eq!(walk(&[0x15, 1, 0], 0, SHAPES), Err(ClaimsTooMuch), "-1");
        let greater = [0x16, 0x80, 0x80, 0x80, 0x80, 0x10, 0];
        assert_eq!(walk(&greater, 0, SHAPES), Err(ClaimsTooMuch), "2^31");
        assert_eq!(walk(&[0x15, 2, 0x25, 2, 0], 0, SHAPES), Err(Malformed), "twice");
    }
}
