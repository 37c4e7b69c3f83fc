//! Episodes to a Parquet file and back: the episode table of the contract (`schemas/episodes.md`).
//!
//! In: episodes as they end; at the end the metadata document. Out: `<stem>.episodes.parquet`, under
//! its name once it is complete; for `score`, its rows again.

use super::part_file::{CompleteFile, PartFile};
use super::regular_file;
use super::verdict_reader::{plain_texts, timestamps_ns, unpanicked};
use super::verdict_table::{METADATA_KEY, TableError, TimestampUnit};
use crate::episodes::Episode;
use arrow_array::builder::StringDictionaryBuilder;
use arrow_array::types::Int32Type;
use arrow_array::{
    ArrayRef, Float32Array, RecordBatch, StringArray, TimestampMicrosecondArray,
    TimestampNanosecondArray, UInt32Array,
};
use arrow_schema::{ArrowError, DataType, Field, Schema, SchemaRef, TimeUnit};
use parquet::arrow::ArrowWriter;
use parquet::arrow::arrow_reader::{ArrowReaderOptions, ParquetRecordBatchReaderBuilder};
use parquet::basic::{Compression, ZstdLevel};
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Episodes that wait for their row group.
const BATCH_ROWS: usize = 8192;
/// Rows that a reader accepts: more episodes are no table of ours.
const MOST_ROWS: usize = 1 << 24;

/// The table's columns as Arrow sees them.
pub fn schema(unit: TimestampUnit) -> Schema {
    let text = || DataType::Dictionary(Box::new(DataType::Int32), Box::new(DataType::Utf8));
    let unit = match unit {
        TimestampUnit::Ns => TimeUnit::Nanosecond,
        TimestampUnit::Us => TimeUnit::Microsecond,
    };
    let time = || DataType::Timestamp(unit, Some("UTC".into()));
    let required = |name, data_type| Field::new(name, data_type, false);
    let nullable = |name, data_type| Field::new(name, data_type, true);
    Schema::new(vec![
        required("printhead", text()),
        required("channel", DataType::UInt32),
        nullable("category", text()),
        nullable("fault", text()),
        required("raised_at", time()),
        required("began_at", time()),
        nullable("ended_at", time()),
        required("bursts", DataType::UInt32),
        nullable("certainty", DataType::Float32),
        nullable("severity_first", DataType::Float32),
        nullable("severity_max", DataType::Float32),
        nullable("severity_last", DataType::Float32),
        nullable("severity_sd", DataType::Float32),
        required("explanation", DataType::Utf8),
    ])
}

pub struct EpisodeWriter {
    writer: ArrowWriter<BufWriter<File>>,
    part: PartFile,
    schema: SchemaRef,
    unit: TimestampUnit,
    waiting: Vec<Episode>,
}

impl EpisodeWriter {
    pub fn create(path: &Path, unit: TimestampUnit) -> Result<EpisodeWriter, TableError> {
        let (part, file) = PartFile::create(path)
            .map_err(|source| TableError::Io { path: path.to_path_buf(), source })?;
        let schema = Arc::new(schema(unit));
        let properties = WriterProperties::builder()
            .set_compression(Compression::ZSTD(ZstdLevel::default()))
            .build();
        let writer = ArrowWriter::try_new(BufWriter::new(file), schema.clone(), Some(properties))
            .map_err(|source| TableError::Parquet { path: path.to_path_buf(), source })?;
        Ok(EpisodeWriter { writer, part, schema, unit, waiting: Vec::new() })
    }

    pub fn write(&mut self, episodes: Vec<Episode>) -> Result<(), TableError> {
        self.waiting.extend(episodes);
        if self.waiting.len() >= BATCH_ROWS { self.flush() } else { Ok(()) }
    }

    fn flush(&mut self) -> Result<(), TableError> {
        let path = self.part.path().to_path_buf();
        let batch = batch(&self.schema, self.unit, &self.waiting)
            .map_err(|source| TableError::Columns { path: path.clone(), source })?;
        self.waiting.clear();
        self.writer.write(&batch).map_err(|source| TableError::Parquet { path, source })
    }

    /// Completes the file with its metadata document; it still has to get its name.
    pub fn complete(mut self, metadata_json: String) -> Result<CompleteFile, TableError> {
        self.flush()?;
        self.writer.append_key_value_metadata(KeyValue::new(METADATA_KEY.into(), metadata_json));
        let path = self.part.path().to_path_buf();
        let parquet_failed = |source| TableError::Parquet { path: path.clone(), source };
        let io_failed = |source| TableError::Io { path: path.clone(), source };
        let file = self.writer.into_inner().map_err(parquet_failed)?;
        let file = file.into_inner().map_err(|e| io_failed(e.into_error()))?;
        self.part.complete(&file).map_err(io_failed)
    }
}

