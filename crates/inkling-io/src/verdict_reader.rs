//! Reads verdict tables for `score`, `report`, and whatever else looks at results.
//!
//! In: a Parquet file with the columns of `schemas/verdicts.md`, as this program wrote it or as
//! another tool wrote it anew (plain strings, other integers, microseconds; nullable columns may be
//! missing). Out: [`VerdictColumns`], batch by batch of 8,192 rows, with names as indices into
//! [`VerdictReader::classes`] and [`VerdictReader::categories`]. A damaged file is an error, also
//! where the parquet crate panics on it.

use super::arrow_cells::{ReadColumn, Texts};
use super::parquet_file::ParquetFile;
use super::regular_file;
use super::unpanicked::unpanicked;
use super::verdict_table::{METADATA_KEY, TableError};
use arrow_array::RecordBatch;
use inkling_core::verdict::{COLUMNS, Cells, Column, Outcome, Reason, Test, VerdictColumns};
use parquet::arrow::ProjectionMask;
use parquet::arrow::arrow_reader::{ParquetRecordBatchReader, ParquetRecordBatchReaderBuilder};
use parquet::file::metadata::ParquetMetaData;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// So few that the columns of a batch fit into the caches, and into memory that the allocator keeps.
const BATCH_ROWS: usize = 1 << 13;

/// Iterator over the batches of a verdict table.
pub struct VerdictReader {
    path: PathBuf,
    batches: ParquetRecordBatchReader,
    classes: Names,
    categories: Names,
}

impl VerdictReader {
    /// Opens a table with all columns. Errors say that the file cannot be read, or is no Parquet file.
    pub fn open(path: &Path) -> Result<VerdictReader, TableError> {
        VerdictReader::open_columns(path, None)
    }

    /// The same with these columns; `None`: all.
    pub fn open_columns(path: &Path, names: Option<&[&str]>) -> Result<VerdictReader, TableError> {
        let mut builder = open(path)?;
        if let Some(names) = names {
            let mask = ProjectionMask::columns(builder.parquet_schema(), names.iter().copied());
            builder = builder.with_projection(mask);
        }
        let document = document(builder.metadata());
        Ok(VerdictReader {
            path: path.to_path_buf(),
            batches: builder
                .with_batch_size(BATCH_ROWS)
                .build()
                .map_err(TableError::parquet(path))?,
            classes: Names::of(&document["classes"]),
            categories: Names::of(&document["categories"]),
        })
    }

    /// The names that the indices of `fault` and `candidate` mean: the metadata's classes, then
    /// others in the order in which they were met. The list grows while batches are read.
    pub fn classes(&self) -> &[String] {
        &self.classes.list
    }

    /// The names that the indices of `category` mean, likewise.
    pub fn categories(&self) -> &[String] {
        &self.categories.list
    }

    fn columns(&mut self, batch: &RecordBatch) -> Result<VerdictColumns, String> {
        let mut columns = VerdictColumns::default();
        for Column { name, nullable, cells } in COLUMNS {
            match batch.column_by_name(name) {
                Some(array) => self.read(cells, ReadColumn { name, array }, &mut columns)?,
                // tables of other tools may lack the column
                None if *nullable || matches!(cells, Cells::Recording) => {}
                None => return Err(format!("column `{name}` is missing")),
            }
        }
        columns.fill_up();
        Ok(columns)
    }

    fn read(
        &mut self,
        cells: &Cells,
        of: ReadColumn,
        c: &mut VerdictColumns,
    ) -> Result<(), String> {
        match cells {
            Cells::Recording => {}
            Cells::Time(at) => *at.of_mut(c) = of.all_times()?,
            Cells::Printhead(at) => {
                let Texts { keys, values } = of.texts()?;
                *at.of_mut(c) = of.required(keys)?;
                c.printheads = values.into_iter().map(Arc::from).collect();
            }
            Cells::Channel(at) => *at.of_mut(c) = of.counts()?,
            Cells::Outcome(at) => *at.of_mut(c) = of.required(of.parsed(Outcome::of)?)?,
            Cells::Category(at) => *at.of_mut(c) = of.parsed(|name| self.categories.key(name))?,
            Cells::Class(at) => *at.of_mut(c) = of.parsed(|name| self.classes.key(name))?,
            Cells::Test(at) => *at.of_mut(c) = of.parsed(Test::of)?,
            Cells::Reason(at) => *at.of_mut(c) = of.parsed(Reason::of)?,
            Cells::Model(at) => *at.of_mut(c) = of.whole()?,
            Cells::Statistic(at)
            | Cells::Threshold(at)
            | Cells::Misfit(at)
            | Cells::Temperature(at)
            | Cells::Drive(at)
            | Cells::Number(at) => {
                *at.of_mut(c) = of.floats()?;
            }
            Cells::Weights => (c.weights_start, c.weights) = of.lists()?,
        }
        Ok(())
    }
}

