//! Episodes to a Parquet file and back: the episode table of the contract (`schemas/episodes.md`).
//!
//! In: episodes as they end; at the end the metadata document. Out: `<stem>.episodes.parquet`, under
//! its name once it is complete; for `score`, its rows again.

use super::part_file::{CompleteFile, PartFile};
use super::row_table::{self, Cells, Column, Read};
use super::stored;
use super::verdict_reader::{open, undamaged};
use super::verdict_table::{METADATA_KEY, TableError, TimestampUnit};
use arrow_schema::SchemaRef;
use inkling_core::episodes::Episode;
use inkling_core::verdict::Reason;
use parquet::arrow::ArrowWriter;
use parquet::file::metadata::KeyValue;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Episodes that wait for their row group.
const BATCH_ROWS: usize = 8192;
/// Rows that a reader accepts: more episodes are no table of ours.
const MOST_ROWS: usize = 1 << 24;

type EpisodeColumn = Column<Episode>;

/// In the table's order.
static COLUMNS: [EpisodeColumn; 18] = [
    EpisodeColumn::required("recording", Cells::Name(|e| Some(e.recording.to_string())))
        .read(Read::Text(|e, name| e.recording = name.unwrap_or_default().into())),
    EpisodeColumn::required("printhead", Cells::Name(|e| Some(e.printhead.to_string())))
        .read(Read::Name(|e, name| e.printhead = name.unwrap_or_default().into())),
    EpisodeColumn::required("channel", Cells::Count(|e| e.channel))
        .read(Read::Count(|e, n| e.channel = n.unwrap_or_default())),
    EpisodeColumn::nullable("category", Cells::Name(|e| e.category.clone()))
        .read(Read::Name(|e, name| e.category = name)),
    EpisodeColumn::nullable("fault", Cells::Name(|e| e.fault.clone()))
        .read(Read::Name(|e, name| e.fault = name)),
    EpisodeColumn::required("raised_at", Cells::Time(|e| Some(e.raised_at_ns)))
        .read(Read::Time(|e, ns| e.raised_at_ns = ns.unwrap_or_default())),
    EpisodeColumn::required("began_at", Cells::Time(|e| Some(e.began_at_ns)))
        .read(Read::Time(|e, ns| e.began_at_ns = ns.unwrap_or_default())),
    EpisodeColumn::nullable("ended_at", Cells::Time(|e| e.ended_at_ns))
        .read(Read::Time(|e, ns| e.ended_at_ns = ns)),
    EpisodeColumn::required("bursts", Cells::Count(|e| e.bursts.try_into().unwrap_or(u32::MAX)))
        .read(Read::Count(|e, n| e.bursts = n.unwrap_or_default().into())),
    number("certainty", |e| e.certainty, |e, v| e.certainty = v),
    number("severity_first", |e| e.severity_first, |e, v| e.severity_first = v),
    number("severity_max", |e| e.severity_max, |e, v| e.severity_max = v),
    number("severity_last", |e| e.severity_last, |e, v| e.severity_last = v),
    number("severity_sd", |e| e.severity_sd, |e, v| e.severity_sd = v),
    number("resonance_hz", |e| e.resonance_hz, |e, v| e.resonance_hz = v),
    number("damping_per_s", |e| e.damping_per_s, |e, v| e.damping_per_s = v),
    EpisodeColumn::nullable("reason", Cells::Name(|e| Some(e.reason?.as_str().to_owned())))
        .read(Read::Text(|e, name| e.reason = name.and_then(|name| Reason::of(&name)))),
    EpisodeColumn::required("explanation", Cells::Text(|e| e.explanation.clone()))
        .read(Read::Text(|e, text| e.explanation = text.unwrap_or_default())),
];

const fn number(
    name: &'static str,
    of: fn(&Episode) -> Option<f64>,
    set: fn(&mut Episode, Option<f64>),
) -> EpisodeColumn {
    EpisodeColumn::nullable(name, Cells::Number(of)).read(Read::Number(set))
}

