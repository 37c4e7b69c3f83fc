//! Baselines: each channel's own healthy ring, averaged over its history.
//!
//! In: features of the channel's healthy signals, recording after recording. Out: per channel the mean
//! features (ln amplitude, ln damping, ln frequency, phase), and the covariance of one channel's signals about
//! it. Judged against its own baseline, a channel shows faults much smaller than channels differ.
//!
//! A channel that is faulty from the start gets no baseline, since only healthy signals count. A baseline moves
//! by at most half the way to a recording's mean, and never learns from signals that are far from the healthy
//! channels, so that it does not follow a slowly growing fault for long. Sums are in fixed point, in units of
//! [`UNIT`]: they do not depend on the order of the signals.

use super::DesignError;
use nalgebra::{Matrix4, Vector4};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Version of the baseline file.
pub const BASELINE_VERSION: u32 = 1;
/// Channels of all printheads in a baseline file, at most.
pub const MOST_CHANNELS: usize = 1 << 20;
/// Fewest healthy signals for a baseline.
pub const FEWEST: u32 = 4;
/// Effective number of signals that a baseline averages over: older ones are forgotten exponentially.
const MEMORY: f64 = 64.0;
/// Largest share of the way to a recording's mean that a baseline moves.
const MOST_GAIN: f64 = 0.5;
/// Least share of healthy signals for a recording of a channel to be learned from.
const LEAST_HEALTHY: f64 = 0.75;
/// Signals that the covariance within channels counts, at most.
const MOST_SIGNALS: f64 = 1e6;
/// Largest entry of the covariance within channels: features are clamped to 4.
const MOST_SHOT: f64 = 32.0;
/// Unit of features in fixed point.
const UNIT: f64 = 1e-9;

