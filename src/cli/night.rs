//! `inkling night`: the nightly job in one command, by the verbs' own steps: `replay` with the state, the page of
//! `report`, and to stdout what changed since the last night.
//!
//! In: `pipeline.toml`. Out, beside what `replay` writes: `state.json` (unless the settings name another place),
//! `report.html` with its table, `account.json`, and `night.json`, which keeps what of which recordings was told. A night is compared
//! with the last one that was told to its end: where a run is killed, or nobody takes its output, the next one tells it.

use super::account::{MOST_RUN_BYTES, RUN_NAME, Row};
use super::changes_since::{ChangesSince, EarlierRun, ToldFault};
use super::exit::{Exit, Failure};
use super::metrics::{self, ByCategory, Found};
use super::output;
use super::progress::complain;
use super::report_page::{self, ACCOUNT_NAME, Page, write_json};
use super::results::{self, ReadReport};
use crate::cli::replay;
use crate::report::{self, Fault, Report};
use chrono::DateTime;
use inkling_io::file_error::FileError;
use inkling_io::inputs::Input;
use inkling_io::journal::{self, Outcome};
use inkling_io::outputs::{self, ResultFile};
use inkling_io::regular_file::{self, if_there};
use inkling_io::{part_file, printable};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::io::Write;
use std::path::{Path, PathBuf};

const SETTINGS_NAME: &str = "pipeline.toml";
const STATE_NAME: &str = "state.json";
pub const PAGE_NAME: &str = "report.html";
pub const NIGHT_NAME: &str = "night.json";
const EXIT_STATUS: &str = "inkling_exit_status";
/// Most bytes of a file of metrics that is read.
const MOST_METRICS_BYTES: u64 = 64 << 20;

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  inkling night
      the recordings, the design and the output that ./pipeline.toml names
  30 2 * * *  cd /srv/printer && inkling night
      as a line of cron, which mails what changed
  inkling night --quiet --metrics /var/lib/node_exporter/inkling.prom
      a mail only where the exit status is not 0, and metrics for Prometheus

Exit status: as `inkling replay`. Beside the results: report.html, account.json, state.json, night.json.")]
pub struct Args {
    /// Instead of those that the settings name: files, directories (searched for *.mcap) or glob patterns
    recordings: Vec<String>,
    /// Settings file [default: pipeline.toml]
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Metrics in Prometheus's text format, for the node exporter's textfile collector
    #[arg(long, value_name = "FILE")]
    metrics: Option<PathBuf>,
    /// Any setting of pipeline.toml, repeatable
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
}

/// What is kept from night to night. It has the keys by which `run.json` is known, too.
#[derive(Debug, Default, Serialize, Deserialize)]
#[serde(default)]
struct Kept {
    version: u32,
    /// The version of inkling that wrote it.
    inkling: String,
    totals: Value,
    /// When a night last ended with status 0 or 3, RFC 3339.
    succeeded_at: Option<String>,
    /// What became of each recording, as it was told last.
    recordings: Vec<Row>,
    /// The faults that were told.
    faults: Vec<ToldFault>,
}

/// How a run ended, as its account says.
#[derive(Deserialize)]
struct RunEnd {
    end: String,
    recordings: Vec<Row>,
}

/// Runs the verb. However it fails, the metrics say so.
pub fn run(args: Args) -> Result<Exit, Failure> {
    let metrics = args.metrics.clone();
    let ended = night(args);
    if let (Some(path), Err(failure)) = (metrics, &ended) {
        let told = failed_metrics(&path, failure.exit);
        told.unwrap_or_else(|e| complain(&format!("inkling: --metrics {}: {e}", path.display())));
    }
    ended
}

/// Puts the exit status of a failed night into the metrics that are there, or alone into new ones. What is no file of
/// metrics stays.
fn failed_metrics(path: &Path, status: Exit) -> std::io::Result<()> {
    let there = if_there(regular_file::read(path, MOST_METRICS_BYTES))?.unwrap_or_default();
    let there = String::from_utf8_lossy(&there);
    if !there.is_empty() && !there.starts_with(metrics::BEGIN) {
        return Ok(());
    }
    let kept = there.lines().filter(|line| !line.contains(EXIT_STATUS));
    let mut text: String = kept.map(|line| format!("{line}\n")).collect();
    text += &exit_status(status);
    part_file::write(path, text.as_bytes())
}

fn exit_status(status: Exit) -> String {
    let mut metrics = metrics::Metrics::default();
    let help = "Exit status of the last night.";
    metrics.one(EXIT_STATUS, "gauge", help, f64::from(status as u8));
    metrics.text
}

