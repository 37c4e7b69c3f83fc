//! A column chunk of long runs: dictionary pages written run by run, not row by row.
//!
//! In: keys into a dictionary, or null, with how often each stands in a row. Out: the encoded chunk of
//! a row group, spliced into the file by the parquet crate. Most columns of a verdict table are the
//! same over a burst; the crate's writer looks every row's string up again.
//! Format: Parquet's RLE / bit-packing hybrid, data pages of version 1.

use bytes::Bytes;
use parquet::basic::{Compression, Encoding, ZstdLevel};
use parquet::column::page::{CompressedPage, Page, PageWriter};
use parquet::column::writer::ColumnCloseResult;
use parquet::errors::{ParquetError, Result};
use parquet::file::metadata::ColumnChunkMetaData;
use parquet::file::statistics::Statistics;
use parquet::file::writer::{SerializedPageWriter, SerializedRowGroupWriter, TrackedWrite};
use parquet::schema::types::ColumnDescPtr;
use std::collections::HashMap;
use zstd::zstd_safe::CompressionLevel;

/// Key of a null.
const NULL: u32 = u32::MAX;
const ZSTD_LEVEL: CompressionLevel = 1;

/// One column of a row group.
#[derive(Debug)]
pub struct RunColumn {
    column: ColumnDescPtr,
    /// Values, encoded PLAIN.
    dictionary: Vec<Vec<u8>>,
    keys: HashMap<Vec<u8>, u32>,
    /// The last two keys that were asked for: values take turns.
    recent: [u32; 2],
    /// Keys and how often.
    runs: Vec<(u32, u32)>,
    rows: u64,
}

/// A text, encoded PLAIN.
pub fn text(value: &str) -> Vec<u8> {
    let length = value.len() as u32; // names are far shorter
    [&length.to_le_bytes(), value.as_bytes()].concat()
}

impl RunColumn {
    /// Of a dictionary that is known: key k is its k-th value.
    pub fn new(column: ColumnDescPtr, values: impl Iterator<Item = Vec<u8>>) -> RunColumn {
        let mut new = RunColumn {
            column,
            dictionary: Vec::new(),
            keys: HashMap::new(),
            recent: [NULL; 2],
            runs: Vec::new(),
            rows: 0,
        };
        for value in values {
            new.key(&value);
        }
        new
    }

    /// The key of a value, which may be new.
    pub fn key(&mut self, value: &[u8]) -> u32 {
        let is_it = |key: &&u32| self.dictionary.get(**key as usize).is_some_and(|v| v == value);
        if let Some(key) = self.recent.iter().find(is_it) {
            return *key;
        }
        let key = self.keys.get(value).copied().unwrap_or_else(|| {
            let key = self.dictionary.len() as u32; // rows of a row group at most
            self.keys.insert(value.to_vec(), key);
            self.dictionary.push(value.to_vec());
            key
        });
        self.recent = [key, self.recent[0]];
        key
    }

    /// The next rows; `None` is null. A key beyond the dictionary is an error.
    pub fn push(&mut self, key: Option<u32>, rows: usize) -> Result<()> {
        let nullable = self.column.max_def_level() > 0;
        match key {
            Some(key) if key as usize >= self.dictionary.len() => {
                let known = self.dictionary.len();
                return Err(ParquetError::General(format!("key {key} of {known} values")));
            }
            None if !nullable => {
                return Err(ParquetError::General("null in a required column".into()));
            }
            _ => {}
        }
        let (key, rows) = (key.unwrap_or(NULL), rows as u32); // rows of a row group at most
        match self.runs.last_mut() {
            Some((last, n)) if *last == key => *n += rows,
            _ if rows > 0 => self.runs.push((key, rows)),
            _ => {}
        }
        self.rows += u64::from(rows);
        Ok(())
    }

    /// Bytes held.
    pub fn memory(&self) -> usize {
        self.runs.len() * size_of::<(u32, u32)>() + self.dictionary.len() * 64
    }

