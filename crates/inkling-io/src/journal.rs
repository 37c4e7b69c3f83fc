//! The journal of a directory of results (`schemas/journal.md`): one JSON line for every recording that
//! was judged or failed, appended when its files have their names.
//!
//! In: lines of any earlier run, the last perhaps cut short by a power cut. Out: what is known of each
//! result file ([`Journal::of_result`]) and each recording ([`Journal::of_recording`]).

pub use super::stamp::Stamp;
use super::{objects, regular_file};
use chrono::{DateTime, SecondsFormat, Utc};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::HashMap;
use std::fs::File;
use std::io::{self, BufRead, BufReader, ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;

pub const JOURNAL_NAME: &str = "journal.jsonl";
/// Of a line. Another version is read as far as it is alike.
pub const VERSION: u32 = 2;
/// Bytes of a line that is read: settings with a thousand priors are far less.
const MOST_LINE_BYTES: u64 = 4 << 20;

/// How a recording ended; the worst first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// No verdicts.
    Failed,
    /// The run ended before it was looked at.
    NotReached,
    /// Of a printhead nothing, or less than half of the signals, could be judged.
    NotJudged,
    /// Judged, but some of it was damaged or rejected.
    Damaged,
    /// Judged, but a healthy window taught nothing: a warning.
    WindowRefused,
    #[default]
    Judged,
}

impl Outcome {
    /// Verdicts were written.
    pub fn is_judged(self) -> bool {
        self > Outcome::NotReached
    }
}

#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Source {
    /// Absolute, without links.
    pub path: String,
    /// `None`: it could not even be looked at.
    #[serde(flatten)]
    pub stamp: Option<Stamp>,
    /// `xxh3:` and 32 hexadecimal digits.
    pub digest: Option<String>,
    /// Its first burst's, UTC; only where results are laid out by date.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub day: Option<String>,
    /// Its earliest burst, ns; only where recordings are judged in that order.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub starts_at_ns: Option<i64>,
}

/// What else decides on verdicts, besides the recording.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Means {
    /// Version of the tables.
    pub schema: u32,
    /// Digests of the files.
    pub design: Option<String>,
    pub labels: Option<String>,
    /// Those that have an effect on what is written.
    pub settings: Arc<Value>,
}

/// Digests of the channels' baselines before and after a recording; `None`: there were none yet.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Link {
    pub before: Option<String>,
    pub after: Option<String>,
}

/// Where the results are.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Results {
    /// The verdict table, below the directory of results, parts separated by `/`.
    pub verdicts: String,
    /// Bytes of verdicts, episodes, summary; empty: there are none.
    pub bytes: Vec<u64>,
}

/// A message about a recording, with the number of messages of its kind; messages of one kind differ in numbers alone.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct CountedMessage {
    /// The text of the first of its kind.
    pub what: String,
    pub times: u64,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Entry {
    pub version: u32,
    /// When it was done, RFC 3339.
    pub at: String,
    pub recording: Source,
    pub by: Means,
    /// Only with channels' own baselines.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub baseline: Option<Link>,
    pub outcome: Outcome,
    /// `None`: its place is taken, or unknown.
    pub results: Option<Results>,
    /// Why it failed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    /// As in its summary; null where it failed.
    pub counts: Value,
    /// Printheads of which nothing, or that less than half, could be judged: a sentence each.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub not_judged: Vec<String>,
    pub damage: Vec<CountedMessage>,
    pub warnings: Vec<CountedMessage>,
    /// What to know that is no fault of anything.
    #[serde(default)]
    pub notes: Vec<CountedMessage>,
    pub seconds: f64,
}

impl Entry {
    /// An entry that is made now, and that says of a recording only how it ended.
    pub fn new(recording: Source, by: Means, outcome: Outcome) -> Entry {
        Entry { version: VERSION, at: now(), recording, by, outcome, ..Entry::default() }
    }

    /// Verdicts were written.
    pub fn is_judged(&self) -> bool {
        self.outcome.is_judged()
    }
}

/// What earlier runs did here.
#[derive(Debug, Default)]
pub struct Journal {
    by_result: HashMap<String, Arc<Entry>>,
    by_path: HashMap<String, Arc<Entry>>,
    /// Lines that are none of ours, or not whole.
    pub unreadable: u64,
    settings: HashMap<String, Arc<Value>>,
}

