//! What client and executors of one run say to each other, in files in `<out>/.fleet/<run>/`.
//!
//! ```text
//! job.json          what all recordings share, by content. If it is gone, the run is over: nobody begins
//!                   or names anything any more
//! ended.json        the same file after the run is over
//! <n>.json          the row of recording n: written once, by the first who judged it
//! <n>.begun         a byte for each time that an executor began with recording n; only among files
//! <n>.beat          how many bytes of recording n were read so far; only among files
//! <n>.<who>/        where the results of recording n are written before they get their names
//! ```
//!
//! A recording may be judged twice, because its first executor was only slow. The first row that is written
//! counts. Whoever finds it gives names to the files that lie where it says; everybody else drops what was
//! judged.

use crate::row::{FLEET_DIR, Row};
use inkling::cli::judge::Detail;
use inkling::io::job::Job;
use inkling::io::journal::Means;
use inkling::io::objects::in_object_store;
use inkling::io::{part_file, regular_file, stored};
use inkling::pipeline::{Replay, resume};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::fs::{self, File};
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// Name of the file that says what all recordings share.
const JOB: &str = "job.json";
/// Its name after the run is over. By it a later run can take over what was finished.
const ENDED: &str = "ended.json";
/// Most bytes of a job: a design and baselines have a GB at most each.
const MOST_JOB_BYTES: u64 = 2 << 30;
/// Most bytes of a row, which may hold baselines.
const MOST_ROW_BYTES: u64 = 1 << 30;

/// A directory of a run that is over is tried to be removed so often.
const MOST_REMOVALS: u32 = 20;

/// What all recordings of a run share.
#[derive(Clone, Serialize, Deserialize)]
pub struct RunJob {
    /// Version of inkling: only the same version writes the same bytes.
    pub version: String,
    pub replay: Replay,
    /// What decides on verdicts, as the journal notes it.
    pub means: Means,
    pub detail: Detail,
    /// The directory of results as the client named it.
    pub out: PathBuf,
}

/// The directory of a run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunDir {
    path: PathBuf,
}

impl RunDir {
    /// Makes the directory of a new run. `out` is the directory of results, absolute.
    pub fn create(out: &Path, job: &RunJob) -> io::Result<RunDir> {
        let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let name = format!("{}-{}", since_1970.as_millis(), std::process::id());
        let dir = RunDir { path: out.join(FLEET_DIR).join(name) };
        if !in_object_store(out) {
            fs::create_dir_all(&dir.path)?;
        }
        write(&dir.path.join(JOB), job)?;
        Ok(dir)
    }

    /// The directory of a run that exists.
    pub fn at(path: &Path) -> RunDir {
        RunDir { path: path.into() }
    }

