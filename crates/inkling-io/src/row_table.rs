//! Writes and reads Parquet tables with a row for each item, such as an episode or a fault. One
//! list of [`Column`]s serves writing and reading.
//!
//! In and out: items as JSON objects whose keys are the names of the columns, so that any struct
//! with serde can be a row; between them Arrow batches. `episode_table.rs` and the report's table
//! of faults (`src/cli/report_page.rs`) use it. These tables are small. Verdict tables, which are
//! large, are written run by run (`verdict_table.rs`).

use super::arrow_cells::ReadColumn;
use super::column_types::{TimestampUnit, text, time, times};
use super::part_file::{CompleteFile, PartFile};
use super::verdict_table::{METADATA_KEY, TableError};
use arrow_array::builder::StringDictionaryBuilder;
use arrow_array::types::Int32Type;
use arrow_array::{ArrayRef, Float32Array, Float64Array, RecordBatch, StringArray, UInt32Array};
use arrow_schema::{ArrowError, DataType, Field, Schema, SchemaRef};
use parquet::arrow::ArrowWriter;
use parquet::basic::{Compression, ZstdLevel};
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value};
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;
use std::sync::Arc;

#[derive(Clone, Copy, Debug)]
pub struct Column {
    pub name: &'static str,
    kind: Kind,
    nullable: bool,
}

#[derive(Clone, Copy, Debug)]
pub enum Kind {
    /// A text of which there are few different ones; stored as a dictionary.
    Name,
    Text,
    /// A whole number of 32 bits.
    Count,
    /// Nanoseconds since 1970.
    Time,
    /// An f32.
    Number,
    /// An f64: seconds.
    Seconds,
}

impl Column {
    pub const fn required(name: &'static str, kind: Kind) -> Column {
        Column { name, kind, nullable: false }
    }

    pub const fn nullable(name: &'static str, kind: Kind) -> Column {
        Column { nullable: true, ..Column::required(name, kind) }
    }

    fn field(&self, unit: TimestampUnit) -> Field {
        let data_type = match self.kind {
            Kind::Name => text(),
            Kind::Text => DataType::Utf8,
            Kind::Count => DataType::UInt32,
            Kind::Time => time(unit),
            Kind::Number => DataType::Float32,
            Kind::Seconds => DataType::Float64,
        };
        Field::new(self.name, data_type, self.nullable)
    }

    /// A value of the wrong type becomes null; a count beyond u32 becomes the largest one.
    fn array(&self, rows: &[Value], unit: TimestampUnit) -> ArrayRef {
        let cells = rows.iter().map(|row| &row[self.name]);
        match self.kind {
            Kind::Name => {
                let mut builder = StringDictionaryBuilder::<Int32Type>::new();
                cells.for_each(|cell| builder.append_option(cell.as_str()));
                Arc::new(builder.finish())
            }
            Kind::Text => Arc::new(cells.map(Value::as_str).collect::<StringArray>()),
            Kind::Count => {
                let count = |n: u64| u32::try_from(n).unwrap_or(u32::MAX);
                Arc::new(cells.map(|cell| cell.as_u64().map(count)).collect::<UInt32Array>())
            }
            Kind::Time => times(cells.map(Value::as_i64), unit),
            Kind::Number => {
                let numbers = cells.map(|cell| cell.as_f64().map(|v| v as f32));
                Arc::new(numbers.collect::<Float32Array>())
            }
            Kind::Seconds => Arc::new(cells.map(Value::as_f64).collect::<Float64Array>()),
        }
    }

    fn cells(&self, of: ReadColumn) -> Result<Vec<Value>, String> {
        fn json<T: Into<Value>>(cells: Vec<Option<T>>) -> Vec<Value> {
            cells.into_iter().map(Value::from).collect()
        }
        let cells = match self.kind {
            Kind::Name | Kind::Text => json(of.texts()?.cells()),
            Kind::Count => json(of.whole::<u32>()?),
            Kind::Time => json(of.times()?),
            Kind::Number | Kind::Seconds => json(of.numbers()?),
        };
        match cells.iter().any(Value::is_null) && !self.nullable {
            true => Err(of.has_null()),
            false => Ok(cells),
        }
    }
}

pub fn schema(columns: &[Column], unit: TimestampUnit) -> Schema {
    Schema::new(columns.iter().map(|column| column.field(unit)).collect::<Vec<_>>())
}

pub fn batch(
    columns: &[Column],
    schema: SchemaRef,
    unit: TimestampUnit,
    rows: &[Value],
) -> Result<RecordBatch, ArrowError> {
    let arrays = columns.iter().map(|column| column.array(rows, unit)).collect();
    RecordBatch::try_new(schema, arrays)
}

pub fn rows<T: DeserializeOwned>(
    columns: &[Column],
    batch: &RecordBatch,
) -> Result<Vec<T>, String> {
    let mut rows = vec![Map::new(); batch.num_rows()];
    for column @ Column { name, .. } in columns {
        let array = batch.column_by_name(name);
        let array = array.ok_or_else(|| format!("column `{name}` is missing"))?;
        for (row, cell) in rows.iter_mut().zip(column.cells(ReadColumn { name, array })?) {
            // a field without a value is left out, and serde takes its default
            if !cell.is_null() {
                row.insert((*name).to_owned(), cell);
            }
        }
    }
    let row = |row| serde_json::from_value(Value::Object(row)).map_err(|e| e.to_string());
    rows.into_iter().map(row).collect()
}

pub struct TableWriter {
    writer: ArrowWriter<BufWriter<File>>,
    part: PartFile,
}

impl TableWriter {
    pub fn create(path: &Path, schema: SchemaRef) -> Result<TableWriter, TableError> {
        let (part, file) = PartFile::create(path).map_err(TableError::io(path))?;
        let compression = Compression::ZSTD(ZstdLevel::default());
        let properties = WriterProperties::builder().set_compression(compression).build();
        let writer = ArrowWriter::try_new(BufWriter::new(file), schema, Some(properties))
            .map_err(TableError::parquet(path))?;
        Ok(TableWriter { writer, part })
    }

    pub fn path(&self) -> &Path {
        self.part.path()
    }

    pub fn write(&mut self, batch: &RecordBatch) -> Result<(), TableError> {
        self.writer.write(batch).map_err(TableError::parquet(self.part.path()))
    }

    /// Completes the file. `about` is its metadata document; the file still has a provisional name.
    pub fn complete(mut self, about: String) -> Result<CompleteFile, TableError> {
        self.writer.append_key_value_metadata(KeyValue::new(METADATA_KEY.into(), about));
        let path = self.part.path().to_path_buf();
        let file = self.writer.into_inner().map_err(TableError::parquet(&path))?;
        self.part.complete_buffered(file).map_err(TableError::io(&path))
    }
}

pub fn write(path: &Path, batch: &RecordBatch) -> Result<(), TableError> {
    let mut table = TableWriter::create(path, batch.schema())?;
    table.write(batch)?;
    // the version of the program, where other tables have a metadata document: it tells who made the file
    let file = table.complete(env!("CARGO_PKG_VERSION").to_owned())?;
    file.name_on_disk().map_err(TableError::io(path))
}
