//! Reads tables of CSV that other programs wrote, of which `inkling convert` makes recordings, and
//! defines the type [`Table`] for all foreign tables. `columnar.rs` reads Parquet and Arrow, and
//! `numpy.rs` arrays, into the same type.
//!
//! In, from `src/cli/convert`: CSV, and which columns are what ([`Columns`]). Out: a [`Table`] of
//! decays. A decay has the times of its samples (in the table's unit) and one column of samples for
//! each output (what was measured); it becomes a burst, and its outputs become the burst's
//! channels. Rows with the same burst and printhead are one decay. Nothing is moved to a regular
//! grid here: `sampling.rs` does that.
//!
//! Cells are separated by comma, semicolon or tab; with semicolon and tab, decimal commas are read,
//! too. A byte order mark and lines that begin with `#` are passed over. No cell of times and
//! outputs is dropped silently: a cell that is no number is an error that names the line, and so is
//! a missing time; a missing output is kept as NaN, and `sampling.rs` counts it. Of the columns
//! beside them ([`Columns::beside`]) only the first row of each decay is read.

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

/// Most bytes of CSV that are read; columns that nobody asks for count, too.
const MOST_BYTES: u64 = 1 << 34;
/// Most bytes of a column's name, and of a cell that names a burst or a printhead.
const LONGEST_NAME: usize = 256;
/// Most characters of the list of a table's columns in an error.
const MOST_NAMED: usize = 400;
/// Most cells of times and outputs that are held in memory.
const MOST_CELLS: usize = 1 << 25;

/// The error for a table that cannot be read. A file that is not there is the mistake of whoever
/// named it; other failures are nobody's.
pub(super) fn unread(path: &Path) -> impl Fn(io::Error) -> FileError {
    |e| match e.kind() {
        io::ErrorKind::NotFound => FileError::unread(path)(e),
        _ => FileError::failed(path, format!("cannot be read: {e}")),
    }
}

/// Which columns of a table are what, by name; of a `.npz`, which arrays.
#[derive(Clone, Debug, Default)]
pub struct Columns {
    /// Column of times. `None`: the first column that is none of `burst`, `printhead` and `beside`,
    /// unless `rows_are_samples`. If `outputs` names that first column, the choice is refused.
    pub time: Option<String>,
    /// Columns of outputs, in the order of the channels. `None`: all columns that are nothing else.
    pub outputs: Option<Vec<String>>,
    /// Column that tells the decays of a table apart: rows that have the same value here, and the same
    /// printhead, are one decay.
    pub burst: Option<String>,
    /// What the user gave for the printhead. If the table has a column of this name, that column
    /// holds each row's printhead; if not, this is the name of the printhead itself, and no column
    /// is read for it.
    pub printhead: Option<String>,
    /// Columns with one value for each decay, such as the temperature.
    pub beside: Vec<String>,
    /// Whether something else (`--period-s`) says the sample period, so that rows need no times:
    /// then no column is taken for times unless `time` names one, whose first value in a decay says
    /// when the decay began.
    pub rows_are_samples: bool,
}

impl Columns {
    /// An error about the choice of columns. It is the user's mistake if the user named any column,
    /// otherwise the table's fault. A printhead's name does not count, as it need not be a
    /// column's.
    pub(super) fn refused(&self, path: &Path, what: String) -> FileError {
        let Columns { time, outputs, burst, beside, .. } = self;
        match time.is_some() || outputs.is_some() || burst.is_some() || !beside.is_empty() {
            true => FileError::mistaken(path, what),
            false => FileError::failed(path, what),
        }
    }
}

/// One decay of a table, which becomes one burst: the rows of the same burst and printhead, in the table's
/// order.
#[derive(Clone, Debug, Default)]
pub struct Decay {
    /// The value of the burst column; empty if there is none.
    pub name: String,
    /// The value of the printhead column; empty if there is none.
    pub printhead: String,
    /// Where the decay's first row stands: the line of a CSV file, otherwise the number of the row,
    /// from 1 on.
    pub line: u64,
    /// Times of the samples, in the unit of the column of times; dates in CSV count from 1970.
    pub times: Vec<f64>,
    /// The samples of each output, as many as `times`; NaN: missing.
    pub outputs: Vec<Vec<f64>>,
    /// Values of the columns of [`Columns::beside`] in the decay's first row; NaN: missing.
    pub beside: Vec<f64>,
}

impl Decay {
    /// The decay as channels × samples, one channel for each output. Of the times only the first is
    /// kept, as the time when the decay began; `has_time`: `times` are times, not numbers of rows.
    /// `None`: more samples than a burst may have.
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
    /// Name of the column of times, whose ending (such as `_ns`) says their unit ([`unit_ns`]). If
    /// the type of an Arrow column or NumPy array says the unit, the reader has added the ending.
    /// `None`: there are no times.
    pub time: Option<String>,
    /// The first time of the first decay or burst: if no ending says the unit, the caller may guess
    /// it by the size of this number.
    pub first_time: Option<f64>,
    /// Names of the columns of outputs, in the order of the channels; empty where channels have no names: in
    /// a NumPy array, and in a column of several channels.
    pub outputs: Vec<String>,
    pub content: Content,
}

