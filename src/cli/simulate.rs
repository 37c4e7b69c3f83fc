//! `inkling simulate`: recordings with known truth.

use super::exit::{Exit, Failure, unless_reader_gone};
use super::progress::{interruptible, thousands};
use crate::io::labels_file;
use crate::io::recording_writer::{self, RecordingWriter, WriterOptions};
use crate::simulate::Scenario;
use crate::simulate::scenario::{Compression, RecordingOptions};
use std::io::Write;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  inkling simulate sample_logs/scenarios/sample.toml -o run/
  inkling simulate sample_logs/scenarios/physics.toml -o run/ --seed 7

Writes the scenario's recordings and labels.csv, the truth of all of them.")]
pub struct Args {
    /// Scenario file
    scenario: PathBuf,
    /// Directory for the recordings and labels.csv
    #[arg(short, long, value_name = "DIR")]
    out: PathBuf,
    /// Instead of the scenario's seed; same seed, same bytes
    #[arg(long)]
    seed: Option<u64>,
}

pub fn run(args: Args) -> Result<Exit, Failure> {
    let text = std::fs::read_to_string(&args.scenario)
        .map_err(|e| Failure::usage(format!("{}: cannot be read: {e}", args.scenario.display())))?;
    let scenario = Scenario::from_toml(&text)
        .map_err(|e| Failure::usage(format!("{}: {e}", args.scenario.display())))?;
    let control = interruptible();
    let mut out = std::io::stdout().lock();
    let seed = args.seed.or(scenario.seed).unwrap_or(1);
    for recording in scenario.recordings(seed) {
        let path = args.out.join(format!("{}.mcap", recording.stem));
        let mut writer =
            RecordingWriter::create(&path, options(&recording.options)).map_err(Failure::new)?;
        let (mut bursts, mut signals) = (0, 0);
        for burst in recording.bursts {
            if control.interrupted() {
                return Err(Failure::new("interrupted; the recording at hand was not written"));
            }
            bursts += 1;
            signals += u64::from(burst.channels);
            writer.write(&burst, burst.t_acq_ns.max(0) as u64).map_err(Failure::new)?;
        }
        writer.finish().map_err(Failure::new)?;
        // whoever stopped reading still wants the files
        unless_reader_gone(writeln!(
            out,
            "{}: {} bursts, {} signals",
            path.display(),
            thousands(bursts),
            thousands(signals)
        ))?;
    }
    let labels = args.out.join("labels.csv");
    labels_file::write(&labels, &scenario.labels(seed)).map_err(Failure::new)?;
    writeln!(out, "{}", labels.display())?;
    Ok(Exit::Done)
}

fn options(of: &RecordingOptions) -> WriterOptions {
    let compression = match of.compression {
        Compression::None => recording_writer::Compression::None,
        Compression::Lz4 => recording_writer::Compression::Lz4,
        Compression::Zstd => recording_writer::Compression::Zstd,
    };
    WriterOptions { compression, chunk_bytes: Some(of.chunk_bytes) }
}
