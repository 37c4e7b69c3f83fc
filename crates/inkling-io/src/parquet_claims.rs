//! Checks what a Parquet file claims of itself, in its footer and in the header of each page,
//! before the parquet crate reads it.
//!
//! In, from `parquet_file.rs`: the bytes of a footer or of a page's header (Thrift's compact
//! protocol, walked by `thrift.rs`). Out: whether they claim no more than there may be: all lists of
//! the footer together have at most as many elements as the footer has bytes, and those of a page's
//! header at most 64; a page has at most 32,768 times its stored bytes uncompressed, and a dictionary
//! no more values than bytes. There are no index pages. The walk refuses a wanted number that comes
//! twice, so three kinds of pages can share one place for their number of values.
//!
//! Why: the reader (parquet 59) makes room for all that is claimed, or counts elements that take no
//! bytes, before it reads on (found by fuzzing). It also takes the types of known fields as given,
//! so the types are written down here, as `parquet.thrift` has them.

use super::thrift::Shape::{Byte, Bytes, Double, Flag, List, Number, Record, Wanted};
use super::thrift::{Shape, ThriftError, Walk};
use std::io::Read;

/// Most elements in all lists of a page's header; the format has no lists there so far.
const MOST_OF_A_PAGE: u64 = 64;
/// Most bytes that a page may claim uncompressed for each stored byte. No compression that is read
/// makes more: zstd makes 128 KiB of one value from four bytes.
const MOST_OF_A_BYTE: u64 = 1 << 15;

/// Places, in the memory of a `Walk`, of the numbers that are wanted of a page's header: its kind,
/// its bytes uncompressed and as stored, its number of values.
const KIND: usize = 0;
const PLAIN_BYTES: usize = 1;
const STORED_BYTES: usize = 2;
const VALUES: usize = 3;
/// Kinds of pages, as `parquet.thrift` numbers them.
const INDEX_PAGE: u32 = 1;
const DICTIONARY_PAGE: u32 = 2;

/// The fields of `PageHeader`, in the order of their numbers. The reader skips statistics (fields
/// 5.5 and 8.8), so their types are not checked.
const PAGE: &[Shape] = &[
    Wanted(KIND),
    Wanted(PLAIN_BYTES),
    Wanted(STORED_BYTES),
    Number,
    Record(&[Wanted(VALUES), Number, Number, Number]),
    Record(&[]),
    Record(&[Wanted(VALUES), Number, Flag]),
    Record(&[Wanted(VALUES), Number, Number, Number, Number, Number, Flag]),
];

// The parts of the footer, each with the types of its fields in the order of their numbers.

const EMPTY: Shape = Record(&[]);
const NUMBERS: Shape = List(&Number);
const TEXTS: Shape = List(&Bytes);

/// `TimeType` and `TimestampType`.
const TIME: Shape = Record(&[Flag, Record(&[EMPTY, EMPTY, EMPTY])]);
const DECIMAL: Shape = Record(&[Number, Number]);
const INTEGER: Shape = Record(&[Byte, Flag]);
const VARIANT: Shape = Record(&[Byte]);
const GEOMETRY: Shape = Record(&[Bytes]);
const GEOGRAPHY: Shape = Record(&[Bytes, Number]);
/// `LogicalType`, a union: a record of which one field is set.
const LOGICAL_TYPE: Shape = Record(&[
    EMPTY, EMPTY, EMPTY, EMPTY, DECIMAL, EMPTY, TIME, TIME, EMPTY, INTEGER, EMPTY, EMPTY, EMPTY,
    EMPTY, EMPTY, VARIANT, GEOMETRY, GEOGRAPHY,
]);
const SCHEMA_ELEMENT: Shape =
    Record(&[Number, Number, Number, Bytes, Number, Number, Number, Number, Number, LOGICAL_TYPE]);

const KEY_VALUE: Shape = Record(&[Bytes, Bytes]);
const STATISTICS: Shape = Record(&[Bytes, Bytes, Number, Number, Bytes, Bytes, Flag, Flag]);
/// `PageEncodingStats` of each kind of page.
const PAGES: Shape = List(&Record(&[Number, Number, Number]));
/// `SizeStatistics`.
const SIZES: Shape = Record(&[Number, NUMBERS, NUMBERS]);
/// `BoundingBox` of geospatial statistics.
const BOX: Shape = Record(&[Double, Double, Double, Double, Double, Double, Double, Double]);
const GEO: Shape = Record(&[BOX, NUMBERS]);
const PAIRS: Shape = List(&KEY_VALUE);
/// `ColumnMetaData`.
const COLUMN: Shape = Record(&[
    Number, NUMBERS, TEXTS, Number, Number, Number, Number, PAIRS, Number, Number, Number,
    STATISTICS, PAGES, Number, Number, SIZES, GEO,
]);
const COLUMNS: Shape = List(&Record(&[Bytes, Number, COLUMN, Number, Number, Number, Number]));
const SORTING: Shape = List(&Record(&[Number, Flag, Flag]));
const ROW_GROUP: Shape = Record(&[COLUMNS, Number, Number, SORTING, Number, Number, Number]);
/// The fields of `FileMetaData`. Encrypted files are not read.
const FOOTER: &[Shape] = &[
    Number,
    List(&SCHEMA_ELEMENT),
    Number,
    List(&ROW_GROUP),
    PAIRS,
    Bytes,
    List(&Record(&[EMPTY])),
];