/// A table consists of decays, whose samples have times of their own, or of whole bursts.
pub enum Content {
    /// A table whose cells are numbers: its decays, in the order of their first rows.
    Decays(Vec<Decay>),
    /// An array, or a table whose cells are lists: its bursts, one after the other.
    Bursts(Box<dyn Iterator<Item = Result<Matrix, FileError>>>),
}

pub fn read(path: &Path, columns: &Columns) -> Result<Table, FileError> {
    let file = regular_file::open(path).map_err(unread(path))?;
    let mut file = BufReader::with_capacity(1 << 16, file);
    let delimiter = delimiter(file.fill_buf().map_err(unread(path))?);
    read_from(file, delimiter, path, columns)
}

/// The byte that separates cells, told from the first line that is neither empty nor a comment: the semicolon
/// if that line has one, else the tab if it has one, else the comma.
fn delimiter(start: &[u8]) -> u8 {
    let mut lines = start.split(|b| *b == b'\n').filter(|line| !line.trim_ascii().is_empty());
    let header = lines.find(|line| !line.starts_with(b"#")).unwrap_or_default();
    [b';', b'\t'].into_iter().find(|d| header.contains(d)).unwrap_or(b',')
}

/// Reads the header, chooses the columns, and reads rows until the input ends.
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

    // which columns are read
    let decimal_comma = delimiter != b',';
    let chosen =
        choose(&header, columns, decimal_comma).map_err(|what| columns.refused(path, what))?;

    // dates become numbers in the unit of their column, seconds where its name says none; as f64 these hold
    // steps of .24 µs
    let date_unit_ns = chosen.time.and_then(|c| unit_ns(&chosen.names[c])).unwrap_or(1e9);

    let mut rows = Rows::new(&chosen);
    let mut record = StringRecord::new();
    while csv.read_record(&mut record).map_err(failed)? {
        csv.get_mut().record_ends();
        let line = record.position().map_or(0, csv::Position::line);
        let text = |c: Option<usize>| c.and_then(|c| record.get(c)).unwrap_or_default();
        let cell = |c: usize| {
            let cell = record.get(c).unwrap_or_default();
            // only cells in the column of times may be dates
            let date = || time_in(cell).filter(|_| chosen.time == Some(c));
            let time = || date().map(|ns| ns as f64 / date_unit_ns);
            number_in(cell, decimal_comma).or_else(|e| time().ok_or(e))
        };
        rows.add(line, text(chosen.burst), text(chosen.printhead), cell)
            .map_err(|what| FileError::Failed { place: line_of(path, line), what })?;
    }
    let time = chosen.time.map(|c| chosen.names[c].clone());
    rows.table(time).ok_or_else(|| FileError::failed(path, "a header and no rows"))
}

/// An error of the csv crate in words, with its line.
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

/// The unit of a column of times in ns (1e9 for `_s`), if the ending of the column's name says one.
pub fn unit_ns(column: &str) -> Option<f64> {
    let units = [("_s", 1e9), ("_ms", 1e6), ("_us", 1e3), ("_ns", 1.0)];
    units.iter().find(|(end, _)| column.ends_with(end)).map(|(_, ns)| *ns)
}

/// Parses a time such as 2026-11-01T08:00:00.5Z to ns since 1970. A blank may stand instead of the
/// T. A time without a zone is taken as UTC. `None`: the cell is no such time.
fn time_in(cell: &str) -> Option<i64> {
    let cell = unquoted(cell);
    let zoned = || DateTime::parse_from_rfc3339(cell).ok()?.timestamp_nanos_opt();
    let plain =
        |format| NaiveDateTime::parse_from_str(cell, format).ok()?.and_utc().timestamp_nanos_opt();
    zoned().or_else(|| plain("%Y-%m-%d %H:%M:%S%.f")).or_else(|| plain("%Y-%m-%dT%H:%M:%S%.f"))
}

/// Decays that are being gathered, row by row.
pub(super) struct Rows<'a> {
    chosen: &'a ChosenColumns,
    decays: Vec<Decay>,
    /// Index in `decays` of the decay of each burst and printhead.
    by_name: HashMap<(String, String), usize>,
    /// How many cells are held so far; each decay counts as 16 more.
    cells: usize,
}

