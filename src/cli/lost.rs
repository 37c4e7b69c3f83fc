//! Recordings that a report cannot cover, because they have no verdicts: recordings that failed
//! according to the journal or whose tables are gone, those that the last run did not reach (`run.json`) or has not reached
//! yet (the lock file), and those whose tables cannot be read. A report that was silent about them
//! would look complete.
//!
//! In: the verdict tables of a report, from `results`. From the place of each table the directory
//! that the user named follows, and from there upwards the directory of results, which has the
//! journal. Out: names and reasons ([`of`]). The same directories also give `changes_since` the
//! journals' entries ([`entries`]).

use super::account::{MOST_RUN_BYTES, RUN_NAME};
use super::acknowledge;
use crate::report::{Acknowledged, LostRecording};
use inkling_io::inputs::Input;
use inkling_io::journal::{Entry, JOURNAL_NAME, Journal, Outcome, Results};
use inkling_io::objects::in_object_store;
use inkling_io::regular_file::{self, if_there};
use inkling_io::run_lock::{self, ToJudge, Unfinished};
use inkling_io::stored;
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The lost recordings of the directories in which `tables` lie. `unread`: sentences about tables that could
/// not be read; `acknowledged`: what is no news.
pub fn of(tables: &[Input], unread: &[String], acknowledged: &Acknowledged) -> Vec<LostRecording> {
    // the directories that the user named, and the directories of results at or above them
    let named: BTreeSet<PathBuf> = tables.iter().filter_map(named).collect();
    let out: BTreeSet<PathBuf> = named.iter().filter_map(|dir| results_above(dir)).collect();

    // failed recordings count if their results would lie where the user looks
    let is_named = |place: &Path| named.iter().any(|dir| place.starts_with(dir));
    let failed = out.iter().flat_map(|out| failed(out, is_named));
    let mut lost: Vec<LostRecording> = failed
        .map(|(path, lost)| LostRecording {
            known: acknowledged.knows_recording(&path).is_some(),
            ..lost
        })
        .collect();

    // Where the others' results would lie is not known here, so they count only if the user named
    // the whole directory of results.
    let whole = || out.iter().filter(|out| is_named(out));
    lost.extend(whole().flat_map(|out| not_reached(out)));
    lost.extend(whole().flat_map(|out| under_way(out)));
    lost.sort_by(|a, b| a.name.cmp(&b.name));
    let unread = unread.iter().map(|words| {
        let (name, why) = words.split_once(": ").unwrap_or(("a table", words));
        LostRecording::new(name, why)
    });
    lost.extend(unread);
    lost
}

/// What is acknowledged in the directories that the user named, and in the directories of results.
pub fn acknowledged(tables: &[Input]) -> Acknowledged {
    let named: BTreeSet<PathBuf> = tables.iter().filter_map(named).collect();
    let out = named.iter().filter_map(|dir| results_above(dir)).collect::<BTreeSet<PathBuf>>();
    let mut all = Acknowledged::default();
    out.union(&named).for_each(|dir| all.absorb(acknowledge::read(dir)));
    all
}

/// The name of a recording in a report: the path of its table relative to what the user named, without the
/// ending.
pub fn name(table: &Input) -> String {
    let file = table.path.file_name().unwrap_or_default().to_string_lossy();
    let stem = file.strip_suffix(".verdicts.parquet").unwrap_or(&file);
    table.below.join(stem).to_string_lossy().into_owned()
}

/// The directory that the user named, in or below which a table was found. `below` is the path from
/// there to the table's directory, so as many levels are gone up as it has.
fn named(table: &Input) -> Option<PathBuf> {
    let levels = table.below.components().count();
    table.path.parent()?.ancestors().nth(levels).map(Path::to_path_buf)
}

/// The journals' entries for the tables of a report, by the report's names for them. Tables that no journal
/// knows have no entry.
pub fn entries(tables: &[Input]) -> BTreeMap<String, Arc<Entry>> {
    let mut journals: BTreeMap<PathBuf, Journal> = BTreeMap::new();
    let entry = |table: &Input| {
        let out = results_above(table.path.parent()?)?;
        let place = table.path.strip_prefix(&out).ok()?.to_string_lossy().into_owned();
        let journal =
            journals.entry(out).or_insert_with_key(|out| Journal::read(out).unwrap_or_default());
        Some((name(table), journal.of_result(&place)?.clone()))
    };
    tables.iter().filter_map(entry).collect()
}

/// The nearest directory at or above `dir` that has a journal.
fn results_above(dir: &Path) -> Option<PathBuf> {
    let has_journal = |dir: &&Path| stored::is_file(&dir.join(JOURNAL_NAME));
    dir.ancestors().take(MOST_LEVELS).find(has_journal).map(Path::to_path_buf)
}

/// Number of directories upwards in which a journal is looked for.
const MOST_LEVELS: usize = 8;

