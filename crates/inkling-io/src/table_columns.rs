//! Which columns of a foreign table are what.
//!
//! In: the names of a table's columns, and what the user says of them ([`Columns`]). Out: [`ChosenColumns`], by which
//! `csv_table.rs` and `columnar.rs` read rows. What nobody says is told from the names (`time_column.rs`).

use super::file_error::FileError;
use super::printable;
use super::time_column::{self, TimeUnit, has_word_for_time, numbers_rows};
use std::path::Path;

/// Most characters of the list of a table's columns in an error.
const MOST_NAMED: usize = 400;

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

/// Which columns are read, as indices among all columns of the table.
pub(super) struct ChosenColumns {
    pub names: Vec<String>,
    pub time: Option<usize>,
    pub outputs: Vec<usize>,
    pub burst: Option<usize>,
    pub printhead: Option<usize>,
    pub beside: Vec<usize>,
    /// Whether nobody said which columns are outputs.
    pub are_guessed: bool,
    /// Columns that number the rows, hold remarks, or times that are not read.
    pub left_out: Vec<usize>,
}

impl ChosenColumns {
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
    /// behind the last name is left by a separator at the end. `is_first`: no row stands above it.
    pub fn check_cells(&self, row: &csv::StringRecord, is_first: bool) -> Result<(), String> {
        let needed = self.asked_for().max().map_or(0, |last| last + 1);
        let is_there = row.iter().skip(self.names.len()).all(str::is_empty) && row.len() >= needed;
        let what = || {
            let advice = match row.len() > self.names.len() {
                true => {
                    "write points before decimals, or semicolons between cells, and none that is too many"
                }
                false if is_first => {
                    "write quotes around a name that holds a comma, or empty cells where nothing was measured"
                }
                false => "remove the line, and what is below it, where they are no rows of samples",
            };
            format!("{} cells where the header has {}: {advice}", row.len(), self.names.len())
        };
        is_there.then_some(()).ok_or_else(what)
    }

    /// Refuses a row that does not say whose it is where a column should.
    pub fn check_names(&self, burst: &str, printhead: &str) -> Result<(), String> {
        let mut columns = [(self.burst, burst), (self.printhead, printhead)].into_iter();
        match columns.find(|(column, name)| column.is_some() && name.is_empty()) {
            Some((Some(c), _)) => Err(self.of_column(
                c,
                "an empty cell: each row must say whose it is; cells that were merged hold it once",
            )),
            _ => Ok(()),
        }
    }

    /// Reads the table without its column of times.
    pub fn leave_times_out(&mut self) {
        self.left_out.extend(self.time.take());
    }

    /// An error about a cell, with the name of its column before it.
    pub fn of_column(&self, c: usize, what: &str) -> String {
        format!("column {:?}: {what}", self.names[c])
    }

    fn asked_for(&self) -> impl Iterator<Item = usize> {
        let one_each = self.time.iter().chain(&self.burst).chain(&self.printhead);
        self.outputs.iter().chain(one_each).chain(&self.beside).copied()
    }

    /// Refuses a column that is asked for twice, and one that shares its name with another: two columns of a name would
    /// be two channels.
    fn check_once(&self, is_time_named: bool) -> Result<(), String> {
        let mut used: Vec<usize> = self.asked_for().collect();
        used.sort_unstable();
        for (i, &c) in used.iter().enumerate() {
            place(&self.names, &self.names[c])?;
            if used.get(i + 1) == Some(&c) {
                let why = match !is_time_named && self.time == Some(c) {
                    true => ": it is that of time, unless --time names another",
                    false => "",
                };
                return Err(format!("the column {:?} is asked for twice{why}", self.names[c]));
            }
        }
        Ok(())
    }
}

/// Finds the columns by their names, in a table that is known to have names, such as Parquet.
pub(super) fn choose_columns(
    names: Vec<String>,
    columns: &Columns,
) -> Result<ChosenColumns, String> {
    let place = |name: &String| place(&names, name);
    let places = |of: &[String]| of.iter().map(place).collect::<Result<Vec<usize>, String>>();

    // columns that the user named; a printhead's name need not be a column
    let burst = columns.burst.as_ref().map(place).transpose()?;
    let beside = places(&columns.beside)?;
    let whose = columns.printhead.as_ref().filter(|name| names.contains(name));
    let printhead = whose.map(place).transpose()?;
    let is_taken = |c: &usize| [burst, printhead].contains(&Some(*c)) || beside.contains(c);
    let free: Vec<usize> = (0..names.len()).filter(|c| !is_taken(c)).collect();

    let time = match &columns.time {
        Some(name) => Some(place(name)?),
        None if columns.rows_are_samples => time_called(&names, &free),
        None => Some(time_among(&names, &free)?),
    };
    let (outputs, left_out) = match &columns.outputs {
        Some(outputs) => (places(outputs)?, Vec::new()),
        None => outputs_among(&names, &free, time),
    };
    no_other_times(&names, &outputs, &left_out)?;
    of_one_unit(outputs.iter().map(|&c| (c, volts_of(&names[c]))), &names)?;
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
    let are_guessed = columns.outputs.is_none();
    let chosen =
        ChosenColumns { names, time, outputs, burst, printhead, beside, are_guessed, left_out };
    chosen.check_once(columns.time.is_some())?;
    Ok(chosen)
}

