//! The options of `inkling convert` ([`Args`]), which of them are refused ([`Args::check`]), and
//! the numbers that they give for bursts ([`BurstValues`]): a sample period, a temperature or a
//! voltage may be one number for all bursts or the name of a column.

use super::super::exit::Failure;
use super::burst_clock::{is_representable, time_in_name};
use inkling_io::dialect::{NO_CELSIUS, NO_VOLTS, has_word};
use inkling_io::table_file::Decay;
use inkling_io::time_column::TimeUnit;
use std::path::{Path, PathBuf};

/// Longest printhead name.
pub const LONGEST_NAME: usize = 200;
/// Time of the first sample if nothing else gives it.
pub const SOME_START: &str = "2025-01-01T08:00:00Z";

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  inkling convert decay.csv -o decay.mcap
  inkling convert gaps.csv --time time_s --outputs output_v --burst gap \\
      -o gaps.mcap
  inkling convert pendulum.csv --resample -o pendulum.mcap
  inkling convert scope.csv --skip-lines 12 --time-unit us -o scope.mcap
  inkling convert scope_*.csv --every 0.5 -o scope.mcap
  inkling convert night.parquet --burst drop --period-s 5e-7 --printhead K1 \\
      -o night.mcap
  inkling convert K1_20261101T0800.parquet --period-s 5e-7 --start name \\
      --every 0.02 -o K1.mcap

A table (CSV with comma, semicolon or tab; Parquet): the column of time is the one that is called \
so, else the first. Its unit is what its name or a row of units says, such as Time (ms), t_us \
or t/ns, or its type; else seconds, unless they are so large that they count from \
1970; times of 1979 and later, and such as 2026-11-01T08:00:00Z, are UTC. Each output \
becomes a channel (in the order of --outputs), each value of --burst a burst; so does each of several \
tables, and each segment where an instrument exports them in one. --printhead may name a \
column. Sampling must be \
regular, but for the rounding of written times; --resample interpolates (cubic spline) to the \
usual sample period. With --period-s rows are samples one after the other, and times say when a \
burst begins. A cell that is a list holds a channel's samples: each row is a burst. Arrays are \
judged from Python (import inkling). Samples are stored as int16 where all of a burst are such, else as float32. A critique takes all \
outputs of one recording as one system: what is independent becomes recordings of its own \
(--outputs).")]
pub struct Args {
    /// Tables: CSV, Parquet; bursts of one after those of the other
    #[arg(required = true, value_name = "TABLE")]
    pub tables: Vec<PathBuf>,
    /// Whether `tables` were put into the order of the numbers in their names
    #[arg(skip)]
    pub by_number: bool,
    /// Recording to write
    #[arg(short, long, value_name = "RECORDING")]
    pub out: PathBuf,
    /// Column of time [default: the one that is called so, else the first]
    #[arg(long, value_name = "COLUMN")]
    pub time: Option<String>,
    /// Unit of times: s, ms, us, ns, min, h or d [default: as the column's name says]
    #[arg(long, value_name = "UNIT")]
    pub time_unit: Option<String>,
    /// Lines before the table that are passed over
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub skip_lines: u64,
    /// Columns of outputs [default: the rest]
    #[arg(long, value_name = "COLUMN,...", value_delimiter = ',')]
    pub outputs: Option<Vec<String>>,
    /// Column that tells decays apart, where the table holds several
    #[arg(long, value_name = "COLUMN")]
    pub burst: Option<String>,
    /// As JSON
    #[arg(long)]
    pub json: bool,
    /// Interpolate irregular or missing samples to a regular grid
    #[arg(long)]
    pub resample: bool,
    /// Time of the first sample, RFC 3339, or `name`: as the file's name says
    #[arg(long, value_name = "TIME")]
    pub start: Option<String>,
    /// Time from one burst to the next, s
    #[arg(long, allow_negative_numbers = true, value_name = "S")]
    pub every: Option<f64>,
    /// Sample period: seconds, or a column
    #[arg(long, allow_negative_numbers = true, value_name = "S|COLUMN")]
    pub period_s: Option<String>,
    /// Whose bursts they are: a name, a column of a table, or `name` of each file [default: the file's name, with --start name without its time]
    #[arg(long, value_name = "NAME")]
    pub printhead: Option<String>,
    /// Number of the first channel
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub first_channel: u32,
    /// Ink temperature: degrees C, or a column
    #[arg(long, allow_negative_numbers = true, value_name = "C|COLUMN")]
    pub temperature: Option<String>,
    /// Amplitude of the actuation: V, or a column
    #[arg(long, allow_negative_numbers = true, value_name = "V|COLUMN")]
    pub voltage: Option<String>,
}

