//! Decides which recordings of a batch are finished already. A recording is finished if its content, the design,
//! the labels, the settings that have an effect, and the version of the tables are those of the journal's last
//! line about it, and its files are there. The program's version does not matter.
//!
//! In: from `cli/plan.rs`, a recording with its place among the results, and the journal. Out: a [`Decision`] with
//! its reason ([`Resume::decide`]). Also what the journal notes as the means of judging ([`means_of`]).
//!
//! The questions, in this order: do files that are not this recording's lie at its place (then it is refused)?
//! Does the journal know its results? Did the means change, or the result files? Did the content change, first by
//! size and time of change, then by its digest, which reads the whole file?
use super::run::Replay;
use crate::settings::Settings;
use inkling_io::job::{Decision, Job, JudgeReason};
use inkling_io::journal::{Entry, Journal, Means, Source, Stamp};
use inkling_io::outputs::ResultFile;
use inkling_io::{
    annotation_writer, episode_table, regular_file, stored, summary_file, verdict_reader,
};
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Version of the tables; raised when the same recording, design and settings give other columns.
pub const TABLES_VERSION: u32 = 5;
/// Maximum bytes of a summary that is read to learn whose it is.
const MOST_SUMMARY_BYTES: u64 = 64 << 20;
const MOST_NAMED: usize = 3;

pub struct Resume<'a> {
    pub out: &'a Path,
    pub journal: &'a Journal,
    pub means: &'a Means,
    pub with_baselines: bool,
    pub force: bool,
    /// Compare the content, whatever the file's size and time of change say.
    pub verify: bool,
}

/// What recordings are judged with, as the journal notes it. `labels`: digest of the labels.
pub fn means_of(replay: &Replay, labels: Option<String>) -> Means {
    Means {
        schema: TABLES_VERSION,
        design: replay.design_digest.clone(),
        labels,
        settings: Arc::new(effective(&replay.settings)),
    }
}

/// The settings that neither a verdict nor its summary depends on, by section. Of files that settings name, the
/// digests are compared instead.
const WITHOUT_EFFECT: [(&str, &[&str]); 4] = [
    ("input", &["recordings", "design", "baseline"]),
    ("identify", &["labels"]),
    ("output", &["dir", "layout"]),
    ("replay", &["pace", "threads"]),
];

pub fn effective(settings: &Settings) -> Value {
    let mut all = serde_json::to_value(settings).unwrap_or_default();
    all.as_object_mut().map(|sections| sections.remove("report"));
    for (section, keys) in WITHOUT_EFFECT {
        if let Some(section) = all.get_mut(section).and_then(Value::as_object_mut) {
            keys.iter().for_each(|key| drop(section.remove(*key)));
        }
    }
    all
}

