//! Channels that give the same bits again and again: a converter or a recorder that stands still says nothing of a nozzle.
//!
//! In: a printhead's bursts. Out: the channels whose last three signals were the same.

use crate::burst::Burst;
use crate::model::inner_product::dot;
use crate::verdict::unusable_signal;
use std::collections::{BTreeSet, HashMap};

/// Noise of one sample, counts, below which two signals of a converter may be equal by chance.
pub const LEAST_NOISE: f64 = 0.3;
/// Bursts that begin with other channels are remembered apart; more are not.
const MOST_PLACES: usize = 1 << 12;

/// Of one printhead.
#[derive(Debug, Default)]
pub struct Frozen {
    /// By a burst's first channel, its rows.
    last: HashMap<u32, Vec<Last>>,
    channels: BTreeSet<u32>,
    signal: Vec<f64>,
    /// Without a pattern: multiples of the golden ratio, less their whole part.
    weights: Vec<f64>,
}

/// A channel's last look.
#[derive(Clone, Copy, Debug, Default)]
struct Last {
    t_ns: i64,
    /// A few of its samples: mostly they tell that it is another signal.
    glance: [u8; 16],
    /// Where they did not: the sum over all samples, each with a weight of its own, which is the same only for the same samples.
    sum: Option<u64>,
}

impl Frozen {
    pub fn hear(&mut self, burst: &Burst, rails: [f64; 2]) {
        let (rows, t_ns) = (burst.channels as usize, burst.t_acq_ns);
        if self.last.len() >= MOST_PLACES && !self.last.contains_key(&burst.first_channel) {
            return;
        }
        let mut last = std::mem::take(self.last.entry(burst.first_channel).or_default());
        last.resize(rows.max(last.len()), Last::default());
        for (row, last) in last[..rows].iter_mut().enumerate() {
            // a burst that is written twice says nothing
            if last.t_ns == t_ns {
                continue;
            }
            let (glance, channel) = (burst.glance(row), burst.first_channel + row as u32);
            let before = last.sum.take();
            if last.glance == glance {
                last.sum = self.sum(burst, row, rails);
            }
            (last.t_ns, last.glance) = (t_ns, glance);
            if last.sum.is_some() && last.sum == before {
                self.channels.insert(channel);
            } else if !self.channels.is_empty() {
                self.channels.remove(&channel);
            }
        }
        self.last.insert(burst.first_channel, last);
    }

    /// `None`: it is not judged for another reason, or a constant, which is a dead sensor line.
    fn sum(&mut self, burst: &Burst, row: usize, rails: [f64; 2]) -> Option<u64> {
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

    pub fn is_frozen(&self, channel: u32) -> bool {
        !self.channels.is_empty() && self.channels.contains(&channel)
    }

    /// Ascending.
    pub fn channels(&self) -> Vec<u32> {
        self.channels.iter().copied().collect()
    }
}
