//! Reservoir sampling by hashes: a bounded sample of a window's signals that does not depend on their order.
//!
//! Every signal has a rank, which is a hash of its time and channel, and the signals of lowest rank are kept
//! (bottom-k sampling). So the sample, and all that is learned from it, is the same for any order of the
//! file, any chunking and any number of threads.

use super::averaging::SignalSet;
use crate::burst::Beside;
use xxhash_rust::xxh3::xxh3_64;

/// The rank (hash of time and channel, time, channel, hash of the samples); the last one distinguishes
/// signals of the same time and channel.
type Rank = (u64, i64, u32, u64);

/// The sample while signals are still offered.
#[derive(Debug, Default)]
pub struct Reservoir {
    capacity: usize,
    samples: usize,
    /// Ranks and slots of the signals that are held: up to a quarter more than the capacity, so that those of
    /// highest rank are dropped many at a time.
    held: Vec<(Rank, usize)>,
    /// The highest rank that is kept; `None` until signals were dropped for the first time.
    worst: Option<Rank>,
    /// Slots whose signals were dropped.
    free: Vec<usize>,
    /// The samples of every slot, one slot after the other, and what was recorded beside each signal.
    data: Vec<f32>,
    beside: Vec<Beside>,
    /// Severity of the label of each slot; NaN where it gives none.
    severity: Vec<f64>,
    /// Number of signals offered, whether kept or not.
    pub offered: u64,
}

impl Reservoir {
    pub fn new(samples: usize, capacity: usize) -> Reservoir {
        Reservoir { capacity, samples, ..Reservoir::default() }
    }

    /// Offers a signal. `severity`: that of its label; NaN: the label gives none.
    pub fn offer(&mut self, beside: Beside, signal: &[f64], severity: f64) {
        let Beside { t_acq_ns, channel, .. } = beside;
        self.offered += 1;
        if !self.may_keep(t_acq_ns, channel) {
            return;
        }
        let hash = hash_of(t_acq_ns, channel);
        let row: Vec<f32> = signal.iter().map(|&y| y as f32).collect();
        let content: Vec<u8> = row.iter().flat_map(|y| y.to_le_bytes()).collect();
        let rank = (hash, t_acq_ns, channel, xxh3_64(&content));
        if self.worst.is_some_and(|worst| rank >= worst) {
            return;
        }
        if self.held.len() > self.capacity + self.capacity / 4 {
            self.let_go();
        }
        let slot = self.free.pop().unwrap_or(self.beside.len());
        if slot == self.beside.len() {
            self.data.extend_from_slice(&row);
            self.beside.push(beside);
            self.severity.push(severity);
        } else {
            self.data[slot * self.samples..(slot + 1) * self.samples].copy_from_slice(&row);
            self.beside[slot] = beside;
            self.severity[slot] = severity;
        }
        self.held.push((rank, slot));
    }

    /// Drops duplicates, and the signals of highest rank beyond the capacity.
    fn let_go(&mut self) {
        let best = self.best();
        let mut stays = vec![false; self.beside.len()];
        best.iter().for_each(|(_, slot)| stays[*slot] = true);
        self.free = (0..stays.len()).filter(|slot| !stays[*slot]).collect();
        self.worst = best.get(self.capacity.wrapping_sub(1)).map(|(rank, _)| *rank);
        self.held = best;
    }

    /// The signals that would be kept now, in rank order and without duplicates, no more than the capacity.
    fn best(&self) -> Vec<(Rank, usize)> {
        let mut best = self.held.clone();
        best.sort_unstable();
        best.dedup_by_key(|(rank, _)| *rank);
        best.truncate(self.capacity);
        best
    }

    /// Whether a signal of that time and channel may be kept. If not, it would not be kept whatever its
    /// samples are, and need not be decoded.
    pub fn may_keep(&self, t_acq_ns: i64, channel: u32) -> bool {
        let rank = (hash_of(t_acq_ns, channel), t_acq_ns, channel);
        self.worst.is_none_or(|worst| rank <= (worst.0, worst.1, worst.2))
    }

    /// Memory that the samples take, bytes.
    pub fn bytes(&self) -> usize {
        self.data.capacity() * size_of::<f32>()
    }

