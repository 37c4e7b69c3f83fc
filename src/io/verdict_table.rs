//! Verdicts to a Parquet file: the verdict table of the contract (`schemas/verdicts.md`).
//!
//! In: verdict columns, batch by batch in the recording's order; at the end the metadata document.
//! Out: `<stem>.verdicts.parquet`, under its name once it is complete. No string is made per row.

use super::part_file::PartFile;
use crate::verdict::{Outcome, Reason, VerdictColumns};
use arrow_array::types::Int32Type;
use arrow_array::{
    ArrayRef, DictionaryArray, FixedSizeListArray, Float32Array, Int32Array, RecordBatch,
    StringArray, TimestampMicrosecondArray, TimestampNanosecondArray, UInt16Array, UInt32Array,
};
use arrow_buffer::{BooleanBuffer, NullBuffer};
use arrow_schema::{ArrowError, DataType, Field, Schema, SchemaRef, TimeUnit};
use parquet::arrow::ArrowWriter;
use parquet::basic::{Compression, Encoding, ZstdLevel};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::schema::types::ColumnPath;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use thiserror::Error;

/// Key of the file's metadata document.
pub const METADATA_KEY: &str = "inkling";
const ROW_GROUP_ROWS: usize = 1 << 20;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TimestampUnit {
    Ns,
    /// For readers without nanoseconds (Spark); its vectorised reader does not know the float
    /// encoding of the other either, so floats are plain then.
    Us,
}

#[derive(Clone, Debug)]
pub struct TableOptions {
    /// What `fault` and `candidate` index, and the order of the weights.
    pub classes: Vec<String>,
    /// What `category` indexes.
    pub categories: Vec<String>,
    pub weights: bool,
    pub timestamp_unit: TimestampUnit,
}

#[derive(Debug, Error)]
pub enum TableError {
    #[error("{path}: {source}")]
    Io { path: PathBuf, source: std::io::Error },
    #[error("{path}: damaged Parquet file; replay the recording again")]
    Damaged { path: PathBuf },
    #[error("{path}: Parquet: {source}")]
    Parquet { path: PathBuf, source: ParquetError },
    #[error("{path}: verdict columns do not fit each other: {source}")]
    Columns { path: PathBuf, source: ArrowError },
    #[error("{path}: not a verdict table: column `{column}` {what}")]
    Column { path: PathBuf, column: &'static str, what: String },
    #[error("{path}: not an episode table: {what}")]
    NotEpisodes { path: PathBuf, what: String },
}

/// The table's columns as Arrow sees them.
pub fn schema(options: &TableOptions) -> Schema {
    let text = || DataType::Dictionary(Box::new(DataType::Int32), Box::new(DataType::Utf8));
    let unit = match options.timestamp_unit {
        TimestampUnit::Ns => TimeUnit::Nanosecond,
        TimestampUnit::Us => TimeUnit::Microsecond,
    };
    let required = |name, data_type| Field::new(name, data_type, false);
    let nullable = |name, data_type| Field::new(name, data_type, true);
    let mut fields = vec![
        required("acquired_at", DataType::Timestamp(unit, Some("UTC".into()))),
        required("printhead", text()),
        required("channel", DataType::UInt32),
        required("outcome", text()),
        nullable("category", text()),
        nullable("fault", text()),
        nullable("candidate", text()),
        nullable("certainty", DataType::Float32),
        nullable("statistic", DataType::Float32),
        nullable("threshold", DataType::Float32),
        nullable("severity", DataType::Float32),
        nullable("severity_sd", DataType::Float32),
        nullable("model", DataType::UInt16),
        nullable("reason", text()),
    ];
    if has_weights(options) {
        let list = DataType::FixedSizeList(weight_field(), options.classes.len() as i32);
        fields.push(nullable("weights", list));
    }
    Schema::new(fields)
}

/// Without classes there is nothing to weigh.
fn has_weights(options: &TableOptions) -> bool {
    options.weights && !options.classes.is_empty()
}

fn weight_field() -> Arc<Field> {
    Arc::new(Field::new("element", DataType::Float32, false))
}

fn properties(unit: TimestampUnit) -> WriterProperties {
    let column = |name: &str| ColumnPath::from(name);
    let mut properties = WriterProperties::builder()
        .set_compression(Compression::ZSTD(ZstdLevel::default()))
        .set_statistics_enabled(EnabledStatistics::Chunk)
        .set_max_row_group_row_count(Some(ROW_GROUP_ROWS));
    for name in ["acquired_at", "channel", "model"] {
        properties = properties
            .set_column_dictionary_enabled(column(name), false)
            .set_column_encoding(column(name), Encoding::DELTA_BINARY_PACKED);
    }
    // what is worth skipping row groups by: when, where, how much
    for name in ["outcome", "category", "fault", "candidate", "reason", "threshold", "model"] {
        properties =
            properties.set_column_statistics_enabled(column(name), EnabledStatistics::None);
    }
    let floats = match unit {
        TimestampUnit::Ns => Encoding::BYTE_STREAM_SPLIT,
        TimestampUnit::Us => Encoding::PLAIN,
    };
    let weights = "weights.list.element";
    for name in ["certainty", "statistic", "threshold", "severity", "severity_sd", weights] {
        let parts = name.split('.').map(String::from).collect::<Vec<_>>();
        properties = properties
            .set_column_dictionary_enabled(ColumnPath::new(parts.clone()), false)
            .set_column_encoding(ColumnPath::new(parts), floats);
    }
    properties.build()
}

pub struct VerdictWriter {
    writer: ArrowWriter<BufWriter<File>>,
    part: PartFile,
    schema: SchemaRef,
    options: TableOptions,
    outcomes: ArrayRef,
    reasons: ArrayRef,
    classes: ArrayRef,
    categories: ArrayRef,
    rows: u64,
}

impl VerdictWriter {
    pub fn create(path: &Path, options: TableOptions) -> Result<VerdictWriter, TableError> {
        let (part, file) = PartFile::create(path)
            .map_err(|source| TableError::Io { path: path.to_path_buf(), source })?;
        let schema = Arc::new(schema(&options));
        let properties = properties(options.timestamp_unit);
        let writer = ArrowWriter::try_new(BufWriter::new(file), schema.clone(), Some(properties))
            .map_err(|source| TableError::Parquet { path: path.to_path_buf(), source })?;
        Ok(VerdictWriter {
            writer,
            part,
            schema,
            outcomes: texts(Outcome::ALL.iter().map(|o| o.as_str())),
            reasons: texts(Reason::ALL.iter().map(|r| r.as_str())),
            classes: texts(options.classes.iter().map(String::as_str)),
            categories: texts(options.categories.iter().map(String::as_str)),
            options,
            rows: 0,
        })
    }