impl Journal {
    /// There need not be one yet.
    pub fn read(dir: &Path) -> io::Result<Journal> {
        let mut journal = Journal::default();
        let file = match regular_file::open(&dir.join(JOURNAL_NAME)) {
            Err(e) if e.kind() == ErrorKind::NotFound => return Ok(journal),
            file => file?,
        };
        let mut lines = BufReader::new(file);
        let mut line = Vec::new();
        loop {
            line.clear();
            let n = lines.by_ref().take(MOST_LINE_BYTES).read_until(b'\n', &mut line)?;
            if n == 0 {
                return Ok(journal);
            }
            match serde_json::from_slice(&line) {
                Ok(entry) => journal.add(entry),
                Err(_) => journal.unreadable += u64::from(!line.trim_ascii().is_empty()),
            }
        }
    }

    fn add(&mut self, mut entry: Entry) {
        // most lines have the same settings
        let text = entry.by.settings.to_string();
        entry.by.settings = self.settings.entry(text).or_insert(entry.by.settings).clone();
        let entry = Arc::new(entry);
        self.by_path.insert(entry.recording.path.clone(), entry.clone());
        if let Some(results) = &entry.results {
            self.by_result.insert(results.verdicts.clone(), entry);
        }
    }

    /// The last that is said of a verdict table.
    pub fn of_result(&self, verdicts: &str) -> Option<&Arc<Entry>> {
        self.by_result.get(verdicts)
    }

    /// The last that is said of each recording, by its path.
    pub fn recordings(&self) -> impl Iterator<Item = &Entry> {
        self.by_path.values().map(Arc::as_ref)
    }

    /// The last that is said of a recording.
    pub fn of_recording(&self, path: &str) -> Option<&Arc<Entry>> {
        self.by_path.get(path)
    }
}

/// Appends to a journal; each line is on disk when it returns.
#[derive(Debug)]
pub struct JournalWriter {
    file: File,
    pub path: PathBuf,
    /// A line was cut short here.
    torn: bool,
    /// The file is a copy of an object, which takes no appending: it is sent anew, whole.
    is_copy: bool,
}

impl JournalWriter {
    pub fn open(dir: &Path) -> io::Result<JournalWriter> {
        let path = dir.join(JOURNAL_NAME);
        let is_copy = objects::in_object_store(&path);
        let mut file = match is_copy {
            false => File::options().read(true).append(true).create(true).open(&path)?,
            true => match objects::fetch(&path) {
                Err(e) if e.kind() == ErrorKind::NotFound => objects::temporary()?,
                file => file?,
            },
        };
        let torn = !ends_with_a_line(&mut file)?;
        super::part_file::sync_directory_of(&path)?;
        Ok(JournalWriter { file, path, torn, is_copy })
    }

    pub fn append(&mut self, entry: &Entry) -> io::Result<()> {
        let mut line = if self.torn { String::from("\n") } else { String::new() };
        line.push_str(&serde_json::to_string(entry)?);
        line.push('\n');
        self.torn = true; // if the next fails, perhaps in the middle
        if self.is_copy {
            self.file.seek(SeekFrom::End(0))?; // sending it read it
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

/// RFC 3339, to the second.
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
        writer.file.write_all(b"{\"version\":1,\"at\":\"20").unwrap();
        drop(writer);
        JournalWriter::open(dir.path()).unwrap().append(&entry("/5", Some("e"))).unwrap();

        let journal = Journal::read(dir.path()).unwrap();
        assert_eq!(journal.unreadable, 1);
        assert_eq!(journal.of_result("a").unwrap().recording.path, "/3");
        assert_eq!(journal.of_result("b").unwrap().results.as_ref().unwrap().bytes, [1, 2, 3]);
        assert_eq!(journal.of_recording("/1").unwrap().results.as_ref().unwrap().verdicts, "a");
        assert!(journal.of_recording("/4").unwrap().results.is_none());
        assert!(journal.of_result("e").is_some());
        assert_eq!(journal.settings.len(), 1, "equal settings are held once");
    }
}
