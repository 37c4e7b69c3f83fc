//! A table of time and outputs, as others write them. In: CSV and which columns. Out: [`Table`], its
//! decays as written: times and one column per output.
//!
//! Comma, semicolon (then with decimal commas) or tab; a byte order mark and lines that begin with
//! `#` are passed over. It must never drop a cell without saying so: what is no number is an error
//! that names the line, what is missing is kept as NaN and counted by whoever samples.

use super::printable;
use super::regular_file::{self, Records};
use chrono::{DateTime, NaiveDateTime};
use csv::StringRecord;
use std::collections::HashMap;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Columns that are not asked for included.
const MOST_BYTES: u64 = 1 << 34;
/// Bytes of a value of the burst column, and of a column's name.
const LONGEST_NAME: usize = 256;
/// Characters of the columns' names in a message.
const MOST_NAMED: usize = 400;
/// Cells that we hold in memory at most: 16 bytes each with the copy that is sampled.
const MOST_CELLS: usize = 1 << 25;

#[derive(Debug, Error)]
pub enum TableError {
    #[error("{path}: cannot be read: {source}")]
    Read { path: PathBuf, source: std::io::Error },
    #[error("{path}, line {line}: {what}")]
    Line { path: PathBuf, line: u64, what: String },
    #[error("{path}: {what}")]
    Columns { path: PathBuf, what: String },
    /// Of the columns that were asked for.
    #[error("{path}: {what}")]
    Choice { path: PathBuf, what: String },
    #[error("{path}: no table{instead}; CSV, Parquet, Arrow IPC, .npy and .npz are converted")]
    NoTable { path: PathBuf, instead: String },
}

impl TableError {
    pub(super) fn unread(path: &Path, source: std::io::Error) -> TableError {
        TableError::Read { path: path.into(), source }
    }

    pub(super) fn wrong(path: &Path, what: String) -> TableError {
        TableError::Columns { path: path.into(), what }
    }
}

/// Which columns are what; `None`: the first that is not the burst column is time, the rest outputs.
#[derive(Clone, Debug, Default)]
pub struct Columns {
    pub time: Option<String>,
    pub outputs: Option<Vec<String>>,
    pub burst: Option<String>,
    /// Whose bursts they are, if there is a column of that name.
    pub printhead: Option<String>,
    /// What is neither: one value a decay.
    pub beside: Vec<String>,
    /// Rows are samples one after the other: without a time column none is taken for it.
    pub rows_are_samples: bool,
}

impl Columns {
    /// Whose mistake it is: the table's, or of whoever named columns of it.
    pub(super) fn refused(&self, path: &Path, what: String) -> TableError {
        let Columns { time, outputs, burst, printhead, beside, .. } = self;
        let named = [time, burst, printhead].iter().any(|name| name.is_some());
        let path = path.into();
        match named || outputs.is_some() || !beside.is_empty() {
            true => TableError::Choice { path, what },
            false => TableError::Columns { path, what },
        }
    }
}

/// One decay of a table: rows of one value of the burst column, in the table's order.
#[derive(Clone, Debug, Default)]
pub struct Decay {
    /// The value of the burst column; empty without one.
    pub name: String,
    /// The value of the printhead column; empty without one.
    pub printhead: String,
    /// The table's line of its first row.
    pub line: u64,
    /// In the unit of the table.
    pub times: Vec<f64>,
    /// One column per output, each as long as `times`; NaN: missing.
    pub outputs: Vec<Vec<f64>>,
    /// Of its first row, as [`Columns::beside`] asks.
    pub beside: Vec<f64>,
}

#[derive(Clone, Debug)]
pub struct Table {
    /// Empty: rows are samples one after the other.
    pub time: String,
    /// Names of the outputs: channel 0, 1, 2 ...
    pub outputs: Vec<String>,
    /// In the order in which they first appear; at least one, none of them empty.
    pub decays: Vec<Decay>,
}