    /// Appends a batch of verdicts.
    pub fn write(&mut self, columns: &VerdictColumns) -> Result<(), TableError> {
        let batch = self
            .batch(columns)
            .map_err(|source| TableError::Columns { path: self.path(), source })?;
        self.writer
            .write(&batch)
            .map_err(|source| TableError::Parquet { path: self.path(), source })?;
        self.rows += columns.len() as u64;
        Ok(())
    }

    pub fn rows(&self) -> u64 {
        self.rows
    }

    /// Completes the file with its metadata document and gives it its name.
    pub fn finish(mut self, metadata_json: String) -> Result<(), TableError> {
        self.writer
            .append_key_value_metadata(KeyValue::new(METADATA_KEY.to_string(), metadata_json));
        let path = self.path();
        let parquet_failed = |source| TableError::Parquet { path: path.clone(), source };
        let io_failed = |source| TableError::Io { path: path.clone(), source };
        // Writes the footer too.
        let file = self.writer.into_inner().map_err(parquet_failed)?;
        let file = file.into_inner().map_err(|e| io_failed(e.into_error()))?;
        self.part.finish(&file).map_err(io_failed)
    }

    fn path(&self) -> PathBuf {
        self.part.path().to_path_buf()
    }

    fn batch(&self, c: &VerdictColumns) -> Result<RecordBatch, ArrowError> {
        let times: ArrayRef = match self.options.timestamp_unit {
            TimestampUnit::Ns => {
                let ns = TimestampNanosecondArray::from(c.acquired_at_ns.clone());
                Arc::new(ns.with_timezone("UTC"))
            }
            TimestampUnit::Us => {
                let us: Vec<i64> = c.acquired_at_ns.iter().map(|t| t.div_euclid(1000)).collect();
                Arc::new(TimestampMicrosecondArray::from(us).with_timezone("UTC"))
            }
        };
        let printheads = texts(c.printheads.iter().map(|p| &**p));
        let class = |of: &[Option<u16>]| coded(keys(of, |&c| c.into()), &self.classes);
        let floats = |of: &[Option<f32>]| -> ArrayRef {
            let (values, valid) = columnar(of, |&v| v);
            Arc::new(Float32Array::new(values.into(), valid))
        };
        let (models, has_model) = columnar(&c.model, |&m| m);
        let printhead_keys = c.printhead.iter().map(|&p| i32::try_from(p).unwrap_or(-1));
        let outcome_keys = c.outcome.iter().map(|&o| o as i32);
        let mut columns = vec![
            times,
            coded(Int32Array::from_iter_values(printhead_keys), &printheads)?,
            Arc::new(UInt32Array::from(c.channel.clone())),
            coded(Int32Array::from_iter_values(outcome_keys), &self.outcomes)?,
            coded(keys(&c.category, |&c| c.into()), &self.categories)?,
            class(&c.fault)?,
            class(&c.candidate)?,
            floats(&c.certainty),
            floats(&c.statistic),
            floats(&c.threshold),
            floats(&c.severity),
            floats(&c.severity_sd),
            Arc::new(UInt16Array::new(models.into(), has_model)),
            coded(keys(&c.reason, |&r| r as i32), &self.reasons)?,
        ];
        if has_weights(&self.options) {
            columns.push(weights(c, self.options.classes.len())?);
        }
        RecordBatch::try_new(self.schema.clone(), columns)
    }
}

fn texts<'a>(of: impl Iterator<Item = &'a str>) -> ArrayRef {
    Arc::new(StringArray::from_iter_values(of))
}

