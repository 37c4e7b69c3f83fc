//! Runs the six stages side by side: starts threads, connects them by bounded queues, gathers their results.
//!
//! In: a run ([`Run`]), from `replay`. Out: [`StageResults`], from which `finish` makes the report and completes the files.
//!
//! The reader ends at the end of the recording, each other stage when the stage before it is gone. If a worker
//! fails, nobody waits for room any more (`RunningStages::start`), so that all stages end.

use super::batches::{BufferPools, JudgedBatch};
use super::episodes::{EpisodeReport, EpisodeTap};
use super::groups::Groups;
use super::head_clock::{FileOrder, HeadClock};
use super::head_movement::HeadMovement;
use super::heads::Heads;
use super::in_flight::InFlight;
use super::judges::Judges;
use super::run::Run;
use super::stages::{self, BlockQueue, JudgeAssignment};
use super::tally::Tally;
use super::temperature_check::TemperatureCheck;
use super::timings::{Clock, StageTiming, Timings};
use super::topic_overlap::TopicOverlap;
use super::visit::Pass;
use super::{PipelineError, Result};
use crossbeam_channel::{Receiver, bounded};
use inkling_core::fault::categories;
use inkling_core::state::Memory;
use inkling_core::verdict::Verdicts;
use inkling_io::damage::Damage;
use inkling_io::digest::Digest;
use inkling_io::episode_table::{self, EpisodeWriter};
use inkling_io::verdict_arrays::VerdictArrays;
use inkling_io::verdict_table::{TableError, TableOptions, VerdictWriter};
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::Ordering;
use std::thread::{self, Scope, ScopedJoinHandle};

const QUEUE: usize = 4;
/// Maximum number of blocks between reader and writer, per worker of a parallel stage: one at work, one
/// waiting. More would only be further from the processor's caches.
const BLOCKS_PER_WORKER: usize = 2;
/// Maximum bytes of memory of the blocks between reader and writer. A larger block goes alone.
const MOST_BYTES: u64 = 64 << 20;

/// What the stages leave behind. The files are not complete yet, and do not have their names.
pub struct StageResults<'a> {
    pub judges: Judges<'a>,
    /// What the times of each printhead's bursts were worth.
    pub clocks: Vec<HeadClock>,
    pub tally: Tally,
    pub table: Table,
    /// The episodes, and their table; `None`: they are only listed.
    pub episodes: (EpisodeReport, Option<EpisodeWriter>),
    pub scan_damage: Vec<Damage>,
    pub timings: Vec<StageTiming>,
    pub digest: Digest,
    /// Printheads judged at temperatures that no model knows, and that were not followed.
    pub temperatures: TemperatureCheck,
    pub topics: TopicOverlap,
    /// How all channels of printheads moved together, where there is something to tell.
    pub moved: Vec<HeadMovement>,
    pub memory: Option<Memory>,
}

