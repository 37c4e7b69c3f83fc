//! A batch's signals to their statistic: many at once by the streaming kernel, and again by the
//! reference where the kernel alone cannot settle the verdict.
//!
//! In: bursts with their judges. Out: per signal its detection statistics, or why it has none. A signal's
//! number does not depend on what else is in the batch: short bursts share tiles, and a lane does not
//! know its neighbours ([`crate::detect::kernel`]).

use crate::burst::{Acquisition, Burst};
use crate::design::{Detection, Judge, JudgeKey, Known, Lanes, Scratch, Workspace};
use crate::detect::kernel::LaneStatistics;
use crate::detect::tile::{Gather, Instructions, LANES, Tile};
use crate::model::ring_fit::{Fit, Products};
use crate::verdict::{Reason, unusable_signal};
use nalgebra::{Matrix3, Vector4};
use std::ops::Range;
use std::sync::Arc;

/// Scratch of one worker, for the judges of one schedule.
pub struct Statistics {
    rails: [f64; 2],
    instructions: Instructions,
    tile: Tile,
    signal: Vec<f64>,
    expected: Vec<f64>,
    /// Whose `expected` it is: of which judge, drive and temperature.
    expected_of: Option<(JudgeKey, u64, Option<u64>)>,
    work: Workspace,
    own: Scratch,
    /// Rows of a burst that has fewer than there are lanes.
    filled: Vec<u8>,
    products: Products,
}

/// A signal that waits for its statistic.
#[derive(Clone, Copy)]
struct Waiting<'a> {
    /// Its row in the batch.
    at: usize,
    burst: &'a Burst,
    /// In its burst.
    row: usize,
}

/// Signals that wait to fill a tile.
struct Queue<'a> {
    gather: Gather<'a>,
    signals: Vec<Waiting<'a>>,
}

/// A burst to judge.
struct Placed<'a> {
    key: JudgeKey,
    /// The batch's row of its first signal.
    first: usize,
    burst: &'a Burst,
    /// In the batch.
    place: usize,
}

impl Statistics {
    pub fn new(rails: [f64; 2]) -> Statistics {
        Statistics {
            rails,
            instructions: Instructions::best(),
            tile: Tile::default(),
            signal: Vec::new(),
            expected: Vec::new(),
            expected_of: None,
            work: Workspace::default(),
            own: Scratch::default(),
            filled: Vec::new(),
            products: Products::default(),
        }
    }

    /// One entry per row of a batch, in its order. `judges`: of each acquisition.
    pub fn of(
        &mut self,
        acquisitions: &[Acquisition],
        judges: &[Result<Arc<Judge>, Reason>],
        statistic: &mut Vec<Result<Detection, Reason>>,
    ) {
        statistic.clear();
        statistic.reserve(acquisitions.iter().map(Acquisition::rows).sum());
        let mut bursts = Vec::with_capacity(acquisitions.len());
        for (place, (acquisition, judge)) in acquisitions.iter().zip(judges).enumerate() {
            let fill = match (acquisition, judge) {
                (Acquisition::Usable(burst), Ok(judge)) => {
                    let (key, first) = (judge.key(), statistic.len());
                    bursts.push(Placed { key, first, burst, place });
                    Ok(Detection { ring: f64::NAN, unexplained: f64::NAN })
                }
                (_, Err(reason)) => Err(*reason),
                (Acquisition::Unusable(unusable), Ok(_)) => Err(unusable.why.into()),
            };
            statistic.resize(statistic.len() + acquisition.rows(), fill);
        }
        // one judge after the other, so that interleaved short bursts fill tiles, too
        bursts.sort_by_key(|of| (of.key, of.first));
        for of_judge in bursts.chunk_by(|p, q| p.key == q.key) {
            let Ok(judge) = &judges[of_judge[0].place] else { continue };
            self.of_judge(judge, of_judge, statistic);
        }
    }

    fn of_judge(
        &mut self,
        judge: &Judge,
        bursts: &[Placed],
        statistic: &mut [Result<Detection, Reason>],
    ) {
        let mut queue = Queue { gather: Gather::default(), signals: Vec::with_capacity(LANES) };
        let mut unsettled: Vec<Waiting> = Vec::new();
        for of @ &Placed { first, burst, .. } in bursts {
            let n = burst.samples_per_channel as usize;
            let rows = 0..burst.channels as usize;
            let waiting = |row: usize| Waiting { at: first + row, burst, row };
            let Some(lanes) = judge.lanes.as_ref().filter(|l| l.samples() == n) else {
                unsettled.extend(rows.map(waiting));
                continue;
            };
            let (drive, warmer) = (judge.drive(burst), judge.warmer(burst));
            let whole = self.of_rows(judge, lanes, of, statistic, &mut unsettled);
            for row in whole..rows.end {
                queue.gather.push(burst, row, drive, warmer);
                queue.signals.push(waiting(row));
                if queue.gather.is_full() {
                    self.settle(judge, lanes, &mut queue, statistic, &mut unsettled);
                }
            }
        }
        if let Some(lanes) = &judge.lanes
            && !queue.gather.is_empty()
        {
            self.settle(judge, lanes, &mut queue, statistic, &mut unsettled);
        }
        self.look_again(judge, unsettled, statistic);
    }

