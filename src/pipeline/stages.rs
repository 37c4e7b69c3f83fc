//! The six stages: thin loops over batches. What each does to a signal stands in its room.
//!
//! A stage ends when its input does; a peer that has gone away ends it quietly, because the peer
//! has the cause.

use super::baseline::InUse;
use super::follow::Heads;
use super::in_flight::InFlight;
use super::rings::{self, Rings};
use super::schedule::{Assignment, Schedule};
use super::spares::Spares;
use super::statistics::Statistics;
use super::tally::Tally;
use super::timings::Clock;
use super::warmth::Warmth;
use super::{Control, PipelineError, rows};
use crate::burst::{Acquisition, Place, SignalBatch};
use crate::design::{Detection, Isolation, Judge, Workspace};
use crate::io::digest::{Digest, Digester, ReadBlock};
use crate::io::recording::{Damage, Recording, note};
use crate::io::scan::{Block, Blocks};
use crate::isolate::Likeness;
use crate::settings::Settings;
use crate::verdict::{Appearance, Reason, VerdictColumns};
use crossbeam_channel::{Receiver, Sender};
use std::collections::BTreeMap;
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// A block's batch on its way, with what it takes up in flight and what was lost in it.
#[derive(Debug)]
pub struct Read {
    pub batch: SignalBatch,
    /// The last batch of a block: these bytes leave the house with it.
    pub leaves: Option<u64>,
    pub damage: Vec<Damage>,
}

/// With the judge of every acquisition.
#[derive(Debug)]
pub struct Assigned {
    pub read: Read,
    pub judges: Vec<Result<Arc<Judge>, Reason>>,
}

/// With every signal's statistics, or why it has none.
#[derive(Debug)]
pub struct Filtered {
    pub assigned: Assigned,
    pub statistic: Vec<Result<Detection, Reason>>,
}

/// With the rows that are to be isolated.
#[derive(Debug)]
pub struct Gated {
    pub filtered: Filtered,
    pub passed: Vec<bool>,
}

/// Rows, ready to be written.
#[derive(Debug)]
pub struct Judged {
    pub place: Place,
    pub leaves: Option<u64>,
    pub damage: Vec<Damage>,
    pub columns: VerdictColumns,
    /// Of its flagged rows, ascending: what one row of a table has no room for.
    pub flagged: Vec<Flagged>,
    pub bursts: u64,
}

/// What isolation says of a flagged signal, for the evidence over time.
#[derive(Debug)]
pub struct Flagged {
    pub row: u32,
    /// Per class; empty: nothing was said.
    pub weights: Vec<f32>,
    /// [`Workspace::ring`]
    pub ring: Option<[f64; 2]>,
    /// Of what belongs to no class.
    pub appearance: Option<Appearance>,
}

/// Hands out blocks in file order to the reader's workers, with their bytes: one after the other, so
/// that the digest sees them on the way.
pub struct BlockQueue {
    queue: Mutex<Queue>,
}

struct Queue {
    blocks: Blocks,
    damage: Vec<Damage>,
    digester: Digester,
}