impl Run<'_> {
    /// Creates the tables that the writer appends to. `classes`: names of the fault classes.
    fn tables(&self, classes: &[String]) -> Result<Tables<'_>> {
        let output = &self.replay.settings.output;
        let timestamp_unit = output.timestamps;
        let of_episodes = self.verdicts.map(|verdicts| {
            let path = episode_table::path_beside(verdicts);
            EpisodeWriter::create(&path, timestamp_unit, &self.recording.label)
        });
        let episodes = EpisodeTap::create(self.replay, self.watch, of_episodes.transpose()?)?;
        let options = TableOptions {
            recording: self.recording.label.clone(),
            classes: classes.to_vec(),
            categories: categories(&self.replay.fault_classes()).0,
            weights: output.weights,
            timestamp_unit,
        };

        // without a path, the rows stay in memory
        let Some(verdicts) = self.verdicts else {
            let table = Table::Arrays(VerdictArrays::new(options));
            return Ok(Tables { episodes, table, rows: None });
        };

        let table = Table::File(VerdictWriter::create(verdicts, options)?);
        let rows = self.watch.and_then(|watch| watch.rows);
        Ok(Tables { episodes, table, rows })
    }

    /// Connects the six stages, runs them, and waits for all of them. The writer runs on the caller's thread.
    pub fn through_stages(&self) -> Result<StageResults<'_>> {
        let Run { replay, recording, control, .. } = *self;
        let settings = &replay.settings;

        // 1. what the writer and the identify stage work with
        let classes = replay.classes();
        let mut tables = self.tables(&classes)?;
        let mut tally = Tally::new(classes);
        // own levels rest on a head's common level
        let is_followed = replay.baselines.is_some() || settings.identify.common_change;
        let following = is_followed.then(|| Heads::new(replay));
        let mut deciding = JudgeAssignment {
            groups: Groups::default(),
            judges: Judges::new(replay, Pass { recording, control }),
            order: FileOrder::of(recording),
            clocks: Vec::new(),
            temperatures: TemperatureCheck::default(),
            topics: TopicOverlap::default(),
            following,
        };
        let workers = replay.workers();
        // blocks may define channels of later ones, and a pace is that of one reader
        let one_reader = self.pacer.is_some() || !recording.channels_known_upfront;
        let readers = if one_reader { 1 } else { workers };

        // 2. what the stages share
        let in_flight = InFlight::new(BLOCKS_PER_WORKER * (readers + 2 * workers), MOST_BYTES);
        let queue = BlockQueue::new(recording, &in_flight, control);
        let (timings, pools) = (Timings::default(), BufferPools::default());
        let names = ["reader", "identify", "filter", "gate", "isolate", "writer"];
        names.iter().for_each(|stage| timings.expect(stage));
        control.bytes_read.store(0, Ordering::Relaxed);
        control.abandoned.store(false, Ordering::Relaxed);

        // 3. the threads, which end before the scope does
        thread::scope(|scope| {
            let (to_identify, from_reader) = bounded(QUEUE);
            let (to_filter, from_identify) = bounded(QUEUE);
            let (queue, in_flight, pacer) = (&queue, &in_flight, self.pacer);
            let (timings, pools, deciding) = (&timings, &pools, &mut deciding);

            let mut running = RunningStages { scope, timings, in_flight, stages: Vec::new() };
            for _ in 0..readers {
                let out = to_identify.clone();
                running.start("reader", move |clock| stages::read(queue, pacer, clock, out));
            }
            // a queue ends when all its senders are gone: only the workers' own copies may remain
            drop(to_identify);
            let rails = settings.input.rails;
            running.start("identify", move |clock| {
                stages::identify(deciding, in_flight, clock, from_reader, to_filter)
            });
            let filter = move || stages::filter(rails, pools);
            let from_filter = running.start_each("filter", workers, from_identify, filter);
            let gate = move || move |batch| stages::gate(pools, batch);
            let from_gate = running.start_each("gate", 1, from_filter, gate);
            let isolate = move || stages::isolate(settings, pools);
            let from_isolate = running.start_each("isolate", workers, from_gate, isolate);

            // the writer, here
            let put = |judged: &mut JudgedBatch| {
                tables.write(judged)?;
                tally.add(judged);
                Ok(())
            };
            let clock = timings.clock("writer");
            let written = stages::write(clock, from_isolate, in_flight, pools, control, put);
            // a reader that waits for room or for more to be written must not wait for a writer that is gone
            control.abandoned.store(true, Ordering::Relaxed);
            in_flight.close();
            running.joined(written)
        })?;

        // 4. what is left behind
        let ((scan_damage, digest), timings) = (queue.finish()?, timings.stages());
        let Tables { episodes, table, .. } = tables;
        let JudgeAssignment { judges, clocks, mut temperatures, topics, following, .. } = deciding;
        let episodes = episodes.finish()?;
        // what temperature does to followed printheads is part of their level
        temperatures.forget(following.iter().flat_map(Heads::followed));

        Ok(StageResults {
            judges,
            clocks,
            tally,
            table,
            episodes,
            scan_damage,
            timings,
            digest,
            temperatures,
            topics,
            moved: following.as_ref().map_or(Vec::new(), Heads::movements),
            memory: following.as_ref().and_then(Heads::memory),
        })
    }
}

pub enum Table {
    File(VerdictWriter),
    Arrays(VerdictArrays),
}

