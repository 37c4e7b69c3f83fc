//! `inkling simulate`: writes simulated recordings and their truth.
//!
//! In: a scenario file and a seed. Out: the scenario's recordings and `labels.csv`, which says what
//! is true of their channels; the same seed gives the same bytes. With `--hide` it writes one print run instead, in
//! which an effect is hidden that the model does not know, or none, and seals its truth (`hide`): critiques are tested
//! with it. The signals are made by `inkling_lab::simulate`; here they are written.

use super::exit::{Exit, Failure, unless_reader_gone};
use super::progress::{interruptible, steps, thousands};
use crate::pipeline::Control;
use inkling_io::file_error::FileError;
use inkling_io::outputs::ResultFile;
use inkling_io::recording_writer::{RecordingWriter, WriterOptions};
use inkling_io::{labels_file, outputs, printable, regular_file, truth_file};
use inkling_lab::simulate::scenario::Kind;
use inkling_lab::simulate::{Scenario, SimulatedRecording, hidden};
use std::io::Write;
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  inkling simulate sample_logs/scenarios/sample.toml -o run/
  inkling simulate sample_logs/scenarios/physics.toml -o run/ --seed 7

  inkling simulate sample_logs/scenarios/hidden.toml -o blind/ --hide 26

Writes the scenario's recordings and labels.csv, the truth of all of them.

With --hide, something (or nothing) drawn from SEED is put into the scenario's healthy print run: \
an effect that the model does not know. What it is stands in DIR/sealed/truth.json, for `inkling \
score critique.json --truth truth.json` afterwards; the salted SHA-256 of it, truth.sha256, lies \
beside the recording, so that the truth cannot change unseen. The recording is not compressed: its \
size says nothing.")]
pub struct Args {
    /// Scenario file
    scenario: PathBuf,
    /// Directory for the recordings and labels.csv
    #[arg(short, long, value_name = "DIR")]
    out: PathBuf,
    /// Instead of the scenario's seed; same seed, same bytes
    #[arg(long)]
    seed: Option<u64>,
    /// Hide something in the print run, drawn from SEED
    #[arg(long, value_name = "SEED", conflicts_with = "seed")]
    hide: Option<u64>,
}

/// Uncompressed size at which a chunk of a recording is closed.
const CHUNK_BYTES: u64 = 256 << 10;

/// Runs the verb.
pub fn run(args: Args) -> Result<Exit, Failure> {
    outputs::check_directory(&args.out)?;
    let text = regular_file::read_text(&args.scenario, regular_file::MOST_SETTINGS_BYTES)
        .map_err(FileError::unread(&args.scenario))?;
    let scenario = Scenario::from_toml(&text).map_err(|e| {
        Failure::usage(format!("{}: {}", args.scenario.display(), printable::of_parser(&e)))
    })?;
    if let Some(seed) = args.hide {
        return hide(&args, &scenario, seed);
    }

    let mut out = super::output::report();
    let seed = args.seed.or(scenario.seed).unwrap_or(1);
    let recordings = scenario.recordings(seed);

    // files that inkling did not write are not overwritten
    let names: Vec<String> = recordings.iter().map(|of| file_name(&of.stem)).collect();
    let files = names.iter().map(|name| (name.as_str(), ResultFile::Recording));
    outputs::check_files(&args.out, files.chain([("labels.csv", ResultFile::Companion)]))?;
    let control = interruptible();
    for recording in recordings {
        write(recording, &args.out, &control, &mut out)?;
    }
    let labels = args.out.join("labels.csv");
    labels_file::write(&labels, &scenario.labels(seed)).map_err(Failure::new)?;
    writeln!(out, "{}", labels.display())?;
    Ok(Exit::Done)
}

/// The name of a recording's file.
fn file_name(stem: &str) -> String {
    format!("{stem}.mcap")
}

/// Writes a recording into `dir`, burst by burst as they are simulated, and tells on `out` how many
/// bursts and signals it holds. The file gets its name when it is complete.
fn write(
    recording: SimulatedRecording,
    dir: &Path,
    control: &Control,
    out: &mut impl Write,
) -> Result<(), Failure> {
    let path = dir.join(file_name(&recording.stem));
    let compression = recording.options.compression;
    let options = WriterOptions { compression, chunk_bytes: Some(CHUNK_BYTES) };
    let mut writer = RecordingWriter::create(&path, options).map_err(Failure::new)?;
    let bursts = recording.bursts.len() as u64;
    let steps = steps(&recording.stem, Some(bursts), "bursts");
    let mut signals = 0;
    for burst in recording.bursts {
        if control.interrupted() {
            return Err(Failure::new("interrupted; the recording at hand was not written"));
        }
        signals += u64::from(burst.channels);
        writer.write(&burst, burst.t_acq_ns.max(0) as u64).map_err(Failure::new)?;
        steps.inc(1);
    }
    writer.finish().map_err(Failure::new)?;
    drop(steps);
    // if the reader of the output is gone, the files are still written
    let (path, [bursts, signals]) = (path.display(), [bursts, signals].map(thousands));
    unless_reader_gone(writeln!(out, "{path}: {bursts} bursts, {signals} signals"))
}

/// Writes a recording in which something is hidden, and its sealed truth: the directory `sealed`
/// with truth and labels, and beside the recording a salted digest of the truth, so that a later change of it
/// shows. `seed` decides what is hidden.
fn hide(args: &Args, scenario: &Scenario, seed: u64) -> Result<Exit, Failure> {
    let wrong = |what: &str| Failure::usage(format!("{}: {what}", args.scenario.display()));
    let Kind::Physics(physics) = &scenario.kind else {
        return Err(wrong("--hide needs a scenario of kind \"physics\""));
    };
    let hidden =
        hidden::recording(physics, &scenario.recording, seed).map_err(|e| wrong(&e.to_string()))?;

    // all places are checked before anything is written
    let mut out = super::output::report();
    let name = file_name(&hidden.recording.stem);
    let beside = ["truth.sha256", "sealed/truth.json", "sealed/labels.csv"];
    let beside = beside.map(|name| (name, ResultFile::Companion));
    let files = std::iter::once((&*name, ResultFile::Recording)).chain(beside);
    outputs::check_files(&args.out, files)?;

    // The recording comes first. Until it is whole, an earlier recording stays, with its own seal. If the run ends
    // right after it, the next run may write the other files: `check_files` takes companions for ours where a recording of
    // ours lies beside them. What is hidden is not lost then, as it follows from the seed.
    let sealed = args.out.join("sealed");
    let digest = args.out.join("truth.sha256");
    write(hidden.recording, &args.out, &interruptible(), &mut out)?;
    truth_file::write(&sealed.join("truth.json"), &digest, &hidden.truth).map_err(Failure::new)?;
    labels_file::write(&sealed.join("labels.csv"), &hidden.labels).map_err(Failure::new)?;
    writeln!(out, "{}", digest.display())?;
    Ok(Exit::Done)
}
