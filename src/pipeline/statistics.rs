//! Computes the detection statistics of a batch's signals, by the method of each burst's judge.
//!
//! In: bursts with their judges; the workers of the filter stage call [`Statistics::of`] once per batch. Out: for each
//! signal its detection statistics ([`Detection`]), or why it has none. What else is in the batch does not change them.
//!
//! The bursts of a batch are taken judge by judge. With `detect.method` = `sensitivity` [`Distances`] computes
//! the distances of many signals side by side; any other method takes the energy, or the largest sample, of each
//! signal's residual.

use super::batches::{AssignedBatch, Detected};
use super::distances::{Distances, PlacedBurst, finite};
use inkling_core::burst::Acquisition;
use inkling_core::design::{Detection, Judge};
use inkling_core::detect::residual_generator::TOGETHER;

/// The buffers of one worker, for the judges of one recording.
#[derive(Default)]
pub struct Statistics {
    pub distances: Distances,
    waiting: WaitingSignals,
}

/// Signals that wait to be filtered side by side.
#[derive(Default)]
struct WaitingSignals {
    /// The index of each in the batch.
    at: Vec<usize>,
    /// `samples` values of each, counts, one signal after the other.
    deviations: Vec<f64>,
    /// Samples of each: signals of another length wait by themselves.
    samples: usize,
}

impl Statistics {
    /// `rails`: limits of the converter, counts.
    pub fn new(rails: [f64; 2]) -> Statistics {
        Statistics { distances: Distances::new(rails), ..Statistics::default() }
    }

    /// Computes the statistics of a batch into `statistic`: one entry per signal, in the batch's order.
    pub fn of(&mut self, batch: &AssignedBatch, statistic: &mut Vec<Detected>) {
        statistic.clear();
        statistic.reserve(batch.read.batch.rows());
        let mut bursts = Vec::with_capacity(batch.judges.len());

        for (signals, acquisition, of) in batch.placed() {
            let fill = match (acquisition, &of.judge) {
                (Acquisition::Usable(burst), Ok(judge)) => {
                    bursts.push(PlacedBurst { judge, first: signals.start, burst });
                    // every usable burst is overwritten below
                    Ok(Detection { ring: f64::NAN, unexplained: f64::NAN })
                }
                (_, Err(reason)) => Err(*reason),
                (Acquisition::Unusable(unusable), Ok(_)) => Err(unusable.why),
            };
            statistic.resize(signals.end, fill);
        }

        // one judge after the other, so that signals are computed side by side even if short bursts of several judges
        // alternate
        bursts.sort_by_key(|of| (of.judge.key(), of.first));
        for bursts in bursts.chunk_by(|p, q| p.judge.key() == q.judge.key()) {
            let judge = bursts[0].judge;
            match judge.detector() {
                Some(detector) => self.distances.of(judge, detector, bursts, statistic),
                None => self.of_residuals(judge, bursts, statistic),
            }
        }
    }

    /// Computes the energy (or the largest sample) of each signal's residual, thesis e(r). [`TOGETHER`] signals are
    /// computed at once, which may come from several bursts.
    fn of_residuals(&mut self, judge: &Judge, bursts: &[PlacedBurst], statistic: &mut [Detected]) {
        for &PlacedBurst { first, burst, .. } in bursts {
            if burst.samples_per_channel as usize != self.waiting.samples {
                self.waiting.compute(judge, statistic);
                self.waiting.samples = burst.samples_per_channel as usize;
            }
            for row in 0..burst.channels as usize {
                match self.distances.deviations.usable(judge, burst, row) {
                    Err(reason) => statistic[first + row] = Err(reason),
                    Ok(deviation) => {
                        self.waiting.at.push(first + row);
                        self.waiting.deviations.extend_from_slice(deviation);
                    }
                }
                if self.waiting.at.len() == TOGETHER {
                    self.waiting.compute(judge, statistic);
                }
            }
        }
        self.waiting.compute(judge, statistic);
    }
}

impl WaitingSignals {
    /// Computes the statistics of what waits; nothing waits afterwards.
    fn compute(&mut self, judge: &Judge, statistic: &mut [Detected]) {
        let found = judge.model.of_residuals(&self.deviations, self.samples);
        for (at, ring) in self.at.drain(..).zip(found) {
            statistic[at] = finite(Detection { ring, unexplained: f64::NAN });
        }
        self.deviations.clear();
    }
}
