//! Verdicts to a Parquet file: the verdict table of the contract (`schemas/verdicts.md`).
//!
//! In: verdict columns, batch by batch in the recording's order; at the end the metadata document.
//! Out: `<stem>.verdicts.parquet`, under its name once it is complete. No string is made per row.

use super::part_file::{CompleteFile, PartFile};
use super::run_column::{self, RunColumn};
use crate::verdict::{Outcome, Reason, Test, VerdictColumns};
use arrow_array::{
    ArrayRef, FixedSizeListArray, Float32Array, TimestampMicrosecondArray,
    TimestampNanosecondArray, UInt32Array,
};
use arrow_buffer::{BooleanBuffer, NullBuffer};
use arrow_schema::{ArrowError, DataType, Field, Schema, SchemaRef, TimeUnit};
use parquet::arrow::ArrowWriter;
use parquet::arrow::arrow_writer::{ArrowColumnWriter, ArrowRowGroupWriterFactory, compute_leaves};
use parquet::basic::{Compression, Encoding, ZstdLevel};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::ColumnPath;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use thiserror::Error;

/// Key of the file's metadata document.
pub const METADATA_KEY: &str = "inkling";
const ROW_GROUP_ROWS: usize = 1 << 20;
/// A row group that takes this much memory is ended early.
const MOST_HELD_BYTES: usize = 128 << 20;

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
        nullable("test", text()),
        nullable("misfit", DataType::Float32),
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
        // of no use without statistics per page
        .set_offset_index_disabled(true)
        .set_max_row_group_row_count(Some(ROW_GROUP_ROWS));
    for name in ["acquired_at", "channel"] {
        properties = properties
            .set_column_dictionary_enabled(column(name), false)
            .set_column_encoding(column(name), Encoding::DELTA_BINARY_PACKED);
    }
    let floats = match unit {
        TimestampUnit::Ns => Encoding::BYTE_STREAM_SPLIT,
        TimestampUnit::Us => Encoding::PLAIN,
    };
    let weights = "weights.list.element";
    for name in ["certainty", "statistic", "misfit", "severity", "severity_sd", weights] {
        let parts = name.split('.').map(String::from).collect::<Vec<_>>();
        properties = properties
            .set_column_dictionary_enabled(ColumnPath::new(parts.clone()), false)
            .set_column_encoding(ColumnPath::new(parts), floats);
    }
    properties.build()
}

pub struct VerdictWriter {
    file: SerializedFileWriter<BufWriter<File>>,
    factory: ArrowRowGroupWriterFactory,
    part: PartFile,
    schema: SchemaRef,
    options: TableOptions,
    group: Option<RowGroup>,
    groups: usize,
    rows: u64,
}

/// A row group under way.
struct RowGroup {
    /// In the table's order.
    columns: Vec<Column>,
    rows: usize,
}

/// Columns that are the same over many rows are written by runs, the others value by value.
enum Column {
    Runs(Box<RunColumn>),
    Values(Box<ArrowColumnWriter>),
}

/// Pushes a batch's runs onto their column.
type PushRuns<'a> = Box<dyn Fn(&mut RunColumn) -> Result<(), ParquetError> + 'a>;

/// What a batch has for a column.
enum Part<'a> {
    Runs(PushRuns<'a>),
    Values(ArrayRef),
}

impl VerdictWriter {
    pub fn create(path: &Path, options: TableOptions) -> Result<VerdictWriter, TableError> {
        let (part, file) = PartFile::create(path)
            .map_err(|source| TableError::Io { path: path.to_path_buf(), source })?;
        let schema = Arc::new(schema(&options));
        let properties = properties(options.timestamp_unit);
        let (file, factory) =
            ArrowWriter::try_new(BufWriter::new(file), schema.clone(), Some(properties))
                .and_then(ArrowWriter::into_serialized_writer)
                .map_err(|source| TableError::Parquet { path: path.to_path_buf(), source })?;
        Ok(VerdictWriter { file, factory, part, schema, options, group: None, groups: 0, rows: 0 })
    }

