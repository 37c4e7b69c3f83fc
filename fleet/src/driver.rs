//! Sees to it that all recordings of a run are judged: submits jobs, watches them, submits again what is
//! missing, and gives up if that does not help. It runs on a thread of its own beside the client
//! (`fleet.rs`); the two talk by [`Shared`].
//!
//! What is finished is known by its rows in the run's directory, not by what the scheduler says: a scheduler
//! may forget, and an executor may die after it has done its work.

use crate::client::{Client, State, Trouble};
use crate::node;
use crate::run_dir::RunDir;
use crate::security::Scheduler;
use crate::watchdog::Watchdog;
use crate::worker::Task;
use std::collections::HashSet;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Time between two looks at the rows.
const LOOK: Duration = Duration::from_millis(100);
/// The scheduler is asked once in so many looks.
const LOOKS_PER_QUESTION: u32 = 5;
/// So many jobs without a single finished recording end the run.
const MOST_TRIES: u32 = 3;
/// Most tasks of one job, because its plan is one message. Further tasks follow in further jobs.
const MOST_TASKS: usize = 10_000;
/// So many rows are looked for at each look if the results are objects of a store; files are listed instead.
const MOST_ASKED: usize = 32;

/// What driver and client tell each other.
#[derive(Default)]
pub struct Shared {
    now: Mutex<Now>,
    changed: Condvar,
}

/// The state that they share.
#[derive(Default)]
pub struct Now {
    /// Recordings whose rows are there.
    pub finished: HashSet<usize>,
    /// Messages that the client is to show.
    pub messages: Vec<String>,
    /// Why no further recording will be judged.
    pub broken: Option<String>,
    /// Set by the client: the driver is to end.
    pub stop: bool,
}

impl Shared {
    pub fn lock(&self) -> MutexGuard<'_, Now> {
        self.now.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits until something changes, for `most` at most.
    pub fn wait<'a>(&self, now: MutexGuard<'a, Now>, most: Duration) -> MutexGuard<'a, Now> {
        self.changed.wait_timeout(now, most).unwrap_or_else(PoisonError::into_inner).0
    }

    /// Changes the state and wakes the client.
    fn change(&self, change: impl FnOnce(&mut Now)) {
        change(&mut self.lock());
        self.changed.notify_all();
    }
}

/// How long is waited.
#[derive(Clone, Copy, Debug)]
pub struct Patience {
    /// For a job in which nothing moves.
    pub job: Duration,
    /// For a scheduler that does not answer.
    pub scheduler: Duration,
}

/// The driver of one run.
pub struct Driver {
    pub scheduler: Scheduler,
    pub run: RunDir,
    /// All tasks of the run. Finished ones are not submitted again.
    pub tasks: Vec<Task>,
    pub patience: Patience,
    pub shared: Arc<Shared>,
}

/// How a job ended.
enum Ended {
    Done,
    Stalled,
    /// The scheduler does not know it any more.
    Lost,
    Failed(String),
    /// The client asked for the end.
    Stopped,
}

impl Driver {
    /// Works until all recordings are judged, or no more can be. In that case `broken` says why.
    pub async fn drive(self) {
        if let Err(why) = self.all().await {
            self.shared.change(|now| now.broken = Some(why));
        }
    }

    /// Submits job after job. An error says why it gives up.
    async fn all(&self) -> Result<(), String> {
        let mut client = Client::new(&self.scheduler)?;
        let mut tries = 0;
        loop {
            self.look();
            let missing = self.missing();
            if missing.is_empty() {
                return Ok(());
            }

            let finished_before = self.shared.lock().finished.len();
            let why = match self.job(&mut client, &missing).await? {
                Ended::Stopped => return Ok(()),
                Ended::Done => "it ended without the rows of all its recordings".into(),
                Ended::Lost => "the scheduler does not know it any more".into(),
                Ended::Stalled => {
                    format!("nothing moved in it for {} s", self.patience.job.as_secs())
                }
                Ended::Failed(why) => why,
            };

            self.look();
            let (left, finished) = (self.missing(), self.shared.lock().finished.len());
            tries = if finished > finished_before { 0 } else { tries + 1 };
            match (left.len(), tries) {
                (0, _) => return Ok(()),
                (_, MOST_TRIES) => {
                    return Err(format!(
                        "the fleet finished no recording in {MOST_TRIES} jobs; the last: {why}. Are there \
                         executors, and do they see the same files? What is finished stays: run this again"
                    ));
                }
                _ if finished - finished_before == missing.len() => {}
                _ => self.say(format!("warning: a job is submitted again: {why}")),
            }
        }
    }

    /// The next tasks with a recording that has no row, as many as one job may have.
    fn missing(&self) -> Vec<Task> {
        self.tasks.iter().filter(|task| self.is_open(task)).take(MOST_TASKS).cloned().collect()
    }

