//! Writes a Parquet file of whole columns, for tables of which this crate knows nothing, such as
//! those of a critique.
//!
//! In: the name and the cells of each column. Out: a file, under its name once it is complete.
//! There is no metadata document; the program's version stands in its place.

use super::row_table;
use super::verdict_table::TableError;
use arrow_array::{ArrayRef, BooleanArray, Float64Array, RecordBatch, StringArray, UInt32Array};
use std::path::Path;
use std::sync::Arc;

/// The cells of a column; the functions below make them.
pub type Cells = ArrayRef;

/// A column of whole numbers.
pub fn count(values: impl Iterator<Item = u32>) -> Cells {
    Arc::new(UInt32Array::from_iter_values(values))
}

pub fn flag(values: impl Iterator<Item = bool>) -> Cells {
    Arc::new(values.map(Some).collect::<BooleanArray>())
}

/// A column of numbers. NaN and infinity become null.
pub fn number(values: impl Iterator<Item = f64>) -> Cells {
    Arc::new(values.map(|v| v.is_finite().then_some(v)).collect::<Float64Array>())
}

pub fn text<'a>(values: impl Iterator<Item = &'a str>) -> Cells {
    Arc::new(StringArray::from_iter_values(values))
}

/// Writes a table. An error if the columns are not equally long.
pub fn write(path: &Path, columns: Vec<(&str, Cells)>) -> Result<(), TableError> {
    let batch = RecordBatch::try_from_iter(columns).map_err(TableError::columns(path))?;
    row_table::write(path, &batch)
}
