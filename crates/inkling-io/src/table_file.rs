//! A table of time and outputs, as others write them: CSV here; Parquet, Arrow and NumPy become the same
//! [`Table`] in `columnar.rs` and `numpy.rs`. `inkling convert` makes a recording of it.
//!
//! In: CSV, and which columns are what. Out: [`Table`], its decays as written: times and one column per
//! output. Cells are separated by comma, semicolon (then with decimal commas) or tab; a byte order mark and
//! lines that begin with `#` are passed over. It must never drop a cell without saying so: a cell that is no
//! number is an error that names the line, and a missing cell is kept as NaN and counted by whoever samples.

use super::file_error::{FileError, line_of};
use super::matrix::Matrix;
use super::printable;
use super::regular_file::{self, Records};
use chrono::{DateTime, NaiveDateTime};
use csv::StringRecord;
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::io::{self, BufRead, BufReader, Read};
use std::path::Path;

/// Largest file that is read, columns that nobody asks for included.
const MOST_BYTES: u64 = 1 << 34;
/// Most bytes of a burst's or a printhead's name, and of a column's name.
const LONGEST_NAME: usize = 256;
/// Most characters of the columns' names in an error.
const MOST_NAMED: usize = 400;
/// Most cells that are held in memory: 16 bytes each, with the copy that is sampled.
const MOST_CELLS: usize = 1 << 25;

/// The error of a table that cannot be read. A file that is not there is the mistake of whoever named it.
pub(super) fn unread(path: &Path) -> impl Fn(io::Error) -> FileError {
    |e| match e.kind() {
        io::ErrorKind::NotFound => FileError::unread(path)(e),
        _ => FileError::failed(path, format!("cannot be read: {e}")),
    }
}

/// Which columns of a table are what, by name. If nobody says so, the first column that is not named here is
/// time, and all others are outputs.
#[derive(Clone, Debug, Default)]
pub struct Columns {
    pub time: Option<String>,
    pub outputs: Option<Vec<String>>,
    /// Column that tells the decays of a table apart: rows with the same value belong together.
    pub burst: Option<String>,
    /// Column of the printhead's name; it counts only if the table has a column of that name.
    pub printhead: Option<String>,
    /// Columns of neither times nor outputs, with one value for each decay, such as the temperature.
    pub beside: Vec<String>,
    /// Rows are samples one after the other: if no time column is named, none is taken for it.
    pub rows_are_samples: bool,
}

impl Columns {
    /// The error about columns. If the user named columns, the mistake is the user's, otherwise the table's.
    pub(super) fn refused(&self, path: &Path, what: String) -> FileError {
        let Columns { time, outputs, burst, printhead, beside, .. } = self;
        let named = [time, burst, printhead].iter().any(|name| name.is_some());
        match named || outputs.is_some() || !beside.is_empty() {
            true => FileError::mistaken(path, what),
            false => FileError::failed(path, what),
        }
    }
}

/// One decay of a table: the rows with one value of the burst column, in the table's order.
#[derive(Clone, Debug, Default)]
pub struct Decay {
    /// The value of the burst column; empty if there is none.
    pub name: String,
    /// The value of the printhead column; empty if there is none.
    pub printhead: String,
    /// The line of the table in which its first row stands.
    pub line: u64,
    /// Times of the samples, in the unit of the table.
    pub times: Vec<f64>,
    /// One column per output, each as long as `times`; NaN: missing.
    pub outputs: Vec<Vec<f64>>,
    /// Values of the columns of [`Columns::beside`] in its first row.
    pub beside: Vec<f64>,
}

impl Decay {
    /// The samples of the decay, without its times but the first. `has_time`: its first time says when it
    /// began. `None`: more samples than a burst may have.
    pub fn matrix(self, has_time: bool) -> Option<Matrix> {
        let numbers = self.outputs.iter().flatten().copied();
        let matrix = Matrix::of(self.outputs.len(), self.times.len(), numbers)?;
        Some(Matrix {
            time: self.times.first().copied().filter(|_| has_time),
            printhead: Some(self.printhead).filter(|name| !name.is_empty()),
            beside: self.beside,
            ..matrix
        })
    }
}

/// The content of a file, whatever its format was.
pub struct Table {
    /// Name of the column of times; if its type says the unit, an ending such as `_ns` is added.
    pub time: Option<String>,
    /// The first of the times.
    pub first_time: Option<f64>,
    /// Names of the outputs; they become channel 0, 1, 2 and so on.
    pub outputs: Vec<String>,
    pub content: Content,
}

/// A table consists of decays or of whole bursts.
pub enum Content {
    /// A table whose cells are numbers: its decays, in the order in which they first appear. There is at
    /// least one, and none is empty.
    Decays(Vec<Decay>),
    /// An array, or a table whose cells are lists: one matrix after the other.
    Bursts(Box<dyn Iterator<Item = Result<Matrix, FileError>>>),
}

