//! Verdict tables read again, for `score`.
//!
//! In: a Parquet file with the columns of the contract, as we wrote it or as another tool wrote it
//! again (plain strings, other integers, microseconds; nullable columns may be missing). Out:
//! [`VerdictColumns`] batch by batch.

use super::arrow_cells::{inside, numbers, texts, times};
use super::parquet_file::ParquetFile;
use super::regular_file;
use super::unpanicked::unpanicked;
use super::verdict_table::{METADATA_KEY, TableError};
use arrow_array::cast::AsArray;
use arrow_array::{Array, ArrayRef, RecordBatch};
use inkling_core::verdict::{COLUMNS, Cells, Column, Outcome, Reason, Test, VerdictColumns};
use parquet::arrow::ProjectionMask;
use parquet::arrow::arrow_reader::{
    ArrowReaderOptions, ParquetRecordBatchReader, ParquetRecordBatchReaderBuilder,
};
use parquet::file::metadata::ParquetMetaData;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

const BATCH_ROWS: usize = 1 << 16;

/// Iterator over a verdict table.
pub struct VerdictReader {
    path: PathBuf,
    batches: ParquetRecordBatchReader,
    metadata_json: Option<String>,
    classes: Names,
    categories: Names,
}

impl VerdictReader {
    pub fn open(path: &Path) -> Result<VerdictReader, TableError> {
        VerdictReader::of_columns(path, None)
    }

    /// Reads these columns alone; the others are null where they may be.
    pub fn open_columns(path: &Path, names: &[&str]) -> Result<VerdictReader, TableError> {
        VerdictReader::of_columns(path, Some(names))
    }

    fn of_columns(path: &Path, names: Option<&[&str]>) -> Result<VerdictReader, TableError> {
        let failed = |source| TableError::Parquet { path: path.to_path_buf(), source };
        let mut builder = open(path)?;
        if let Some(names) = names {
            let mask = ProjectionMask::columns(builder.parquet_schema(), names.iter().copied());
            builder = builder.with_projection(mask);
        }
        let metadata_json = metadata_json(builder.metadata());
        let document = document(metadata_json.as_deref());
        Ok(VerdictReader {
            path: path.to_path_buf(),
            batches: builder.with_batch_size(BATCH_ROWS).build().map_err(failed)?,
            classes: Names::from(&document["classes"]),
            categories: Names::from(&document["categories"]),
            metadata_json,
        })
    }

    /// The document under the key `inkling`, if the file still has it.
    pub fn metadata_json(&self) -> Option<&str> {
        self.metadata_json.as_deref()
    }

    /// What `fault` and `candidate` index: the metadata's classes, then others as they were met.
    pub fn classes(&self) -> &[String] {
        &self.classes.list
    }

    /// What `category` indexes.
    pub fn categories(&self) -> &[String] {
        &self.categories.list
    }

    fn columns(&mut self, batch: &RecordBatch) -> Result<VerdictColumns, Misfit> {
        let mut columns = VerdictColumns::default();
        for column in COLUMNS {
            match batch.column_by_name(column.name) {
                Some(array) => self.read(column, array, &mut columns)?,
                // tables of others, and of version 1, do not name it
                None if column.nullable || matches!(column.cells, Cells::Recording) => {}
                None => {
                    return Err(Misfit { column: column.name, what: "is missing".into() });
                }
            }
        }
        columns.fill_up();
        Ok(columns)
    }