/// Reads a table.
pub fn read(path: &Path, columns: &Columns) -> Result<Table, TableError> {
    let unreadable = |source| TableError::unread(path, source);
    let file = regular_file::open(path).map_err(unreadable)?;
    let mut file = BufReader::with_capacity(1 << 16, file);
    let delimiter = delimiter(file.fill_buf().map_err(unreadable)?);
    read_from(file, delimiter, path, columns)
}

/// What separates cells: of semicolon, tab and comma the first that the first line of cells has.
fn delimiter(start: &[u8]) -> u8 {
    let mut lines = start.split(|b| *b == b'\n').filter(|line| !line.trim_ascii().is_empty());
    let header = lines.find(|line| !line.starts_with(b"#")).unwrap_or_default();
    [b';', b'\t'].into_iter().find(|d| header.contains(d)).unwrap_or(b',')
}

fn read_from(
    input: impl Read,
    delimiter: u8,
    path: &Path,
    columns: &Columns,
) -> Result<Table, TableError> {
    let mut csv = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .delimiter(delimiter)
        .comment(Some(b'#'))
        .from_reader(Records::new(input, MOST_BYTES));
    let failed = |e| csv_error(path, e);
    let wrong = |what| TableError::wrong(path, what);
    let header = csv.headers().map_err(failed)?.clone();
    if header.is_empty() {
        let what = "is empty: a line of column names and rows of numbers are needed";
        return Err(wrong(what.to_owned()));
    }
    let decimal_comma = delimiter != b',';
    let chosen =
        choose(&header, columns, decimal_comma).map_err(|what| columns.refused(path, what))?;
    let time = chosen.time.map_or(String::new(), |c| chosen.names[c].clone());
    let mut rows = Rows::new(&chosen, time);
    let mut record = StringRecord::new();
    while csv.read_record(&mut record).map_err(failed)? {
        csv.get_mut().record_ends();
        let line = record.position().map_or(0, csv::Position::line);
        let text = |c: Option<usize>| c.and_then(|c| record.get(c)).unwrap_or_default();
        let of = DecayName { burst: text(chosen.burst), printhead: text(chosen.printhead) };
        let cell = |c: usize| {
            let cell = record.get(c).unwrap_or_default();
            let time = || time_in(cell).filter(|_| chosen.time == Some(c));
            number_in(cell, decimal_comma).or_else(|e| time().ok_or(e))
        };
        rows.add(line, of, cell).map_err(|what| line_error(path, line, what))?;
    }
    rows.table().ok_or_else(|| wrong("a header and no rows".to_owned()))
}

fn csv_error(path: &Path, e: csv::Error) -> TableError {
    let line = e.position().map_or(1, csv::Position::line);
    match e.into_kind() {
        csv::ErrorKind::Io(source) => TableError::unread(path, source),
        csv::ErrorKind::Utf8 { .. } => line_error(path, line, "is not UTF-8 text".into()),
        csv::ErrorKind::UnequalLengths { expected_len, len, .. } => {
            let what = format!("{len} cells where the header has {expected_len}");
            line_error(path, line, what)
        }
        other => line_error(path, line, format!("{other:?}")),
    }
}

/// Which decay a row is of.
#[derive(Clone, Copy, Debug)]
pub(super) struct DecayName<'a> {
    pub burst: &'a str,
    pub printhead: &'a str,
}

/// A time such as 2026-11-01T08:00:00.5Z, or with a blank and without its zone, which is then UTC: s since 1970.
fn time_in(cell: &str) -> Option<f64> {
    let cell = unquoted(cell);
    let zoned = || DateTime::parse_from_rfc3339(cell).ok()?.timestamp_nanos_opt();
    let plain =
        |format| NaiveDateTime::parse_from_str(cell, format).ok()?.and_utc().timestamp_nanos_opt();
    let ns = zoned()
        .or_else(|| plain("%Y-%m-%d %H:%M:%S%.f"))
        .or_else(|| plain("%Y-%m-%dT%H:%M:%S%.f"))?;
    Some(ns as f64 / 1e9)
}

