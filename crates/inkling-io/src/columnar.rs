//! Reads Parquet tables, as other programs write them, for `inkling convert`.
//!
//! In: a file, and which columns are what. Out: a [`Table`]. If the
//! cells of the output columns are numbers, a row is an instant, and rows are gathered to decays as
//! from CSV. If the cells are lists, a row is a burst: its lists are the channels in the order of
//! the columns, and of a list of lists every inner list is a channel.
//!
//! Files may be hostile: claimed sizes are checked before a library allocates by them
//! (`parquet_file`), and a panic of a library becomes an error.

use super::arrow_cells::{self, counted, inside, is_list, is_list_of_lists, unit_ns};
use super::file_error::FileError;
use super::mcap_records::MAGIC;
use super::parquet_file::{self, ParquetFile};
use super::table_columns::{ChosenColumns, Columns, choose_columns};
use super::table_file::{Decay, MOST_CELLS, Moment, Rows, Table, unread};
use super::time_column::{self, TimeUnit};
use super::unpanicked::unpanicked;
use super::{Limits, printable, regular_file, result_file, unread_file};
use arrow_array::cast::AsArray;
use arrow_array::types::{Decimal128Type, Int64Type};
use arrow_array::{Array, ArrayRef, RecordBatchReader as _};
use arrow_schema::{DataType, FieldRef, Schema};
use parquet::arrow::arrow_reader::{ArrowReaderOptions, ParquetRecordBatchReader};
use std::path::Path;

/// Rows that are read at once.
const BATCH_ROWS: usize = 4096;

/// Whether a table is Parquet, by its first bytes; else it is text. A file that is something else is
/// refused with what to do.
pub fn is_parquet(path: &Path) -> Result<bool, FileError> {
    let start = regular_file::start(path, 32).map_err(unread(path))?;
    Ok(match start[..] {
        [b'P', b'A', b'R', b'1', ..] => true,
        _ if start.starts_with(b"{") || start.starts_with(MAGIC) => {
            let instead = result_file::instead(path);
            let what = format!("no table{instead}; CSV and Parquet are converted");
            return Err(FileError::mistaken(path, what));
        }
        _ => match unread_file::kind(&start) {
            Some(kind) => {
                let what =
                    "in Python, `import inkling` takes arrays; or export it as CSV or Parquet";
                return Err(FileError::mistaken(path, format!("no table, but {kind}: {what}")));
            }
            None => false,
        },
    })
}

pub fn read(path: &Path, columns: &Columns) -> Result<Table, FileError> {
    let whole = || read_batches(path, columns);
    unpanicked(whole)
        .unwrap_or_else(|| Err(FileError::failed(path, "is damaged: it cannot be read")))
}

fn open(path: &Path) -> Result<ParquetRecordBatchReader, FileError> {
    let file = regular_file::open(path).map_err(unread(path))?;
    ParquetFile::open(file, ArrowReaderOptions::new())
        .and_then(|builder| builder.with_batch_size(BATCH_ROWS).build())
        .map_err(|e| {
            let what = printable::of_parser(&parquet_file::words(&e));
            FileError::failed(path, format!("cannot be read: {what}"))
        })
}

/// With the only column whose type is that of times as that of times, where nobody names one and no name says time.
fn typed_times(schema: &Schema, columns: &Columns) -> Columns {
    let Columns { time, outputs, burst, printhead, beside, .. } = columns;
    let names = || schema.fields().iter().map(|field| field.name());
    let taken = outputs.iter().flatten().chain(burst).chain(printhead).chain(beside);
    let taken: Vec<&String> = taken.collect();
    let is_typed = |field: &&FieldRef| matches!(field.data_type(), DataType::Timestamp(..));
    let typed: Vec<&FieldRef> = schema.fields().iter().filter(is_typed).collect();
    let only = match typed[..] {
        [one] if time.is_none() && !names().any(|name| time_column::is_time(name)) => {
            Some(one.name())
        }
        _ => None,
    };
    Columns {
        time: only.filter(|name| !taken.contains(name)).or(time.as_ref()).cloned(),
        ..columns.clone()
    }
}

