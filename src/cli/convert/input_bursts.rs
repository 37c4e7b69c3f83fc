//! Reads the bursts of a table, and finds the unit of its times.
//!
//! In: the options. Out: decays, one per burst ([`InputBursts`]). There are two forms. Where cells
//! are lists, rows are bursts. Where rows are samples (a decay per burst), their times must lie on a
//! regular grid, give the sample period, and may be resampled.

use super::super::exit::Failure;
use super::args::Args;
use inkling_io::sampling::{self, Sampled};
use inkling_io::table_file::{self, Columns, Decay, Table};
use inkling_io::{columnar, csv_table};

/// The bursts of a table, and what is to be told about it.
#[derive(Default)]
pub struct InputBursts {
    pub decays: Vec<Decay>,
    /// The unit of the column of times, if there is one.
    pub unit: Option<TimeUnit>,
    /// The sample period, s, if the table's own times give it.
    pub period_s: Option<f64>,
    /// Number of cells without a value that no interpolation fills.
    pub missing: usize,
    pub outputs: Vec<String>,
    /// How regular the table's times are, if they are the times of samples.
    pub sampled: Option<Sampled>,
}

impl InputBursts {
    /// Reads a table. Its rows are samples, or whole bursts if its cells are lists. `beside`: columns that
    /// are read beside the samples.
    pub fn open(args: &Args, beside: &[String]) -> Result<InputBursts, Failure> {
        let columns = Columns {
            time: args.time.clone(),
            outputs: args.outputs.clone(),
            burst: args.burst.clone(),
            printhead: args.printhead.clone(),
            beside: beside.to_vec(),
            rows_are_samples: args.period_s.is_some(),
        };

        // 1. read the file by its kind
        let table = match columnar::is_parquet(&args.table)? {
            true => columnar::read(&args.table, &columns)?,
            false => csv_table::read(&args.table, &columns)?,
        };

        // 2. the unit of its times; rows that are bursts need nothing more
        let first_time = table.first_time();
        let Table { time, outputs, decays, rows_are_bursts } = table;
        let unit = time.as_ref().map(|time| TimeUnit::of(time, first_time));
        if rows_are_bursts {
            return match args.resample {
                true => Err(Failure::usage("--resample has no effect: each row is a burst")),
                false => Ok(InputBursts { decays, unit, outputs, ..InputBursts::default() }),
            };
        }

        // 3. rows that are samples: with --period-s they are taken as they are listed; else the
        // table's times give the period, and must be regular
        let by_times = time.filter(|_| args.period_s.is_none());
        let mut sampled = match &by_times {
            Some(time) => sampling::sample(decays, time, args.resample),
            None => sampling::as_listed(decays),
        }
        .map_err(|e| Failure::new(format!("{}: {e}", args.table.display())))?;
        let decays = std::mem::take(&mut sampled.decays);
        let missing = if args.resample { 0 } else { sampled.missing };
        let unit_ns = unit.map_or(TimeUnit::SECONDS.ns, |unit| unit.ns);
        let period_s = args.period_s.is_none().then_some(sampled.period * unit_ns / 1e9);
        let sampled = Some(sampled).filter(|_| period_s.is_some());
        Ok(InputBursts { decays, unit, period_s, missing, outputs, sampled })
    }
}

/// The unit of a time column.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimeUnit {
    pub ns: f64,
    /// Name of the unit, if it was recognised by the size of the first time, and not by the column's name or
    /// type.
    pub by_size: Option<&'static str>,
}

impl TimeUnit {
    pub const SECONDS: TimeUnit = TimeUnit { ns: 1e9, by_size: None };

    /// The unit of a column of times: by the ending of the column's name, or else by the size of the first
    /// time if it counts from 1970. Times of 1979 to 2200 do not overlap in any two units. Smaller times are
    /// seconds.
    pub fn of(column: &str, first: Option<f64>) -> TimeUnit {
        if let Some(ns) = table_file::unit_ns(column) {
            return TimeUnit { ns, by_size: None };
        }
        match first.map_or(0.0, f64::abs) {
            t if t >= 3e17 => TimeUnit { ns: 1.0, by_size: Some("nanoseconds") },
            t if t >= 3e14 => TimeUnit { ns: 1e3, by_size: Some("microseconds") },
            t if t >= 3e11 => TimeUnit { ns: 1e6, by_size: Some("milliseconds") },
            t if t >= 3e8 => TimeUnit { ns: 1e9, by_size: Some("seconds") },
            _ => TimeUnit::SECONDS,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_read_off_the_column_name() {
        let ns = |column: &str, first: f64| TimeUnit::of(column, Some(first)).ns;
        assert_eq!(
            ["time", "time_s", "t_ms", "t_us", "t_ns"].map(|column| ns(column, 0.5)),
            [1e9, 1e9, 1e6, 1e3, 1.0]
        );
        // times of 2026; the ending of a name has precedence
        assert_eq!([1.77e9, 1.77e12, 1.77e15, 1.77e18].map(|t| ns("t", t)), [1e9, 1e6, 1e3, 1.0]);
        assert_eq!(ns("t_ms", 1.77e15), 1e6);
    }
}
