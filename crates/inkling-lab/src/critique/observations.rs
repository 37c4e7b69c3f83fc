//! The data of a critique: healthy signals, and what was recorded beside each.
//!
//! In: signals one by one, in any order, offered to a [`Sampler`]. Out: [`Observations`]: signals of one
//! length, sorted by printhead, channel and time, as a matrix of rows x samples. The sampler keeps at most
//! `capacity` signals, those with the lowest hashes of printhead, channel and time (without the channel, where
//! bursts must stay whole). So memory is bounded, the sample is random, and reruns agree.

use super::covariates::Covariates;
use super::work::Work;
use inkling_core::burst::Beside;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use xxhash_rust::xxh3::xxh3_64;

#[derive(Clone, Copy, Debug)]
pub struct Row {
    pub beside: Beside,
    pub printhead: usize,
    /// Index of the signal's channel among those of all printheads, without gaps; rows are sorted by it.
    pub unit: usize,
    /// Index of the acquisition, that is of printhead and time, without gaps, but not in the order of time.
    pub burst: usize,
}

#[derive(Clone, Debug)]
pub struct Observations {
    pub dt_s: f64,
    pub samples: usize,
    /// Whether all samples that were offered are whole counts.
    pub integer: bool,
    pub rows: Vec<Row>,
    /// What was recorded beside the rows; whoever changes it must call [`Observations::standardised`].
    pub beside: Covariates,
    y: Vec<f32>,
    /// For each element of `y` whether it counts for nothing, because it or the one before it may be clipped;
    /// empty if all count.
    pub lost: Vec<bool>,
    pub units: usize,
    pub bursts: usize,
    /// Number of signals that were offered.
    pub found: u64,
    pub printheads: Vec<String>,
    /// Told while they are worked on.
    pub work: Work,
}

impl Observations {
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    pub fn length_s(&self) -> f64 {
        self.dt_s * self.samples as f64
    }

    /// The price of a parameter in the Bayesian information criterion.
    pub fn ln_samples(&self) -> f64 {
        (self.len() as f64 * self.samples as f64).ln()
    }

    pub fn signal(&self, i: usize) -> &[f32] {
        &self.y[i * self.samples..(i + 1) * self.samples]
    }

    /// Sum of squares of a signal about its mean.
    pub fn movement(&self, i: usize) -> f64 {
        let y = || self.signal(i).iter().map(|y| f64::from(*y));
        let mean = y().sum::<f64>() / self.samples as f64;
        y().map(|y| (y - mean).powi(2)).sum()
    }

    /// The rows of each channel, by `Row::unit`.
    pub fn channels(&self) -> impl Iterator<Item = Range<usize>> {
        let each = self.rows.chunk_by(|p, q| p.unit == q.unit);
        each.scan(0, |next, rows| {
            *next += rows.len();
            Some(*next - rows.len()..*next)
        })
    }

    /// The same, with what was recorded beside them standardised anew, over these rows alone.
    pub fn standardised(mut self) -> Observations {
        let recorded: Vec<Beside> = self.rows.iter().map(|row| row.beside).collect();
        self.beside = Covariates::of(&recorded, self.bursts);
        self
    }

    /// Those rows whose index `keep` accepts. Channels and bursts are numbered anew. The standardised
    /// covariates keep their values, so a model that was fitted to all rows can be used with these.
    pub fn select(&self, keep: impl Fn(usize) -> bool) -> Observations {
        let (mut rows, mut y, mut lost) = (Vec::new(), Vec::new(), Vec::new());
        let (mut units, mut bursts) = (BTreeMap::new(), BTreeMap::new());
        for (i, row) in self.rows.iter().enumerate().filter(|(i, _)| keep(*i)) {
            let unit = numbered(&mut units, row.unit);
            let burst = numbered(&mut bursts, row.burst);
            rows.push(Row { unit, burst, ..*row });
            y.extend_from_slice(self.signal(i));
            lost.extend(self.lost.chunks(self.samples).nth(i).unwrap_or_default());
        }
        Observations {
            rows,
            y,
            lost,
            beside: self.beside.select(keep),
            units: units.len(),
            bursts: bursts.len(),
            printheads: self.printheads.clone(),
            work: self.work.clone(),
            ..*self
        }
    }