    /// Whether a recording of the task has no row yet.
    fn is_open(&self, task: &Task) -> bool {
        let finished = &self.shared.lock().finished;
        task.chain.iter().any(|(at, _)| !finished.contains(at))
    }

    /// Takes note of the rows that are there now.
    fn look(&self) {
        let asked: Vec<usize> = {
            let finished = &self.shared.lock().finished;
            let all = self.tasks.iter().flat_map(|task| &task.chain).map(|(at, _)| *at);
            all.filter(|at| !finished.contains(at)).take(MOST_ASKED).collect()
        };
        let there = self.run.finished(asked.into_iter());
        if there.len() != self.shared.lock().finished.len() || !there.is_empty() {
            self.shared.change(|now| now.finished.extend(there));
        }
    }

    /// Has the client show a message.
    fn say(&self, message: String) {
        self.shared.change(|now| now.messages.push(message));
    }

    /// Submits tasks as a job, and watches it to its end.
    async fn job(&self, client: &mut Client, tasks: &[Task]) -> Result<Ended, String> {
        let plan = node::plan(self.run.clone(), tasks).map_err(|e| e.to_string())?;
        let mut away = Away::new(self.patience.scheduler);
        let job = loop {
            match client.submit(plan.clone()).await {
                Ok(job) => break job,
                Err(Trouble::Refused(why)) => return Err(format!("the scheduler refuses: {why}")),
                Err(Trouble::Away(why)) => self.bear(&mut away, &why).await?,
            }
            if self.shared.lock().stop {
                return Ok(Ended::Stopped);
            }
        };

        let mut watchdog = Watchdog::new(self.patience.job, Instant::now());
        for looks in 0u32.. {
            tokio::time::sleep(LOOK).await;
            self.look();
            if self.shared.lock().stop {
                client.cancel(&job).await;
                return Ok(Ended::Stopped);
            }
            if !tasks.iter().any(|task| self.is_open(task)) {
                return Ok(Ended::Done); // only the scheduler's bookkeeping is left
            }
            let seen = (self.shared.lock().finished.len(), self.run.last_beat());
            if watchdog.bites(seen, Instant::now()) {
                client.cancel(&job).await;
                return Ok(Ended::Stalled);
            }
            if looks % LOOKS_PER_QUESTION != 0 {
                continue;
            }
            match client.state(&job).await {
                Ok(State::Alive) => away = Away::new(self.patience.scheduler),
                Ok(State::Done) => return Ok(Ended::Done),
                Ok(State::Failed(why)) => return Ok(Ended::Failed(in_words(&why))),
                Ok(State::Unknown) | Err(Trouble::Refused(_)) => return Ok(Ended::Lost),
                Err(Trouble::Away(why)) => self.bear(&mut away, &why).await?,
            }
        }
        Ok(Ended::Lost)
    }

    /// Waits a moment for the scheduler. An error, if it has been away for longer than the patience lasts.
    async fn bear(&self, away: &mut Away, why: &str) -> Result<(), String> {
        let at = format!("{}:{}", self.scheduler.host, self.scheduler.port);
        if away.since.elapsed() >= away.most {
            return Err(format!(
                "no scheduler at {at} for {} s: {why}. Is one running, with certificates of the same authority or, like \
                 this side, none? What is finished stays: run this again",
                away.most.as_secs()
            ));
        }
        if !away.told {
            away.told = true;
            self.say(format!("warning: no scheduler at {at}, waiting for it: {why}"));
        }
        tokio::time::sleep(Duration::from_millis(500)).await;
        Ok(())
    }
}

/// Since when the scheduler does not answer, for how long that is borne, and whether the user was told.
struct Away {
    since: Instant,
    most: Duration,
    told: bool,
}

impl Away {
    fn new(most: Duration) -> Away {
        Away { since: Instant::now(), most, told: false }
    }
}

/// The sentence of the fleet in an error, without what it was wrapped into on its way through the engine.
fn in_words(error: &str) -> String {
    let ours = error.split_once("Execution(\"").and_then(|(_, rest)| rest.rsplit_once("\")"));
    match ours {
        Some((ours, _)) => ours.replace("\\\"", "\"").replace("\\\\", "\\"),
        None => error.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use datafusion::error::DataFusionError;

    #[test]
    fn an_executors_words_are_told_without_their_wrapping() {
        let wrapped =
            "Job failed due to stage 1 failed: DataFusionError(Execution(\"/x: no room\"))\n";
        assert_eq!(in_words(wrapped), "/x: no room");
        let quoted = DataFusionError::Execution("/ü \"q\") \\x: no".into());
        assert_eq!(in_words(&format!("stage failed: {quoted:?})")), "/ü \"q\") \\x: no");
        assert_eq!(in_words("plain"), "plain");
    }
}