fn batch(
    schema: &SchemaRef,
    unit: TimestampUnit,
    rows: &[Episode],
) -> Result<RecordBatch, ArrowError> {
    let texts = |of: &dyn Fn(&Episode) -> Option<String>| -> ArrayRef {
        let mut builder = StringDictionaryBuilder::<Int32Type>::new();
        rows.iter().for_each(|e| builder.append_option(of(e)));
        Arc::new(builder.finish())
    };
    let times = |of: &dyn Fn(&Episode) -> Option<i64>| -> ArrayRef {
        match unit {
            TimestampUnit::Ns => {
                let ns: TimestampNanosecondArray = rows.iter().map(of).collect();
                Arc::new(ns.with_timezone("UTC"))
            }
            TimestampUnit::Us => {
                let us = rows.iter().map(|e| of(e).map(|t| t.div_euclid(1000)));
                let us: TimestampMicrosecondArray = us.collect();
                Arc::new(us.with_timezone("UTC"))
            }
        }
    };
    let floats = |of: &dyn Fn(&Episode) -> Option<f64>| -> ArrayRef {
        Arc::new(rows.iter().map(|e| of(e).map(|v| v as f32)).collect::<Float32Array>())
    };
    let count = |n: u64| u32::try_from(n).unwrap_or(u32::MAX);
    RecordBatch::try_new(
        schema.clone(),
        vec![
            texts(&|e| Some(e.printhead.to_string())),
            Arc::new(UInt32Array::from_iter_values(rows.iter().map(|e| e.channel))),
            texts(&|e| e.category.clone()),
            texts(&|e| e.fault.clone()),
            times(&|e| Some(e.raised_at_ns)),
            times(&|e| Some(e.began_at_ns)),
            times(&|e| e.ended_at_ns),
            Arc::new(UInt32Array::from_iter_values(rows.iter().map(|e| count(e.bursts)))),
            floats(&|e| e.certainty),
            floats(&|e| e.severity_first),
            floats(&|e| e.severity_max),
            floats(&|e| e.severity_last),
            floats(&|e| e.severity_sd),
            Arc::new(StringArray::from_iter_values(rows.iter().map(|e| &e.explanation))),
        ],
    )
}

/// `<stem>.verdicts.parquet` -> `<stem>.episodes.parquet`.
pub fn path_beside(verdicts: &Path) -> PathBuf {
    let name = verdicts.file_name().unwrap_or_default().to_string_lossy();
    let stem = name.strip_suffix(".verdicts.parquet").unwrap_or(&name);
    verdicts.with_file_name(format!("{stem}.episodes.parquet"))
}

/// The rows of an episode table, as we wrote it or as another tool wrote it again. Severities and
/// sentences may be missing.
pub fn read(path: &Path) -> Result<Vec<Episode>, TableError> {
    let file = regular_file::open(path)
        .map_err(|source| TableError::Io { path: path.to_path_buf(), source })?;
    let failed = |source| TableError::Parquet { path: path.to_path_buf(), source };
    let options = ArrowReaderOptions::new().with_skip_arrow_metadata(true);
    let open = || ParquetRecordBatchReaderBuilder::try_new_with_options(file, options);
    let builder = unpanicked(path, open)?.map_err(failed)?;
    let mut batches = builder.with_batch_size(BATCH_ROWS).build().map_err(failed)?;
    let mut episodes = Vec::new();
    while let Some(batch) = unpanicked(path, || batches.next())? {
        let batch =
            batch.map_err(|source| TableError::Columns { path: path.to_path_buf(), source })?;
        let misfit = |what: String| TableError::NotEpisodes { path: path.to_path_buf(), what };
        if episodes.len() + batch.num_rows() > MOST_ROWS {
            return Err(misfit(format!("it has more than {MOST_ROWS} rows")));
        }
        episodes.extend(rows(&batch).map_err(misfit)?);
    }
    Ok(episodes)
}

