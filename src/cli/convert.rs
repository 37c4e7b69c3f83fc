//! `inkling convert`: a table or an array of others becomes a burst recording.

use super::burst_clock::{BurstClock, LATEST_NS, time_in_name};
use super::exit::{Exit, Failure};
use super::progress::thousands;
use crate::burst::Burst;
use crate::io::columnar::{self, Content, FileKind};
use crate::io::matrix::Matrix;
use crate::io::numpy;
use crate::io::outputs;
use crate::io::recording_writer::{RecordingWriter, WriterOptions};
use crate::io::sampling::{self, Sampled};
use crate::io::table_file::{self, Columns, Table};
use bytes::Bytes;
use std::collections::BTreeSet;
use std::io::Write;
use std::path::PathBuf;
use std::sync::Arc;

/// Longest printhead name.
const LONGEST_NAME: usize = 200;
/// Where nothing says when the first sample was.
const SOME_START: &str = "2025-01-01T08:00:00Z";

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  inkling convert decay.csv -o decay.mcap
  inkling convert gaps.csv --time time_s --outputs output_v --burst gap \\
      -o gaps.mcap
  inkling convert pendulum.csv --resample -o pendulum.mcap
  inkling convert night.parquet --burst drop --period-s 5e-7 --printhead K1 \\
      -o night.mcap
  inkling convert K1_20261101T0800.npy --period-s 5e-7 --start name \\
      --every 0.02 -o K1.mcap
  inkling convert heads.npz --outputs K1 --time t --period-s dt \\
      --temperature 31.5 -o K1.mcap

A table (CSV with comma, semicolon or tab; Parquet; Arrow IPC): time is in seconds, unless its \
column's name ends in _ms, _us or _ns, its type says so, or they are so large that they count from \
1970; times of 1979 and later, and such as 2026-11-01T08:00:00Z, are UTC. Each output \
becomes a channel (in the order of --outputs), each value of --burst a burst; --printhead may name a \
column. Sampling must be \
regular, but for the rounding of written times; --resample interpolates (cubic spline) to the \
usual sample period. With --period-s rows are samples one after the other, and --time is when a \
burst begins. A cell that is a list holds a channel's samples: each row is a burst. An array \
(.npy; .npz): samples, channels x samples, or bursts x channels x samples. In a .npz --time, \
--period-s, --temperature, --voltage may name further arrays, one number a burst or one for all. \
Samples are stored as int16 where all of a burst are such, else as float32. A critique takes all \
outputs of one recording as one system: what is independent becomes recordings of its own \
(--outputs).")]
pub struct Args {
    /// Table or array: CSV, Parquet, Arrow IPC, .npy, .npz
    table: PathBuf,
    /// Recording to write
    #[arg(short, long, value_name = "RECORDING")]
    out: PathBuf,
    /// Column of time [default: the first]
    #[arg(long, value_name = "COLUMN")]
    time: Option<String>,
    /// Columns of outputs [default: the rest]; of a .npz the array of samples
    #[arg(long, value_name = "COLUMN,...", value_delimiter = ',')]
    outputs: Option<Vec<String>>,
    /// Column that tells decays apart, where the table holds several
    #[arg(long, value_name = "COLUMN")]
    burst: Option<String>,
    /// As JSON
    #[arg(long)]
    json: bool,
    /// Interpolate irregular or missing samples to a regular grid
    #[arg(long)]
    resample: bool,
    /// Time of the first sample, RFC 3339, or `name`: as the file's name says
    #[arg(long, value_name = "TIME")]
    start: Option<String>,
    /// Time from one burst to the next, s
    #[arg(long, allow_negative_numbers = true, value_name = "S")]
    every: Option<f64>,
    /// Sample period: seconds, or a column
    #[arg(long, allow_negative_numbers = true, value_name = "S|COLUMN")]
    period_s: Option<String>,
    /// Whose bursts they are: a name, or a column of a table [default: the file's name, with --start name without its time]
    #[arg(long, value_name = "NAME")]
    printhead: Option<String>,
    /// Number of the first channel
    #[arg(long, value_name = "N", default_value_t = 0)]
    first_channel: u32,
    /// Ink temperature: degrees C, or a column
    #[arg(long, allow_negative_numbers = true, value_name = "C|COLUMN")]
    temperature: Option<String>,
    /// Amplitude of the actuation: V, or a column
    #[arg(long, allow_negative_numbers = true, value_name = "V|COLUMN")]
    voltage: Option<String>,
}

