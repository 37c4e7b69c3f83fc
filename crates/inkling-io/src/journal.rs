//! The journal of a directory of results (`journal.jsonl`, `schemas/journal.md`): one line of JSON
//! for every recording that was judged or failed, appended once the recording's result files have
//! their final names. By it a later run skips what is finished.
//!
//! In: lines of earlier runs, of which any may have been cut short by a power cut. Out: what the
//! last line says of each result file and recording; `src/pipeline/resume.rs` decides by them. New
//! lines are written by [`JournalWriter`].

use super::objects;
use super::regular_file::{self, if_there};
pub use super::stamp::Stamp;
use chrono::{DateTime, SecondsFormat, Utc};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::HashMap;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;

/// Name of the file in the directory of results.
pub const JOURNAL_NAME: &str = "journal.jsonl";
/// Version of a line. Of a line of another version nothing is known: its recording is judged again.
pub const VERSION: u32 = 2;
/// Most bytes of a line that is read as one; settings with a thousand priors take far less.
const MOST_LINE_BYTES: u64 = 4 << 20;

/// How a recording ended; the worst outcome comes first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    Failed,
    /// The run ended before it looked at the recording.
    NotReached,
    /// It was judged, but of a printhead nothing, or less than half of the signals, could be judged.
    NotJudged,
    /// It was judged, but some of it was damaged or rejected.
    Damaged,
    /// A warning: no model could be learned from a window of signals that should have been healthy.
    WindowRefused,
    #[default]
    Judged,
}

impl Outcome {
    pub fn is_judged(self) -> bool {
        self > Outcome::NotReached
    }
}

#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Source {
    /// Its path, absolute and without links.
    pub path: String,
    /// Size and time of change. `None`: it could not even be looked at.
    #[serde(flatten)]
    pub stamp: Option<Stamp>,
    /// `xxh3:` and 32 hexadecimal digits.
    pub digest: Option<String>,
    /// Day of its first burst, UTC; only if results are laid out by day.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub day: Option<String>,
    /// When it begins by what most of its bursts say, ns since 1970; only if recordings are judged in that order.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub starts_at_ns: Option<i64>,
    /// Whether most of its bursts cannot have been acquired when they say: `starts_at_ns` is of the records,
    /// and the state does not learn from it.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub misdated: bool,
}

/// What decides on verdicts besides the recording.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Means {
    pub schema: u32,
    /// Digest of the file of the design; `None`: none was given.
    pub design: Option<String>,
    /// Digest of the file of the labels; `None`: none was given.
    pub labels: Option<String>,
    /// The settings that have an effect on what is written.
    pub settings: Arc<Value>,
}

/// Digests of the file of baselines before and after a recording was judged; `None`: no file. Each
/// recording must begin with the digest that the one before ended with. Both are the same for a recording that
/// had no place in this order and taught nothing.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Link {
    pub before: Option<String>,
    pub after: Option<String>,
}

