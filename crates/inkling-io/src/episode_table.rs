//! Writes episodes to a Parquet file and reads them back: the episode table
//! (`schemas/episodes.md`). An episode is a fault of one channel over several bursts; a row is an
//! episode.
//!
//! In, from the pipeline: episodes as they end, and at the end the metadata document (JSON). Out:
//! `<stem>.episodes.parquet`, which the caller gives its name when it is complete; and its rows
//! again, for `score` and `report`. `row_table.rs` does the work, by the list of columns here.

use super::part_file::CompleteFile;
use super::row_table::{self, Column, Kind, TableWriter};
use super::stored;
use super::verdict_reader::{next_batch, open};
use super::verdict_table::{TableError, TimestampUnit};
use arrow_schema::SchemaRef;
use inkling_core::episodes::Episode;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// From so many waiting episodes on, they are handed to the parquet crate together.
const BATCH_ROWS: usize = 8192;
/// A table with more rows is refused: no run writes so many episodes.
const MOST_ROWS: usize = 1 << 24;

/// From `began_at` to `ended_at`, s: for databases that cannot subtract times of nanoseconds.
const DURATION: &str = "duration_s";

/// The columns in the table's order. Their names are those of [`Episode`]'s fields, but for [`DURATION`].
static COLUMNS: [Column; 19] = [
    Column::required("recording", Kind::Name),
    Column::required("printhead", Kind::Name),
    Column::required("channel", Kind::Count),
    Column::nullable("category", Kind::Name),
    Column::nullable("fault", Kind::Name),
    Column::required("raised_at", Kind::Time),
    Column::required("began_at", Kind::Time),
    Column::nullable("ended_at", Kind::Time),
    Column::required("bursts", Kind::Count),
    Column::nullable("certainty", Kind::Number),
    Column::nullable("severity_first", Kind::Number),
    Column::nullable("severity_max", Kind::Number),
    Column::nullable("severity_last", Kind::Number),
    Column::nullable("severity_sd", Kind::Number),
    Column::nullable("resonance_hz", Kind::Number),
    Column::nullable("damping_per_s", Kind::Number),
    Column::nullable("reason", Kind::Name),
    Column::nullable(DURATION, Kind::Seconds),
    Column::required("explanation", Kind::Text),
];

pub struct EpisodeWriter {
    table: TableWriter,
    schema: SchemaRef,
    unit: TimestampUnit,
    waiting: Vec<Value>,
    recording: Arc<str>,
}

impl EpisodeWriter {
    pub fn create(
        path: &Path,
        unit: TimestampUnit,
        recording: &str,
    ) -> Result<EpisodeWriter, TableError> {
        let schema = Arc::new(row_table::schema(&COLUMNS, unit));
        let table = TableWriter::create(path, schema.clone())?;
        Ok(EpisodeWriter { table, schema, unit, waiting: Vec::new(), recording: recording.into() })
    }

    /// Appends episodes. The recording that an episode names is replaced by the table's own.
    pub fn write(&mut self, episodes: Vec<Episode>) -> Result<(), TableError> {
        for episode in episodes {
            let seconds =
                episode.ended_at_ns.map(|end| end.saturating_sub(episode.began_at_ns) as f64 / 1e9);
            let of_it = Episode { recording: self.recording.clone(), ..episode };
            let mut row =
                serde_json::to_value(of_it).map_err(|e| TableError::wrong(self.table.path(), e))?;
            row[DURATION] = seconds.into();
            self.waiting.push(row);
        }
        if self.waiting.len() >= BATCH_ROWS { self.flush() } else { Ok(()) }
    }

    fn flush(&mut self) -> Result<(), TableError> {
        let batch = row_table::batch(&COLUMNS, self.schema.clone(), self.unit, &self.waiting)
            .map_err(TableError::columns(self.table.path()))?;
        self.waiting.clear();
        self.table.write(&batch)
    }

    /// The file is complete then, and still has a provisional name.
    pub fn complete(mut self, metadata_json: String) -> Result<CompleteFile, TableError> {
        self.flush()?;
        self.table.complete(metadata_json)
    }
}

/// The episodes that belong to a verdict table: `<stem>.verdicts.parquet` gives `<stem>.episodes.parquet`.
pub fn path_beside(verdicts: &Path) -> PathBuf {
    stored::beside(verdicts, "episodes.parquet")
}

/// The rows of an episode table that this program wrote, or that another tool wrote anew.
pub fn read(path: &Path) -> Result<Vec<Episode>, TableError> {
    let batches = open(path)?.with_batch_size(BATCH_ROWS).build();
    let mut batches = batches.map_err(TableError::parquet(path))?;
    let (mut episodes, fields) = (Vec::new(), COLUMNS.iter().filter(|of| of.name != DURATION));
    let fields: Vec<Column> = fields.copied().collect();
    while let Some(batch) = next_batch(path, &mut batches) {
        let batch = batch?;
        let unfit = |what| TableError::wrong(path, format!("not an episode table: {what}"));
        if episodes.len() + batch.num_rows() > MOST_ROWS {
            return Err(unfit(format!("it has more than {MOST_ROWS} rows")));
        }
        episodes.extend(row_table::rows::<Episode>(&fields, &batch).map_err(unfit)?);
    }
    Ok(episodes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::documented::is_documented;
    use crate::fixtures::place;
    use inkling_core::verdict::Reason;

    fn episodes() -> Vec<Episode> {
        let first = Episode {
            recording: "night/1.mcap".into(),
            printhead: "black-2".into(),
            channel: 713,
            category: Some("blocked_nozzle".into()),
            fault: Some("PBN".into()),
            raised_at_ns: 1_700_000_000_123_456_789,
            began_at_ns: 1_700_000_000_000_000_000,
            bursts: 12,
            certainty: Some(0.5),
            severity_first: Some(0.25),
            severity_last: Some(0.5),
            resonance_hz: Some(61_000.0),
            explanation: "channel 713: partly blocked".into(),
            ..Episode::default()
        };
        let second = Episode {
            channel: 714,
            ended_at_ns: Some(1_700_000_001_000_000_000),
            severity_max: Some(0.75),
            severity_sd: Some(0.125),
            damping_per_s: Some(9_000.0),
            reason: Some(Reason::NoRing),
            ..Episode { recording: first.recording.clone(), ..Episode::default() }
        };
        vec![first, second]
    }

    #[test]
    fn rows_written_are_rows_read_back() {
        let (_dir, path) = place("a/r.episodes.parquet");
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
    fn schema_is_the_documented_one() {
        let page = include_str!("../../../schemas/episodes.md");
        is_documented(page, &row_table::schema(&COLUMNS, TimestampUnit::Ns));
    }
}