    /// Directories of earlier runs that did not come to their end. Objects are not listed.
    pub fn earlier(out: &Path) -> Vec<RunDir> {
        let dirs = fs::read_dir(out.join(FLEET_DIR)).into_iter().flatten().flatten();
        // a link leads to a directory that the fleet did not make
        let own = |entry: &fs::DirEntry| entry.file_type().is_ok_and(|of| of.is_dir());
        dirs.filter(own).map(|entry| RunDir { path: entry.path() }).collect()
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The directory of results.
    pub fn out(&self) -> &Path {
        self.path.parent().and_then(Path::parent).unwrap_or(&self.path)
    }

    /// The job. `NotFound`: the run is over.
    pub fn job(&self) -> io::Result<RunJob> {
        read(&self.path.join(JOB), MOST_JOB_BYTES)
    }

    /// The job of a run that is over.
    pub fn ended_job(&self) -> io::Result<RunJob> {
        read(&self.path.join(ENDED), MOST_JOB_BYTES)
    }

    /// Whether the run is over.
    pub fn is_over(&self) -> bool {
        !stored::is_file(&self.path.join(JOB))
    }

    /// Ends the run: from here on nobody begins or names anything for it.
    pub fn end(&self) -> io::Result<()> {
        match stored::rename(&self.path.join(JOB), &self.path.join(ENDED)) {
            Err(e) if e.kind() == ErrorKind::NotFound => Ok(()),
            ended => ended,
        }
    }

    /// Removes the directory with all that is in it. `rows` is how many recordings the run has, for stores,
    /// where nothing is listed. Failures are ignored: what stays only takes up room.
    pub fn remove(&self, rows: usize) {
        if in_object_store(&self.path) {
            let names = [JOB, ENDED].map(|name| self.path.join(name));
            let rows = (0..rows).map(|at| self.row_path(at));
            names.into_iter().chain(rows).for_each(|path| drop(stored::remove(&path)));
        } else {
            // somebody who has not yet seen that the run is over may put a file into it meanwhile
            for _ in 0..MOST_REMOVALS {
                match fs::remove_dir_all(&self.path) {
                    Err(e) if e.kind() != ErrorKind::NotFound => {
                        std::thread::sleep(Duration::from_millis(100));
                    }
                    _ => break,
                }
            }
            let _ = self.path.parent().map(fs::remove_dir); // where it was the last
        }
    }

    /// The file of a recording's row.
    fn row_path(&self, at: usize) -> PathBuf {
        self.path.join(format!("{at}.json"))
    }

    /// Whether a recording has a row.
    pub fn has_row(&self, at: usize) -> bool {
        stored::is_file(&self.row_path(at))
    }

    /// The row of a recording; `None`: there is none yet.
    pub fn row(&self, at: usize) -> io::Result<Option<Row>> {
        match read(&self.row_path(at), MOST_ROW_BYTES) {
            Ok(row) => Ok(Some(row)),
            Err(e) if e.kind() == ErrorKind::NotFound => Ok(None),
            Err(e) => Err(e),
        }
    }

    /// Writes a row, in place of any other.
    pub fn write_row(&self, at: usize, row: &Row) -> io::Result<()> {
        write(&self.row_path(at), row)
    }

    /// All rows that are there, in no order.
    pub fn rows(&self) -> impl Iterator<Item = Row> {
        self.numbers(".json").filter_map(|(at, _)| self.row(at).ok().flatten())
    }

    /// Numbers of the files with this ending, and when each changed last.
    fn numbers(&self, ending: &'static str) -> impl Iterator<Item = (usize, SystemTime)> {
        let entries = fs::read_dir(&self.path).into_iter().flatten().flatten();
        entries.filter_map(move |entry| {
            let name = entry.file_name().into_string().ok()?;
            let at = name.strip_suffix(ending)?.parse().ok()?;
            let changed = entry.metadata().and_then(|m| m.modified()).unwrap_or(UNIX_EPOCH);
            Some((at, changed))
        })
    }

    /// Recordings that have rows. Among objects, only those of `asked` are looked for.
    pub fn finished(&self, asked: impl Iterator<Item = usize>) -> Vec<usize> {
        match in_object_store(&self.path) {
            true => asked.filter(|&at| self.has_row(at)).collect(),
            false => self.numbers(".json").map(|(at, _)| at).collect(),
        }
    }

    /// When an executor last read on in any recording.
    pub fn last_beat(&self) -> Option<SystemTime> {
        self.numbers(".beat").map(|(_, changed)| changed).max()
    }

    /// Notes how many bytes of a recording were read so far.
    pub fn beat(&self, at: usize, bytes: u64) {
        if !in_object_store(&self.path) {
            let _ = fs::write(self.path.join(format!("{at}.beat")), bytes.to_string());
        }
    }

    /// Notes that an executor begins with a recording; gives how often that has happened. An error if the run
    /// is over.
    pub fn begin(&self, at: usize) -> io::Result<u64> {
        if self.is_over() {
            return Err(io::Error::new(ErrorKind::NotFound, "the run is over"));
        }
        if in_object_store(&self.path) {
            return Ok(1);
        }
        let path = self.path.join(format!("{at}.begun"));
        let mut file = File::options().append(true).create(true).open(path)?;
        file.write_all(b".")?;
        Ok(file.metadata()?.len())
    }

    /// A place of one's own for the verdicts of a recording, before they have their name.
    pub fn staging(&self, at: usize, who: &str, item: &Job) -> PathBuf {
        let name = item.verdicts.rsplit('/').next().unwrap_or(&item.verdicts);
        self.path.join(format!("{at}.{who}")).join(name)
    }

    /// Writes the row of a recording, if nobody did before, and gives names to the files of the row that
    /// counts. Gives that row, which may be another executor's. `row.staged` says where the files lie.
    pub fn commit(&self, at: usize, row: Row) -> io::Result<Row> {
        let staged = row.staged.clone();
        let committed =
            self.claim(at, row).and_then(|first| first.name(self.out()).map(|()| first));
        for file in resume::files(&staged) {
            let _ = stored::remove(&file); // what was not named is dropped
        }
        if !in_object_store(&staged) {
            let _ = staged.parent().map(fs::remove_dir);
            if self.is_over() {
                // the run was removed while this was judged, and its directories were made anew
                let _ = fs::remove_dir(&self.path);
                let _ = self.path.parent().map(fs::remove_dir);
            }
        }
        committed
    }

    /// Makes a row the only one of its recording, unless there is one already; gives the one that counts.
    fn claim(&self, at: usize, row: Row) -> io::Result<Row> {
        if self.is_over() {
            return Err(io::Error::new(ErrorKind::NotFound, "the run is over"));
        }
        if let Some(first) = self.row(at)? {
            return Ok(first);
        }
        if in_object_store(&self.path) {
            return self.write_row(at, &row).map(|()| row);
        }
        let own = row.staged.with_extension("row");
        write(&own, &row)?;
        // a second name for the file: unlike renaming, a link never replaces a file that another executor
        // wrote
        let claimed = fs::hard_link(&own, self.row_path(at));
        let _ = fs::remove_file(&own);
        match claimed {
            Ok(()) => Ok(row),
            Err(e) => self.row(at)?.ok_or(e),
        }
    }
}

/// Writes a file as JSON, complete or not at all.
fn write(path: &Path, value: &impl Serialize) -> io::Result<()> {
    part_file::write(path, &serde_json::to_vec(value)?)
}

/// Reads a file of JSON.
fn read<T: DeserializeOwned>(path: &Path, most_bytes: u64) -> io::Result<T> {
    let text = regular_file::read(path, most_bytes)?;
    serde_json::from_slice(&text)
        .map_err(|e| io::Error::new(ErrorKind::InvalidData, format!("{}: {e}", path.display())))
}

#[cfg(test)]
mod tests {
    use super::*;
    use inkling::cli::judge::Judged;
    use inkling::io::design_file;
    use inkling::io::inputs::Input;
    use inkling::io::journal::{Entry, Outcome, Results};
    use inkling::io::layout::Layout;
    use inkling::labels::{Channels, Label, Labels};
    use serde_json::json;

