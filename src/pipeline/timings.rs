//! Measures where the time of a recording goes, for `--timings` and the summary: by phase, one after another
//! ([`PhaseTiming`]); and for each stage, how long its workers worked, waited for input (*starved*), and waited for
//! room behind them (*blocked*) ([`Timings`]). The stage that waits for neither is the bottleneck.
//!
//! Each worker has a [`Clock`], through which it receives and sends, and which adds its sums to those of the
//! stage when the worker ends.

use super::locked;
use crossbeam_channel::{Receiver, Sender};
use std::sync::Mutex;
use std::time::Instant;

#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct PhaseTiming {
    /// `open`, `stages`, `finish`.
    pub phase: &'static str,
    pub seconds: f64,
}

#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct StageTiming {
    pub stage: &'static str,
    /// Number of its workers, and of the batches that they took, or made in the reader.
    pub workers: usize,
    pub batches: u64,
    /// Time spent working (or waiting for a processor), waiting for input, and waiting for room behind; s,
    /// summed over workers.
    pub busy_s: f64,
    pub starved_s: f64,
    pub blocked_s: f64,
    /// Average number of batches in the queue before this stage when it took one.
    pub queue_fill: f64,
}

#[derive(Debug, Default)]
pub struct Timings(Mutex<Vec<StageTiming>>);

impl Timings {
    /// Announces a stage; stages are listed in the order in which they were announced.
    pub fn expect(&self, stage: &'static str) {
        locked(&self.0).push(StageTiming { stage, ..StageTiming::default() });
    }

    pub fn clock(&self, stage: &'static str) -> Clock<'_> {
        let of = StageTiming { stage, workers: 1, ..StageTiming::default() };
        Clock { timings: self, started: Instant::now(), of }
    }

    pub fn stages(&self) -> Vec<StageTiming> {
        let mut stages = locked(&self.0).clone();
        for s in &mut stages {
            s.queue_fill /= s.batches.max(1) as f64;
        }
        stages
    }
}

/// The clock of one worker; when it is dropped, its times are added to the stage's.
pub struct Clock<'a> {
    timings: &'a Timings,
    started: Instant,
    /// What was measured so far; `queue_fill` is the sum over the batches.
    of: StageTiming,
}

impl Clock<'_> {
    /// Receives the next batch, and counts the wait as starved. `None`: the input has ended.
    pub fn receive<T>(&mut self, input: &Receiver<T>) -> Option<T> {
        let queued = input.len();
        let from = Instant::now();
        let received = input.recv().ok();
        self.of.starved_s += from.elapsed().as_secs_f64();
        if received.is_some() {
            self.of.queue_fill += queued as f64;
            self.count();
        }
        received
    }

    /// Sends a batch, and counts the wait as blocked. False: nobody is there to receive it.
    pub fn send<T>(&mut self, out: &Sender<T>, of: T) -> bool {
        self.blocked(|| out.send(of).is_ok())
    }

    pub fn blocked<T>(&mut self, wait: impl FnOnce() -> T) -> T {
        let from = Instant::now();
        let waited = wait();
        self.of.blocked_s += from.elapsed().as_secs_f64();
        waited
    }

    pub fn count(&mut self) {
        self.of.batches += 1;
    }
}

impl Drop for Clock<'_> {
    fn drop(&mut self) {
        let StageTiming { stage, workers, batches, starved_s, blocked_s, queue_fill, .. } = self.of;
        let busy_s = (self.started.elapsed().as_secs_f64() - starved_s - blocked_s).max(0.0);
        let mut stages = locked(&self.timings.0);
        if let Some(s) = stages.iter_mut().find(|s| s.stage == stage) {
            s.workers += workers;
            s.batches += batches;
            s.busy_s += busy_s;
            s.starved_s += starved_s;
            s.blocked_s += blocked_s;
            s.queue_fill += queue_fill;
        }
    }
}
