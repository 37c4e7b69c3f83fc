//! The tables of other programs, of which `inkling convert` makes recordings: how rows are gathered to decays.
//! `csv_table.rs` reads CSV and `columnar.rs` Parquet, both into [`Table`].
//!
//! In: which columns are what (`table_columns.rs`), and rows.
//! Out: a [`Table`] of decays. A decay has the times of its samples (in the table's unit) and one
//! column of samples for each output (what was measured); it becomes a burst, and its outputs
//! become the burst's channels. Rows with the same burst and printhead are one decay. Nothing is
//! moved to a regular grid here: `sampling.rs` does that.

pub use super::table_columns::Columns;

use super::dialect::value::{Gathered, Samples};
use super::file_error::FileError;
use super::table_columns::ChosenColumns;
use super::time_column::TimeUnit;
use super::{Limits, printable};
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::io;
use std::path::Path;

/// Most bytes of a column's name, and of a cell that names a burst or a printhead.
pub(super) const LONGEST_NAME: usize = 256;
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

/// From this size on, whole numbers are taken off times: f64 holds fewer than ten digits behind the point beside them.
const LARGE_TIME: u64 = 1_000_000;

/// So many numbers that go up by one count rows.
const FEWEST_COUNTED: usize = 4;

/// How far two readings of one time may differ, relative, by the rounding of their digits.
const SAME_TIME: f64 = 1e-12;

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
    /// The values of each column of [`Columns::beside`], row by row: a decay that is cut has several bursts, each with
    /// that of its first row. NaN: missing.
    pub beside: Vec<Vec<f64>>,
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
    /// A table of these columns without decays.
    pub(super) fn of(chosen: &ChosenColumns, unit: Option<TimeUnit>) -> Table {
        let names = |of: &[usize]| of.iter().map(|&c| chosen.names[c].clone()).collect();
        let (outputs, left_out) = (names(&chosen.outputs), names(&chosen.left_out));
        let time = chosen.time.map(|c| chosen.names[c].clone());
        Table { time, unit, left_out, outputs, decays: Vec::new(), rows_are_bursts: false }
    }

    /// Leaves out the outputs that are the times once more, as where each channel is exported with its own, or that count
    /// the rows; one output stays.
    fn leave_out_copies(&mut self) {
        let is_copy = |c: usize, of: &Decay| {
            let (times, y) = (of.times.iter().map(|t| of.base as f64 + t), &of.outputs[c]);
            let counts = || y.windows(2).all(|y| y[1] - y[0] == 1.0 && y[0].fract() == 0.0);
            times.zip(y).all(|(t, y)| (y - t).abs() <= SAME_TIME * t.abs())
                || y.len() >= FEWEST_COUNTED && counts()
        };
        for c in (0..self.outputs.len()).rev() {
            if self.outputs.len() > 1 && self.decays.iter().all(|of| is_copy(c, of)) {
                self.left_out.push(self.outputs.remove(c));
                self.decays.iter_mut().for_each(|of| drop(of.outputs.remove(c)));
            }
        }
    }

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

    pub fn is_empty(&self) -> bool {
        self.decays.is_empty()
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
        chosen.check_names(burst, printhead)?;
        self.cells += 1 + chosen.outputs.len() + chosen.beside.len();
        if self.cells > MOST_CELLS {
            return Err(format!(
                "more than {MOST_CELLS} cells of time and outputs; cut the table into several"
            ));
        }

        // the decay that the row belongs to
        let decays = &mut self.decays;
        let place = match self.by_name.entry((burst.to_owned(), printhead.to_owned())) {
            Entry::Occupied(known) => *known.get(),
            Entry::Vacant(new) => {
                for (what, name) in [("burst", burst), ("printhead", printhead)] {
                    if name.len() > LONGEST_NAME {
                        let name = printable::cell(name);
                        return Err(format!("{what} {name:?}: a name that long?"));
                    }
                }
                // a decay of its own takes about as much memory as 16 cells
                self.cells += 16;
                let (name, printhead) = (burst.to_owned(), printhead.to_owned());
                let [outputs, beside] =
                    [&chosen.outputs, &chosen.beside].map(|of| vec![Vec::new(); of.len()]);
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
        let columns = decay.outputs.iter_mut().zip(&chosen.outputs);
        for (column, &c) in columns.chain(decay.beside.iter_mut().zip(&chosen.beside)) {
            column.push(cell(c)?);
        }
        Ok(())
    }

    /// The table of these rows; `None`: there are none.
    pub fn table(self, unit: Option<TimeUnit>) -> Option<Table> {
        let mut table = Table { decays: self.decays, ..Table::of(self.chosen, unit) };
        if self.chosen.are_guessed && table.time.is_some() {
            table.leave_out_copies();
        }
        (!table.decays.is_empty()).then_some(table)
    }
}
