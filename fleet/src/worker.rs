//! What an executor does with a task: it judges recording after recording by the library's own replay, and
//! commits each of them once.

use crate::roots::Roots;
use crate::row::{Row, stays_below};
use crate::run_dir::{RunDir, RunJob};
use inkling::cli::judge::{Judged, NotJudged};
use inkling::io::Limits;
use inkling::io::dialect::Dialects;
use inkling::io::job::Job;
use inkling::io::recording::Recording;
use inkling::pipeline::{self, Control, PipelineError, Replay};
use inkling::settings::Pace;
use inkling::state::Memory;
use serde::{Deserialize, Serialize};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError, mpsc};
use std::time::Duration;

/// Time between two looks whether a recording goes on, and whether its run is over.
const BEAT: Duration = Duration::from_secs(1);

/// After so many executors began with a recording and none ended, it is left alone, before it takes the whole
/// fleet with it.
const MOST_BEGUN: u64 = 5;

/// Recordings that are judged one after the other, each with its place among those of the run.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Task {
    pub chain: Vec<(usize, Job)>,
}

/// What an executor judges with: where it may read and write, and how many threads a recording gets.
#[derive(Debug)]
pub struct Worker {
    roots: Roots,
    threads: usize,
    /// Host and process.
    name: String,
    /// The job of the last run: a design is parsed once and not for each recording.
    job: Mutex<Option<(PathBuf, Arc<Loaded>)>>,
    /// How many recordings were begun, so that each has a directory of its own.
    attempts: AtomicU64,
}

/// A job, ready to judge.
struct Loaded {
    job: RunJob,
    dialects: Dialects,
}

impl std::fmt::Debug for Loaded {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.write_str("Loaded")
    }
}

impl Worker {
    pub fn new(roots: Roots, threads: usize, name: String) -> Worker {
        Worker { roots, threads, name, job: Mutex::default(), attempts: AtomicU64::new(0) }
    }

    /// Judges the recordings of a task; gives a line about each. What goes wrong with a recording is said in
    /// its row. `Err`: something that no recording of the run can escape, in words.
    pub fn judge(&self, run: &RunDir, task: &Task) -> Result<Vec<String>, String> {
        self.roots.check(run.path())?;
        let loaded = self.load(run)?;
        let mut baselines = loaded.job.replay.baselines.clone();
        let mut said = Vec::new();
        for (at, item) in &task.chain {
            if let Some((known, at_ns)) = baselines.as_mut().zip(item.source.starts_at_ns) {
                known.begin_anew(&loaded.job.replay.replaced, at_ns);
            }
            let row = match run.row(*at).map_err(|e| self.words(run, e))? {
                Some(row) => self.name(run, item, row)?,
                None => self.attempt(run, *at, item, &loaded, &baselines)?,
            };
            said.push(match &row.ended {
                Ok(judged) => {
                    let digest = &judged.entry.recording.digest;
                    format!("{at} {}", digest.as_deref().unwrap_or_default())
                }
                Err(_) => format!("{at} failed"),
            });
            // the next recording of the chain begins with what this one has taught
            if let Ok(Judged { baselines: Some(next), .. }) = row.ended
                && item.teaches
            {
                baselines = Some(next);
            }
        }
        Ok(said)
    }

    /// Gives the files of a row that was found their names.
    fn name(&self, run: &RunDir, item: &Job, row: Row) -> Result<Row, String> {
        if !row.is_of(item) {
            return Err(self.words(run, format!("a row that is not of {}", item.source.path)));
        }
        if self.allowed(run, item).is_ok() {
            row.name(run.out()).map_err(|e| self.words(run, e))?;
        }
        Ok(row)
    }

    /// An error in words, with who says it and of which run.
    fn words(&self, run: &RunDir, e: impl std::fmt::Display) -> String {
        format!("{} at {}: {e}", self.name, run.path().display())
    }

