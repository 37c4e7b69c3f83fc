//! Writes verdicts to a Parquet file: the verdict table (`schemas/verdicts.md`), one row for each
//! signal.
//!
//! In, from the pipeline's write stage: verdicts, batch by batch in the recording's order, and at
//! the end the metadata document (JSON). Out: `<stem>.verdicts.parquet`, under its name once it is
//! complete.
//!
//! Batches fill a row group, which has one `Chunk` for each column; runs of healthy signals stay
//! runs, and no string is made for each row. A row group ends at 1,048,576 rows or 128 MiB. A
//! thread then encodes and writes it, while the next row group fills up; at most one row group is
//! written at a time.

pub use super::column_types::TimestampUnit;
pub use super::verdict_columns::TableOptions;

use super::parquet_file;
use super::part_file::{CompleteFile, PartFile};
use super::verdict_chunk::Chunk;
use super::verdict_columns::{ROW_GROUP_ROWS, columns, properties, schema};
use arrow_schema::ArrowError;
use inkling_core::side_by_side::{cores, side_by_side};
use inkling_core::verdict::{Part, Tests, Verdicts};
use parquet::arrow::ArrowWriter;
use parquet::arrow::arrow_writer::ArrowRowGroupWriterFactory;
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::ColumnDescPtr;
use std::fs::File;
use std::io::{self, BufWriter};
use std::panic::resume_unwind;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::{self, JoinHandle};
use thiserror::Error;

/// Key of the metadata document in the file's footer.
pub const METADATA_KEY: &str = "inkling";
/// A row group that takes this much memory is ended even if it lacks rows.
const MOST_HELD_BYTES: usize = 128 << 20;

/// Why a table of results could not be written or read.
#[derive(Debug, Error)]
pub enum TableError {
    #[error("{path}: {source}")]
    Io { path: PathBuf, source: io::Error },
    /// The parquet crate's error stays the source, because a full disk is recognised by it.
    #[error("{path}: {}", parquet_file::words(source))]
    Parquet { path: PathBuf, source: ParquetError },
    #[error("{path}: {what}")]
    Wrong { path: PathBuf, what: String },
}

impl TableError {
    pub(super) fn wrong(path: &Path, what: impl ToString) -> TableError {
        TableError::Wrong { path: path.into(), what: what.to_string() }
    }

    /// The error for a file that was complete once and cannot be read now.
    pub(super) fn damaged(path: &Path, how: &str) -> TableError {
        let what = format!("damaged Parquet file{how}; replay the recording again");
        TableError::wrong(path, what)
    }

    pub(super) fn io(path: &Path) -> impl Fn(io::Error) -> TableError {
        |source| TableError::Io { path: path.into(), source }
    }

    pub(super) fn parquet(path: &Path) -> impl Fn(ParquetError) -> TableError {
        |source| TableError::Parquet { path: path.into(), source }
    }

    /// The columns of a table that is being made do not fit each other.
    pub fn columns(path: &Path) -> impl Fn(ArrowError) -> TableError {
        |error| TableError::wrong(path, format!("columns do not fit each other: {error}"))
    }
}

type Out = SerializedFileWriter<BufWriter<File>>;

pub struct VerdictWriter {
    /// `None` after an append has failed, or while the file is in use here or by the thread.
    file: Option<Box<Out>>,
    /// The thread, if any, that has the file and appends the row group that ended last.
    appending: Option<JoinHandle<Result<Box<Out>, ParquetError>>>,
    /// The columns as the file's schema describes them.
    described: Vec<ColumnDescPtr>,
    /// Makes the parquet crate's writers of columns; only that of the weights is used.
    factory: ArrowRowGroupWriterFactory,
    part: PartFile,
    options: TableOptions,
    group: Option<RowGroup>,
    groups: usize,
    pub rows: u64,
}

struct RowGroup {
    /// One for each column, in the table's order.
    chunks: Vec<Chunk>,
    rows: usize,
}

impl VerdictWriter {
    pub fn create(path: &Path, options: TableOptions) -> Result<VerdictWriter, TableError> {
        let (part, file) = PartFile::create(path).map_err(TableError::io(path))?;
        let schema = Arc::new(schema(&options));
        let properties = properties(&options);
        let (file, factory) = ArrowWriter::try_new(BufWriter::new(file), schema, Some(properties))
            .and_then(ArrowWriter::into_serialized_writer)
            .map_err(TableError::parquet(path))?;
        let of_schema = file.schema_descr();
        let described = (0..of_schema.num_columns()).map(|k| of_schema.column(k)).collect();
        let (file, appending) = (Some(Box::new(file)), None);
        let (group, groups, rows) = (None, 0, 0);
        Ok(VerdictWriter {
            file,
            appending,
            described,
            factory,
            part,
            options,
            group,
            groups,
            rows,
        })
    }

