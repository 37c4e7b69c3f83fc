//! The verdict table, Parquet out (`schemas/verdicts.md`).
//!
//! In: columns of verdicts, batch by batch. Out: one file, complete under its name or not there.

use super::part_file::PartFile;
use crate::verdict::{Outcome, Reason, VerdictColumns};
use arrow_array::builder::{FixedSizeListBuilder, Float32Builder};
use arrow_array::types::Int32Type;
use arrow_array::{
    ArrayRef, DictionaryArray, Float32Array, Int32Array, RecordBatch, StringArray,
    TimestampMicrosecondArray, TimestampNanosecondArray, UInt16Array, UInt32Array,
};
use arrow_schema::{ArrowError, DataType, Field, Schema, SchemaRef, TimeUnit};
use parquet::arrow::ArrowWriter;
use parquet::basic::{Compression, Encoding, ZstdLevel};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::schema::types::ColumnPath;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use thiserror::Error;

/// The key of the document in the file's metadata.
pub const METADATA_KEY: &str = "inkling";

#[derive(Debug, Error)]
pub enum VerdictError {
    #[error("{path}: cannot be written: {source}")]
    Write { path: PathBuf, source: std::io::Error },
    #[error("{path}: {source}")]
    Parquet { path: PathBuf, source: ParquetError },
    #[error("{path}: {source}")]
    Arrow { path: PathBuf, source: ArrowError },
    #[error("{path}: {what}; is it a verdict file that inkling wrote?")]
    NotVerdicts { path: PathBuf, what: String },
}

#[derive(Clone, Debug)]
pub struct TableOptions {
    pub classes: Vec<String>,
    pub categories: Vec<String>,
    /// Write the weights of every class.
    pub weights: bool,
    /// Timestamps in µs instead of ns.
    pub microseconds: bool,
}

/// The contract's columns.
pub fn schema(options: &TableOptions) -> Schema {
    let unit = if options.microseconds { TimeUnit::Microsecond } else { TimeUnit::Nanosecond };
    let word = || DataType::Dictionary(Box::new(DataType::Int32), Box::new(DataType::Utf8));
    let mut fields = vec![
        Field::new("acquired_at", DataType::Timestamp(unit, Some("UTC".into())), false),
        Field::new("printhead", word(), false),
        Field::new("channel", DataType::UInt32, false),
        Field::new("outcome", word(), false),
        Field::new("category", word(), true),
        Field::new("fault", word(), true),
        Field::new("candidate", word(), true),
        Field::new("certainty", DataType::Float32, true),
        Field::new("statistic", DataType::Float32, true),
        Field::new("threshold", DataType::Float32, true),
        Field::new("severity", DataType::Float32, true),
        Field::new("severity_sd", DataType::Float32, true),
        Field::new("model", DataType::UInt16, true),
        Field::new("reason", word(), true),
    ];
    if options.weights {
        let item = Arc::new(Field::new_list_field(DataType::Float32, true));
        let list = DataType::FixedSizeList(item, options.classes.len().max(1) as i32);
        fields.push(Field::new("weights", list, true));
    }
    Schema::new(fields)
}

pub struct VerdictWriter {
    path: PathBuf,
    writer: ArrowWriter<File>,
    part: PartFile,
    file: File,
    schema: SchemaRef,
    options: TableOptions,
    outcomes: ArrayRef,
    reasons: ArrayRef,
    classes: ArrayRef,
    categories: ArrayRef,
    rows: u64,
}

impl VerdictWriter {
    pub fn create(path: &Path, options: TableOptions) -> Result<VerdictWriter, VerdictError> {
        let failed = |source| VerdictError::Write { path: path.into(), source };
        let (part, file) = PartFile::create(path).map_err(failed)?;
        let schema = Arc::new(schema(&options));
        let writer = ArrowWriter::try_new(
            file.try_clone().map_err(failed)?,
            schema.clone(),
            Some(properties()),
        )
        .map_err(|source| VerdictError::Parquet { path: path.into(), source })?;
        Ok(VerdictWriter {
            path: path.into(),
            writer,
            part,
            file,
            schema,
            outcomes: words(Outcome::ALL.iter().map(|o| o.as_str())),
            reasons: words(Reason::ALL.iter().map(|r| r.as_str())),
            classes: words(options.classes.iter().map(String::as_str)),
            categories: words(options.categories.iter().map(String::as_str)),
            options,
            rows: 0,
        })
    }

    pub fn rows(&self) -> u64 {
        self.rows
    }

