//! Reads tables of CSV that other programs wrote.
//!
//! In: CSV, and which columns are what ([`Columns`]). Out: a [`Table`] of decays.
//!
//! `table_text.rs` reads the records. With semicolon and tab, decimal commas are read, too; lines that begin
//! with `#` are passed over, and a row of units below the names is read (`Units`). No cell of times and
//! outputs is dropped silently: a cell that is no number is an error that names the line, and so is a missing
//! time; a missing output is kept as NaN, and `sampling.rs` counts it. Of the columns beside them
//! ([`Columns::beside`]) only the first row of each decay is read.

use super::file_error::{FileError, line_of};
use super::table_file::{
    ChosenColumns, Columns, LONGEST_NAME, Moment, Rows, Table, choose_columns, unread,
};
use super::table_text::{TextError, TextOptions, TextTable};
use super::time_column::{TimeUnit, numbers_rows};
use super::{printable, regular_file};
use chrono::{DateTime, NaiveDateTime};
use csv::StringRecord;
use inkling_core::verdict::NO_VALUE;
use std::io::Read;
use std::path::Path;

/// Most bytes of CSV that are read; columns that nobody asks for count, too.
const MOST_BYTES: u64 = 1 << 34;
/// What people and instruments write where there is no sample.
const MISSING: &str = "nan na n/a null none nodata ol over ovl ovld overflow overload overrange underflow underrange \
    max min \u{221e} #n/a #num! #div/0! #value!";

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
    let decimal_comma = text.delimiter != b',';
    let mut chosen = choose(&header, columns, decimal_comma).map_err(refused)?;

    // the first row may be one of units
    let mut ahead = [text.next_names().map_err(failed)?, text.next_record().map_err(failed)?];
    let mut unit = None;
    if let Some((line, row)) = &ahead[0] {
        let below = ahead[1].as_ref().map(|(_, row)| row);
        if let Some(units) = Units::of(row, below, &chosen, decimal_comma) {
            unit = match units.of_time(row, &chosen, columns) {
                Err(_) if columns.spare_times() => {
                    chosen.leave_times_out();
                    None
                }
                of_time => of_time.map_err(at(*line))?,
            };
            chosen.outputs.retain(|c| !units.no_outputs.contains(c));
            chosen.left_out.extend(units.no_outputs);
            one_unit(row, &chosen).map_err(at(*line))?;
            ahead[0] = None;
        }
    }
    let moment = |cell: &str, unit_ns: f64| {
        let written = Moment::written(&with_point(unquoted(cell), decimal_comma));
        let date = || time_in(cell).map(|ns| Moment::of_ns(ns, unit_ns));
        let number = || number_in(cell, decimal_comma).map(Moment::from);
        written.or_else(date).or_else(number)
    };
    // with --period-s a column whose times cannot be read is as good as none
    if let (true, Some(c), Some((_, row))) =
        (columns.spare_times(), chosen.time, ahead.iter().flatten().next())
        && moment(row.get(c).unwrap_or_default(), 1.0).is_none_or(|time| time.rest.is_nan())
    {
        chosen.leave_times_out();
    }
    if unit.is_none() {
        unit = chosen.unit(columns).map_err(refused)?;
    }

    // dates become numbers in the unit of their column, seconds where nothing says one
    let date_unit_ns = unit.unwrap_or(TimeUnit::SECONDS).ns;
    let (mut rows, mut grouped) = (Rows::new(&chosen), Grouped::default());
    let mut ahead = ahead.into_iter().flatten();
    while let Some((line, row)) =
        ahead.next().map_or_else(|| text.next_record().map_err(failed), |row| Ok(Some(row)))?
    {
        chosen.check_cells(&row).map_err(at(line))?;
        if decimal_comma {
            let cells = chosen.outputs.iter().filter_map(|c| row.get(*c));
            cells.for_each(|cell| grouped.add(unquoted(cell), line));
        }
        let text = |c: Option<usize>| c.and_then(|c| row.get(c)).unwrap_or_default();
        let cell = |c: usize| {
            let cell = row.get(c).unwrap_or_default();
            number_in(cell, decimal_comma).ok_or_else(|| no_number(cell, ELSE))
        };
        // only cells in the column of times may be dates
        let time = |c: usize| {
            let cell = row.get(c).unwrap_or_default();
            let otherwise = "remove the line, if it is no row of samples";
            moment(cell, date_unit_ns).ok_or_else(|| no_number(cell, otherwise))
        };
        rows.add(line, text(chosen.burst), text(chosen.printhead), cell, time).map_err(at(line))?;
    }
    grouped.check().map_err(|(line, what)| at(line)(what))?;
    rows.table(unit).ok_or_else(|| FileError::failed(path, "a header and no rows"))
}