    /// Appends a batch of verdicts.
    pub fn write(&mut self, columns: &VerdictColumns) -> Result<(), TableError> {
        let path = self.path();
        let failed = |source| TableError::Parquet { path: path.clone(), source };
        let unfit = |source| TableError::Columns { path: path.clone(), source };
        check_lengths(columns).map_err(unfit)?;
        let mut group = match self.group.take() {
            Some(group) => group,
            None => self.new_group().map_err(failed)?,
        };
        let parts = self.parts(columns).map_err(unfit)?;
        for ((column, part), field) in group.columns.iter_mut().zip(parts).zip(self.schema.fields())
        {
            match (column, part) {
                (Column::Runs(column), Part::Runs(push)) => {
                    push(column)
                        .map_err(|e| unfit(ArrowError::InvalidArgumentError(e.to_string())))?;
                }
                (Column::Values(column), Part::Values(array)) => {
                    for leaf in compute_leaves(field, &array).map_err(failed)? {
                        column.write(&leaf).map_err(failed)?;
                    }
                }
                _ => unreachable!("`new_group` and `parts` name the same columns"),
            }
        }
        group.rows += columns.len();
        self.rows += columns.len() as u64;
        let held = group.columns.iter().map(Column::memory).sum::<usize>();
        if group.rows >= ROW_GROUP_ROWS || held >= MOST_HELD_BYTES {
            self.end_group(group).map_err(failed)?;
        } else if group.rows > 0 {
            self.group = Some(group);
        }
        Ok(())
    }

    pub fn rows(&self) -> u64 {
        self.rows
    }

    /// Completes the file with its metadata document; it still has to get its name.
    pub fn complete(mut self, metadata_json: String) -> Result<CompleteFile, TableError> {
        let path = self.path();
        let parquet_failed = |source| TableError::Parquet { path: path.clone(), source };
        let io_failed = |source| TableError::Io { path: path.clone(), source };
        if let Some(group) = self.group.take() {
            self.end_group(group).map_err(parquet_failed)?;
        }
        self.file.append_key_value_metadata(KeyValue::new(METADATA_KEY.to_string(), metadata_json));
        // Writes the footer too.
        let file = self.file.into_inner().map_err(parquet_failed)?;
        let file = file.into_inner().map_err(|e| io_failed(e.into_error()))?;
        self.part.complete(&file).map_err(io_failed)
    }

    /// The same, and gives it its name.
    pub fn finish(self, metadata_json: String) -> Result<(), TableError> {
        let path = self.path();
        let named = self.complete(metadata_json)?.name();
        named.map_err(|source| TableError::Io { path, source })
    }

    fn path(&self) -> PathBuf {
        self.part.path().to_path_buf()
    }

    fn new_group(&mut self) -> Result<RowGroup, ParquetError> {
        let writers = self.factory.create_column_writers(self.groups)?;
        let of_schema = self.file.schema_descr();
        let texts = |of: &[String]| of.iter().map(|v| run_column::text(v)).collect::<Vec<_>>();
        let columns = writers.into_iter().zip(self.schema.fields()).enumerate();
        let columns = columns.map(|(k, (values, field))| {
            let known = match field.name().as_str() {
                "printhead" | "threshold" | "model" => Vec::new(),
                "outcome" => Outcome::ALL.map(|o| run_column::text(o.as_str())).to_vec(),
                "test" => Test::ALL.map(|t| run_column::text(t.as_str())).to_vec(),
                "reason" => Reason::ALL.map(|r| run_column::text(r.as_str())).to_vec(),
                "category" => texts(&self.options.categories),
                "fault" | "candidate" => texts(&self.options.classes),
                _ => return Column::Values(Box::new(values)),
            };
            Column::Runs(Box::new(RunColumn::new(of_schema.column(k), known.into_iter())))
        });
        Ok(RowGroup { columns: columns.collect(), rows: 0 })
    }

    fn end_group(&mut self, group: RowGroup) -> Result<(), ParquetError> {
        let mut out = self.file.next_row_group()?;
        for (column, field) in group.columns.into_iter().zip(self.schema.fields()) {
            match column {
                // what is worth skipping row groups by: when, where, how much
                Column::Runs(column) => column.append_to(&mut out, field.name() == "printhead")?,
                Column::Values(column) => column.close()?.append_to_row_group(&mut out)?,
            }
        }
        out.close()?;
        self.groups += 1;
        Ok(())
    }