/// A number for all bursts, or a column: its place among those beside the samples.
#[derive(Clone, Copy, Debug)]
enum Said {
    Constant(f64),
    Beside(usize),
}

impl Said {
    /// `beside`: the columns that are asked for so far.
    fn of(text: &Option<String>, beside: &mut Vec<String>) -> Option<Said> {
        let text = text.as_ref()?;
        Some(match text.parse() {
            Ok(x) => Said::Constant(x),
            Err(_) => {
                beside.push(text.clone());
                Said::Beside(beside.len() - 1)
            }
        })
    }

    fn in_burst(self, matrix: &Matrix) -> f64 {
        match self {
            Said::Constant(x) => x,
            Said::Beside(place) => matrix.beside.get(place).copied().unwrap_or(f64::NAN),
        }
    }
}

/// Bursts of a file, and what to say of it.
struct Opened {
    matrices: Box<dyn Iterator<Item = Result<Matrix, Failure>>>,
    unit: Unit,
    /// Where the table's own times say it.
    period_s: Option<f64>,
    /// Cells without a value, which no interpolation fills.
    missing: usize,
    /// Names of the channels.
    outputs: Vec<String>,
    sampled: Option<Sampled>,
}

impl Opened {
    /// Of which nothing is to be said.
    fn new(
        matrices: impl Iterator<Item = Result<Matrix, Failure>> + 'static,
        unit: Unit,
        outputs: Vec<String>,
    ) -> Opened {
        let matrices = Box::new(matrices);
        Opened { matrices, unit, period_s: None, missing: 0, outputs, sampled: None }
    }
}

pub fn run(args: Args) -> Result<Exit, Failure> {
    let start_ns = start_ns(&args)?;
    let mut beside = Vec::new();
    let period = Said::of(&args.period_s, &mut beside);
    let temperature = Said::of(&args.temperature, &mut beside);
    let voltage = Said::of(&args.voltage, &mut beside);
    check(&args, period)?;
    refuse_beside(&args)?;
    outputs::check_file(&args.out, outputs::ResultFile::Recording)?;
    let kind = columnar::table_kind_of(&args.table)?;
    let opened = match kind {
        FileKind::Numpy => open_array(&args, &beside)?,
        kind => open_table(&args, kind, beside)?,
    };
    let mut conversion = Conversion {
        args: &args,
        printhead: args.name()?.into(),
        // else the table's own times say it
        period: period.or(opened.period_s.map(Said::Constant)),
        unit: opened.unit,
        temperature,
        voltage,
        clock: BurstClock::new(start_ns, args.every),
        bursts: 0,
        samples: 0,
        least_period_s: f64::INFINITY,
        most_period_s: 0.0,
        shortest: u32::MAX,
        longest: 0,
        missing: opened.missing,
        heads: BTreeSet::new(),
    };
    let mut writer =
        RecordingWriter::create(&args.out, WriterOptions::default()).map_err(Failure::new)?;
    for matrix in opened.matrices {
        let burst = conversion.burst(matrix?)?;
        writer.write(&burst, burst.t_acq_ns as u64).map_err(Failure::new)?;
    }
    writer.finish().map_err(Failure::new)?;
    match args.json {
        true => super::output::event(&conversion.document(&opened.outputs))?,
        false => conversion.tell(&opened.outputs, opened.sampled.as_ref())?,
    }
    Ok(Exit::Done)
}

/// Bursts under way: what is said of all of them, and what they were so far.
struct Conversion<'a> {
    args: &'a Args,
    printhead: Arc<str>,
    period: Option<Said>,
    unit: Unit,
    temperature: Option<Said>,
    voltage: Option<Said>,
    clock: BurstClock,
    bursts: u64,
    samples: u64,
    least_period_s: f64,
    most_period_s: f64,
    /// Samples per channel of the shortest and the longest burst.
    shortest: u32,
    longest: u32,
    missing: usize,
    /// Those that rows name.
    heads: BTreeSet<Arc<str>>,
}