impl Link {
    pub fn taught(&self) -> bool {
        self.before != self.after
    }
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Results {
    /// The verdict table, below the directory of results, parts separated by `/`.
    pub verdicts: String,
    /// Sizes in bytes of verdicts, episodes and summary, in this order; empty: there are no files.
    pub bytes: Vec<u64>,
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct CountedMessage {
    /// The text of the first of its kind.
    pub what: String,
    pub times: u64,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Entry {
    pub version: u32,
    /// When the recording was done, RFC 3339.
    pub at: String,
    pub recording: Source,
    pub by: Means,
    /// Only with `--baseline`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub baseline: Option<Link>,
    pub outcome: Outcome,
    /// `None`: another recording's results lie at this one's place, or the place is unknown.
    pub results: Option<Results>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    /// Whether it failed for what is in it, so that it fails again until it is changed.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub by_content: bool,
    /// Counts of signals by outcome and so on, as in the recording's summary; null if it failed.
    pub counts: Value,
    /// Printheads of which nothing, or that less than half, could be judged: a sentence each.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub not_judged: Vec<String>,
    pub damage: Vec<CountedMessage>,
    /// What else the user was warned of.
    pub warnings: Vec<CountedMessage>,
    /// What the user was told although quiet was asked for: odd times, and what looks like bursts and was not read.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub always: Vec<CountedMessage>,
    /// What the user should know although nothing is wrong.
    pub notes: Vec<CountedMessage>,
    pub seconds: f64,
}

impl Entry {
    pub fn new(recording: Source, by: Means, outcome: Outcome) -> Entry {
        Entry { version: VERSION, at: now(), recording, by, outcome, ..Entry::default() }
    }
}

/// What earlier runs did in a directory: the last entry of each recording and of each result.
#[derive(Debug, Default)]
pub struct Journal {
    /// By the path of the verdict table below the directory.
    by_result: HashMap<String, Arc<Entry>>,
    by_path: HashMap<String, Arc<Entry>>,
    /// What the state of a design has learned from a recording, by its path, and the digest of that design. It has,
    /// whoever judged the recording since.
    links: HashMap<String, (Option<String>, Link)>,
    /// Settings by their text: entries share them, since a journal may have a million lines.
    settings: HashMap<String, Arc<Value>>,
}

impl Journal {
    /// Reads the journal of a directory; there need not be one yet.
    pub fn read(dir: &Path) -> io::Result<Journal> {
        let mut journal = Journal::default();
        let Some(file) = if_there(regular_file::open(&dir.join(JOURNAL_NAME)))? else {
            return Ok(journal);
        };
        let mut lines = BufReader::new(file);
        let mut line = Vec::new();
        loop {
            line.clear();
            let n = lines.by_ref().take(MOST_LINE_BYTES).read_until(b'\n', &mut line)?;
            if n == 0 {
                return Ok(journal);
            }
            // a line that was cut short, or is of another version, costs itself
            if let Ok(entry) = serde_json::from_slice::<Entry>(&line)
                && entry.version == VERSION
            {
                journal.add(entry);
            }
        }
    }

    fn add(&mut self, mut entry: Entry) {
        let text = entry.by.settings.to_string();
        entry.by.settings = self.settings.entry(text).or_insert(entry.by.settings).clone();
        if let Some(link) = &entry.baseline {
            let of = (entry.by.design.clone(), link.clone());
            self.links.insert(entry.recording.path.clone(), of);
        }
        let entry = Arc::new(entry);
        self.by_path.insert(entry.recording.path.clone(), entry.clone());
        if let Some(results) = &entry.results {
            self.by_result.insert(results.verdicts.clone(), entry);
        }
    }

    /// The last entry about a verdict table, by its path below the directory.
    pub fn of_result(&self, verdicts: &str) -> Option<&Arc<Entry>> {
        self.by_result.get(verdicts)
    }

    pub fn recordings(&self) -> impl Iterator<Item = &Entry> {
        self.by_path.values().map(Arc::as_ref)
    }

    /// The states of a design (its digest) before and after they learned from a recording; `None`: none did.
    pub fn link_of(&self, path: &str, design: &Option<String>) -> Option<&Link> {
        self.links.get(path).filter(|(by, _)| by == design).map(|(_, link)| link)
    }

    pub fn of_recording(&self, path: &str) -> Option<&Arc<Entry>> {
        self.by_path.get(path)
    }
}

/// A line is safely on disk, or in the store, when [`JournalWriter::append`] returns.
#[derive(Debug)]
pub struct JournalWriter {
    file: File,
    pub path: PathBuf,
    /// Whether the last line was cut short, so that the next entry must begin with a line break.
    torn: bool,
    /// Objects cannot be appended to, so a copy is kept, and sent anew as a whole with each line.
    is_copy: bool,
}

impl JournalWriter {
    pub fn open(dir: &Path) -> io::Result<JournalWriter> {
        let path = dir.join(JOURNAL_NAME);
        let is_copy = objects::in_object_store(&path);
        let mut file = match is_copy {
            false => File::options().read(true).append(true).create(true).open(&path)?,
            true => if_there(objects::fetch(&path))?.map_or_else(objects::temporary, Ok)?,
        };
        let torn = !ends_with_a_line(&mut file)?;
        super::part_file::sync_directory_of(&path)?;
        Ok(JournalWriter { file, path, torn, is_copy })
    }

    pub fn append(&mut self, entry: &Entry) -> io::Result<()> {
        let mut line = if self.torn { String::from("\n") } else { String::new() };
        line.push_str(&serde_json::to_string(entry)?);
        line.push('\n');
        self.torn = true; // in case that writing fails, perhaps in the middle
        if self.is_copy {
            self.file.seek(SeekFrom::End(0))?; // sending the file has moved its position
        }
        self.file.write_all(line.as_bytes())?;
        self.torn = false;
        match self.is_copy {
            true => objects::send(&self.file, &self.path),
            false => self.file.sync_data(),
        }
    }
}

fn ends_with_a_line(file: &mut File) -> io::Result<bool> {
    if file.seek(SeekFrom::End(0))? == 0 {
        return Ok(true);
    }
    let mut last = [0];
    file.seek(SeekFrom::End(-1))?;
    file.read_exact(&mut last)?;
    Ok(last == *b"\n")
}

pub fn now() -> String {
    DateTime::<Utc>::from(SystemTime::now()).to_rfc3339_opts(SecondsFormat::Secs, true)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn entry(path: &str, verdicts: Option<&str>) -> Entry {
        let stamp = Some(Stamp { bytes: 7, modified_ns: Some(1) });
        let recording = Source { path: path.into(), stamp, ..Source::default() };
        let settings = Arc::new(json!({"identify": {"first": 20.0}}));
        let by = Means { schema: 1, design: None, labels: None, settings };
        Entry {
            results: verdicts.map(|v| Results { verdicts: v.into(), bytes: vec![1, 2, 3] }),
            counts: json!({"signals": 3}),
            seconds: 0.25,
            ..Entry::new(recording, by, Outcome::Judged)
        }
    }

    #[test]
    fn the_last_line_of_a_result_counts_and_a_line_cut_short_costs_itself() {
        let dir = tempfile::tempdir().unwrap();
        assert!(Journal::read(dir.path()).unwrap().of_result("a").is_none());
        let mut writer = JournalWriter::open(dir.path()).unwrap();
        for (path, verdicts) in [("/1", Some("a")), ("/2", Some("b")), ("/3", Some("a"))] {
            writer.append(&entry(path, verdicts)).unwrap();
        }
        writer.append(&entry("/4", None)).unwrap();
        let unreleased = Entry { version: 1, ..entry("/1", Some("b")) };
        writer.append(&unreleased).unwrap();
        writer.file.write_all(b"{\"version\":1,\"at\":\"20").unwrap();
        drop(writer);
        JournalWriter::open(dir.path()).unwrap().append(&entry("/5", Some("e"))).unwrap();

        let journal = Journal::read(dir.path()).unwrap();
        assert_eq!(journal.of_result("a").unwrap().recording.path, "/3");
        assert_eq!(journal.of_result("b").unwrap().results.as_ref().unwrap().bytes, [1, 2, 3]);
        assert_eq!(journal.of_recording("/1").unwrap().results.as_ref().unwrap().verdicts, "a");
        assert!(journal.of_recording("/4").unwrap().results.is_none());
        assert!(journal.of_result("e").is_some());
        assert_eq!(journal.settings.len(), 1, "equal settings are held once");
    }
}
