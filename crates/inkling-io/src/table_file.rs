//! The tables of other programs, of which `inkling convert` makes recordings: which of their columns
//! are what, and how rows are gathered to decays. `csv_table.rs` reads CSV and
//! `columnar.rs` Parquet, both into [`Table`].
//!
//! In: the names of a table's columns and what the user says of them ([`Columns`]), then its rows.
//! Out: a [`Table`] of decays. A decay has the times of its samples (in the table's unit) and one
//! column of samples for each output (what was measured); it becomes a burst, and its outputs
//! become the burst's channels. Rows with the same burst and printhead are one decay. Nothing is
//! moved to a regular grid here: `sampling.rs` does that.

use super::dialect::value::{Gathered, Samples};
use super::file_error::FileError;
use super::time_column::{self, TimeUnit};
use super::{Limits, printable};
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::io;
use std::path::{Path, PathBuf};

/// Most bytes of a column's name, and of a cell that names a burst or a printhead.
pub(super) const LONGEST_NAME: usize = 256;
/// Most characters of the list of a table's columns in an error.
const MOST_NAMED: usize = 400;
/// Most cells of times and outputs, or samples in lists, that are held in memory.
pub(super) const MOST_CELLS: usize = 1 << 25;

/// The error for a table that cannot be read. A file that is not there is the mistake of whoever
/// named it; other failures are nobody's.
pub(super) fn unread(path: &Path) -> impl Fn(io::Error) -> FileError {
    |e| match e.kind() {
        io::ErrorKind::NotFound => FileError::unread(path)(e),
        _ => FileError::failed(path, format!("cannot be read: {e}")),
    }
}

/// Which columns of a table are what, by name.
#[derive(Clone, Debug, Default)]
pub struct Columns {
    /// Column of times. `None`: the one that is called time, else the first column that is none of `burst`,
    /// `printhead` and `beside`, unless `rows_are_samples`. If `outputs` names that column, the choice is
    /// refused.
    pub time: Option<String>,
    /// The unit of times; `None`: the table says it.
    pub unit: Option<TimeUnit>,
    /// Lines that are passed over before the table begins, of a text.
    pub skip_lines: u64,
    /// Columns of outputs, in the order of the channels. `None`: all columns that are nothing else.
    pub outputs: Option<Vec<String>>,
    /// Rows that have the same value here, and the same printhead, are one decay.
    pub burst: Option<String>,
    /// The name of the column that holds each row's printhead, or, if there is no such column, of
    /// the printhead itself.
    pub printhead: Option<String>,
    /// Columns with one value for each decay, such as the temperature.
    pub beside: Vec<String>,
    /// Whether something else (`--period-s`) says the sample period: then the first time of a decay says when it
    /// began, and only a column that is called time is taken for times, unless `time` names one.
    pub rows_are_samples: bool,
}

impl Columns {
    /// Whether the table is read as well without the column of times.
    pub(super) fn spare_times(&self) -> bool {
        self.rows_are_samples && self.time.is_none()
    }

    /// A wrong choice is the user's mistake if the user named any column, otherwise the table's
    /// fault. A printhead's name does not count, as it need not be a column's.
    pub(super) fn refused(&self, path: &Path, what: String) -> FileError {
        let Columns { time, unit, outputs, burst, beside, skip_lines, .. } = self;
        let chosen = time.is_some() || outputs.is_some() || burst.is_some() || !beside.is_empty();
        match chosen || unit.is_some() || *skip_lines > 0 {
            true => FileError::mistaken(path, what),
            false => FileError::failed(path, what),
        }
    }
}

/// From this size on, whole numbers are taken off times: f64 holds fewer than ten digits behind the point beside them.
const LARGE_TIME: u64 = 1_000_000;

/// A time, in the unit of its column: a whole number, and what is added to it. One f64 holds times since 1970 only to
/// 0.2 µs, and exports count in nanoseconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Moment {
    pub whole: i64,
    pub rest: f64,
}

impl From<f64> for Moment {
    fn from(rest: f64) -> Moment {
        Moment { whole: 0, rest }
    }
}

impl From<i64> for Moment {
    fn from(whole: i64) -> Moment {
        Moment { whole, rest: 0.0 }
    }
}

impl Moment {
    /// A time in ns as one in units of so many ns.
    pub fn of_ns(ns: i64, unit_ns: f64) -> Moment {
        match unit_ns as i64 {
            0 => (ns as f64 / unit_ns).into(),
            unit => Moment { whole: ns / unit, rest: (ns % unit) as f64 / unit_ns },
        }
    }

