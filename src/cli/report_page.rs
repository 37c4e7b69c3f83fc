//! `inkling report`: which channels to clean, since when they are faulty, and how far to trust
//! this. In: the results of any number of recordings. Out: the page, text or JSON, and beside the
//! page `report.html` the Parquet file `report.faults.parquet` (`schemas/faults.md`), with a row
//! for each fault, the most urgent first.
//!
//! The results are read by `results`, and the faults found and worded by `crate::report`; here the
//! options are checked and the files written. With `--changes-since` the text or JSON is about what
//! is new (`changes_since`).

use super::changes_since::{ChangesSince, EarlierRun, head_as_json};
use super::exit::{Exit, Failure};
use super::output;
use super::progress::{Progress, complain, first_few, interruptible};
use super::results::{self, ReadReport};
use crate::report::{self, Fault, Report, rfc3339};
use crate::settings::Settings;
use inkling_core::verdict::Reason;
use inkling_io::column_types::TimestampUnit;
use inkling_io::file_error::FileError;
use inkling_io::inputs::Input;
use inkling_io::journal::JOURNAL_NAME;
use inkling_io::outputs::{self, ResultFile};
use inkling_io::row_table::{self, Column, Kind};
use inkling_io::verdict_table::TableError;
use inkling_io::{part_file, printable, stored};
use serde::Serialize;
use serde_json::{Value, json};
use std::io::ErrorKind::{PermissionDenied, ReadOnlyFilesystem};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// What is told of all recordings of a directory of results, in it.
pub const ACCOUNT_NAME: &str = "account.json";
/// Most failures that are told one by one.
const MOST_TOLD: usize = 10;

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  inkling report verdicts/ -o report.html
      all recordings below verdicts/, one night or a year; beside it
      report.faults.parquet
  inkling report verdicts/2026-03-* -o march.html --config pipeline.toml
      with [report.actions] as pipeline.toml has them
  inkling report verdicts/ --changes-since last.json
      one mail's worth: what is new, worse, cured, not judged since the run
      whose run.json was kept as last.json
  inkling report verdicts/ -o report.html \\
      --set report.actions.dried_nozzle=\"spit 2000 drops\"

Reads what `inkling replay` wrote: verdicts, episodes, summaries. The page loads and runs nothing. \
In it ± is one standard deviation; “change” is per day, with its 95 % interval.")]
pub struct Args {
    /// Directories of results, verdict files, or patterns
    #[arg(required = true)]
    out: Vec<String>,
    /// The page; its table of faults goes beside it
    #[arg(short, long, value_name = "FILE", required_unless_present_any = ["changes_since", "json"])]
    output: Option<PathBuf>,
    /// Tell what is new, worse, cured and not judged in the recordings that an earlier run did not have, instead of
    /// what is to be cleaned: its run.json, or the directory where that lies
    #[arg(long, value_name = "RUN")]
    changes_since: Option<PathBuf>,
    /// What is told as JSON
    #[arg(long)]
    json: bool,
    /// Settings file, for its section [report]
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// A setting of [report], repeatable
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
}

/// Runs the verb. The exit status is 3 if some results could not be read.
pub fn run(args: Args) -> Result<Exit, Failure> {
    // 1. settings and places
    if let Some(other) = args.set.iter().find(|pair| !pair.trim_start().starts_with("report.")) {
        let what = "has no effect on a report: its settings begin with report.";
        return Err(Failure::usage(format!("--set {}: {what}", printable::cell(other))));
    }
    let settings = Settings::load(args.config.as_deref(), None, &args.set)?;
    let page = args.output.as_deref().map(Page::at).transpose()?;
    let account = account_of(&args.out)?;

    // 2. read; names and files are checked before the verdicts are read, which may take long
    let found = results::find(&args.out, "a report")?;
    let earlier =
        args.changes_since.as_deref().map(|run| EarlierRun::read(run, &found)).transpose()?;
    let read = read(&found, &settings, false)?;
    let since = earlier.as_ref().map(|earlier| ChangesSince::of(earlier, &read.report));
    let since = since.transpose()?;
    // 3. files first, then stdout
    page.iter().try_for_each(|page| page.write(&read.report))?;
    if let Some(account) = &account {
        // what a killed run left of it
        part_file::sweep(Path::new(&args.out[0]), |name| name == ACCOUNT_NAME);
        let text = json_text(&read.report.account())?;
        match part_file::write(account, text.as_bytes()) {
            // who may only read the results has the page all the same
            Err(e) if [PermissionDenied, ReadOnlyFilesystem].contains(&e.kind()) => {
                complain(&format!("warning: {}: {e}", account.display()));
            }
            written => written.map_err(FileError::unwritten(account))?,
        }
    }
    match args.json {
        true => tell_json(&read, since.as_ref(), page.as_ref())?,
        false => tell(&read, since.as_ref(), page.as_ref())?,
    }
    Ok(if read.failed.is_empty() { Exit::Done } else { Exit::Incomplete })
}