/// Refuses outputs in several units, such as (mV) and (V): their numbers cannot be compared.
fn one_unit(units: &StringRecord, chosen: &ChosenColumns) -> Result<(), String> {
    let all = chosen.outputs.iter().filter_map(|c| Some((*c, units.get(*c)?.trim())));
    let mut all = all.filter(|(_, unit)| !unit.is_empty());
    let Some((first, unit)) = all.next() else { return Ok(()) };
    let Some((other, of_other)) = all.find(|(_, of)| *of != unit) else { return Ok(()) };
    let [unit, of_other] = [unit, of_other].map(printable::cell);
    let [first, other] = [first, other].map(|c| printable::cell(&chosen.names[c]));
    Err(format!(
        "{first} is in {unit}, and {other} in {of_other}: choose columns of one unit by --outputs, or write all in one"
    ))
}

/// Whether points stand between thousands, as where commas stand before decimals: each number with a point has three
/// digits behind it, and whole numbers below a thousand have none.
#[derive(Default)]
struct Grouped {
    /// The first number with a point, and its line.
    first: Option<(u64, String)>,
    has_small: bool,
    is_other: bool,
}

impl Grouped {
    fn add(&mut self, cell: &str, line: u64) {
        let digits = cell.trim_start_matches(['+', '-']);
        let is_digits = |of: &str| !of.is_empty() && of.bytes().all(|c| c.is_ascii_digit());
        match digits.split_once('.') {
            _ if self.is_other || digits.is_empty() => {}
            Some((whole, rest)) => {
                let is_group = is_digits(whole)
                    && is_digits(rest)
                    && (1..=3).contains(&whole.len())
                    && !whole.starts_with('0')
                    && rest.len() == 3;
                self.is_other |= !is_group;
                self.first.get_or_insert_with(|| (line, cell.to_owned()));
            }
            None => {
                self.has_small |= is_digits(digits);
                self.is_other |= is_digits(digits) && digits.len() > 3;
            }
        }
    }

    fn check(self) -> Result<(), (u64, String)> {
        match self.first.filter(|_| self.has_small && !self.is_other) {
            Some((line, cell)) => Err((
                line,
                format!(
                    "{:?} has a point and three digits, as all numbers here that are no whole ones below 1000: write \
                     nothing between thousands, or all decimals of all numbers",
                    printable::cell(&cell)
                ),
            )),
            None => Ok(()),
        }
    }
}

/// A row of units, as instruments write it below the names.
struct Units {
    /// Outputs of which it says that they are none: numbers of rows, and what stands in this row alone.
    no_outputs: Vec<usize>,
}

impl Units {
    /// `below`: the next row. `None`: the row is one of numbers, or has a cell that is neither.
    fn of(
        row: &StringRecord,
        below: Option<&StringRecord>,
        chosen: &ChosenColumns,
        decimal_comma: bool,
    ) -> Option<Units> {
        let is_text = |c: usize| {
            let cell = row.get(c).unwrap_or_default();
            number_in(cell, decimal_comma).is_none() && time_in(cell).is_none()
        };
        let is_alone = |c: &usize| below.is_some_and(|of| of.get(*c).is_none_or(str::is_empty));
        let (texts, others): (Vec<usize>, Vec<usize>) =
            chosen.outputs.iter().partition(|c| is_text(**c));
        let are_units = chosen.time.is_none_or(is_text) && others.iter().all(is_alone);
        let counts = |c: &usize| numbers_rows(row.get(*c).unwrap_or_default());
        let counting = texts.iter().copied().filter(counts);
        (are_units && !texts.is_empty())
            .then(|| Units { no_outputs: others.iter().copied().chain(counting).collect() })
    }

