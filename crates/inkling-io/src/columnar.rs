//! Parquet and Arrow IPC tables, as others write them.
//!
//! In: a file and which columns. Out: a [`Table`] where a row is an instant and a cell a number, as of CSV; or
//! [`Matrix`]es where a cell is a list: then a row is a burst, its lists the channels, in the order of the
//! columns, and of a list of lists every inner one a channel.

use super::arrow_cells::{self, counted, inside, is_list, unit};
use super::matrix::Matrix;
use super::mcap_records::MAGIC;
use super::parquet_file::{self, ParquetFile};
use super::table_file::{
    ChosenColumns, Columns, DecayName, Rows, Table, TableError, choose_columns,
};
use super::unpanicked::unpanicked;
use super::{Limits, ipc_sizes, regular_file, result_file};
use arrow_array::cast::AsArray;
use arrow_array::{Array, ArrayRef, RecordBatch};
use arrow_schema::{DataType, SchemaRef, TimeUnit};
use parquet::arrow::arrow_reader::ArrowReaderOptions;
use std::io::Cursor;
use std::path::Path;

const BATCH_ROWS: usize = 4096;
/// Of an Arrow IPC file: it is checked as a whole.
const MOST_IPC_BYTES: u64 = 1 << 30;
/// Samples of all bursts that are held in memory.
const MOST_SAMPLES: usize = 1 << 27;

/// What kind of table a file begins like.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileKind {
    Parquet,
    ArrowFile,
    ArrowStream,
    Numpy,
    Text,
}

pub fn kind_of(path: &Path) -> Result<FileKind, TableError> {
    start(path).map(|start| kind_by(&start))
}

/// Of a file that is to be a table, which JSON and recordings are not.
pub fn table_kind_of(path: &Path) -> Result<FileKind, TableError> {
    let start = start(path)?;
    match start.starts_with(b"{") || start.starts_with(MAGIC) {
        true => Err(TableError::NoTable { path: path.into(), instead: result_file::instead(path) }),
        false => Ok(kind_by(&start)),
    }
}

fn start(path: &Path) -> Result<Vec<u8>, TableError> {
    regular_file::start(path, 8).map_err(|e| TableError::unread(path, e))
}

fn kind_by(start: &[u8]) -> FileKind {
    match start {
        [b'P', b'A', b'R', b'1', ..] => FileKind::Parquet,
        [b'A', b'R', b'R', b'O', b'W', b'1', ..] => FileKind::ArrowFile,
        [0xff, 0xff, 0xff, 0xff, ..] => FileKind::ArrowStream,
        [0x93, b'N', b'U', b'M', b'P', b'Y', ..] | [b'P', b'K', 3, 4, ..] => FileKind::Numpy,
        _ => FileKind::Text,
    }
}

/// What a columnar file holds.
pub enum Content {
    Rows(Table),
    Bursts { time: Option<String>, outputs: Vec<String>, matrices: Vec<Matrix> },
}

/// Reads a table; what a library cannot bear to read is an error, too.
pub fn read(path: &Path, kind: FileKind, columns: &Columns) -> Result<Content, TableError> {
    let whole = || read_batches(path, kind, columns);
    unpanicked(whole)
        .unwrap_or_else(|| Err(TableError::wrong(path, "is damaged: it cannot be read".into())))
}

type Batches = Box<dyn Iterator<Item = Result<RecordBatch, arrow_schema::ArrowError>>>;

fn open(path: &Path, kind: FileKind) -> Result<(SchemaRef, Batches), TableError> {
    let failed = |source| TableError::unread(path, source);
    let damaged = |e: &dyn std::fmt::Display| {
        TableError::wrong(
            path,
            format!("cannot be read: {}", super::printable::of_parser(&e.to_string())),
        )
    };
    Ok(match kind {
        FileKind::ArrowFile => {
            let bytes = regular_file::read(path, MOST_IPC_BYTES).map_err(failed)?;
            ipc_sizes::check_file(&bytes).map_err(|e| damaged(&e))?;
            let reader = arrow_ipc::reader::FileReader::try_new(Cursor::new(bytes), None)
                .map_err(|e| damaged(&e))?;
            (reader.schema(), Box::new(reader))
        }
        FileKind::ArrowStream => {
            let bytes = regular_file::read(path, MOST_IPC_BYTES).map_err(failed)?;
            ipc_sizes::check_stream(&bytes).map_err(|e| damaged(&e))?;
            let reader = arrow_ipc::reader::StreamReader::try_new(Cursor::new(bytes), None)
                .map_err(|e| damaged(&e))?;
            (reader.schema(), Box::new(reader))
        }
        _ => {
            let file = regular_file::open(path).map_err(failed)?;
            let options = ArrowReaderOptions::new();
            let reader = ParquetFile::open(file, options)
                .and_then(|builder| builder.with_batch_size(BATCH_ROWS).build())
                .map_err(|e| damaged(&parquet_file::words(&e)))?;
            (arrow_array::RecordBatchReader::schema(&reader), Box::new(reader))
        }
    })
}

