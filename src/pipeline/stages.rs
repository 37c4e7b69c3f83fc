//! The six stages: thin loops over batches. What each does to a signal stands in its room.
//!
//! A stage ends when its input does; a peer that has gone away ends it quietly, because the peer
//! has the cause.

use super::batches::{
    AssignedBatch, AssignedJudge, AssignedJudges, FilteredBatch, GatedBatch, JudgedBatch,
    MOST_ROWS, ReadBatch, Slot,
};
use super::buffer_pools::BufferPools;
use super::heads::Heads;
use super::in_flight::InFlight;
use super::in_order::InOrder;
use super::isolator::Isolator;
use super::models::Models;
use super::own_levels::OwnLevels;
use super::pacer::Pacer;
use super::parked::ParkedBatches;
use super::statistics::Statistics;
use super::temperature_check::TemperatureCheck;
use super::timings::Clock;
use super::{Control, PipelineError, rows};
use crossbeam_channel::{Receiver, Sender};
use inkling_core::burst::{Acquisition, Place, SignalBatch};
use inkling_io::block::{Block, ReadBlock};
use inkling_io::damage::{Damage, note};
use inkling_io::digest::{Digest, Digester};
use inkling_io::recording::Recording;
use inkling_io::scan::Blocks;
use std::sync::atomic::Ordering;
use std::sync::{Mutex, PoisonError};

/// Hands out blocks in file order to the reader's workers, with their bytes: one after the other, so
/// that the digest sees them on the way.
pub struct BlockQueue<'a> {
    recording: &'a Recording,
    queue: Mutex<Queue>,
}

struct Queue {
    blocks: Blocks,
    damage: Vec<Damage>,
    digester: Digester,
}