    fn job() -> RunJob {
        let sample = Path::new(env!("CARGO_MANIFEST_DIR")).join("../sample_logs/design.json");
        let (design, digest) = design_file::read(&sample).unwrap();
        let row = Label {
            printhead: "a".into(),
            channel: Channels::One(3),
            from_ns: None,
            to_ns: Some(i64::MAX),
            state: "healthy".into(),
            severity: Some(0.1 + 0.2),
        };
        let replay = Replay {
            design: Some(design),
            design_digest: Some(digest),
            labels: Some(Labels::new(vec![row])),
            ..Replay::default()
        };
        let means = resume::means_of(&replay, Some("xxh3:1".into()));
        RunJob { version: "0".into(), replay, means, detail: Detail::Line, out: "out".into() }
    }

    fn judged(bytes: u64) -> Judged {
        let Job { source, verdicts, .. } = placed();
        let entry = Entry {
            results: Some(Results { verdicts, bytes: vec![bytes; 3] }),
            counts: json!({"signals": 3}),
            ..Entry::new(source, job().means, Outcome::Judged)
        };
        Judged { entry, report: "x".into(), baselines: None }
    }

    fn placed() -> Job {
        let input = Input { path: "/x.mcap".into(), below: "below".into() };
        Job::new(Layout::Tree, input, |_| String::new())
    }

