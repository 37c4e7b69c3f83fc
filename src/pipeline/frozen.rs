//! Finds frozen channels, which give the same bits again and again: a converter or a recorder that stands
//! still says nothing of a nozzle.
//!
//! In: a printhead's bursts, from `heads`, in about the order of time. Out: the channels whose last three
//! signals were the same bit by bit; of the oldest of the three only the *glance*, 16 bytes, is compared.
//!
//! Signals are not kept. Only if a glance is that of the signal before, which is rare, a weighted sum over all
//! samples is computed, too. The channel is frozen when two such sums in a row are equal.

use inkling_core::burst::Burst;
use inkling_core::model::inner_product::dot;
use inkling_core::verdict::unusable_signal;
use std::collections::{BTreeSet, HashMap};

/// Noise of one sample, counts, below which two signals of a converter may be equal by chance.
pub const LEAST_NOISE: f64 = 0.3;
/// Maximum number of channels of a printhead that are watched: the first that are heard.
const MOST_CHANNELS: usize = 1 << 14;

#[derive(Debug, Default)]
pub struct Frozen {
    /// What is kept of the last signal of each row, by the first channel of the bursts: a logger divides
    /// channels into bursts always alike.
    last: HashMap<u32, Vec<LastLook>>,
    watched: usize,
    channels: BTreeSet<u32>,
    sums: Sums,
}

#[derive(Debug, Default)]
struct Sums {
    signal: Vec<f64>,
    /// One weight per sample, without a pattern: .5 plus the fractional part of a multiple of the golden ratio.
    weights: Vec<f64>,
}

#[derive(Clone, Copy, Debug, Default)]
struct LastLook {
    t_ns: i64,
    glance: [u8; 16],
    /// The bits of the weighted sum over all samples; only if the glance is that of the signal before.
    sum: Option<u64>,
}

impl Frozen {
    /// Takes in a burst. A channel is frozen if three signals in a row agree: two equal glances give a sum,
    /// and the sum of the third must be that of the second. `rails`: limits of the converter, counts.
    pub fn hear(&mut self, burst: &Burst, rails: [f64; 2]) {
        let (rows, t_ns) = (burst.channels as usize, burst.t_acq_ns);
        let known = self.last.get(&burst.first_channel).map_or(0, Vec::len);
        let new = rows.saturating_sub(known).min(MOST_CHANNELS - self.watched);
        self.watched += new;
        if known + new == 0 {
            return;
        }

        let last = self.last.entry(burst.first_channel).or_default();
        last.resize(known + new, LastLook::default());
        let channels = burst.first_channel..=u32::MAX;
        for ((row, last), channel) in last.iter_mut().take(rows).enumerate().zip(channels) {
            // a burst that is written twice says nothing
            if last.t_ns == t_ns {
                continue;
            }
            // `before`: the sum of the signal before, if that had the glance of its own predecessor
            let glance = burst.glance(row);
            let before = last.sum.take();
            if last.glance == glance {
                last.sum = self.sums.of(burst, row, rails);
            }
            (last.t_ns, last.glance) = (t_ns, glance);
            if last.sum.is_some() && last.sum == before {
                self.channels.insert(channel);
            } else {
                self.channels.remove(&channel);
            }
        }
    }

    pub fn is_frozen(&self, channel: u32) -> bool {
        self.channels.contains(&channel)
    }

    pub fn channels(&self) -> Vec<u32> {
        self.channels.iter().copied().collect()
    }
}

impl Sums {
    /// `None`: the row is not judged for another reason, or is constant, which is a dead sensor line.
    fn of(&mut self, burst: &Burst, row: usize, rails: [f64; 2]) -> Option<u64> {
        let samples = burst.samples_per_channel as usize;
        if self.weights.len() != samples {
            let golden = 0.5 * (5.0_f64.sqrt() - 1.0);
            self.weights = (1..=samples).map(|i| 0.5 + (i as f64 * golden).fract()).collect();
            self.signal = vec![0.0; samples];
        }
        burst.copy_signal(row, &mut self.signal);
        let is_constant = self.signal.iter().all(|y| *y == self.signal[0]);
        let is_usable = unusable_signal(&self.signal, rails).is_none();
        (is_usable && !is_constant).then(|| dot(&self.weights, &self.signal).to_bits())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use inkling_core::burst::{Format, Layout};

    #[test]
    fn channels_beyond_the_most_are_not_remembered_however_many_bursts_they_are_in() {
        let of = |first_channel: u32| {
            let burst = Burst::of(&[vec![1.0, 2.0]], 1e-6, Format::S16Le, Layout::ChannelMajor);
            Burst { first_channel, ..burst }
        };
        let mut frozen = Frozen::default();
        for channel in 0..3 * MOST_CHANNELS as u32 {
            frozen.hear(&of(channel), [-32768.0, 32767.0]);
        }
        assert_eq!((frozen.last.len(), frozen.watched), (MOST_CHANNELS, MOST_CHANNELS));
    }

    #[test]
    fn a_channel_recovers_in_a_burst_of_more_channels_than_there_is_room_for() {
        let of = |t_acq_ns: i64, rows: usize, y: f32| {
            let rows = vec![vec![1.0, y]; rows];
            let burst = Burst::of(&rows, 1e-6, Format::S16Le, Layout::ChannelMajor);
            Burst { t_acq_ns, ..burst }
        };
        let mut frozen = Frozen::default();
        (1..=3).for_each(|t| frozen.hear(&of(t, 2, 2.0), [-32768.0, 32767.0]));
        assert_eq!(frozen.channels(), [0, 1]);
        frozen.hear(&of(4, MOST_CHANNELS + 5, 3.0), [-32768.0, 32767.0]);
        assert_eq!((frozen.channels(), frozen.watched), (vec![], MOST_CHANNELS));
    }
}