/// Values, and which of them are there; `None` where all are. Without a branch per row: most columns
/// are all one or all the other.
fn columnar<T, V: Default>(
    of: &[Option<T>],
    value: impl Fn(&T) -> V,
) -> (Vec<V>, Option<NullBuffer>) {
    let values = of.iter().map(|v| v.as_ref().map(&value).unwrap_or_default()).collect();
    let missing = of.iter().filter(|v| v.is_none()).count();
    let valid = match missing {
        0 => None,
        n if n == of.len() => Some(NullBuffer::new_null(n)),
        _ => Some(NullBuffer::new(BooleanBuffer::collect_bool(of.len(), |i| of[i].is_some()))),
    };
    (values, valid)
}

fn keys<T>(of: &[Option<T>], key: impl Fn(&T) -> i32) -> Int32Array {
    let (keys, valid) = columnar(of, key);
    Int32Array::new(keys.into(), valid)
}

/// Keys into `values`; keys beyond them are an error.
fn coded(keys: Int32Array, values: &ArrayRef) -> Result<ArrayRef, ArrowError> {
    Ok(Arc::new(DictionaryArray::<Int32Type>::try_new(keys, values.clone())?))
}

/// `classes` weights per row; no weights at all: every row is null.
fn weights(c: &VerdictColumns, classes: usize) -> Result<ArrayRef, ArrowError> {
    let mut values = Vec::with_capacity(c.len() * classes);
    let mut valid = Vec::with_capacity(c.len());
    for row in 0..c.len() {
        let start = c.weights_start.get(row).copied().flatten().map(|start| start as usize);
        match start.map(|start| c.weights.get(start..start + classes)) {
            Some(Some(of_row)) => values.extend_from_slice(of_row),
            None => values.resize(values.len() + classes, 0.0),
            Some(None) => {
                let what = format!("weights of row {row} lie beyond the weights");
                return Err(ArrowError::InvalidArgumentError(what));
            }
        }
        valid.push(start.is_some());
    }
    let values = Arc::new(Float32Array::from(values));
    let valid = Some(NullBuffer::from(valid));
    let list = FixedSizeListArray::try_new(weight_field(), classes as i32, values, valid)?;
    Ok(Arc::new(list))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::io::verdict_reader::VerdictReader;

    pub(in crate::io) fn options(weights: bool, timestamp_unit: TimestampUnit) -> TableOptions {
        let list = |of: &[&str]| of.iter().map(|s| s.to_string()).collect();
        TableOptions {
            classes: list(&["EC", "AB1", "my,own"]),
            categories: list(&["empty_channel", "air_bubble"]),
            weights,
            timestamp_unit,
        }
    }

    /// Rows with every outcome, reason and pattern of nulls, numbered from `from`.
    pub(in crate::io) fn columns(from: u32, rows: u32, printheads: &[&str]) -> VerdictColumns {
        let printheads: Vec<Arc<str>> = printheads.iter().map(|&p| p.into()).collect();
        let mut c = VerdictColumns { printheads: printheads.clone(), ..Default::default() };
        for i in from..from + rows {
            let k = i as usize;
            let some = |n: u32| (i % n == 0).then_some(i as f32 / 7.0);
            c.acquired_at_ns.push(1_700_000_000_123_456_000 + i64::from(i) * 1000);
            c.printhead.push(i % printheads.len() as u32);
            c.channel.push(if i == from { u32::MAX } else { i });
            c.outcome.push(Outcome::ALL[k % 4]);
            c.category.push((i % 3 > 0).then_some((i % 2) as u16));
            c.fault.push((i % 4 > 0).then_some((i % 3) as u16));
            c.candidate.push((i % 5 > 0).then_some((i % 3) as u16));
            c.certainty.push(some(2));
            c.statistic.push(some(3));
            c.threshold.push(some(1));
            c.severity.push(some(4));
            c.severity_sd.push(some(5));
            c.model.push((i % 2 > 0).then_some((i % 65_536) as u16));
            c.reason.push((i % 6 > 0).then_some(Reason::ALL[k % Reason::ALL.len()]));
            c.weights_start.push((i % 3 > 0).then_some(c.weights.len() as u32));
            if i % 3 > 0 {
                c.weights.extend([i as f32, 0.25, -1.0]);
            }
        }
        c
    }

    #[test]
    fn keys_of_outcomes_and_reasons_are_their_places() {
        assert!(Outcome::ALL.iter().enumerate().all(|(i, &o)| o as usize == i));
        assert!(Reason::ALL.iter().enumerate().all(|(i, &r)| r as usize == i));
    }

    #[test]
    fn rows_written_are_rows_read_back_over_batches_with_other_printheads() {
        let dir = tempfile::tempdir().unwrap();
        for (with_weights, unit) in [(false, TimestampUnit::Ns), (true, TimestampUnit::Us)] {
            let path = dir.path().join(format!("{with_weights}/r.verdicts.parquet"));
            let mut writer = VerdictWriter::create(&path, options(with_weights, unit)).unwrap();
            let batches = [
                columns(0, 1000, &["K1", "K2"]),
                columns(1000, 777, &["K3"]),
                columns(5, 0, &["x"]),
            ];
            for batch in &batches {
                writer.write(batch).unwrap();
            }
            assert_eq!(writer.rows(), 1777);
            assert!(!path.exists());
            writer.finish(r#"{"classes":["EC","AB1","my,own"]}"#.into()).unwrap();
            assert!(path.exists() && !path.with_extension("parquet.part").exists());

            let reader = VerdictReader::open(&path).unwrap();
            assert_eq!(reader.metadata_json(), Some(r#"{"classes":["EC","AB1","my,own"]}"#));
            let (rows, lists) = crate::io::verdict_reader::tests::rows(reader);
            let expected: Vec<String> = batches
                .iter()
                .flat_map(|b| crate::io::verdict_reader::tests::row_texts(b, &options(false, unit)))
                .map(
                    |row| {
                        if with_weights {
                            row
                        } else {
                            row.split(" weights").next().unwrap().into()
                        }
                    },
                )
                .collect();
            let found: Vec<String> =
                rows.iter()
                    .flat_map(|b| crate::io::verdict_reader::tests::row_texts(b, &lists))
                    .map(|row| {
                        if with_weights {
                            row
                        } else {
                            row.split(" weights").next().unwrap().into()
                        }
                    })
                    .collect();
            assert_eq!(found, expected);
        }
        let path = dir.path().join("dropped/r.verdicts.parquet");
        drop(VerdictWriter::create(&path, options(false, TimestampUnit::Ns)).unwrap());
        assert_eq!(std::fs::read_dir(dir.path().join("dropped")).unwrap().count(), 0);
    }

    #[test]
    fn columns_that_do_not_fit_are_an_error() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("r.parquet");
        type Change = fn(&mut VerdictColumns);
        let changes: [Change; 5] = [
            |c| c.severity.truncate(3),
            |c| c.fault[1] = Some(3),
            |c| c.category[1] = Some(2),
            |c| c.printhead[1] = u32::MAX,
            |c| c.weights.truncate(1),
        ];
        for change in changes {
            let mut writer =
                VerdictWriter::create(&path, options(true, TimestampUnit::Ns)).unwrap();
            let mut wrong = columns(0, 10, &["K"]);
            change(&mut wrong);
            assert!(matches!(writer.write(&wrong), Err(TableError::Columns { .. })));
        }
        assert!(!path.exists());
    }

    /// The documented table is the Arrow schema.
    #[test]
    fn schemas_verdicts_md_is_the_schema_in_code() {
        let doc = include_str!("../../schemas/verdicts.md");
        let documented: Vec<(String, String)> = doc
            .lines()
            .filter_map(|line| {
                let mut cells = line.strip_prefix("| `")?.split(" | ");
                let name = cells.next()?.trim_end_matches('`').to_string();
                Some((name, cells.next()?.to_string()))
            })
            .collect();
        let in_code: Vec<(String, String)> = schema(&options(true, TimestampUnit::Ns))
            .fields()
            .iter()
            .map(|field| {
                let kind = match field.data_type() {
                    DataType::Timestamp(TimeUnit::Nanosecond, Some(zone)) => {
                        format!("timestamp(ns, {zone})")
                    }
                    DataType::Dictionary(_, of) if **of == DataType::Utf8 => {
                        "dictionary of utf8".into()
                    }
                    DataType::FixedSizeList(..) => "fixed-size list of float32".into(),
                    plain => plain.to_string().to_lowercase(),
                };
                let nullable = if field.is_nullable() { ", nullable" } else { "" };
                (field.name().clone(), kind + nullable)
            })
            .collect();
        assert_eq!(documented, in_code);
    }
}
