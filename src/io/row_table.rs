//! Tables with a row per item, of one list of columns: what each is called, and what an item has there.

use super::column_types::{TimestampUnit, text, time};
use super::part_file::PartFile;
use super::verdict_table::{METADATA_KEY, TableError};
use arrow_array::builder::StringDictionaryBuilder;
use arrow_array::types::Int32Type;
use arrow_array::{
    ArrayRef, Float32Array, RecordBatch, StringArray, TimestampMicrosecondArray,
    TimestampNanosecondArray, UInt32Array,
};
use arrow_schema::{ArrowError, DataType, Field, Schema};
use parquet::arrow::ArrowWriter;
use parquet::basic::{Compression, ZstdLevel};
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use std::path::Path;
use std::sync::Arc;

/// A column of a table of `T`s.
pub struct Column<T> {
    pub name: &'static str,
    pub nullable: bool,
    pub cells: Cells<T>,
}

/// What an item has in a column.
pub enum Cells<T> {
    /// One of few texts.
    Name(fn(&T) -> Option<String>),
    Text(fn(&T) -> String),
    Count(fn(&T) -> u32),
    /// Nanoseconds since 1970.
    Time(fn(&T) -> Option<i64>),
    Number(fn(&T) -> Option<f64>),
}

impl<T> Column<T> {
    pub const fn required(name: &'static str, cells: Cells<T>) -> Column<T> {
        Column { name, nullable: false, cells }
    }

    pub const fn nullable(name: &'static str, cells: Cells<T>) -> Column<T> {
        Column { name, nullable: true, cells }
    }

    fn field(&self, unit: TimestampUnit) -> Field {
        let data_type = match self.cells {
            Cells::Name(_) => text(),
            Cells::Text(_) => DataType::Utf8,
            Cells::Count(_) => DataType::UInt32,
            Cells::Time(_) => time(unit),
            Cells::Number(_) => DataType::Float32,
        };
        Field::new(self.name, data_type, self.nullable)
    }

    fn array(&self, rows: &[T], unit: TimestampUnit) -> ArrayRef {
        match self.cells {
            Cells::Name(of) => {
                let mut builder = StringDictionaryBuilder::<Int32Type>::new();
                rows.iter().for_each(|row| builder.append_option(of(row)));
                Arc::new(builder.finish())
            }
            Cells::Text(of) => Arc::new(StringArray::from_iter_values(rows.iter().map(of))),
            Cells::Count(of) => Arc::new(UInt32Array::from_iter_values(rows.iter().map(of))),
            Cells::Time(of) => times(rows.iter().map(of), unit),
            Cells::Number(of) => {
                let numbers = rows.iter().map(|row| of(row).map(|v| v as f32));
                Arc::new(numbers.collect::<Float32Array>())
            }
        }
    }
}

fn times(ns: impl Iterator<Item = Option<i64>>, unit: TimestampUnit) -> ArrayRef {
    match unit {
        TimestampUnit::Ns => {
            Arc::new(ns.collect::<TimestampNanosecondArray>().with_timezone("UTC"))
        }
        TimestampUnit::Us => {
            let us = ns.map(|t| t.map(|t| t.div_euclid(1000)));
            Arc::new(us.collect::<TimestampMicrosecondArray>().with_timezone("UTC"))
        }
    }
}

/// The columns as Arrow sees them.
pub fn schema<T: 'static>(
    columns: impl IntoIterator<Item = &'static Column<T>>,
    unit: TimestampUnit,
) -> Schema {
    Schema::new(columns.into_iter().map(|column| column.field(unit)).collect::<Vec<_>>())
}

pub fn batch<T: 'static>(
    columns: impl IntoIterator<Item = &'static Column<T>>,
    schema: Arc<Schema>,
    unit: TimestampUnit,
    rows: &[T],
) -> Result<RecordBatch, ArrowError> {
    let arrays = columns.into_iter().map(|column| column.array(rows, unit)).collect();
    RecordBatch::try_new(schema, arrays)
}

/// Of a file of such a table.
pub fn properties() -> WriterProperties {
    WriterProperties::builder().set_compression(Compression::ZSTD(ZstdLevel::default())).build()
}

/// A table of one batch; the file has its name when it is whole.
pub fn write(path: &Path, batch: &RecordBatch) -> Result<(), TableError> {
    let io_failed = |source| TableError::Io { path: path.to_path_buf(), source };
    let failed = |source| TableError::Parquet { path: path.to_path_buf(), source };
    let (part, file) = PartFile::create(path).map_err(io_failed)?;
    let mut writer =
        ArrowWriter::try_new(file, batch.schema(), Some(properties())).map_err(failed)?;
    writer.write(batch).map_err(failed)?;
    // who made it, as the other tables say in their metadata
    let made_by = Some(env!("CARGO_PKG_VERSION").to_owned());
    writer.append_key_value_metadata(KeyValue::new(METADATA_KEY.into(), made_by));
    let file = writer.into_inner().map_err(failed)?;
    part.finish(&file).map_err(io_failed)
}
