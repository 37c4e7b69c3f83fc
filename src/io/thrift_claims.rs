//! How much a Thrift structure (compact protocol) claims to hold.
//!
//! In: its bytes, from its beginning. Out: whether its lists claim no more elements than they may. The Parquet reader
//! believes what they claim: it makes room for all of them, or counts as many that take no byte, before it reads on
//! (found by fuzzing; parquet 59). Whatever else is wrong with the bytes, it says itself.

use std::io::{self, Read};

/// Structures within structures that are followed; the reader refuses more.
const MOST_DEPTH: u8 = 64;

/// Whether all lists, sets and maps together claim at most `most` elements, none of them booleans, as which Parquet has none.
pub fn are_within(bytes: impl Read, most: u64) -> bool {
    let mut walk = Walk { bytes, left: most };
    !matches!(walk.structure(0), Err(Stop::Beyond))
}

struct Walk<R> {
    bytes: R,
    /// Elements that may still be claimed.
    left: u64,
}

enum Stop {
    /// More is claimed than may be.
    Beyond,
    /// The bytes end, or are no such structure.
    Unread,
}

impl<R: Read> Walk<R> {
    fn structure(&mut self, depth: u8) -> Result<(), Stop> {
        if depth > MOST_DEPTH {
            return Err(Stop::Unread);
        }
        loop {
            let head = self.byte()?;
            if head == 0 {
                return Ok(());
            }
            if head >> 4 == 0 {
                self.number()?; // the field's own number, where it is not the next
            }
            match head & 0xf {
                1 | 2 => {} // a boolean is its type
                kind => self.value(kind, depth)?,
            }
        }
    }

    fn value(&mut self, kind: u8, depth: u8) -> Result<(), Stop> {
        match kind {
            3 => self.byte().map(drop),
            4..=6 => self.number().map(drop),
            7 => self.pass(8),
            8 => {
                let bytes = self.number()?;
                self.pass(bytes)
            }
            9 | 10 => {
                let head = self.byte()?;
                let elements = match head >> 4 {
                    15 => self.number()?,
                    few => few.into(),
                };
                self.elements(elements, &[head & 0xf], depth)
            }
            11 => match self.number()? {
                0 => Ok(()),
                elements => {
                    let kinds = self.byte()?;
                    self.elements(elements, &[kinds >> 4, kinds & 0xf], depth)
                }
            },
            12 => self.structure(depth + 1),
            13 => self.pass(16),
            _ => Err(Stop::Unread),
        }
    }

    fn elements(&mut self, number: u64, kinds: &[u8], depth: u8) -> Result<(), Stop> {
        let booleans = kinds.iter().any(|kind| matches!(kind, 1 | 2));
        if number > 0 && (booleans || depth >= MOST_DEPTH) {
            return Err(Stop::Beyond);
        }
        self.left = self.left.checked_sub(number).ok_or(Stop::Beyond)?;
        for _ in 0..number {
            for &kind in kinds {
                self.value(kind, depth + 1)?;
            }
        }
        Ok(())
    }

    fn byte(&mut self) -> Result<u8, Stop> {
        let mut byte = [0];
        self.bytes.read_exact(&mut byte).map_err(|_| Stop::Unread)?;
        Ok(byte[0])
    }

    /// Seven bits a byte, the lowest first.
    fn number(&mut self) -> Result<u64, Stop> {
        let mut number = 0;
        for place in 0..10 {
            let byte = self.byte()?;
            number |= u64::from(byte & 0x7f) << (7 * place);
            if byte < 0x80 {
                return Ok(number);
            }
        }
        Err(Stop::Unread)
    }

    fn pass(&mut self, bytes: u64) -> Result<(), Stop> {
        match io::copy(&mut self.bytes.by_ref().take(bytes), &mut io::sink()) {
            Ok(passed) if passed == bytes => Ok(()),
            _ => Err(Stop::Unread),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_there_may_be_claimed_and_no_more() {
        // field 1: a list of three numbers; field 2: text; field 3: a structure of nothing; the end
        let honest = [0x19, 0x35, 2, 4, 6, 0x18, 2, b'a', b'b', 0x1c, 0, 0];
        assert!(are_within(&honest[..], 3));
        assert!(!are_within(&honest[..], 2), "all lists together");
        for end in 0..honest.len() {
            assert!(are_within(&honest[..end], 3), "cut short: the reader says so");
        }
        // a list of 2^31 - 1: of numbers, of structures; a set; a map
        for kind in [0x19, 0x1a] {
            for of in [0xf5, 0xfc] {
                assert!(!are_within(&[kind, of, 0xff, 0xff, 0xff, 0xff, 7, 0][..], 1 << 20));
            }
        }
        assert!(!are_within(&[0x1b, 0xff, 0xff, 0xff, 0xff, 7, 0x55, 0][..], 1 << 20));
        // two booleans take no byte
        assert!(!are_within(&[0x19, 0x21, 0, 0, 0][..], 1 << 20));
        // a list in a list in a list, and so on
        assert!(!are_within(&[0x19].repeat(1000)[..], 1 << 20));
        assert!(are_within(&[0x1c].repeat(1000)[..], 1 << 20), "the reader refuses it");
    }
}