fn read_batches(path: &Path, columns: &Columns) -> Result<Table, FileError> {
    let batches = open(path)?;
    let schema = batches.schema();
    let names: Vec<String> = schema.fields().iter().map(|field| field.name().clone()).collect();
    let typed = typed_times(&schema, columns);
    let mut chosen = choose_columns(names, &typed).map_err(|what| columns.refused(path, what))?;
    let type_of = |c: usize| schema.field(c).data_type();
    // with --period-s a column whose times cannot be read is as good as none
    let is_text =
        |c: usize| matches!(type_of(c), DataType::Utf8 | DataType::LargeUtf8 | DataType::Utf8View);
    if columns.spare_times() && chosen.time.is_some_and(is_text) {
        chosen.leave_times_out();
    }

    let are_lists = are_lists(path, &chosen, type_of)?;
    // numbers fill `rows`, lists fill `bursts`; the other one stays empty
    let (mut rows, mut bursts, mut held) = (Rows::new(&chosen), Vec::new(), 0);
    let mut line = 0;
    for batch in batches {
        let batch = batch.map_err(|e| FileError::failed(path, printable::of_parser(&e)))?;
        // times and durations become numbers of their own unit
        let columns: Vec<ArrayRef> = batch.columns().iter().map(counted).collect();
        for row in 0..batch.num_rows() {
            line += 1;
            let row = Row { chosen: &chosen, columns: &columns, row };
            let added = match are_lists {
                false => row.name(chosen.burst, "burst").and_then(|burst| {
                    let printhead = row.name(chosen.printhead, "printhead")?;
                    rows.add(line, &burst, &printhead, |c| row.number(c), |c| row.moment(c))
                }),
                true => row.burst(line).and_then(|burst| {
                    // a burst without samples takes room, too
                    held += 16 + burst.outputs.iter().map(|of| 4 + of.len()).sum::<usize>();
                    bursts.push(burst);
                    let too_many =
                        || format!("more than {MOST_CELLS} samples; cut the table into several");
                    (held <= MOST_CELLS).then_some(()).ok_or_else(too_many)
                }),
            };
            added.map_err(|what| FileError::failed(path, format!("row {line}: {what}")))?;
        }
    }

    if line == 0 {
        return Err(FileError::failed(path, "no rows"));
    }
    // the type of a time beats the column's name
    let of_type = chosen.time.and_then(|c| TimeUnit::of_ns(unit_ns(type_of(c))? as f64));
    if of_type.is_some() && columns.unit.is_some() {
        let what = "--time-unit has no effect: the type of the column says its unit";
        return Err(FileError::mistaken(path, what));
    }
    let by_name = || chosen.unit(columns).map_err(|what| columns.refused(path, what));
    let unit = of_type.map_or_else(by_name, |unit| Ok(Some(unit)))?;
    // where a column holds several channels, the column's name is no channel's name
    let several = chosen.outputs.iter().any(|&c| is_list_of_lists(type_of(c)));
    // `rows` gives no table if it is empty; then the table is that of the bursts
    let of_bursts = || Table { rows_are_bursts: true, decays: bursts, ..Table::of(&chosen, unit) };
    let table = rows.table(unit).unwrap_or_else(of_bursts);
    Ok(if several { Table { outputs: Vec::new(), ..table } } else { table })
}

fn are_lists<'a>(
    path: &Path,
    chosen: &ChosenColumns,
    type_of: impl Fn(usize) -> &'a DataType,
) -> Result<bool, FileError> {
    let lists = chosen.outputs.iter().filter(|&&c| is_list(type_of(c))).count();
    if lists == 0 {
        return Ok(false);
    }
    if lists != chosen.outputs.len() {
        let what = "some columns hold lists and some numbers: --outputs names those of one kind";
        return Err(FileError::failed(path, what));
    }
    match chosen.burst {
        None => Ok(true),
        Some(_) => {
            let what = "--burst has no effect: each row holds lists and is a burst by itself";
            Err(FileError::mistaken(path, what))
        }
    }
}

struct Row<'a> {
    chosen: &'a ChosenColumns,
    columns: &'a [ArrayRef],
    row: usize,
}

