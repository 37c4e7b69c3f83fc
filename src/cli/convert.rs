//! `inkling convert`: a table of time and outputs becomes a burst recording.

use super::exit::{Exit, Failure};
use super::progress::thousands;
use crate::burst::{Burst, Format, Layout};
use crate::io::outputs;
use crate::io::recording_writer::{RecordingWriter, WriterOptions};
use crate::io::sampling::{self, Regular};
use crate::io::table_file::{self, Columns};
use bytes::Bytes;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Times up to here (year 2200) leave room in i64 nanoseconds.
const LATEST_NS: f64 = 7.258e18;
/// Longest printhead name that is made of a file name.
const LONGEST_NAME: usize = 200;

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  inkling convert decay.csv -o decay.mcap
  inkling convert gaps.csv --time time_s --outputs output_v --burst gap -o gaps.mcap
  inkling convert pendulum.csv --resample -o pendulum.mcap

Time is in seconds, unless its column's name ends in _ms, _us or _ns. Each output becomes a channel
(0, 1, 2 ... in the order of --outputs), each value of --burst a burst. Samples are stored as float32.
Comma, semicolon and tab are understood. Sampling must be regular, but for the rounding of written
times; --resample interpolates (cubic spline) to the usual sample period.
A critique takes all outputs of one recording as one system: what is independent
becomes recordings of its own (--outputs).")]
pub struct Args {
    /// Table with one line of column names
    table: PathBuf,
    /// Recording to write
    #[arg(short, long, value_name = "RECORDING")]
    out: PathBuf,
    /// Column of time [default: the first]
    #[arg(long, value_name = "COLUMN")]
    time: Option<String>,
    /// Columns of outputs [default: the rest]
    #[arg(long, value_name = "COLUMN,...", value_delimiter = ',')]
    outputs: Option<Vec<String>>,
    /// Column that tells decays apart, where the table holds several
    #[arg(long, value_name = "COLUMN")]
    burst: Option<String>,
    /// Interpolate irregular or missing samples to a regular grid
    #[arg(long)]
    resample: bool,
    /// Time of the first sample, RFC 3339
    #[arg(long, value_name = "TIME", default_value = "2025-01-01T08:00:00Z")]
    start: String,
}

pub fn run(args: Args) -> Result<Exit, Failure> {
    let start_ns = chrono::DateTime::parse_from_rfc3339(&args.start)
        .ok()
        .and_then(|t| t.timestamp_nanos_opt())
        .filter(|ns| (0.0..LATEST_NS).contains(&(*ns as f64)))
        .ok_or_else(|| {
            let example = "2025-01-01T08:00:00Z";
            Failure::usage(format!(
                "--start {:?} is no time such as {example} (1970 to 2200)",
                args.start
            ))
        })?;
    if same_file(&args.table, &args.out) {
        return Err(Failure::usage(
            "the recording would overwrite its own table: choose another -o",
        ));
    }
    outputs::check_file(&args.out).map_err(Failure::new)?;
    let Args { time, outputs, burst, .. } = args;
    let columns = Columns { time, outputs, burst };
    let table = table_file::read(&args.table, &columns).map_err(Failure::new)?;
    let of_table = |e: &dyn std::fmt::Display| format!("{}: {e}", args.table.display());
    let sampled =
        sampling::sample(&table, args.resample).map_err(|e| Failure::new(of_table(&e)))?;
    let unit_s = unit_s(&table.time);
    let period_s = sampled.period * unit_s;
    let starts_ns = starts_ns(&sampled.decays, sampled.period, unit_s, start_ns)
        .ok_or_else(|| Failure::new(of_table(&"its times reach beyond the year 2200")))?;

    let name: String = args.table.file_stem().unwrap_or_default().to_string_lossy().into();
    let printhead: Arc<str> = name.chars().take(LONGEST_NAME).collect::<String>().into();
    let mut writer =
        RecordingWriter::create(&args.out, WriterOptions::default()).map_err(Failure::new)?;
    for (decay, t_acq_ns) in sampled.decays.iter().zip(&starts_ns.at) {
        let burst = as_burst(decay, &printhead, *t_acq_ns, period_s);
        writer.write(&burst, *t_acq_ns as u64).map_err(Failure::new)?;
    }
    writer.finish().map_err(Failure::new)?;

    let mut out = super::output::report();
    let samples: usize = sampled.decays.iter().flat_map(|d| &d.outputs).map(Vec::len).sum();
    writeln!(
        out,
        "{}: {} bursts, {} samples, one every {} s",
        args.out.display(),
        thousands(sampled.decays.len() as u64),
        thousands(samples as u64),
        period_s as f32
    )?;
    for (channel, output) in table.outputs.iter().enumerate() {
        writeln!(out, "  channel {channel}: {}", super::report::printable(output))?;
    }
    if args.resample {
        writeln!(
            out,
            "  resampled: {} of {samples} samples interpolated, {} cells were missing",
            sampled.interpolated, sampled.missing
        )?;
    } else {
        writeln!(out, "  times within {:.3} periods of a regular grid", sampled.most_off_grid)?;
    }
    if starts_ns.moved > 0 {
        writeln!(
            out,
            "  {} bursts begin where an earlier one has not ended: put after it",
            starts_ns.moved
        )?;
    }
    Ok(Exit::Done)
}