/// A table under way, row by row.
pub(super) struct Rows<'a> {
    chosen: &'a ChosenColumns,
    table: Table,
    /// Places of the decays, by burst and printhead.
    by_name: HashMap<(String, String), usize>,
    cells: usize,
}

impl Rows<'_> {
    /// `time`: name of its column.
    pub fn new(chosen: &ChosenColumns, time: String) -> Rows<'_> {
        let outputs = chosen.outputs.iter().map(|&c| chosen.names[c].clone()).collect();
        let table = Table { time, outputs, decays: Vec::new() };
        Rows { chosen, table, by_name: HashMap::new(), cells: 0 }
    }

    /// The next row, of the decay named so; `cell`: what it has in a column.
    pub fn add(
        &mut self,
        line: u64,
        of: DecayName,
        cell: impl Fn(usize) -> Result<f64, String>,
    ) -> Result<(), String> {
        let chosen = self.chosen;
        let of_column = |c: usize, what: &str| format!("column {:?}: {what}", chosen.names[c]);
        let cell = |c: usize| cell(c).map_err(|what| of_column(c, &what));
        self.cells += 1 + chosen.outputs.len();
        if self.cells > MOST_CELLS {
            return Err(format!(
                "more than {MOST_CELLS} cells of time and outputs; cut the table into several"
            ));
        }
        let key = (of.burst.to_owned(), of.printhead.to_owned());
        let place = match self.by_name.get(&key) {
            Some(place) => *place,
            None => {
                let beside = chosen.beside.iter().map(|&c| cell(c)).collect::<Result<_, _>>()?;
                let place = self.begin(line, of, beside)?;
                self.by_name.insert(key, place);
                place
            }
        };
        let decay = &mut self.table.decays[place];
        let time = match chosen.time {
            Some(c) => Some(cell(c)?)
                .filter(|t| t.is_finite())
                .ok_or_else(|| of_column(c, "a row without a time"))?,
            None => decay.times.len() as f64,
        };
        decay.times.push(time);
        for (column, &c) in decay.outputs.iter_mut().zip(&chosen.outputs) {
            column.push(cell(c)?);
        }
        Ok(())
    }

    /// A decay without rows: its place.
    fn begin(&mut self, line: u64, of: DecayName, beside: Vec<f64>) -> Result<usize, String> {
        let DecayName { burst: name, printhead } = of;
        if let Some(long) = [name, printhead].into_iter().find(|name| name.len() > LONGEST_NAME) {
            return Err(format!("burst {:?}: a name that long?", printable::cell(long)));
        }
        // a decay of its own takes about as much as eight rows
        self.cells += 16;
        let (name, printhead) = (name.into(), printhead.into());
        let outputs = vec![Vec::new(); self.chosen.outputs.len()];
        self.table.decays.push(Decay { name, printhead, line, times: Vec::new(), outputs, beside });
        Ok(self.table.decays.len() - 1)
    }

    /// `None`: there were no rows.
    pub fn table(self) -> Option<Table> {
        (!self.table.decays.is_empty()).then_some(self.table)
    }
}

fn line_error(path: &Path, line: u64, what: String) -> TableError {
    TableError::Line { path: path.into(), line, what }
}

/// The places of a table's columns that are read.
pub(super) struct ChosenColumns {
    pub names: Vec<String>,
    pub time: Option<usize>,
    pub outputs: Vec<usize>,
    pub burst: Option<usize>,
    pub printhead: Option<usize>,
    pub beside: Vec<usize>,
}

/// Columns by name. Whatever is ambiguous is refused.
fn choose(
    header: &StringRecord,
    columns: &Columns,
    decimal_comma: bool,
) -> Result<ChosenColumns, String> {
    let names: Vec<String> = header
        .iter()
        .map(|h| unquoted(h.trim_start_matches('\u{feff}').trim()).to_owned())
        .collect();
    if let Some(name) = names.iter().find(|name| name.len() > LONGEST_NAME) {
        return Err(format!("a column's name is too long: {:?}", printable::cell(name)));
    }
    let numbers =
        names.iter().filter(|name| number_in(name, decimal_comma).is_ok_and(f64::is_finite));
    if numbers.count() == names.len() {
        return Err("the first line holds numbers: it must name the columns".to_owned());
    }
    choose_columns(names, columns)
}

