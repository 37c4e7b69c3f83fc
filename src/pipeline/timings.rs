//! Where a run's time goes: per stage, how long its workers worked, waited for input, and waited for
//! room. The stage that is neither starved nor blocked is the bottleneck.

use crossbeam_channel::{Receiver, Sender};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Of what a recording takes, one after the other.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct PhaseTiming {
    /// `open`, `survey`, `windows`, `baselines`, `wait`, `stages`, `given up` (stages that had
    /// to begin anew), `finish`.
    pub phase: &'static str,
    pub seconds: f64,
}

/// Adds up phases, and everything there is.
#[derive(Debug)]
pub struct Phases {
    started: Instant,
    /// Before `started`.
    before: Duration,
    pub list: Vec<PhaseTiming>,
}

impl Phases {
    /// `opening`: what opening the recording took.
    pub fn new(opening: Duration) -> Phases {
        let mut phases = Phases { started: Instant::now(), before: opening, list: Vec::new() };
        phases.add("open", opening);
        phases
    }

    pub fn time<T>(&mut self, phase: &'static str, job: impl FnOnce() -> T) -> T {
        let started = Instant::now();
        let done = job();
        self.add(phase, started.elapsed());
        done
    }

    pub fn add(&mut self, phase: &'static str, took: Duration) {
        let seconds = took.as_secs_f64();
        match self.list.iter_mut().find(|of| of.phase == phase) {
            Some(of) => of.seconds += seconds,
            None => self.list.push(PhaseTiming { phase, seconds }),
        }
    }

    /// Of everything so far.
    pub fn seconds(&self) -> f64 {
        (self.before + self.started.elapsed()).as_secs_f64()
    }
}

/// Of one stage, over its workers.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct StageTiming {
    pub stage: &'static str,
    pub workers: usize,
    pub batches: u64,
    /// Working, waiting for input, waiting for room behind; s, summed over workers. On a machine
    /// that has other work, busy includes waiting for a processor.
    pub busy_s: f64,
    pub starved_s: f64,
    pub blocked_s: f64,
    /// Batches that stood in the queue before this stage when it took one, on average.
    pub queue_fill: f64,
}

/// Of all stages; workers add theirs when they end.
#[derive(Debug, Default)]
pub struct Timings(Mutex<Vec<StageTiming>>);

impl Timings {
    /// In the order in which stages were first heard of.
    pub fn expect(&self, stage: &'static str) {
        self.lock().push(StageTiming { stage, ..StageTiming::default() });
    }

    pub fn clock(&self, stage: &'static str) -> Clock<'_> {
        Clock {
            timings: self,
            stage,
            started: Instant::now(),
            starved: Duration::ZERO,
            blocked: Duration::ZERO,
            batches: 0,
            queued: 0,
        }
    }

    pub fn stages(&self) -> Vec<StageTiming> {
        let mut stages = self.lock().clone();
        for s in &mut stages {
            s.queue_fill /= s.batches.max(1) as f64;
        }
        stages
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Vec<StageTiming>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// One worker's; adds up when it is dropped.
pub struct Clock<'a> {
    timings: &'a Timings,
    stage: &'static str,
    started: Instant,
    starved: Duration,
    blocked: Duration,
    batches: u64,
    queued: u64,
}

impl Clock<'_> {
    /// The next of `input`, or `None` after the last.
    pub fn receive<T>(&mut self, input: &Receiver<T>) -> Option<T> {
        let queued = input.len() as u64;
        let from = Instant::now();
        let received = input.recv().ok();
        self.starved += from.elapsed();
        if received.is_some() {
            self.queued += queued;
            self.batches += 1;
        }
        received
    }

    /// Whether there is still someone to receive it.
    pub fn send<T>(&mut self, out: &Sender<T>, of: T) -> bool {
        self.blocked(|| out.send(of).is_ok())
    }

    /// Runs what waits for room.
    pub fn blocked<T>(&mut self, wait: impl FnOnce() -> T) -> T {
        let from = Instant::now();
        let waited = wait();
        self.blocked += from.elapsed();
        waited
    }

    /// A batch that came from elsewhere than a queue.
    pub fn count(&mut self) {
        self.batches += 1;
    }
}

impl Drop for Clock<'_> {
    fn drop(&mut self) {
        let waited = self.starved + self.blocked;
        let busy = self.started.elapsed().saturating_sub(waited);
        let mut stages = self.timings.lock();
        if let Some(s) = stages.iter_mut().find(|s| s.stage == self.stage) {
            s.workers += 1;
            s.batches += self.batches;
            s.busy_s += busy.as_secs_f64();
            s.starved_s += self.starved.as_secs_f64();
            s.blocked_s += self.blocked.as_secs_f64();
            s.queue_fill += self.queued as f64;
        }
    }
}
