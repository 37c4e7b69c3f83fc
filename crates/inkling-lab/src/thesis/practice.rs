//! The current practice as a baseline: thresholds for each class on the dominant frequency and damping of
//! signals, thesis §4-2 and §4-3.
//!
//! In: the signals of a set. Out to `measure`: whether a signal is faulty, and which class the
//! thresholds name. The manufacturer's toolbox is not published. Here the frequency is the peak of the
//! spectrum, and the damping the ratio of the peak's magnitudes in the two halves of the signal. Nor are its
//! thresholds, which are set by hand; here they are learned: for each class the range of dominant frequency
//! and damping of its training signals.

use super::datasets::each;
use inkling_core::design::TrainingSet;
use inkling_core::fault::HEALTHY;
use nalgebra::Complex;
use std::collections::BTreeMap;
use std::f64::consts::TAU;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KeyNumbers {
    damping_per_s: f64,
    frequency_hz: f64,
}

const LOWEST_HZ: f64 = 15e3;
const STEP_HZ: f64 = 1e3;
const STEPS: usize = 96;

/// State and key numbers (dominant damping and frequency) of each signal of a set.
pub fn key_numbers(set: &TrainingSet) -> Vec<(&str, KeyNumbers)> {
    let spectrum = Spectrum::new(set.samples, set.sample_period_s);
    each(set).map(|(state, y)| (state, spectrum.key_numbers(&y))).collect()
}

struct Spectrum {
    dt_s: f64,
    /// Per frequency: cos + i sin at every sample, N.
    waves: Vec<Vec<Complex<f64>>>,
}

impl Spectrum {
    fn new(samples: usize, dt_s: f64) -> Spectrum {
        let wave = |k: usize| {
            let omega = TAU * (LOWEST_HZ + k as f64 * STEP_HZ) * dt_s;
            (0..samples).map(|n| Complex::cis(omega * n as f64)).collect()
        };
        Spectrum { dt_s, waves: (0..STEPS).map(wave).collect() }
    }

    /// The key numbers of a signal `y`, N, counts (2 samples or more).
    fn key_numbers(&self, y: &[f64]) -> KeyNumbers {
        let powers: Vec<f64> = self.waves.iter().map(|wave| magnitude(y, wave).powi(2)).collect();
        let last = |p: &usize, q: &usize| powers[*p].total_cmp(&powers[*q]);
        let top = (0..STEPS).rev().max_by(last).unwrap_or_default();

        // the top of a parabola through the ln of the power at the peak and its neighbours
        let mut shift = 0.0;
        if top > 0 && top + 1 < powers.len() {
            let [l, m, r] = [top - 1, top, top + 1].map(|k| powers[k].max(f64::MIN_POSITIVE).ln());
            let bend = l - 2.0 * m + r;
            if bend < 0.0 {
                shift = (0.5 * (l - r) / bend).clamp(-0.5, 0.5);
            }
        }
        let frequency_hz = LOWEST_HZ + (top as f64 + shift) * STEP_HZ;

        // a ring with damping sigma loses the factor e^(-sigma span) from one half to the next
        let (wave, half) = (&self.waves[top], y.len() / 2);
        let first = magnitude(&y[..half], &wave[..half]);
        let second = magnitude(&y[half..], &wave[half..]);
        let span = half as f64 * self.dt_s;
        let damping_per_s = (first / second.max(f64::MIN_POSITIVE)).ln() / span;
        KeyNumbers { damping_per_s, frequency_hz }
    }
}

fn magnitude(y: &[f64], wave: &[Complex<f64>]) -> f64 {
    y.iter().zip(wave).map(|(y, wave)| wave * *y).sum::<Complex<f64>>().norm()
}

/// The ranges of one class, from the lowest to the highest value.
struct KeyRange {
    frequency_hz: [f64; 2],
    damping_per_s: [f64; 2],
}