impl Conversion<'_> {
    /// The next one.
    fn burst(&mut self, matrix: Matrix) -> Result<Burst, Failure> {
        let args = self.args;
        let wrong = |what: &str| Failure::new(format!("{}: {what}", args.table.display()));
        let of_burst = |n: u64, what: &str| wrong(&format!("burst {n}: {what}"));
        let nobody = || Failure::usage("--period-s: nothing else says the sample period");
        let period_s = self.period.ok_or_else(nobody)?.in_burst(&matrix);
        if !(period_s.is_finite() && period_s > 0.0) {
            return Err(of_burst(self.bursts, &format!("{period_s} s is no sample period")));
        }
        if period_s > LONGEST_PERIOD_S {
            let what = "s between samples: if that is a rate, give the period, which is 1 / rate";
            return Err(of_burst(self.bursts, &format!("{period_s} {what}")));
        }
        let period_ns = period_s * 1e9;
        let length_ns = f64::from(matrix.samples_per_channel) * period_ns;
        let time_ns = matrix.time.map(|t| t * self.unit.ns);
        if time_ns.is_some_and(|t| !t.is_finite()) {
            return Err(of_burst(self.bursts, "it has no time"));
        }
        let t_acq_ns = self
            .clock
            .next(time_ns, length_ns, period_ns)
            .ok_or_else(|| wrong("its times reach beyond the years 1970 to 2200"))?;
        if args.first_channel.checked_add(matrix.channels).is_none() {
            return Err(Failure::usage(format!(
                "--first-channel {}: {} channels more have no numbers",
                args.first_channel, matrix.channels
            )));
        }
        let printhead = self.of_head(matrix.printhead.clone())?;
        self.bursts += 1;
        self.samples += u64::from(matrix.channels) * u64::from(matrix.samples_per_channel);
        self.shortest = self.shortest.min(matrix.samples_per_channel);
        self.longest = self.longest.max(matrix.samples_per_channel);
        self.least_period_s = self.least_period_s.min(period_s);
        self.most_period_s = self.most_period_s.max(period_s);
        let measured =
            |said: Option<Said>| said.map(|s| s.in_burst(&matrix)).filter(|x| x.is_finite());
        Ok(Burst {
            t_acq_ns,
            printhead,
            first_channel: args.first_channel,
            channels: matrix.channels,
            samples_per_channel: matrix.samples_per_channel,
            sample_period_s: period_s,
            format: matrix.format,
            layout: matrix.layout,
            temperature_c: measured(self.temperature),
            drive_voltage_v: measured(self.voltage),
            idle_time_s: Vec::new(),
            neighbours_fired: Bytes::new(),
            samples: matrix.samples,
        })
    }

    /// The printhead of a burst: as its row says, else as is said of all.
    fn of_head(&mut self, own: Option<String>) -> Result<Arc<str>, Failure> {
        let Some(name) = own else { return Ok(self.printhead.clone()) };
        if name.chars().count() > LONGEST_NAME {
            return Err(Failure::new("a printhead's name that long?"));
        }
        if let Some(known) = self.heads.get(name.as_str()) {
            return Ok(known.clone());
        }
        let name: Arc<str> = name.into();
        self.heads.insert(name.clone());
        Ok(name)
    }

    /// The same as [`Conversion::tell`], for programs.
    fn document(&self, outputs: &[String]) -> serde_json::Value {
        serde_json::json!({
            "recording": self.args.out,
            "bursts": self.bursts,
            "samples": self.samples,
            "sample_period_s": [self.least_period_s, self.most_period_s],
            "samples_per_channel": [self.shortest, self.longest],
            "outputs": outputs,
            "printheads": self.heads,
            "cells_missing": self.missing,
            "times_in": self.unit.by_size,
        })
    }

    /// What became of the table, and what nothing in it said.
    fn tell(&self, outputs: &[String], sampled: Option<&Sampled>) -> std::io::Result<()> {
        let mut out = super::output::report();
        let path = self.args.out.display();
        let (bursts, samples) = (thousands(self.bursts), thousands(self.samples));
        let (least, most) = (self.least_period_s as f32, self.most_period_s as f32);
        let every =
            if least == most { format!("{least} s") } else { format!("{least} to {most} s") };
        writeln!(out, "{path}: {bursts} bursts, {samples} samples, one every {every}")?;
        for (n, output) in (0u64..).zip(outputs) {
            let channel = n + u64::from(self.args.first_channel);
            writeln!(out, "  channel {channel}: {}", super::report::printable(output))?;
        }
        match sampled {
            Some(sampled) if self.args.resample => writeln!(
                out,
                "  resampled: {} of {samples} samples interpolated, {} cells were missing",
                sampled.interpolated, sampled.missing
            )?,
            Some(sampled) => {
                let off = sampled.most_off_grid;
                writeln!(out, "  times within {off:.3} periods of a regular grid")?;
            }
            None => {}
        }
        if let Some(unit) = self.unit.by_size {
            writeln!(out, "  times are taken as {unit} since 1970, by their size")?;
        }
        if !self.heads.is_empty() {
            writeln!(out, "  printheads by their column: {}", self.heads.len())?;
        }
        if self.shortest < self.longest {
            writeln!(
                out,
                "  bursts have {} to {} samples a channel; a design takes one length, the others are \
                 `design_mismatch`",
                self.shortest, self.longest
            )?;
        }
        if self.missing > 0 {
            writeln!(
                out,
                "  {} cells have no value: signals with one are rejected (`non_finite`); --resample interpolates",
                thousands(self.missing as u64)
            )?;
        }
        if self.clock.invented() {
            writeln!(out, "  nothing says when: the first burst is put at {SOME_START} (--start)")?;
        }
        if self.clock.in_a_row() {
            writeln!(
                out,
                "  nothing says when bursts begin: put one after the other without a gap (--time, --every)"
            )?;
        }
        match self.clock.moved {
            0 => Ok(()),
            n => {
                writeln!(out, "  {n} bursts begin where an earlier one has not ended: put after it")
            }
        }
    }
}