    /// The signals with AR(1) noise made white: y_k - rho y_{k-1}. A sum of exponentials stays one with the
    /// same rates, so a ring stays a ring. The first sample is cut.
    pub fn whitened(&self, rho: f64) -> Observations {
        let white = |i| self.signal(i).windows(2).map(|w| w[1] - rho as f32 * w[0]);
        let y = (0..self.len()).flat_map(white).collect();
        let lost = self.lost.chunks(self.samples).flat_map(|lost| &lost[1..]).copied().collect();
        Observations { samples: self.samples - 1, integer: false, y, lost, ..self.clone() }
    }

    pub fn is_lost(&self, i: usize, k: usize) -> bool {
        self.lost.get(i * self.samples + k).is_some_and(|lost| *lost)
    }
}

/// The number of a key, from 0 in the order in which they first come.
pub fn numbered<Key: Ord>(known: &mut BTreeMap<Key, usize>, key: Key) -> usize {
    let next = known.len();
    *known.entry(key).or_insert(next)
}

#[derive(Debug)]
struct Held {
    printhead: usize,
    beside: Beside,
    y: Vec<f32>,
}

#[derive(Debug)]
pub struct Sampler {
    dt_s: f64,
    capacity: usize,
    /// Whether the signals of a burst are kept or dropped together, as an oscillator's must be.
    pub whole_bursts: bool,
    /// Whether all samples of all signals offered so far are whole counts.
    integer: bool,
    printheads: BTreeMap<String, usize>,
    /// By the hash of each signal and its number among all that were offered. The last one is replaced next.
    held: BTreeMap<(u64, u64), Held>,
    found: u64,
}

impl Sampler {
    pub fn new(dt_s: f64, capacity: usize) -> Sampler {
        Sampler {
            dt_s,
            capacity: capacity.max(1),
            whole_bursts: false,
            integer: true,
            printheads: BTreeMap::new(),
            held: BTreeMap::new(),
            found: 0,
        }
    }

    pub fn len(&self) -> usize {
        self.held.len()
    }

    pub fn is_empty(&self) -> bool {
        self.held.is_empty()
    }

    /// The length N at which most samples are kept, if longer signals are cut to it and shorter ones left
    /// out.
    fn common_length(&self) -> usize {
        let mut lengths: Vec<usize> = self.held.values().map(|h| h.y.len()).collect();
        lengths.sort_unstable_by(|p, q| q.cmp(p));
        let kept = lengths.iter().enumerate().map(|(longer, &n)| (n * (longer + 1), n));
        kept.max().map_or(0, |(_, n)| n)
    }

    /// Offers a healthy signal of finite samples, counts.
    pub fn offer(&mut self, printhead: &str, beside: Beside, signal: &[f64]) {
        self.found += 1;
        self.integer &= signal.iter().all(|y| y.fract() == 0.0);
        let mut key = beside.t_acq_ns.to_le_bytes().to_vec();
        if !self.whole_bursts {
            key.extend_from_slice(&beside.channel.to_le_bytes());
        }
        key.extend_from_slice(printhead.as_bytes());
        let hash = xxh3_64(&key);
        if self.held.len() >= self.capacity {
            if self.held.last_key_value().is_some_and(|((worst, _), _)| hash >= *worst) {
                return;
            }
            self.held.pop_last();
        }
        let printhead = numbered(&mut self.printheads, printhead.to_owned());
        let held = Held { printhead, beside, y: signal.iter().map(|&y| y as f32).collect() };
        self.held.insert((hash, self.found), held);
    }