/// Reads a table of CSV.
pub fn read(path: &Path, columns: &Columns) -> Result<Table, FileError> {
    let file = regular_file::open(path).map_err(unread(path))?;
    let mut file = BufReader::with_capacity(1 << 16, file);
    let delimiter = delimiter(file.fill_buf().map_err(unread(path))?);
    read_from(file, delimiter, path, columns)
}

/// The byte that separates cells: of semicolon, tab and comma the first one that occurs in the first line of
/// cells.
fn delimiter(start: &[u8]) -> u8 {
    let mut lines = start.split(|b| *b == b'\n').filter(|line| !line.trim_ascii().is_empty());
    let header = lines.find(|line| !line.starts_with(b"#")).unwrap_or_default();
    [b';', b'\t'].into_iter().find(|d| header.contains(d)).unwrap_or(b',')
}

/// Reads rows until the input ends. `path` is for errors.
fn read_from(
    input: impl Read,
    delimiter: u8,
    path: &Path,
    columns: &Columns,
) -> Result<Table, FileError> {
    let mut csv = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .delimiter(delimiter)
        .comment(Some(b'#'))
        .from_reader(Records::new(input, MOST_BYTES));
    let failed = |e| csv_error(path, e);
    let header = csv.headers().map_err(failed)?.clone();
    if header.is_empty() {
        let what = "is empty: a line of column names and rows of numbers are needed";
        return Err(FileError::failed(path, what));
    }

    let decimal_comma = delimiter != b',';
    let chosen =
        choose(&header, columns, decimal_comma).map_err(|what| columns.refused(path, what))?;

    let mut rows = Rows::new(&chosen);
    let mut record = StringRecord::new();
    while csv.read_record(&mut record).map_err(failed)? {
        csv.get_mut().record_ends();
        let line = record.position().map_or(0, csv::Position::line);
        let text = |c: Option<usize>| c.and_then(|c| record.get(c)).unwrap_or_default();
        let cell = |c: usize| {
            let cell = record.get(c).unwrap_or_default();
            let time = || time_in(cell).filter(|_| chosen.time == Some(c));
            number_in(cell, decimal_comma).or_else(|e| time().ok_or(e))
        };
        rows.add(line, text(chosen.burst), text(chosen.printhead), cell)
            .map_err(|what| FileError::Failed { place: line_of(path, line), what })?;
    }
    let time = chosen.time.map(|c| chosen.names[c].clone());
    rows.table(time).ok_or_else(|| FileError::failed(path, "a header and no rows"))
}

/// An error of the csv crate, with its line.
fn csv_error(path: &Path, e: csv::Error) -> FileError {
    let line = e.position().map_or(1, csv::Position::line);
    let what = match e.into_kind() {
        csv::ErrorKind::Io(source) => return unread(path)(source),
        csv::ErrorKind::Utf8 { .. } => "is not UTF-8 text".into(),
        csv::ErrorKind::UnequalLengths { expected_len, len, .. } => {
            format!("{len} cells where the header has {expected_len}")
        }
        other => format!("{other:?}"),
    };
    FileError::Failed { place: line_of(path, line), what }
}

/// A time such as 2026-11-01T08:00:00.5Z as seconds since 1970. There may be a blank instead of the T, and no
/// zone, which then is UTC.
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

/// Decays that are being gathered, row by row.
pub(super) struct Rows<'a> {
    chosen: &'a ChosenColumns,
    decays: Vec<Decay>,
    /// The place of each decay among `decays`, by the names of burst and printhead.
    by_name: HashMap<(String, String), usize>,
    /// Cells that are held so far.
    cells: usize,
}

impl Rows<'_> {
    pub fn new(chosen: &ChosenColumns) -> Rows<'_> {
        Rows { chosen, decays: Vec::new(), by_name: HashMap::new(), cells: 0 }
    }

    /// Adds a row to the decay of these names. `cell` gives what the row has in a column.
    pub fn add(
        &mut self,
        line: u64,
        burst: &str,
        printhead: &str,
        cell: impl Fn(usize) -> Result<f64, String>,
    ) -> Result<(), String> {
        let chosen = self.chosen;
        let cell = |c: usize| cell(c).map_err(|what| chosen.of_column(c, &what));
        self.cells += 1 + chosen.outputs.len();
        if self.cells > MOST_CELLS {
            return Err(format!(
                "more than {MOST_CELLS} cells of time and outputs; cut the table into several"
            ));
        }
        let decays = &mut self.decays;
        let place = match self.by_name.entry((burst.to_owned(), printhead.to_owned())) {
            Entry::Occupied(known) => *known.get(),
            Entry::Vacant(new) => {
                let beside = chosen.beside.iter().map(|&c| cell(c)).collect::<Result<_, _>>()?;
                let is_long = |name: &&str| name.len() > LONGEST_NAME;
                if let Some(long) = [burst, printhead].into_iter().find(is_long) {
                    return Err(format!("burst {:?}: a name that long?", printable::cell(long)));
                }
                // a decay of its own takes about as much memory as 16 cells
                self.cells += 16;
                let (name, printhead) = (burst.to_owned(), printhead.to_owned());
                let outputs = vec![Vec::new(); chosen.outputs.len()];
                decays.push(Decay { name, printhead, line, times: Vec::new(), outputs, beside });
                *new.insert(decays.len() - 1)
            }
        };

        let decay = &mut decays[place];
        let time = match chosen.time {
            Some(c) => Some(cell(c)?)
                .filter(|t| t.is_finite())
                .ok_or_else(|| chosen.of_column(c, "a row without a time"))?,
            None => decay.times.len() as f64,
        };
        decay.times.push(time);
        for (column, &c) in decay.outputs.iter_mut().zip(&chosen.outputs) {
            column.push(cell(c)?);
        }
        Ok(())
    }

    /// The table of all rows. `time` is the name of the column of times. `None`: there were no rows.
    pub fn table(self, time: Option<String>) -> Option<Table> {
        let first_time = self.decays.first()?.times.first().copied();
        let (outputs, content) = (self.chosen.output_names(), Content::Decays(self.decays));
        Some(Table { first_time: first_time.filter(|_| time.is_some()), time, outputs, content })
    }
}

