//! The six stages, as thin loops over batches. What a stage does to a signal stands in the module that it
//! calls.
//!
//! In: for each stage its queues, from `wiring`, which runs each on a thread, several where a stage does not
//! depend on order (reader, filter, isolate). Out: batches, each of which knows more than before (`batches`).
//!
//! Two stages need the recording's order, and put batches back into it ([`InOrder`]): identify, since the state of
//! heads and channels is learned in that order, and the writer. So the number of threads changes nothing.
//!
//! A stage ends when its input does, or without an error if the next stage, which reports the cause, is gone.

use super::batches::{
    AssignedBatch, AssignedJudge, AssignedJudges, BufferPools, FilteredBatch, GatedBatch,
    JudgedBatch, MOST_ROWS, ReadBatch, Slot,
};
use super::groups::{GroupKey, Groups};
use super::head_clock::{FileOrder, HeadClock, Standing};
use super::heads::{Heads, Heard};
use super::in_flight::{InFlight, InOrder, ParkedBatches};
use super::isolator::Isolator;
use super::judges::Judges;
use super::own_levels::OwnLevels;
use super::pacer::Pacer;
use super::statistics::Statistics;
use super::temperature_check::TemperatureCheck;
use super::timings::Clock;
use super::topic_overlap::TopicOverlap;
use super::{Control, Result, locked, rows};
use crate::settings::Settings;
use crossbeam_channel::{Receiver, Sender};
use inkling_core::burst::{Acquisition, Burst, Place, SignalBatch};
use inkling_core::verdict::Reason;
use inkling_io::block::{Block, ReadBlock};
use inkling_io::damage::{Damage, note};
use inkling_io::digest::{Digest, Digester};
use inkling_io::recording::Recording;
use inkling_io::scan::Blocks;
use std::sync::atomic::Ordering;
use std::sync::{Mutex, PoisonError};

/// Hands out blocks in file order to the workers of the reader stage, one after the other, so that the bytes
/// pass through the digest in order. Decoding, which costs more, is done by the workers side by side.
pub struct BlockQueue<'a> {
    recording: &'a Recording,
    in_flight: &'a InFlight,
    control: &'a Control,
    queue: Mutex<Queue>,
}

/// What the workers of the reader stage share, under a lock.
struct Queue {
    blocks: Blocks,
    damage: Vec<Damage>,
    digester: Digester,
}

impl<'a> BlockQueue<'a> {
    pub fn new(
        recording: &'a Recording,
        in_flight: &'a InFlight,
        control: &'a Control,
    ) -> BlockQueue<'a> {
        let (blocks, digester) = (recording.blocks(), recording.digester());
        let queue = Mutex::new(Queue { blocks, damage: Vec::new(), digester });
        BlockQueue { recording, in_flight, control, queue }
    }

    /// The next block and its bytes, once there is room for it in flight. `None`: there is no more, or nobody
    /// wants it. `None` as bytes: the digest did not read them, and the reader does.
    pub(super) fn next(&self, clock: &mut Clock) -> Result<Option<(Block, Option<ReadBlock>)>> {
        let mut queue = clock.blocked(|| locked(&self.queue));
        loop {
            match self.control.next_block(self.recording, &mut queue.blocks)? {
                None => return Ok(None),
                // bytes that frame no block are noted, and reading goes on behind them
                Some(Err(damage)) => note(&mut queue.damage, damage),
                Some(Ok(block)) => {
                    // The lock is held while waiting for room, so that blocks enter in file order.
                    if !clock.blocked(|| self.in_flight.enter(block.held_bytes())) {
                        return Ok(None);
                    }
                    let read = queue.digester.read(&block, || self.control.check())?;
                    return Ok(Some((block, read)));
                }
            }
        }
    }

    /// The damage that the scan of the file met, and the digest of the whole file.
    pub fn finish(self) -> Result<(Vec<Damage>, Digest)> {
        let Queue { damage, digester, .. } =
            self.queue.into_inner().unwrap_or_else(PoisonError::into_inner);
        Ok((damage, digester.finish(|| self.control.check())?))
    }
}