    fn read(
        &mut self,
        column: &Column,
        array: &ArrayRef,
        c: &mut VerdictColumns,
    ) -> Result<(), Misfit> {
        let name = column.name;
        let unfit = || Misfit::kind(name, array);
        let numbers = || numbers(array).ok_or_else(unfit);
        // tools without nulls write NaN for them
        let number = |v: &Option<f64>| v.filter(|v| !v.is_nan());
        let texts = || Texts::of(array).ok_or_else(unfit);
        let outcome = |text: &str| Outcome::ALL.into_iter().find(|o| o.as_str() == text);
        let reason = Reason::of;
        let test = |text: &str| Test::ALL.into_iter().find(|t| t.as_str() == text);
        match &column.cells {
            Cells::Recording => {}
            Cells::Time(at) => *at.of_mut(c) = nanoseconds(array, name)?,
            Cells::Printhead(at) => {
                (*at.of_mut(c), c.printheads) = texts()?.required(name)?;
            }
            Cells::Channel(at) => *at.of_mut(c) = required(whole(&numbers()?, name)?, name)?,
            Cells::Outcome(at) => {
                *at.of_mut(c) = required(texts()?.parse(name, outcome)?, name)?;
            }
            Cells::Category(at) => *at.of_mut(c) = self.categories.indices(&texts()?, name)?,
            Cells::Class(at) => *at.of_mut(c) = self.classes.indices(&texts()?, name)?,
            Cells::Test(at) => *at.of_mut(c) = texts()?.parse(name, test)?,
            Cells::Reason(at) => *at.of_mut(c) = texts()?.parse(name, reason)?,
            Cells::Model(at) => {
                let values: Vec<Option<f64>> = numbers()?.iter().map(number).collect();
                *at.of_mut(c) = whole(&values, name)?;
            }
            Cells::Statistic(at) | Cells::Threshold(at) | Cells::Misfit(at) | Cells::Number(at) => {
                let values = numbers()?;
                *at.of_mut(c) = values.iter().map(|v| number(v).map(|v| v as f32)).collect();
            }
            Cells::Weights => (c.weights_start, c.weights) = weights(array, name)?,
        }
        Ok(())
    }
}

impl Iterator for VerdictReader {
    type Item = Result<VerdictColumns, TableError>;

    fn next(&mut self) -> Option<Self::Item> {
        let batches = &mut self.batches;
        let batch = match undamaged(&self.path, || batches.next()) {
            Err(damaged) => return Some(Err(damaged)),
            Ok(None) => return None,
            Ok(Some(Ok(batch))) => batch,
            Ok(Some(Err(source))) => {
                return Some(Err(TableError::Unread { path: self.path.clone(), source }));
            }
        };
        Some(self.columns(&batch).map_err(|Misfit { column, what }| TableError::Column {
            path: self.path.clone(),
            column,
            what,
        }))
    }
}

/// The document under the key `inkling` of a table of ours, whatever it holds: of verdicts, of episodes. Null: it has none,
/// or cannot be read.
pub fn document_of(path: &Path) -> serde_json::Value {
    open(path).map(|table| document(metadata_json(table.metadata()).as_deref())).unwrap_or_default()
}

fn metadata_json(of: &ParquetMetaData) -> Option<String> {
    let entries = of.file_metadata().key_value_metadata()?;
    entries.iter().find(|entry| entry.key == METADATA_KEY)?.value.clone()
}

fn document(json: Option<&str>) -> serde_json::Value {
    json.and_then(|json| serde_json::from_str(json).ok()).unwrap_or_default()
}

/// A Parquet file that anybody may have written.
pub(super) fn open(
    path: &Path,
) -> Result<ParquetRecordBatchReaderBuilder<ParquetFile>, TableError> {
    let file = regular_file::open(path)
        .map_err(|source| TableError::Io { path: path.to_path_buf(), source })?;
    // Parquet's own types are enough. The Arrow schema that tools put beside them may say more
    // than can be read (pandas: a dictionary of nulls), and then the reader panics.
    let options = ArrowReaderOptions::new().with_skip_arrow_metadata(true);
    undamaged(path, || ParquetFile::open(file, options))?
        .map_err(|source| TableError::Parquet { path: path.to_path_buf(), source })
}

/// The Parquet reader panics on some damaged pages; a damaged file is no bug of ours.
pub(super) fn undamaged<T>(path: &Path, read: impl FnOnce() -> T) -> Result<T, TableError> {
    unpanicked(read).ok_or_else(|| TableError::Damaged { path: path.to_path_buf() })
}

/// A column that is not what the contract says.
struct Misfit {
    column: &'static str,
    what: String,
}

impl Misfit {
    fn kind(column: &'static str, found: &ArrayRef) -> Misfit {
        Misfit { column, what: format!("has type {}, which does not fit", found.data_type()) }
    }

    fn null(column: &'static str) -> Misfit {
        Misfit { column, what: "has a null, and may have none".into() }
    }
}

/// Names by index, in the order of their first appearance.
#[derive(Default)]
struct Names {
    list: Vec<String>,
    index: HashMap<String, u16>,
}

impl From<&serde_json::Value> for Names {
    fn from(document: &serde_json::Value) -> Names {
        let mut names = Names::default();
        for name in document.as_array().into_iter().flatten().filter_map(|n| n.as_str()) {
            names.intern(name);
        }
        names
    }
}

