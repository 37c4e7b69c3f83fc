//! Reads tables of CSV that other programs wrote.
//!
//! In: CSV, and which columns are what ([`Columns`]). Out: a [`Table`] of decays.
//!
//! `table_text.rs` reads the records, `csv_cells.rs` their cells. With semicolon and tab, decimal commas are read,
//! too; lines that begin with `#` are passed over, and a row of units below the names is read (`csv_units.rs`). No
//! cell of times and outputs is dropped silently: a cell that is no number is an error that names the line, and so is
//! a missing time; a missing output is kept as NaN, and `sampling.rs` counts it.

use super::csv_cells::{Cells, Grouped, no_number, unquoted};
use super::csv_units::{self, Units};
use super::file_error::{FileError, line_of};
use super::table_columns::{ChosenColumns, Columns, choose_columns};
use super::table_file::{LONGEST_NAME, Rows, Table, unread};
use super::table_text::{TextError, TextOptions, TextTable};
use super::time_column::TimeUnit;
use super::{printable, regular_file};
use csv::StringRecord;
use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;

/// Most bytes of CSV that are read; columns that nobody asks for count, too.
const MOST_BYTES: u64 = 1 << 34;

pub fn read(path: &Path, columns: &Columns) -> Result<Table, FileError> {
    read_from(regular_file::open(path).map_err(unread(path))?, path, columns)
}

fn read_from(
    input: impl Read + 'static,
    path: &Path,
    columns: &Columns,
) -> Result<Table, FileError> {
    let options =
        TextOptions { skip_lines: columns.skip_lines, comments: true, most_bytes: MOST_BYTES };
    let mut text = TextTable::open(input, options).map_err(unread(path))?;
    let table = read_rows(&mut text, path, columns);
    // what stands before a table is none of its rows, whatever is wrong with it
    table.map_err(|e| match text.begins_below() {
        Some(what) => FileError::failed(path, what),
        None => e,
    })
}

fn read_rows(text: &mut TextTable, path: &Path, columns: &Columns) -> Result<Table, FileError> {
    let at = |line: u64| move |what: String| FileError::Failed { place: line_of(path, line), what };
    let failed = |e: TextError| match e {
        TextError::Io(e) => unread(path)(e),
        TextError::NoText { line } => at(line)("is not UTF-8 text".into()),
    };
    let refused = |what| columns.refused(path, what);
    let Some((_, header)) = text.next_names().map_err(failed)? else {
        let what = "is empty: a line of column names and rows of numbers are needed";
        return Err(FileError::failed(path, what));
    };
    let cells = Cells { decimal_comma: text.delimiter != b',' };
    let mut chosen = choose(&header, columns, cells).map_err(refused)?;

    // the first row may be one of units
    let mut ahead = [text.next_names().map_err(failed)?, text.next_record().map_err(failed)?];
    let mut unit = None;
    if let [Some((line, row)), below] = &ahead {
        let below = below.as_ref().map(|(_, row)| row);
        let units = csv_units::read(row, below, &mut chosen, columns, cells).map_err(at(*line))?;
        if let Some(Units { of_time }) = units {
            (unit, ahead[0]) = (of_time, None);
        }
    }
    // with --period-s a column whose times cannot be read is as good as none
    if let (true, Some(c), Some((_, row))) =
        (columns.spare_times(), chosen.time, ahead.iter().flatten().next())
        && cells.moment(row.get(c).unwrap_or_default(), 1.0).is_none_or(|time| time.rest.is_nan())
    {
        chosen.leave_times_out();
    }
    if unit.is_none() {
        unit = chosen.unit(columns).map_err(refused)?;
    }

    // dates become numbers in the unit of their column, seconds where nothing says one
    let date_unit_ns = unit.unwrap_or(TimeUnit::SECONDS).ns;
    let (mut rows, mut grouped) = (Rows::new(&chosen), BTreeMap::<usize, Grouped>::new());
    let behind = std::iter::from_fn(|| text.next_record().map_err(failed).transpose());
    for row in ahead.into_iter().flatten().map(Ok).chain(behind) {
        let (line, row) = row?;
        chosen.check_cells(&row, rows.is_empty()).map_err(at(line))?;
        let cell = |c: usize| row.get(c).unwrap_or_default();
        for c in chosen.time.iter().chain(&chosen.outputs).filter(|_| cells.decimal_comma) {
            if cells.number(cell(*c)).is_some_and(f64::is_finite) {
                grouped.entry(*c).or_default().add(cell(*c), line);
            }
        }
        let number = |c: usize| {
            let otherwise =
                "leave cells empty where nothing was measured, or choose columns by --outputs";
            cells.number(cell(c)).ok_or_else(|| no_number(cell(c), otherwise))
        };
        // only cells in the column of times may be dates
        let time = |c: usize| {
            let otherwise = match cell(c).contains(|c: char| c.is_ascii_digit()) {
                true => "write times as 2026-11-01T08:00:00.5, or as numbers",
                false => "remove the line, if it is no row of samples",
            };
            cells.moment(cell(c), date_unit_ns).ok_or_else(|| no_number(cell(c), otherwise))
        };
        let [burst, printhead] = [chosen.burst, chosen.printhead].map(|c| c.map_or("", cell));
        rows.add(line, burst, printhead, number, time).map_err(at(line))?;
    }
    if let Some((line, what)) = Grouped::mistake(&grouped.values().collect::<Vec<_>>()) {
        return Err(at(line)(what));
    }
    rows.table(unit).ok_or_else(|| FileError::failed(path, "a header and no rows"))
}

fn choose(header: &StringRecord, columns: &Columns, cells: Cells) -> Result<ChosenColumns, String> {
    let name = |of: &str| unquoted(of.trim_start_matches('\u{feff}').trim()).to_owned();
    let mut names: Vec<String> = header.iter().map(name).collect();
    // spreadsheets write separators for columns that were once there; the last one may hold remarks
    while names.len() > 2 && names[names.len() - 2..].iter().all(String::is_empty) {
        names.pop();
    }
    if let Some(name) = names.iter().find(|name| name.len() > LONGEST_NAME) {
        return Err(format!("a column's name is too long: {:?}", printable::cell(name)));
    }
    let is_number = |name: &String| cells.number(name).is_some_and(f64::is_finite);
    let unnamed = || {
        Err("the first line holds numbers: it must name the columns, without a # before them"
            .to_owned())
    };
    let is_row = names.iter().all(|name| cells.number(name).is_some());
    if is_row && names.iter().any(is_number) && !are_counted(&names) {
        return unnamed();
    }
    if let ([only], false) = (&names[..], columns.rows_are_samples) {
        return Err(format!(
            "{:?} has no comma, semicolon or tab, which separate cells: a line sep=| above it says another sign; \
             tr -s ' ' , makes commas of blanks; --period-s takes a column of samples alone",
            printable::cell(only)
        ));
    }
    let chosen = choose_columns(names, columns)?;
    match columns.time.is_none() && chosen.time.is_some_and(|c| is_number(&chosen.names[c])) {
        true => unnamed(),
        false => Ok(chosen),
    }
}

/// Whether names are numbers that count columns behind an empty one, as pandas writes them above its index.
fn are_counted(names: &[String]) -> bool {
    let counts = |first: usize| {
        names[1..].iter().enumerate().all(|(n, name)| *name == (first + n).to_string())
    };
    names[0].is_empty() && (counts(0) || counts(1))
}

#[cfg(test)]
mod tests;