impl Iterator for VerdictReader {
    type Item = Result<VerdictColumns, TableError>;

    fn next(&mut self) -> Option<Self::Item> {
        let batch = next_batch(&self.path, &mut self.batches)?;
        Some(batch.and_then(|batch| {
            let unfit = |what| format!("not a verdict table: {what}");
            self.columns(&batch).map_err(|what| TableError::wrong(&self.path, unfit(what)))
        }))
    }
}

/// The metadata document under the key `inkling` of a table that this program wrote, of verdicts or of
/// episodes. Null: the file has none, since other tools may drop it, or it is no JSON.
pub fn document_of(path: &Path) -> Result<serde_json::Value, TableError> {
    Ok(document(open(path)?.metadata()))
}

fn document(of: &ParquetMetaData) -> serde_json::Value {
    let mut entries = of.file_metadata().key_value_metadata().into_iter().flatten();
    let entry = entries.find(|entry| entry.key == METADATA_KEY);
    let json = entry.and_then(|entry| entry.value.as_deref());
    json.and_then(|json| serde_json::from_str(json).ok()).unwrap_or_default()
}

/// Opens a Parquet file that anybody may have written.
pub(super) fn open(
    path: &Path,
) -> Result<ParquetRecordBatchReaderBuilder<ParquetFile>, TableError> {
    let file = regular_file::open(path).map_err(TableError::io(path))?;
    undamaged(path, || ParquetFile::open_with_dictionaries(file))?
        .map_err(TableError::parquet(path))
}

fn undamaged<T>(path: &Path, read: impl FnOnce() -> T) -> Result<T, TableError> {
    unpanicked(read).ok_or_else(|| TableError::damaged(path, ""))
}

pub(super) fn next_batch(
    path: &Path,
    batches: &mut ParquetRecordBatchReader,
) -> Option<Result<RecordBatch, TableError>> {
    let batch = undamaged(path, || batches.next()).transpose()?;
    Some(batch.and_then(|batch| batch.map_err(|e| TableError::damaged(path, &format!(" ({e})")))))
}

/// Names by index, in the order of their first appearance.
#[derive(Default)]
struct Names {
    list: Vec<String>,
    index: HashMap<String, u16>,
}

impl Names {
    /// The names in a list of the metadata document.
    fn of(list: &serde_json::Value) -> Names {
        let mut names = Names::default();
        for name in list.as_array().into_iter().flatten().filter_map(|n| n.as_str()) {
            names.key(name);
        }
        names
    }