/// Stage 1, reader: decodes blocks into batches. With a pacer, a batch is handed on when it is due.
/// `clock` measures, here and in the other stages, how long the stage works and waits (`timings`).
pub fn read(
    queue: &BlockQueue,
    pacer: Option<&Mutex<Pacer>>,
    mut clock: Clock,
    out: Sender<ReadBatch>,
) -> Result<()> {
    let (control, mut reader) = (queue.control, queue.recording.reader());
    // a paced recording has one reader, which holds the pacer for as long as it runs
    let mut pacer = pacer.map(locked);

    while let Some((block, read)) = queue.next(&mut clock)? {
        reader.load_read(&block, read);
        let mut place = Place { block: block.index, piece: 0 };
        while let Some(piece) = reader.next_piece(pacer.as_ref().map_or(MOST_ROWS, |p| p.rows)) {
            control.check()?;
            let batch = SignalBatch { place, acquisitions: piece.acquisitions };
            if let Some(pacer) = &mut pacer {
                pacer.wait_for(&batch, control)?;
            }
            place.piece += 1;
            let leaves = piece.last.then(|| block.held_bytes());
            clock.count();
            let definitions = reader.definitions();
            let read = ReadBatch { batch, block, definitions, leaves, damage: piece.damage };
            if !clock.send(&out, read) {
                return Ok(());
            }
        }
        control.bytes_read.fetch_max(block.offset + block.bytes, Ordering::Relaxed);
    }
    Ok(())
}

/// Stage 2, identify: finds the judge of every burst, from a healthy window where no design knows its printhead
/// (thesis 3-1), and follows the head and its channels from there. A burst waits until its sweep is over (`sweep`), and
/// its batch until all of its bursts have judges. Batches leave in the recording's order. The only stage with a state; it has one worker.
pub fn identify(
    deciding: &mut JudgeAssignment,
    in_flight: &InFlight,
    mut clock: Clock,
    input: Receiver<ReadBatch>,
    out: Sender<AssignedBatch>,
) -> Result<()> {
    // `waiting`: batches before their turn; `parked`: batches after it, of which some bursts have no judge yet;
    // `given`: what judges bursts whose sweeps have just ended
    let (mut waiting, mut parked) = (InOrder::new(), ParkedBatches::new(in_flight));
    let mut given = AssignedJudges::new();
    while let Some(read) = clock.receive(&input) {
        waiting.put(read.batch.place, read);
        while let Some(read) = waiting.take(|read| read.leaves.is_some()) {
            deciding.decide(parked.next(), &read, &mut given)?;

            // where nobody waits for a sweep, the batch is handed out again at once
            parked.park(read);
            if !parked.give(&mut given).all(|assigned| clock.send(&out, assigned)) {
                return Ok(());
            }
        }
    }

    if let Some(heads) = &mut deciding.following {
        heads.end(&mut given);
    }
    let _ = parked.give(&mut given).all(|assigned| clock.send(&out, assigned));
    Ok(())
}

/// Samples that an unusable burst counts for while it waits behind others, since nobody knows how many it has: it keeps
/// a message of the file in memory.
const OF_UNUSABLE: u64 = 1 << 12;

/// Assigns each burst its judge, checks its time, and follows the printheads where that is asked for.
pub struct JudgeAssignment<'a> {
    pub groups: Groups,
    pub judges: Judges<'a>,
    pub order: FileOrder,
    /// By the number of the group.
    pub clocks: Vec<HeadClock>,
    pub temperatures: TemperatureCheck,
    pub topics: TopicOverlap,
    /// Follows the heads; `None`: each signal is judged by the models as they are.
    pub following: Option<Heads<'a>>,
}

