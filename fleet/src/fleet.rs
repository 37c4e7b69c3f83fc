//! The judge of a run whose recordings are judged by a fleet. `inkling replay` judges by a [`Judge`]; this
//! one begins all recordings at once and then waits for each of them in the order of the plan.
//!
//! In: the plan of a run. Out: for each recording what a judge on this machine would have given, so that
//! journal, messages and exit status come from the same code as those of one machine.

use crate::chains;
use crate::driver::{Driver, Patience, Shared};
use crate::row::Row;
use crate::run_dir::{RunDir, RunJob};
use crate::security::Scheduler;
use crate::worker::Task;
use inkling::cli::exit::Failure;
use inkling::cli::judge::{Judge, Judged, NotJudged, Run};
use inkling::io::job::Job;
use inkling::io::objects::in_object_store;
use inkling::state::Memory;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Time between two looks whether the run is interrupted.
const LOOK: Duration = Duration::from_millis(200);
/// Time between two lines of progress.
const LINE_EVERY: Duration = Duration::from_secs(10);

/// The judge; nothing is begun before the plan is known.
pub struct Fleet {
    scheduler: Scheduler,
    patience: Patience,
    begun: Option<Begun>,
}

/// A run under way.
struct Begun {
    run: RunDir,
    /// How many recordings are judged by the fleet.
    recordings: usize,
    /// How many places of rows the run's directory has: one for each recording of the plan, also for those that
    /// the fleet does not judge.
    rows: usize,
    driver: Option<JoinHandle<()>>,
    shared: Arc<Shared>,
    last_line: Instant,
}

impl Fleet {
    pub fn new(scheduler: Scheduler, patience: Patience) -> Fleet {
        Fleet { scheduler, patience, begun: None }
    }
}

impl Judge for Fleet {
    /// Writes the run's directory, takes over what earlier runs have finished, and starts the driver.
    fn begin(&mut self, run: &Run, items: &[Job]) -> Result<(), Failure> {
        if items.is_empty() {
            return Ok(());
        }
        let out = absolute(run.out).map_err(Failure::new)?;
        let failed = |e: std::io::Error| Failure::new(format!("{}: {e}", out.display()));
        // only one run at a time holds the lock of the directory, so these have died
        let earlier = RunDir::earlier(&out);
        earlier.iter().for_each(|dir| drop(dir.end())); // executors that still work for them stop
        let job = RunJob {
            version: env!("CARGO_PKG_VERSION").into(),
            replay: run.replay.clone(),
            means: run.means.clone(),
            detail: run.detail,
            out: run.out.into(),
        };
        let dir = RunDir::create(&out, &job).map_err(failed)?;
        let with_baselines = run.replay.baselines.is_some();
        if !run.force && !with_baselines {
            let adopted = adopt(&earlier, &dir, &job, items).map_err(failed)?;
            if adopted > 0 {
                run.progress
                    .say(&format!("finished by a run that did not end, and taken over: {adopted}"));
            }
        }
        earlier.iter().for_each(|dir| dir.remove(0));

        let shared = Arc::new(Shared::default());
        let task = |chain: Vec<usize>| Task {
            chain: chain
                .into_iter()
                .filter(|&at| is_text(&items[at]))
                .map(|at| (at, items[at].clone()))
                .collect(),
        };

        let driver = Driver {
            scheduler: self.scheduler.clone(),
            run: dir.clone(),
            tasks: chains::split(items, with_baselines)
                .into_iter()
                .map(task)
                .filter(|task| !task.chain.is_empty())
                .collect(),
            patience: self.patience,
            shared: shared.clone(),
        };

        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
            .map_err(|e| Failure::new(format!("no threads: {e}")))?;
        self.begun = Some(Begun {
            run: dir,
            recordings: items.iter().filter(|item| is_text(item)).count(),
            rows: items.len(),
            driver: Some(std::thread::spawn(move || runtime.block_on(driver.drive()))),
            shared,
            last_line: Instant::now(),
        });
        Ok(())
    }