impl Names {
    fn intern(&mut self, name: &str) -> Option<u16> {
        if let Some(&known) = self.index.get(name) {
            return Some(known);
        }
        let new = u16::try_from(self.list.len()).ok()?;
        self.list.push(name.to_string());
        self.index.insert(name.to_string(), new);
        Some(new)
    }

    fn indices(&mut self, texts: &Texts, column: &'static str) -> Result<Vec<Option<u16>>, Misfit> {
        texts.parse(column, |name| self.intern(name))
    }
}

/// A text column as keys into its distinct values.
struct Texts {
    keys: Vec<Option<usize>>,
    values: Vec<Option<String>>,
}

impl Texts {
    fn of(column: &ArrayRef) -> Option<Texts> {
        if let Some(dictionary) = column.as_any_dictionary_opt() {
            let values = plain(dictionary.values())?;
            if values.is_empty() {
                return Some(Texts { keys: vec![None; column.len()], values });
            }
            let keys = dictionary.normalized_keys().into_iter().enumerate();
            let keys = keys.map(|(row, key)| column.is_valid(row).then_some(key)).collect();
            return Some(Texts { keys, values });
        }
        // texts mostly repeat the one before
        let mut index: HashMap<&str, usize> = HashMap::new();
        let mut last = None;
        let mut values = Vec::new();
        let mut key = |text| match last {
            Some((before, key)) if before == text => key,
            _ => {
                let key = *index.entry(text).or_insert_with(|| {
                    values.push(Some(text.to_owned()));
                    values.len() - 1
                });
                last = Some((text, key));
                key
            }
        };
        let keys = texts(column)?.map(|text| text.map(&mut key)).collect();
        Some(Texts { keys, values })
    }

    /// Each row's value; a text that is none of the known ones is an error. Only texts that occur
    /// are looked at: a dictionary may hold more.
    fn parse<T: Copy>(
        &self,
        column: &'static str,
        mut parse: impl FnMut(&str) -> Option<T>,
    ) -> Result<Vec<Option<T>>, Misfit> {
        let mut parsed: Vec<Option<T>> = vec![None; self.values.len()];
        let value = |key: &Option<usize>| {
            let Some((key, text)) = key.and_then(|k| Some((k, self.values.get(k)?.as_ref()?)))
            else {
                return Ok(None);
            };
            if parsed[key].is_none() {
                parsed[key] = parse(text);
            }
            let unknown = || Misfit { column, what: format!("has `{text}`, which is unknown") };
            parsed[key].map(Some).ok_or_else(unknown)
        };
        self.keys.iter().map(value).collect()
    }

    fn required(
        self,
        column: &'static str,
    ) -> Result<(Vec<u32>, Vec<std::sync::Arc<str>>), Misfit> {
        let names = self.values.iter().map(|v| v.as_deref().unwrap_or_default().into()).collect();
        let known = |key: usize| self.values.get(key).is_some_and(Option::is_some);
        let key = |key: &Option<usize>| key.filter(|&k| known(k)).and_then(|k| k.try_into().ok());
        let keys: Option<Vec<u32>> = self.keys.iter().map(key).collect();
        Ok((keys.ok_or_else(|| Misfit::null(column))?, names))
    }
}

fn plain(column: &ArrayRef) -> Option<Vec<Option<String>>> {
    Some(texts(column)?.map(|text| text.map(String::from)).collect())
}

/// Values of a column that may have no null.
fn required<T>(values: Vec<Option<T>>, column: &'static str) -> Result<Vec<T>, Misfit> {
    values.into_iter().collect::<Option<_>>().ok_or_else(|| Misfit::null(column))
}

fn whole<T: TryFrom<u64>>(
    values: &[Option<f64>],
    column: &'static str,
) -> Result<Vec<Option<T>>, Misfit> {
    let one = |v: f64| {
        let n = (v >= 0.0 && v <= f64::from(u32::MAX) && v.fract() == 0.0).then_some(v as u64);
        let wrong = || Misfit { column, what: format!("has {v}, which is out of range") };
        n.and_then(|n| T::try_from(n).ok()).ok_or_else(wrong)
    };
    values.iter().map(|v| v.map(one).transpose()).collect()
}

