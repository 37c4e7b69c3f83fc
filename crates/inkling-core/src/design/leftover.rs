//! The *leftover*: the mean misfit of healthy signals beside their rings, which is part of the
//! expected signal; and the misfits that remain when the leftover is subtracted.
//!
//! In: signals, and the ring of their model (`learn_distances` gives healthy signals, `typical`
//! those of classes). Out: the leftover (of a second mode, an amplifier's transient, a nonlinear
//! spring: a deficit of the model, not of a signal), the signals' misfits, and their autocovariance,
//! which shows coloured noise.
//!
//! A misfit is the signal less its fitted ring, projected beside the ring's tangent space. Rings are
//! fitted signal by signal, since the average of different rings is no ring.

use super::HealthyModel;
use super::rings::Rings;
use crate::identify::SignalSet;
use crate::model::inner_product::dot;
use crate::model::median::median;
use crate::model::ring_fit::Features;

/// At most so many signals are fitted, spread evenly over the set.
const MOST_SIGNALS: usize = 4096;

/// The misfits of some signals beside their rings, one entry per signal each.
#[derive(Default)]
pub(super) struct Misfits {
    /// N each, counts at the signal's own drive, or by [`Misfits::over`] in units of the noise.
    pub rows: Vec<Vec<f64>>,
    /// The amplitude of each signal's ring over that of the healthy ring at the reference drive.
    pub size: Vec<f64>,
}

impl Misfits {
    pub fn extend(&mut self, more: Misfits) {
        self.rows.extend(more.rows);
        self.size.extend(more.size);
    }

    /// The same misfits in units of `noise`, counts.
    pub fn over(mut self, noise: f64) -> Misfits {
        self.rows.iter_mut().flatten().for_each(|v| *v /= noise);
        self
    }

    /// Fits rings (the phase free) to at most `MOST_SIGNALS` signals of a set, at the reference drive, from `near` if given
    /// (at the model's temperature). The leftover is still in the result.
    pub fn of(
        model: &HealthyModel,
        rings: &Rings,
        set: &SignalSet,
        near: Option<Features>,
    ) -> Misfits {
        let every = set.len().div_ceil(MOST_SIGNALS).max(1);
        let chosen: Vec<usize> = (0..set.len()).step_by(every).collect();
        let mut of = Misfits::default();
        // at the signals' own drives all misfits have the same noise
        model.each_own_ring((&rings.fitter, near), (set, &chosen), |i, y, fit| {
            let Some(fit) = fit else { return };
            let drive = set.drive[i];
            let left = rings.beside.misfit(&rings.fitter, y, &fit.features);
            of.rows.push(left.into_iter().map(|v| v * drive).collect());
            of.size.push(fit.features.ln_amplitude.exp() * drive);
        });
        of
    }

    /// The mean shape s of the misfits, N, counts, for a ring of the healthy amplitude, less the
    /// share of noise (James and Stein). Signals with more than twice the median square norm are
    /// left out (somewhat arbitrary). `None`: no signals, or noise explains all of the shape.
    pub fn shape(&self) -> Option<Vec<f64>> {
        let n = self.rows.first()?.len();
        let squares: Vec<f64> = self.rows.iter().map(|row| dot(row, row)).collect();
        let most = 2.0 * median(&mut squares.clone());
        let each = self.rows.iter().zip(&self.size).zip(&squares);
        let kept: Vec<(&Vec<f64>, f64)> =
            each.filter(|(_, square)| **square <= most).map(|((row, a), _)| (row, *a)).collect();

        // s minimises the sum of |row - a s|² over the kept signals: s = sum a row / sum a²
        let weight: f64 = kept.iter().map(|(_, a)| a * a).sum();
        let mut shape = vec![0.0; n];
        for (row, a) in &kept {
            shape.iter_mut().zip(*row).for_each(|(s, v)| *s += a * v / weight);
        }

        // the mean of |row - a s|² over the sum of a²: the square norm by noise alone
        let off = |(row, a): &(&Vec<f64>, f64)| -> f64 {
            row.iter().zip(&shape).map(|(v, s)| (v - a * s).powi(2)).sum()
        };
        let of_noise = kept.iter().map(off).sum::<f64>() / kept.len() as f64 / weight;
        let square = dot(&shape, &shape);
        let share = (1.0 - of_noise / square.max(f64::MIN_POSITIVE)).max(0.0);
        shape.iter_mut().for_each(|s| *s *= share);
        (share > 0.0 && shape.iter().all(|s| s.is_finite())).then_some(shape)
    }

    /// The misfits less a mean shape (empty: nothing), in proportion to each signal's ring.
    pub fn without(mut self, shape: &[f64]) -> Misfits {
        for (row, size) in self.rows.iter_mut().zip(&self.size) {
            row.iter_mut().zip(shape).for_each(|(v, s)| *v -= size * s);
        }
        self
    }

    /// Autocovariance of the misfits, counts², at lags of 0, 1, .., `lags` - 1 samples, with N as
    /// the divisor, of the half with the least square norm, so that faulty ones do not matter.
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

    /// Autocovariance of white noise of unit variance, projected alike, of 64 simulated signals.
    pub fn of_white_noise(&self, rings: &Rings, lags: usize) -> Vec<f64> {
        let n = self.rows.first().map_or(0, Vec::len);
        let tangent_space = rings.beside.tangent_space(&rings.fitter, &Features::HEALTHY);
        let rows = (0..64)
            .map(|i| {
                // only the projection matters, so uniform numbers will do: xorshift, seeds fixed
                let mut state = 0x9e37_79b9_7f4a_7c15u64.wrapping_mul(i + 1);
                let mut next = || {
                    state ^= state << 13;
                    state ^= state >> 7;
                    state ^= state << 17;
                    (state >> 11) as f64 / (1u64 << 53) as f64 - 0.5
                };
                tangent_space.without((0..n).map(|_| 12f64.sqrt() * next()).collect())
            })
            .collect();
        Misfits { rows, size: Vec::new() }.autocovariance(lags)
    }
}