impl Table {
    fn write(&mut self, of: &Verdicts) -> Result<(), TableError> {
        match self {
            Table::File(writer) => writer.write(of),
            Table::Arrays(arrays) => {
                arrays.write(of).map_err(TableError::columns("verdicts".as_ref()))
            }
        }
    }

    pub fn rows(&self) -> u64 {
        match self {
            Table::File(writer) => writer.rows,
            Table::Arrays(arrays) => arrays.rows,
        }
    }
}

struct Tables<'a> {
    episodes: EpisodeTap<'a>,
    table: Table,
    rows: Option<&'a (dyn Fn(&Verdicts) + Sync)>,
}

impl Tables<'_> {
    /// Episodes come first: they take what isolation says of flagged signals out of the batch.
    fn write(&mut self, judged: &mut JudgedBatch) -> Result<()> {
        if judged.verdicts.is_empty() {
            return Ok(());
        }
        self.episodes.add(judged)?;
        self.table.write(&judged.verdicts)?;
        if let Some(rows) = self.rows {
            rows(&judged.verdicts);
        }
        Ok(())
    }
}

struct RunningStages<'scope, 'env> {
    scope: &'scope Scope<'scope, 'env>,
    timings: &'scope Timings,
    in_flight: &'scope InFlight,
    stages: Vec<(&'static str, ScopedJoinHandle<'scope, Result<()>>)>,
}

impl<'scope> RunningStages<'scope, '_> {
    /// Starts a thread of a stage, with a clock for its timings. If the thread fails, no block that it
    /// had is ever written, so nobody may wait for room any more.
    fn start(
        &mut self,
        stage: &'static str,
        work: impl FnOnce(Clock<'scope>) -> Result<()> + Send + 'scope,
    ) {
        let (timings, in_flight) = (self.timings, self.in_flight);
        let thread = move || {
            let done = catch_unwind(AssertUnwindSafe(|| work(timings.clock(stage))));
            if !matches!(done, Ok(Ok(()))) {
                in_flight.close();
            }
            done.unwrap_or_else(|panic| resume_unwind(panic))
        };
        self.stages.push((stage, self.scope.spawn(thread)));
    }

    /// `turn` makes what turns batches into those of the next stage. Returns the queue of the turned batches.
    fn start_each<A, B, T>(
        &mut self,
        stage: &'static str,
        workers: usize,
        input: Receiver<A>,
        turn: impl Fn() -> T + Copy + Send + 'scope,
    ) -> Receiver<B>
    where
        A: Send + 'scope,
        B: Send + 'scope,
        T: FnMut(A) -> B,
    {
        let (out, turned) = bounded(QUEUE);
        for _ in 0..workers {
            let (input, out) = (input.clone(), out.clone());
            self.start(stage, move |clock| stages::each(clock, input, out, turn()));
        }
        turned
    }

    /// Waits for all threads. Of several errors the writer's own is returned, else that of the first stage.
    fn joined(self, written: Result<()>) -> Result<()> {
        let mut outcome = written;
        for (stage, thread) in self.stages {
            outcome = outcome.and(thread.join().unwrap_or(Err(PipelineError::Panicked(stage))));
        }
        outcome
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_worker_that_fails_ends_all_waiting_for_room() {
        let failing: [fn() -> Result<()>; 2] =
            [|| panic!("on purpose"), || Err(PipelineError::Interrupted)];
        for fail in failing {
            let (in_flight, timings) = (InFlight::new(1, 100), Timings::default());
            assert!(in_flight.enter(10));
            let in_flight = &in_flight;
            let outcome = thread::scope(|scope| {
                let stages = Vec::new();
                let mut running = RunningStages { scope, timings: &timings, in_flight, stages };
                // there is no room, and nobody takes the first block out
                running.start("reader", move |_| {
                    assert!(!in_flight.enter(10));
                    Ok(())
                });
                running.start("filter", move |_| fail());
                running.joined(Ok(()))
            });
            assert!(matches!(
                outcome,
                Err(PipelineError::Panicked("filter") | PipelineError::Interrupted)
            ));
        }
    }
}