pub struct EpisodeWriter {
    writer: ArrowWriter<BufWriter<File>>,
    part: PartFile,
    schema: SchemaRef,
    unit: TimestampUnit,
    waiting: Vec<Episode>,
    recording: Arc<str>,
}

impl EpisodeWriter {
    /// `recording`: what the column of that name says.
    pub fn create(
        path: &Path,
        unit: TimestampUnit,
        recording: &str,
    ) -> Result<EpisodeWriter, TableError> {
        let (part, file) = PartFile::create(path)
            .map_err(|source| TableError::Io { path: path.to_path_buf(), source })?;
        let schema = Arc::new(row_table::schema(&COLUMNS, unit));
        let properties = Some(row_table::properties());
        let writer = ArrowWriter::try_new(BufWriter::new(file), schema.clone(), properties)
            .map_err(|source| TableError::Parquet { path: path.to_path_buf(), source })?;
        let (waiting, recording) = (Vec::new(), recording.into());
        Ok(EpisodeWriter { writer, part, schema, unit, waiting, recording })
    }

    pub fn write(&mut self, episodes: Vec<Episode>) -> Result<(), TableError> {
        let of_it = |episode| Episode { recording: self.recording.clone(), ..episode };
        self.waiting.extend(episodes.into_iter().map(of_it));
        if self.waiting.len() >= BATCH_ROWS { self.flush() } else { Ok(()) }
    }

    fn flush(&mut self) -> Result<(), TableError> {
        let path = self.part.path().to_path_buf();
        let batch = row_table::batch(&COLUMNS, self.schema.clone(), self.unit, &self.waiting)
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

/// `<stem>.verdicts.parquet` -> `<stem>.episodes.parquet`.
pub fn path_beside(verdicts: &Path) -> PathBuf {
    stored::beside(verdicts, "episodes.parquet")
}

/// The rows of an episode table, as we wrote it or as another tool wrote it again. Numbers and
/// sentences may be missing.
pub fn read(path: &Path) -> Result<Vec<Episode>, TableError> {
    let builder = open(path)?;
    let failed = |source| TableError::Parquet { path: path.to_path_buf(), source };
    let mut batches = builder.with_batch_size(BATCH_ROWS).build().map_err(failed)?;
    let mut episodes = Vec::new();
    while let Some(batch) = undamaged(path, || batches.next())? {
        let batch =
            batch.map_err(|source| TableError::Unread { path: path.to_path_buf(), source })?;
        let misfit = |what: String| TableError::NotEpisodes { path: path.to_path_buf(), what };
        if episodes.len() + batch.num_rows() > MOST_ROWS {
            return Err(misfit(format!("it has more than {MOST_ROWS} rows")));
        }
        episodes.extend(row_table::rows(&COLUMNS, &batch).map_err(misfit)?);
    }
    Ok(episodes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::documented::is_documented;

    fn episodes() -> Vec<Episode> {
        let first = Episode {
            recording: "night/1.mcap".into(),
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
            resonance_hz: Some(61_000.0),
            damping_per_s: None,
            reason: None,
            explanation: "channel 713: partly blocked".into(),
        };
        let ended = Some(1_700_000_001_000_000_000);
        let (fault, reason) = (None, Some(Reason::NoRing));
        let second = Episode { category: None, fault, reason, ended_at_ns: ended, ..first.clone() };
        vec![first, second]
    }

    #[test]
    fn rows_written_are_rows_read_back() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a/r.episodes.parquet");
        let mut writer = EpisodeWriter::create(&path, TimestampUnit::Ns, "night/1.mcap").unwrap();
        writer.write(episodes()).unwrap();
        assert!(!path.exists(), "no name before it is complete");
        writer.complete("{}".into()).unwrap().name().unwrap();
        assert_eq!(read(&path).unwrap(), episodes());

        let writer = EpisodeWriter::create(&path, TimestampUnit::Us, "x").unwrap();
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
        let page = include_str!("../../../schemas/episodes.md");
        is_documented(page, &row_table::schema(&COLUMNS, TimestampUnit::Ns));
    }
}