/// The same of columns that have names for certain.
pub(super) fn choose_columns(
    names: Vec<String>,
    columns: &Columns,
) -> Result<ChosenColumns, String> {
    let place = |name: &str| {
        let mut places = (0..names.len()).filter(|&c| names[c] == name);
        match (places.next(), places.next()) {
            (Some(place), None) => Ok(place),
            (Some(_), Some(_)) => Err(format!("there are several columns {name:?}: rename them")),
            (None, _) => {
                let there = printable::line(&names.join(", "), MOST_NAMED);
                Err(format!("no column {name:?}; there are {there}"))
            }
        }
    };
    let burst = columns.burst.as_deref().map(place).transpose()?;
    let beside: Vec<usize> =
        columns.beside.iter().map(|name| place(name)).collect::<Result<_, _>>()?;
    let whose = columns.printhead.as_ref().filter(|name| names.contains(name));
    let printhead = whose.map(|name| place(name)).transpose()?;
    let taken = |c: usize| [burst, printhead].contains(&Some(c)) || beside.contains(&c);
    let time = match &columns.time {
        Some(name) => Some(place(name)?),
        None if columns.rows_are_samples => None,
        None => {
            let first = (0..names.len()).find(|c| !taken(*c));
            Some(first.ok_or("there is no column left for time")?)
        }
    };
    let outputs: Vec<usize> = match &columns.outputs {
        Some(outputs) => outputs.iter().map(|name| place(name)).collect::<Result<_, _>>()?,
        None => (0..names.len()).filter(|c| Some(*c) != time && !taken(*c)).collect(),
    };
    if outputs.is_empty() {
        let time = time.map_or("", |c| &names[c]);
        return Err(format!("no column is left for an output beside {time:?}"));
    }
    let all = outputs.iter().chain(&time).chain(&burst).chain(&printhead).chain(&beside);
    let mut used: Vec<usize> = all.copied().collect();
    used.sort_unstable();
    for (i, &c) in used.iter().enumerate() {
        place(&names[c])?; // the default takes columns by place: equal names would be two channels
        if used.get(i + 1) == Some(&c) {
            return Err(format!("the column {:?} is asked for twice", names[c]));
        }
    }
    Ok(ChosenColumns { names, time, outputs, burst, printhead, beside })
}

/// A cell as a number; NaN where it is empty or says so.
fn number_in(cell: &str, decimal_comma: bool) -> Result<f64, String> {
    let cell = unquoted(cell);
    if cell.is_empty()
        || ["nan", "na", "null", "none", "-"].iter().any(|w| cell.eq_ignore_ascii_case(w))
    {
        return Ok(f64::NAN);
    }
    let parsed = match decimal_comma && cell.contains(',') && !cell.contains('.') {
        true => cell.replacen(',', ".", 1).parse::<f64>(),
        false => cell.parse(),
    };
    match parsed {
        // samples are stored as f32
        Ok(x) if x.abs() <= f64::from(f32::MAX) || x.is_nan() => Ok(x),
        Ok(_) => Err(format!("{} is too large for a sample (f32)", printable::cell(cell))),
        Err(_) => Err(format!("{:?} is no number", printable::cell(cell))),
    }
}