fn night(args: Args) -> Result<Exit, Failure> {
    // 1. all that may be wrong is looked at first; `replay` looks at the rest
    let here = Path::new(SETTINGS_NAME);
    if args.config.is_none() && !here.is_file() {
        return Err(Failure::usage(format!(
            "{SETTINGS_NAME}: there is none here: run where it is, or name another by --config"
        )));
    }
    let config = args.config.unwrap_or_else(|| here.into());
    let mut of_replay = replay::Args::of_night(args.recordings, config, args.set);
    let settings = replay::settings_of(&of_replay)?;
    let out = PathBuf::from(&settings.output.dir);
    if settings.input.baseline.is_empty() {
        of_replay.baseline = Some(out.join(STATE_NAME));
    }
    let (page, kept_at) = (out.join(PAGE_NAME), out.join(NIGHT_NAME));
    let page = Page::at(&page)?;
    let account_at = out.join(ACCOUNT_NAME);
    outputs::check_file(&kept_at, ResultFile::Run)?;
    outputs::check_file(&account_at, ResultFile::Account)?;
    args.metrics.as_deref().map_or(Ok(()), check_metrics)?;

    // 2. the recordings; of them only what makes the status another one than 0 is told here
    let (is_quiet, before) = (output::is_quiet(), account(&out)?);
    output::be_quiet();
    let ended = replay::run(of_replay);
    let account = account(&out)?;
    let run: Option<RunEnd> = account.as_deref().and_then(|text| serde_json::from_slice(text).ok());
    let is_over = |run: &&RunEnd| ["finished", "broken"].contains(&run.end.as_str());
    let Some(run) = run.as_ref().filter(is_over).filter(|_| account != before) else {
        return ended; // it had no turn, or was stopped: there is nothing new to tell
    };

    // 3. the page, and what changed; where there are no verdicts at all, the run has failed, and says why
    let mut kept = Kept::read(&kept_at);
    let read = results::find(std::slice::from_ref(&settings.output.dir), "a report")
        .and_then(|found| Ok((report_page::read(&found, &settings, true)?, found)));
    let (read, mut ended) = match (read, ended) {
        (Ok(read), ended) => (Some(read), ended),
        (Err(_), Err(failure)) => (None, Err(failure)),
        (Err(failure), Ok(_)) => (None, Err(failure)),
    };
    if let Some((read, found)) = &read {
        page.write(&read.report)?;
        write_json(&account_at, &read.report.account())?;
        if !is_quiet {
            // what cannot be told is told by the next night; whoever watches metrics hears of it now
            match kept.tell(read, found, &kept_at) {
                Ok(()) => kept.take(run.recordings.clone(), &read.report),
                Err(failure) => ended = Err(failure),
            }
        }
    }
    let ended = match (ended, &read) {
        (Ok(Exit::Done), Some((read, _))) if !read.failed.is_empty() => Ok(Exit::Incomplete),
        (ended, _) => ended,
    };

    // 4. what the next night needs, and what is watched
    if matches!(ended, Ok(Exit::Done | Exit::Incomplete)) {
        kept.succeeded_at = Some(journal::now());
    }
    kept.write(&kept_at)?;
    if let Some(path) = &args.metrics {
        let status = ended.as_ref().map_or_else(|failure| failure.exit, |exit| *exit);
        let report = read.as_ref().map(|(read, _)| &read.report);
        let text = metrics(report, &kept, &run.recordings, status);
        part_file::write(path, text.as_bytes()).map_err(FileError::unwritten(path))?;
    }
    ended
}

/// The account of the last run, if there is one.
fn account(out: &Path) -> Result<Option<Vec<u8>>, Failure> {
    let path = out.join(RUN_NAME);
    Ok(if_there(regular_file::read(&path, MOST_RUN_BYTES)).map_err(FileError::unread(&path))?)
}

/// Metrics replace metrics, and nothing else.
fn check_metrics(path: &Path) -> Result<(), Failure> {
    let most = metrics::BEGIN.len() as u64;
    let start = if_there(regular_file::start(path, most)).map_err(FileError::unread(path))?;
    match start.unwrap_or_default() {
        start if start.is_empty() || start == metrics::BEGIN.as_bytes() => Ok(()),
        _ => Err(Failure::usage(format!(
            "--metrics {}: is there already, and holds no metrics of inkling: give another name",
            path.display()
        ))),
    }
}