    /// The reference's statistic of what the lanes did not settle; rings that it asks for are fitted
    /// side by side.
    fn look_again(
        &mut self,
        judge: &Judge,
        mut unsettled: Vec<Waiting>,
        statistic: &mut [Result<Detection, Reason>],
    ) {
        let Some(detector) = judge.detector() else {
            for Waiting { at, burst, row } in unsettled {
                statistic[at] = self.reference(judge, burst, row);
            }
            return;
        };
        let mut looks = Vec::new();
        unsettled.retain(|&Waiting { at, burst, row }| {
            let look = self
                .deviation(judge, burst, row)
                .map(|()| detector.first_look(&self.signal, judge.drive(burst)));
            statistic[at] = look.and_then(|look| finite(look.detection()));
            let asks = look.ok().filter(|look| look.asks().is_some());
            looks.extend(asks);
            asks.is_some()
        });
        let mut products = std::mem::take(&mut self.products);
        let copy = |&Waiting { burst, row, .. }: &Waiting, y: &mut [f64]| {
            burst.copy_signal(row, y);
            judge.take_off_extension(burst, row, y);
            judge.at_reference(y, judge.drive(burst), judge.warmer(burst));
        };
        let mut next = unsettled.iter().zip(&looks);
        let mut beside: Vec<(usize, Option<Fit>)> = Vec::new();
        detector.fitter().fit_all(
            false,
            &mut products,
            |y| {
                let (waiting, look) = next.next()?;
                copy(waiting, y);
                Some(look.asks())
            },
            |i, fit| match looks[i].asks_beside() {
                true => beside.push((i, fit)),
                false => {
                    let drive = judge.drive(unsettled[i].burst);
                    statistic[unsettled[i].at] =
                        finite(detector.second_look(&looks[i], fit.as_ref(), None, drive));
                }
            },
        );
        // what stands beside a ring is told where its phase is free, too
        let mut next = beside.iter();
        detector.fitter().fit_all(
            true,
            &mut products,
            |y| {
                let (i, held) = next.next()?;
                copy(&unsettled[*i], y);
                Some(Some(looks[*i].near(held.as_ref())))
            },
            |j, free| {
                let (i, held) = &beside[j];
                let (waiting, look) = (unsettled[*i], &looks[*i]);
                self.signal.resize(waiting.burst.samples_per_channel as usize, 0.0);
                copy(&waiting, &mut self.signal);
                let free = free.as_ref().map(|fit| (self.signal.as_slice(), fit));
                let drive = judge.drive(waiting.burst);
                statistic[waiting.at] =
                    finite(detector.second_look(look, held.as_ref(), free, drive));
            },
        );
        self.products = products;
    }