    /// A time that is written with a point and without an exponent or a sign. `None`: it is not.
    pub fn written(text: &str) -> Option<Moment> {
        let (whole, digits) = text.split_once('.').unwrap_or((text, "0"));
        let is_digits = |of: &str| !of.is_empty() && of.bytes().all(|c| c.is_ascii_digit());
        let is_plain = is_digits(whole) && is_digits(digits);
        let rest = || format!("0.{digits}").parse().ok();
        Some(Moment { whole: whole.parse().ok().filter(|_| is_plain)?, rest: rest()? })
    }
}

/// The rows of the same burst and printhead, in the table's order, or one row whose cells are lists.
#[derive(Clone, Debug, Default)]
pub struct Decay {
    /// The value of the burst column; empty if there is none.
    pub name: String,
    /// The value of the printhead column; empty if there is none.
    pub printhead: String,
    /// Where the decay's first row stands: the line of a CSV file, otherwise the number of the row,
    /// from 1 on.
    pub line: u64,
    /// Times of the samples, in the unit of the column of times, from `base` on; dates in CSV count from 1970. Of a
    /// row of lists only when it began; without a column of times the numbers of the rows.
    pub times: Vec<f64>,
    /// What was taken off all times, so that they keep their digits; 0 where they are small.
    pub base: i64,
    /// The samples of each output; NaN: missing.
    pub outputs: Vec<Vec<f64>>,
    /// Values of the columns of [`Columns::beside`] in the decay's first row; NaN: missing.
    pub beside: Vec<f64>,
}

impl Decay {
    pub(super) fn push_time(&mut self, time: Moment) {
        if self.times.is_empty() && time.whole.unsigned_abs() >= LARGE_TIME {
            self.base = time.whole;
        }
        self.times.push((i128::from(time.whole) - i128::from(self.base)) as f64 + time.rest);
    }

    /// One of its times as the table has it, to the digits of an f64.
    pub fn time(&self, k: usize) -> Option<f64> {
        self.times.get(k).map(|t| self.base as f64 + t)
    }

    /// The samples as a burst has them, channel after channel: int16 if all of them are, else
    /// float32. `None`: more bytes than a burst may have.
    pub fn samples(&self) -> Option<Samples> {
        let all = self.outputs.iter().flatten().copied();
        let all = Gathered::of(all.map(Some))?.samples(Limits::default().samples_bytes);
        (!all.too_many).then_some(all)
    }
}

/// Puts tables whose names are in the order of letters, as a shell lists them (1, 10, 2), into that of the numbers in
/// their names. Gives whether it is another order; any order that is not that of letters was meant.
pub fn in_order_of_numbers(tables: &mut [PathBuf]) -> bool {
    // many a shell passes over signs and the case of letters
    let letters = |path: &PathBuf| -> String {
        let name = path.to_string_lossy().to_lowercase();
        name.chars().filter(|c| c.is_alphanumeric()).collect()
    };
    let is_of_letters = tables.is_sorted() || tables.is_sorted_by_key(letters);
    let is_other = is_of_letters && !tables.is_sorted_by_key(|path| parts(path));
    if is_other {
        tables.sort_by_cached_key(|path| parts(path));
    }
    is_other
}

/// The texts and the numbers that a name consists of.
fn parts(path: &Path) -> Vec<(String, Option<u128>)> {
    let name = path.to_string_lossy();
    let mut rest = &*name;
    let mut parts = Vec::new();
    while !rest.is_empty() {
        let begins = rest.find(|c: char| c.is_ascii_digit()).unwrap_or(rest.len());
        let behind = rest[begins..].find(|c: char| !c.is_ascii_digit());
        let ends = behind.map_or(rest.len(), |n| begins + n);
        parts.push((rest[..begins].to_owned(), rest[begins..ends].parse().ok()));
        rest = &rest[ends..];
    }
    parts
}

pub struct Table {
    /// The name of the column of times.
    pub time: Option<String>,
    /// The unit of the times; `None`: nothing says it.
    pub unit: Option<TimeUnit>,
    /// Names of columns that are no outputs, though nobody said so.
    pub left_out: Vec<String>,
    /// Names in the order of the channels; empty where a column holds several channels.
    pub outputs: Vec<String>,
    /// In the order of their first rows.
    pub decays: Vec<Decay>,
    /// Whether cells are lists, so that each row is a burst by itself.
    pub rows_are_bursts: bool,
}

impl Table {
    /// The first time of the first decay, by whose size the caller may guess the unit.
    pub fn first_time(&self) -> Option<f64> {
        self.time.as_ref().and(self.decays.first()?.time(0))
    }
}

pub(super) struct Rows<'a> {
    chosen: &'a ChosenColumns,
    decays: Vec<Decay>,
    /// Index in `decays` of the decay of each burst and printhead.
    by_name: HashMap<(String, String), usize>,
    /// How many cells are held so far; each decay counts as 16 more.
    cells: usize,
}

