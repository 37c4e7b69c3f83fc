//! A batch's signals to their statistic: many at once by the streaming kernel, and again by the
//! reference where the kernel alone cannot settle the verdict.
//!
//! In: bursts with their judges. Out: per signal the residual energy, or why it has none. A signal's
//! number does not depend on what else is in the batch: short bursts share tiles, and a lane does not
//! know its neighbours ([`crate::detect::kernel`]).

use super::stages::Assigned;
use crate::burst::{Acquisition, Burst};
use crate::design::{Judge, Lanes, Own, Workspace};
use crate::detect::tile::{Gather, Instructions, LANES, Tile};
use crate::verdict::{Reason, unusable_signal};

/// Scratch of one worker, for the judges of one schedule.
pub struct Statistics {
    rails: [f64; 2],
    instructions: Instructions,
    tile: Tile,
    signal: Vec<f64>,
    expected: Vec<f64>,
    /// Whose `expected` it is: the judge's number, drive and temperature.
    expected_of: Option<(u16, u64, Option<u64>)>,
    work: Workspace,
}

/// A signal that waits in a tile: its row in the batch, and in its burst.
type Waiting<'a> = (usize, &'a Burst, usize);

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
        }
    }

    /// One entry per row of the batch, in its order.
    pub fn of(&mut self, assigned: &Assigned, statistic: &mut Vec<Result<f64, Reason>>) {
        let acquisitions = &assigned.read.batch.acquisitions;
        statistic.clear();
        statistic.reserve(assigned.read.batch.rows());
        // bursts to judge: the judge's number, the first row, place in the batch
        let mut bursts = Vec::with_capacity(acquisitions.len());
        for (place, (acquisition, judge)) in acquisitions.iter().zip(&assigned.judges).enumerate() {
            let fill = match (acquisition, judge) {
                (Acquisition::Usable(burst), Ok(judge)) => {
                    bursts.push((judge.index, statistic.len(), burst, place));
                    Ok(f64::NAN)
                }
                (_, Err(reason)) => Err(*reason),
                (Acquisition::Unusable(unusable), Ok(_)) => Err(unusable.why.into()),
            };
            statistic.resize(statistic.len() + acquisition.rows(), fill);
        }
        // one judge after the other, so that interleaved short bursts fill tiles, too
        bursts.sort_by_key(|&(judge, row, ..)| (judge, row));
        for of_judge in bursts.chunk_by(|p, q| p.0 == q.0) {
            let Ok(judge) = &assigned.judges[of_judge[0].3] else { continue };
            let of_judge = of_judge.iter().map(|&(_, row, burst, _)| (row, burst));
            self.of_judge(judge, of_judge, statistic);
        }
    }

    fn of_judge<'a>(
        &mut self,
        judge: &Judge,
        bursts: impl Iterator<Item = (usize, &'a Burst)>,
        statistic: &mut [Result<f64, Reason>],
    ) {
        let mut gather = Gather::default();
        let mut waiting: Vec<Waiting> = Vec::with_capacity(LANES);
        for (first, burst) in bursts {
            let n = burst.samples_per_channel as usize;
            let Some(lanes) = judge.lanes.as_ref().filter(|l| l.samples() == n) else {
                for row in 0..burst.channels as usize {
                    statistic[first + row] = self.reference(judge, burst, row);
                }
                continue;
            };
            let (drive, warmer) = (judge.drive(burst), judge.warmer(burst));
            let whole = self.of_rows(judge, lanes, burst, &mut statistic[first..]);
            for row in whole..burst.channels as usize {
                gather.push(burst, row, drive, warmer);
                waiting.push((first + row, burst, row));
                if gather.is_full() {
                    self.settle(judge, lanes, &mut gather, &mut waiting, statistic);
                }
            }
        }
        if let Some(lanes) = &judge.lanes
            && !gather.is_empty()
        {
            self.settle(judge, lanes, &mut gather, &mut waiting, statistic);
        }
    }

    /// Judges a burst's signals as they lie, as many as can be: how many.
    fn of_rows(
        &mut self,
        judge: &Judge,
        lanes: &Lanes,
        burst: &Burst,
        statistic: &mut [Result<f64, Reason>],
    ) -> usize {
        let channels = burst.channels as usize;
        if channels < LANES || burst.int16_rows(0, LANES).is_none() {
            return 0;
        }
        let Some((lanes, condition)) = lanes.rows(judge.drive(burst), judge.warmer(burst)) else {
            return 0;
        };
        let limit = Lanes::limit(judge.model.threshold.value);
        let mut row = 0;
        while row + LANES <= channels
            && let Some(samples) = burst.int16_rows(row, LANES)
        {
            let judged =
                lanes.judge_rows(samples, &condition, limit, self.rails, self.instructions);
            let each = statistic[row..row + LANES].iter_mut();
            for (lane, (statistic, settled)) in each.zip(judged.settled).enumerate() {
                *statistic = match settled {
                    true => Ok(judged.statistic[lane]),
                    false => self.reference(judge, burst, row + lane),
                };
            }
            row += LANES;
        }
        row
    }

    /// Judges what waits.
    fn settle(
        &mut self,
        judge: &Judge,
        lanes: &Lanes,
        gather: &mut Gather,
        waiting: &mut Vec<Waiting>,
        statistic: &mut [Result<f64, Reason>],
    ) {
        self.tile.fill(gather, lanes.samples(), self.instructions);
        let threshold = judge.model.threshold.value;
        let judged = lanes.judge(&mut self.tile, threshold, self.rails, self.instructions);
        for (lane, (at, burst, row)) in waiting.drain(..).enumerate() {
            statistic[at] = if judged.settled[lane] {
                Ok(judged.statistic[lane])
            } else {
                self.reference(judge, burst, row)
            };
        }
    }

    /// The statistic about the channel's own baseline.
    pub fn of_own(
        &mut self,
        judge: &Judge,
        burst: &Burst,
        row: usize,
        own: Own,
    ) -> Result<f64, Reason> {
        self.work.own = Some(own);
        let statistic = self.reference(judge, burst, row);
        self.work.own = None;
        statistic
    }

    /// The statistic in f64, and the checks of a signal: what every verdict agrees with.
    pub fn reference(&mut self, judge: &Judge, burst: &Burst, row: usize) -> Result<f64, Reason> {
        let n = burst.samples_per_channel as usize;
        self.signal.resize(n, 0.0);
        burst.copy_signal(row, &mut self.signal);
        if let Some(reason) = unusable_signal(&self.signal, self.rails) {
            return Err(reason);
        }
        let drive = judge.drive(burst);
        let of = (judge.index, drive.to_bits(), burst.temperature_c.map(f64::to_bits));
        if self.expected_of != Some(of) || self.expected.len() != n {
            self.expected.resize(n, 0.0);
            judge.expect(burst, &mut self.expected);
            self.expected_of = Some(of);
        }
        judge.deviate(burst, row, &self.expected, &mut self.signal);
        let statistic = judge.statistic(&self.signal, drive, &mut self.work);
        // of absurd covariates; no threshold may call that healthy
        if statistic.is_finite() { Ok(statistic) } else { Err(Reason::NonFinite) }
    }
}