impl Row<'_> {
    /// A cell as a number; NaN where it is empty.
    fn number(&self, c: usize) -> Result<f64, String> {
        number(&self.columns[c], self.row)
            .map_err(|of| format!("values of type {of} are no numbers"))
    }

    /// A cell as a time; whole numbers keep all their digits.
    fn moment(&self, c: usize) -> Result<Moment, String> {
        let column = &self.columns[c];
        match column.as_primitive_opt::<Int64Type>().filter(|of| of.is_valid(self.row)) {
            Some(of) => Ok(Moment { whole: of.value(self.row), rest: 0.0 }),
            None => self.number(c).map(Moment::from),
        }
    }

    /// The text in a column; empty if no column was chosen.
    fn name(&self, c: Option<usize>, what: &str) -> Result<String, String> {
        let name = c.map_or(Ok(String::new()), |c| text(&self.columns[c], self.row));
        name.map_err(|of| format!("{what} column of type {of}"))
    }

    /// The burst of a row whose cells are lists.
    fn burst(&self, line: u64) -> Result<Decay, String> {
        let chosen = self.chosen;
        let outputs = channels(chosen.outputs.iter().map(|&c| &self.columns[c]), self.row)?;
        let cell = |c: usize| self.number(c).map_err(|what| chosen.of_column(c, &what));
        let time = chosen.time.map(|c| self.moment(c).map_err(|what| chosen.of_column(c, &what)));
        let printhead = self.name(chosen.printhead, "printhead")?;
        chosen.check_names("", &printhead)?;
        let beside =
            chosen.beside.iter().map(|&c| Ok(vec![cell(c)?])).collect::<Result<_, String>>()?;
        let mut burst = Decay { printhead, line, outputs, beside, ..Decay::default() };
        time.transpose()?.into_iter().for_each(|time| burst.push_time(time));
        Ok(burst)
    }
}

/// The samples of a row of lists, channel by channel.
fn channels<'a>(
    lists: impl Iterator<Item = &'a ArrayRef>,
    row: usize,
) -> Result<Vec<Vec<f64>>, String> {
    let mut channels: Vec<ArrayRef> = Vec::new();
    for list in lists {
        let of_row = inside(list, row).ok_or("no samples")?;
        match is_list(of_row.data_type()) {
            true => {
                for i in 0..of_row.len() {
                    channels.push(inside(&of_row, i).ok_or("a channel without samples")?);
                }
            }
            false => channels.push(of_row),
        }
    }

    let limits = Limits::default();
    let n = channels.first().map_or(0, |channel| channel.len());
    if n == 0 || channels.iter().any(|channel| channel.len() != n) {
        return Err("its channels have no samples, or not equally many".into());
    }
    if channels.len() > limits.channels as usize || n > limits.samples_per_channel as usize {
        return Err(format!("{} channels of {n} samples: too large for a burst", channels.len()));
    }

    let sample = |channel: &ArrayRef, k: usize| {
        number(channel, k).map_err(|of| format!("lists of {of}, not of numbers"))
    };
    let channels = channels.iter().map(counted);
    channels.map(|channel| (0..n).map(|k| sample(&channel, k)).collect()).collect()
}

/// A cell as a number; NaN where it is null. The error is the type of cells that hold none.
fn number(array: &ArrayRef, row: usize) -> Result<f64, String> {
    let (array, row) = resolved(array, row)?;
    let of = || printable::cell(&array.data_type().to_string());
    match array.data_type() {
        _ if array.is_null(row) => Ok(f64::NAN),
        DataType::Decimal128(_, scale) => {
            let digits = array.as_primitive::<Decimal128Type>().value(row) as f64;
            Ok(digits / 10f64.powi((*scale).into()))
        }
        _ => arrow_cells::number(array, row).ok_or_else(of),
    }
}

/// Where a cell has its value: that of a dictionary (pandas' categories) stands among the dictionary's. Keys are looked
/// up cell by cell, since a column of texts may be far larger without them.
fn resolved(array: &ArrayRef, row: usize) -> Result<(&ArrayRef, usize), String> {
    let Some(of) = array.as_any_dictionary_opt().filter(|of| of.is_valid(row)) else {
        return Ok((array, row));
    };
    let key = arrow_cells::number(of.keys(), row).filter(|&key| key < of.values().len() as f64);
    resolved(of.values(), key.ok_or("dictionary without that key")? as usize)
}