    /// Sum and count of the recorded drive voltages, in rank order.
    pub fn voltage_sum(&self) -> (f64, usize) {
        let known: Vec<f64> = self
            .in_order()
            .map(|s| self.beside[s].drive_v)
            .filter(|v| *v > 0.0 && v.is_finite())
            .collect();
        (known.iter().sum(), known.len())
    }

    /// The sample in rank order, with drives relative to `reference_v` (1 where the drive was not recorded).
    pub fn into_set(&self, reference_v: Option<f64>) -> SignalSet {
        let mut set = SignalSet::new(self.samples);
        for slot in self.in_order() {
            let signal = &self.data[slot * self.samples..(slot + 1) * self.samples];
            let Beside { channel, drive_v, temperature_c, .. } = self.beside[slot];
            set.push(signal, channel, relative_drive(drive_v, reference_v), temperature_c);
            set.set_severity(self.severity[slot]);
        }
        set
    }

    /// The slots of the sample in rank order.
    fn in_order(&self) -> impl Iterator<Item = usize> {
        self.best().into_iter().map(|(_, slot)| slot)
    }
}

/// The hash that ranks signals by time and channel.
fn hash_of(t_acq_ns: i64, channel: u32) -> u64 {
    let mut key = [0; 12];
    key[..8].copy_from_slice(&t_acq_ns.to_le_bytes());
    key[8..].copy_from_slice(&channel.to_le_bytes());
    xxh3_64(&key)
}

/// The drive relative to the reference; 1 where either is not known. x_a is proportional to the drive
/// voltage, thesis (2-2), so this is the scale of the expected signal.
pub fn relative_drive(voltage_v: f64, reference_v: Option<f64>) -> f64 {
    match reference_v {
        Some(reference) if voltage_v > 0.0 && voltage_v.is_finite() => voltage_v / reference,
        _ => 1.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn beside(t_acq_ns: i64, channel: u32) -> Beside {
        let unknown = f64::NAN;
        Beside {
            channel,
            t_acq_ns,
            drive_v: unknown,
            temperature_c: unknown,
            idle_s: unknown,
            neighbours: unknown,
        }
    }

    #[test]
    fn sample_does_not_depend_on_the_order() {
        let signals: Vec<(i64, u32)> =
            (0..500).map(|i| (1_000_000 * (i as i64 / 50), i as u32 % 50)).collect();
        let fill = |order: &mut dyn Iterator<Item = &(i64, u32)>| {
            let mut r = Reservoir::new(2, 64);
            for &(t, c) in order {
                r.offer(beside(t, c), &[t as f64, f64::from(c)], f64::NAN);
            }
            r.into_set(None)
        };
        let forward = fill(&mut signals.iter());
        let backward = fill(&mut signals.iter().rev());
        assert_eq!(forward.len(), 64);
        assert_eq!(forward.data, backward.data);
        assert_eq!(forward.channel, backward.channel);
    }

    #[test]
    fn however_many_are_offered_memory_is_that_of_the_capacity() {
        let (samples, capacity) = (16, 64);
        let mut r = Reservoir::new(samples, capacity);
        let mut refused = 0;
        for i in 0..100 * capacity {
            let (t, channel) = (1_000 * (i as i64 / 50), i as u32 % 50);
            refused += usize::from(!r.may_keep(t, channel));
            r.offer(beside(t, channel), &[i as f64; 16], f64::NAN);
        }
        assert_eq!(r.offered, 100 * capacity as u64);
        // a quarter more is held before the worst go, and a vector doubles
        assert!(r.bytes() <= 2 * (capacity + capacity / 4 + 1) * samples * size_of::<f32>());
        assert!(refused > 90 * capacity, "most need not be decoded: {refused}");
        assert_eq!(r.into_set(None).len(), capacity);
    }

    #[test]
    fn repeats_of_one_burst_are_told_apart_by_their_samples() {
        let offer = |values: &[f64]| {
            let mut r = Reservoir::new(1, 2);
            values.iter().for_each(|&v| r.offer(beside(5, 5), &[v], f64::NAN));
            r.into_set(None).data
        };
        assert_eq!(offer(&[1.0, 2.0, 3.0]), offer(&[3.0, 1.0, 2.0]));
        // the very same signal again is no other
        assert_eq!(offer(&[1.0, 1.0, 2.0, 2.0, 3.0, 3.0]), offer(&[1.0, 2.0, 3.0]));
    }
}
