//! Fits rings, side by side, to the signals that are to be isolated.
//!
//! In: a batch, with the signals that passed the gate. Out: the fit of each such signal, where the judge's
//! method names fitted rings. A fit does not depend on its neighbours ([`inkling_core::model::ring_fit`]).

use super::batches::GatedBatch;
use inkling_core::burst::{Acquisition, Burst};
use inkling_core::design::Judge;
use inkling_core::model::ring_fit::{Fit, Products};

/// The fitted rings of one batch; their memory is reused for the next.
#[derive(Default)]
pub struct Rings {
    products: Products,
    /// The fits, in the order of the rows that were to be fitted; `None`: the signal is no ring.
    fits: Vec<Option<Fit>>,
    /// How many of them were taken.
    taken: usize,
}

/// A signal that is to be fitted.
struct WaitingSignal<'a> {
    judge: &'a Judge,
    burst: &'a Burst,
    row: usize,
    /// Its index among the fits.
    number: usize,
}

impl Rings {
    /// Fits the signals that passed the gate, or with `everything` all that were judged. The fits are then
    /// taken row by row.
    pub fn fit(&mut self, of: &GatedBatch, everything: bool) {
        let mut waiting: Vec<WaitingSignal> = Vec::new();
        for (rows, acquisition, assigned) in of.filtered.assigned.placed() {
            let (Acquisition::Usable(burst), Ok(judge)) = (acquisition, &assigned.judge) else {
                continue;
            };
            if judge.rings().is_none() {
                continue;
            }
            let judged = of.tests.healthy[rows.clone()].iter().zip(&of.filtered.statistic[rows]);
            for (row, (healthy, statistic)) in judged.enumerate() {
                if statistic.is_ok() && (!healthy || everything) {
                    waiting.push(WaitingSignal { judge, burst, row, number: waiting.len() });
                }
            }
        }
        (self.fits, self.taken) = (vec![None; waiting.len()], 0);
        // one judge after the other, so that fits run side by side even if short
        // bursts of several judges alternate
        waiting.sort_by_key(|w| (w.judge.key(), w.number));
        for of_judge in waiting.chunk_by(|p, q| p.judge.key() == q.judge.key()) {
            let Some(fitter) = of_judge[0].judge.rings() else { continue };
            let mut next = of_judge.iter();
            fitter.fit_all(
                true,
                &mut self.products,
                |y| {
                    let WaitingSignal { judge, burst, row, .. } = next.next()?;
                    per_drive(judge, burst, *row, y);
                    Some(None)
                },
                |i, fit| self.fits[of_judge[i].number] = fit,
            );
        }
    }

    /// The fit of the next row that was to be fitted; the inner `None`: the signal is
    /// no ring. `None`: no row is left.
    pub fn take(&mut self) -> Option<Option<Fit>> {
        self.taken += 1;
        self.fits.get(self.taken - 1).copied()
    }
}

/// Writes a burst's signal to `y`, per unit drive and at its own temperature, counts.
pub fn per_drive(judge: &Judge, burst: &Burst, row: usize, y: &mut [f64]) {
    burst.copy_signal(row, y);
    judge.take_off_extension(burst, row, y);
    let scale = 1.0 / judge.drive(burst);
    y.iter_mut().for_each(|y| *y *= scale);
}