impl Args {
    /// What the options give beside the samples, and the columns that they name.
    pub fn values(&self) -> Result<BurstValues, Failure> {
        // the unit of a column is what its name says: of periods any of time, else the one of the option
        let period =
            |column: &str| Ok(TimeUnit::in_name(column)?.map_or(1.0, |unit| unit.ns / 1e9));
        let only = |unit: &str, others: &str, column: &str| match has_word(column, others) {
            true => Err(format!("by its name {column:?} is not in {unit}: add a column that is")),
            false => Ok(1.0),
        };
        let mut columns = Vec::new();
        let mut value =
            |option: &str, text: &Option<String>, unit: &dyn Fn(&str) -> Result<f64, String>| {
                let value = BurstValue::of(text, unit, &mut columns);
                value.map_err(|what| Failure::usage(format!("{option}: {what}")))
            };
        let period_s = value("--period-s", &self.period_s, &period)?;
        let celsius = |column: &str| only("degrees C", NO_CELSIUS, column);
        let temperature = value("--temperature", &self.temperature, &celsius)?;
        let voltage = value("--voltage", &self.voltage, &|column| only("V", NO_VOLTS, column))?;
        Ok(BurstValues { period_s, temperature, voltage, columns })
    }

    /// The name of the printhead of a table: the one that is given, else that of its file, without its time if the time
    /// is taken from there. Where nothing is given, files whose names differ in nothing but a time, or else a number, are
    /// of the printhead of the first of them.
    pub fn name(&self, table: &Path) -> Result<String, Failure> {
        let Some(name) = self.printhead.as_ref().filter(|name| *name != "name") else {
            let of_one = |other: &&PathBuf| {
                self.printhead.is_none() && without_number(other) == without_number(table)
            };
            let stem = stem(self.tables.iter().find(of_one).map_or(table, PathBuf::as_path));
            let time = time_in_name(&stem).filter(|_| self.start.as_deref() == Some("name"));
            let name = time.map_or(stem, |time| time.without);
            return Ok(name.chars().take(LONGEST_NAME).collect());
        };
        let is_good = (1..=LONGEST_NAME).contains(&name.chars().count());
        let what = || Failure::usage(format!("--printhead: give 1 to {LONGEST_NAME} characters"));
        is_good.then(|| name.clone()).ok_or_else(what)
    }

    /// The unit of `--time-unit`.
    pub fn unit(&self) -> Result<Option<TimeUnit>, Failure> {
        let Some(word) = &self.time_unit else { return Ok(None) };
        let wrong =
            || Failure::usage(format!("--time-unit {word:?}: give s, ms, us, ns, min, h or d"));
        TimeUnit::called(word).map(Some).ok_or_else(wrong)
    }