impl<'a> BlockQueue<'a> {
    pub fn new(recording: &'a Recording) -> BlockQueue<'a> {
        let (blocks, digester) = (recording.blocks(), recording.digester());
        BlockQueue { recording, queue: Mutex::new(Queue { blocks, damage: Vec::new(), digester }) }
    }

    /// The next block, once there is room for it in flight.
    pub(super) fn next(
        &self,
        in_flight: &InFlight,
        control: &Control,
        clock: &mut Clock,
    ) -> Result<Option<(Block, Option<ReadBlock>)>, PipelineError> {
        let mut queue = clock.blocked(|| self.queue.lock().unwrap_or_else(PoisonError::into_inner));
        loop {
            match control.next_block(self.recording, &mut queue.blocks)? {
                None => return Ok(None),
                Some(Err(damage)) => note(&mut queue.damage, damage),
                Some(Ok(block)) => {
                    if !clock.blocked(|| in_flight.enter(block.bytes)) {
                        return Ok(None);
                    }
                    let read = queue.digester.read(&block, || control.check())?;
                    return Ok(Some((block, read)));
                }
            }
        }
    }

    /// What the scan could not frame, and the digest of the whole file.
    pub fn finish(self, control: &Control) -> Result<(Vec<Damage>, Digest), PipelineError> {
        let Queue { damage, digester, .. } =
            self.queue.into_inner().unwrap_or_else(PoisonError::into_inner);
        Ok((damage, digester.finish(|| control.check())?))
    }
}

/// 1. Reader: blocks to batches.
pub fn read(
    recording: &Recording,
    queue: &BlockQueue,
    in_flight: &InFlight,
    pacer: Option<&Mutex<Pacer>>,
    control: &Control,
    mut clock: Clock,
    out: Sender<ReadBatch>,
) -> Result<(), PipelineError> {
    let mut reader = recording.reader();
    let mut pacer = pacer.map(|pacer| pacer.lock().unwrap_or_else(PoisonError::into_inner));
    while let Some((block, read)) = queue.next(in_flight, control, &mut clock)? {
        reader.load_read(&block, read);
        let mut place = Place { block: block.index, piece: 0 };
        while let Some(piece) =
            reader.next_piece(pacer.as_ref().map_or(MOST_ROWS, |pacer| pacer.rows()))
        {
            control.check()?;
            let batch = SignalBatch { place, acquisitions: piece.acquisitions };
            if let Some(pacer) = &mut pacer {
                pacer.wait_for(&batch, control)?;
            }
            place.piece += 1;
            let leaves = piece.last.then_some(block.bytes);
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

/// 2. Identify: the model of every burst, learned on the way where windows decide, and what its head and channels are
///    known to be then. A burst waits until its sweep is over.
pub fn identify(
    mut deciding: JudgeAssignment,
    parked: ParkedBatches,
    mut clock: Clock,
    input: Receiver<ReadBatch>,
    out: Sender<AssignedBatch>,
) -> Result<(), PipelineError> {
    let (mut waiting, mut parked) = (InOrder::new(), parked);
    let mut given = AssignedJudges::new();
    while let Some(read) = clock.receive(&input) {
        waiting.put(read.batch.place, read);
        while let Some(read) = waiting.take(|read| read.leaves.is_some()) {
            deciding.models.see(&read)?;
            deciding.decide(parked.next(), &read.batch, &mut given)?;
            parked.park(read);
            parked.give(&mut given);
            while let Some(assigned) = parked.leave() {
                if !clock.send(&out, assigned) {
                    return Ok(());
                }
            }
        }
    }
    if let Some(heads) = &mut deciding.following {
        heads.end(&mut given);
    }
    parked.give(&mut given);
    while let Some(assigned) = parked.leave() {
        if !clock.send(&out, assigned) {
            return Ok(());
        }
    }
    deciding.models.end()
}

/// Assigns each burst its judge, and says who follows the heads meanwhile.
pub struct JudgeAssignment<'a, 'm, 'd> {
    pub models: &'a mut Models<'m>,
    pub temperatures: &'a mut TemperatureCheck,
    /// `None`: each signal is judged by the models as they are.
    pub following: Option<&'a mut Heads<'d>>,
}

impl JudgeAssignment<'_, '_, '_> {
    /// `number`: of the batch.
    fn decide(
        &mut self,
        number: u64,
        batch: &SignalBatch,
        given: &mut AssignedJudges,
    ) -> Result<(), PipelineError> {
        for (place, acquisition) in batch.acquisitions.iter().enumerate() {
            let slot = Slot { batch: number, place };
            let judge = match acquisition {
                Acquisition::Unusable(unusable) => Err(unusable.why.into()),
                Acquisition::Usable(burst) => self.models.judge_of(burst)?,
            };
            match (judge, acquisition, &mut self.following) {
                (Ok(judge), Acquisition::Usable(burst), following) => {
                    self.temperatures.take(&judge, burst);
                    match following {
                        Some(heads) => heads.take(slot, &judge, burst, given),
                        None => given.push((slot, AssignedJudge::by(Ok(judge)))),
                    }
                }
                (judge, ..) => given.push((slot, AssignedJudge::by(judge))),
            }
        }
        Ok(())
    }
}

/// 3. FD filter: the detection statistics of every signal; with `residual-energy` thesis e(r).
pub fn filter(
    rails: [f64; 2],
    pools: &BufferPools,
    mut clock: Clock,
    input: Receiver<AssignedBatch>,
    out: Sender<FilteredBatch>,
) -> Result<(), PipelineError> {
    let (mut statistics, mut levels) = (Statistics::new(rails), OwnLevels::default());
    while let Some(assigned) = clock.receive(&input) {
        let mut statistic = pools.statistic.take();
        let AssignedBatch { read, judges, own } = &assigned;
        let acquisitions = &read.batch.acquisitions;
        statistics.of(acquisitions, judges, &mut statistic);
        levels.judge(acquisitions, judges, own, &mut statistics, &mut statistic);
        if !clock.send(&out, FilteredBatch { assigned, statistic }) {
            break;
        }
    }
    Ok(())
}

/// 4. Energy gate: e <= threshold is healthy, thesis f after (3-4). What it says of a healthy signal is what the table
///    says of it: nothing behind it touches that signal again before the page.
pub fn gate(
    pools: &BufferPools,
    mut clock: Clock,
    input: Receiver<FilteredBatch>,
    out: Sender<GatedBatch>,
) -> Result<(), PipelineError> {
    while let Some(filtered) = clock.receive(&input) {
        let mut tests = pools.tests.take();
        tests.clear();
        tests.reserve(filtered.statistic.len());
        let assigned = &filtered.assigned;
        let mut from = 0;
        for (acquisition, judge) in assigned.read.batch.acquisitions.iter().zip(&assigned.judges) {
            let to = from + acquisition.rows();
            rows::test(judge.as_deref().ok(), &filtered.statistic[from..to], &mut tests);
            from = to;
        }
        if !clock.send(&out, GatedBatch { filtered, tests }) {
            break;
        }
    }
    Ok(())
}

/// 5. Isolate: names for what passed the gate, and every signal's row.
pub fn isolate(
    mut isolator: Isolator,
    mut clock: Clock,
    input: Receiver<GatedBatch>,
    out: Sender<JudgedBatch>,
) -> Result<(), PipelineError> {
    while let Some(gated) = clock.receive(&input) {
        if !clock.send(&out, isolator.judge(gated)) {
            break;
        }
    }
    Ok(())
}

/// 6. Writer: rows in the recording's order.
pub fn write(
    mut clock: Clock,
    input: Receiver<JudgedBatch>,
    in_flight: &InFlight,
    pools: &BufferPools,
    control: &Control,
    mut put: impl FnMut(&mut JudgedBatch) -> Result<(), PipelineError>,
) -> Result<(), PipelineError> {
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
            pools.tests.give(judged.verdicts.tests);
            pools.rows.give(judged.verdicts.rows);
        }
    }
    Ok(())
}
