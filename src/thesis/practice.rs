//! The current practice as a baseline: dominant amplitude, frequency and damping by Fourier
//! transform, per-class thresholds on frequency and damping learned on training signals.
//!
//! In: signals. Out: their key numbers (thesis §4-1) and what thresholds on them say (§4-2, §4-3).
//! The maker's own toolbox is not published: this is what its description amounts to.

use super::data::Signals;
use crate::fault::HEALTHY;
use std::f64::consts::TAU;

/// Dominant amplitude, damping and frequency of a signal, thesis §4-1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KeyNumbers {
    pub amplitude_counts: f64,
    pub damping_per_s: f64,
    pub frequency_hz: f64,
}

/// Frequencies looked at, Hz.
const LOWEST_HZ: f64 = 15e3;
const STEP_HZ: f64 = 1e3;
const STEPS: usize = 96;

/// A Fourier transform on the frequencies looked at.
pub struct Spectrum {
    dt_s: f64,
    /// Per frequency: cos and sin at every sample.
    waves: Vec<(Vec<f64>, Vec<f64>)>,
}

impl Spectrum {
    pub fn new(samples: usize, dt_s: f64) -> Spectrum {
        let wave = |k: usize| {
            let omega = TAU * (LOWEST_HZ + k as f64 * STEP_HZ) * dt_s;
            let at = |f: fn(f64) -> f64| (0..samples).map(|n| f(omega * n as f64)).collect();
            (at(f64::cos), at(f64::sin))
        };
        Spectrum { dt_s, waves: (0..STEPS).map(wave).collect() }
    }

    /// The peak of the spectrum, between its frequencies by a parabola; the damping from what the
    /// peak loses from the first half of the signal to the second.
    pub fn key_numbers(&self, y: &[f64]) -> KeyNumbers {
        let power = |(cos, sin): &(Vec<f64>, Vec<f64>)| magnitude(y, cos, sin).powi(2);
        let powers: Vec<f64> = self.waves.iter().map(power).collect();
        let mut top = 0;
        for k in 1..powers.len() {
            if powers[k] > powers[top] {
                top = k;
            }
        }
        let mut shift = 0.0;
        if top > 0 && top + 1 < powers.len() {
            let [l, m, r] = [top - 1, top, top + 1].map(|k| powers[k].max(f64::MIN_POSITIVE).ln());
            let bend = l - 2.0 * m + r;
            if bend < 0.0 {
                shift = (0.5 * (l - r) / bend).clamp(-0.5, 0.5);
            }
        }
        let frequency_hz = LOWEST_HZ + (top as f64 + shift) * STEP_HZ;
        let (cos, sin) = &self.waves[top];
        let half = y.len() / 2;
        let first = magnitude(&y[..half], &cos[..half], &sin[..half]);
        let second = magnitude(&y[half..], &cos[half..], &sin[half..]);
        let damping_per_s =
            (first / second.max(f64::MIN_POSITIVE)).ln() / (half as f64 * self.dt_s);
        // |sum of A e^{-sigma t} cos| ~ A/2 (1 - e^{-sigma T/2}) / (sigma dt) over the first half
        let span = half as f64 * self.dt_s;
        let decay = damping_per_s * span;
        let mean = if decay.abs() < 1e-6 { 1.0 } else { -(-decay).exp_m1() / decay };
        let amplitude_counts = 2.0 * first / (half as f64 * mean);
        KeyNumbers { amplitude_counts, damping_per_s, frequency_hz }
    }

    pub fn of_all(&self, signals: &Signals) -> Vec<KeyNumbers> {
        signals.y.iter().map(|y| self.key_numbers(y)).collect()
    }
}

fn magnitude(y: &[f64], cos: &[f64], sin: &[f64]) -> f64 {
    let (mut re, mut im) = (0.0, 0.0);
    for ((y, c), s) in y.iter().zip(cos).zip(sin) {
        re += y * c;
        im += y * s;
    }
    re.hypot(im)
}

/// Thresholds of one class: the range of its training signals.
struct Range {
    name: String,
    frequency_hz: [f64; 2],
    damping_per_s: [f64; 2],
}

impl Range {
    /// How far outside, in half-widths of the range; up to 1 inside.
    fn distance(&self, k: &KeyNumbers) -> f64 {
        let off = |v: f64, [low, high]: [f64; 2]| {
            ((v - 0.5 * (low + high)) / (0.5 * (high - low)).max(f64::MIN_POSITIVE)).abs()
        };
        off(k.frequency_hz, self.frequency_hz).max(off(k.damping_per_s, self.damping_per_s))
    }
}

/// Thresholds per class.
pub struct Thresholds {
    ranges: Vec<Range>,
}

impl Thresholds {
    /// The range of every class's training signals; of healthy ones all, of faults the middle 98 %.
    pub fn learn(signals: &Signals, numbers: &[KeyNumbers]) -> Thresholds {
        let mut names: Vec<&str> = signals.state.iter().map(String::as_str).collect();
        names.sort_unstable();
        names.dedup();
        let range = |name: &str, of: fn(&KeyNumbers) -> f64| {
            let mut v: Vec<f64> = numbers
                .iter()
                .zip(&signals.state)
                .filter(|(_, s)| *s == name)
                .map(|(k, _)| of(k))
                .collect();
            v.sort_unstable_by(f64::total_cmp);
            let cut = if name == HEALTHY { 0 } else { v.len() / 100 };
            [v[cut], v[v.len() - 1 - cut]]
        };
        let of_class = |name: &&str| Range {
            name: (*name).into(),
            frequency_hz: range(name, |k| k.frequency_hz),
            damping_per_s: range(name, |k| k.damping_per_s),
        };
        Thresholds { ranges: names.iter().map(of_class).collect() }
    }

    pub fn is_faulty(&self, k: &KeyNumbers) -> bool {
        self.ranges.iter().any(|r| r.name == HEALTHY && r.distance(k) > 1.0)
    }

    /// The class whose range is nearest; `None`: within no range of `known` classes.
    pub fn name(&self, k: &KeyNumbers, known: &[&str]) -> Option<&str> {
        self.ranges
            .iter()
            .filter(|r| known.contains(&r.name.as_str()))
            .map(|r| (r.distance(k), r.name.as_str()))
            .filter(|(distance, _)| *distance <= 1.0)
            .min_by(|p, q| p.0.total_cmp(&q.0))
            .map(|(_, name)| name)
    }
}