    pub fn write(&mut self, columns: &VerdictColumns) -> Result<(), VerdictError> {
        let batch = self
            .batch(columns)
            .map_err(|source| VerdictError::Arrow { path: self.path.clone(), source })?;
        self.writer
            .write(&batch)
            .map_err(|source| VerdictError::Parquet { path: self.path.clone(), source })?;
        self.rows += columns.len() as u64;
        Ok(())
    }

    fn batch(&self, c: &VerdictColumns) -> Result<RecordBatch, ArrowError> {
        let times: ArrayRef = if self.options.microseconds {
            let us = c.acquired_at_ns.iter().map(|ns| ns.div_euclid(1000));
            Arc::new(TimestampMicrosecondArray::from_iter_values(us).with_timezone("UTC"))
        } else {
            let ns = c.acquired_at_ns.iter().copied();
            Arc::new(TimestampNanosecondArray::from_iter_values(ns).with_timezone("UTC"))
        };
        let of_class = |codes: &[Option<u16>], words: &ArrayRef| {
            coded(codes.iter().map(|c| c.map(i32::from)), words)
        };
        let floats = |v: &[Option<f32>]| -> ArrayRef {
            Arc::new(v.iter().copied().collect::<Float32Array>())
        };
        let mut arrays: Vec<ArrayRef> = vec![
            times,
            coded(
                c.printhead.iter().map(|&p| Some(p as i32)),
                &words(c.printheads.iter().map(|p| &**p)),
            )?,
            Arc::new(UInt32Array::from_iter_values(c.channel.iter().copied())),
            coded(c.outcome.iter().map(|o| Some(*o as i32)), &self.outcomes)?,
            of_class(&c.category, &self.categories)?,
            of_class(&c.fault, &self.classes)?,
            of_class(&c.candidate, &self.classes)?,
            floats(&c.certainty),
            floats(&c.statistic),
            floats(&c.threshold),
            floats(&c.severity),
            floats(&c.severity_sd),
            Arc::new(c.model.iter().copied().collect::<UInt16Array>()),
            coded(c.reason.iter().map(|r| r.map(|r| r as i32)), &self.reasons)?,
        ];
        if self.options.weights {
            arrays.push(self.weights(c));
        }
        RecordBatch::try_new(self.schema.clone(), arrays)
    }

    fn weights(&self, c: &VerdictColumns) -> ArrayRef {
        let n = self.options.classes.len();
        let mut list = FixedSizeListBuilder::new(Float32Builder::new(), n.max(1) as i32);
        for start in &c.weights_start {
            match start.and_then(|s| c.weights.get(s as usize..s as usize + n)).filter(|_| n > 0) {
                Some(weights) => list.values().append_slice(weights),
                None => list.values().append_nulls(n.max(1)),
            }
            list.append(start.is_some() && n > 0);
        }
        Arc::new(list.finish())
    }

    /// Adds the document and gives the file its name.
    pub fn finish(self, document: String) -> Result<(), VerdictError> {
        let VerdictWriter { path, mut writer, part, file, .. } = self;
        let parquet = |source| VerdictError::Parquet { path: path.clone(), source };
        writer.append_key_value_metadata(KeyValue::new(METADATA_KEY.to_owned(), document));
        writer.close().map_err(parquet)?;
        part.finish(&file).map_err(|source| VerdictError::Write { path: path.clone(), source })
    }
}

fn words<'a>(values: impl Iterator<Item = &'a str>) -> ArrayRef {
    Arc::new(StringArray::from_iter_values(values))
}

/// A dictionary column: codes into words, no string per row.
fn coded(
    codes: impl Iterator<Item = Option<i32>>,
    words: &ArrayRef,
) -> Result<ArrayRef, ArrowError> {
    let keys: Int32Array = codes.collect();
    Ok(Arc::new(DictionaryArray::<Int32Type>::try_new(keys, words.clone())?))
}

/// Row groups of about a million rows; floats and times are no dictionaries: they hardly repeat.
fn properties() -> WriterProperties {
    let level = ZstdLevel::try_new(1).unwrap_or_default();
    let mut properties = WriterProperties::builder()
        .set_compression(Compression::ZSTD(level))
        .set_max_row_group_row_count(Some(1 << 20))
        .set_statistics_enabled(EnabledStatistics::Chunk);
    for (column, encoding) in [
        ("acquired_at", Encoding::DELTA_BINARY_PACKED),
        ("channel", Encoding::DELTA_BINARY_PACKED),
        ("statistic", Encoding::BYTE_STREAM_SPLIT),
    ] {
        let column = ColumnPath::from(column);
        properties = properties
            .set_column_dictionary_enabled(column.clone(), false)
            .set_column_encoding(column, encoding);
    }
    properties.build()
}