    /// Encodes the chunk and appends it to the row group as its next column.
    pub fn append_to<W: std::io::Write + Send>(
        self,
        group: &mut SerializedRowGroupWriter<'_, W>,
        statistics: bool,
    ) -> Result<()> {
        let values = self.dictionary.len().max(1) as u32;
        let width = (u32::BITS - (values - 1).leading_zeros()).max(1) as u8;
        let page = self.page(width);
        let mut dictionary = self.dictionary.concat();
        if dictionary.is_empty() {
            dictionary = text(""); // of which no row speaks
        }
        let mut sink = TrackedWrite::new(Vec::new());
        let mut pages = SerializedPageWriter::new(&mut sink);
        let (raw, compressed) = (dictionary.len(), compress(&dictionary)?);
        let dictionary_page = Page::DictionaryPage {
            buf: compressed,
            num_values: values,
            encoding: Encoding::PLAIN,
            is_sorted: false,
        };
        let first = pages.write_page(CompressedPage::new(dictionary_page, raw))?;
        let (raw, compressed) = (page.len(), compress(&page)?);
        let data_page = Page::DataPage {
            buf: compressed,
            num_values: self.rows as u32, // rows of a row group
            encoding: Encoding::RLE_DICTIONARY,
            def_level_encoding: Encoding::RLE,
            rep_level_encoding: Encoding::RLE,
            statistics: None,
        };
        let second = pages.write_page(CompressedPage::new(data_page, raw))?;
        pages.close()?;
        let mut metadata = ColumnChunkMetaData::builder(self.column.clone())
            .set_compression(Compression::ZSTD(ZstdLevel::try_new(ZSTD_LEVEL)?))
            .set_encodings(vec![Encoding::PLAIN, Encoding::RLE, Encoding::RLE_DICTIONARY])
            .set_num_values(self.rows as i64)
            .set_total_compressed_size((first.compressed_size + second.compressed_size) as i64)
            .set_total_uncompressed_size(
                (first.uncompressed_size + second.uncompressed_size) as i64,
            )
            .set_dictionary_page_offset(Some(first.offset as i64))
            .set_data_page_offset(second.offset as i64);
        if statistics {
            metadata = metadata.set_statistics(self.text_statistics());
        }
        let close = ColumnCloseResult {
            bytes_written: first.bytes_written + second.bytes_written,
            rows_written: self.rows,
            metadata: metadata.build()?,
            bloom_filter: None,
            column_index: None,
            offset_index: None,
        };
        group.append_column(&Bytes::from(sink.into_inner()?), close)
    }

    /// Which rows have a value, and the keys of those, of `width` bits.
    fn page(&self, width: u8) -> Vec<u8> {
        let (mut levels, mut indices) = (Hybrid::new(1), Hybrid::new(width));
        for &(key, rows) in &self.runs {
            levels.push(u32::from(key != NULL), rows);
            if key != NULL {
                indices.push(key, rows);
            }
        }
        let mut page = Vec::new();
        if self.column.max_def_level() > 0 {
            let levels = levels.finish();
            page.extend((levels.len() as u32).to_le_bytes());
            page.extend(levels);
        }
        page.push(width);
        page.extend(indices.finish());
        page
    }

    /// Of texts: the least and the largest.
    fn text_statistics(&self) -> Statistics {
        let nulls = self.runs.iter().filter(|(key, _)| *key == NULL);
        let nulls = nulls.map(|(_, rows)| u64::from(*rows)).sum();
        let texts = || self.dictionary.iter().filter_map(|value| value.get(size_of::<u32>()..));
        let value = |text: Option<&[u8]>| text.map(|t| t.to_vec().into());
        Statistics::byte_array(value(texts().min()), value(texts().max()), None, Some(nulls), false)
    }
}

fn compress(page: &[u8]) -> Result<Bytes> {
    zstd::bulk::compress(page, ZSTD_LEVEL)
        .map(Bytes::from)
        .map_err(|e| ParquetError::General(format!("zstd: {e}")))
}

/// Parquet's hybrid of run lengths and bit packing, of values of `width` bits.
#[derive(Debug)]
struct Hybrid {
    width: u8,
    out: Vec<u8>,
    /// Waits to be packed, in groups of eight.
    literals: Vec<u32>,
    run: (u32, u32),
}

