//! Reservoir sampling by hashes: a bounded sample of a recording's signals that does not depend on
//! their order.
//!
//! In: signals with their covariates, from the pipeline (`collect.rs`). Out: a [`SignalSet`] of at most `capacity` signals.
//!
//! Every signal has a rank, a hash of its time and channel, and the signals of lowest rank are kept
//! (bottom-k sampling). A hash is as good as random, so the sample is a fair one, and it is the same
//! for any order of the file, any chunking and any number of threads.

use super::SignalSet;
use crate::burst::Beside;
use std::collections::BTreeMap;
use xxhash_rust::xxh3::xxh3_64;

/// The rank of a signal: hash of time and channel, time, channel, hash of the samples and
/// covariates. A signal that is the same in all of this is held only once.
type Rank = (u64, i64, u32, u64);

#[derive(Debug)]
struct HeldSignal {
    samples: Vec<f32>,
    beside: Beside,
    /// Severity of the signal's label; NaN: it gives none.
    severity: f64,
}

#[derive(Debug)]
pub struct Reservoir {
    capacity: usize,
    samples: usize,
    held: BTreeMap<Rank, HeldSignal>,
}

impl Reservoir {
    pub fn new(samples: usize, capacity: usize) -> Reservoir {
        Reservoir { capacity, samples, held: BTreeMap::new() }
    }

    /// `signal`: N counts; `severity`: of its label; NaN: none.
    pub fn offer(&mut self, beside: Beside, signal: &[f64], severity: f64) {
        let Beside { t_acq_ns, channel, .. } = beside;
        if !self.may_keep(t_acq_ns, channel) {
            return;
        }

        let samples: Vec<f32> = signal.iter().map(|&y| y as f32).collect();
        let beside_it = [beside.drive_v, beside.temperature_c, severity];
        let content: Vec<u8> = samples
            .iter()
            .flat_map(|y| y.to_le_bytes())
            .chain(beside_it.iter().flat_map(|v| v.to_le_bytes()))
            .collect();
        let rank = (hash_of(t_acq_ns, channel), t_acq_ns, channel, xxh3_64(&content));

        self.held.entry(rank).or_insert(HeldSignal { samples, beside, severity });
        if self.held.len() > self.capacity {
            self.held.pop_last();
        }
    }

    /// Whether a signal may be kept, whatever its samples are.
    fn may_keep(&self, t_acq_ns: i64, channel: u32) -> bool {
        let rank = (hash_of(t_acq_ns, channel), t_acq_ns, channel);
        let is_below = |worst: &Rank| rank <= (worst.0, worst.1, worst.2);
        let full = self.held.len() >= self.capacity;
        !full || self.held.last_key_value().is_some_and(|(worst, _)| is_below(worst))
    }

    /// Sum, V, and count of the recorded drive voltages; in rank order, for the same bits always.
    pub fn voltage_sum(&self) -> (f64, usize) {
        let all = self.held.values().map(|held| held.beside.drive_v);
        let known: Vec<f64> = all.filter(|v| *v > 0.0 && v.is_finite()).collect();
        (known.iter().sum(), known.len())
    }

    /// The sample in rank order, with drives relative to `reference_v`.
    pub fn to_set(&self, reference_v: Option<f64>) -> SignalSet {
        let mut set = SignalSet::new(self.samples);
        for HeldSignal { samples, beside, severity } in self.held.values() {
            let drive = relative_drive(beside.drive_v, reference_v);
            set.push(samples, drive, beside);
            set.set_severity(*severity);
        }
        set
    }
}

fn hash_of(t_acq_ns: i64, channel: u32) -> u64 {
    let mut key = [0; 12];
    key[..8].copy_from_slice(&t_acq_ns.to_le_bytes());
    key[8..].copy_from_slice(&channel.to_le_bytes());
    xxh3_64(&key)
}

/// A number that looks random and depends on `x` alone: who keeps what has the lowest ones draws a fair sample.
pub fn drawn_by(x: i64) -> u64 {
    xxh3_64(&x.to_le_bytes())
}

/// The drive, to which a signal is proportional, relative to the reference; 1: not known.
pub fn relative_drive(voltage_v: f64, reference_v: Option<f64>) -> f64 {
    match reference_v {
        Some(reference) if voltage_v > 0.0 && voltage_v.is_finite() => voltage_v / reference,
        _ => 1.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sample_does_not_depend_on_the_order() {
        let signals: Vec<(i64, u32)> =
            (0..500).map(|i| (1_000_000 * (i as i64 / 50), i as u32 % 50)).collect();
        let fill = |order: &mut dyn Iterator<Item = &(i64, u32)>| {
            let mut r = Reservoir::new(2, 64);
            for &(t, c) in order {
                r.offer(Beside::alone(c, t), &[t as f64, f64::from(c)], f64::NAN);
            }
            r.to_set(None)
        };
        let forward = fill(&mut signals.iter());
        let backward = fill(&mut signals.iter().rev());
        assert_eq!(forward.len(), 64);
        assert_eq!(forward.data, backward.data);
        assert_eq!(forward.channel, backward.channel);
    }

    #[test]
    fn however_many_are_offered_only_the_capacity_is_held() {
        let (samples, capacity) = (16, 64);
        let mut r = Reservoir::new(samples, capacity);
        let mut refused = 0;
        for i in 0..100 * capacity {
            let (t, channel) = (1_000 * (i as i64 / 50), i as u32 % 50);
            refused += usize::from(!r.may_keep(t, channel));
            r.offer(Beside::alone(channel, t), &[i as f64; 16], f64::NAN);
        }
        assert!(refused > 90 * capacity, "most need not be held: {refused}");
        assert_eq!(r.to_set(None).len(), capacity);
    }

    #[test]
    fn repeats_of_one_burst_are_told_apart_by_their_samples() {
        let offer = |values: &[f64]| {
            let mut r = Reservoir::new(1, 2);
            values.iter().for_each(|&v| r.offer(Beside::alone(5, 5), &[v], f64::NAN));
            r.to_set(None).data
        };
        assert_eq!(offer(&[1.0, 2.0, 3.0]), offer(&[3.0, 1.0, 2.0]));
        // the very same signal again is no other, but at another drive it is
        assert_eq!(offer(&[1.0, 1.0, 2.0, 2.0, 3.0, 3.0]), offer(&[1.0, 2.0, 3.0]));
        let by_drive = |drives: [f64; 2]| {
            let mut r = Reservoir::new(1, 1);
            drives.iter().for_each(|&drive_v| {
                r.offer(Beside { drive_v, ..Beside::alone(5, 5) }, &[1.0], f64::NAN);
            });
            r.to_set(Some(1.0)).drive
        };
        assert_eq!(by_drive([30.0, 40.0]), by_drive([40.0, 30.0]));
    }
}
