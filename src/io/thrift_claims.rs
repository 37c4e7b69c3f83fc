//! How much the headers of a Parquet file claim, Thrift structures in the compact protocol.
//!
//! In: a structure's bytes, from its beginning. Out: whether it claims no more than there may be. The Parquet reader
//! believes what is claimed: it makes room for all of it, or counts as many elements that take no byte, before it reads
//! on (found by fuzzing; parquet 59). Whatever else is wrong with the bytes, it says itself.

use std::io::{self, Read};

/// Structures within structures that are followed; the reader refuses more.
const MOST_DEPTH: u8 = 64;

/// Elements in the lists of a page's header: there are none so far.
const MOST_OF_A_PAGE: u64 = 64;

/// Why a structure was not followed to its end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    /// More is claimed than may be.
    Beyond,
    /// The bytes end, or are no such structure.
    Unread,
}

/// A file's metadata, so many bytes: what its lists claim together takes at least a byte each.
pub fn footer(metadata: impl Read, bytes: u64) -> Result<(), Stop> {
    Walk::new(metadata, bytes).structure(0)
}

/// A page's header: a dictionary has no more values than bytes. How far it is from its beginning to the next header's.
pub fn page(header: impl Read) -> Result<u64, Stop> {
    let mut walk = Walk::new(header, MOST_OF_A_PAGE);
    walk.structure(0)?;
    match walk.dictionary_values <= walk.page_bytes {
        true => Ok(walk.read.saturating_add(walk.stored_bytes)),
        false => Err(Stop::Beyond),
    }
}

struct Walk<R> {
    bytes: R,
    /// Elements that lists, sets and maps may still claim.
    left: u64,
    /// Numbers of the fields that lead here.
    path: Vec<u64>,
    /// Bytes so far.
    read: u64,
    /// Of a page's header: bytes of the page, uncompressed and as they are stored, and values of a dictionary. 0 if
    /// it says nothing.
    page_bytes: u64,
    stored_bytes: u64,
    dictionary_values: u64,
}

impl<R: Read> Walk<R> {
    fn new(bytes: R, left: u64) -> Walk<R> {
        let path = Vec::new();
        Walk { bytes, left, path, read: 0, page_bytes: 0, stored_bytes: 0, dictionary_values: 0 }
    }

    fn structure(&mut self, depth: u8) -> Result<(), Stop> {
        if depth > MOST_DEPTH {
            return Err(Stop::Unread);
        }
        let mut field = 0;
        loop {
            let head = self.byte()?;
            if head == 0 {
                return Ok(());
            }
            field = match head >> 4 {
                0 => zigzag(self.number()?), // where it is not one of the next
                on => field.wrapping_add(on.into()),
            };
            self.path.push(field);
            match head & 0xf {
                1 | 2 => {} // a boolean is its type
                kind => self.value(kind, depth)?,
            }
            self.path.pop();
        }
    }

    fn value(&mut self, kind: u8, depth: u8) -> Result<(), Stop> {
        match kind {
            3 => self.byte().map(drop),
            4..=6 => {
                let number = zigzag(self.number()?);
                match self.path[..] {
                    [2] => self.page_bytes = number,
                    [3] => self.stored_bytes = number,
                    [7, 1] => self.dictionary_values = number,
                    _ => {}
                }
                Ok(())
            }
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
        self.read += 1;
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
            Ok(passed) if passed == bytes => {
                self.read += passed;
                Ok(())
            }
            _ => Err(Stop::Unread),
        }
    }
}

/// Of a signed number as it is written; one below 0 is larger than any that may be.
fn zigzag(written: u64) -> u64 {
    (written >> 1) ^ (written & 1).wrapping_neg()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_there_may_be_claimed_and_no_more() {
        // field 1: a list of three numbers; field 2: text; field 3: a structure of nothing; the end
        let honest = [0x19, 0x35, 2, 4, 6, 0x18, 2, b'a', b'b', 0x1c, 0, 0];
        assert_eq!(footer(&honest[..], 3), Ok(()));
        assert_eq!(footer(&honest[..], 2), Err(Stop::Beyond), "all lists together");
        for end in 0..honest.len() {
            assert_eq!(footer(&honest[..end], 3), Err(Stop::Unread), "cut short");
        }
        // a list of 2^31 - 1: of numbers, of structures; a set; a map
        for kind in [0x19, 0x1a] {
            for of in [0xf5, 0xfc] {
                let claims = [kind, of, 0xff, 0xff, 0xff, 0xff, 7, 0];
                assert_eq!(footer(&claims[..], 1 << 20), Err(Stop::Beyond));
            }
        }
        let map = [0x1b, 0xff, 0xff, 0xff, 0xff, 7, 0x55, 0];
        assert_eq!(footer(&map[..], 1 << 20), Err(Stop::Beyond));
        // two booleans take no byte
        assert_eq!(footer(&[0x19, 0x21, 0, 0, 0][..], 1 << 20), Err(Stop::Beyond));
        // lists in lists, structures in structures
        assert_eq!(footer(&[0x19].repeat(1000)[..], 1 << 20), Err(Stop::Beyond));
        assert_eq!(footer(&[0x1c].repeat(1000)[..], 1 << 20), Err(Stop::Unread));
    }

    #[test]
    fn a_dictionary_has_no_more_values_than_bytes_and_a_page_ends_where_the_next_begins() {
        // 16 bytes, stored as 9; 15, 17 and -1 values
        let header = |values| [0x25, 32, 0x15, 18, 0x4c, 0x15, values, 0, 0];
        assert_eq!(page(&header(30)[..]), Ok(9 + 9));
        assert_eq!(page(&header(34)[..]), Err(Stop::Beyond));
        assert_eq!(page(&header(1)[..]), Err(Stop::Beyond));
    }
}
