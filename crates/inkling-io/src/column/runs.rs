//! Encodes a column of long runs: texts, and numbers that are the same over many rows. Each
//! distinct value stands once in a dictionary; rows are keys (indices) into it.
//!
//! In: keys with a number of rows each, from `verdict_chunk.rs`. Out: a dictionary page and one
//! data page (RLE_DICTIONARY). Until the row group ends, a run of rows is one [`Run`]. Where two values take turns row by row, such as the test that decided, runs
//! of single rows would be many, so a run of "either of two keys" is kept, with one flag for each
//! row.

use super::hybrid::Hybrid;
use super::pages::{ClosedPage, ColumnPages};
use parquet::basic::Encoding;
use parquet::errors::{ParquetError, Result};
use parquet::file::statistics::Statistics;
use parquet::schema::types::ColumnDescPtr;
use std::collections::HashMap;

/// The key that stands for null in a run.
const NULL: u32 = u32::MAX;

#[derive(Debug)]
pub struct RunColumn {
    column: ColumnDescPtr,
    /// The values by key, encoded PLAIN as a page of the dictionary has them.
    dictionary: Vec<Vec<u8>>,
    keys: HashMap<Vec<u8>, u32>,
    /// The last two keys that were asked for, the latest first; `NULL` before. Values often take
    /// turns, so these two are compared before the map is asked.
    recent: [u32; 2],
    runs: Vec<Run>,
    /// One flag for each row of the runs of two keys, all these runs one after the other: whether
    /// the row has the second key.
    which: Vec<bool>,
    rows: u32,
}

/// Rows that follow one another: all of one key (`NULL`: null), or each of either of two keys, by
/// the flags in `which`.
#[derive(Clone, Copy, Debug)]
enum Run {
    Same { key: u32, rows: u32 },
    Either { keys: [u32; 2], rows: u32 },
}

/// A text, encoded PLAIN: its length in four bytes, then its bytes.
pub fn text(value: &str) -> Vec<u8> {
    let length = value.len() as u32; // names are far shorter
    [&length.to_le_bytes(), value.as_bytes()].concat()
}

impl RunColumn {
    /// A column with values that are known from the beginning: key k is the k-th of them.
    pub fn new(column: ColumnDescPtr, values: impl Iterator<Item = Vec<u8>>) -> RunColumn {
        let mut new = RunColumn {
            column,
            dictionary: Vec::new(),
            keys: HashMap::new(),
            recent: [NULL; 2],
            runs: Vec::new(),
            which: Vec::new(),
            rows: 0,
        };
        for value in values {
            new.key(&value);
        }
        new
    }

    /// The key of a value (encoded PLAIN). A value that is not in the dictionary yet is added.
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

    pub fn push(&mut self, key: Option<u32>, rows: usize) -> Result<()> {
        match key {
            Some(key) => self.check(key)?,
            None if self.column.max_def_level() == 0 => {
                return Err(ParquetError::General("null in a required column".into()));
            }
            None => {}
        }

        let (next, more) = (key.unwrap_or(NULL), rows as u32); // rows of a row group at most
        match self.runs.last_mut() {
            Some(Run::Same { key, rows }) if *key == next => *rows += more,
            _ if more > 0 => self.runs.push(Run::Same { key: next, rows: more }),
            _ => {}
        }
        self.rows += more;
        Ok(())
    }

    /// The next rows, one for each flag: the second key where it is true, else the first.
    pub fn push_either(&mut self, keys: [u32; 2], which: &[bool]) -> Result<()> {
        let Some(&first) = which.first() else { return Ok(()) };
        if which.iter().all(|&second| second == first) {
            return self.push(Some(keys[usize::from(first)]), which.len());
        }

        keys.into_iter().try_for_each(|key| self.check(key))?;
        let rows = which.len() as u32;
        self.runs.push(Run::Either { keys, rows });
        self.which.extend(which);
        self.rows += rows;
        Ok(())
    }

    fn check(&self, key: u32) -> Result<()> {
        match self.dictionary.len() {
            known if key as usize >= known => {
                Err(ParquetError::General(format!("key {key} of {known} values")))
            }
            _ => Ok(()),
        }
    }

    /// Bytes held, about: a value of the dictionary is counted as 64 bytes.
    pub fn memory(&self) -> usize {
        self.runs.len() * size_of::<Run>() + self.which.len() + self.dictionary.len() * 64
    }

    pub fn close(self, statistics: bool) -> Result<ColumnPages> {
        // every key takes as many bits as the largest one, at least one bit
        let values = self.dictionary.len().max(1) as u32;
        let width = (u32::BITS - (values - 1).leading_zeros()).max(1) as u8;
        let page = self.page(width)?;
        let mut dictionary = self.dictionary.concat();
        // A dictionary must have a value, even if no row refers to it: four zero bytes, which are
        // the empty text (a length of 0), or the number 0 of four bytes.
        if dictionary.is_empty() {
            dictionary = text("");
        }
        let dictionary = |out: &mut Vec<u8>| out.extend(&dictionary);
        Ok(ColumnPages {
            dictionary: Some(ClosedPage::new(None, dictionary, values)?),
            pages: vec![page],
            encoding: Encoding::RLE_DICTIONARY,
            statistics: statistics.then(|| self.text_statistics()),
            column: self.column,
        })
    }

    /// Encodes the data page: the definition levels (which rows have a value), then the keys of the
    /// rows that have one, in `width` bits each.
    fn page(&self, width: u8) -> Result<ClosedPage> {
        let (mut levels, mut indices) = (Hybrid::new(1), Hybrid::new(width));
        let mut which = &self.which[..];
        for run in &self.runs {
            match *run {
                Run::Same { key: NULL, rows } => levels.push(0, rows),
                Run::Same { key, rows } => {
                    levels.push(1, rows);
                    indices.push(key, rows);
                }
                Run::Either { keys, rows } => {
                    let (now, later) = which.split_at(rows as usize);
                    levels.push(1, rows);
                    indices.push_either(keys, now);
                    which = later;
                }
            }
        }
        let nullable = self.column.max_def_level() > 0;
        let keys = indices.finish();
        let encode = |out: &mut Vec<u8>| {
            out.push(width);
            out.extend(keys);
        };
        ClosedPage::new(nullable.then(|| levels.finish()), encode, self.rows)
    }

    /// Values that no row refers to count, so the bounds may be wider than the rows; readers may
    /// rely on bounds, not on their being met.
    fn text_statistics(&self) -> Statistics {
        let nulls = self.runs.iter().map(|run| match *run {
            Run::Same { key: NULL, rows } => u64::from(rows),
            _ => 0,
        });
        let nulls = nulls.sum();
        let texts = || self.dictionary.iter().filter_map(|value| value.get(size_of::<u32>()..));
        let value = |text: Option<&[u8]>| text.map(|t| t.to_vec().into());
        Statistics::byte_array(value(texts().min()), value(texts().max()), None, Some(nulls), false)
    }
}
