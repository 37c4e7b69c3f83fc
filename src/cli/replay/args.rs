//! The options of `inkling replay` ([`Args`]), as the command line gives them.

use crate::settings::Pace;
use clap::builder::PossibleValue;
use std::path::PathBuf;

/// The values of `--preset`.
pub const PRESETS: [&str; 1] = ["thesis"];

// The `///` of the fields below are the help text of the options, and no comments.
#[derive(Debug, Default, clap::Args)]
#[command(after_help = "Examples:
  inkling replay
      the recordings, the design and the output that ./pipeline.toml names
  inkling replay night.mcap --design design.json --out verdicts
      judged by the design's models as they are
  inkling replay 'logs/2026-*/*.mcap' --design design.json --identify windows
      each printhead identified again on its first healthy window of the
      recording
  inkling replay night.mcap --set identify.first=\"1 min\"
      without a design: detected, not named; any setting of pipeline.toml by
      --set

  inkling replay archive/ --design design.json --out verdicts --layout date \\
      --quiet
      every night: what is finished is skipped, journal.jsonl and run.json say
      what became of each
  inkling replay now.mcap --design design.json --follow
      while it is being written: faults as they are found
  inkling replay now.mcap --design design.json --follow --serve 127.0.0.1:8080
      and a page of it in a browser, /metrics for Prometheus, /faults.json

Where recordings are named, ./pipeline.toml is not read unless --config names it.")]
pub struct Args {
    /// Files, directories (searched for *.mcap) or glob patterns
    pub(super) recordings: Vec<String>,
    /// Where verdicts go [default: verdicts]
    #[arg(short, long, value_name = "DIR")]
    pub(super) out: Option<PathBuf>,
    /// Settings file
    #[arg(long, value_name = "FILE")]
    pub(super) config: Option<PathBuf>,
    /// Design, from `inkling train`
    #[arg(long, value_name = "FILE")]
    pub(super) design: Option<PathBuf>,
    /// Channels' own healthy baselines: read if the file is there, brought up to date at the end;
    /// recordings are then judged in the order of their start times
    #[arg(long, value_name = "FILE")]
    pub(in crate::cli) baseline: Option<PathBuf>,
    /// Judge by the design's models as they are, or identify again on healthy windows
    /// [default: design where --design is given, else windows]
    #[arg(long, value_parser = ["design", "windows"])]
    pub(super) identify: Option<String>,
    /// Any setting of pipeline.toml, repeatable
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub(super) set: Vec<String>,
    /// Choices that belong together; --set wins over them
    #[arg(long, value_parser = PRESETS)]
    pub(super) preset: Option<String>,
    /// As fast as possible (max), at the recorded speed (recorded), or so many signals per second [default: max]
    #[arg(long)]
    pub(super) pace: Option<Pace>,
    /// Workers per parallel stage [default: the machine's cores]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub(super) threads: Option<u16>,
    /// Where below --out: the tree below a directory is kept, by day of its begin, or each kind of table
    /// as one data set (verdicts/day=2026-11-01/)
    /// [default: tree]
    #[arg(long, value_parser = ["tree".into(), "date".into(), "hive".into(), PossibleValue::new("flat").hide(true)])]
    pub(super) layout: Option<String>,
    /// Judge again what is finished
    #[arg(long)]
    pub(super) force: bool,
    /// Take damage that an earlier run told of into the exit status again: otherwise it is told once
    #[arg(long)]
    pub(super) strict: bool,
    /// Say what would be done and why, and do nothing
    #[arg(long)]
    pub(super) dry_run: bool,
    /// Recognise finished recordings by their content, not by size and time of change
    #[arg(long)]
    pub(super) verify: bool,
    /// Write `<stem>.annotations.mcap` beside the verdicts: episodes as log lines, a moving picture of each
    /// printhead, faulty channels burst by burst; for Foxglove, Lichtblick and Rerun
    #[arg(long)]
    pub(super) annotate: bool,
    /// Watch one recording that is being written: tell of episodes as they are raised, until it is closed
    /// or Ctrl-C; then write what any replay of it would
    #[arg(long)]
    pub(super) follow: bool,
    /// With --follow: a page of what is known so far at http://ADDRESS/ (127.0.0.1:8080), /metrics for Prometheus and
    /// /faults.json; from another machine only with --serve-token
    #[arg(long, value_name = "ADDRESS")]
    pub(super) serve: Option<String>,
    /// A file with a password that whoever opens the page must give
    #[arg(long, value_name = "FILE")]
    pub(super) serve_token: Option<PathBuf>,
    /// One JSON line per recording and one for the run, instead of text
    #[arg(long)]
    pub(super) json: bool,
    /// Whether whoever calls this tells what all recordings come to.
    #[arg(skip)]
    pub(super) is_told_by_others: bool,
}

impl Args {
    /// What `inkling night` asks for: everything else the settings say.
    pub fn of_night(recordings: Vec<String>, config: PathBuf, set: Vec<String>) -> Args {
        let is_told_by_others = true;
        Args { recordings, config: Some(config), set, is_told_by_others, ..Args::default() }
    }
}