    /// The unit of the times. An error if it is none, and no option says one.
    fn of_time(
        &self,
        row: &StringRecord,
        chosen: &ChosenColumns,
        columns: &Columns,
    ) -> Result<Option<TimeUnit>, String> {
        let Some(time) = chosen.time.filter(|_| columns.unit.is_none()) else { return Ok(None) };
        let cell = row.get(time).unwrap_or_default();
        let said = printable::cell(cell);
        if let Ok(Some(unit)) = TimeUnit::in_text(cell) {
            let named = TimeUnit::in_name(&chosen.names[time]).ok().flatten();
            return match named.filter(|named| *named != unit) {
                Some(named) => {
                    let [named, unit] = [named, unit].map(|of| of.name);
                    let what = format!(
                        "its name says {named}, and {said:?} below it {unit}: --time-unit says which"
                    );
                    Err(chosen.of_column(time, &what))
                }
                None => Ok(Some(unit)),
            };
        }
        let what = match numbers_rows(cell) {
            // what stands in this row alone may be the sample period
            true => format!(
                "{said:?} counts samples: --period-s says how far apart they are{}",
                self.told(row, chosen)
            ),
            false => format!("{said:?} is no number, and no unit of time that is known"),
        };
        Err(chosen.of_column(time, &what))
    }

    /// The numbers that stand in this row alone.
    fn told(&self, row: &StringRecord, chosen: &ChosenColumns) -> String {
        let told = self.no_outputs.iter().filter_map(|&c| {
            let number = row.get(c).filter(|cell| cell.parse::<f64>().is_ok())?;
            Some(format!("{} {number}", chosen.names[c]))
        });
        let told: Vec<String> = told.collect();
        match told.is_empty() {
            true => String::new(),
            false => printable::line(&format!(" (there are {})", told.join(", ")), 200),
        }
    }
}

/// Parses a time such as 2026-11-01T08:00:00.5Z, or 1.11.2026 8:00:00.5, to ns since 1970. A blank may stand instead of
/// the T. A time without a zone is taken as UTC. `None`: the cell is no such time.
fn time_in(cell: &str) -> Option<i64> {
    let cell = unquoted(cell);
    let zoned = || DateTime::parse_from_rfc3339(cell).ok()?.timestamp_nanos_opt();
    let plain =
        |format| NaiveDateTime::parse_from_str(cell, format).ok()?.and_utc().timestamp_nanos_opt();
    let formats = ["%Y-%m-%d %H:%M:%S%.f", "%Y-%m-%dT%H:%M:%S%.f", "%d.%m.%Y %H:%M:%S%.f"];
    zoned().or_else(|| formats.into_iter().find_map(plain))
}

fn choose(
    header: &StringRecord,
    columns: &Columns,
    decimal_comma: bool,
) -> Result<ChosenColumns, String> {
    let mut names: Vec<String> = header
        .iter()
        .map(|h| unquoted(h.trim_start_matches('\u{feff}').trim()).to_owned())
        .collect();
    // spreadsheets write separators for columns that were once there; the last one may hold remarks
    while names.len() > 2 && names[names.len() - 2..].iter().all(String::is_empty) {
        names.pop();
    }
    if let Some(name) = names.iter().find(|name| name.len() > LONGEST_NAME) {
        return Err(format!("a column's name is too long: {:?}", printable::cell(name)));
    }
    let numbers =
        names.iter().filter(|name| number_in(name, decimal_comma).is_some_and(f64::is_finite));
    if numbers.count() == names.len() {
        return Err("the first line holds numbers: it must name the columns".to_owned());
    }
    choose_columns(names, columns)
}