    /// Of a batch, in the table's order.
    fn parts<'a>(&self, c: &'a VerdictColumns) -> Result<Vec<Part<'a>>, ArrowError> {
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
        let floats = |of: &[Option<f32>]| -> Part {
            let (values, valid) = columnar(of);
            Part::Values(Arc::new(Float32Array::new(values.into(), valid)))
        };
        let mut parts = vec![
            Part::Values(times),
            Part::Runs(Box::new(|column| push_printheads(c, column))),
            Part::Values(Arc::new(UInt32Array::from(c.channel.clone()))),
            runs(&c.outcome, |&o, _| Some(o as u32)),
            runs(&c.category, |&k, _| k.map(u32::from)),
            runs(&c.fault, |&k, _| k.map(u32::from)),
            runs(&c.candidate, |&k, _| k.map(u32::from)),
            floats(&c.certainty),
            floats(&c.statistic),
            runs(&c.threshold, |v, column| v.map(|v| column.key(&v.to_le_bytes()))),
            runs(&c.test, |t, _| t.map(|t| t as u32)),
            floats(&c.misfit),
            floats(&c.severity),
            floats(&c.severity_sd),
            // Parquet has no 16-bit integers
            runs(&c.model, |m, column| m.map(|m| column.key(&i32::from(m).to_le_bytes()))),
            runs(&c.reason, |r, _| r.map(|r| r as u32)),
        ];
        if has_weights(&self.options) {
            parts.push(Part::Values(weights(c, self.options.classes.len())?));
        }
        Ok(parts)
    }
}

impl Column {
    /// Bytes held, about.
    fn memory(&self) -> usize {
        match self {
            Column::Runs(column) => column.memory(),
            Column::Values(column) => column.memory_size(),
        }
    }
}

/// The runs of a column of a batch; `key` of a value in the dictionary.
fn runs<'a, T: PartialEq>(
    of: &'a [T],
    key: impl Fn(&T, &mut RunColumn) -> Option<u32> + 'a,
) -> Part<'a> {
    Part::Runs(Box::new(move |column| {
        of.chunk_by(|p, q| p == q).try_for_each(|run| {
            let key = key(&run[0], column);
            column.push(key, run.len())
        })
    }))
}

/// Printheads by name: a batch numbers its own.
fn push_printheads(c: &VerdictColumns, column: &mut RunColumn) -> Result<(), ParquetError> {
    let mut keys: Vec<Option<u32>> = vec![None; c.printheads.len()];
    c.printhead.chunk_by(|p, q| p == q).try_for_each(|run| {
        let place = run[0] as usize;
        let (Some(name), Some(key)) = (c.printheads.get(place), keys.get_mut(place)) else {
            let known = c.printheads.len();
            return Err(ParquetError::General(format!("printhead {place} of {known}")));
        };
        let key = *key.get_or_insert_with(|| column.key(&run_column::text(name)));
        column.push(Some(key), run.len())
    })
}

fn check_lengths(c: &VerdictColumns) -> Result<(), ArrowError> {
    let lengths = [
        c.printhead.len(),
        c.channel.len(),
        c.outcome.len(),
        c.category.len(),
        c.fault.len(),
        c.candidate.len(),
        c.certainty.len(),
        c.statistic.len(),
        c.threshold.len(),
        c.test.len(),
        c.misfit.len(),
        c.severity.len(),
        c.severity_sd.len(),
        c.model.len(),
        c.reason.len(),
    ];
    match lengths.iter().all(|&n| n == c.len()) {
        true => Ok(()),
        false => Err(ArrowError::InvalidArgumentError(format!(
            "columns of {lengths:?} rows beside {} times",
            c.len()
        ))),
    }
}

/// Values, and which of them are there; `None` where all are. Without a branch per row: most columns
/// are all one or all the other.
fn columnar(of: &[Option<f32>]) -> (Vec<f32>, Option<NullBuffer>) {
    let values = of.iter().map(|v| v.unwrap_or_default()).collect();
    let missing = of.iter().filter(|v| v.is_none()).count();
    let valid = match missing {
        0 => None,
        n if n == of.len() => Some(NullBuffer::new_null(n)),
        _ => Some(NullBuffer::new(BooleanBuffer::collect_bool(of.len(), |i| of[i].is_some()))),
    };
    (values, valid)
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
            c.test.push((i % 4 > 0).then_some(Test::ALL[k % 3]));
            c.misfit.push(some(6));
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
        assert!(Test::ALL.iter().enumerate().all(|(i, &t)| t as usize == i));
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
            assert_eq!(std::fs::read_dir(path.parent().unwrap()).unwrap().count(), 1);

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