impl Resume<'_> {
    /// Decides whether a recording is judged. `digest` reads the whole file; it fails only if the run is
    /// interrupted, and gives `None` if the file cannot be read.
    pub fn decide<E>(
        &self,
        job: &Job,
        digest: impl Fn(&Path) -> Result<Option<String>, E>,
    ) -> Result<Decision, E> {
        let (path, stamp) = (&job.input.path, job.source.stamp);
        let entry = self.journal.of_result(&job.verdicts);

        // 1. files at its place must be this recording's, by its path or by its content
        let verdicts = job.verdicts_in(self.out);
        let there = files(&verdicts).into_iter().find(|file| stored::exists(file));
        if let Some(there) = &there {
            let owner = owner(entry, &verdicts);
            let same_path = entry.is_some_and(|e| e.recording.path == job.source.path);
            let bytes = owner.as_ref().and_then(|of| Some(of.stamp?.bytes));
            let is_as_long = bytes.is_some() && bytes == stamp.map(|stamp| stamp.bytes);
            let of_owner = owner.as_ref().and_then(|of| of.digest.as_ref());
            let same =
                same_path || is_as_long && of_owner.is_some() && digest(path)?.as_ref() == of_owner;
            if !same {
                return Ok(Decision::Refuse(refusal(there, owner)));
            }
        }

        // 2. the same for annotations, which are recognised by what is in them
        let annotations = annotation_writer::path_beside(&verdicts);
        if is_of_another(&annotations) {
            return Ok(Decision::Refuse(format!(
                "{}: is no file of annotations that inkling wrote, and would be one: give another --out, or remove it",
                annotations.display()
            )));
        }

        // 3. without a line in the journal it is judged
        let Some(entry) = entry else {
            let why = if there.is_some() { JudgeReason::NotInJournal } else { JudgeReason::New };
            return Ok(Decision::Judge(why));
        };

        // 4. what failed for its content fails again; nobody is told twice
        let is_same = entry.recording.path == job.source.path && entry.recording.stamp == stamp;
        let is_dated = stamp.is_some_and(|stamp| stamp.modified_ns.is_some());
        if entry.by_content && is_same && is_dated && entry.by == *self.means && !self.force {
            return Ok(Decision::Finished { entry: entry.clone(), moved: false });
        }

        // 5. did anything but its content change? What was never judged keeps its reason with `--force`
        match self.stale(entry, job) {
            Some(why) if !(self.force && entry.outcome.is_judged()) => Ok(Decision::Judge(why)),
            None if !self.force => self.compare(entry, job, digest),
            _ => Ok(Decision::Judge(JudgeReason::Forced)),
        }
    }

    /// The reason for judging a recording again, apart from its content. `None`: there is none.
    fn stale(&self, entry: &Entry, job: &Job) -> Option<JudgeReason> {
        let (then, now) = (&entry.by, self.means);
        let bytes = entry.results.as_ref().map_or(&[][..], |results| &results.bytes);
        let is_there = |(file, &bytes): (PathBuf, &u64)| {
            stored::is_file(&file) && stored::bytes(&file) == bytes
        };
        let files = files(&job.verdicts_in(self.out));
        if !entry.outcome.is_judged() {
            let known = entry.recording.path == job.source.path;
            Some(if known { JudgeReason::FailedBefore } else { JudgeReason::New })
        } else if then.schema != now.schema {
            Some(JudgeReason::OtherTables)
        } else if then.design != now.design {
            Some(JudgeReason::DesignChanged)
        } else if then.labels != now.labels {
            Some(JudgeReason::LabelsChanged)
        } else if then.settings != now.settings {
            Some(JudgeReason::SettingsChanged(changed(&then.settings, &now.settings)))
        } else if entry.baseline.is_some() != self.with_baselines {
            Some(JudgeReason::BaselineChanged)
        } else if bytes.len() != files.len() || !files.into_iter().zip(bytes).all(is_there) {
            Some(JudgeReason::ResultsChanged)
        } else {
            None
        }
    }

    /// Compares a recording's content with that of the journal: by size and time of change, and by the digest
    /// where these do not tell, or with `verify`.
    fn compare<E>(
        &self,
        entry: &Arc<Entry>,
        job: &Job,
        digest: impl Fn(&Path) -> Result<Option<String>, E>,
    ) -> Result<Decision, E> {
        let (then, stamp) = (&entry.recording, job.source.stamp);
        let same_place = then.path == job.source.path;
        if stamp.map(|s| s.bytes) != then.stamp.map(|s| s.bytes) {
            return Ok(Decision::Judge(JudgeReason::RecordingChanged));
        }
        // a file whose time of change is unknown does not count as unchanged
        let unchanged = stamp == then.stamp && stamp.is_some_and(|s| s.modified_ns.is_some());
        let entry = entry.clone();
        if same_place && unchanged && !self.verify {
            return Ok(Decision::Finished { entry, moved: false });
        }

        let of_this = digest(&job.input.path)?;
        if of_this.is_none() {
            return Ok(Decision::Refuse(format!(
                "{}: cannot be read now, so nobody knows whether it is what was judged; its results were left as \
                 they are",
                job.input.path.display()
            )));
        }
        Ok(match of_this == then.digest {
            false => Decision::Judge(JudgeReason::RecordingChanged),
            true => Decision::Finished { entry, moved: !(same_place && unchanged) },
        })
    }
}

