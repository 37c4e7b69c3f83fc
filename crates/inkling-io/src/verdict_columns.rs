//! Says how the verdict table's columns stand in Parquet and Arrow: their types, encodings, names and
//! lists of weights. Which columns there are, and what they mean, is said in [`inkling_core::verdict`]
//! and `schemas/verdicts.md`. The writer of the file (`verdict_table.rs`) and that of arrays
//! (`verdict_arrays.rs`) both follow this.

use super::column_types::{TimestampUnit, text, time};
use arrow_array::{FixedSizeListArray, Float32Array};
use arrow_buffer::NullBuffer;
use arrow_schema::{ArrowError, DataType, Field, Schema};
use inkling_core::verdict::{COLUMNS, Cells, Column, Outcome, Reason, Test, VerdictColumns};
use parquet::basic::{Compression, Encoding, ZstdLevel};
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::schema::types::ColumnPath;
use std::sync::Arc;

/// A row group ends with the batch that reaches so many rows, or 128 MiB.
pub const ROW_GROUP_ROWS: usize = 1 << 20;

/// What decides on the form of one recording's table, besides the verdicts themselves.
#[derive(Clone, Debug)]
pub struct TableOptions {
    /// The text of the column `recording`, the same in every row.
    pub recording: String,
    /// The names that the columns `fault` and `candidate` refer to; also the order of the weights.
    pub classes: Vec<String>,
    pub categories: Vec<String>,
    pub weights: bool,
    pub timestamp_unit: TimestampUnit,
}

/// The table's columns in their order.
pub fn columns(options: &TableOptions) -> impl Iterator<Item = &'static Column> {
    let has_weights = options.weights && !options.classes.is_empty();
    COLUMNS.iter().filter(move |column| has_weights || !matches!(column.cells, Cells::Weights))
}

pub fn schema(options: &TableOptions) -> Schema {
    let field = |column: &Column| {
        let data_type = match column.cells {
            Cells::Time(_) => time(options.timestamp_unit),
            Cells::Recording | Cells::Printhead(_) | Cells::Outcome(_) => text(),
            Cells::Category(_) => text(),
            Cells::Class(_) | Cells::Test(_) | Cells::Reason(_) => text(),
            Cells::Channel(_) => DataType::UInt32,
            Cells::Model(_) => DataType::UInt16,
            Cells::Statistic(_) | Cells::Threshold(_) => DataType::Float32,
            Cells::Temperature(_) | Cells::Drive(_) => DataType::Float32,
            Cells::Misfit(_) | Cells::Number(_) => DataType::Float32,
            Cells::Weights => DataType::FixedSizeList(weight_field(), options.classes.len() as i32),
        };
        Field::new(column.name, data_type, column.nullable)
    };
    Schema::new(columns(options).map(field).collect::<Vec<_>>())
}

pub fn weight_field() -> Arc<Field> {
    Arc::new(Field::new("element", DataType::Float32, false))
}

/// The encoding of numbers that differ from row to row. BYTE_STREAM_SPLIT compresses better, but
/// readers that want microseconds (Spark) do not know it.
pub fn floats(options: &TableOptions) -> Encoding {
    match options.timestamp_unit {
        TimestampUnit::Ns => Encoding::BYTE_STREAM_SPLIT,
        TimestampUnit::Us => Encoding::PLAIN,
    }
}

/// The weights are the one column that the parquet crate encodes itself.
pub fn properties(options: &TableOptions) -> WriterProperties {
    let weights = ColumnPath::new(["weights", "list", "element"].map(String::from).to_vec());
    WriterProperties::builder()
        .set_compression(Compression::ZSTD(ZstdLevel::default()))
        .set_statistics_enabled(EnabledStatistics::Chunk)
        // the index of pages is of no use without statistics of each page
        .set_offset_index_disabled(true)
        .set_column_dictionary_enabled(weights.clone(), false)
        .set_column_encoding(weights, floats(options))
        .build()
}

/// The names that the keys of a column refer to ([`Cells::key`]), as far as they are known before
/// there are any rows: all but those of printheads.
pub fn names<'a>(column: &Column, options: &'a TableOptions) -> Vec<&'a str> {
    let texts = |of: &'a [String]| of.iter().map(String::as_str).collect();
    match column.cells {
        Cells::Recording => vec![&options.recording],
        Cells::Outcome(_) => Outcome::ALL.map(Outcome::as_str).to_vec(),
        Cells::Test(_) => Test::ALL.map(Test::as_str).to_vec(),
        Cells::Reason(_) => Reason::ALL.map(Reason::as_str).to_vec(),
        Cells::Category(_) => texts(&options.categories),
        Cells::Class(_) => texts(&options.classes),
        _ => Vec::new(),
    }
}

/// The weights of all rows as lists of `classes` numbers, null where a row has none: its signal is
/// healthy, was rejected or was not named. An error if a row's weights lie beyond the columns'.
pub fn weights(rows: &VerdictColumns, classes: usize) -> Result<FixedSizeListArray, ArrowError> {
    let mut values = Vec::with_capacity(rows.len() * classes);
    for start in &rows.weights_start {
        let Some(start) = start.map(|start| start as usize) else {
            values.resize(values.len() + classes, 0.0);
            continue;
        };
        let of_row = rows.weights.get(start..start + classes);
        let beyond = || ArrowError::InvalidArgumentError("weights beyond the last one".into());
        values.extend_from_slice(of_row.ok_or_else(beyond)?);
    }
    let valid = rows.weights_start.iter().map(Option::is_some).collect::<Vec<bool>>();
    let (values, valid) = (Arc::new(Float32Array::from(values)), Some(NullBuffer::from(valid)));
    FixedSizeListArray::try_new(weight_field(), classes as i32, values, valid)
}