    pub fn write(&mut self, batch: &Verdicts) -> Result<(), TableError> {
        let path = self.path();
        let (failed, unfit) = (TableError::parquet(&path), TableError::columns(&path));
        // a wrong batch is refused before any column has taken a part of it
        check_lengths(batch).map_err(&unfit)?;

        let mut group = match self.group.take() {
            Some(group) => group,
            None => self.new_group().map_err(&failed)?,
        };
        for (chunk, column) in group.chunks.iter_mut().zip(columns(&self.options)) {
            chunk
                .push(column, batch, &self.options)
                .map_err(|e| unfit(ArrowError::InvalidArgumentError(e.to_string())))?;
        }

        group.rows += batch.len();
        self.rows += batch.len() as u64;
        let held = group.chunks.iter().map(Chunk::memory).sum::<usize>();
        if group.rows >= ROW_GROUP_ROWS || held >= MOST_HELD_BYTES {
            self.end_group(group).map_err(failed)?;
        } else if group.rows > 0 {
            self.group = Some(group);
        }
        Ok(())
    }

    /// Writes the last row group and the metadata document. The file is complete then, but still
    /// has a provisional name, so that several results can get their names together.
    pub fn complete(mut self, metadata_json: String) -> Result<CompleteFile, TableError> {
        let path = self.path();
        let failed = TableError::parquet(&path);
        let mut file = self.file().map_err(&failed)?;
        if let Some(group) = self.group.take() {
            group.append_to(&mut file, &self.options, cores()).map_err(&failed)?;
        }
        file.append_key_value_metadata(KeyValue::new(METADATA_KEY.to_string(), metadata_json));
        // this writes the footer, too
        let file = file.into_inner().map_err(&failed)?;
        self.part.complete_buffered(file).map_err(TableError::io(&path))
    }

    fn path(&self) -> PathBuf {
        self.part.path().to_path_buf()
    }

    fn new_group(&mut self) -> Result<RowGroup, ParquetError> {
        // the parquet crate makes a writer for each column; only that of the weights is kept
        let writers = self.factory.create_column_writers(self.groups)?;
        let chunks = writers.into_iter().zip(columns(&self.options)).zip(&self.described);
        let chunks = chunks.map(|((writer, column), described)| {
            Chunk::new(column, described.clone(), writer, &self.options)
        });
        Ok(RowGroup { chunks: chunks.collect(), rows: 0 })
    }

    fn file(&mut self) -> Result<Box<Out>, ParquetError> {
        let failed = || ParquetError::General("a row group could not be written".into());
        match self.appending.take() {
            Some(thread) => thread.join().unwrap_or_else(|panic| resume_unwind(panic)),
            None => self.file.take().ok_or_else(failed),
        }
    }

    fn end_group(&mut self, group: RowGroup) -> Result<(), ParquetError> {
        let mut file = self.file()?;
        self.part.sync_early()?;
        self.groups += 1;
        let options = self.options.clone();
        let append = move || group.append_to(&mut file, &options, 1).map(|()| file);
        self.appending = Some(thread::Builder::new().name("row group".into()).spawn(append)?);
        Ok(())
    }
}

impl RowGroup {
    fn append_to(
        self,
        file: &mut Out,
        options: &TableOptions,
        workers: usize,
    ) -> Result<(), ParquetError> {
        let chunks = self.chunks.into_iter().zip(columns(options)).collect();
        let closed =
            side_by_side(workers, chunks, |(chunk, column): (Chunk, _)| chunk.close(column));
        let mut group = file.next_row_group()?;
        closed.into_iter().try_for_each(|append| append?(&mut group))?;
        group.close()?;
        Ok(file.flush()?)
    }
}

/// A batch whose vectors are not as long as its rows and runs say is an error and no panic.
pub(super) fn check_lengths(batch: &Verdicts) -> Result<(), ArrowError> {
    let wrong = |what: String| Err(ArrowError::InvalidArgumentError(what));
    let (rows, lengths) = (batch.rows.len(), batch.rows.lengths());
    if lengths.iter().any(|&n| n != rows) {
        return wrong(format!("columns of {lengths:?} rows beside {rows} times"));
    }
    let Tests { statistic, misfit, beside, healthy } = &batch.tests;
    let lengths = [statistic.len(), misfit.len(), beside.len(), healthy.len()];
    let signals = lengths.into_iter().min().unwrap_or_default();
    let beyond = |part: &Part| match part {
        Part::Healthy(run) => run.signals.end > signals,
        Part::Rows(range) => range.end > rows,
    };
    match batch.parts.iter().any(beyond) {
        true => wrong(format!("parts beyond {signals} tests and {rows} rows")),
        false => Ok(()),
    }
}

#[cfg(test)]
pub(super) mod tests;
