//! `inkling report`: what to clean, since when, and how far to trust it.

use super::exit::{Exit, Failure};
use super::progress::{Progress, interruptible};
use super::{output, results};
use crate::io::{fault_table, outputs, part_file, printable};
use crate::report::{self, Fault};
use crate::settings::Settings;
use chrono::DateTime;
use serde_json::json;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Complaints told one by one.
const MOST_TOLD: usize = 10;

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  inkling report verdicts/ -o report.html
      all recordings below verdicts/, one night or a year; beside it
      report.faults.parquet
  inkling report verdicts/2026-03-* -o march.html --config pipeline.toml
      with [report.actions] and the nozzles' places as pipeline.toml has them
  inkling report verdicts/ -o report.html \\
      --set report.actions.dried_nozzle=\"spit 2000 drops\"

Reads what `inkling replay` wrote: verdicts, episodes, summaries. The page loads and runs nothing. \
In it ± is one standard deviation; “change” is per day, with its 95 % interval.")]
pub struct Args {
    /// Directories of results, verdict files, or patterns
    #[arg(required = true)]
    out: Vec<String>,
    /// The page; its table of faults goes beside it
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// What is to be cleaned, most urgent first, as JSON
    #[arg(long)]
    json: bool,
    /// Settings file, for its section [report]
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// A setting of [report], repeatable
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
}

pub fn run(args: Args) -> Result<Exit, Failure> {
    if let Some(other) = args.set.iter().find(|pair| !pair.trim_start().starts_with("report.")) {
        return Err(Failure::usage(format!(
            "--set {}: has no effect on a report: its settings begin with report.",
            printable::cell(other)
        )));
    }
    let settings = Settings::load(args.config.as_deref(), None, &args.set)?;
    let declared = settings.isolate.classes.into_keys().collect::<Vec<_>>();
    let settings = settings.report;
    let is_page = args.output.extension().is_some_and(|e| e == "html" || e == "htm");
    if !is_page {
        let name = args.output.display();
        return Err(Failure::usage(format!("{name}: the result is a page: give a name.html")));
    }
    let table = args.output.with_extension("faults.parquet");
    for path in [&args.output, &table] {
        outputs::check_file(path).map_err(Failure::of_place)?;
    }
    let found = results::find(&args.out, "a report")?;
    let progress = Progress::new(1, 0);
    let read = results::read(&found, &settings, true, &progress, &interruptible())?;
    let own = read.classes.iter().chain(&declared).map(String::as_str);
    settings.check_actions(own).map_err(Failure::usage)?;
    for note in &read.notes {
        progress.say(&format!("warning: {note}"));
    }
    for failure in read.failed.iter().take(MOST_TOLD) {
        progress.fail(&format!("inkling: {failure}"));
    }
    if read.failed.len() > MOST_TOLD {
        progress.fail(&format!("inkling: and {} more", read.failed.len() - MOST_TOLD));
    }
    fault_table::write(&table, &read.report.faults).map_err(Failure::new)?;
    write_text(&args.output, &report::html(&read.report))?;
    if args.json {
        let faults: Vec<_> = read.report.faults.iter().map(as_json).collect();
        let mut coverage = json!(read.report.coverage);
        coverage["complete"] = json!(read.report.coverage.is_complete());
        let told = json!({
            "page": args.output,
            "table": table,
            "faults": faults,
            "failed": read.failed,
            "coverage": coverage,
            "notes": read.report.notes,
        });
        output::event(&told)?;
        return Ok(if read.failed.is_empty() { Exit::Done } else { Exit::Incomplete });
    }
    let mut out = output::report();
    report::print(&read.report, printable::line, &mut out)?;
    writeln!(out, "{}, {}", args.output.display(), table.display())?;
    Ok(if read.failed.is_empty() { Exit::Done } else { Exit::Incomplete })
}

/// A row of the cleaning list, as `report.faults.parquet` has it.
fn as_json(fault: &Fault) -> serde_json::Value {
    let story = &fault.story;
    let time = |ns: i64| DateTime::from_timestamp_nanos(ns).to_rfc3339();
    json!({
        "printhead": story.printhead.to_string(),
        "channel": story.channel,
        "category": story.category,
        "fault": story.fault,
        "began_at": time(story.began_at_ns),
        "ended_at": story.ended_at_ns.map(time),
        "severity_last": story.severity_last,
        "certainty": story.certainty,
        "urgency": fault.urgency,
        "action": fault.action,
        "sentence": fault.sentence,
    })
}

/// A page gets its name when it is whole.
pub fn write_text(path: &Path, text: &str) -> Result<(), Failure> {
    part_file::write(path, text.as_bytes())
        .map_err(|e| Failure::new(format!("{}: {e}", path.display())))
}