    fn key(&mut self, name: &str) -> Option<u16> {
        if let Some(&known) = self.index.get(name) {
            return Some(known);
        }
        let new = u16::try_from(self.list.len()).ok()?;
        self.list.push(name.to_string());
        self.index.insert(name.to_string(), new);
        Some(new)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::{assert_refused, place};
    use arrow_array::{
        ArrayRef, Int64Array, StringArray, StringViewArray, TimestampMicrosecondArray,
    };
    use arrow_schema::{DataType, Field, Schema};
    use parquet::arrow::add_encoded_arrow_schema_to_metadata;
    use parquet::arrow::arrow_writer::{ArrowWriter, ArrowWriterOptions};
    use parquet::file::properties::WriterProperties;
    use std::fs::File;

    type Columns = Vec<(&'static str, ArrayRef)>;

    fn schema(columns: &Columns) -> Schema {
        let field = |(n, c): &(&str, ArrayRef)| Field::new(*n, c.data_type().clone(), true);
        Schema::new(columns.iter().map(field).collect::<Vec<_>>())
    }

    fn write(path: &Path, columns: Columns, options: ArrowWriterOptions) {
        let schema = Arc::new(schema(&columns));
        let arrays = columns.into_iter().map(|c| c.1).collect();
        let batch = RecordBatch::try_new(schema.clone(), arrays).unwrap();
        let file = File::create(path).unwrap();
        let mut writer = ArrowWriter::try_new_with_options(file, schema, options).unwrap();
        writer.write(&batch).unwrap();
        writer.close().unwrap();
    }

    fn rewritten() -> Columns {
        let us = TimestampMicrosecondArray::from(vec![1, -2]).with_timezone("UTC");
        vec![
            ("acquired_at", Arc::new(us)),
            ("printhead", Arc::new(StringViewArray::from(vec!["K", "L"]))),
            ("channel", Arc::new(Int64Array::from(vec![7, i64::from(u32::MAX)]))),
            ("outcome", Arc::new(StringArray::from(vec!["healthy", "faulty"]))),
            ("fault", Arc::new(StringArray::from(vec![None, Some("EC")]))),
            ("severity", Arc::new(arrow_array::Float64Array::from(vec![f64::NAN, 0.5]))),
        ]
    }

    #[test]
    fn a_table_rewritten_by_another_tool_reads_the_same() {
        let (_dir, path) = place("t.parquet");
        write(&path, rewritten(), ArrowWriterOptions::new());
        let mut reader = VerdictReader::open(&path).unwrap();
        let c = reader.next().unwrap().unwrap();
        assert_eq!(c.acquired_at_ns, [1000, -2000]);
        assert_eq!(c.channel, [7, u32::MAX]);
        assert_eq!(c.outcome, [Outcome::Healthy, Outcome::Faulty]);
        assert_eq!(c.fault, [None, Some(0)]);
        assert_eq!(reader.classes(), ["EC"]);
        assert_eq!(c.severity, [None, Some(0.5)]);
        assert_eq!(c.certainty, [None, None]);
        let names: Vec<&str> = c.printhead.iter().map(|&p| &*c.printheads[p as usize]).collect();
        assert_eq!(names, ["K", "L"]);
    }

    /// What pandas puts beside a column without a value: the reader of it panics.
    #[test]
    fn arrow_schema_that_claims_a_dictionary_of_nulls_is_not_believed() {
        let (_dir, path) = place("t.parquet");
        let mut columns = rewritten();
        columns.push(("reason", Arc::new(arrow_array::NullArray::new(2))));
        let nulls = DataType::Dictionary(Box::new(DataType::Int8), Box::new(DataType::Null));
        let mut claimed = schema(&columns).fields().to_vec();
        *claimed.last_mut().unwrap() = Arc::new(Field::new("reason", nulls, true));
        let mut properties = WriterProperties::builder().build();
        add_encoded_arrow_schema_to_metadata(&Schema::new(claimed), &mut properties);
        let options = ArrowWriterOptions::new().with_skip_arrow_metadata(true);
        write(&path, columns, options.with_properties(properties));
        let first = VerdictReader::open(&path).unwrap().next().unwrap().unwrap();
        assert_eq!(first.reason, [None, None]);
    }

    #[test]
    fn what_is_no_verdict_table_is_refused_with_the_column() {
        let (_dir, path) = place("t.parquet");
        let refused = |column: &str, array: Option<ArrayRef>| {
            let mut columns = rewritten();
            match array {
                None => columns.retain(|c| c.0 != column),
                Some(array) => columns.iter_mut().find(|c| c.0 == column).unwrap().1 = array,
            }
            write(&path, columns, ArrowWriterOptions::new());
            let first = VerdictReader::open(&path).unwrap().next().unwrap();
            assert_refused(first, &[&format!("`{column}`")]);
        };
        refused("outcome", None);
        refused("outcome", Some(Arc::new(StringArray::from(vec!["fine", "faulty"]))));
        refused("channel", Some(Arc::new(Int64Array::from(vec![-1, 0]))));
        refused("channel", Some(Arc::new(Int64Array::from(vec![None, Some(0)]))));
        refused("printhead", Some(Arc::new(StringArray::from(vec![None, Some("K")]))));
        refused("severity", Some(Arc::new(StringArray::from(vec!["a", "b"]))));
        std::fs::write(&path, "not parquet").unwrap();
        assert!(matches!(VerdictReader::open(&path), Err(TableError::Parquet { .. })));
    }
}