impl Args {
    fn name(&self) -> Result<String, Failure> {
        let is_good = |name: &str| (1..=LONGEST_NAME).contains(&name.chars().count());
        match &self.printhead {
            Some(name) if is_good(name) => Ok(name.clone()),
            Some(_) => {
                Err(Failure::usage(format!("--printhead: give 1 to {LONGEST_NAME} characters")))
            }
            None => {
                let stem = self.stem();
                let time = time_in_name(&stem).filter(|_| self.start.as_deref() == Some("name"));
                let name = time.map_or(stem, |time| time.without);
                Ok(name.chars().take(LONGEST_NAME).collect())
            }
        }
    }

    /// The table's name.
    fn stem(&self) -> String {
        self.table.file_stem().unwrap_or_default().to_string_lossy().into_owned()
    }
}

/// What contradicts itself, or has no effect.
fn check(args: &Args, period: Option<Said>) -> Result<(), Failure> {
    let wrong = |what: &str| Err(Failure::usage(what));
    let no_time = |s: f64| !(s.is_finite() && s > 0.0);
    if matches!(period, Some(Said::Constant(s)) if no_time(s)) {
        return wrong("--period-s: give seconds, more than 0");
    }
    if args.every.is_some_and(no_time) {
        return wrong("--every: give seconds, more than 0");
    }
    if args.every.is_some() && args.time.is_some() && period.is_some() {
        return wrong("--every and --time both say when bursts begin: give one of them");
    }
    if args.resample && period.is_some() {
        return wrong(
            "--resample has no effect with --period-s: rows are samples one after the other",
        );
    }
    Ok(())
}

