//! What is computed of signals before they are named, in two helpers.
//!
//! [`Deviations`]: a signal goes in, its deviation from what its judge expects comes out, N, counts.
//!
//! [`Rings`]: a batch goes in, the fitted ring of each signal that passed the gate comes out, where the
//! judge's method names fitted rings (`isolate.method` = `posterior`). The isolate stage fits all rings of a
//! batch first, many side by side, and then takes them in the order of the rows. A fit does not depend on its
//! neighbours ([`inkling_core::model::ring_fit`]).

use super::batches::GatedBatch;
use inkling_core::burst::{Acquisition, Burst};
use inkling_core::design::{Judge, JudgeKey};
use inkling_core::model::ring_fit::{Fit, FitBuffers};
use inkling_core::verdict::{Reason, unusable_signal};

#[derive(Debug, Default)]
pub(super) struct Deviations {
    pub rails: [f64; 2],
    /// The signal at hand, counts: as it was acquired, or its deviation.
    pub signal: Vec<f64>,
    expected: Vec<f64>,
    /// What `expected` was computed for: judge, drive and temperature, the latter two as bits.
    expected_of: Option<(JudgeKey, u64, Option<u64>)>,
}

impl Deviations {
    /// `rails`: limits of the converter, counts.
    pub fn new(rails: [f64; 2]) -> Deviations {
        Deviations { rails, ..Deviations::default() }
    }

    pub fn copy(&mut self, burst: &Burst, row: usize) -> &[f64] {
        self.signal.resize(burst.samples_per_channel as usize, 0.0);
        burst.copy_signal(row, &mut self.signal);
        &self.signal
    }

    /// A signal's deviation; an error if the signal cannot be judged.
    pub fn usable(&mut self, judge: &Judge, burst: &Burst, row: usize) -> Result<&[f64], Reason> {
        let rails = self.rails;
        match unusable_signal(self.copy(burst, row), rails) {
            Some(reason) => Err(reason),
            None => Ok(self.deviate(judge, burst, row)),
        }
    }

    /// How large the signal is beside the expected one, if it has the form of that: most of its energy lies along it.
    /// Of the signal whose deviation was made last.
    pub fn size(&self) -> Option<f64> {
        let (mut own, mut along, mut of_expected) = (0.0, 0.0, 0.0);
        for (deviation, expected) in self.signal.iter().zip(&self.expected) {
            let y = deviation + expected;
            own += y * y;
            along += y * expected;
            of_expected += expected * expected;
        }
        (2.0 * along * along > own * of_expected).then(|| along / of_expected)
    }

    /// Turns the signal that was copied last into its deviation: burst and row must be the same.
    pub fn deviate(&mut self, judge: &Judge, burst: &Burst, row: usize) -> &[f64] {
        // bursts that follow each other mostly expect the same signal
        let drive = judge.drive(burst).to_bits();
        let of = (judge.key(), drive, burst.temperature_c.map(f64::to_bits));
        let n = self.signal.len();
        if self.expected_of != Some(of) || self.expected.len() != n {
            self.expected.resize(n, 0.0);
            judge.expect(burst, &mut self.expected);
            self.expected_of = Some(of);
        }
        judge.deviate(burst, row, &self.expected, &mut self.signal);
        &self.signal
    }
}

/// The fitted rings of one batch; their memory is reused for the next.
#[derive(Default)]
pub struct Rings {
    products: FitBuffers,
    /// The fits that were not taken yet, in the order of the rows; `None`: the signal is no ring.
    pub fits: std::vec::IntoIter<Option<Fit>>,
}

struct WaitingSignal<'a> {
    judge: &'a Judge,
    burst: &'a Burst,
    row: usize,
    number: usize,
}

impl Rings {
    /// Fits the signals that passed the gate, or with `everything` all that were judged.
    pub fn fit(&mut self, of: &GatedBatch, everything: bool) {
        // the signals to be fitted, numbered in the order of the batch
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

        let mut fits = vec![None; waiting.len()];
        // one judge after the other, so that fits run side by side even if bursts of several judges alternate
        waiting.sort_by_key(|w| (w.judge.key(), w.number));
        for of_judge in waiting.chunk_by(|p, q| p.judge.key() == q.judge.key()) {
            let Some(fitter) = of_judge[0].judge.rings() else { continue };
            // with the phase free (`true`), and without a known start
            let starts = vec![None; of_judge.len()];
            let found = fitter.fit_all(true, &mut self.products, &starts, |i, y| {
                let WaitingSignal { judge, burst, row, .. } = of_judge[i];
                per_drive(judge, burst, row, y);
            });
            of_judge.iter().zip(found).for_each(|(w, fit)| fits[w.number] = fit);
        }
        self.fits = fits.into_iter();
    }
}

/// Writes a burst's signal to `y`, per unit drive and at its own temperature, counts.
pub fn per_drive(judge: &Judge, burst: &Burst, row: usize, y: &mut [f64]) {
    burst.copy_signal(row, y);
    judge.take_off(burst, row, y);
    let scale = 1.0 / judge.drive(burst);
    y.iter_mut().for_each(|y| *y *= scale);
}