fn rows(batch: &RecordBatch) -> Result<Vec<Episode>, String> {
    let column = |name: &str| {
        batch.column_by_name(name).ok_or_else(|| format!("column `{name}` is missing"))
    };
    let texts = |name: &str| {
        plain_texts(column(name)?).ok_or_else(|| format!("column `{name}` has no texts"))
    };
    let times = |name: &str| {
        timestamps_ns(column(name)?).ok_or_else(|| format!("column `{name}` has no times"))
    };
    let numbers = |name: &str| {
        super::verdict_reader::numbers(column(name)?)
            .ok_or_else(|| format!("column `{name}` has no numbers"))
    };
    let (printheads, channels) = (texts("printhead")?, numbers("channel")?);
    let (categories, faults) = (texts("category")?, texts("fault")?);
    let (raised, began, ended) = (times("raised_at")?, times("began_at")?, times("ended_at")?);
    let (bursts, certainty) = (numbers("bursts")?, numbers("certainty")?);
    let or_nothing = |name: &str| match batch.column_by_name(name) {
        Some(_) => numbers(name),
        None => Ok(vec![None; batch.num_rows()]),
    };
    let (first, max) = (or_nothing("severity_first")?, or_nothing("severity_max")?);
    let (last, sd) = (or_nothing("severity_last")?, or_nothing("severity_sd")?);
    let explanations = match batch.column_by_name("explanation") {
        Some(_) => texts("explanation")?,
        None => vec![None; batch.num_rows()],
    };
    let missing = |name: &str| format!("column `{name}` has a null or a number out of range");
    let finite = |value: Option<f64>| value.filter(|v| v.is_finite());
    (0..batch.num_rows())
        .map(|i| {
            let channel = channels[i].filter(|c| *c >= 0.0 && *c <= f64::from(u32::MAX));
            let printhead = printheads[i].as_deref().ok_or_else(|| missing("printhead"))?;
            Ok(Episode {
                printhead: printhead.into(),
                channel: channel.ok_or_else(|| missing("channel"))? as u32,
                category: categories[i].clone(),
                fault: faults[i].clone(),
                raised_at_ns: raised[i].ok_or_else(|| missing("raised_at"))?,
                began_at_ns: began[i].ok_or_else(|| missing("began_at"))?,
                ended_at_ns: ended[i],
                bursts: bursts[i].unwrap_or(0.0) as u64,
                certainty: certainty[i].filter(|c| !c.is_nan()),
                severity_first: finite(first[i]),
                severity_max: finite(max[i]),
                severity_last: finite(last[i]),
                severity_sd: finite(sd[i]),
                explanation: explanations[i].clone().unwrap_or_default(),
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn episodes() -> Vec<Episode> {
        let first = Episode {
            printhead: "black-2".into(),
            channel: 713,
            category: Some("blocked_nozzle".into()),
            fault: Some("PBN".into()),
            raised_at_ns: 1_700_000_000_123_456_789,
            began_at_ns: 1_700_000_000_000_000_000,
            ended_at_ns: None,
            bursts: 12,
            certainty: Some(0.5),
            severity_first: Some(0.25),
            severity_max: None,
            severity_last: Some(0.5),
            severity_sd: None,
            explanation: "channel 713: partly blocked".into(),
        };
        let ended = Some(1_700_000_001_000_000_000);
        let second = Episode { category: None, fault: None, ended_at_ns: ended, ..first.clone() };
        vec![first, second]
    }

    #[test]
    fn rows_written_are_rows_read_back() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a/r.episodes.parquet");
        let mut writer = EpisodeWriter::create(&path, TimestampUnit::Ns).unwrap();
        writer.write(episodes()).unwrap();
        assert!(!path.exists(), "no name before it is complete");
        writer.complete("{}".into()).unwrap().name().unwrap();
        assert_eq!(read(&path).unwrap(), episodes());

        let writer = EpisodeWriter::create(&path, TimestampUnit::Us).unwrap();
        writer.complete("{}".into()).unwrap().name().unwrap();
        assert_eq!(read(&path).unwrap(), []);
    }

    #[test]
    fn what_is_no_episode_table_is_an_error() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("r.episodes.parquet");
        assert!(matches!(read(&path), Err(TableError::Io { .. })));
        std::fs::write(&path, "PAR1 but no more PAR1").unwrap();
        assert!(read(&path).is_err());
    }

    #[test]
    fn path_lies_beside_the_verdicts() {
        let path = path_beside(Path::new("out/night.verdicts.parquet"));
        assert_eq!(path, Path::new("out/night.episodes.parquet"));
    }

    #[test]
    fn schema_is_the_documented_one() {
        let schema = schema(TimestampUnit::Ns);
        let document = include_str!("../../schemas/episodes.md");
        let documented: Vec<&str> = document
            .lines()
            .filter_map(|line| line.strip_prefix("| `")?.split('`').next())
            .collect();
        let names: Vec<&str> = schema.fields().iter().map(|f| f.name().as_str()).collect();
        assert_eq!(names, documented);
    }
}