impl Rows<'_> {
    pub fn new(chosen: &ChosenColumns) -> Rows<'_> {
        Rows { chosen, decays: Vec::new(), by_name: HashMap::new(), cells: 0 }
    }

    /// `line`: see [`Decay::line`]; `cell` gives the number that the row has in a column, `moment` its time there.
    pub fn add(
        &mut self,
        line: u64,
        burst: &str,
        printhead: &str,
        cell: impl Fn(usize) -> Result<f64, String>,
        moment: impl Fn(usize) -> Result<Moment, String>,
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
                decays.push(Decay { name, printhead, line, outputs, beside, ..Decay::default() });
                *new.insert(decays.len() - 1)
            }
        };

        let decay = &mut decays[place];
        let time = match chosen.time {
            Some(c) => Some(moment(c).map_err(|what| chosen.of_column(c, &what))?)
                .filter(|time| time.rest.is_finite())
                .ok_or_else(|| chosen.of_column(c, "a row without a time"))?,
            None => (decay.times.len() as f64).into(),
        };
        decay.push_time(time);
        for (column, &c) in decay.outputs.iter_mut().zip(&chosen.outputs) {
            column.push(cell(c)?);
        }
        Ok(())
    }

    /// The table of these rows; `None`: there are none.
    pub fn table(self, unit: Option<TimeUnit>) -> Option<Table> {
        (!self.decays.is_empty()).then(|| Table { decays: self.decays, ..self.chosen.table(unit) })
    }
}

/// Which columns are read, as indices among all columns of the table.
pub(super) struct ChosenColumns {
    pub names: Vec<String>,
    pub time: Option<usize>,
    pub outputs: Vec<usize>,
    pub burst: Option<usize>,
    pub printhead: Option<usize>,
    pub beside: Vec<usize>,
    /// Columns that number the rows, hold remarks, or times that are not read.
    pub left_out: Vec<usize>,
}

impl ChosenColumns {
    /// A table of these columns without decays.
    pub fn table(&self, unit: Option<TimeUnit>) -> Table {
        let names = |of: &[usize]| of.iter().map(|&c| self.names[c].clone()).collect();
        let (outputs, left_out) = (names(&self.outputs), names(&self.left_out));
        let time = self.time.map(|c| self.names[c].clone());
        Table { time, unit, left_out, outputs, decays: Vec::new(), rows_are_bursts: false }
    }

    /// The unit of the times: the one that is given, else what the column's name says.
    pub fn unit(&self, columns: &Columns) -> Result<Option<TimeUnit>, String> {
        match (self.time, columns.unit) {
            (None, Some(_)) => Err("--time-unit has no effect: no column is that of time".into()),
            (None, None) => Ok(None),
            (Some(_), Some(unit)) => Ok(Some(unit)),
            (Some(c), None) => TimeUnit::in_name(&self.names[c]),
        }
    }

    /// Refuses a row that lacks a cell that is asked for, or has more cells than there are names. What is empty
    /// behind the last name is left by a separator at the end.
    pub fn check_cells(&self, row: &csv::StringRecord) -> Result<(), String> {
        let asked = self.time.iter().chain(&self.outputs).chain(&self.burst).chain(&self.printhead);
        let needed = asked.chain(&self.beside).max().map_or(0, |last| last + 1);
        let is_there = row.iter().skip(self.names.len()).all(str::is_empty) && row.len() >= needed;
        let what = || format!("{} cells where the header has {}", row.len(), self.names.len());
        is_there.then_some(()).ok_or_else(what)
    }

    /// Reads the table without its column of times.
    pub fn leave_times_out(&mut self) {
        self.left_out.extend(self.time.take());
    }