/// A number with a point before its decimals, where a comma may stand, and with the minus of a keyboard.
fn with_point(cell: &str, decimal_comma: bool) -> String {
    let cell = cell.replace('\u{2212}', "-");
    match decimal_comma && !cell.contains('.') {
        true => cell.replacen(',', ".", 1),
        false => cell,
    }
}

/// A cell as a number; NaN where it is empty or says that nothing was measured. `None`: it is neither.
fn number_in(cell: &str, decimal_comma: bool) -> Option<f64> {
    let cell = unquoted(cell);
    let word = cell.trim_start_matches(['+', '-', '<', '>']).to_lowercase().replace(' ', "");
    let is_missing = MISSING.split(' ').any(|missing| missing == word)
        // the words of a C library for what is no number, and cells that are filled with one sign
        || word.starts_with("1.#")
        || cell.chars().all(|sign| "-*#?".contains(sign));
    if is_missing {
        return Some(f64::NAN);
    }
    let x: f64 = with_point(cell, decimal_comma).parse().ok()?;
    Some(if x.abs() < NO_VALUE { x } else { f64::NAN })
}

/// What to do about a cell of samples that is no number, and says nothing more.
const ELSE: &str = "leave cells empty where nothing was measured, or choose columns by --outputs";

/// Says that a cell is no number, and what to do about it.
fn no_number(cell: &str, otherwise: &'static str) -> String {
    let cell = unquoted(cell);
    format!("{:?} is no number: {}", printable::cell(cell), advice(cell).unwrap_or(otherwise))
}

/// What to do about a cell that is no number, by what is in it beside digits.
fn advice(cell: &str) -> Option<&'static str> {
    let is_of_number = |c: char| c.is_ascii_digit() || "+-.eE".contains(c);
    let rest = cell.trim_matches(is_of_number).trim();
    let begins_with_digit =
        cell.trim_start_matches(['+', '-']).starts_with(|c: char| c.is_ascii_digit());
    let is_separator = |c: char| is_of_number(c) || c.is_whitespace() || ",'_’".contains(c);
    let has_two = |sign: char| cell.matches(sign).count() >= 2;
    Some(match begins_with_digit {
        true if [':', '/'].into_iter().any(has_two) => {
            "write times as 2026-11-01T08:00:00.5, or as seconds"
        }
        true if cell.starts_with("0x") || cell.starts_with("0X") => {
            "write whole numbers to base 10"
        }
        true if cell.chars().all(is_separator) => {
            "write a point before decimals, and nothing between thousands"
        }
        true if !rest.chars().any(|c| c.is_ascii_digit()) => {
            "write the unit into the column's name"
        }
        _ => return None,
    })
}

/// A cell without quotes. The csv crate takes quotes that follow a blank for a part of the cell.
fn unquoted(cell: &str) -> &str {
    cell.strip_prefix('"').and_then(|cell| cell.strip_suffix('"')).unwrap_or(cell)
}

#[cfg(test)]
mod tests {
    use super::super::table_file::Decay;
    use super::*;
    use crate::fixtures::assert_refused;
    use std::io::Cursor;

    fn table(text: &[u8], columns: &Columns) -> Result<(Table, Vec<Decay>), FileError> {
        let mut table = read_from(Cursor::new(text.to_vec()), Path::new("t.csv"), columns)?;
        let decays = std::mem::take(&mut table.decays);
        Ok((table, decays))
    }

    /// The table of this text by its usual columns.
    fn plain(text: &str) -> Result<(Table, Vec<Decay>), FileError> {
        table(text.as_bytes(), &Columns::default())
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
        let (t, decays) = plain("t,a,b\n0,1,2\n1,3,4\n").unwrap();
        assert_eq!(t.time.as_deref(), Some("t"));
        assert_eq!(t.outputs, ["a", "b"]);
        assert_eq!(decays.len(), 1);
        assert_eq!(decays[0].times, [0.0, 1.0]);
        assert_eq!(decays[0].outputs, [[1.0, 3.0], [2.0, 4.0]]);
    }