impl Rows<'_> {
    /// No rows yet; `chosen` says which columns are read.
    pub fn new(chosen: &ChosenColumns) -> Rows<'_> {
        Rows { chosen, decays: Vec::new(), by_name: HashMap::new(), cells: 0 }
    }

    /// Adds a row to the decay of its burst and printhead, or begins a decay with it. `line`: see
    /// [`Decay::line`]; `cell` gives the number that the row has in a column. An error says in
    /// words what is wrong with the row.
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

        // the decay that the row belongs to; with its first row the values beside it are read
        let decays = &mut self.decays;
        let place = match self.by_name.entry((burst.to_owned(), printhead.to_owned())) {
            Entry::Occupied(known) => *known.get(),
            Entry::Vacant(new) => {
                let beside = chosen.beside.iter().map(|&c| cell(c)).collect::<Result<_, _>>()?;
                for (what, name) in [("burst", burst), ("printhead", printhead)] {
                    if name.len() > LONGEST_NAME {
                        let name = printable::cell(name);
                        return Err(format!("{what} {name:?}: a name that long?"));
                    }
                }
                // a decay of its own takes about as much memory as 16 cells
                self.cells += 16;
                let (name, printhead) = (burst.to_owned(), printhead.to_owned());
                let outputs = vec![Vec::new(); chosen.outputs.len()];
                decays.push(Decay { name, printhead, line, times: Vec::new(), outputs, beside });
                *new.insert(decays.len() - 1)
            }
        };

        // one time, and one sample for each output
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

    /// The table of all rows.
    pub fn table(self, time: Option<String>) -> Option<Table> {
        let first_time = self.decays.first()?.times.first().copied();
        let (outputs, content) = (self.chosen.output_names(), Content::Decays(self.decays));
        Some(Table { first_time: first_time.filter(|_| time.is_some()), time, outputs, content })
    }
}

/// Which columns are read, as indices among all columns of the table.
pub(super) struct ChosenColumns {
    /// Names of all columns.
    pub names: Vec<String>,
    pub time: Option<usize>,
    pub outputs: Vec<usize>,
    pub burst: Option<usize>,
    pub printhead: Option<usize>,
    pub beside: Vec<usize>,
}

impl ChosenColumns {
    /// An error about a cell, with the name of its column before it.
    pub fn of_column(&self, c: usize, what: &str) -> String {
        format!("column {:?}: {what}", self.names[c])
    }

    /// Names of the columns of outputs, in the order of the channels.
    pub fn output_names(&self) -> Vec<String> {
        self.outputs.iter().map(|&c| self.names[c].clone()).collect()
    }
}

/// Finds the columns of a CSV by the names in its first line.
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

/// Finds the columns by their names, in a table that is known to have names, such as Parquet.
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

    // columns that the user named; a printhead's name need not be a column
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

    // no column may be asked for twice, and none may share its name with another
    let all = outputs.iter().chain(&time).chain(&burst).chain(&printhead).chain(&beside);
    let mut used: Vec<usize> = all.copied().collect();
    used.sort_unstable();
    for (i, &c) in used.iter().enumerate() {
        // columns that nobody named were not looked up by name: two of the same name would be two
        // channels
        place(&names[c])?;
        if used.get(i + 1) == Some(&c) {
            let why = match columns.time.is_none() && time == Some(c) {
                true => ": as the first column it is that of time, unless --time names another",
                false => "",
            };
            return Err(format!("the column {:?} is asked for twice{why}", names[c]));
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
        // samples are stored as f32; times have the same bound
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
            (columns("", "t", ""), "unless --time names another"),
        ] {
            let e = table("t,y\n0,1\n", &columns).err().unwrap();
            assert!(e.contains(says), "{e}");
        }
    }

    #[test]
    fn dates_are_in_the_unit_of_their_column() {
        for (time, second) in
            [("t", 1.0), ("t_s", 1.0), ("t_ms", 1e3), ("t_us", 1e6), ("t_ns", 1e9)]
        {
            let text = format!("{time},y\n1970-01-01T00:00:01Z,1\n1970-01-01 00:00:01.5,2\n");
            let (_, decays) = table(&text, &Columns::default()).unwrap();
            assert_eq!(decays[0].times, [second, 1.5 * second], "{time}");
        }
    }

    #[test]
    fn who_names_a_printhead_has_not_chosen_wrong_columns() {
        let read = |columns: &Columns| {
            read_from(&b"0,1\n1,2\n"[..], b',', Path::new("t.csv"), columns).err().unwrap()
        };
        let printhead = Columns { printhead: Some("K1".into()), ..Columns::default() };
        assert!(matches!(read(&printhead), FileError::Failed { .. }));
        assert!(matches!(read(&columns("t", "", "")), FileError::Mistaken { .. }));
    }

    #[test]
    fn text_that_is_not_utf_8_is_an_error() {
        let e = read_from(&b"t,y\n0,1\n1,\xff\n"[..], b',', Path::new("t"), &Columns::default());
        assert!(e.err().unwrap().to_string().contains("line 3: is not UTF-8"));
    }
}