    /// Loads what all recordings of a run share. An error if client and executor are not of one version.
    fn load(&self, run: &RunDir) -> Result<Arc<Loaded>, String> {
        let mut last = self.job.lock().unwrap_or_else(PoisonError::into_inner);
        match last.as_ref() {
            Some((of, loaded)) if of == run.path() => return Ok(loaded.clone()),
            _ => *last = None,
        }
        let mut job = run.job().map_err(|e| self.words(run, e))?;
        if job.version != env!("CARGO_PKG_VERSION") {
            let (theirs, ours) = (&job.version, env!("CARGO_PKG_VERSION"));
            return Err(self.words(
                run,
                format!("inkling {ours} cannot judge for a client of inkling {theirs}: their tables would not be the same"),
            ));
        }
        if let Some(design) = &job.replay.design {
            design.check().map_err(|e| self.words(run, e))?;
        }
        let replay = &mut job.replay.settings.replay;
        // pace and threads are the executor's decision, not the client's
        (replay.pace, replay.threads) = (Pace::Max, self.threads);
        let dialects = job.replay.settings.input.dialects();
        let loaded = Arc::new(Loaded { job, dialects });
        *last = Some((run.path().into(), loaded.clone()));
        Ok(loaded)
    }

    /// Judges a recording and commits its row. A panic, a forbidden path or too many earlier attempts make a
    /// failed row.
    fn attempt(
        &self,
        run: &RunDir,
        at: usize,
        item: &Job,
        loaded: &Loaded,
        baselines: &Option<Memory>,
    ) -> Result<Row, String> {
        let attempt = self.attempts.fetch_add(1, Ordering::Relaxed);
        let staged = run.staging(at, &format!("{}-{attempt}", self.name), item);
        let failed = |why: String| Err(NotJudged::Failed { why, usage: false, by_content: false });
        let begun = run.begin(at).map_err(|e| self.words(run, e))?;
        let ended = match self.allowed(run, item) {
            Err(why) => failed(why),
            Ok(()) if begun > MOST_BEGUN => failed(format!(
                "{}: begun {MOST_BEGUN} times and never ended: whoever judges it dies or hangs",
                item.source.path
            )),
            Ok(()) => {
                let replay = || self.replay(run, at, item, loaded, baselines, &staged);
                catch_unwind(AssertUnwindSafe(replay)).unwrap_or_else(|_| {
                    failed(format!("{}: judging it panicked; this is our bug", item.source.path))
                })
            }
        };
        // if it was interrupted, its run is over, and no row is taken
        let row = Row { item: item.clone(), ended, by: self.name.clone(), staged };
        run.commit(at, row).map_err(|e| self.words(run, e))
    }

    /// Whether the executor may read the recording and write its results.
    fn allowed(&self, run: &RunDir, item: &Job) -> Result<(), String> {
        let below = Path::new(&item.verdicts);
        if !stays_below(below) {
            return Err(format!("{}: leads out of the directory of results", below.display()));
        }
        self.roots.check(Path::new(&item.source.path))?;
        self.roots.check(&item.verdicts_in(run.out()))
    }

    /// Judges one recording into `staged`.
    fn replay(
        &self,
        run: &RunDir,
        at: usize,
        item: &Job,
        loaded: &Loaded,
        baselines: &Option<Memory>,
        staged: &Path,
    ) -> Result<Judged, NotJudged> {
        // with baselines each recording has settings of its own: those of the job, with the chain's baselines
        let chained;
        let replay: &Replay = match baselines {
            None => &loaded.job.replay,
            Some(_) => {
                chained = Replay { baselines: baselines.clone(), ..loaded.job.replay.clone() };
                &chained
            }
        };
        let path = Path::new(&item.source.path);
        let mut recording = Recording::open_with(path, Limits::default(), &loaded.dialects)
            .map_err(PipelineError::from)?;
        recording.label.clone_from(&item.label());
        let control = Control::default();
        let report =
            watched(run, at, &control, || pipeline::replay(replay, &recording, staged, &control))?;
        let job = &loaded.job;
        Ok(Judged::of(report, item, &job.means, &job.out, job.detail))
    }
}

/// Runs `job` while its progress is noted every second, and interrupts it if its run is over.
fn watched<T>(run: &RunDir, at: usize, control: &Control, job: impl FnOnce() -> T) -> T {
    let (ended, wait) = mpsc::channel::<()>();
    std::thread::scope(|scope| {
        scope.spawn(move || {
            let mut told = 0;
            // ends with the sender, also where the job panics
            while wait.recv_timeout(BEAT) == Err(mpsc::RecvTimeoutError::Timeout) {
                let read = control.bytes_read.load(Ordering::Relaxed);
                if run.is_over() {
                    control.interrupt();
                } else if read != told {
                    told = read;
                    run.beat(at, read);
                }
            }
        });
        let _ended = ended;
        job()
    })
}