    /// An error about a cell, with the name of its column before it.
    pub fn of_column(&self, c: usize, what: &str) -> String {
        format!("column {:?}: {what}", self.names[c])
    }
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
        None if columns.rows_are_samples => time_called(&names, |c| !taken(c)),
        None => Some(time_among(&names, |c| !taken(c))?),
    };

    // what numbers the rows stands before the time, or else first; remarks stand last; times that are not asked for
    // are no output either
    let is_no_output = |c: usize| {
        time_column::has_word_for_time(&names[c])
            || time_column::holds_a_setting(&names[c])
            || c <= time.unwrap_or(0) && time_column::numbers_rows(&names[c])
            || c + 1 == names.len() && time_column::holds_remarks(&names[c])
    };
    let rest = (0..names.len()).filter(|c| Some(*c) != time && !taken(*c));
    let (outputs, left_out): (Vec<usize>, Vec<usize>) = match &columns.outputs {
        Some(outputs) => {
            (outputs.iter().map(|name| place(name)).collect::<Result<_, _>>()?, Vec::new())
        }
        None => rest.partition(|c| !is_no_output(*c)),
    };
    no_other_times(&names, &outputs, &left_out)?;
    // a table of nothing but what looks like numbers of rows has no other outputs
    let (outputs, left_out) =
        if outputs.is_empty() { (left_out, outputs) } else { (outputs, left_out) };
    let guessed = outputs.iter().filter(|_| columns.outputs.is_none() && outputs.len() > 1);
    for name in guessed.map(|&c| &names[c]) {
        if let Some(what) = time_column::not_samples(name) {
            return Err(format!("column {name:?} {what}"));
        }
    }
    if outputs.is_empty() {
        let time = time.map_or("", |c| &names[c]);
        return Err(format!("no column is left for an output beside {time:?}"));
    }

    // no column may be asked for twice, and none may share its name with another
    let all = outputs.iter().chain(&time).chain(&burst).chain(&printhead).chain(&beside);
    let mut used: Vec<usize> = all.copied().collect();
    used.sort_unstable();
    for (i, &c) in used.iter().enumerate() {
        // columns that nobody named: two of the same name would be two channels
        place(&names[c])?;
        if used.get(i + 1) == Some(&c) {
            let why = match columns.time.is_none() && time == Some(c) {
                true => ": it is that of time, unless --time names another",
                false => "",
            };
            return Err(format!("the column {:?} is asked for twice{why}", names[c]));
        }
    }
    Ok(ChosenColumns { names, time, outputs, burst, printhead, beside, left_out })
}

/// Refuses further columns of times that have outputs on both sides: each of them is that of the outputs behind it.
fn no_other_times(names: &[String], outputs: &[usize], left_out: &[usize]) -> Result<(), String> {
    let (Some(first), Some(last)) = (outputs.first(), outputs.last()) else { return Ok(()) };
    let mut others = left_out.iter().filter(|c| time_column::has_word_for_time(&names[**c]));
    match others.find(|c| (first..last).contains(c)) {
        Some(&other) => Err(format!(
            "{:?} looks like the times of the columns behind it: --time and --outputs choose those of one time",
            names[other]
        )),
        None => Ok(()),
    }
}

/// The column among those that are `free` that is called time, where its name leaves no doubt.
fn time_called(names: &[String], free: impl Fn(usize) -> bool) -> Option<usize> {
    let is_time = |c: &usize| {
        let name = &names[*c];
        free(*c) && time_column::has_word_for_time(name) && TimeUnit::in_name(name).is_ok()
    };
    (0..names.len()).find(is_time)
}

/// The column of time among those that are `free`: the first one if it is called so, else the only one that
/// is called so, else the first one, unless that numbers the rows.
fn time_among(names: &[String], free: impl Fn(usize) -> bool) -> Result<usize, String> {
    let free: Vec<usize> = (0..names.len()).filter(|c| free(*c)).collect();
    let first = *free.first().ok_or("there is no column left for time")?;
    let is_time = |c: &&usize| time_column::is_time(&names[**c]);
    let called: Vec<usize> = free.iter().filter(is_time).copied().collect();
    match called[..] {
        [one] => Ok(one),
        _ if called.contains(&first) => Ok(first),
        [] if !time_column::numbers_rows(&names[first]) => Ok(first),
        [] => {
            let what = format!("no column is called time, and {:?} numbers the rows", names[first]);
            Err(format!(
                "{what}: --time names the column of times, or --period-s says how far apart samples are"
            ))
        }
        _ => {
            let called: Vec<&str> = called.iter().map(|&c| &*names[c]).collect();
            let called = printable::line(&called.join(", "), MOST_NAMED);
            Err(format!("several columns are called time ({called}): --time says which"))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_in_the_order_of_a_shell_are_taken_in_that_of_their_numbers() {
        let paths = |names: &[&str]| names.iter().map(PathBuf::from).collect::<Vec<_>>();
        for (given, taken) in [
            (["s_1.csv", "s_10.csv", "s_2.csv"], Some(["s_1.csv", "s_2.csv", "s_10.csv"])),
            (["s_10.csv", "s_1.csv", "s_2.csv"], Some(["s_1.csv", "s_2.csv", "s_10.csv"])),
            (["s_2.csv", "s_10.csv", "s_1.csv"], None),
            (["s_08.csv", "s_09.csv", "s_10.csv"], None),
        ] {
            let mut tables = paths(&given);
            assert_eq!(in_order_of_numbers(&mut tables), taken.is_some(), "{given:?}");
            assert_eq!(tables, paths(&taken.unwrap_or(given)));
        }
    }
}
