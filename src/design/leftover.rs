//! What every healthy signal holds beside its ring, and how much beside that.
//!
//! In: healthy signals, the ring of their model. Out: their mean shape beside the ring (a second mode, an
//! amplifier's transient, a bent spring: what the model lacks is no misfit of a signal), and the squares
//! that are left without it. Rings are fitted signal by signal: the average of rings that differ is no
//! ring, and what it leaves is in none of them.

use crate::identify::averaging::SignalSet;
use crate::model::beside_ring::BesideRing;
use crate::model::inner_product::dot;
use crate::model::ring_fit::{Features, Products, RingFitter};

/// Signals that are fitted, at most.
const MOST_SIGNALS: usize = 4096;

/// Signals less their rings.
pub(super) struct Left {
    /// Rows of N, counts.
    pub rows: Vec<Vec<f64>>,
    /// Amplitude of the ring over the healthy one's at the reference drive.
    pub size: Vec<f64>,
}

impl Left {
    pub fn none() -> Left {
        Left { rows: Vec::new(), size: Vec::new() }
    }

    pub fn extend(&mut self, more: Left) {
        self.rows.extend(more.rows);
        self.size.extend(more.size);
    }

    /// In other units.
    pub fn over(mut self, noise: f64) -> Left {
        self.rows.iter_mut().flatten().for_each(|v| *v /= noise);
        self
    }

    /// `near`: what the rings lie near, if that is known. `at_reference`: leaves signal `i` of the set as
    /// it would be at reference drive and temperature.
    pub fn of(
        set: &SignalSet,
        (fitter, beside): (&RingFitter, &BesideRing),
        near: Option<Features>,
        mut at_reference: impl FnMut(usize, &mut [f64]),
    ) -> Left {
        let every = set.len().div_ceil(MOST_SIGNALS).max(1);
        let chosen: Vec<usize> = (0..set.len()).step_by(every).collect();
        let mut of = Left::none();
        let mut next = chosen.iter();
        let mut signals: Vec<Vec<f64>> = Vec::with_capacity(chosen.len());
        let mut fits = Vec::with_capacity(chosen.len());
        fitter.fit_all(
            true,
            &mut Products::default(),
            |y| {
                at_reference(*next.next()?, y);
                signals.push(y.to_vec());
                Some(near)
            },
            |i, fit| fits.push((i, fit)),
        );
        fits.sort_by_key(|(i, _)| *i);
        for (i, fit) in fits {
            let Some(fit) = fit else { continue };
            let drive = set.drive[chosen[i]];
            let left = beside.left(fitter, &signals[i], &fit.features);
            of.rows.push(left.into_iter().map(|v| v * drive).collect());
            of.size.push(fit.features.ln_amplitude.exp() * drive);
        }
        of
    }

    /// The mean shape of signals as large as the healthy ring, robust: signals further from the others
    /// than most do not count. Counts; shrunk by what noise alone would leave of it (James and Stein).
    pub fn shape(&self) -> Option<Vec<f64>> {
        let n = self.rows.first()?.len();
        let mut squares: Vec<f64> = self.rows.iter().map(|row| dot(row, row)).collect();
        let mid = squares.len() / 2;
        let most = 2.0 * *squares.clone().select_nth_unstable_by(mid, f64::total_cmp).1;
        squares.iter_mut().for_each(|q| *q = f64::from(u8::from(*q <= most)));
        let weight: f64 = squares.iter().zip(&self.size).map(|(kept, a)| kept * a * a).sum();
        let mut shape = vec![0.0; n];
        for ((row, kept), a) in self.rows.iter().zip(&squares).zip(&self.size) {
            shape.iter_mut().zip(row).for_each(|(s, v)| *s += kept * a * v / weight);
        }
        let (mut beyond, mut count) = (0.0, 0.0);
        for ((row, kept), a) in self.rows.iter().zip(&squares).zip(&self.size) {
            let off: f64 = row.iter().zip(&shape).map(|(v, s)| (v - a * s).powi(2)).sum();
            beyond += kept * off;
            count += kept;
        }
        let of_noise = beyond / count / weight;
        let square = dot(&shape, &shape);
        let share = (1.0 - of_noise / square.max(f64::MIN_POSITIVE)).max(0.0);
        shape.iter_mut().for_each(|s| *s *= share);
        (share > 0.0 && shape.iter().all(|s| s.is_finite())).then_some(shape)
    }

    /// The same without what every healthy signal holds.
    pub fn without(mut self, shape: &[f64]) -> Left {
        for (row, size) in self.rows.iter_mut().zip(&self.size) {
            row.iter_mut().zip(shape).for_each(|(v, s)| *v -= size * s);
        }
        self
    }

    /// Mean product of what is left `lag` samples apart, counts², lags from 0 on: of the half of the
    /// signals that leave least.
    pub fn autocovariance(&self, lags: usize) -> Vec<f64> {
        let mut order: Vec<usize> = (0..self.rows.len()).collect();
        let squares: Vec<f64> = self.rows.iter().map(|row| dot(row, row)).collect();
        order.sort_by(|&i, &j| squares[i].total_cmp(&squares[j]));
        let kept = &order[..self.rows.len().div_ceil(2)];
        let of_lag = |lag: usize| {
            let each = kept.iter().map(|&i| {
                let row = &self.rows[i];
                dot(&row[..row.len() - lag], &row[lag..]) / row.len() as f64
            });
            each.sum::<f64>() / kept.len().max(1) as f64
        };
        let most = self.rows.first().map_or(0, |row| row.len().min(lags));
        (0..most).map(of_lag).collect()
    }

    /// The same of white noise of unit variance, seen beside the same rings.
    pub fn of_white_noise(
        &self,
        fitter: &RingFitter,
        beside: &BesideRing,
        lags: usize,
    ) -> Vec<f64> {
        let n = self.rows.first().map_or(0, Vec::len);
        let explained = beside.explained(fitter, &Features::HEALTHY);
        let rows = (0..64)
            .map(|i| {
                // any white sequence: what is asked is what the projection does to it
                let mut state = 0x9e37_79b9_7f4a_7c15u64.wrapping_mul(i + 1);
                let mut next = || {
                    state ^= state << 13;
                    state ^= state >> 7;
                    state ^= state << 17;
                    (state >> 11) as f64 / (1u64 << 53) as f64 - 0.5
                };
                explained.taken_off((0..n).map(|_| 12f64.sqrt() * next()).collect())
            })
            .collect();
        Left { rows, size: Vec::new() }.autocovariance(lags)
    }
}
