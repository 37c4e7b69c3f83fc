//! What the current practice looks at, with which the thesis compares: dominant amplitude, damping
//! and frequency of a signal by Fourier transform, and their distance from a class's range.
//!
//! In: a signal, N, counts. Out: its key numbers (thesis §4-1), and their distance from the
//! [`KeyRange`] of other signals. The manufacturer's toolbox is not published; here the frequency
//! is the peak of the spectrum, the damping the ratio of the peak's magnitudes in the two halves of
//! the signal, and the amplitude that of the first half.

use nalgebra::Complex;
use std::f64::consts::TAU;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KeyNumbers {
    pub amplitude_counts: f64,
    pub damping_per_s: f64,
    pub frequency_hz: f64,
}

const LOWEST_HZ: f64 = 15e3;
const STEP_HZ: f64 = 1e3;
const STEPS: usize = 96;

#[derive(Clone, Debug)]
pub struct Spectrum {
    dt_s: f64,
    /// Per frequency: cos + i sin at every sample, N.
    waves: Vec<Vec<Complex<f64>>>,
}

impl Spectrum {
    pub fn new(samples: usize, dt_s: f64) -> Spectrum {
        let wave = |k: usize| {
            let omega = TAU * (LOWEST_HZ + k as f64 * STEP_HZ) * dt_s;
            (0..samples).map(|n| Complex::cis(omega * n as f64)).collect()
        };
        Spectrum { dt_s, waves: (0..STEPS).map(wave).collect() }
    }

    /// The key numbers of a signal `y`, N, counts (2 samples or more).
    pub fn key_numbers(&self, y: &[f64]) -> KeyNumbers {
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

        // amplitude A: the magnitude over the first half is about A/2 sum e^{-sigma t}
        let decay = damping_per_s * span;
        let mean = if decay.abs() < 1e-6 { 1.0 } else { -(-decay).exp_m1() / decay };
        let amplitude_counts = 2.0 * first / (half as f64 * mean);
        KeyNumbers { amplitude_counts, damping_per_s, frequency_hz }
    }
}

fn magnitude(y: &[f64], wave: &[Complex<f64>]) -> f64 {
    y.iter().zip(wave).map(|(y, wave)| wave * *y).sum::<Complex<f64>>().norm()
}

/// The range of values less a share `cut` of them at each end. `None`: there are none.
pub fn range(mut values: Vec<f64>, cut: f64) -> Option<[f64; 2]> {
    values.sort_unstable_by(f64::total_cmp);
    let cut = (cut * values.len() as f64) as usize;
    let last = values.len().checked_sub(1 + cut)?;
    Some([*values.get(cut)?, values[last]])
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KeyRange {
    pub frequency_hz: [f64; 2],
    pub damping_per_s: [f64; 2],
}

impl KeyRange {
    /// The range of key numbers less a share `cut` at each end. `None`: there are no signals.
    pub fn of<'a>(
        numbers: impl Iterator<Item = &'a KeyNumbers> + Clone,
        cut: f64,
    ) -> Option<KeyRange> {
        let range = |of: fn(&KeyNumbers) -> f64| range(numbers.clone().map(of).collect(), cut);
        Some(KeyRange {
            frequency_hz: range(|k| k.frequency_hz)?,
            damping_per_s: range(|k| k.damping_per_s)?,
        })
    }

    /// Distance of frequency or damping, whichever is larger, from the middle, in half-widths.
    pub fn distance(&self, k: &KeyNumbers) -> f64 {
        let off = |v: f64, [low, high]: [f64; 2]| {
            ((v - 0.5 * (low + high)) / (0.5 * (high - low)).max(f64::MIN_POSITIVE)).abs()
        };
        off(k.frequency_hz, self.frequency_hz).max(off(k.damping_per_s, self.damping_per_s))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn key_numbers_are_those_that_a_signal_was_made_with() {
        let dt_s = 0.78125e-6;
        let spectrum = Spectrum::new(128, dt_s);
        for (frequency_hz, damping_per_s, amplitude) in
            [(64.7e3, 3e4, 400.0), (48e3, 4e4, 300.0), (80e3, 1e4, 200.0)]
        {
            let y: Vec<f64> = (0..128)
                .map(|k| {
                    let t = k as f64 * dt_s;
                    amplitude * (-damping_per_s * t).exp() * (TAU * frequency_hz * t + 0.4).cos()
                })
                .collect();
            let k = spectrum.key_numbers(&y);
            assert!((k.frequency_hz / frequency_hz - 1.0).abs() < 0.02, "{k:?}");
            assert!((k.damping_per_s / damping_per_s - 1.0).abs() < 0.25, "{k:?}");
            assert!((k.amplitude_counts / amplitude - 1.0).abs() < 0.25, "{k:?}");
        }
    }

    #[test]
    fn the_ends_of_a_range_are_one_half_width_from_its_middle() {
        let at = |frequency_hz, damping_per_s| KeyNumbers {
            amplitude_counts: 1.0,
            damping_per_s,
            frequency_hz,
        };
        let numbers = [at(60.0, 2.0), at(70.0, 3.0), at(66.0, 4.0)];
        let range = KeyRange::of(numbers.iter(), 0.0).unwrap();
        assert!(numbers.iter().all(|k| range.distance(k) <= 1.0));
        assert_eq!(range.distance(&at(75.0, 3.0)), 2.0);
        assert_eq!(range.distance(&at(65.0, 3.0)), 0.0);
        assert!(KeyRange::of([].iter(), 0.0).is_none());
    }
}