    /// Waits for a recording's row, gives its files their names, and gives what the row says.
    fn judge(&mut self, run: &Run, at: usize, item: &Job) -> Result<Judged, NotJudged> {
        if !is_text(item) {
            let why = format!("{}: its name is no UTF-8, which a job cannot hold", item.label());
            return Err(NotJudged::Failed { why, usage: false, by_content: false });
        }
        let Some(begun) = &mut self.begun else {
            return Err(NotJudged::Broken("the fleet was not asked".into()));
        };
        begun.wait(run, at)?;
        let unreadable =
            |e: std::io::Error| NotJudged::Broken(format!("{}: {e}", begun.run.path().display()));
        let row = begun.run.row(at).map_err(unreadable)?;
        let row: Row = row.ok_or_else(|| unreadable(std::io::ErrorKind::NotFound.into()))?;
        if !row.is_of(item) {
            return Err(NotJudged::Broken(format!(
                "{}: holds a row that is not of {}; nobody of the fleet writes that",
                begun.run.path().display(),
                item.source.path
            )));
        }
        row.name(begun.run.out()).map_err(unreadable)?;
        if !row.stands(begun.run.out()) {
            let why = format!("{}: its results are not what {} wrote", item.source.path, row.by);
            return Err(NotJudged::Failed { why, usage: false, by_content: false });
        }

        // a failure names the recording by its absolute path, as the executor knows it
        let mut judged = row.ended.map_err(|why| as_named(why, item))?;
        // other chains have changed the baselines since this chain began
        if let (Some(now), Some(next)) = (&run.replay.baselines, judged.baselines.take()) {
            judged.baselines = Some(merged(now, next, &item.printheads));
        }
        Ok(judged)
    }
}

impl Begun {
    /// Waits until a recording's row is there; shows messages and progress meanwhile.
    fn wait(&mut self, run: &Run, at: usize) -> Result<(), NotJudged> {
        let mut now = self.shared.lock();
        loop {
            now.messages.drain(..).for_each(|message| run.progress.say(&message));
            if now.finished.contains(&at) {
                return Ok(());
            }
            if run.control.interrupted() {
                return Err(NotJudged::Interrupted);
            }
            if let Some(why) = &now.broken {
                return Err(NotJudged::Broken(why.clone()));
            }
            if self.last_line.elapsed() >= LINE_EVERY {
                self.last_line = Instant::now();
                let (finished, all) = (now.finished.len(), self.recordings);
                let asked = if finished == 0 { "; are there executors?" } else { "" };
                run.progress
                    .say(&format!("the fleet has finished {finished} of {all} recordings{asked}"));
            }
            now = self.shared.wait(now, LOOK);
        }
    }
}

/// Leaves nothing at work, and removes the run's directory if nobody needs it any more: if all recordings are
/// finished.
impl Drop for Begun {
    fn drop(&mut self) {
        self.shared.lock().stop = true;
        let _ = self.driver.take().map(JoinHandle::join);
        let _ = self.run.end();
        if self.shared.lock().finished.len() == self.recordings {
            self.run.remove(self.rows);
        }
    }
}

/// Whether a recording can be named in a job, which is text.
fn is_text(item: &Job) -> bool {
    item.input.path.to_str().is_some()
}

/// A failure with the recording's name as the user gave it, as one machine would say it.
fn as_named(why: NotJudged, item: &Job) -> NotJudged {
    match why {
        NotJudged::Failed { why, usage, by_content } => {
            let name = item.input.path.display().to_string();
            NotJudged::Failed { why: why.replace(&item.source.path, &name), usage, by_content }
        }
        other => other,
    }
}

/// The baselines `now`, with those of these printheads as one chain of recordings has changed them. Other
/// chains have changed others meanwhile.
fn merged(now: &Memory, mut next: Memory, printheads: &[String]) -> Memory {
    let mut merged = now.clone();
    for printhead in printheads {
        if let Some(learned) = next.printheads.remove(printhead) {
            merged.printheads.insert(printhead.clone(), learned);
        }
    }
    merged
}

/// Takes over rows of runs that did not come to their end, if the recording is asked for now, has not
/// changed, and would be judged by the same means. Gives how many.
fn adopt(earlier: &[RunDir], dir: &RunDir, job: &RunJob, items: &[Job]) -> std::io::Result<usize> {
    // the same recording with its results at the same place
    let key = |item: &Job| (item.source.path.clone(), item.verdicts.clone());
    let all = items.iter().enumerate();
    let mut places: HashMap<_, usize> = all.map(|(at, item)| (key(item), at)).collect();
    let mut adopted = 0;
    for old in earlier {
        let same =
            old.ended_job().is_ok_and(|of| of.means == job.means && of.version == job.version);
        for row in old.rows().filter(|_| same) {
            let key = key(&row.item);
            let Some(&at) = places.get(&key) else { continue };
            let whole = row.ended.is_ok() && row.name(dir.out()).is_ok() && row.stands(dir.out());
            if whole
                && items[at].source.stamp.is_some()
                && row.item.source.stamp == items[at].source.stamp
            {
                dir.write_row(at, &row)?;
                adopted += usize::from(places.remove(&key).is_some());
            }
        }
    }
    Ok(adopted)
}

/// The directory of results as executors find it: absolute, without links.
fn absolute(out: &Path) -> Result<PathBuf, String> {
    match in_object_store(out) {
        true => Ok(out.into()),
        false => out.canonicalize().map_err(|e| format!("{}: {e}", out.display())),
    }
}