pub fn footer(metadata: impl Read, bytes: u64) -> Result<(), ThriftError> {
    Walk::new(metadata, bytes).fields(FOOTER, 0)
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Page {
    pub header_bytes: u64,
    /// Bytes of the page as it is stored, behind the header.
    pub stored_bytes: u64,
    /// Values in the page, nulls included.
    pub values: u64,
    pub is_dictionary: bool,
}

/// Reads and checks the header of a page. `compressed`: the page may be compressed.
pub fn page(header: impl Read, compressed: bool) -> Result<Page, ThriftError> {
    let mut walk = Walk::new(header, MOST_OF_A_PAGE);
    walk.fields(PAGE, 0)?;
    let wanted = |place: usize| walk.wanted[place].ok_or(ThriftError::Malformed);
    let (plain, stored) = (u64::from(wanted(PLAIN_BYTES)?), u64::from(wanted(STORED_BYTES)?));
    let page = Page {
        header_bytes: walk.read,
        stored_bytes: stored,
        values: wanted(VALUES)?.into(),
        is_dictionary: wanted(KIND)? == DICTIONARY_PAGE,
    };
    // nobody writes pages of indexes, and the reader does not always find their end
    if wanted(KIND)? == INDEX_PAGE {
        return Err(ThriftError::Malformed);
    }

    // values of a dictionary take a byte at least, except where compression shrinks them
    let held = if compressed { plain } else { plain.min(stored) };
    match plain <= stored * MOST_OF_A_BYTE && !(page.is_dictionary && page.values > held) {
        true => Ok(page),
        false => Err(ThriftError::ClaimsTooMuch),
    }
}

#[cfg(test)]
mod tests {
    use super::ThriftError::{ClaimsTooMuch, Malformed};
    use super::*;

    /// Of the kind, bytes plain and stored, and values; each below 64.
    fn header(kind: u8, plain: u8, stored: u8, values: u8) -> Vec<u8> {
        let body = match kind {
            2 => [0x4c, 0x15, 2 * values, 0x15, 0, 0, 0].to_vec(),
            _ => [0x2c, 0x15, 2 * values, 0x15, 0, 0x15, 0, 0x15, 0, 0, 0].to_vec(),
        };
        [&[0x15, 2 * kind, 0x15, 2 * plain, 0x15, 2 * stored], &body[..]].concat()
    }

    #[test]
    fn a_page_ends_where_the_next_begins_and_all_that_it_says_is_told() {
        let honest = header(0, 16, 9, 60);
        let data = Page { header_bytes: 17, stored_bytes: 9, values: 60, is_dictionary: false };
        assert_eq!(page(&honest[..], true), Ok(data));
        let read = page(&header(2, 16, 9, 16)[..], true).unwrap();
        assert_eq!((read.header_bytes, read.is_dictionary), (13, true));
        for end in 0..17 {
            assert_eq!(page(&honest[..end], true), Err(Malformed));
        }
        for left_out in [0, 2, 4] {
            let mut bytes = honest.clone();
            bytes.drain(left_out..left_out + 2);
            bytes[left_out] += 0x10;
            assert_eq!(page(&bytes[..], true), Err(Malformed), "without the field at {left_out}");
        }
        assert_eq!(page(&header(1, 16, 9, 16)[..], true), Err(Malformed), "an index");
    }

    #[test]
    fn a_dictionary_has_no_more_values_than_bytes() {
        assert_eq!(page(&header(2, 16, 9, 17)[..], true), Err(ClaimsTooMuch));
        assert!(page(&header(2, 16, 9, 9)[..], false).is_ok());
        assert_eq!(page(&header(2, 16, 9, 10)[..], false), Err(ClaimsTooMuch));
        assert!(page(&header(0, 16, 9, 63)[..], false).is_ok(), "values by runs");
    }

    #[test]
    fn a_byte_holds_no_more_than_compression_can_make_of_it() {
        assert!(page(&header(0, 0, 0, 1)[..], true).is_ok());
        assert_eq!(page(&header(0, 1, 0, 1)[..], true), Err(ClaimsTooMuch));
        let plain = |bytes: [u8; 3]| {
            let mut all = header(0, 0, 1, 1);
            all.splice(3..4, bytes);
            page(&all[..], true)
        };
        assert!(plain([0x80, 0x80, 4]).is_ok(), "32 768");
        assert_eq!(plain([0x82, 0x80, 4]), Err(ClaimsTooMuch), "32 769");
    }
}
