//! Tells which kind of inkling's results a file is: by how it begins, by the keys of its JSON, or
//! by a table's footer.
//!
//! In: a file. Out: its [`ResultFile`], or `None` if inkling did not make it or it does not say so.
//! Two callers need this: `outputs.rs`, because a result may overwrite only an earlier result of
//! its own kind; and readers, which tell whoever names a wrong file what it is instead
//! ([`instead`]).
//!
//! Recognised are: Parquet by `PAR1` and the word `inkling` in its footer; MCAP by its magic and
//! the library `inkling` in its header; JSON by its top-level keys (`BY_KEYS`); HTML and manual
//! pages by a mark in the first 1024 bytes.

use super::mcap_records::{MAGIC, RECORD_HEADER};
use super::parquet_file::footer;
use super::regular_file;
use serde::de::IgnoredAny;
use std::collections::BTreeMap;
use std::fmt;
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Seek};
use std::path::Path;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ResultFile {
    Design,
    /// Models of `inkling identify`.
    Models,
    Baselines,
    Critique,
    /// Tables of `inkling thesis`.
    Chapter,
    /// What a run did: `run.json`.
    Run,
    /// What is told of all recordings: `account.json`.
    Account,
    Journal,
    Summary,
    /// An HTML page of `report`, of `critique`.
    Page,
    CritiquePage,
    Manual,
    Recording,
    Table,
    /// The table of faults over recordings, beside a report's page.
    Faults,
    /// A file that does not say who made it. The files beside it, which the same run wrote, say it.
    Companion,
}

/// Bytes at the beginning of a file that are searched for a mark.
const HEAD_BYTES: u64 = 1024;
/// Most bytes of a table's footer that is searched for marks.
const MOST_FOOTER_BYTES: u64 = 16 << 20;
/// Most bytes of the first line of a file of JSON that are tried as a document of their own.
const MOST_LINE_BYTES: u64 = 4 << 20;

/// Kinds of JSON, each with keys that tell it. The first kind whose keys are all there is taken, so
/// a kind with few keys stands after those that have the same keys and more.
const BY_KEYS: [(ResultFile, &[&str]); 9] = [
    (ResultFile::Design, &["version", "sample_period_s", "pooled"]),
    (ResultFile::Critique, &["version", "verdict", "causes"]),
    (ResultFile::Chapter, &["version", "rounds", "sets"]),
    (ResultFile::Run, &["version", "totals", "recordings"]),
    (ResultFile::Account, &["version", "statements", "recordings"]),
    (ResultFile::Journal, &["version", "recording", "outcome", "by"]),
    (ResultFile::Summary, &["version", "recording", "counts", "settings"]),
    (ResultFile::Baselines, &["version", "printheads"]),
    (ResultFile::Models, &["models"]),
];

/// What marks a page of `critique`; one of `report` has a title with dates.
const TITLE_OF_CRITIQUE: &str = "<title>Model critique<";

/// The key of inkling's metadata in a Parquet footer, as Thrift's compact protocol writes a pair of texts. A name or
/// value that happens to be the word has no value after it.
const OURS: &[u8] = b"\x18\x07inkling\x18";
/// The required column `urgency` in the schema there. Only tables of faults have it.
const URGENCY: &[u8] = b"\x25\x00\x18\x07urgency";

impl fmt::Display for ResultFile {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(self.words().0)
    }
}

impl ResultFile {
    /// The kind of a file. `None`: inkling did not make it, or it does not say so.
    pub fn of(path: &Path) -> std::io::Result<Option<ResultFile>> {
        let mut file = regular_file::open(path)?;
        let mut head = Vec::new();
        file.by_ref().take(HEAD_BYTES).read_to_end(&mut head)?;
        let says = |mark: &str| head.windows(mark.len()).any(|part| part == mark.as_bytes());
        let is = |is: bool, kind: ResultFile| is.then_some(kind);
        Ok(match head.as_slice() {
            [b'P', b'A', b'R', b'1', ..] => {
                let footer = footer(&file, MOST_FOOTER_BYTES)?;
                let has = |part: &[u8]| footer.windows(part.len()).any(|of| of == part);
                let kind = if has(URGENCY) { ResultFile::Faults } else { ResultFile::Table };
                is(has(OURS), kind)
            }
            [b'{', ..] => of_json(file)?,
            head if head.starts_with(MAGIC) => {
                is(library(head) == Some(b"inkling"), ResultFile::Recording)
            }
            _ if says("<meta name=\"generator\" content=\"inkling\">") => {
                let of_critique = says(TITLE_OF_CRITIQUE);
                Some(if of_critique { ResultFile::CritiquePage } else { ResultFile::Page })
            }
            _ if says(".TH inkling") => Some(ResultFile::Manual),
            _ => is(holds_line_of_journal(file)?, ResultFile::Journal),
        })
    }