impl BlockQueue {
    pub fn new(recording: &Recording) -> BlockQueue {
        let (blocks, digester) = (recording.blocks(), recording.digester());
        BlockQueue { queue: Mutex::new(Queue { blocks, damage: Vec::new(), digester }) }
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
            match queue.blocks.next() {
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

/// Replays at the recorded speed: waits until a batch's last burst would have been there.
#[derive(Debug)]
pub struct Pacer {
    started: Instant,
    first_ns: Option<i64>,
    /// How far behind it ever was.
    pub behind: Duration,
}

impl Pacer {
    pub fn new() -> Pacer {
        Pacer { started: Instant::now(), first_ns: None, behind: Duration::ZERO }
    }

    fn wait_for(&mut self, batch: &SignalBatch, control: &Control) -> Result<(), PipelineError> {
        let times = batch.acquisitions.iter().filter_map(|a| match a {
            Acquisition::Usable(b) => Some(b.t_acq_ns),
            Acquisition::Unusable(_) => None,
        });
        let Some((first, last)) = times.fold(None, |span: Option<(i64, i64)>, t| {
            Some(span.map_or((t, t), |(from, to)| (from.min(t), to.max(t))))
        }) else {
            return Ok(());
        };
        let origin = *self.first_ns.get_or_insert(first);
        let due = Duration::from_nanos(last.saturating_sub(origin).max(0) as u64);
        loop {
            control.check()?;
            let now = self.started.elapsed();
            if now >= due {
                self.behind = self.behind.max(now - due);
                return Ok(());
            }
            std::thread::sleep((due - now).min(Duration::from_millis(100)));
        }
    }
}

/// 1. Reader: blocks to batches.
pub fn read(
    recording: &Recording,
    queue: &BlockQueue,
    in_flight: &InFlight,
    mut pacer: Option<&mut Pacer>,
    control: &Control,
    mut clock: Clock,
    out: Sender<Read>,
) -> Result<(), PipelineError> {
    /// Rows of a batch: enough to make a channel's cost vanish, few enough to bound memory.
    const MOST_ROWS: usize = 32_768;
    let mut reader = recording.reader();
    while let Some((block, read)) = queue.next(in_flight, control, &mut clock)? {
        reader.load_read(&block, read);
        let mut place = Place { block: block.index, piece: 0 };
        while let Some(piece) = reader.next_piece(MOST_ROWS) {
            control.check()?;
            let batch = SignalBatch { place, acquisitions: piece.acquisitions };
            if let Some(pacer) = pacer.as_deref_mut() {
                pacer.wait_for(&batch, control)?;
            }
            place.piece += 1;
            let leaves = piece.last.then_some(block.bytes);
            clock.count();
            if !clock.send(&out, Read { batch, leaves, damage: piece.damage }) {
                return Ok(());
            }
        }
        control.bytes_read.fetch_add(block.bytes, Ordering::Relaxed);
    }
    Ok(())
}

/// 2. Identify: the model of every burst, from the windows learned before.
pub fn identify(
    schedule: &Schedule,
    warmth: &mut Warmth,
    heads: &mut Heads,
    mut clock: Clock,
    input: Receiver<Read>,
    out: Sender<Assigned>,
) -> Result<(), PipelineError> {
    while let Some(read) = clock.receive(&input) {
        let mut judges = Vec::with_capacity(read.batch.acquisitions.len());
        for acquisition in &read.batch.acquisitions {
            judges.push(match acquisition {
                Acquisition::Unusable(unusable) => Err(unusable.why.into()),
                Acquisition::Usable(burst) => match schedule.assign(burst) {
                    Assignment::Judge(judge) => {
                        warmth.take(judge, burst)?;
                        Ok(heads.follow(judge, burst))
                    }
                    Assignment::Reject(reason) => Err(reason),
                    Assignment::Survey => return Err(PipelineError::NeedsSurvey),
                },
            });
        }
        if !clock.send(&out, Assigned { read, judges }) {
            break;
        }
    }
    Ok(())
}

/// 3. FD filter: the residual energy of every signal, thesis e(r).
pub fn filter(
    rails: [f64; 2],
    baselines: Option<&InUse>,
    spares: &Spares,
    mut clock: Clock,
    input: Receiver<Assigned>,
    out: Sender<Filtered>,
) -> Result<(), PipelineError> {
    let mut statistics = Statistics::new(rails);
    while let Some(assigned) = clock.receive(&input) {
        let mut statistic = spares.statistic.take();
        statistics.of(&assigned, &mut statistic);
        if let Some(baselines) = baselines {
            baselines.sharpen(&assigned, &mut statistics, &mut statistic);
        }
        if !clock.send(&out, Filtered { assigned, statistic }) {
            break;
        }
    }
    Ok(())
}

/// 4. Energy gate: e <= threshold is healthy, thesis f after (3-4).
pub fn gate(
    spares: &Spares,
    mut clock: Clock,
    input: Receiver<Filtered>,
    out: Sender<Gated>,
) -> Result<(), PipelineError> {
    while let Some(filtered) = clock.receive(&input) {
        let mut passed = spares.passed.take();
        passed.clear();
        passed.reserve(filtered.statistic.len());
        let mut rows = filtered.statistic.iter();
        let assigned = &filtered.assigned;
        for (acquisition, judge) in assigned.read.batch.acquisitions.iter().zip(&assigned.judges) {
            let rows = rows.by_ref().take(acquisition.rows());
            match judge {
                Ok(judge) => {
                    passed.extend(rows.map(|e| e.is_ok_and(|found| judge.is_flagged(found))))
                }
                Err(_) => passed.extend(rows.map(|_| false)),
            }
        }
        if !clock.send(&out, Gated { filtered, passed }) {
            break;
        }
    }
    Ok(())
}

/// 5. Isolate: names for what passed the gate, and every signal's row.
pub fn isolate(
    settings: &Settings,
    baselines: Option<&InUse>,
    spares: &Spares,
    mut clock: Clock,
    input: Receiver<Gated>,
    out: Sender<Judged>,
) -> Result<(), PipelineError> {
    let mut work = Workspace::default();
    let (mut signal, mut expected) = (Vec::new(), Vec::new());
    let mut rings = Rings::default();
    while let Some(gated) = clock.receive(&input) {
        rings.fit(&gated, !settings.isolate.gate);
        let Gated { filtered, passed } = gated;
        let Filtered { assigned: Assigned { read, judges }, statistic } = filtered;
        let mut columns = spares.columns.take();
        columns.clear();
        columns.reserve(read.batch.rows());
        let mut flagged = Vec::new();
        let mut row = 0;
        for (acquisition, judge) in read.batch.acquisitions.iter().zip(&judges) {
            match acquisition {
                Acquisition::Unusable(u) => {
                    let printhead = rows::intern(&mut columns, &u.printhead);
                    rows::push_rejected(
                        &mut columns,
                        (u.t_acq_ns, printhead, u.first_channel),
                        u.why.into(),
                    );
                    row += 1;
                }
                Acquisition::Usable(burst) => {
                    let printhead = rows::intern(&mut columns, &burst.printhead);
                    let mut expected_ready = false;
                    let rows = row..row + burst.channels as usize;
                    let isolates_all =
                        !settings.isolate.gate && judge.as_ref().is_ok_and(|j| j.can_isolate());
                    let mut k = 0;
                    while k < burst.channels {
                        // what passed no gate and is not isolated: row after row alike
                        let healthy = match judge {
                            Ok(judge) if !isolates_all => rows::push_healthy(
                                &mut columns,
                                (burst.t_acq_ns, printhead, burst.first_channel + k),
                                &statistic[row..rows.end],
                                &passed[row..rows.end],
                                judge,
                            ),
                            _ => 0,
                        };
                        row += healthy;
                        k += healthy as u32;
                        if k == burst.channels {
                            break;
                        }
                        let (at, gated) = (k, passed[row]);
                        k += 1;
                        let id = (burst.t_acq_ns, printhead, burst.first_channel + at);
                        let verdict =
                            statistic[row].and_then(|e| Ok((e, judge.as_ref().map_err(|r| *r)?)));
                        row += 1;
                        let (found, judge) = match verdict {
                            Ok(judged) => judged,
                            Err(reason) => {
                                rows::push_rejected(&mut columns, id, reason);
                                continue;
                            }
                        };
                        let isolates = judge.can_isolate() && (gated || !settings.isolate.gate);
                        let isolation = if !isolates {
                            None
                        } else {
                            work.own = baselines.and_then(|b| b.of(burst, at));
                            work.warmer = judge.warmer(burst);
                            let drive = judge.drive(burst);
                            match judge.rings().and_then(|_| rings.take()) {
                                Some(fit) => {
                                    let copy = |y: &mut Vec<f64>| {
                                        y.resize(burst.samples_per_channel as usize, 0.0);
                                        rings::per_drive(judge, burst, at as usize, y);
                                    };
                                    judge.isolate_ring(fit.as_ref(), drive, copy, &mut work)
                                }
                                None => {
                                    let n = burst.samples_per_channel as usize;
                                    signal.resize(n, 0.0);
                                    if !expected_ready {
                                        expected.resize(n, 0.0);
                                        judge.expect(burst, &mut expected);
                                        expected_ready = true;
                                    }
                                    burst.copy_signal(at as usize, &mut signal);
                                    judge.deviate(burst, at as usize, &expected, &mut signal);
                                    judge.isolate(&signal, drive, &mut work)
                                }
                            }
                        };
                        let mut tested = judge.test(found);
                        // along the ring it is healthy: what else it holds is none of a fault's
                        let isolation = match gated && !judge.is_faulty_ring(found) {
                            true => {
                                work.severity = None;
                                work.weights.clear();
                                Some(Isolation::of_no_ring())
                            }
                            false => isolation,
                        };
                        if tested.misfit.is_nan() && isolation.is_some() {
                            tested.misfit = work.misfit;
                        }
                        if gated && let Some(isolation) = &isolation {
                            let strange = isolation.likeness != Likeness::Known;
                            let appearance = strange.then(|| {
                                signal.resize(burst.samples_per_channel as usize, 0.0);
                                rings::per_drive(judge, burst, at as usize, &mut signal);
                                judge.appearance(&signal, judge.drive(burst), &mut work)
                            });
                            flagged.push(Flagged {
                                appearance: appearance.flatten(),
                                row: columns.len() as u32, // a batch is far smaller
                                weights: work.weights.iter().map(|&w| w as f32).collect(),
                                ring: work.ring,
                            });
                        }
                        let weights = (settings.output.weights
                            && isolation.is_some()
                            && !work.weights.is_empty())
                        .then_some(work.weights.as_slice());
                        rows::push_judged(
                            &mut columns,
                            id,
                            (tested, judge.index),
                            isolation.as_ref(),
                            weights,
                        );
                        rows::set_severity(&mut columns, work.severity.take());
                    }
                }
            }
        }
        let judged = Judged {
            place: read.batch.place,
            leaves: read.leaves,
            damage: read.damage,
            columns,
            flagged,
            bursts: read.batch.acquisitions.len() as u64,
        };
        spares.statistic.give(statistic);
        spares.passed.give(passed);
        if !clock.send(&out, judged) {
            break;
        }
    }
    Ok(())
}

/// 6. Writer: rows in the recording's order.
pub fn write(
    mut clock: Clock,
    input: Receiver<Judged>,
    in_flight: &InFlight,
    control: &Control,
    (tally, spares): (&mut Tally, &Spares),
    mut put: impl FnMut(&mut Judged) -> Result<(), PipelineError>,
) -> Result<(), PipelineError> {
    let mut waiting: BTreeMap<Place, Judged> = BTreeMap::new();
    let mut next = Place::default();
    while let Some(judged) = clock.receive(&input) {
        control.check()?;
        waiting.insert(judged.place, judged);
        while let Some(mut judged) = waiting.remove(&next) {
            if !judged.columns.is_empty() {
                put(&mut judged)?;
            }
            tally.add(&judged);
            control.signals.fetch_add(judged.columns.len() as u64, Ordering::Relaxed);
            next = match judged.leaves {
                Some(bytes) => {
                    in_flight.leave(bytes);
                    Place { block: next.block + 1, piece: 0 }
                }
                None => Place { piece: next.piece + 1, ..next },
            };
            spares.columns.give(judged.columns);
        }
    }
    Ok(())
}