/// Where the account goes: into the directory of results, if that as a whole is what is reported on.
fn account_of(out: &[String]) -> Result<Option<PathBuf>, Failure> {
    let [out] = out else { return Ok(None) };
    let out = Path::new(out);
    if !stored::is_file(&out.join(JOURNAL_NAME)) {
        return Ok(None);
    }
    let account = out.join(ACCOUNT_NAME);
    outputs::check_file(&account, ResultFile::Account)?;
    Ok(Some(account))
}

/// Reads the results of these tables, and tells what could not be read. `keeps_counts`: as in [`results::read`].
pub fn read(
    found: &[Input],
    settings: &Settings,
    keeps_counts: bool,
) -> Result<ReadReport, Failure> {
    let progress = Progress::new(1, 0);
    let read = results::read(found, &settings.report, keeps_counts, &progress, &interruptible())?;

    // The actions can only be checked now that the classes of the recordings are known. There may be some for these,
    // and for classes that the settings declare.
    let own = read.classes.iter().chain(settings.isolate.classes.keys()).map(String::as_str);
    settings.report.check_actions(own).map_err(Failure::usage)?;
    for note in &read.notes {
        progress.say(&format!("warning: {note}"));
    }
    let failed = read.failed.iter().cloned();
    for failure in first_few(failed, MOST_TOLD, |more| format!("and {more} more")) {
        progress.fail(&format!("inkling: {failure}"));
    }
    Ok(read)
}

/// The files of the result: the page, and the table of faults beside it.
pub struct Page<'a> {
    page: &'a Path,
    table: PathBuf,
}