impl JudgeAssignment<'_> {
    /// Assigns the bursts of batch `number` their judges, and appends these to `given`. The judges of bursts
    /// that wait for the end of a sweep are appended by a later call, or by `Heads::end`.
    fn decide(&mut self, number: u64, read: &ReadBatch, given: &mut AssignedJudges) -> Result<()> {
        for (place, acquisition) in read.batch.acquisitions.iter().enumerate() {
            let slot = Slot { batch: number, place, standing: Standing::InOrder };
            match acquisition {
                Acquisition::Unusable(unusable) => {
                    given.push((slot, AssignedJudge::new(Err(unusable.why))));
                    self.following.iter_mut().for_each(|heads| heads.count(OF_UNUSABLE, given));
                }
                Acquisition::Usable(burst) => self.decide_on(slot, burst, read, given)?,
            }
        }
        Ok(())
    }

    fn decide_on(
        &mut self,
        slot: Slot,
        burst: &Burst,
        read: &ReadBatch,
        given: &mut AssignedJudges,
    ) -> Result<()> {
        let Some(group) = self.groups.of(burst) else {
            // beyond so many groups nobody learns any more
            given.push((slot, AssignedJudge::new(Err(Reason::NoModel))));
            let samples = u64::from(burst.channels) * u64::from(burst.samples_per_channel);
            self.following.iter_mut().for_each(|heads| heads.count(samples, given));
            return Ok(());
        };
        let judge = self.judges.of(group, &self.groups, burst, read)?;
        let standing = self.clock(group, burst).hear(burst);
        self.topics.hear(group, burst);
        let slot = Slot { standing, ..slot };
        if let Some(heads) = &mut self.following {
            heads.hear(group, burst, given);
        }
        if let Ok(judge) = &judge {
            self.temperatures.take(judge, burst);
            if let Some(heads) = &mut self.following {
                // the judge is given when the sweep is over, moved to where the head is then
                heads.take(group, Heard { slot, burst }, judge, given);
                return Ok(());
            }
        }
        given.push((slot, AssignedJudge::new(judge)));
        Ok(())
    }

    fn clock(&mut self, group: usize, burst: &Burst) -> &mut HeadClock {
        let new = || HeadClock::new(GroupKey::of(burst), self.order);
        if group >= self.clocks.len() {
            self.clocks.push(new()); // groups are numbered as they are met
        }
        &mut self.clocks[group]
    }
}

/// Runs a stage, 3 to 5, that by `turn` makes of each batch one of the next stage.
pub fn each<A, B>(
    mut clock: Clock,
    input: Receiver<A>,
    out: Sender<B>,
    mut turn: impl FnMut(A) -> B,
) -> Result<()> {
    while let Some(batch) = clock.receive(&input) {
        if !clock.send(&out, turn(batch)) {
            break;
        }
    }
    Ok(())
}

/// Stage 3, FD filter: computes the detection statistics of every signal; with `detect.method` =
/// `residual-energy` thesis e(r). `rails`: limits of the converter, counts.
pub fn filter(rails: [f64; 2], pools: &BufferPools) -> impl FnMut(AssignedBatch) -> FilteredBatch {
    let (mut statistics, mut levels) = (Statistics::new(rails), OwnLevels::default());
    move |assigned| {
        let mut statistic = pools.statistic.take();
        statistics.of(&assigned, &mut statistic);
        levels.judge(&assigned, &mut statistics.distances, &mut statistic);
        FilteredBatch { assigned, statistic }
    }
}

/// Stage 4, gate: a signal whose statistic is not above its threshold is healthy, thesis f after (3-4). Unless
/// `isolate.gate` is off or `output.ring` is `all`, no later stage computes anything for that signal.
pub fn gate(pools: &BufferPools, filtered: FilteredBatch) -> GatedBatch {
    let mut tests = pools.tests.take();
    tests.clear();
    for (signals, _, of) in filtered.assigned.placed() {
        rows::test(of.judge.as_deref().ok(), &filtered.statistic[signals], &mut tests);
    }
    GatedBatch { filtered, tests }
}

/// Stage 5, isolate: names the faults of what passed the gate, and makes every signal's row.
pub fn isolate<'a>(
    settings: &'a Settings,
    pools: &'a BufferPools,
) -> impl FnMut(GatedBatch) -> JudgedBatch {
    let mut isolator = Isolator::new(settings, pools);
    move |gated| isolator.judge(gated)
}

/// Stage 6, writer: hands the verdicts to `put`, which writes and counts them, in the recording's order, and
/// takes finished blocks out of flight.
pub fn write(
    mut clock: Clock,
    input: Receiver<JudgedBatch>,
    in_flight: &InFlight,
    pools: &BufferPools,
    control: &Control,
    mut put: impl FnMut(&mut JudgedBatch) -> Result<()>,
) -> Result<()> {
    let mut waiting = InOrder::new();
    while let Some(judged) = clock.receive(&input) {
        control.check()?;
        waiting.put(judged.place, judged);
        while let Some(mut judged) = waiting.take(|judged| judged.leaves.is_some()) {
            put(&mut judged)?;
            control.signals.fetch_add(judged.verdicts.len() as u64, Ordering::Relaxed);
            if let Some(bytes) = judged.leaves {
                in_flight.leave(bytes);
            }
            // the buffers go back to the stages that fill them
            pools.tests.give(judged.verdicts.tests);
            pools.rows.give(judged.verdicts.rows);
        }
    }
    Ok(())
}