impl Hybrid {
    /// What one header of packed groups may announce, so that it stays one byte.
    const MOST_LITERALS: usize = 63 * 8;

    fn new(width: u8) -> Hybrid {
        Hybrid { width, out: Vec::new(), literals: Vec::new(), run: (0, 0) }
    }

    fn push(&mut self, value: u32, times: u32) {
        if value == self.run.0 {
            self.run.1 += times;
        } else {
            self.end_run();
            self.run = (value, times);
        }
    }

    fn end_run(&mut self) {
        let (value, mut times) = std::mem::take(&mut self.run);
        // packed groups are whole: a run lends what is missing
        let missing = ((8 - self.literals.len() % 8) % 8) as u32;
        let literal = if times >= missing + 8 { missing } else { times };
        for _ in 0..literal {
            self.literals.push(value);
            if self.literals.len() == Self::MOST_LITERALS {
                self.pack();
            }
        }
        times -= literal;
        if times > 0 {
            self.pack();
            self.header(times << 1);
            let bytes = usize::from(self.width.div_ceil(8));
            self.out.extend(&value.to_le_bytes()[..bytes]);
        }
    }

    /// Writes the waiting literals; the last group may be filled up, which only the end may do.
    fn pack(&mut self) {
        if self.literals.is_empty() {
            return;
        }
        let groups = self.literals.len().div_ceil(8);
        self.literals.resize(groups * 8, 0);
        self.header((groups as u32) << 1 | 1);
        let (mut bits, mut held) = (0u64, 0);
        for value in self.literals.drain(..) {
            bits |= u64::from(value) << held;
            held += self.width;
            while held >= 8 {
                self.out.push(bits as u8);
                bits >>= 8;
                held -= 8;
            }
        }
    }

    fn header(&mut self, mut value: u32) {
        while value >= 0x80 {
            self.out.push(value as u8 | 0x80);
            value >>= 7;
        }
        self.out.push(value as u8);
    }

    fn finish(mut self) -> Vec<u8> {
        self.end_run();
        self.pack();
        self.out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    /// A decoder from the format's description.
    fn decode(width: u8, mut of: &[u8], values: usize) -> Vec<u32> {
        let mut out = Vec::new();
        while out.len() < values {
            let (mut header, mut shift) = (0u32, 0);
            loop {
                let byte = of[0];
                of = &of[1..];
                header |= u32::from(byte & 0x7f) << shift;
                shift += 7;
                if byte & 0x80 == 0 {
                    break;
                }
            }
            if header & 1 == 0 {
                let bytes = usize::from(width.div_ceil(8));
                let mut value = [0; 4];
                value[..bytes].copy_from_slice(&of[..bytes]);
                of = &of[bytes..];
                out.extend(std::iter::repeat_n(u32::from_le_bytes(value), (header >> 1) as usize));
            } else {
                let groups = (header >> 1) as usize;
                let bit = |i: usize| u32::from(of[i / 8] >> (i % 8) & 1);
                let width = usize::from(width);
                out.extend(
                    (0..groups * 8)
                        .map(|v| (0..width).map(|b| bit(v * width + b) << b).sum::<u32>()),
                );
                of = &of[groups * width..];
            }
        }
        out.truncate(values);
        out
    }

    #[test]
    fn property_hybrid_of_any_runs_decodes_to_them() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(8);
        for round in 0..400 {
            let width = rng.random_range(1..=20u8);
            let longest = [1, 3, 9, 40, 5000][round % 5];
            let (mut hybrid, mut values) = (Hybrid::new(width), Vec::new());
            for _ in 0..rng.random_range(0..60) {
                let value = rng.random_range(0..1u32 << width.min(3 + (round % 18) as u8));
                let times = rng.random_range(1..=longest);
                hybrid.push(value, times);
                values.extend(std::iter::repeat_n(value, times as usize));
            }
            let packed = hybrid.finish();
            assert_eq!(decode(width, &packed, values.len()), values, "round {round}");
        }
    }
}