    /// Refuses options that contradict each other, have no effect, or whose numbers are out of range.
    pub fn check(&self, values: &BurstValues) -> Result<(), Failure> {
        let wrong = |what: &str| Err(Failure::usage(what));
        let no_time = |s: f64| !(s.is_finite() && s > 0.0);
        if matches!(values.period_s, Some(BurstValue::Constant(s)) if no_time(s)) {
            return wrong("--period-s: give seconds, more than 0");
        }
        if self.every.is_some_and(no_time) {
            return wrong("--every: give seconds, more than 0");
        }
        if self.every.is_some() && self.time.is_some() && values.period_s.is_some() {
            return wrong("--every and --time both say when bursts begin: give one of them");
        }
        if self.resample && values.period_s.is_some() {
            let why = "rows are samples one after the other";
            return wrong(&format!("--resample has no effect with --period-s: {why}"));
        }
        let no_number = |value| matches!(value, Some(BurstValue::Constant(v)) if !v.is_finite());
        if no_number(values.temperature) || no_number(values.voltage) {
            return wrong("--temperature, --voltage: give a finite number");
        }
        Ok(())
    }

    /// The time of `--start`, ns, for this table; `None` if the option is not given.
    pub fn start_ns(&self, table: &Path) -> Result<Option<i64>, Failure> {
        let Some(text) = &self.start else { return Ok(None) };
        let (ns, why_none) = if text == "name" {
            let stem = stem(table);
            let such = "20261101T080000 or 2026-11-01_08-00-00";
            let why = format!("--start name: there is no time such as {such} in {stem:?}");
            (time_in_name(&stem).map(|time| time.ns), why)
        } else {
            let time = chrono::DateTime::parse_from_rfc3339(text).ok();
            let ns = time.and_then(|t| t.timestamp_nanos_opt()).filter(|ns| is_representable(*ns));
            let such = format!("{SOME_START} (1970 to 2200)");
            (ns, format!("--start {text:?} is no time such as {such}, nor `name`"))
        };
        ns.map(Some).ok_or_else(|| Failure::usage(why_none))
    }
}

/// The name of a table's file, without its ending.
fn stem(table: &Path) -> String {
    table.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

/// The letters and digits of a table's name without its time, or else without its last number.
fn without_number(table: &Path) -> String {
    let stem = stem(table);
    let is_digit = |c: char| c.is_ascii_digit();
    let name = match time_in_name(&stem) {
        Some(time) if time.without == stem => String::new(),
        Some(time) => time.without,
        None => {
            let end = stem.rfind(is_digit).map_or(0, |at| at + 1);
            format!("{}{}", stem[..end].trim_end_matches(is_digit), &stem[end..])
        }
    };
    name.chars().filter(|c| c.is_alphanumeric()).collect()
}

/// A number that an option gives: a constant for all bursts, or a column.
#[derive(Clone, Copy, Debug)]
pub enum BurstValue {
    Constant(f64),
    /// Its index among the columns that are read beside the samples, and its unit in that of the option.
    Column {
        place: usize,
        unit: f64,
    },
}

impl BurstValue {
    /// The value of an option; a column that it names is added to `columns`. `unit`: the unit of a column in that of
    /// the option, by the column's name.
    fn of(
        text: &Option<String>,
        unit: impl Fn(&str) -> Result<f64, String>,
        columns: &mut Vec<String>,
    ) -> Result<Option<BurstValue>, String> {
        let Some(text) = text else { return Ok(None) };
        if let Ok(x) = text.parse() {
            return Ok(Some(BurstValue::Constant(x)));
        }
        let unit = unit(text)?;
        columns.push(text.clone());
        Ok(Some(BurstValue::Column { place: columns.len() - 1, unit }))
    }

    /// The number for one burst; NaN if its column has none.
    pub fn in_burst(self, decay: &Decay) -> f64 {
        match self {
            BurstValue::Constant(x) => x,
            BurstValue::Column { place, unit } => {
                let first = decay.beside.get(place).and_then(|of| of.first());
                first.map_or(f64::NAN, |value| value * unit)
            }
        }
    }
}

/// The values of `--period-s`, `--temperature` and `--voltage`; `None` if the option is not given.
#[derive(Debug)]
pub struct BurstValues {
    pub period_s: Option<BurstValue>,
    pub temperature: Option<BurstValue>,
    pub voltage: Option<BurstValue>,
    /// The columns that the options name.
    pub columns: Vec<String>,
}
