//! `inkling thesis`: repeats chapter 4 of the thesis on simulated data or on labelled recordings.
//!
//! In: a number of seeds, or recordings and labels. Out: `tables.md`, `tables.json` and a picture in
//! the directory of `--out`, and the main figures as text. Everything is computed by
//! `inkling_lab::thesis`; recordings are divided into parts by channel, and each part is tested by
//! what was learned on the others.

use super::collected::{Collected, RecordingSource, collected};
use super::exit::{Exit, Failure};
use super::progress::steps;
use crate::settings::Settings;
use inkling_core::labels::{Label, known_states, nearest};
use inkling_io::labels_file::{self, LabelSource, States};
use inkling_io::outputs::{self, ResultFile};
use inkling_io::printable;
use inkling_lab::thesis::{self, Chapter, DataSet, Recorded};
use std::io::Write;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  inkling thesis -o chapter4/
  inkling thesis -o chapter4/ --seeds 20 --seed 1001
  inkling thesis logs/ --labels labels.csv -o chapter4/

Without recordings on simulated data: signals of the thesis's form, its drying experiment, and faults by \
its model (2-2). With recordings and labels on these, divided by channel: each is tested on once, by what \
was learned on others. Writes tables.md (ours beside the thesis's), tables.json and mean_residuals.svg.")]
pub struct Args {
    /// Files, directories (searched for *.mcap) or glob patterns; none: simulated data
    #[arg(requires = "labels")]
    recordings: Vec<String>,
    /// What is true of the recordings' channels
    #[arg(long, value_name = "CSV", requires = "recordings")]
    labels: Option<PathBuf>,
    /// Settings file: how the recordings are read
    #[arg(long, value_name = "FILE", requires = "recordings")]
    config: Option<PathBuf>,
    /// Directory for the tables
    #[arg(short, long, value_name = "DIR")]
    out: PathBuf,
    /// How many seeds [default: 5]
    #[arg(long, value_name = "N", conflicts_with = "recordings", value_parser = clap::value_parser!(u64).range(1..=10_000))]
    seeds: Option<u64>,
    /// The first of them [default: 1]
    #[arg(long, value_name = "SEED", conflicts_with = "recordings")]
    seed: Option<u64>,
}

/// Default number of seeds.
const SEEDS: u64 = 5;

/// Runs the verb: checks the places, computes the chapter, writes and tells it.
pub fn run(args: Args) -> Result<Exit, Failure> {
    let [tables, page, picture] = thesis::FILES;
    let companions = [page, picture].map(|name| (name, ResultFile::Companion));
    let files = std::iter::once((tables, ResultFile::Chapter)).chain(companions);
    outputs::check_files(&args.out, files)?;
    let threads = inkling_core::side_by_side::cores();
    let (chapter, recorded, exit) = match &args.labels {
        None => (simulated(&args, threads)?, None, Exit::Done),
        Some(labels) => {
            let (recorded, exit) = recorded(&args, labels)?;
            let steps = steps("thesis", Some(recorded.folds() as u64), "parts");
            let chapter = recorded.chapter(threads, || steps.inc(1)).map_err(Failure::new)?;
            (chapter, Some(recorded), exit)
        }
    };
    thesis::write(&chapter, recorded.as_ref(), &args.out).map_err(Failure::new)?;
    let mut out = super::output::report();
    chapter.sets.iter().try_for_each(|of| tell(of, &mut out))?;
    writeln!(out, "{}", args.out.join(page).display())?;
    Ok(exit)
}

/// The chapter on simulated data: all data sets for each seed.
fn simulated(args: &Args, threads: usize) -> Result<Chapter, Failure> {
    let (seeds, first) = (args.seeds.unwrap_or(SEEDS), args.seed.unwrap_or(1));
    let seeds: Vec<u64> = (0..seeds).map(|k| first.wrapping_add(k)).collect();
    let all = (seeds.len() * DataSet::SIMULATED.len()) as u64;
    let steps = steps("thesis", Some(all), "data sets");
    thesis::simulated(&seeds, threads, || steps.inc(1)).map_err(Failure::new)
}

/// The labelled signals of the recordings, and the exit status, which says whether something could not be
/// used.
fn recorded(args: &Args, labels: &std::path::Path) -> Result<(Recorded, Exit), Failure> {
    let settings = Settings::load(args.config.as_deref(), None, &[])?;
    let written = labels_file::read_states(LabelSource::File(labels), States::Any)?;
    let given = RecordingSource::Named(&args.recordings);
    let Collected { set, met, incomplete, .. } = collected(given, &settings, Some(&written))?;
    labels_file::check(labels, &written, &met)?;
    // classes need not be declared here, but a misspelt state must not become a class
    let unknown = |row: &&Label| !known_states().any(|known| known == row.state);
    for row in written.rows().iter().filter(unknown) {
        if let Some(near) = nearest(&row.state, known_states()).first() {
            let (path, state) = (labels.display(), printable::cell(&row.state));
            let what = format!("state \"{state}\": did you mean {near}?");
            return Err(Failure::usage(format!("{path}: {what}")));
        }
    }
    let recorded = Recorded::new(&set).map_err(Failure::new)?;
    Ok((recorded, if incomplete { Exit::Incomplete } else { Exit::Done }))
}

/// Prints the main figures of one data set.
fn tell(of: &thesis::Measured, out: &mut impl Write) -> std::io::Result<()> {
    writeln!(out, "{}", of.set.title())?;
    for (what, key) in [
        ("share right of detection, as the thesis", "I, 1.12 f0/right"),
        ("  by default", "default/right"),
        ("isolation by regression on r: class right", "LR on r, all/accuracy"),
        ("  where phi >= .8", "LR on r, all/certain"),
        ("  by default", "default, all/accuracy"),
        ("  by default where the certainty is >= .8", "default, all/certain"),
    ] {
        if let Some(spread) = of.spread(key) {
            write!(out, "  {what:<44} {:.4}", spread.mean)?;
            match of.values(key).len() {
                1 => writeln!(out)?,
                _ => writeln!(out, " ± {:.4}", spread.sd)?,
            }
        }
    }
    Ok(())
}