    fn row(by: &str, bytes: u64) -> Row {
        Row { item: placed(), ended: Ok(judged(bytes)), by: by.into(), staged: PathBuf::new() }
    }

    fn staged(dir: &RunDir, row: Row) -> Row {
        let staged = dir.staging(7, &row.by, &row.item);
        fs::create_dir_all(staged.parent().unwrap()).unwrap();
        resume::files(&staged).iter().for_each(|file| fs::write(file, &row.by).unwrap());
        Row { staged, ..row }
    }

    #[test]
    fn a_job_says_all_and_says_it_exactly() {
        let out = tempfile::tempdir().unwrap();
        let job = job();
        let dir = RunDir::create(out.path(), &job).unwrap();
        let back = dir.job().unwrap();
        back.replay.design.as_ref().unwrap().check().unwrap();
        let text = |job: &RunJob| serde_json::to_string(job).unwrap();
        assert!(text(&back) == text(&job), "by content, to the last digit");
        assert_eq!(back.means, job.means);
    }

    #[test]
    fn the_first_of_two_that_judge_a_recording_names_it_and_nobody_does_when_the_run_is_over() {
        let out = tempfile::tempdir().unwrap();
        let dir = RunDir::create(out.path(), &job()).unwrap();
        let [first, second] = [row("first", 5), row("other", 6)].map(|row| staged(&dir, row));
        assert_eq!(
            (dir.begin(7).unwrap(), dir.begin(7).unwrap(), dir.begin(8).unwrap()),
            (1, 2, 1)
        );
        // stopped after it wrote its row: the other names the first one's files
        assert_eq!(dir.claim(7, first.clone()).unwrap().by, "first");
        assert_eq!(dir.commit(7, second.clone()).unwrap().by, "first");
        assert!(!second.staged.parent().unwrap().exists(), "nothing is left");
        let named = resume::files(&first.item.verdicts_in(out.path()));
        let are_first = || named.iter().all(|file| fs::read_to_string(file).unwrap() == "first");
        assert!(are_first());
        assert_eq!(dir.commit(7, first).unwrap().by, "first", "it wakes");
        assert!(are_first());
        assert!(dir.row(7).unwrap().unwrap().stands(out.path()));
        assert_eq!(dir.finished([].into_iter()), [7]);

        fs::write(&named[2], "changed").unwrap();
        assert!(!dir.row(7).unwrap().unwrap().stands(out.path()));
        dir.end().unwrap();
        dir.end().unwrap();
        assert!(dir.commit(9, staged(&dir, row("late", 4))).is_err() && !dir.has_row(9));
        assert!(fs::read_to_string(&named[0]).unwrap() == "first" && dir.ended_job().is_ok());
        dir.remove(10);
        assert_eq!(fs::read_dir(out.path()).unwrap().count(), 1, "results alone are left");
    }

    #[test]
    fn a_row_that_leads_out_names_nothing() {
        let out = tempfile::tempdir().unwrap();
        let dir = RunDir::create(out.path(), &job()).unwrap();
        let good = staged(&dir, row("first", 5));
        let elsewhere = Row { staged: out.path().join("x.verdicts.parquet"), ..good.clone() };
        let mut beyond = good.clone();
        beyond.item.verdicts = "../x.verdicts.parquet".into();
        let outside = tempfile::tempdir().unwrap();
        std::os::unix::fs::symlink(outside.path(), out.path().join("link")).unwrap();
        let mut through = good.clone();
        through.item.verdicts = "link/x.verdicts.parquet".into();
        for row in [elsewhere, beyond, through] {
            assert_eq!(row.name(out.path()).unwrap_err().kind(), ErrorKind::InvalidData);
        }
        assert_eq!(fs::read_dir(outside.path()).unwrap().count(), 0);
        let mut other = good.item.clone();
        other.source.path = "/y.mcap".into();
        assert!(good.is_of(&good.item) && !good.is_of(&other));
        good.name(out.path()).unwrap();
    }
}
