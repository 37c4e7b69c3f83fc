//! Encodes a nullable column of f32 that differ from row to row, or are mostly null: statistics,
//! misfits and the numbers of flagged signals.
//!
//! In: slices of f32, where NaN is null, and counts of nulls. Out: pages of some 65,536 rows. A
//! page has first the definition levels (one bit for each row: whether it has a value; coded by
//! `hybrid.rs`), then the values of the rows that have one. The encoding of values is
//! BYTE_STREAM_SPLIT (the first bytes of all values, then all second bytes, and so on: bytes of one
//! significance resemble each other, so they compress well), or PLAIN for readers that do not know
//! it.

use super::hybrid::Hybrid;
use super::pages::{ClosedPage, ColumnPages};
use parquet::basic::Encoding;
use parquet::errors::Result;
use parquet::file::statistics::Statistics;
use parquet::schema::types::ColumnDescPtr;

/// A page is closed once it has so many rows: few enough that its values stay in the processor's cache.
const PAGE_ROWS: u32 = 1 << 16;

#[derive(Debug)]
pub struct NumberColumn {
    column: ColumnDescPtr,
    encoding: Encoding,
    /// The values of the page under way that are not null.
    values: Vec<f32>,
    /// For each row of the page under way: 1 if it has a value, 0 if it is null.
    levels: Hybrid,
    /// Rows of the page under way, nulls included.
    rows: u32,
    /// Number of nulls in the whole chunk.
    nulls: u64,
    /// The least and the largest value of the closed pages.
    span: Option<(f32, f32)>,
    pages: Vec<ClosedPage>,
}

impl NumberColumn {
    /// A column without rows. `encoding`: BYTE_STREAM_SPLIT or PLAIN.
    pub fn new(column: ColumnDescPtr, encoding: Encoding) -> NumberColumn {
        NumberColumn {
            column,
            encoding,
            values: Vec::new(),
            levels: Hybrid::new(1),
            rows: 0,
            nulls: 0,
            span: None,
            pages: Vec::new(),
        }
    }

    pub fn push_nulls(&mut self, rows: usize) -> Result<()> {
        self.levels.push(0, rows as u32); // rows of a row group at most
        self.nulls += rows as u64;
        self.go_on(rows)
    }

    /// The next rows; NaN is null.
    pub fn push(&mut self, of: &[f32]) -> Result<()> {
        // stretches of numbers and stretches of NaN in turns
        for run in of.chunk_by(|p, q| p.is_nan() == q.is_nan()) {
            match run[0].is_nan() {
                true => self.push_nulls(run.len())?,
                false => {
                    self.levels.push(1, run.len() as u32);
                    self.values.extend(run);
                    self.go_on(run.len())?;
                }
            }
        }
        Ok(())
    }

    /// Bytes held, about: values and pages; the levels are small beside them and are not counted.
    pub fn memory(&self) -> usize {
        self.values.len() * size_of::<f32>()
            + self.pages.iter().map(ClosedPage::memory).sum::<usize>()
    }

    fn go_on(&mut self, rows: usize) -> Result<()> {
        self.rows += rows as u32;
        if self.rows >= PAGE_ROWS { self.end_page() } else { Ok(()) }
    }

    fn end_page(&mut self) -> Result<()> {
        self.span = self.values.iter().fold(self.span, |span, &value| {
            Some(span.map_or((value, value), |(least, most)| (least.min(value), most.max(value))))
        });
        let levels = std::mem::replace(&mut self.levels, Hybrid::new(1)).finish();

        let encode = |out: &mut Vec<u8>| match self.encoding {
            Encoding::BYTE_STREAM_SPLIT => split(&self.values, out),
            _ => out.extend(self.values.iter().flat_map(|value| value.to_le_bytes())),
        };
        self.pages.push(ClosedPage::new(Some(levels), encode, self.rows)?);
        self.values.clear();
        self.rows = 0;
        Ok(())
    }

    pub fn close(mut self) -> Result<ColumnPages> {
        if self.rows > 0 {
            self.end_page()?;
        }
        // a reader may not tell zeros apart by their sign, so the span has both of them (as the format
        // demands)
        let least = self.span.map(|(least, _)| if least == 0.0 { -0.0 } else { least });
        let most = self.span.map(|(_, most)| if most == 0.0 { 0.0 } else { most });
        Ok(ColumnPages {
            dictionary: None,
            pages: self.pages,
            encoding: self.encoding,
            statistics: Some(Statistics::float(least, most, None, Some(self.nulls), false)),
            column: self.column,
        })
    }
}

fn split(values: &[f32], out: &mut Vec<u8>) {
    let from = out.len();
    out.resize(from + size_of_val(values), 0);
    for (k, stream) in out[from..].chunks_exact_mut(values.len().max(1)).enumerate() {
        stream.iter_mut().zip(values).for_each(|(byte, value)| *byte = value.to_le_bytes()[k]);
    }
}