fn same_file(a: &Path, b: &Path) -> bool {
    match (a.canonicalize(), b.canonicalize()) {
        (Ok(a), Ok(b)) => a == b,
        _ => false,
    }
}

/// Seconds per unit of a time column, by the end of its name.
fn unit_s(column: &str) -> f64 {
    let units = [("_ms", 1e-3), ("_us", 1e-6), ("_ns", 1e-9)];
    units.iter().find(|(end, _)| column.ends_with(end)).map_or(1.0, |(_, unit_s)| *unit_s)
}

struct Starts {
    at: Vec<i64>,
    /// Bursts that were put after the one before them.
    moved: usize,
}

/// When the bursts begin: the first at `start_ns`, the others as far after it as the table has them.
/// A burst that would begin before an earlier one ends (times that start at 0 again) follows it, one
/// sample period later. `None`: beyond the year 2200.
fn starts_ns(decays: &[Regular], period: f64, unit_s: f64, start_ns: i64) -> Option<Starts> {
    let first = decays.first()?.start;
    let (mut starts, mut free_from) = (Starts { at: Vec::new(), moved: 0 }, f64::NEG_INFINITY);
    for decay in decays {
        let length = decay.outputs.first().map_or(0, Vec::len) as f64 * period;
        let own = decay.start - first;
        // a hair below: bursts that follow each other without a gap stay where they are
        let begins = if own < free_from - 1e-6 * period { free_from } else { own };
        starts.moved += usize::from(begins != own);
        free_from = begins + length;
        let t_ns = start_ns as f64 + begins * unit_s * 1e9;
        if !(0.0..LATEST_NS).contains(&t_ns) {
            return None;
        }
        starts.at.push(start_ns + (begins * unit_s * 1e9).round() as i64);
    }
    Some(starts)
}

fn as_burst(decay: &Regular, printhead: &Arc<str>, t_acq_ns: i64, sample_period_s: f64) -> Burst {
    let samples: Vec<u8> =
        decay.outputs.iter().flatten().flat_map(|y| (*y as f32).to_le_bytes()).collect();
    Burst {
        t_acq_ns,
        printhead: printhead.clone(),
        first_channel: 0,
        channels: decay.outputs.len() as u32,
        samples_per_channel: decay.outputs.first().map_or(0, Vec::len) as u32,
        sample_period_s,
        format: Format::F32Le,
        layout: Layout::ChannelMajor,
        samples: samples.into(),
        temperature_c: None,
        drive_voltage_v: None,
        idle_time_s: Vec::new(),
        neighbours_fired: Bytes::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bursts_stand_where_the_table_has_them_or_follow_each_other() {
        let decay = |start| Regular { name: String::new(), start, outputs: vec![vec![0.0; 10]] };
        let starts =
            starts_ns(&[decay(7.0), decay(100.0), decay(110.0)], 1.0, 1e-3, 5_000).unwrap();
        assert_eq!((starts.at, starts.moved), (vec![5_000, 93_005_000, 103_005_000], 0));
        let starts = starts_ns(&[decay(0.0), decay(0.0), decay(3.0)], 1.0, 1.0, 0).unwrap();
        assert_eq!((starts.at, starts.moved), (vec![0, 10_000_000_000, 20_000_000_000], 2));
        assert!(starts_ns(&[decay(0.0), decay(1e12)], 1.0, 1.0, 0).is_none());
    }

    #[test]
    fn units_are_read_off_the_column_name() {
        assert_eq!(["time", "time_s", "t_ms", "t_us"].map(unit_s), [1.0, 1.0, 1e-3, 1e-6]);
    }
}