/// A cell as a text, empty where it is null.
fn text(array: &ArrayRef, row: usize) -> Result<String, String> {
    let (array, row) = resolved(array, row)?;
    match array.data_type() {
        _ if array.is_null(row) => Ok(String::new()),
        DataType::Utf8 => Ok(array.as_string::<i32>().value(row).to_owned()),
        DataType::LargeUtf8 => Ok(array.as_string::<i64>().value(row).to_owned()),
        DataType::Utf8View => Ok(array.as_string_view().value(row).to_owned()),
        _ => number(array, row).map(|x| x.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::place;
    use arrow_array::builder::{Int16Builder, ListBuilder};
    use arrow_array::{
        Decimal128Array, DictionaryArray, Float64Array, Int32Array, RecordBatch,
        TimestampNanosecondArray, TimestampSecondArray,
    };
    use parquet::arrow::ArrowWriter;
    use std::sync::Arc;

    fn reread(columns: [(&str, ArrayRef); 2]) -> Table {
        reread_by(columns, &Columns::default())
    }

    fn reread_by<const N: usize>(columns: [(&str, ArrayRef); N], chosen: &Columns) -> Table {
        let batch = RecordBatch::try_from_iter(columns).unwrap();
        let (_dir, path) = place("t.parquet");
        let file = std::fs::File::create(&path).unwrap();
        let mut writer = ArrowWriter::try_new(file, batch.schema(), None).unwrap();
        writer.write(&batch).unwrap();
        writer.close().unwrap();
        read(&path, chosen).unwrap()
    }

    #[test]
    fn times_in_ns_keep_their_digits_and_decimals_and_dictionaries_are_numbers() {
        let ns = 1_772_536_953_000_000_000;
        let times: ArrayRef = Arc::new(TimestampNanosecondArray::from(vec![ns + 1, ns + 782]));
        let decimals = Decimal128Array::from(vec![1_500, -250]).with_precision_and_scale(10, 3);
        let keys = Int32Array::from(vec![1, 0]);
        let values = Arc::new(Float64Array::from(vec![-0.25, 1.5]));
        let dictionary = DictionaryArray::new(keys, values);
        let outputs: [ArrayRef; 2] = [Arc::new(decimals.unwrap()), Arc::new(dictionary)];
        for output in outputs {
            let decay = &reread([("t", times.clone()), ("y", output)]).decays[0];
            assert_eq!((decay.base, &*decay.times), (ns + 1, &[0.0, 781.0][..]));
            assert_eq!(decay.outputs, [[1.5, -0.25]]);
        }
    }

    #[test]
    fn what_stands_beside_samples_is_kept_row_by_row() {
        let times: ArrayRef = Arc::new(Float64Array::from(vec![0.0, 1.0, 50.0]));
        let warm: ArrayRef = Arc::new(Float64Array::from(vec![25.0, 25.0, 26.0]));
        let beside = Columns { beside: vec!["warm".into()], ..Columns::default() };
        let table = reread_by([("t", times.clone()), ("y", times), ("warm", warm)], &beside);
        assert_eq!(table.decays[0].beside, [[25.0, 25.0, 26.0]]);
    }

    /// A time column named so, whose type says seconds, and a list of two channels.
    fn two_channels(time: &str) -> Table {
        let mut lists = ListBuilder::new(ListBuilder::new(Int16Builder::new()));
        for _ in 0..2 {
            lists.values().values().append_slice(&[1, 2, 3]);
            lists.values().append(true);
        }
        lists.append(true);
        let times: ArrayRef = Arc::new(TimestampSecondArray::from(vec![1_767_000_000]));
        reread([(time, times), ("samples", Arc::new(lists.finish()))])
    }

    #[test]
    fn the_only_column_of_a_type_of_times_is_that_of_times_wherever_it_stands() {
        let times: ArrayRef =
            Arc::new(TimestampSecondArray::from(vec![1_767_000_000, 1_767_000_001]));
        let values: ArrayRef = Arc::new(Float64Array::from(vec![3.5, 1.5]));
        let table = reread([("pressure", values), ("__index_level_0__", times)]);
        assert_eq!(
            (table.outputs, &table.decays[0].outputs),
            (vec!["pressure".into()], &vec![vec![3.5, 1.5]])
        );
    }

    #[test]
    fn a_column_of_several_channels_is_no_channels_name_and_the_type_of_a_time_beats_its_name() {
        assert!(two_channels("t").outputs.is_empty());
        assert_eq!(two_channels("t_ms").unit, Some(TimeUnit::SECONDS));
    }
}