/// Units of voltage, which amplifiers of one system may be exported in side by side.
const VOLTS: [&str; 6] = ["V", "mV", "uV", "µV", "μV", "kV"];

/// The unit of voltage that ends the name of a column, as `a_mV`, `a (mV)` or `a [mV]` do; empty: none does.
fn volts_of(name: &str) -> &str {
    let name = name.trim().trim_end_matches([')', ']']);
    let unit = name.rsplit(['_', ' ', '(', '[']).next().filter(|unit| *unit != name);
    unit.filter(|unit| VOLTS.contains(unit)).unwrap_or_default()
}

/// Refuses outputs in several units, such as (mV) and (V): their numbers cannot be compared. `units`: with the column of
/// each; empty: nobody says it.
pub(super) fn of_one_unit<'a>(
    units: impl Iterator<Item = (usize, &'a str)>,
    names: &[String],
) -> Result<(), String> {
    let mut all = units.filter(|(_, unit)| !unit.is_empty());
    let Some((first, unit)) = all.next() else { return Ok(()) };
    let Some((other, of_other)) = all.find(|(_, of)| *of != unit) else { return Ok(()) };
    let [unit, of_other] = [unit, of_other].map(printable::cell);
    let [first, other] = [first, other].map(|c| printable::cell(&names[c]));
    Err(format!(
        "{first} is in {unit}, and {other} in {of_other}: choose columns of one unit by --outputs, or write all in one"
    ))
}

fn place(names: &[String], name: &str) -> Result<usize, String> {
    let mut places = (0..names.len()).filter(|&c| names[c] == name);
    match (places.next(), places.next()) {
        (Some(place), None) => Ok(place),
        (Some(_), Some(_)) => Err(format!("there are several columns {name:?}: rename them")),
        (None, _) => {
            let there = printable::line(&names.join(", "), MOST_NAMED);
            Err(format!("no column {name:?}; there are {there}"))
        }
    }
}

/// The outputs among the columns that are `free`, and those columns that are none: what numbers the rows stands before
/// the time, or else first; remarks stand last; times that are not asked for are no output either.
fn outputs_among(
    names: &[String],
    free: &[usize],
    time: Option<usize>,
) -> (Vec<usize>, Vec<usize>) {
    let is_output = |c: &usize| {
        let name = &names[*c];
        let is_before_time = *c <= time.unwrap_or(0);
        let is_last = c + 1 == names.len();
        !(has_word_for_time(name)
            || time_column::holds_a_setting(name)
            || is_before_time && numbers_rows(name)
            || is_last && time_column::holds_remarks(name))
    };
    free.iter().filter(|c| Some(**c) != time).partition(|c| is_output(c))
}

/// Refuses further columns of times that have outputs on both sides: each of them is that of the outputs behind it.
fn no_other_times(names: &[String], outputs: &[usize], left_out: &[usize]) -> Result<(), String> {
    let (Some(first), Some(last)) = (outputs.first(), outputs.last()) else { return Ok(()) };
    let mut others = left_out.iter().filter(|c| has_word_for_time(&names[**c]));
    match others.find(|c| (first..last).contains(c)) {
        Some(&other) => Err(format!(
            "{:?} looks like the times of the columns behind it: --time and --outputs choose those of one time",
            names[other]
        )),
        None => Ok(()),
    }
}

/// The column among those that are `free` that is called time, where its name leaves no doubt.
fn time_called(names: &[String], free: &[usize]) -> Option<usize> {
    let is_time = |name: &String| has_word_for_time(name) && TimeUnit::in_name(name).is_ok();
    free.iter().copied().find(|c| is_time(&names[*c]))
}

/// The column of time among those that are `free`: the first one if it is called so, else the only one that
/// is called so, else the first one, unless that numbers the rows.
fn time_among(names: &[String], free: &[usize]) -> Result<usize, String> {
    let first = *free.first().ok_or("there is no column left for time")?;
    let is_time = |c: &&usize| time_column::is_time(&names[**c]);
    let called: Vec<usize> = free.iter().filter(is_time).copied().collect();
    match called[..] {
        [one] => Ok(one),
        _ if called.contains(&first) => Ok(first),
        [] if !numbers_rows(&names[first]) => Ok(first),
        [] => Err(format!(
            "no column is called time, and {:?} numbers the rows: --time names the column of times, or --period-s says \
             how far apart samples are",
            names[first]
        )),
        _ => {
            let called: Vec<&str> = called.iter().map(|&c| &*names[c]).collect();
            let called = printable::line(&called.join(", "), MOST_NAMED);
            Err(format!("several columns are called time ({called}): --time says which"))
        }
    }
}
