//! Reads the bursts of a table, and finds the unit of its times.
//!
//! In: the options, and one of the tables. Out: decays, one per burst ([`InputBursts`]). There are two forms.
//! Where cells are lists, rows are bursts. Where rows are samples (a decay per burst), their times must lie on
//! a regular grid, give the sample period, and may be resampled.

use super::super::exit::Failure;
use super::args::Args;
use inkling_io::sampling::{self, Sampled, TimeColumn};
use inkling_io::table_file::{Columns, Decay, Table};
use inkling_io::time_column::TimeUnit;
use inkling_io::{columnar, csv_table};
use std::path::Path;

/// The bursts of a table, and what is to be told about it.
#[derive(Default)]
pub struct InputBursts {
    pub decays: Vec<Decay>,
    /// The times, if there is a column of them.
    pub times: Option<Times>,
    /// The sample period, s, if the table's own times give it.
    pub period_s: Option<f64>,
    /// Number of cells without a value that no interpolation fills.
    pub missing: usize,
    pub outputs: Vec<String>,
    /// Columns that are no outputs, though nobody said so.
    pub left_out: Vec<String>,
    /// How regular the table's times are, if they are the times of samples.
    pub sampled: Option<Sampled>,
}

impl InputBursts {
    /// Reads a table. Its rows are samples, or whole bursts if its cells are lists. `beside`: columns that
    /// are read beside the samples.
    pub fn open(path: &Path, args: &Args, beside: &[String]) -> Result<InputBursts, Failure> {
        let columns = Columns {
            time: args.time.clone(),
            unit: args.unit()?,
            skip_lines: args.skip_lines,
            outputs: args.outputs.clone(),
            burst: args.burst.clone(),
            printhead: args.printhead.clone(),
            beside: beside.to_vec(),
            rows_are_samples: args.period_s.is_some(),
        };

        // 1. read the file by its kind
        let table = match columnar::is_parquet(path)? {
            true if args.skip_lines > 0 => {
                return Err(Failure::usage("--skip-lines has no effect: Parquet has no lines"));
            }
            true => columnar::read(path, &columns)?,
            false => csv_table::read(path, &columns)?,
        };

        // 2. the unit of its times; rows that are bursts need nothing more
        let failed = |what: String| Failure::new(format!("{}: {what}", path.display()));
        let times = Times::of(&table, &columns).map_err(failed)?;
        let Table { time, outputs, left_out, decays, rows_are_bursts, .. } = table;
        let input = InputBursts { times, outputs, left_out, ..InputBursts::default() };
        if rows_are_bursts {
            return match args.resample {
                true => Err(Failure::usage("--resample has no effect: each row is a burst")),
                false => Ok(InputBursts { decays, ..input }),
            };
        }

        // 3. rows that are samples: with --period-s they are taken as they are listed; else the
        // table's times give the period, and must be regular
        let unit_s = input.times.as_ref().map_or(1.0, |times| times.unit.ns / 1e9);
        let mut sampled = match time.as_ref().filter(|_| args.period_s.is_none()) {
            Some(name) => sampling::sample(decays, TimeColumn { name, unit_s }, args.resample),
            None => sampling::as_listed(decays),
        }
        .map_err(failed)?;
        let decays = std::mem::take(&mut sampled.decays);
        let missing = if args.resample { 0 } else { sampled.missing };
        let period_s = args.period_s.is_none().then_some(sampled.period * unit_s);
        Ok(InputBursts { decays, period_s, missing, sampled: Some(sampled), ..input })
    }
}

/// A column of times: what its numbers mean.
#[derive(Clone, Debug, PartialEq)]
pub struct Times {
    pub unit: TimeUnit,
    /// Whether the table or an option says the unit.
    pub has_unit: bool,
    /// The number that stands for 1970.
    zero: f64,
    /// Why they have that unit, in words.
    pub why: String,
}

/// Who counts days so that 1970 begins on which of them.
const DAYS_OF_1970: [(f64, &str); 3] = [
    (25_569.0, "spreadsheets"),
    (719_529.0, "programs such as MATLAB"),
    (2_440_587.5, "astronomers"),
];
/// The days of 2000 to 2100 since 1970.
const LIKELY_DAYS: std::ops::Range<f64> = 10_957.0..47_482.0;

impl Times {
    /// The unit of a table's times: as the table or an option says, or else by the size of the first time if it
    /// counts from 1970: times of 1979 to 2200 do not overlap in any two units. Smaller times are seconds,
    /// unless they may be days of a spreadsheet. `None`: the table has no times.
    fn of(table: &Table, columns: &Columns) -> Result<Option<Times>, String> {
        let Some(column) = &table.time else { return Ok(None) };
        let first = table.first_time().unwrap_or(0.0).abs();
        let days = DAYS_OF_1970.iter().find(|(zero, _)| LIKELY_DAYS.contains(&(first - zero)));
        let of = |unit: TimeUnit, why: String| {
            let zero = days.filter(|_| unit == TimeUnit::DAYS).map_or(0.0, |(zero, _)| *zero);
            let has_unit = table.unit.is_some();
            Ok(Some(Times { unit, has_unit, zero, why }))
        };
        match (table.unit, columns.unit) {
            (Some(unit), Some(_)) => return of(unit, "by --time-unit".into()),
            (Some(unit), None) => return of(unit, format!("as the column {column:?} says")),
            (None, _) => {}
        }
        let by_size = |word| {
            let unit = TimeUnit::called(word).unwrap_or(TimeUnit::SECONDS);
            of(unit, "since 1970, by their size".into())
        };
        match (first, days) {
            (t, _) if t >= 3e17 => by_size("ns"),
            (t, _) if t >= 3e14 => by_size("us"),
            (t, _) if t >= 3e11 => by_size("ms"),
            (t, _) if t >= 3e8 => by_size("s"),
            (t, Some((_, who))) => Err(format!(
                "times such as {t} may be days, as {who} count them, or seconds: --time-unit d, or s, says which"
            )),
            _ => of(
                TimeUnit::SECONDS,
                format!("as the column {column:?} says no unit (--time-unit)"),
            ),
        }
    }

    /// The begin of a decay, as ns and what is added to them; since 1970 if the table's times are.
    pub fn begin(&self, decay: &Decay) -> Option<(i64, f64)> {
        let (unit_ns, after) = (self.unit.ns, decay.times.first()? - self.zero);
        let base = (unit_ns >= 1.0).then(|| decay.base.checked_mul(unit_ns as i64)).flatten();
        Some(match base {
            Some(base_ns) => (base_ns, after * unit_ns),
            None => (0, (decay.base as f64 + after) * unit_ns),
        })
    }
}
