//! Reads the results of earlier replays for a report: first summaries and episodes, then all
//! verdicts once. In: verdict tables, from `report_page`, or from `batch` for its cleaning list.
//! Out: a [`ReadReport`]: the report, and what could not be read. `score` uses only [`find`].
//!
//! Verdicts of a year do not fit into memory, so one thread reads batches of a few columns ahead,
//! and another one adds them up (`Survey`). The survey needs all episodes before the first verdict.

use super::copies::{self, Table};
use super::exit::Failure;
use super::lost;
use super::progress::Progress;
use crate::pipeline::Control;
use crate::report::{Clocks, Names, Report, ReportSettings, Source, Survey};
use inkling_core::verdict::VerdictColumns;
use inkling_io::inputs::Input;
use inkling_io::objects::in_object_store;
use inkling_io::verdict_reader::VerdictReader;
use inkling_io::verdict_table::TableError;
use inkling_io::{
    episode_table, inputs, printable, regular_file, result_file, stored, summary_file,
};
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{SyncSender, sync_channel};

/// The columns of a verdict table that a report needs.
const COLUMNS: [&str; 10] = [
    "acquired_at",
    "printhead",
    "channel",
    "outcome",
    "category",
    "candidate",
    "statistic",
    "threshold",
    "severity",
    "reason",
];
/// Number of batches that are read ahead, of some MB each.
const READ_AHEAD: usize = 16;

/// Finds the verdict tables that a command line names: files, directories or patterns. `what`: what
/// is made of the tables (`a report`), for messages. A usage failure if a name is that of another
/// kind of file.
pub fn find(named: &[String], what: &str) -> Result<Vec<Input>, Failure> {
    // what was found is looked into, as a file may have any name
    let found = inputs::find_verdicts(named)?;
    if let Some(Input { path, .. }) = found.iter().find(|input| !may_hold_verdicts(&input.path)) {
        let name = printable::cell(&path.to_string_lossy());
        let instead = result_file::instead(path);
        return Err(Failure::usage(format!(
            "{name}: no table of verdicts{instead}; {what} reads *.verdicts.parquet of `inkling replay`, or their \
             directory"
        )));
    }
    Ok(found)
}

/// Whether a file may be a table of verdicts, by its name or else by how it begins. Damage is told when the
/// file is read.
fn may_hold_verdicts(path: &Path) -> bool {
    let name = path.to_string_lossy();
    let is_named = |endings: &[&str]| endings.iter().any(|ending| name.ends_with(ending));
    match () {
        () if is_named(&[".mcap", ".episodes.parquet", ".faults.parquet"]) => false,
        () if is_named(&[".parquet"]) || in_object_store(path) => true,
        () => regular_file::start(path, 4).is_ok_and(|start| start == b"PAR1"),
    }
}

/// A report, and messages about results that could not be read.
pub struct ReadReport {
    pub report: Report,
    /// Messages about results that could not be read, and are missing in the report.
    pub failed: Vec<String>,
    /// Messages about files without which nothing is lost.
    pub notes: Vec<String>,
    /// Names of the classes by which the recordings were judged.
    pub classes: BTreeSet<String>,
}

/// Some rows of a recording, with the names to which the indices in their columns refer.
struct VerdictBatch {
    /// Index of the recording.
    recording: usize,
    columns: VerdictColumns,
    classes: Vec<String>,
    categories: Vec<String>,
}

