//! `inkling thesis`: chapter 4 again.

use super::exit::{Exit, Failure};
use super::progress::Steps;
use crate::io::outputs::{self, ResultFile};
use crate::thesis;
use std::io::Write;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  inkling thesis -o chapter4/
  inkling thesis -o chapter4/ --seeds 20 --seed 1001

Writes tables.md, tables.json and, of the first seed, the figures (SVG, PNG, and their data as \
CSV).")]
pub struct Args {
    /// Directory for tables and figures
    #[arg(short, long, value_name = "DIR")]
    out: PathBuf,
    /// How many seeds
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    seeds: u64,
    /// The first of them
    #[arg(long, value_name = "SEED", default_value_t = 1)]
    seed: u64,
    /// Seeds at a time; 0: the machine's cores
    #[arg(long, value_name = "N", default_value_t = 0)]
    threads: usize,
}

pub fn run(args: Args) -> Result<Exit, Failure> {
    let files = [("tables.json", ResultFile::Chapter), ("tables.md", ResultFile::Companion)];
    outputs::check_files(&args.out, files).map_err(Failure::of_place)?;
    let again = args.out.join("tables.json").is_file();
    outputs::check_beside(&args.out, "fig_", again).map_err(Failure::of_place)?;
    let seeds: Vec<u64> = (0..args.seeds).map(|k| args.seed.wrapping_add(k)).collect();
    let threads = match args.threads {
        0 => crate::side_by_side::cores(),
        n => n.min(1024),
    };
    // Ctrl-C simply ends the run: nothing is written before the last seed is done
    let steps = Steps::new("thesis", Some(args.seeds), "seeds");
    let chapter = thesis::run(&seeds, threads, |_| steps.step()).map_err(Failure::new)?;
    drop(steps);
    thesis::write(&chapter, &args.out).map_err(Failure::new)?;
    let mut out = super::output::report();
    for (what, key) in [
        ("detection, n_o = 7.25 (thesis .979)", "FD n_o = 7.25/accuracy"),
        ("misses, n_o = f0 T", "FD n_o = f0 T/misses"),
        ("isolation by LR on r (thesis .801)", "LR on r, 2025/accuracy"),
        ("the same, phi >= .8 (thesis .879)", "LR on r, 2025/certain"),
        ("default: misses of 2025", "FD default/misses"),
        ("default: false alarms of 2475", "FD default/false alarms"),
        ("default: isolation, 2025 signals", "posterior, 2025/accuracy"),
        ("default: 1013", "posterior, 1013/accuracy"),
        ("default: 203", "posterior, 203/accuracy"),
        ("default: best 53.2 %", "posterior, 2025/best 53.2 %"),
        ("default: certainty >= .8", "posterior, 2025/certain"),
        ("default: share of them", "posterior, 2025/coverage"),
        ("default: ECE", "posterior, 2025/ECE"),
        ("default: ECE class-wise", "posterior, 2025/class-wise ECE"),
    ] {
        if let Some(v) = chapter.values.get(key) {
            writeln!(out, "{what:<38} {:.4} ± {:.4}", v.mean, v.sd)?;
        }
    }
    writeln!(out, "{}", args.out.join("tables.md").display())?;
    Ok(Exit::Done)
}
