//! Tables with a row per item, of one list of columns: what each is called, what an item has there, and how that gets
//! back into an item.

use super::arrow_cells::numbers;
use super::column_types::{TimestampUnit, text, time, times};
use super::part_file::PartFile;
use super::verdict_reader::{plain_texts, timestamps_ns};
use super::verdict_table::{METADATA_KEY, TableError};
use arrow_array::builder::StringDictionaryBuilder;
use arrow_array::types::Int32Type;
use arrow_array::{ArrayRef, Float32Array, RecordBatch, StringArray, UInt32Array};
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
    pub read: Option<Read<T>>,
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

/// How what a column holds gets back into an item: without a null where the column may have none.
pub enum Read<T> {
    Name(fn(&mut T, Option<String>)),
    /// Of a column that may be missing.
    Text(fn(&mut T, Option<String>)),
    Count(fn(&mut T, Option<u32>)),
    Time(fn(&mut T, Option<i64>)),
    /// Of a column that may be missing.
    Number(fn(&mut T, Option<f64>)),
}

impl<T> Column<T> {
    pub const fn required(name: &'static str, cells: Cells<T>) -> Column<T> {
        Column { name, nullable: false, cells, read: None }
    }

    pub const fn nullable(name: &'static str, cells: Cells<T>) -> Column<T> {
        Column { name, nullable: true, cells, read: None }
    }

    pub const fn read(self, read: Read<T>) -> Column<T> {
        Column { read: Some(read), ..self }
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

/// The rows of a batch. An error says what does not fit.
pub fn rows<T: Clone + Default>(
    columns: &'static [Column<T>],
    batch: &RecordBatch,
) -> Result<Vec<T>, String> {
    let mut rows = vec![T::default(); batch.num_rows()];
    for column in columns {
        let Some(read) = &column.read else { continue };
        match batch.column_by_name(column.name) {
            Some(array) => column.read_into(&mut rows, read, array)?,
            None if matches!(read, Read::Text(_) | Read::Number(_)) => {}
            None => return Err(format!("column `{}` is missing", column.name)),
        }
    }
    Ok(rows)
}

impl<T> Column<T> {
    /// Every row's cell into its item.
    fn read_into(&self, rows: &mut [T], read: &Read<T>, array: &ArrayRef) -> Result<(), String> {
        let unfit = |what| format!("column `{}` has no {what}", self.name);
        let texts = || plain_texts(array).ok_or_else(|| unfit("texts"));
        let numbers = || numbers(array).ok_or_else(|| unfit("numbers"));
        match *read {
            Read::Name(set) => self.set(rows, texts()?, set),
            Read::Text(set) => {
                let or_empty = texts()?.into_iter().map(|text| Some(text.unwrap_or_default()));
                self.set(rows, or_empty, set)
            }
            Read::Count(set) => {
                let count = |n: f64| (0.0..=u32::MAX.into()).contains(&n).then_some(n as u32);
                self.set(rows, numbers()?.into_iter().map(|n| n.and_then(count)), set)
            }
            Read::Time(set) => {
                let times = timestamps_ns(array).ok_or_else(|| unfit("times"))?;
                self.set(rows, times, set)
            }
            Read::Number(set) => {
                let finite = |v: Option<f64>| v.filter(|v| v.is_finite());
                self.set(rows, numbers()?.into_iter().map(finite), set)
            }
        }
    }

    fn set<V>(
        &self,
        rows: &mut [T],
        cells: impl IntoIterator<Item = Option<V>>,
        set: fn(&mut T, Option<V>),
    ) -> Result<(), String> {
        for (row, cell) in rows.iter_mut().zip(cells) {
            if cell.is_none() && !self.nullable {
                let name = self.name;
                return Err(format!("column `{name}` has a null or a number out of range"));
            }
            set(row, cell);
        }
        Ok(())
    }
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