/// Recordings that the last run did not reach or did not find, and files that it did not read, as its account says.
fn not_reached(out: &Path) -> Vec<LostRecording> {
    let account = if_there(regular_file::read(&out.join(RUN_NAME), MOST_RUN_BYTES));
    let account = match account {
        Ok(account) => account.unwrap_or_default(),
        Err(e) => return vec![unread(RUN_NAME, &e)],
    };
    let account: Value = serde_json::from_slice(&account).unwrap_or_default();
    let rows = |key: &str| account[key].as_array().cloned().unwrap_or_default().into_iter();
    let not_read = rows("unread").filter_map(|row| {
        let text = |key: &str| row[key].as_str().map(str::to_owned);
        Some(LostRecording::new(text("recording")?, text("why")?))
    });
    // what was judged before and has not changed since still has its results
    let journal = Journal::read(out).unwrap_or_default();
    let judged = journal.recordings().filter(|of| of.outcome.is_judged());
    let mut by_name: BTreeMap<_, Vec<&Entry>> = BTreeMap::new();
    for of in judged {
        by_name.entry(Path::new(&of.recording.path).file_name()).or_default().push(of);
    }
    let has_results = |row: &Value| {
        let name = Path::new(row["recording"].as_str().unwrap_or_default());
        let mut of_name = by_name.get(&name.file_name()).into_iter().flatten();
        of_name.any(|of| {
            let path = Path::new(&of.recording.path);
            path.ends_with(name) && stored::stamp(path).ok() == of.recording.stamp
        })
    };
    // those that failed while they were judged are in the journal
    let was_met = |row: &Value| {
        let name = Path::new(row["recording"].as_str().unwrap_or_default());
        journal.recordings().any(|of| Path::new(&of.recording.path).ends_with(name))
    };
    let lost = rows("recordings").filter_map(|row| {
        let (name, why) = (row["recording"].as_str()?, row["why"].as_str());
        if row["outcome"] == json!(Outcome::NotReached) && !has_results(&row) {
            let why = format!("not reached: {}", why.unwrap_or("the run ended before it"));
            Some(LostRecording::new(name, why))
        } else if row["outcome"] == json!(Outcome::Failed) && !was_met(&row) {
            let why = why.unwrap_or("not found");
            Some(LostRecording::new(name, why.strip_prefix(&format!("{name}: ")).unwrap_or(why)))
        } else {
            None
        }
    });
    lost.chain(not_read).collect()
}

/// In the place of the recordings of which a file would have told.
fn unread(file: &str, e: &std::io::Error) -> LostRecording {
    LostRecording::new(file, format!("cannot be read ({e}): what else was lost is not known"))
}

/// Recordings that an unfinished run was to judge and has not judged yet.
fn under_way(out: &Path) -> Vec<LostRecording> {
    let Some(Unfinished { since, recordings }) = run_lock::unfinished(out) else {
        return Vec::new();
    };
    let journal = Journal::read(out).unwrap_or_default();
    // a recording is done if its last entry is not older than the run; both times are from one
    // clock and in one time zone, so that their texts sort like the times
    let is_done =
        |of: &ToJudge| journal.of_recording(&of.path).is_some_and(|entry| entry.at >= since);
    let left = recordings.into_iter().filter(|of| !is_done(of));
    let why = format!(
        "not judged yet by the run that began at {since}: it is still under way, or was killed, and then the same \
         `inkling replay` goes on where it stopped"
    );
    left.map(|of| LostRecording::new(of.recording, &*why)).collect()
}

/// Recordings that failed, or whose verdicts are gone, still exist, and would have their tables at a place that
/// `is_asked_for` accepts, with their paths.
fn failed(out: &Path, is_asked_for: impl Fn(&Path) -> bool) -> Vec<(String, LostRecording)> {
    let journal = match Journal::read(out) {
        Ok(journal) => journal,
        Err(e) => return vec![(String::new(), unread(JOURNAL_NAME, &e))],
    };
    let is_asked_for = |entry: &&Entry| {
        let place = entry.results.as_ref().map(|results| out.join(&results.verdicts));
        is_asked_for(place.as_deref().unwrap_or(out))
    };
    // a recording that was deleted from a directory that is still there is no longer missed; one that leads nowhere is
    let is_gone = |entry: &&Entry| {
        let path = Path::new(&entry.recording.path);
        path.parent().is_some_and(Path::is_dir) && path.symlink_metadata().is_err()
    };
    // a store is not asked for each table: there a question takes as long as a small file
    let is_gone_table = |of: &Results| {
        !of.bytes.is_empty() && !in_object_store(out) && !out.join(&of.verdicts).is_file()
    };
    let has_none = |entry: &&Entry| match entry.outcome {
        Outcome::Failed => true,
        judged => judged.is_judged() && entry.results.as_ref().is_some_and(is_gone_table),
    };
    let without = journal.recordings().filter(has_none);
    let lost = without.filter(is_asked_for).filter(|entry| !is_gone(entry)).map(|entry| {
        let path = &entry.recording.path;
        let name = Path::new(path).file_name().map_or(path.into(), |name| name.to_string_lossy());
        // errors begin with the path, which the line in the report has already
        let error = match entry.outcome {
            Outcome::Failed => entry.error.as_deref().unwrap_or("failed"),
            _ => "its verdicts are gone: `inkling replay` makes them again",
        };
        let why = error.split_once(&*name).and_then(|(_, rest)| rest.strip_prefix(": "));
        (path.clone(), LostRecording::new(name.clone(), why.unwrap_or(error)))
    });
    lost.collect()
}