    #[test]
    fn a_burst_column_groups_rows_also_where_they_alternate() {
        let text = "gap,t,in,out\nx,0,9,1\ny,0,9,2\nx,1,9,3\ny,1,9,4\n";
        let (_, decays) = table(text.as_bytes(), &columns("t", "out", "gap")).unwrap();
        let names: Vec<&str> = decays.iter().map(|d| d.name.as_str()).collect();
        assert_eq!(names, ["x", "y"]);
        assert_eq!(decays[1].outputs, [[2.0, 4.0]]);
        assert_eq!(decays[1].line, 3);
        let (t, _) = table(text.as_bytes(), &columns("", "", "gap")).unwrap();
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
            let (t, decays) = plain(text).unwrap();
            assert_eq!((t.time.as_deref(), &decays[0].outputs), (Some("t"), &expected), "{text}");
        }
    }

    #[test]
    fn points_before_three_decimals_are_no_thousands_where_one_number_says_so() {
        for text in
            ["t;y\n0;1\n1;0.125\n", "t;y\n0;1.000\n1;2.125\n", "t;y\n0;1\n1;2.125\n2;2.25\n"]
        {
            assert!(plain(text).is_ok(), "{text}");
        }
        assert!(plain("t;y\n0;1000\n1;2.125\n").is_ok());
    }

    #[test]
    fn missing_cells_are_nan_and_what_is_no_number_names_its_line() {
        let (_, decays) = plain("t,y\n0,\n1,NaN\n2,3\n").unwrap();
        let y = &decays[0].outputs[0];
        assert!(y[0].is_nan() && y[1].is_nan() && y[2] == 3.0);
        for (text, says) in [
            ("t,y\n0,1\n1,abc\n", "line 3: column \"y\": \"abc\" is no number: leave"),
            ("t,y\n0,1\n1,\"1,234.5\"\n", "nothing between thousands"),
            ("t,y\n0,1\n1,-1.5 mV\n", "the unit into the column's name"),
            ("t;y\n0;975\n1;-4.000\n2;12.345\n", "line 3: \"-4.000\" has a point and three digits"),
            ("t,a,b\n(us),(mV),(V)\n0,1,2\n1,3,4\n", "line 2: a is in (mV), and b in (V): choose"),
            ("t,y\n11/1/2026 8:00:00,1\n11/1/2026 8:00:01,2\n", "write times as 2026-11-01"),
            ("t,y\n0,1\n1,0x1F\n", "base 10"),
            ("t,y\n0,1\n,2\n", "line 3: column \"t\": a row without a time"),
            ("t,y\n0,1\ninf,2\n", "line 3"),
            ("t,y\n0,1\n1\n", "line 3: 1 cells where the header has 2"),
            ("t,y\n", "no rows"),
            ("", "is empty: a line of column names"),
            ("0,1\n1,2\n", "must name the columns"),
            ("t\n0\n", "no column is left for an output"),
            ("t,y,y\n0,1,2\n", "several columns \"y\""),
            ("Time1 (us),a,Time2 (us),b\n0,1,0,1\n", "\"Time2 (us)\" looks like the times of"),
            ("Time (us),y\n(ms),V\n0,1\n", "says microseconds, and \"(ms)\" below it milliseconds"),
            ("t,y\n0,1\nSum,1\n", "line 3: column \"t\": \"Sum\" is no number: remove the line"),
            ("t,head,y\n0,K1,1\n", "--printhead head divides"),
            (
                "t;y\n0,5;-1.400,00\n1,5;20,00\n2,5;3,00\n3,5;1,00\n",
                "line 2: column \"y\": \"-1.400,00\"",
            ),
        ] {
            assert_refused(plain(text), &[says]);
        }
        for (columns, says) in [
            (columns("u", "", ""), "no column \"u\"; there are t, y"),
            (columns("t", "y,y", ""), "asked for twice"),
            (columns("t", "t", ""), "asked for twice"),
            (columns("", "t", ""), "unless --time names another"),
        ] {
            assert_refused(table(b"t,y\n0,1\n", &columns), &[says]);
        }
    }

    #[test]
    fn dates_are_in_the_unit_of_their_column() {
        for (time, second) in
            [("t", 1.0), ("t_s", 1.0), ("t_ms", 1e3), ("t_us", 1e6), ("t_ns", 1e9)]
        {
            let second_row = ["1970-01-01 00:00:01.5", "1.1.1970 0:00:01.5"];
            for row in second_row {
                let text = format!("{time},y\n1970-01-01T00:00:01Z,1\n{row},2\n");
                let (_, decays) = plain(&text).unwrap();
                let found = [0, 1].map(|k| decays[0].time(k));
                assert_eq!(found, [Some(second), Some(1.5 * second)], "{time}");
            }
        }
    }

    #[test]
    fn times_keep_their_digits_however_long_ago_they_count_from() {
        let ns = [0, 781, 1_563, 1_000_000_000];
        for (time, written) in [
            ("time_ns", ns.map(|ns| format!("{}", 1_772_536_953_000_000_000_i64 + ns))),
            (
                "t",
                ns.map(|ns| {
                    format!("{}.{:09}", 1_772_536_953 + ns / 1_000_000_000, ns % 1_000_000_000)
                }),
            ),
            (
                "t_s",
                ns.map(|ns| {
                    format!(
                        "2026-03-03 11:22:{}.{:09}",
                        33 + ns / 1_000_000_000,
                        ns % 1_000_000_000
                    )
                }),
            ),
        ] {
            let rows: String = written.iter().map(|time| format!("{time},1\n")).collect();
            let (_, decays) = plain(&format!("{time},y\n{rows}")).unwrap();
            let unit = if time == "time_ns" { 1.0 } else { 1e9 };
            for (t, ns) in decays[0].times.iter().zip(ns) {
                assert!((t * unit - ns as f64).abs() < 1e-3, "{time}: {t}");
            }
            assert_eq!(decays[0].base as f64 * unit, 1_772_536_953e9);
        }
    }

    #[test]
    fn with_a_period_times_say_when_a_burst_began_where_they_can_be_read() {
        let columns = Columns { rows_are_samples: true, ..Columns::default() };
        for (text, times, outputs) in [
            ("elapsed,y\n5,1\n6,2\n", vec![5.0, 6.0], 1),
            ("Time,y\n08:00:00,1\n08:00:01,2\n", vec![0.0, 1.0], 1),
            ("Time,y\nSample,V\n0,1\n1,2\n", vec![0.0, 1.0], 1),
            ("a,b\n5,1\n6,2\n", vec![0.0, 1.0], 2),
        ] {
            let (t, decays) = table(text.as_bytes(), &columns).unwrap();
            assert_eq!((&decays[0].times, t.outputs.len()), (&times, outputs), "{text}");
        }
    }

    #[test]
    fn what_stands_among_the_names_or_signs_is_read_as_it_is_meant() {
        for text in [
            "t,y,,\n0,1,,\n1,-2,,\n",
            "t,y,t0 = -2e-05, tInc = 1,\n0,1,,\n1,-2,,\n",
            "t,y\n0,1\n1,\u{2212}2\n",
        ] {
            let (t, decays) = plain(text).unwrap();
            assert_eq!((t.outputs, &decays[0].outputs), (vec!["y".into()], &vec![vec![1.0, -2.0]]));
        }
    }

    #[test]
    fn who_names_a_printhead_has_not_chosen_wrong_columns() {
        let read = |columns: &Columns| table(b"0,1\n1,2\n", columns);
        let printhead = Columns { printhead: Some("K1".into()), ..Columns::default() };
        assert!(matches!(read(&printhead), Err(FileError::Failed { .. })));
        assert!(matches!(read(&columns("t", "", "")), Err(FileError::Mistaken { .. })));
    }

    #[test]
    fn text_that_is_not_utf_8_is_an_error() {
        let read = table(b"t,y\n0,1\n1,\xff\n", &Columns::default());
        assert_refused(read, &["line 3: is not UTF-8"]);
    }
}