impl Kept {
    /// What the nights before have kept; nothing if there is no such file, or it cannot be understood: then everything
    /// is told.
    fn read(path: &Path) -> Kept {
        let text = if_there(regular_file::read(path, MOST_RUN_BYTES)).ok().flatten();
        let kept = text.map(|text| serde_json::from_slice(&text));
        kept.transpose()
            .unwrap_or_else(|e| {
                let (path, e) = (path.display(), printable::of_parser(&e));
                complain(&format!("inkling: {path}: cannot be understood ({e}): all is told anew"));
                None
            })
            .unwrap_or_default()
    }

    /// Tells what changed since the night that was told last, or all where there was none.
    fn tell(&self, read: &ReadReport, found: &[Input], path: &Path) -> Result<(), Failure> {
        let mut out = std::io::stdout().lock();
        let earlier = EarlierRun::told(path, self.recordings.clone(), self.faults.clone(), found);
        match ChangesSince::of(&earlier, &read.report) {
            Ok(changes) => changes.print(&mut out)?,
            Err(_) => {
                writeln!(out, "no night was told before this one: all that is known")?;
                report::print(&read.report, printable::line, &mut out)?;
            }
        }
        Ok(out.flush()?)
    }

    /// Takes over what was told of the recordings of a run, and of the faults. A recording that had no turn stays
    /// as it was.
    fn take(&mut self, told: Vec<Row>, report: &Report) {
        self.faults = report.faults.iter().map(|fault| ToldFault::of(&fault.story)).collect();
        let told: Vec<Row> =
            told.into_iter().filter(|row| row.outcome != Outcome::NotReached).collect();
        let recordings: BTreeSet<&str> = told.iter().map(|row| row.recording.as_str()).collect();
        let tables: BTreeSet<&str> =
            told.iter().filter_map(|row| row.verdicts.as_deref()).collect();
        self.recordings.retain(|of| {
            let table = of.verdicts.as_deref();
            !recordings.contains(&*of.recording) && table.is_none_or(|of| !tables.contains(of))
        });
        self.recordings.extend(told);
    }

    fn write(&mut self, path: &Path) -> Result<(), Failure> {
        self.version = journal::VERSION;
        self.inkling = env!("CARGO_PKG_VERSION").into();
        write_json(path, self)
    }
}

/// The metrics of a night. `report`: `None` if there are no verdicts; `rows`: of the run's recordings.
fn metrics(report: Option<&Report>, kept: &Kept, rows: &[Row], status: Exit) -> String {
    let mut metrics = report.map(found).unwrap_or_default().metrics();
    let mut outcomes: BTreeMap<String, u64> = BTreeMap::new();
    let all = [
        Outcome::Failed,
        Outcome::NotReached,
        Outcome::NotJudged,
        Outcome::Damaged,
        Outcome::WindowRefused,
        Outcome::Judged,
    ];
    let word = |of: Outcome| serde_json::json!(of).as_str().unwrap_or_default().to_owned();
    outcomes.extend(all.map(|of| (word(of), 0)).into_iter().chain([("acknowledged".into(), 0)]));
    for row in rows {
        let outcome = if row.acknowledged { "acknowledged".into() } else { word(row.outcome) };
        *outcomes.entry(outcome).or_default() += 1;
    }
    let series = outcomes.iter().map(|(of, n)| (vec![("outcome", of.as_str())], *n as f64));
    let help = "Recordings of the last run by what became of them.";
    metrics.family("inkling_recordings", "gauge", help, series);
    let succeeded =
        kept.succeeded_at.as_deref().and_then(|at| DateTime::parse_from_rfc3339(at).ok());
    let succeeded = succeeded.map(|at| (Vec::new(), at.timestamp() as f64));
    let help = "When a night last ended with status 0 or 3.";
    metrics.family("inkling_last_success_seconds", "gauge", help, succeeded);
    metrics.text + &exit_status(status)
}

/// What a report has found.
fn found(report: &Report) -> Found<'_> {
    fn counted<'a>(faults: impl Iterator<Item = &'a Fault>, into: &mut ByCategory<'a>) {
        for Fault { story, .. } in faults {
            let category = metrics::category(story.category.as_deref());
            *into.entry((&*story.printhead, category)).or_default() += 1;
        }
    }
    let mut found = Found::default();
    for head in report.survey.heads_with_signals() {
        found.open.insert((&*head.name, ""), 0);
        for tally in head.tallies.values() {
            found.signals += tally.signals();
            for (reason, n) in &tally.reasons {
                *found.rejected.entry(reason.as_str()).or_default() += n;
            }
            found.newest_ns = found.newest_ns.max(tally.span.map(|(_, to_ns)| to_ns));
        }
    }
    counted(report.news(), &mut found.open);
    counted(report.open().filter(|fault| fault.story.known.is_some()), &mut found.known);
    found
}