    /// What people call a kind of file, and what it can be used for on a command line (empty if it
    /// has no such use).
    fn words(self) -> (&'static str, &'static str) {
        match self {
            ResultFile::Design => ("design", "--design takes it"),
            ResultFile::Models => ("file of identified models", ""),
            ResultFile::Baselines => ("file of baselines", "--baseline takes it"),
            ResultFile::Critique => ("critique", "`inkling score --truth` takes it"),
            ResultFile::Chapter => ("chapter of inkling thesis", ""),
            ResultFile::Run => ("account of a replay", "`inkling report --changes-since` takes it"),
            ResultFile::Account => ("account of all recordings", ""),
            ResultFile::Journal => ("journal of a replay", ""),
            ResultFile::Summary => ("summary of a recording's verdicts", ""),
            ResultFile::Page => ("page of `inkling report`", ""),
            ResultFile::CritiquePage => ("page of `inkling critique`", ""),
            ResultFile::Manual => ("manual page of inkling", ""),
            ResultFile::Recording => ("recording that inkling made", "`inkling replay` judges it"),
            ResultFile::Table => (
                "Parquet table that inkling made",
                "`inkling report` and `score` read tables of verdicts",
            ),
            ResultFile::Faults => ("table of faults that a report made", ""),
            ResultFile::Companion => {
                ("file of an earlier run, as far as what lies beside it tells", "")
            }
        }
    }
}

/// What somebody gave instead of what was asked for, to be put into an error, such as `, but a design:
/// --design takes it`. Empty if the file is of no known kind.
pub fn instead(path: &Path) -> String {
    let Ok(Some(kind)) = ResultFile::of(path) else { return String::new() };
    let (name, used) = kind.words();
    let used = if used.is_empty() { String::new() } else { format!(": {used}") };
    let is_account = matches!(kind, ResultFile::Run | ResultFile::Account);
    let article = if is_account { "an" } else { "a" };
    format!(", but {article} {name}{used}")
}

/// Like [`instead`], but if the file is of the kind that was `asked_for` (a word of that kind's
/// name), or of no known kind, the text says `what` is wrong with it.
pub fn instead_or(path: &Path, asked_for: &str, what: &str) -> String {
    match instead(path) {
        instead if instead.is_empty() || instead.contains(asked_for) => format!(": {what}"),
        instead => instead,
    }
}

/// The program that wrote a recording, as its header record says in its second text, behind the profile.
fn library(head: &[u8]) -> Option<&[u8]> {
    let text = |at: usize| {
        let (length, rest) = head.get(at..)?.split_first_chunk::<4>()?;
        rest.get(..u32::from_le_bytes(*length) as usize)
    };
    let profile_at = MAGIC.len() + RECORD_HEADER;
    text(profile_at + 4 + text(profile_at)?.len())
}

/// The kind of a file of JSON, which is one document or lines of documents. A journal whose only
/// line was cut short by a power cut is known by how it begins.
fn of_json(mut file: File) -> std::io::Result<Option<ResultFile>> {
    // 1. the first line by itself: all of a document on one line, or a line of a journal
    file.rewind()?;
    let (mut file, mut text) = (BufReader::new(file), Vec::new());
    file.by_ref().take(MOST_LINE_BYTES).read_until(b'\n', &mut text)?;
    if let Some(keys) = keys(&text) {
        return Ok(by_keys(keys)); // a journal may be long, and each of its lines says what it is
    }
    // 2. the whole file as one document; else its first line that is a document, unless the first
    //    line is a bracket alone, as in a document over several lines
    let is_line = text.len() > 2;
    file.read_to_end(&mut text)?;
    let lines = || text.split(|byte| *byte == b'\n').filter(|_| is_line).filter_map(keys).next();
    // 3. a single line that was cut short: a journal's, unless it goes on like that of baselines
    let is_of_state = text.windows(9).any(|part| part == b",\"design\"");
    let is_torn = text.starts_with(b"{\"version\":") && !text.contains(&b'\n') && !is_of_state;
    Ok(match keys(&text).or_else(lines) {
        Some(keys) => by_keys(keys),
        None => is_torn.then_some(ResultFile::Journal),
    })
}

/// The keys of a document of JSON.
type Keys = BTreeMap<String, IgnoredAny>;

fn keys(text: &[u8]) -> Option<Keys> {
    serde_json::from_slice(text).ok()
}

fn by_keys(keys: Keys) -> Option<ResultFile> {
    let has = |all: &[&str]| all.iter().all(|key| keys.contains_key(*key));
    BY_KEYS.iter().find(|(_, all)| has(all)).map(|(kind, _)| *kind)
}