/// `None`: nobody says.
fn start_ns(args: &Args) -> Result<Option<i64>, Failure> {
    let Some(text) = &args.start else { return Ok(None) };
    if text == "name" {
        let stem = args.stem();
        let none = || {
            Failure::usage(format!(
                "--start name: there is no time such as 20261101T080000 or 2026-11-01_08-00-00 in {stem:?}"
            ))
        };
        return time_in_name(&stem).map(|time| Some(time.ns)).ok_or_else(none);
    }
    chrono::DateTime::parse_from_rfc3339(text)
        .ok()
        .and_then(|t| t.timestamp_nanos_opt())
        .filter(|ns| (0.0..LATEST_NS).contains(&(*ns as f64)))
        .map(Some)
        .ok_or_else(|| {
            Failure::usage(format!(
                "--start {text:?} is no time such as {SOME_START} (1970 to 2200), nor `name`"
            ))
        })
}

/// What stands beside the samples is a number that a printhead may have.
fn refuse_beside(args: &Args) -> Result<(), Failure> {
    let number = |text: &Option<String>| text.as_deref().and_then(|text| text.parse::<f64>().ok());
    for (option, value, most) in
        [("--temperature", &args.temperature, 1000.0), ("--voltage", &args.voltage, 1e5)]
    {
        if let Some(v) = number(value).filter(|v| !(-most..=most).contains(v)) {
            return Err(Failure::usage(format!("{option} {v}: give a number up to {most}")));
        }
    }
    Ok(())
}

/// Nothing that rings is sampled more slowly: tides of a day are, every ten minutes.
const LONGEST_PERIOD_S: f64 = 1000.0;

/// The unit of a time column.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Unit {
    ns: f64,
    /// Its name, where neither the column's name nor its type said it but the size of its first time.
    by_size: Option<&'static str>,
}

impl Unit {
    const SECONDS: Unit = Unit { ns: 1e9, by_size: None };

    /// By the end of the column's name; else, of times since 1970, by how large they are: those of 1979 to 2200 overlap in
    /// no two units.
    fn of(column: &str, first: Option<f64>) -> Unit {
        let units = [("_s", 1e9), ("_ms", 1e6), ("_us", 1e3), ("_ns", 1.0)];
        if let Some((_, ns)) = units.iter().find(|(end, _)| column.ends_with(end)) {
            return Unit { ns: *ns, by_size: None };
        }
        match first.map_or(0.0, f64::abs) {
            t if t >= 3e17 => Unit { ns: 1.0, by_size: Some("nanoseconds") },
            t if t >= 3e14 => Unit { ns: 1e3, by_size: Some("microseconds") },
            t if t >= 3e11 => Unit { ns: 1e6, by_size: Some("milliseconds") },
            t if t >= 3e8 => Unit { ns: 1e9, by_size: Some("seconds") },
            _ => Unit::SECONDS,
        }
    }
}

fn open_table(args: &Args, kind: FileKind, beside: Vec<String>) -> Result<Opened, Failure> {
    let columns = Columns {
        time: args.time.clone(),
        outputs: args.outputs.clone(),
        burst: args.burst.clone(),
        printhead: args.printhead.clone(),
        beside,
        rows_are_samples: args.period_s.is_some(),
    };
    let table = match kind {
        FileKind::Text => table_file::read(&args.table, &columns)?,
        kind => match columnar::read(&args.table, kind, &columns)? {
            Content::Rows(table) => table,
            Content::Bursts { time, outputs, matrices } => {
                if args.resample {
                    return Err(Failure::usage("--resample has no effect: each row is a burst"));
                }
                let first = matrices.iter().find_map(|matrix| matrix.time);
                let unit = time.map_or(Unit::SECONDS, |time| Unit::of(&time, first));
                return Ok(Opened::new(matrices.into_iter().map(Ok), unit, outputs));
            }
        },
    };
    let failed = |e: &dyn std::fmt::Display| Failure::new(format!("{}: {e}", args.table.display()));
    let first = table.decays.first().and_then(|decay| decay.times.first().copied());
    let unit = Unit::of(&table.time, first.filter(|_| !table.time.is_empty()));
    let (period, sampled) = match args.period_s {
        Some(_) => (None, sampling::as_listed(&table).map_err(|e| failed(&e))?),
        None => {
            let sampled = sampling::sample(&table, args.resample).map_err(|e| failed(&e))?;
            (Some(sampled.period * unit.ns / 1e9), sampled)
        }
    };
    let Table { time, outputs, decays } = table;
    let has_time = !time.is_empty() && args.every.is_none();
    let regular = sampled.decays.iter().zip(decays);
    let matrices: Vec<Matrix> = regular
        .map(|(regular, decay)| Matrix {
            time: has_time.then_some(regular.start),
            printhead: Some(decay.printhead).filter(|name| !name.is_empty()),
            beside: decay.beside,
            ..matrix(&regular.outputs)
        })
        .collect();
    let missing = sampled.missing;
    Ok(Opened {
        period_s: period,
        missing: if args.resample { 0 } else { missing },
        sampled: period.is_some().then(|| Sampled { decays: Vec::new(), ..sampled }),
        ..Opened::new(matrices.into_iter().map(Ok), unit, outputs)
    })
}