/// A text column, dictionary or not. `None`: it is none.
pub(super) fn plain_texts(column: &ArrayRef) -> Option<Vec<Option<String>>> {
    let texts = Texts::of(column)?;
    let text = |key: &Option<usize>| key.and_then(|k| texts.values.get(k)?.clone());
    Some(texts.keys.iter().map(text).collect())
}

/// A column of times. `None`: it is none, or out of range.
pub(super) fn timestamps_ns(column: &ArrayRef) -> Option<Vec<Option<i64>>> {
    let (values, factor) = times(column)?;
    values
        .into_iter()
        .map(|v| v.map(|v| v.checked_mul(factor)).map_or(Some(None), |ns| ns.map(Some)))
        .collect()
}

fn nanoseconds(array: &ArrayRef, column: &'static str) -> Result<Vec<i64>, Misfit> {
    let (values, factor) = times(array).ok_or_else(|| Misfit::kind(column, array))?;
    let one = |value: i64| {
        let out_of_range = || Misfit { column, what: format!("has {value}, out of range") };
        value.checked_mul(factor).ok_or_else(out_of_range)
    };
    required(values, column)?.into_iter().map(one).collect()
}

/// Starts and values of the weights.
fn weights(array: &ArrayRef, column: &'static str) -> Result<(Vec<Option<u32>>, Vec<f32>), Misfit> {
    let mut starts = Vec::with_capacity(array.len());
    let mut weights = Vec::new();
    for row in 0..array.len() {
        let values = match inside(array, row) {
            None if array.is_valid(row) => return Err(Misfit::kind(column, array)),
            values => values,
        };
        starts.push(values.as_ref().and_then(|_| u32::try_from(weights.len()).ok()));
        if let Some(values) = values {
            let of_row = numbers(&values).ok_or_else(|| Misfit::kind(column, &values))?;
            weights.extend(of_row.iter().map(|w| w.unwrap_or(f64::NAN) as f32));
        }
    }
    Ok((starts, weights))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::verdict_table::tests::{options, rows};
    use crate::verdict_table::{TableOptions, TimestampUnit, VerdictWriter};
    use arrow_array::{Int64Array, StringArray, StringViewArray, TimestampMicrosecondArray};
    use arrow_schema::{DataType, Field, Schema};
    use parquet::arrow::add_encoded_arrow_schema_to_metadata;
    use parquet::arrow::arrow_writer::{ArrowWriter, ArrowWriterOptions};
    use parquet::file::properties::WriterProperties;
    use std::fs::File;
    use std::sync::Arc;

    pub(crate) fn read_all(mut reader: VerdictReader) -> (Vec<VerdictColumns>, TableOptions) {
        let rows = reader.by_ref().map(Result::unwrap).collect();
        let lists = TableOptions {
            recording: "r.mcap".into(),
            classes: reader.classes().to_vec(),
            categories: reader.categories().to_vec(),
            ..options(false, TimestampUnit::Ns)
        };
        (rows, lists)
    }

    /// Rows as text, with names in place of indices.
    pub(crate) fn row_texts(c: &VerdictColumns, lists: &TableOptions) -> Vec<String> {
        let row = |i: usize| {
            let name = |list: &[String], of: Option<u16>| of.map(|k| list[k as usize].clone());
            let text = |column: &Column| match &column.cells {
                Cells::Recording => String::new(),
                Cells::Time(at) => at.of(c)[i].to_string(),
                Cells::Printhead(at) => c.printheads[at.of(c)[i] as usize].to_string(),
                Cells::Channel(at) => at.of(c)[i].to_string(),
                Cells::Outcome(at) => format!("{:?}", at.of(c)[i]),
                Cells::Category(at) => format!("{:?}", name(&lists.categories, at.of(c)[i])),
                Cells::Class(at) => format!("{:?}", name(&lists.classes, at.of(c)[i])),
                Cells::Test(at) => format!("{:?}", at.of(c)[i]),
                Cells::Reason(at) => format!("{:?}", at.of(c)[i]),
                Cells::Model(at) => format!("{:?}", at.of(c)[i]),
                Cells::Statistic(at) | Cells::Threshold(at) => format!("{:?}", at.of(c)[i]),
                Cells::Misfit(at) | Cells::Number(at) => format!("{:?}", at.of(c)[i]),
                Cells::Weights => {
                    let start = c.weights_start.get(i).copied().flatten().map(|s| s as usize);
                    format!("weights {:?}", start.map(|s| &c.weights[s..s + 3]))
                }
            };
            COLUMNS.iter().map(text).collect::<Vec<_>>().join(" ")
        };
        (0..c.len()).map(row).collect()
    }

    fn write(path: &Path, columns: Vec<(&str, ArrayRef)>) {
        let fields: Vec<Field> =
            columns.iter().map(|(n, c)| Field::new(*n, c.data_type().clone(), true)).collect();
        let schema = Arc::new(Schema::new(fields));
        let columns = columns.into_iter().map(|c| c.1).collect();
        let batch = RecordBatch::try_new(schema.clone(), columns).unwrap();
        let mut writer = ArrowWriter::try_new(File::create(path).unwrap(), schema, None).unwrap();
        writer.write(&batch).unwrap();
        writer.close().unwrap();
    }

    fn rewritten() -> Vec<(&'static str, ArrayRef)> {
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
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("t.parquet");
        write(&path, rewritten());
        let (batches, lists) = read_all(VerdictReader::open(&path).unwrap());
        let c = &batches[0];
        assert_eq!(c.acquired_at_ns, [1000, -2000]);
        assert_eq!(c.channel, [7, u32::MAX]);
        assert_eq!(c.outcome, [Outcome::Healthy, Outcome::Faulty]);
        assert_eq!(c.fault, [None, Some(0)]);
        assert_eq!(lists.classes, ["EC"]);
        assert_eq!(c.severity, [None, Some(0.5)]);
        assert_eq!(c.certainty, [None, None]);
        let names: Vec<&str> = c.printhead.iter().map(|&p| &*c.printheads[p as usize]).collect();
        assert_eq!(names, ["K", "L"]);
    }

    /// What pandas puts beside a column without a value: the reader of it panics.
    #[test]
    fn arrow_schema_that_claims_a_dictionary_of_nulls_is_not_believed() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("t.parquet");
        let mut columns = rewritten();
        columns.push(("reason", Arc::new(arrow_array::NullArray::new(2))));
        let field = |(n, c): &(&str, ArrayRef)| Field::new(*n, c.data_type().clone(), true);
        let honest: Vec<Field> = columns.iter().map(field).collect();
        let mut claimed = honest.clone();
        let nulls = DataType::Dictionary(Box::new(DataType::Int8), Box::new(DataType::Null));
        *claimed.last_mut().unwrap() = Field::new("reason", nulls, true);
        let mut properties = WriterProperties::builder().build();
        add_encoded_arrow_schema_to_metadata(&Schema::new(claimed), &mut properties);
        let options =
            ArrowWriterOptions::new().with_skip_arrow_metadata(true).with_properties(properties);
        let schema = Arc::new(Schema::new(honest));
        let arrays = columns.into_iter().map(|c| c.1).collect();
        let batch = RecordBatch::try_new(schema.clone(), arrays).unwrap();
        let file = File::create(&path).unwrap();
        let mut writer = ArrowWriter::try_new_with_options(file, schema, options).unwrap();
        writer.write(&batch).unwrap();
        writer.close().unwrap();
        let (batches, _) = read_all(VerdictReader::open(&path).unwrap());
        assert_eq!(batches[0].reason, [None, None]);
    }

    #[test]
    fn what_is_no_verdict_table_is_refused_with_the_column() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("t.parquet");
        let refused = |column: &str, array: Option<ArrayRef>| {
            let mut columns = rewritten();
            match array {
                None => columns.retain(|c| c.0 != column),
                Some(array) => columns.iter_mut().find(|c| c.0 == column).unwrap().1 = array,
            }
            write(&path, columns);
            let error = VerdictReader::open(&path).unwrap().next().unwrap().unwrap_err();
            assert!(error.to_string().contains(&format!("`{column}`")), "{error}");
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

    #[test]
    fn a_table_of_no_rows_reads_as_no_rows() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("t.parquet");
        let mut writer = VerdictWriter::create(&path, options(true, TimestampUnit::Ns)).unwrap();
        writer.write(&rows(0, 0, &[]).into()).unwrap();
        writer.finish("{}".into()).unwrap();
        let (batches, _) = read_all(VerdictReader::open(&path).unwrap());
        assert_eq!(batches.iter().map(VerdictColumns::len).sum::<usize>(), 0);
    }
}