/// Baselines of all printheads: what `--baseline FILE` holds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Baselines {
    pub version: u32,
    /// Digest of the design whose models the features are relative to; absent: there was none.
    pub design: Option<String>,
    pub printheads: BTreeMap<String, PrintheadBaselines>,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PrintheadBaselines {
    /// Covariance within channels: of one channel's signals about its baseline, from drop to drop, beyond the noise.
    pub shot: [[f64; 4]; 4],
    /// Degrees of freedom of `shot`.
    pub shot_signals: f64,
    pub channels: BTreeMap<u32, ChannelBaseline>,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ChannelBaseline {
    /// Effective number of healthy signals, each weighted by its precision relative to the reference drive.
    pub signals: f64,
    /// ln amplitude, ln damping, ln frequency, phase in rad: relative to the printhead's model.
    pub features: [f64; 4],
}

/// Sums over one channel's signals.
#[derive(Clone, Copy, Debug, Default)]
struct Sum {
    healthy: u32,
    unhealthy: u32,
    features: [i64; 4],
}

/// Sums over the signals of a recording, or of its first window, for one printhead's baselines.
#[derive(Clone, Debug, Default)]
pub struct Heard {
    channels: BTreeMap<u32, Sum>,
    all: Squares,
    /// Signals of channels beyond the limit on their number.
    pub beyond: u64,
}

/// Sums over healthy signals of all channels.
#[derive(Clone, Debug, Default)]
struct Squares {
    /// Of x x', its lower triangle row by row, in UNIT².
    products: [i128; 10],
    /// Of 1/drive², in millionths: the variance of their noise over the reference's.
    weaker: i64,
}

/// What is known of one signal.
#[derive(Clone, Copy, Debug)]
pub struct Said {
    /// ln amplitude, ln damping, ln frequency, phase in rad.
    pub features: Vector4<f64>,
    pub healthy: bool,
}

impl Heard {
    /// Adds a burst: of each signal from channel `first` on, what is known of it; `None`: it was not judged. `room`: how
    /// many channels may still be added.
    pub fn take(&mut self, first: u32, of: &[Option<Said>], drive: f64, room: &mut usize) {
        let weaker = ((1.0 / (drive * drive)).clamp(0.0, 1e4) * 1e6).round() as i64;
        let mut new = Vec::new();
        let mut known = self.channels.range_mut(first..).peekable();
        for (channel, said) in (first..).zip(of) {
            let Some(said) = said else { continue };
            while known.next_if(|(k, _)| **k < channel).is_some() {}
            match known.next_if(|(k, _)| **k == channel) {
                Some((_, sum)) => sum.add(said, &mut self.all, weaker),
                None => new.push((channel, said)),
            }
        }
        for (channel, said) in new {
            match room.checked_sub(1) {
                None => self.beyond += 1,
                Some(left) => {
                    *room = left;
                    self.channels.entry(channel).or_default().add(said, &mut self.all, weaker);
                }
            }
        }
    }

    /// Adds what was heard elsewhere.
    pub fn add(&mut self, other: &Heard) {
        for (channel, of) in &other.channels {
            let Sum { healthy, unhealthy, features } = of;
            let sum = self.channels.entry(*channel).or_default();
            sum.healthy = sum.healthy.saturating_add(*healthy);
            sum.unhealthy = sum.unhealthy.saturating_add(*unhealthy);
            sum.features.iter_mut().zip(features).for_each(|(s, f)| *s += f);
        }
        let Squares { products, weaker } = &other.all;
        self.all.products.iter_mut().zip(products).for_each(|(s, p)| *s += p);
        self.all.weaker += weaker;
        self.beyond += other.beyond;
    }

    pub fn channels(&self) -> usize {
        self.channels.len()
    }

    fn within(&self, noise: &Matrix4<f64>) -> Within {
        let (mut n, mut degrees) = (0.0, 0.0);
        let entry =
            |i: usize, j: usize| self.all.products[i.max(j) * (i.max(j) + 1) / 2 + i.min(j)];
        let mut scatter = Matrix4::from_fn(|i, j| entry(i, j) as f64 * UNIT * UNIT);
        for all in self.channels.values() {
            let healthy = f64::from(all.healthy);
            if all.healthy > 0 {
                let sum = Vector4::from(all.features.map(|f| f as f64 * UNIT));
                scatter -= sum * sum.transpose() / healthy;
                n += healthy;
                degrees += healthy - 1.0;
            }
        }
        let weaker = self.all.weaker as f64 * 1e-6 / f64::max(n, 1.0);
        if degrees < 16.0 {
            return Within { weaker: weaker.max(1e-9), shot: Matrix4::zeros(), degrees: 0.0 };
        }
        let beyond = scatter / degrees - noise * weaker;
        let eigen = beyond.symmetric_eigen();
        let kept = Matrix4::from_diagonal(&eigen.eigenvalues.map(|v| v.max(0.0)));
        let shot = eigen.eigenvectors * kept * eigen.eigenvectors.transpose();
        Within { weaker: weaker.max(1e-9), shot, degrees }
    }
}

/// Of a printhead's channels.
struct Within {
    /// Mean of 1/drive².
    weaker: f64,
    /// Covariance within channels beyond the noise, and its degrees of freedom.
    shot: Matrix4<f64>,
    degrees: f64,
}

/// In [`UNIT`]s, to the nearest; without the library's rounding, which would be a call for each number.
fn in_units(x: f64) -> i64 {
    const PER_UNIT: f64 = 1.0 / UNIT;
    (x * PER_UNIT + 0.5_f64.copysign(x)) as i64
}

impl Sum {
    #[inline]
    fn add(&mut self, of: &Said, all: &mut Squares, weaker: i64) {
        if !of.healthy {
            self.unhealthy = self.unhealthy.saturating_add(1);
        } else if self.healthy < 1 << 30 {
            self.healthy += 1;
            // healthy features are below 1; clamped, even others cannot overflow the sums
            let fixed: [i64; 4] =
                std::array::from_fn(|k| in_units(of.features[k].clamp(-4.0, 4.0)));
            self.features.iter_mut().zip(fixed).for_each(|(s, f)| *s += f);
            let mut products = all.products.iter_mut();
            for i in 0..4 {
                for (j, sum) in (0..=i).zip(&mut products) {
                    *sum += i128::from(fixed[i]) * i128::from(fixed[j]);
                }
            }
            all.weaker += weaker;
        }
    }

    /// The mean of the healthy signals; `None` where too few or too small a share were healthy.
    fn mean(&self) -> Option<[f64; 4]> {
        let all = f64::from(self.healthy) + f64::from(self.unhealthy);
        (self.healthy >= FEWEST && f64::from(self.healthy) >= LEAST_HEALTHY * all)
            .then(|| self.features.map(|f| f as f64 * UNIT / f64::from(self.healthy)))
    }
}

impl Baselines {
    pub fn new(design: Option<String>) -> Baselines {
        Baselines { version: BASELINE_VERSION, design, printheads: BTreeMap::new() }
    }

    /// Refuses what no run could have written.
    pub fn check(&self) -> Result<(), DesignError> {
        let refuse = |what: String| Err(DesignError::Invalid(what));
        if self.version != BASELINE_VERSION {
            return refuse(format!(
                "baseline version {}: this inkling reads version {BASELINE_VERSION}",
                self.version
            ));
        }
        let channels: usize = self.printheads.values().map(|p| p.channels.len()).sum();
        if channels > MOST_CHANNELS {
            return refuse(format!("{channels} channels: at most {MOST_CHANNELS}"));
        }
        for (name, printhead) in &self.printheads {
            let shot = Matrix4::from_fn(|i, j| printhead.shot[i][j]);
            if !is_covariance(&shot) {
                return refuse(format!(
                    "`shot` of printhead {name}: must be a covariance (symmetric, positive \
                     semidefinite), none of it beyond {MOST_SHOT}"
                ));
            }
            let whole = |c: &ChannelBaseline| {
                c.signals > 0.0 && c.signals <= MEMORY && c.features.iter().all(|f| f.abs() <= 4.0)
            };
            if !((0.0..=MOST_SIGNALS).contains(&printhead.shot_signals)
                && printhead.channels.values().all(whole))
            {
                return refuse(format!("baselines of printhead {name}: numbers out of range"));
            }
        }
        Ok(())
    }

    /// Number of channels with a baseline.
    pub fn channels(&self) -> usize {
        self.printheads.values().map(|p| p.channels.len()).sum()
    }

    /// The baselines that judge a recording: the known ones, and for channels without one the mean of the
    /// recording's first window, `heard`. `noise`: covariance of a fit's noise at the reference drive.
    pub fn with_first_window(
        &self,
        name: &str,
        heard: &Heard,
        noise: &Matrix4<f64>,
    ) -> PrintheadBaselines {
        let known = self.printheads.get(name).cloned().unwrap_or_default();
        let Within { weaker, shot, degrees } = heard.within(noise);
        let mut judging = merged_shot(&known, &shot, degrees);
        for (&channel, window) in &heard.channels {
            if let Some(features) = window.mean() {
                let signals = f64::from(window.healthy) / weaker;
                judging
                    .channels
                    .entry(channel)
                    .or_insert(ChannelBaseline { signals: signals.min(MEMORY), features });
            }
        }
        judging
    }

    /// Updates the baselines by a recording, for the next one.
    pub fn learn(&mut self, name: &str, heard: &Heard, noise: &Matrix4<f64>) {
        let Within { weaker, shot, degrees } = heard.within(noise);
        let known = self.printheads.remove(name).unwrap_or_default();
        let mut learned = merged_shot(&known, &shot, degrees);
        for (&channel, all) in &heard.channels {
            let Some(features) = all.mean() else { continue };
            let signals = (f64::from(all.healthy) / weaker).min(MEMORY);
            let new = ChannelBaseline { signals, features };
            let entry = learned.channels.entry(channel).or_insert(new);
            if known.channels.contains_key(&channel) {
                let gain = (signals / (entry.signals + signals)).min(MOST_GAIN);
                entry.features.iter_mut().zip(features).for_each(|(e, f)| *e += gain * (f - *e));
                entry.signals = (entry.signals + signals).min(MEMORY);
            }
        }
        self.printheads.insert(name.into(), learned);
    }
}

/// Whether a matrix is symmetric, positive semidefinite and bounded, up to rounding.
fn is_covariance(m: &Matrix4<f64>) -> bool {
    const ROUNDING: f64 = 1e-9;
    let most = m.amax();
    let bounded = m.iter().all(|v| v.abs() <= MOST_SHOT);
    bounded
        && (m - m.transpose()).amax() <= ROUNDING * most
        && m.symmetric_eigenvalues().min() >= -ROUNDING * most
}

fn merged_shot(
    known: &PrintheadBaselines,
    shot: &Matrix4<f64>,
    degrees: f64,
) -> PrintheadBaselines {
    let total = known.shot_signals + degrees;
    let share = if total > 0.0 { degrees / total } else { 0.0 };
    let mut merged = known.clone();
    for i in 0..4 {
        for j in 0..4 {
            merged.shot[i][j] += share * (shot[(i, j)] - merged.shot[i][j]);
        }
    }
    merged.shot_signals = total.min(MOST_SIGNALS);
    merged
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `n` signals of each of some channels about their own features, in an order.
    fn heard(channels: &[(u32, f64, u32)], backwards: bool) -> Heard {
        let mut signals = Vec::new();
        for &(channel, at, n) in channels {
            for i in 0..n {
                let off = 0.01 * (f64::from(i * 7 % 11) - 5.0) / 5.0;
                signals.push((channel, Vector4::new(at + off, at - off, 0.1 * off, off), at < 0.5));
            }
        }
        if backwards {
            signals.reverse();
        }
        let (mut heard, mut room) = (Heard::default(), 100);
        for (channel, features, healthy) in &signals {
            let said = Said { features: *features, healthy: *healthy };
            heard.take(*channel, &[Some(said)], 0.9, &mut room);
        }
        heard
    }

    fn noise() -> Matrix4<f64> {
        Matrix4::identity() * 1e-4
    }

    #[test]
    fn no_order_of_the_signals_gives_other_baselines() {
        let said = [(1, 0.02, 40), (2, -0.03, 35), (9, 0.0, 5)];
        let (mut forwards, mut backwards) = (Baselines::new(None), Baselines::new(None));
        forwards.learn("p", &heard(&said, false), &noise());
        backwards.learn("p", &heard(&said, true), &noise());
        assert_eq!(forwards, backwards);
        forwards.check().unwrap();
        let found = forwards.printheads["p"].channels[&2].features;
        assert!((found[0] + 0.03).abs() < 0.003, "{found:?}");
    }

    #[test]
    fn a_channel_that_was_faulty_from_the_start_has_no_baseline() {
        let mut baselines = Baselines::new(None);
        let said = heard(&[(1, 0.0, 20), (2, 0.9, 20), (3, 0.0, 3)], false);
        baselines.learn("p", &said, &noise());
        let known = &baselines.printheads["p"].channels;
        assert!(known.contains_key(&1) && !known.contains_key(&2) && !known.contains_key(&3));
        let judging = Baselines::new(None).with_first_window("p", &said, &noise());
        assert_eq!(&judging.channels, known);
    }

    #[test]
    fn one_recording_moves_a_baseline_by_half_the_way_at_most() {
        let mut baselines = Baselines::new(None);
        baselines.learn("p", &heard(&[(1, 0.0, 11)], false), &noise());
        baselines.learn("p", &heard(&[(1, 0.1, 5000)], false), &noise());
        let moved = baselines.printheads["p"].channels[&1];
        assert!((0.03..0.056).contains(&moved.features[0]), "{moved:?}");
        assert!(moved.signals <= MEMORY);
    }

    #[test]
    fn channels_beyond_the_limit_are_counted() {
        let (mut heard, mut room) = (Heard::default(), 1);
        for channel in 0..3 {
            let said = Said { features: Vector4::zeros(), healthy: true };
            heard.take(channel, &[Some(said)], 1.0, &mut room);
        }
        assert_eq!((heard.channels(), heard.beyond), (1, 2));
    }

    #[test]
    fn senseless_files_are_refused() {
        let mut baselines = Baselines::new(None);
        baselines.learn("p", &heard(&[(1, 0.0, 20)], false), &noise());
        let mut other = baselines.clone();
        other.version = 2;
        assert!(other.check().is_err());
        if let Some(printhead) = baselines.printheads.get_mut("p") {
            printhead.shot[0][0] = -1.0;
        }
        assert!(baselines.check().is_err());
    }

    #[test]
    fn scatter_that_is_no_covariance_is_refused() {
        let with = |shot: [[f64; 4]; 4]| {
            let mut baselines = Baselines::new(None);
            baselines.learn("p", &heard(&[(1, 0.0, 20)], false), &noise());
            baselines.printheads.get_mut("p").unwrap().shot = shot;
            baselines.check()
        };
        let mut shot = [[0.0; 4]; 4];
        with(shot).unwrap();
        for (i, row) in shot.iter_mut().enumerate() {
            row[i] = 1e-3;
        }
        with(shot).unwrap();
        let entry = |i: usize, j: usize, v: f64| {
            let mut other = shot;
            other[i][j] = v;
            other
        };
        for wrong in
            [entry(0, 1, 5e-4), entry(2, 2, 1e3), entry(3, 3, -1e-3), entry(1, 1, f64::NAN)]
        {
            assert!(with(wrong).unwrap_err().to_string().contains("shot"));
        }
        // symmetric, but one direction is less than nothing
        let mut indefinite = entry(0, 1, 2e-3);
        indefinite[1][0] = 2e-3;
        assert!(with(indefinite).is_err());
    }
}
