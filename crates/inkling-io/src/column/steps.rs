//! Encodes a required column of whole numbers that mostly go on by equal steps: times and channels.
//!
//! In: `start`, `step`, `rows`, by [`StepColumn::push`]. Out: one page in DELTA_BINARY_PACKED: the first
//! number, then the differences from each number to the next, in blocks of 128. A block is its
//! least difference, then four widths in bits, then four parts of 32 numbers: how far each
//! difference lies above the least one, packed in its part's width. In a block of equal steps all
//! lie 0 above, which takes no bits, so the block takes a few bytes.

use super::hybrid::{pack, put_number};
use super::pages::{ClosedPage, ColumnPages};
use parquet::basic::{Encoding, Type};
use parquet::errors::Result;
use parquet::file::statistics::Statistics;
use parquet::schema::types::ColumnDescPtr;

const BLOCK: usize = 128;
/// Parts of a block; each has its own width of bits.
const PARTS: usize = 4;

#[derive(Debug)]
pub struct StepColumn {
    column: ColumnDescPtr,
    first: i64,
    last: i64,
    span: (i64, i64),
    /// Differences that wait until they are a block.
    block: Vec<i64>,
    blocks: Vec<u8>,
    rows: u32,
}

impl StepColumn {
    pub fn new(column: ColumnDescPtr) -> StepColumn {
        let (block, blocks) = (Vec::with_capacity(BLOCK), Vec::new());
        StepColumn { column, first: 0, last: 0, span: (i64::MAX, i64::MIN), block, blocks, rows: 0 }
    }

    /// The next `rows` rows: `start`, `start` + `step`, and so on.
    pub fn push(&mut self, start: i64, step: i64, rows: usize) {
        let Some(more) = rows.checked_sub(1) else { return };
        // numbers between the ends of a run lie between them, so the ends suffice for the span
        let last = start.wrapping_add(step.wrapping_mul(more as i64));
        self.span = (self.span.0.min(start).min(last), self.span.1.max(start).max(last));
        match self.rows {
            0 => self.first = start,
            _ => {
                self.block.push(start.wrapping_sub(self.last));
                self.end_full_block();
            }
        }
        self.last = last;
        self.rows += rows as u32; // rows of a row group at most

        let mut left = more;
        while left > 0 {
            let some = left.min(BLOCK - self.block.len());
            self.block.resize(self.block.len() + some, step);
            self.end_full_block();
            left -= some;
        }
    }

    pub fn memory(&self) -> usize {
        self.blocks.len()
    }

    /// Encodes the chunk: a header (differences in a block, parts of a block, number of rows, first
    /// number), then the blocks.
    pub fn close(mut self) -> Result<ColumnPages> {
        if !self.block.is_empty() {
            let block = std::mem::take(&mut self.block);
            self.end_block_of(&block);
        }
        let encode = |out: &mut Vec<u8>| {
            let first = zigzag(self.stored(self.first));
            for number in [BLOCK as u64, PARTS as u64, self.rows.into(), first] {
                put_number(number, out);
            }
            out.extend(&self.blocks);
        };
        let (least, most) = (Some(self.span.0), Some(self.span.1));
        let narrow = |value: Option<i64>| value.map(|value| value as u32 as i32);
        let statistics = match self.is_wide() {
            true => Statistics::int64(least, most, None, Some(0), false),
            false => Statistics::int32(narrow(least), narrow(most), None, Some(0), false),
        };
        Ok(ColumnPages {
            dictionary: None,
            pages: vec![ClosedPage::new(None, encode, self.rows)?],
            encoding: Encoding::DELTA_BINARY_PACKED,
            statistics: Some(statistics),
            column: self.column,
        })
    }

    fn is_wide(&self) -> bool {
        self.column.physical_type() == Type::INT64
    }

    /// A number as the column's type stores it: in an INT32 column numbers above `i32::MAX` wrap
    /// around to negative ones (the type's annotation says "without sign").
    fn stored(&self, value: i64) -> i64 {
        if self.is_wide() { value } else { i64::from(value as i32) }
    }

    fn end_full_block(&mut self) {
        if self.block.len() == BLOCK {
            let mut block = std::mem::take(&mut self.block);
            self.end_block_of(&block);
            block.clear();
            self.block = block;
        }
    }

    /// Encodes a block. Only the last block of a column may have fewer than `BLOCK` differences.
    fn end_block_of(&mut self, differences: &[i64]) {
        let wide = self.is_wide();
        let stored = |d: i64| if wide { d } else { i64::from(d as i32) };
        let least = differences.iter().map(|d| stored(*d)).min().unwrap_or_default();
        let above = |d: &i64| {
            let above = stored(*d).wrapping_sub(least) as u64;
            if wide { above } else { u64::from(above as u32) }
        };

        put_number(zigzag(least), &mut self.blocks);
        let parts = || differences.chunks(BLOCK / PARTS);
        let width = |part: &[i64]| {
            let most = part.iter().map(above).fold(0, |all, above| all | above);
            (u64::BITS - most.leading_zeros()) as u8
        };
        // a part without differences keeps the width 0
        let mut widths = [0; PARTS];
        widths.iter_mut().zip(parts()).for_each(|(w, part)| *w = width(part));
        self.blocks.extend(widths);

        for (part, width) in parts().zip(widths) {
            // a part that is not full is filled up with zeros; one without differences is left out
            let end = self.blocks.len() + BLOCK / PARTS * usize::from(width) / 8;
            pack(part.iter().map(above), width, &mut self.blocks);
            self.blocks.resize(end, 0);
        }
    }
}

/// Maps signed numbers to numbers without sign, 0, −1, 1, −2 to 0, 1, 2, 3, so that those of small
/// magnitude stay short.
fn zigzag(number: i64) -> u64 {
    ((number << 1) ^ (number >> 63)) as u64
}