/// Quotes after a blank are none to the csv crate.
fn unquoted(cell: &str) -> &str {
    cell.strip_prefix('"').and_then(|cell| cell.strip_suffix('"')).unwrap_or(cell)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(text: &str, columns: &Columns) -> Result<Table, String> {
        let path = Path::new("t.csv");
        read_from(text.as_bytes(), delimiter(text.as_bytes()), path, columns)
            .map_err(|e| e.to_string())
    }

    fn columns(time: &str, outputs: &str, burst: &str) -> Columns {
        let some = |name: &str| (!name.is_empty()).then(|| name.to_owned());
        Columns {
            time: some(time),
            outputs: some(outputs).map(|o| o.split(',').map(str::to_owned).collect()),
            burst: some(burst),
            ..Columns::default()
        }
    }

    #[test]
    fn the_first_column_is_time_and_the_rest_are_outputs() {
        let t = table("t,a,b\n0,1,2\n1,3,4\n", &Columns::default()).unwrap();
        assert_eq!((t.time.as_str(), t.outputs.join(" ")), ("t", "a b".to_owned()));
        assert_eq!(t.decays.len(), 1);
        assert_eq!(t.decays[0].times, [0.0, 1.0]);
        assert_eq!(t.decays[0].outputs, [[1.0, 3.0], [2.0, 4.0]]);
    }

    #[test]
    fn a_burst_column_groups_rows_also_where_they_alternate() {
        let text = "gap,t,in,out\nx,0,9,1\ny,0,9,2\nx,1,9,3\ny,1,9,4\n";
        let t = table(text, &columns("t", "out", "gap")).unwrap();
        let names: Vec<&str> = t.decays.iter().map(|d| d.name.as_str()).collect();
        assert_eq!(names, ["x", "y"]);
        assert_eq!(t.decays[1].outputs, [[2.0, 4.0]]);
        assert_eq!(t.decays[1].line, 3);
        let t = table(text, &columns("", "", "gap")).unwrap();
        assert_eq!(t.outputs, ["in", "out"]);
    }

    #[test]
    fn semicolons_decimal_commas_tabs_marks_comments_and_quotes_are_read() {
        let expected = vec![vec![1.5, -2e3]];
        for text in [
            "\u{feff}t;y\r\n0;1,5\r\n1;-2e3\r\n",
            "# made by hand\nt\ty\n0\t1.5\n1\t-2000\n",
            "\"t\", \"y\"\n\n0, \"1.5\"\n1, -2000.0\n",
        ] {
            let t = table(text, &Columns::default()).unwrap();
            assert_eq!((t.time.as_str(), &t.decays[0].outputs), ("t", &expected), "{text}");
        }
    }

    #[test]
    fn missing_cells_are_nan_and_what_is_no_number_names_its_line() {
        let t = table("t,y\n0,\n1,NaN\n2,3\n", &Columns::default()).unwrap();
        let y = &t.decays[0].outputs[0];
        assert!(y[0].is_nan() && y[1].is_nan() && y[2] == 3.0);
        for (text, says) in [
            ("t,y\n0,1\n1,abc\n", "line 3: column \"y\": \"abc\" is no number"),
            ("t,y\n0,1\n,2\n", "line 3: column \"t\": a row without a time"),
            ("t,y\n0,1\ninf,2\n", "line 3"),
            ("t,y\n0,1e60\n", "too large"),
            ("t,y\n0,1\n1\n", "line 3: 1 cells where the header has 2"),
            ("t,y\n", "no rows"),
            ("", "is empty: a line of column names"),
            ("0,1\n1,2\n", "must name the columns"),
            ("t\n0\n", "no column is left for an output"),
            ("t,y,y\n0,1,2\n", "several columns \"y\""),
        ] {
            let e = table(text, &Columns::default()).unwrap_err();
            assert!(e.contains(says), "{text:?}: {e}");
        }
        for (columns, says) in [
            (columns("u", "", ""), "no column \"u\"; there are t, y"),
            (columns("t", "y,y", ""), "asked for twice"),
            (columns("t", "t", ""), "asked for twice"),
        ] {
            let e = table("t,y\n0,1\n", &columns).unwrap_err();
            assert!(e.contains(says), "{e}");
        }
    }

    #[test]
    fn text_that_is_not_utf_8_is_an_error() {
        let e = read_from(&b"t,y\n0,1\n1,\xff\n"[..], b',', Path::new("t"), &Columns::default());
        assert!(e.unwrap_err().to_string().contains("line 3: is not UTF-8"));
    }
}