/// Whether there is a file that is not empty, and that is no recording of inkling, which annotations are.
fn is_of_another(annotations: &Path) -> bool {
    let is_something = annotations.metadata().is_ok_and(|of| of.len() > 0);
    is_something && !matches!(ResultFile::of(annotations), Ok(Some(ResultFile::Recording)))
}

/// Paths of the files that are written of a recording. The summary, which says that all are there, is the last.
pub fn files(verdicts: &Path) -> [PathBuf; 3] {
    [
        verdicts.to_path_buf(),
        episode_table::path_beside(verdicts),
        summary_file::path_beside(verdicts),
    ]
}

/// The recording whose results lie at a place, by the journal, or else by the summary beside the table, or what
/// the tables say of themselves.
fn owner(entry: Option<&Arc<Entry>>, verdicts: &Path) -> Option<Source> {
    if let Some(entry) = entry {
        return Some(entry.recording.clone());
    }

    let summary = regular_file::read(&summary_file::path_beside(verdicts), MOST_SUMMARY_BYTES).ok();
    let summary: Value =
        summary.and_then(|text| serde_json::from_slice(&text).ok()).unwrap_or_default();

    let [table, episodes, _] = files(verdicts);
    let tables = [table, episodes].into_iter();
    let tables = tables.filter_map(|path| verdict_reader::document_of(&path).ok());
    let all = [summary].into_iter().chain(tables);
    // the first document that names a recording's digest
    let document = all.into_iter().find(|of| of["recording"]["digest"].is_string())?;
    let text = |key: &str| document["recording"][key].as_str().map(str::to_owned);
    let bytes = document["recording"]["bytes"].as_u64();
    let stamp = bytes.map(|bytes| Stamp { bytes, modified_ns: None });
    Some(Source { path: text("name")?, stamp, digest: text("digest"), ..Source::default() })
}

fn refusal(there: &Path, owner: Option<Source>) -> String {
    let whose = match owner {
        Some(of) => format!("the verdicts of another recording, {}", of.path),
        None => "there already, and nothing says of which recording".into(),
    };
    format!(
        "{} is {whose}; it was left as it is. Name the directory above both recordings (the tree \
         below it is kept), lay them out by day (--layout date), give another --out, or remove it",
        there.display()
    )
}

/// Names of settings that differ, as `identify.first, detect.mu`, and how many more there are.
fn changed(then: &Value, now: &Value) -> String {
    let mut keys = Vec::new();
    differ("", then, now, &mut keys);
    let more = keys.len().saturating_sub(MOST_NAMED);
    let named = keys.into_iter().take(MOST_NAMED).collect::<Vec<_>>().join(", ");
    if more > 0 { format!("{named} and {more} more") } else { named }
}

/// Adds the names of all leaves that differ below `key` to `keys`, sorted. `then`, `now`: the
/// values of `key`.
fn differ(key: &str, then: &Value, now: &Value, keys: &mut Vec<String>) {
    let (Some(a), Some(b)) = (then.as_object(), now.as_object()) else {
        if then != now {
            keys.push(key.into());
        }
        return;
    };
    let names: BTreeSet<&String> = a.keys().chain(b.keys()).collect();
    for name in names {
        let below = if key.is_empty() { name.clone() } else { format!("{key}.{name}") };
        let of = |values: &serde_json::Map<String, Value>| values.get(name).cloned();
        differ(&below, &of(a).unwrap_or_default(), &of(b).unwrap_or_default(), keys);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_without_effect_do_not_count_and_those_with_are_named() {
        let with = |pairs: &[&str]| {
            let pairs: Vec<String> = pairs.iter().map(|s| s.to_string()).collect();
            effective(&Settings::load(None, None, &pairs).unwrap())
        };
        let plain = with(&[]);
        let idle = ["output.dir=x", "replay.threads=3", "input.design=d", "identify.labels=l"];
        assert_eq!(with(&idle), plain);
        assert_eq!(changed(&plain, &with(&["identify.first=5"])), "identify.first");
        let many = ["identify.first=5", "detect.mu=2", "isolate.gate=false", "output.weights=true"];
        assert_eq!(
            changed(&plain, &with(&many)),
            "detect.mu, identify.first, isolate.gate and 1 more"
        );
    }
}