impl<'a> Page<'a> {
    /// Checks that both files may be written (that neither is something that inkling did not
    /// write), without writing them.
    pub fn at(page: &'a Path) -> Result<Page<'a>, Failure> {
        if !page.extension().is_some_and(|e| e == "html" || e == "htm") {
            let name = page.display();
            return Err(Failure::usage(format!("{name}: the result is a page: give a name.html")));
        }
        let table = page.with_extension("faults.parquet");
        outputs::check_file(page, ResultFile::Page)?;
        outputs::check_file(&table, ResultFile::Faults)?;
        Ok(Page { page, table })
    }

    /// Writes the table, then the page.
    pub fn write(&self, report: &Report) -> Result<(), Failure> {
        write_faults(&self.table, &report.faults).map_err(Failure::new)?;
        write_text(self.page, &report::html(report))
    }
}

/// Prints the result as one JSON document: the changes or all faults, the files, and what was not judged.
fn tell_json(
    read: &ReadReport,
    since: Option<&ChangesSince>,
    page: Option<&Page>,
) -> std::io::Result<()> {
    let faults = || read.report.faults.iter().map(as_json).collect::<Vec<_>>();
    let mut document = since.map_or_else(|| json!({ "faults": faults() }), ChangesSince::as_json);
    if let Some(Page { page, table }) = page {
        (document["page"], document["table"]) = (json!(page), json!(table));
    }
    let coverage = &read.report.coverage;
    document["coverage"] = json!(coverage);
    document["coverage"]["complete"] = json!(coverage.is_complete());
    document["head_changes"] = read.report.head_changes.iter().map(head_as_json).collect();
    document["notes"] = read.report.notes.iter().map(|note| json!(note.what)).collect();
    document["failed"] = json!(read.failed);
    output::event(&document)
}

/// Prints the result as text: the changes or the cleaning list, and the files. With `--quiet` it is
/// printed only where stdout is the result itself: changes without a page.
fn tell(
    read: &ReadReport,
    since: Option<&ChangesSince>,
    page: Option<&Page>,
) -> std::io::Result<()> {
    let mut out = output::result(since.is_none() || page.is_some());
    match since {
        None => report::print(&read.report, printable::line, &mut out)?,
        Some(since) => since.print(&mut out)?,
    }
    match page {
        Some(Page { page, table }) => writeln!(out, "{}, {}", page.display(), table.display()),
        None => Ok(()),
    }
}

/// Writes a text file, which gets its name once it is complete.
pub fn write_text(path: &Path, text: &str) -> Result<(), Failure> {
    part_file::write(path, text.as_bytes())
        .map_err(|e| Failure::new(format!("{}: {e}", path.display())))
}

/// Writes a document as JSON for people, which gets its name once it is complete.
pub fn write_json(path: &Path, document: &impl Serialize) -> Result<(), Failure> {
    write_text(path, &json_text(document)?)
}

fn json_text(document: &impl Serialize) -> Result<String, Failure> {
    Ok(serde_json::to_string_pretty(document).map_err(Failure::new)? + "\n")
}

/// Gives what a fault has in a column; null where it has nothing.
type Cell = fn(&Fault) -> Value;

/// The columns of the table of faults, in its order. `schemas/faults.md` explains them; a test
/// compares.
static COLUMNS: [(Column, Cell); 17] = [
    (Column::required("printhead", Kind::Name), |f| json!(f.story.printhead)),
    (Column::required("channel", Kind::Count), |f| json!(f.story.channel)),
    (Column::nullable("category", Kind::Name), |f| json!(f.story.category)),
    (Column::nullable("fault", Kind::Name), |f| json!(f.story.fault)),
    (Column::required("began_at", Kind::Time), |f| json!(f.story.began_at_ns)),
    (Column::nullable("ended_at", Kind::Time), |f| json!(f.story.ended_at_ns)),
    (Column::required("recordings", Kind::Count), |f| json!(f.story.recordings)),
    (Column::required("episodes", Kind::Count), |f| json!(f.story.spells.len())),
    (Column::nullable("severity_first", Kind::Number), |f| json!(f.story.severity_first)),
    (Column::nullable("severity_last", Kind::Number), |f| json!(f.story.severity_last)),
    (Column::nullable("severity_per_day", Kind::Number), |f| json!(per_day(f))),
    (Column::nullable("certainty", Kind::Number), |f| json!(f.story.certainty)),
    (Column::nullable("reason", Kind::Name), |f| json!(f.story.reason.map(Reason::as_str))),
    (Column::required("urgency", Kind::Number), |f| json!(f.urgency)),
    (Column::required("action", Kind::Name), |f| json!(f.action)),
    (Column::required("sentence", Kind::Text), |f| json!(f.sentence)),
    (Column::required("known_at", Kind::Time), |f| json!(f.story.known_at_ns)),
];

fn columns() -> [Column; 17] {
    COLUMNS.each_ref().map(|(column, _)| *column)
}

/// A fault as JSON, with the columns of the table of faults as keys; times are text here. `acknowledged`: the note of
/// whoever knows the fault; null: nobody does.
pub fn as_json(fault: &Fault) -> Value {
    let cell = |(column, of): &(Column, Cell)| {
        let time_ns = of(fault).as_i64().filter(|_| column.name.ends_with("_at"));
        (column.name.to_owned(), time_ns.map_or_else(|| of(fault), |ns| json!(rfc3339(ns))))
    };
    let mut all: Value = COLUMNS.iter().map(cell).collect();
    all["acknowledged"] = json!(fault.story.known);
    all
}

/// The trend of the severity, in its unit per day, if the trend is certain. Of a fault without a
/// severity the trend is that of its distance from healthy, which is no severity: `None`.
fn per_day(fault: &Fault) -> Option<f64> {
    let is_sized = fault.story.severity_last.is_some();
    report::certain_trend(&fault.story).filter(|_| is_sized).map(|trend| trend.per_day)
}

/// Writes the table of faults. The file gets its name once it is complete.
fn write_faults(path: &Path, faults: &[Fault]) -> Result<(), TableError> {
    let (columns, unit) = (columns(), TimestampUnit::Ns);
    let row = |fault| COLUMNS.iter().map(|(column, of)| (column.name, of(fault))).collect();
    let rows: Vec<Value> = faults.iter().map(row).collect();
    let schema = Arc::new(row_table::schema(&columns, unit));
    let batch =
        row_table::batch(&columns, schema, unit, &rows).map_err(TableError::columns(path))?;
    row_table::write(path, &batch)
}

#[cfg(test)]
#[path = "../../crates/inkling-io/src/documented.rs"]
mod documented;

#[cfg(test)]
mod tests {
    use super::documented::is_documented;
    use super::*;

    #[test]
    fn schema_is_the_documented_one() {
        let page = include_str!("../../schemas/faults.md");
        is_documented(page, &row_table::schema(&columns(), TimestampUnit::Ns));
    }
}