impl KeyRange {
    /// The range of key numbers less a share `cut` at each end. `None`: there are no signals.
    fn of(numbers: &[KeyNumbers], cut: f64) -> Option<KeyRange> {
        let range = |of: fn(&KeyNumbers) -> f64| {
            let mut values: Vec<f64> = numbers.iter().map(of).collect();
            values.sort_unstable_by(f64::total_cmp);
            let cut = (cut * values.len() as f64) as usize;
            let last = values.len().checked_sub(1 + cut)?;
            Some([*values.get(cut)?, values[last]])
        };
        Some(KeyRange {
            frequency_hz: range(|k| k.frequency_hz)?,
            damping_per_s: range(|k| k.damping_per_s)?,
        })
    }

    /// Distance of frequency or damping, whichever is larger, from the middle, in half-widths.
    fn distance(&self, k: &KeyNumbers) -> f64 {
        let off = |v: f64, [low, high]: [f64; 2]| {
            ((v - 0.5 * (low + high)) / (0.5 * (high - low)).max(f64::MIN_POSITIVE)).abs()
        };
        off(k.frequency_hz, self.frequency_hz).max(off(k.damping_per_s, self.damping_per_s))
    }
}

/// The thresholds: for each class a range of frequency and one of damping.
pub struct Thresholds<'a> {
    ranges: BTreeMap<&'a str, KeyRange>,
}

impl<'a> Thresholds<'a> {
    /// Learns the range of every class from its training signals: of the healthy ones all, so that
    /// few healthy signals are flagged; of a fault the middle 98 %, so that outliers do not widen
    /// its range.
    pub fn learn(numbers: &[(&'a str, KeyNumbers)]) -> Thresholds<'a> {
        let mut by_state: BTreeMap<&str, Vec<KeyNumbers>> = BTreeMap::new();
        numbers.iter().for_each(|(state, k)| by_state.entry(state).or_default().push(*k));
        let range = |(state, own): (&'a str, Vec<KeyNumbers>)| {
            let cut = if state == HEALTHY { 0.0 } else { 0.01 };
            Some((state, KeyRange::of(&own, cut)?))
        };
        Thresholds { ranges: by_state.into_iter().filter_map(range).collect() }
    }

    /// Whether a signal lies outside the healthy range in frequency or damping.
    pub fn is_faulty(&self, k: &KeyNumbers) -> bool {
        self.ranges.get(HEALTHY).is_some_and(|range| range.distance(k) > 1.0)
    }

    /// The fault class that `known` accepts in whose range the signal lies, the nearest by half-widths.
    pub fn name(&self, k: &KeyNumbers, known: impl Fn(&str) -> bool) -> Option<&'a str> {
        self.ranges
            .iter()
            .filter(|(name, _)| **name != HEALTHY && known(name))
            .map(|(name, range)| (range.distance(k), *name))
            .filter(|(distance, _)| *distance <= 1.0)
            .min_by(|p, q| p.0.total_cmp(&q.0))
            .map(|(_, name)| name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn key_numbers_are_those_that_a_signal_was_made_with() {
        let dt_s = 0.78125e-6;
        let spectrum = Spectrum::new(128, dt_s);
        for (frequency_hz, damping_per_s) in [(64.7e3, 3e4), (48e3, 4e4), (80e3, 1e4)] {
            let t = (0..128).map(|k| k as f64 * dt_s);
            let ring = |t: f64| (-damping_per_s * t).exp() * (TAU * frequency_hz * t + 0.4).cos();
            let y: Vec<f64> = t.map(|t| 300.0 * ring(t)).collect();
            let k = spectrum.key_numbers(&y);
            assert!((k.frequency_hz / frequency_hz - 1.0).abs() < 0.02, "{k:?}");
            assert!((k.damping_per_s / damping_per_s - 1.0).abs() < 0.25, "{k:?}");
        }
    }

    #[test]
    fn the_ends_of_a_range_are_one_half_width_from_its_middle() {
        let at = |frequency_hz, damping_per_s| KeyNumbers { damping_per_s, frequency_hz };
        let numbers = [at(60.0, 2.0), at(70.0, 3.0), at(66.0, 4.0)];
        let range = KeyRange::of(&numbers, 0.0).unwrap();
        assert!(numbers.iter().all(|k| range.distance(k) <= 1.0));
        assert_eq!(range.distance(&at(75.0, 3.0)), 2.0);
        assert_eq!(range.distance(&at(65.0, 3.0)), 0.0);
        assert!(KeyRange::of(&[], 0.0).is_none());
    }
}