    pub fn finish(self) -> Observations {
        let samples = self.common_length();
        let mut all = self.held;
        // one burst more was begun than there is room for, unless a single one is all that there is
        if self.whole_bursts && self.found > all.len() as u64 {
            let cut = all.last_key_value().map(|((hash, _), _)| *hash);
            let is_whole = |hash: u64| Some(hash) != cut;
            if all.keys().any(|(hash, _)| is_whole(*hash)) {
                all.retain(|(hash, _), _| is_whole(*hash));
            }
        }
        let mut held: Vec<Held> = all.into_values().collect();
        held.retain(|h| h.y.len() >= samples);
        // a printhead may have none of the signals that are kept
        let kept: BTreeSet<usize> = held.iter().map(|h| h.printhead).collect();
        let mut printheads = self.printheads;
        printheads.retain(|_, number| kept.contains(number));
        // from numbers in the order of coming to numbers in the order of names
        let by_name: BTreeMap<usize, usize> =
            printheads.values().enumerate().map(|(k, &number)| (number, k)).collect();
        let key = |h: &Held| (by_name[&h.printhead], h.beside.channel, h.beside.t_acq_ns);
        held.sort_by_key(key);
        let (mut units, mut bursts) = (BTreeMap::new(), BTreeMap::new());
        let mut rows = Vec::with_capacity(held.len());
        let mut y = Vec::with_capacity(held.len() * samples);
        for h in &held {
            let (printhead, channel, time) = key(h);
            let unit = numbered(&mut units, (printhead, channel));
            let burst = numbered(&mut bursts, (printhead, time));
            rows.push(Row { beside: h.beside, printhead, unit, burst });
            y.extend_from_slice(&h.y[..samples]);
        }
        let all = Observations {
            dt_s: self.dt_s,
            samples,
            integer: self.integer,
            rows,
            beside: Covariates::default(),
            y,
            lost: Vec::new(),
            units: units.len(),
            bursts: bursts.len(),
            found: self.found,
            printheads: printheads.into_keys().collect(),
            work: Work::default(),
        };
        all.standardised()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sample_does_not_depend_on_the_order() {
        let signal = |i: i64| Beside {
            channel: (i % 7) as u32,
            t_acq_ns: i / 7,
            drive_v: 20.0,
            temperature_c: f64::NAN,
            idle_s: f64::NAN,
            neighbours: 0.0,
        };
        let drawn = |order: &mut dyn Iterator<Item = i64>| {
            let mut sampler = Sampler::new(1e-6, 40);
            for i in order {
                sampler.offer(if i % 2 == 0 { "b" } else { "a" }, signal(i), &[i as f64, 1.0]);
            }
            let drawn = sampler.finish();
            (0..drawn.len()).map(|i| drawn.signal(i)[0] as i64).collect::<Vec<_>>()
        };
        let forward = drawn(&mut (0..300));
        assert_eq!(forward.len(), 40);
        assert_eq!(forward, drawn(&mut (0..300).rev()));
    }

    /// Thirteen bursts of seven signals in room for forty: five are whole.
    #[test]
    fn bursts_that_are_held_are_whole() {
        let mut sampler = Sampler::new(1e-6, 40);
        sampler.whole_bursts = true;
        for i in 0..13 * 7 {
            sampler.offer("p", Beside::alone(i % 7, i64::from(i / 7)), &[1.0; 4]);
        }
        let held = sampler.finish();
        assert_eq!((held.found, held.len(), held.bursts), (91, 35, 5));
        // a single burst that is larger than the room is held in part
        let mut sampler = Sampler::new(1e-6, 40);
        sampler.whole_bursts = true;
        (0..50).for_each(|i| sampler.offer("p", Beside::alone(i, 0), &[1.0; 4]));
        assert_eq!(sampler.finish().len(), 40);
    }

    #[test]
    fn a_printhead_of_which_no_signal_is_kept_does_not_count() {
        let mut sampler = Sampler::new(1e-6, 10);
        sampler.offer("stray", Beside::alone(0, 0), &[1.0; 4]);
        (0..3).for_each(|i| sampler.offer("one", Beside::alone(0, i), &[1.0; 90]));
        let data = sampler.finish();
        assert_eq!((data.len(), data.printheads), (3, vec!["one".to_owned()]));
        assert!(data.rows.iter().all(|row| row.printhead == 0));
    }
}