/// Whether a text that begins otherwise, as after a power failure, has a line of a journal.
fn holds_line_of_journal(mut file: File) -> std::io::Result<bool> {
    file.rewind()?;
    let mut text = Vec::new();
    file.take(MOST_LINE_BYTES).read_to_end(&mut text)?;
    let is_line = |line| keys(line).and_then(by_keys) == Some(ResultFile::Journal);
    Ok(text.split(|byte| *byte == b'\n').any(is_line))
}

/// Whether a file is a document of JSON that inkling began and that ends before its end, as after a failing disk.
pub fn is_cut(path: &Path) -> bool {
    let begin = |start: Vec<u8>| {
        let text: String = String::from_utf8_lossy(&start).split_whitespace().collect();
        let rest =
            text.strip_prefix("{\"version\":").map(|of| of.trim_start_matches(char::is_numeric));
        rest.is_some_and(|rest| rest.starts_with(",\"inkling\":"))
    };
    let is_ours = regular_file::start(path, HEAD_BYTES).is_ok_and(begin);
    let end = || {
        let text = BufReader::new(regular_file::open(path).ok()?);
        serde_json::from_reader::<_, IgnoredAny>(text).err()
    };
    is_ours && end().is_some_and(|e| e.is_eof())
}

#[cfg(test)]
mod tests {
    use super::ResultFile::*;
    use super::*;
    use crate::fixtures::place;

    #[test]
    fn a_file_says_what_it_is_and_those_of_others_say_nothing() {
        let (_dir, path) = place("there");
        let page = "<html><head><meta name=\"generator\" content=\"inkling\"><title>a</title>";
        let parquet = |footer: &[u8]| {
            [b"PAR1", footer, &(footer.len() as u32).to_le_bytes(), b"PAR1"].concat()
        };
        let table = parquet(b"..\x18\x07inkling\x18..\x08\x07urgency");
        let faults = parquet(b"\x15\x0a\x25\x00\x18\x07urgency..\x18\x07inkling\x18..");
        let others = parquet(b"\x19\x18\x07inkling\x15");
        let design = br#"{"version": 1, "sample_period_s": 1e-6, "models": {}, "pooled": {}}"#;
        let summary = br#"{"version": 3, "recording": {}, "counts": {}, "settings": {}}"#;
        let journal = b"{\"version\":2,\"recording\":1,\"outcome\":1,\"by\":1}\n{\"vers";
        let mcap = b"\x89MCAP0\r\n\x01\x0f\0\0\0\0\0\0\0\0\0\0\0\x07\0\0\0inkling";
        let of_others =
            b"\x89MCAP0\r\n\x01\x10\0\0\0\0\0\0\0\0\0\0\0\x08\0\0\0mcap-cpp inkling.Burst";
        let torn = b"ath\":\"x\"}\n<<<<\n{\"version\":2,\"recording\":1,\"outcome\":1,\"by\":1}\n";
        let critique = page.replace("<title>a<", TITLE_OF_CRITIQUE);
        let files: [(&[u8], Option<ResultFile>); 23] = [
            (torn, Some(Journal)),
            (critique.as_bytes(), Some(CritiquePage)),
            (design, Some(Design)),
            (br#"{"models": []}"#, Some(Models)),
            (br#"{"version": 2, "design": null, "printheads": {}}"#, Some(Baselines)),
            (br#"{"version": 1, "verdict": "none", "causes": []}"#, Some(Critique)),
            (br#"{"version": 3, "rounds": 1, "sets": []}"#, Some(Chapter)),
            (br#"{"version": 2, "totals": {}, "by": 1, "recordings": []}"#, Some(Run)),
            (journal, Some(Journal)),
            (br#"{"version":2,"recor"#, Some(Journal)),
            (br#"{"version":3,"design":null,"printheads":{"bl"#, None),
            (summary, Some(Summary)),
            (page.as_bytes(), Some(Page)),
            (b".ie \\n(.g\n.TH inkling-replay 1", Some(Manual)),
            (mcap, Some(Recording)),
            (&table, Some(Table)),
            (&faults, Some(Faults)),
            (&others, None),
            (b"<!doctype html>\n<html><title>ours</title>", None),
            (of_others, None),
            (b"PAR1....\x04\0\0\0PAR1", None),
            (b"printhead,channel,from,to,state,severity\n", None),
            (br#"{"name": "somebody's"}"#, None),
        ];
        for (content, of) in files {
            std::fs::write(&path, content).unwrap();
            assert_eq!(ResultFile::of(&path).unwrap(), of, "{}", content.escape_ascii());
        }
        assert_eq!(instead(&path), "");
        std::fs::write(&path, r#"{"version": 2, "printheads": {}}"#).unwrap();
        assert_eq!(instead(&path), ", but a file of baselines: --baseline takes it");
    }
}