/// The places of the columns that are read, among all columns of the table.
pub(super) struct ChosenColumns {
    pub names: Vec<String>,
    pub time: Option<usize>,
    pub outputs: Vec<usize>,
    pub burst: Option<usize>,
    pub printhead: Option<usize>,
    pub beside: Vec<usize>,
}

impl ChosenColumns {
    /// An error about a cell, with the column's name.
    pub fn of_column(&self, c: usize, what: &str) -> String {
        format!("column {:?}: {what}", self.names[c])
    }

    /// Names of the outputs, which become the channels in this order.
    pub fn output_names(&self) -> Vec<String> {
        self.outputs.iter().map(|&c| self.names[c].clone()).collect()
    }
}

/// Finds the columns by the names in the first line. Whatever is ambiguous is refused, and so is a first line
/// of numbers.
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

/// Finds the columns among names that are names for certain.
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

/// A cell as a number; NaN where it is empty or says that nothing was measured.
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

/// A cell without quotes. The csv crate takes quotes that follow a blank for a part of the cell.
fn unquoted(cell: &str) -> &str {
    cell.strip_prefix('"').and_then(|cell| cell.strip_suffix('"')).unwrap_or(cell)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(text: &str, columns: &Columns) -> Result<(Table, Vec<Decay>), String> {
        let path = Path::new("t.csv");
        let mut table = read_from(text.as_bytes(), delimiter(text.as_bytes()), path, columns)
            .map_err(|e| e.to_string())?;
        match std::mem::replace(&mut table.content, Content::Decays(Vec::new())) {
            Content::Decays(decays) => Ok((table, decays)),
            Content::Bursts(_) => panic!("rows, not bursts"),
        }
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
        let (t, decays) = table("t,a,b\n0,1,2\n1,3,4\n", &Columns::default()).unwrap();
        assert_eq!((t.time.as_deref(), t.first_time), (Some("t"), Some(0.0)));
        assert_eq!(t.outputs, ["a", "b"]);
        assert_eq!(decays.len(), 1);
        assert_eq!(decays[0].times, [0.0, 1.0]);
        assert_eq!(decays[0].outputs, [[1.0, 3.0], [2.0, 4.0]]);
    }

    #[test]
    fn a_burst_column_groups_rows_also_where_they_alternate() {
        let text = "gap,t,in,out\nx,0,9,1\ny,0,9,2\nx,1,9,3\ny,1,9,4\n";
        let (_, decays) = table(text, &columns("t", "out", "gap")).unwrap();
        let names: Vec<&str> = decays.iter().map(|d| d.name.as_str()).collect();
        assert_eq!(names, ["x", "y"]);
        assert_eq!(decays[1].outputs, [[2.0, 4.0]]);
        assert_eq!(decays[1].line, 3);
        let (t, _) = table(text, &columns("", "", "gap")).unwrap();
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
            let (t, decays) = table(text, &Columns::default()).unwrap();
            assert_eq!((t.time.as_deref(), &decays[0].outputs), (Some("t"), &expected), "{text}");
        }
    }

    #[test]
    fn missing_cells_are_nan_and_what_is_no_number_names_its_line() {
        let (_, decays) = table("t,y\n0,\n1,NaN\n2,3\n", &Columns::default()).unwrap();
        let y = &decays[0].outputs[0];
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
            let e = table(text, &Columns::default()).err().unwrap();
            assert!(e.contains(says), "{text:?}: {e}");
        }
        for (columns, says) in [
            (columns("u", "", ""), "no column \"u\"; there are t, y"),
            (columns("t", "y,y", ""), "asked for twice"),
            (columns("t", "t", ""), "asked for twice"),
        ] {
            let e = table("t,y\n0,1\n", &columns).err().unwrap();
            assert!(e.contains(says), "{e}");
        }
    }

    #[test]
    fn text_that_is_not_utf_8_is_an_error() {
        let e = read_from(&b"t,y\n0,1\n1,\xff\n"[..], b',', Path::new("t"), &Columns::default());
        assert!(e.err().unwrap().to_string().contains("line 3: is not UTF-8"));
    }
}