/// `outputs`: of each channel its samples.
fn matrix(outputs: &[Vec<f64>]) -> Matrix {
    let gathered = numpy::gathered(outputs.iter().flatten().copied());
    Matrix {
        channels: outputs.len() as u32,
        samples_per_channel: outputs.first().map_or(0, Vec::len) as u32,
        format: gathered.format,
        samples: gathered.bytes.into(),
        ..Matrix::default()
    }
}

fn open_array(args: &Args, beside: &[String]) -> Result<Opened, Failure> {
    if args.burst.is_some() || args.resample {
        return Err(Failure::usage("--burst and --resample are of tables, not of arrays"));
    }
    let name = match args.outputs.as_deref() {
        None => None,
        Some([one]) => Some(one.as_str()),
        Some(_) => return Err(Failure::usage("--outputs: one array of a .npz")),
    };
    let path = &args.table;
    let others: Vec<&str> = beside.iter().chain(&args.time).map(String::as_str).collect();
    let array = numpy::open(path, name, &others).map_err(Failure::new)?;
    let bursts = array.left();
    let numbers = |name: &str, one_for_all: bool| {
        let (all, unit_ns) = numpy::numbers(path, name).map_err(Failure::new)?;
        match (all.len(), one_for_all) {
            (1, true) => Ok((vec![all[0]; bursts], unit_ns)),
            (n, _) if n == bursts => Ok((all, unit_ns)),
            (n, _) => {
                let what = format!("array {name:?} has {n} numbers for {bursts} bursts");
                Err(Failure::new(format!("{}: {what}", path.display())))
            }
        }
    };
    let columns: Vec<Vec<f64>> =
        beside.iter().map(|name| Ok(numbers(name, true)?.0)).collect::<Result<_, Failure>>()?;
    let times = args.time.as_deref().map(|name| numbers(name, false)).transpose()?;
    let first = times.as_ref().and_then(|(times, _)| times.first().copied());
    let unit = match (&times, &args.time) {
        (Some((_, Some(unit_ns))), _) => Unit { ns: *unit_ns as f64, by_size: None },
        (_, Some(name)) => Unit::of(name, first),
        _ => Unit::SECONDS,
    };
    let times = times.map(|(times, _)| times);
    let matrices = array.enumerate().map(move |(i, matrix)| {
        let matrix = matrix.map_err(Failure::new)?;
        let beside = columns.iter().map(|column| column[i]).collect();
        Ok(Matrix { time: times.as_ref().map(|times| times[i]), beside, ..matrix })
    });
    Ok(Opened::new(matrices, unit, Vec::new()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_read_off_the_column_name() {
        let ns = |column: &str, first: f64| Unit::of(column, Some(first)).ns;
        assert_eq!(
            ["time", "time_s", "t_ms", "t_us", "t_ns"].map(|column| ns(column, 0.5)),
            [1e9, 1e9, 1e6, 1e3, 1.0]
        );
        // 2026, and what a name says stands
        assert_eq!([1.77e9, 1.77e12, 1.77e15, 1.77e18].map(|t| ns("t", t)), [1e9, 1e6, 1e3, 1.0]);
        assert_eq!(ns("t_ms", 1.77e15), 1e6);
    }
}