/// Reads the results of all tables into a report. A table that cannot be read is left out and noted
/// in `failed`; if no verdicts can be read at all, that is the failure. `with_maps`: whether the
/// report is to have maps of channels over time, which only the page shows.
pub fn read(
    inputs: &[Input],
    settings: &ReportSettings,
    with_maps: bool,
    progress: &Progress,
    control: &Control,
) -> Result<ReadReport, Failure> {
    // 1. the document of each recording: its summary, or what its table says of itself
    let (mut failed, mut notes) = (Vec::new(), Vec::new());
    let (mut found, acknowledged) = (Vec::new(), lost::acknowledged(inputs));
    for input in inputs {
        match source(input, &mut notes) {
            Ok(mut source) => {
                let label = source.document["recording"]["name"].as_str().unwrap_or(&source.name);
                source.known = acknowledged.knows_recording(label).map(str::to_owned);
                found.push((input.path.as_path(), source));
            }
            Err(e) => failed.push(e),
        }
    }

    // 2. of several tables of one recording one stays, and the others are noted
    let tables: Vec<Table> =
        found.iter().map(|(path, source)| Table { path, document: &source.document }).collect();
    let (left_out, mut copies) = (copies::left_out(&tables), Vec::new());

    // 3. the episodes of those that stay; a recording has the same index in all lists
    let (mut sources, mut episodes, mut files) = (Vec::new(), Vec::new(), Vec::new());
    let (mut classes, mut clocks) = (BTreeSet::new(), Vec::new());
    for ((path, mut source), left_out) in found.into_iter().zip(left_out) {
        if let Some(note) = left_out {
            copies.push(note);
            continue;
        }
        let named = source.document["classes"].as_array().into_iter().flatten();
        classes.extend(named.filter_map(|class| Some(class.as_str()?.to_owned())));
        let of_recording = Clocks::of(&source.document);
        let mut found = episodes_of(path, &mut source, &mut failed);
        of_recording.put_right(&mut found);
        clocks.push(of_recording);
        episodes.push(found);
        sources.push(source);
        files.push(path);
    }

    // 4. all verdicts once; the survey needs all episodes before the first verdict
    let mut survey = Survey::new(episodes, with_maps);
    let bytes: u64 = files.iter().map(|file| stored::bytes(file)).sum();
    progress.during("verdicts", bytes, control, || {
        // one thread reads ahead, this one adds up
        let (send, receive) = sync_channel(READ_AHEAD);
        std::thread::scope(|scope| {
            let files = &files;
            scope.spawn(move || read_all(files, control, &send));
            for batch in receive.into_iter().take_while(|_| !control.interrupted()) {
                match batch {
                    Ok(VerdictBatch { recording, mut columns, classes, categories }) => {
                        clocks[recording].put_rows_right(&mut columns);
                        let names = Names { classes: &classes, categories: &categories };
                        survey.add(recording, &columns, names);
                    }
                    Err(e) => failed.push(e),
                }
            }
        });
    });
    if control.interrupted() {
        return Err(Failure::new("interrupted; nothing was written"));
    }

    // 5. the report; a report of nothing is a failure
    if survey.heads.iter().all(|head| head.tallies.is_empty()) {
        let first = failed.into_iter().next();
        return Err(Failure::new(first.unwrap_or_else(|| "the verdict tables are empty".into())));
    }
    let lost = lost::of(inputs, &failed, &acknowledged);
    let mut report = Report::new(&sources, survey, lost, &acknowledged, settings.clone());
    report.notes.append(&mut copies);
    Ok(ReadReport { report, failed, notes, classes })
}

/// The document of a recording: its summary, or else the metadata of its verdict table, which know
/// less. An unreadable summary is told in `notes`; the error is that of the table.
fn source(input: &Input, notes: &mut Vec<String>) -> Result<Source, String> {
    let name = lost::name(input);
    match summary_file::read(&summary_file::path_beside(&input.path)) {
        Ok(Some(document)) => return Ok(Source { name, document, ..Source::default() }),
        Ok(None) => {}
        Err(e) => notes.push(e),
    }
    let verdicts = VerdictReader::open_columns(&input.path, &[]).map_err(|e| e.to_string())?;
    let document = summary_file::of_metadata(verdicts.metadata_json());
    Ok(Source { name, document, missing: vec!["summary"], ..Source::default() })
}

/// The episodes of a recording. If their table cannot be read, `source` and `failed` say so.
fn episodes_of(
    verdicts: &Path,
    source: &mut Source,
    failed: &mut Vec<String>,
) -> Vec<inkling_core::episodes::Episode> {
    let path = episode_table::path_beside(verdicts);
    let read = episode_table::read(&path);
    read.unwrap_or_else(|e| {
        source.missing.push("episodes");
        let path = path.display();
        failed.push(match e {
            TableError::Io { source, .. } if source.kind() == std::io::ErrorKind::NotFound => {
                format!("{path}: is missing: its faults are not in the report; replay again")
            }
            e => e.to_string(),
        });
        Vec::new()
    })
}

/// Reads the batches of all files in their order, and sends them ahead of their use. A file that
/// cannot be read to its end is told as an error, and the next one is read. Progress counts whole
/// files.
fn read_all(files: &[&Path], control: &Control, send: &SyncSender<Result<VerdictBatch, String>>) {
    for (recording, file) in files.iter().enumerate() {
        if let Err(e) = read_one(recording, file, control, send) {
            let failed = format!("{e}; its rows from there on are not in the report");
            if send.send(Err(failed)).is_err() {
                return;
            }
        }
        control.bytes_read.fetch_add(stored::bytes(file), Ordering::Relaxed);
        if control.interrupted() {
            return;
        }
    }
}

/// Sends the batches of one file.
fn read_one(
    recording: usize,
    file: &Path,
    control: &Control,
    send: &SyncSender<Result<VerdictBatch, String>>,
) -> Result<(), TableError> {
    let mut verdicts = VerdictReader::open_columns(file, &COLUMNS)?;
    while let Some(columns) = verdicts.next() {
        let columns = columns?;
        control.signals.fetch_add(columns.len() as u64, Ordering::Relaxed);
        let (classes, categories) = (verdicts.classes().to_vec(), verdicts.categories().to_vec());
        let sent = send.send(Ok(VerdictBatch { recording, columns, classes, categories }));
        if sent.is_err() || control.interrupted() {
            return Ok(()); // nobody looks any more
        }
    }
    Ok(())
}