fn read_batches(path: &Path, kind: FileKind, columns: &Columns) -> Result<Content, TableError> {
    let (schema, batches) = open(path, kind)?;
    let names: Vec<String> = schema.fields().iter().map(|field| field.name().clone()).collect();
    let chosen = choose_columns(names, columns).map_err(|what| columns.refused(path, what))?;
    let type_of = |c: usize| schema.field(c).data_type();
    let lists = chosen.outputs.iter().filter(|&&c| is_list(type_of(c))).count();
    if lists != 0 && lists != chosen.outputs.len() {
        let what = "some columns hold lists and some numbers: --outputs names those of one kind";
        return Err(TableError::wrong(path, what.into()));
    }
    let time = chosen.time.map(|c| with_unit(&chosen.names[c], type_of(c)));
    let columns = |batch: RecordBatch| batch.columns().iter().map(counted).collect();
    let batches = batches.map(|of| {
        of.map(columns).map_err(|e| TableError::wrong(path, super::printable::of_parser(&e)))
    });
    if lists == 0 {
        let table = read_rows(path, batches, &chosen, time.unwrap_or_default())?;
        return Ok(Content::Rows(table));
    }
    if chosen.burst.is_some() {
        let what = "--burst has no effect: each row holds lists and is a burst by itself";
        return Err(TableError::wrong(path, what.into()));
    }
    let outputs = chosen.outputs.iter().map(|&c| chosen.names[c].clone()).collect();
    Ok(Content::Bursts { time, outputs, matrices: read_lists(path, batches, &chosen)? })
}

/// Each row is a burst.
fn read_lists(
    path: &Path,
    batches: impl Iterator<Item = Result<Vec<ArrayRef>, TableError>>,
    chosen: &ChosenColumns,
) -> Result<Vec<Matrix>, TableError> {
    let mut matrices = Vec::new();
    let mut held = 0;
    for columns in batches {
        let columns = columns?;
        for row in 0..columns[chosen.outputs[0]].len() {
            let place = matrices.len() + 1;
            let of_row = |what: String| TableError::wrong(path, format!("row {place}: {what}"));
            let cell = |c: usize| {
                let column = &chosen.names[c];
                number(&columns[c], row)
                    .map_err(|of| of_row(format!("column {column:?}: {}", no_numbers(&of))))
            };
            let lists = chosen.outputs.iter().map(|&c| columns[c].clone());
            let mut matrix = matrix(lists, row).map_err(of_row)?;
            held += matrix.samples.len();
            if held > MOST_SAMPLES {
                let what =
                    format!("more than {MOST_SAMPLES} bytes of samples; cut it into several");
                return Err(TableError::wrong(path, what));
            }
            matrix.time = chosen.time.map(cell).transpose()?;
            let printhead = chosen.printhead.map(|c| text(&columns[c], row)).transpose();
            matrix.printhead =
                printhead.map_err(|of| of_row(format!("printhead column of type {of}")))?;
            matrix.beside = chosen.beside.iter().map(|&c| cell(c)).collect::<Result<_, _>>()?;
            matrices.push(matrix);
        }
    }
    match matrices.is_empty() {
        true => Err(TableError::wrong(path, "no rows".into())),
        false => Ok(matrices),
    }
}

/// Each row is an instant.
fn read_rows(
    path: &Path,
    batches: impl Iterator<Item = Result<Vec<ArrayRef>, TableError>>,
    chosen: &ChosenColumns,
    time: String,
) -> Result<Table, TableError> {
    let mut rows = Rows::new(chosen, time);
    let mut line = 0;
    for columns in batches {
        let columns = columns?;
        for row in 0..columns[chosen.outputs[0]].len() {
            line += 1;
            let name = |c: Option<usize>, what: &str| {
                let name = c.map_or(Ok(String::new()), |c| text(&columns[c], row));
                name.map_err(|of| TableError::wrong(path, format!("{what} column of type {of}")))
            };
            let burst = name(chosen.burst, "burst")?;
            let printhead = name(chosen.printhead, "printhead")?;
            let of = DecayName { burst: &burst, printhead: &printhead };
            let cell = |c: usize| number(&columns[c], row).map_err(|of| no_numbers(&of));
            rows.add(line, of, cell)
                .map_err(|what| TableError::wrong(path, format!("row {line}: {what}")))?;
        }
    }
    rows.table().ok_or_else(|| TableError::wrong(path, "no rows".into()))
}

fn no_numbers(of: &str) -> String {
    format!("values of type {of} are no numbers")
}

/// A column's name with the end that says its unit, where its type says it.
fn with_unit(name: &str, of: &DataType) -> String {
    let end = match unit(of) {
        Some(TimeUnit::Nanosecond) => "_ns",
        Some(TimeUnit::Microsecond) => "_us",
        Some(TimeUnit::Millisecond) => "_ms",
        Some(TimeUnit::Second) | None => "",
    };
    if name.ends_with(end) { name.to_owned() } else { format!("{name}{end}") }
}

fn matrix(lists: impl Iterator<Item = ArrayRef>, row: usize) -> Result<Matrix, String> {
    let mut channels: Vec<ArrayRef> = Vec::new();
    for list in lists {
        let of_row = inside(&list, row).ok_or("no samples")?;
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
    let mut numbers = Vec::with_capacity(channels.len() * n);
    for channel in channels.iter().map(counted) {
        for k in 0..n {
            let x = number(&channel, k).map_err(|of| format!("lists of {of}, not of numbers"))?;
            numbers.push(x);
        }
    }
    let matrix = Matrix::of(channels.len(), n, numbers.into_iter());
    matrix.ok_or_else(|| "too large for a burst".into())
}

/// A cell as a number; NaN where it is empty. The error names a type that has none.
fn number(array: &ArrayRef, row: usize) -> Result<f64, String> {
    let of = || super::printable::cell(&array.data_type().to_string());
    arrow_cells::number(array, row).ok_or_else(of)
}

fn text(array: &ArrayRef, row: usize) -> Result<String, String> {
    match array.data_type() {
        _ if array.is_null(row) => Ok(String::new()),
        DataType::Utf8 => Ok(array.as_string::<i32>().value(row).to_owned()),
        DataType::LargeUtf8 => Ok(array.as_string::<i64>().value(row).to_owned()),
        DataType::Utf8View => Ok(array.as_string_view().value(row).to_owned()),
        _ => number(array, row).map(|x| x.to_string()),
    }
}