    /// Judges a burst's signals as they lie, as many as can be: how many.
    fn of_rows<'a>(
        &mut self,
        judge: &Judge,
        lanes: &Lanes,
        &Placed { first, burst, .. }: &Placed<'a>,
        statistic: &mut [Result<Detection, Reason>],
        unsettled: &mut Vec<Waiting<'a>>,
    ) -> usize {
        let channels = burst.channels as usize;
        if channels < LANES || burst.int16_rows(0, LANES).is_none() {
            return 0;
        }
        let Some((lanes, condition)) = lanes.rows(judge.drive(burst), judge.warmer(burst)) else {
            return 0;
        };
        let limits = Lanes::limits(&judge.model);
        let mut row = 0;
        while row + LANES <= channels
            && let Some(samples) = burst.int16_rows(row, LANES)
        {
            let judged =
                lanes.judge_rows(samples, &condition, limits, self.rails, self.instructions);
            let each = statistic[first + row..].iter_mut();
            for (lane, (statistic, settled)) in each.zip(judged.settled).enumerate() {
                match settled {
                    true => *statistic = Ok(of_lane(&judged, lane)),
                    false => {
                        let row = row + lane;
                        unsettled.push(Waiting { at: first + row, burst, row });
                    }
                }
            }
            row += LANES;
        }
        row
    }

    /// Judges what waits.
    fn settle<'a>(
        &mut self,
        judge: &Judge,
        lanes: &Lanes,
        queue: &mut Queue<'a>,
        statistic: &mut [Result<Detection, Reason>],
        unsettled: &mut Vec<Waiting<'a>>,
    ) {
        self.tile.fill(&mut queue.gather, lanes.samples(), self.instructions);
        let judged = lanes.judge(&mut self.tile, &judge.model, self.rails, self.instructions);
        for (lane, of) in queue.signals.drain(..).enumerate() {
            match judged.settled[lane] {
                true => statistic[of.at] = Ok(of_lane(&judged, lane)),
                false => unsettled.push(of),
            }
        }
    }

    /// First-order features of a burst's signals, row by row, with `detect.method` = `sensitivity`: many at once where
    /// they are int16, the rest one by one. Of a signal that cannot be judged they are of any value.
    pub fn features(&mut self, judge: &Judge, burst: &Burst, features: &mut Vec<Vector4<f64>>) {
        features.clear();
        let Some(detector) = judge.detector() else { return };
        let (drive, warmer) = (judge.drive(burst), judge.warmer(burst));
        let n = burst.samples_per_channel as usize;
        let lanes = judge.lanes.as_ref().filter(|lanes| lanes.samples() == n);
        let condition = lanes.and_then(|lanes| Some(lanes.rows(drive, warmer)?.1));
        if let Some((condition, lanes)) = condition.zip(detector.own_lanes()) {
            while features.len() < burst.channels as usize {
                let rows = LANES.min(burst.channels as usize - features.len());
                let whole = burst.int16_rows(features.len(), LANES).filter(|_| rows == LANES);
                let samples = match whole {
                    Some(samples) => samples,
                    // a lane does not know its neighbours: what fills up is of no influence
                    None if self.fill_up(burst, features.len()..features.len() + rows) => {
                        &self.filled
                    }
                    None => break,
                };
                let of = lanes.of_rows(samples, &condition, self.instructions);
                let of_lane = |l: usize| Vector4::from(of.map(|of| f64::from(of[l])));
                features.extend((0..rows).map(of_lane));
            }
        }
        for row in features.len()..burst.channels as usize {
            let of = self.deviation(judge, burst, row);
            features.push(match of {
                Ok(()) => detector.own_features(&self.signal, drive),
                Err(_) => Vector4::zeros(),
            });
        }
    }

    /// Leaves the signals of some rows in `filled`, as many int16 rows as there are lanes. False: they are no whole numbers.
    fn fill_up(&mut self, burst: &Burst, rows: Range<usize>) -> bool {
        let n = burst.samples_per_channel as usize;
        self.filled.clear();
        self.signal.resize(n, 0.0);
        for row in rows {
            burst.copy_signal(row, &mut self.signal);
            let is_int16 = |y: &f64| f64::from(*y as i16) == *y;
            if !self.signal.iter().all(is_int16) {
                return false;
            }
            self.filled.extend(self.signal.iter().flat_map(|y| (*y as i16).to_le_bytes()));
        }
        self.filled.resize(LANES * n * 2, 0);
        true
    }

    /// A signal's squared distance from its channel's baseline, by a fit. `None`: it is no ring.
    pub fn own_distance(
        &mut self,
        (judge, burst, row): (&Judge, &Burst, usize),
        metric: &Matrix3<f64>,
        (features, known): (&Vector4<f64>, &Known),
    ) -> Option<f64> {
        self.deviation(judge, burst, row).ok()?;
        let (drive, signal) = (judge.drive(burst), &self.signal);
        let own = &mut self.own;
        judge.detector()?.own_distance(metric, (features, known), (signal, drive), own)
    }

    /// The statistic in f64, and the checks of a signal: what every verdict agrees with.
    pub fn reference(
        &mut self,
        judge: &Judge,
        burst: &Burst,
        row: usize,
    ) -> Result<Detection, Reason> {
        self.deviation(judge, burst, row)?;
        finite(judge.detect(&self.signal, judge.drive(burst), &mut self.work))
    }

    /// Leaves a signal's deviation from what is expected of it in `signal`, if it can be judged.
    fn deviation(&mut self, judge: &Judge, burst: &Burst, row: usize) -> Result<(), Reason> {
        let n = burst.samples_per_channel as usize;
        self.signal.resize(n, 0.0);
        burst.copy_signal(row, &mut self.signal);
        if let Some(reason) = unusable_signal(&self.signal, self.rails) {
            return Err(reason);
        }
        let drive = judge.drive(burst);
        let of = (judge.key(), drive.to_bits(), burst.temperature_c.map(f64::to_bits));
        if self.expected_of != Some(of) || self.expected.len() != n {
            self.expected.resize(n, 0.0);
            judge.expect(burst, &mut self.expected);
            self.expected_of = Some(of);
        }
        judge.deviate(burst, row, &self.expected, &mut self.signal);
        Ok(())
    }
}

fn of_lane(of: &LaneStatistics, lane: usize) -> Detection {
    Detection { ring: of.statistic[lane], unexplained: of.unexplained[lane] }
}

/// Of absurd covariates; no threshold may call that healthy.
fn finite(found: Detection) -> Result<Detection, Reason> {
    if found.ring.is_finite() { Ok(found) } else { Err(Reason::NonFinite) }
}
