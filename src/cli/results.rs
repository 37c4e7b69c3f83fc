//! Reads the results of earlier replays for a report: first summaries and episodes, then the counts of
//! verdicts. In: verdict tables, from `report_page`, or from `teller` for the account and the cleaning list.
//! Out: a [`ReadReport`]: the report, and what could not be read. `score` uses only [`find`].
//!
//! Verdicts do not fit into memory: batches of a few columns are read and counted one after another ([`count`]). Those
//! that were counted before are not read again (`counts_file`). The survey, which adds the counts up, needs all episodes
//! before them.

use super::copies::{self, Table};
use super::counts_file::Key;
use super::exit::Failure;
use super::lost;
use super::progress::Progress;
use crate::pipeline::Control;
use crate::report::{
    Clocks, LostRecording, Names, Note, RecordingCounts, Report, ReportSettings, Source, Survey,
    clock,
};
use inkling_io::file_error::FileError;
use inkling_io::inputs::Input;
use inkling_io::objects::in_object_store;
use inkling_io::verdict_reader::VerdictReader;
use inkling_io::verdict_table::TableError;
use inkling_io::{
    episode_table, inputs, printable, regular_file, result_file, stored, summary_file, when,
};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::atomic::Ordering;

/// The columns of a verdict table that a report needs; the second ones are what flagged signals say, which is
/// asked of channels with episodes alone.
const COLUMNS: [&str; 6] = ["acquired_at", "printhead", "channel", "outcome", "category", "reason"];
const COLUMNS_OF_FAULTS: [&str; 6] =
    ["candidate", "statistic", "threshold", "severity", "resonance_hz", "damping_per_s"];

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

/// The counts of all recordings, and the recordings that are left out since no clock which is set can have dated them:
/// all that is told is of the latest time.
struct Told {
    survey: Survey,
    /// When they begin, ns since 1970, by the recording's index.
    far_ahead_ns: BTreeMap<usize, i64>,
}

impl Told {
    fn absorb(&mut self, recording: usize, counts: RecordingCounts) {
        match counts.begin_ns().filter(|begin_ns| when::is_far_ahead(*begin_ns)) {
            Some(begin_ns) => {
                self.far_ahead_ns.insert(recording, begin_ns);
            }
            None => self.survey.absorb(recording, counts),
        }
    }
}

/// Reads the results of all tables into a report. A table that cannot be read is left out and noted
/// in `failed`; if no verdicts can be read at all, that is the failure. `keeps_counts`: whether counts are kept beside
/// the verdicts, for later runs.
pub fn read(
    inputs: &[Input],
    settings: &ReportSettings,
    keeps_counts: bool,
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
                let is_odd = |of: &Source| {
                    of.document["odd_times"].as_array().is_some_and(|all| !all.is_empty())
                };
                let known = acknowledged.knows_recording(label);
                let known = known.filter(|_| !source.is_whole() || is_odd(&source));
                source.known = known.map(str::to_owned);
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
        found.retain(|of| !when::is_far_ahead(of.began_at_ns));
        clocks.push(of_recording);
        episodes.push(found);
        sources.push(source);
        files.push(path);
    }

    // 4. the counts of each recording: those that are kept beside its verdicts, or else by reading these
    let mut told = Told { survey: Survey::new(&episodes), far_ahead_ns: BTreeMap::new() };
    let bytes: u64 = files.iter().map(|file| stored::bytes(file)).sum();
    let count_all = || -> Result<(), FileError> {
        let all = files.iter().zip(&episodes).zip(sources.iter().zip(&mut clocks));
        for (recording, ((file, episodes), (source, clocks))) in all.enumerate() {
            let key = Key::of(file, episodes, &source.document);
            let kept = key.as_ref().ok().and_then(|key| key.as_ref()?.read());
            let is_kept = kept.is_some();
            let mut counts = kept.unwrap_or_else(|| RecordingCounts::new(episodes));
            let read = if is_kept { Ok(()) } else { count(file, &mut counts, clocks, control) };
            if control.interrupted() {
                break;
            }
            match (read, key) {
                (Ok(()), Ok(Some(key))) if keeps_counts && !is_kept => key.keep(&counts)?,
                (Ok(()), Ok(_)) => {}
                (Err(e), _) => failed.push(format!(
                    "{e}; its rows from there on are not in the report. Remove that file, and the next replay judges \
                     its recording again"
                )),
                // looked into in vain, as when its verdicts cannot be read either
                (Ok(()), Err(e)) => failed.push(e.to_string()),
            }
            told.absorb(recording, counts);
            control.bytes_read.fetch_add(stored::bytes(file), Ordering::Relaxed);
        }
        Ok(())
    };
    progress.during("verdicts", bytes, control, count_all)?;
    if control.interrupted() {
        return Err(Failure::new("interrupted; nothing was written"));
    }

    // 5. the report; a report of nothing is a failure
    let Told { survey, far_ahead_ns } = told;
    let far_ahead = far_ahead_ns.iter().map(|(recording, begin_ns)| {
        let (Source { name, known, .. }, begin) = (&sources[*recording], clock(*begin_ns));
        let why = format!(
            "dated {begin} UTC by its bursts and its records: its clock was wrong, and what was found stands in its own tables"
        );
        LostRecording { known: known.is_some(), ..LostRecording::new(name, why) }
    });
    let far_ahead: Vec<LostRecording> = far_ahead.collect();
    if survey.heads.iter().all(|head| head.tallies.is_empty()) {
        let first = far_ahead.first().map(|of| format!("{}: {}", of.name, of.why));
        let first = failed.into_iter().next().or(first);
        return Err(Failure::new(first.unwrap_or_else(|| "the verdict tables are empty".into())));
    }
    let mut lost = lost::of(inputs, &failed, &acknowledged);
    lost.extend(far_ahead);
    let mut report = Report::new(&sources, survey, lost, &acknowledged, settings.clone());
    report.notes.extend(copies.into_iter().map(Note::of_all));
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
    let document = summary_file::of_table(&input.path).map_err(|e| e.to_string())?;
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

/// Adds the rows of a table to the counts of its recording, as far as they can be read. Where nobody had an episode, what
/// flagged signals say is not read.
fn count(
    file: &Path,
    counts: &mut RecordingCounts,
    clocks: &mut Clocks,
    control: &Control,
) -> Result<(), TableError> {
    let of_faults = COLUMNS_OF_FAULTS.iter().filter(|_| counts.has_episodes());
    let columns: Vec<&str> = COLUMNS.iter().chain(of_faults).copied().collect();
    let mut verdicts = VerdictReader::open_columns(file, Some(&columns))?;
    while let Some(rows) = verdicts.next().filter(|_| !control.interrupted()) {
        let mut rows = rows?;
        control.signals.fetch_add(rows.len() as u64, Ordering::Relaxed);
        clocks.put_rows_right(&mut rows);
        let (classes, categories) = (verdicts.classes(), verdicts.categories());
        counts.add(&rows, Names { classes, categories });
    }
    Ok(())
}
