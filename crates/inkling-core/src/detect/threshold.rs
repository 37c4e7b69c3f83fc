//! The threshold on a detection statistic, learned from signals that are all known to be healthy.
//!
//! In: the statistics of healthy training signals (*energies*, after the thesis; only their order
//! and ratios matter), and the channel that each came from. Out: a [`Threshold`], above which a
//! signal counts as faulty. Signals of which some may be faulty go to [`super::contamination`].
//!
//! [`max`] is thesis (3-4), mu times the largest energy.
//!
//! Departs: the largest energy grows with the number of training signals. So the default is
//! [`quantile`]: the energy that healthy signals exceed at a chosen rate, with a confidence bound.
//!
//! 1. The largest energies (a tenth by default) are the tail. Signals of one channel resemble each
//!    other, so the tail counts as fewer, independent signals (design effect).
//! 2. A generalised Pareto distribution is fitted to the excesses over the tail's lower end
//!    (`pareto_tail.rs`); the result is a posterior of the quantile.
//! 3. The threshold is that posterior's upper end at the chosen confidence.

use super::DetectError;
use super::pareto_tail::{Effective, ParetoTail};
use crate::numbers::tuned::little;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Smallest number of healthy signals for the estimate of a tail.
const MIN_SIGNALS: usize = 20;
/// The tail is `little` (a tenth) of all signals, but lies between these two. It is at least twice
/// the number expected beyond the threshold, and half of all signals at most (this bound wins).
const MIN_TAIL: usize = 50;
const MAX_TAIL: usize = 5000;
/// A window's threshold that is raised over its estimate by more than this hides small faults.
const WIDE: f64 = 2.0;
/// The channels are too few if the upper end of the posterior exceeds its median by this factor.
const MAX_FACTOR: f64 = 1e3;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// As a tail quantile: [`quantile`].
    Quantile,
    /// As a multiple of the largest energy, thesis (3-4): [`max`].
    #[default]
    Max,
    /// From a window of unlabelled signals: [`super::contamination`].
    Window,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Threshold {
    /// The threshold, counts²·s for a residual energy. A signal is healthy up to and including it.
    pub value: f64,
    pub method: Method,
    /// Factor mu of (3-4); with method `max` only.
    pub mu: Option<f64>,
    /// Largest share of healthy signals above `value`, with the probability `confidence`; not for `max`.
    pub false_alarm_rate: Option<f64>,
    pub confidence: Option<f64>,
    pub n_signals: usize,
    pub n_channels: usize,
    /// The number of independent signals that would say as much about the tail; with method `window`
    /// the estimated number of healthy signals.
    pub n_effective: f64,
    /// Number of signals to which the tail was fitted; 0 with methods `max` and `window`.
    pub n_tail: usize,
    /// Shape xi of the tail (posterior mean), above 0 heavier than exponential; with method `window` 1
    /// / kappa (`mixture.rs`).
    pub tail_shape: f64,
    /// With method `window`: the factor by which `value` exceeds its estimate.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub widened: Option<f64>,
}

impl Threshold {
    /// The threshold before anything was learned: no signal exceeds it.
    pub fn none() -> Threshold {
        Threshold { value: f64::INFINITY, ..Threshold::default() }
    }

    pub fn scaled(&self, factor: f64) -> Threshold {
        Threshold { value: self.value * factor, ..self.clone() }
    }

    /// A warning where a window's threshold was raised much.
    pub fn wide_in_words(&self) -> Option<String> {
        let widened = self.widened.filter(|by| *by > WIDE)?;
        Some(format!(
            "a window of {} signals of {} channels supports the stated rate of false alarms only with a \
             threshold {widened:.1} times as far out: slight faults may pass; a longer window \
             (identify.first, and identify.every no shorter) or a design says more",
            self.n_signals, self.n_channels
        ))
    }

    pub fn in_words(&self) -> String {
        match (self.method, self.false_alarm_rate, self.confidence) {
            (Method::Quantile, Some(rate), Some(confidence)) => format!(
                "false alarms <= {rate:e} with {:.0} % confidence; generalised Pareto tail of {} \
                 signals, {:.0} effective",
                100.0 * confidence,
                self.n_signals,
                self.n_effective
            ),
            (Method::Window, Some(rate), _) => format!(
                "false alarms <= {rate:e}; law of the window's {} signals, {:.0} of them healthy, \
                 widened by {:.2}",
                self.n_signals,
                self.n_effective,
                self.widened.unwrap_or(1.0)
            ),
            _ => format!(
                "{} times the largest of {} energies",
                self.mu.unwrap_or(1.0),
                self.n_signals
            ),
        }
    }

    /// f of thesis §3-2, after (3-4): a signal is faulty above the threshold, healthy on it.
    pub fn is_faulty(&self, energy: f64) -> bool {
        energy > self.value || energy.is_nan()
    }
}

/// T = mu max(e_h), thesis (3-4), for energies e_h, each with its channel. An error if all are 0.
pub fn max(energies: &[f64], channels: &[u32], mu: f64) -> Result<Threshold, DetectError> {
    let sample = Sample::new(energies, channels, 1, "max")?;
    let value = mu * sample.descending[0].0;
    Ok(Threshold {
        value,
        method: Method::Max,
        mu: Some(mu),
        n_signals: energies.len(),
        n_channels: sample.channels,
        n_effective: sample.effective(1),
        ..Threshold::default()
    })
}

/// The energy that at most `false_alarm_rate` (up to .25) of healthy signals exceed, with the
/// probability `confidence` (.5 to .999). `channels`: of each of the 20 or more energies, numbered over
/// all printheads. An error if the posterior is so wide that the bound tells nothing.
pub fn quantile(
    energies: &[f64],
    channels: &[u32],
    false_alarm_rate: f64,
    confidence: f64,
) -> Result<Threshold, DetectError> {
    let sample = Sample::new(energies, channels, MIN_SIGNALS, "quantile")?;
    let n = energies.len();

    // how many of the largest energies the tail is fitted to
    let tail = ((little() * n as f64) as usize)
        .clamp(MIN_TAIL, MAX_TAIL)
        // a quantile that lies inside the sample needs signals of the tail on both sides of it
        .max((2.0 * false_alarm_rate * n as f64).ceil() as usize)
        .min(n / 2);

    // how many independent signals the tail is worth, as a share of all and by its excesses
    let (number, level) = (sample.effective(tail), sample.descending[tail].0);
    let excesses = sample.independent(tail, |i| sample.descending[i].0 - level);
    let effective = Effective { number: tail as f64 * number / n as f64, excesses };
    let energies: Vec<f64> = sample.descending[..tail].iter().map(|(e, _)| *e).collect();
    let law = ParetoTail::fit(&energies, level, effective);

    let beyond = false_alarm_rate * n as f64 / tail as f64;
    let value = law.quantile(beyond, confidence);
    if !value.is_finite() || value > MAX_FACTOR * law.quantile(beyond, 0.5) {
        return Err(DetectError::TooFewChannels { channels: sample.channels, confidence });
    }
    Ok(Threshold {
        value,
        method: Method::Quantile,
        false_alarm_rate: Some(false_alarm_rate),
        confidence: Some(confidence),
        n_signals: n,
        n_channels: sample.channels,
        n_effective: number,
        n_tail: tail,
        tail_shape: law.shape(),
        ..Threshold::default()
    })
}

/// Healthy energies, sorted for both methods.
struct Sample {
    /// The energies, the largest first, each with its channel. Of a single channel every signal
    /// counts as a channel of its own, for want of others.
    descending: Vec<(f64, u32)>,
    channels: usize,
}

impl Sample {
    /// Sorts and checks the energies. Fewer than `needed` signals are refused.
    fn new(
        energies: &[f64],
        channels: &[u32],
        needed: usize,
        method: &'static str,
    ) -> Result<Sample, DetectError> {
        if energies.len() < needed {
            let found = energies.len();
            return Err(DetectError::TooFewSignals { found, needed, method });
        }
        check_energies(energies)?;
        let mut descending: Vec<(f64, u32)> =
            energies.iter().copied().zip(channels.iter().copied()).collect();
        descending.sort_unstable_by(|p, q| q.0.total_cmp(&p.0).then(p.1.cmp(&q.1)));
        if descending[0].0 == 0.0 {
            return Err(DetectError::NoEnergy { signals: energies.len() });
        }
        let channels = distinct(channels.to_vec()).len();
        if channels == 1 {
            descending.iter_mut().zip(0..).for_each(|(of, i)| of.1 = i);
        }
        Ok(Sample { descending, channels })
    }

    /// How many independent signals would say as much about the share of signals in the tail.
    fn effective(&self, tail: usize) -> f64 {
        self.independent(self.descending.len(), |i| f64::from(u8::from(i < tail)))
    }

    /// [`independent`] of the `value`s of the `n` largest signals, by their places in that order.
    fn independent(&self, n: usize, value: impl Fn(usize) -> f64) -> f64 {
        let channels = self.descending[..n].iter().map(|(_, channel)| *channel);
        independent(channels.enumerate().map(|(i, channel)| (value(i), channel)))
    }
}

/// Refuses statistics that are negative or not finite.
pub(super) fn check_energies(energies: &[f64]) -> Result<(), DetectError> {
    let wrong = energies.iter().position(|e| !(e.is_finite() && *e >= 0.0));
    wrong.map_or(Ok(()), |index| Err(DetectError::NotAnEnergy { value: energies[index], index }))
}

pub(super) fn distinct(mut numbers: Vec<u32>) -> Vec<u32> {
    numbers.sort_unstable();
    numbers.dedup();
    numbers
}

/// Number, sum and square sum of each channel's values, in the order of channel numbers.
pub(super) fn sums_of_channels(values: impl Iterator<Item = (f64, u32)>) -> Vec<[f64; 3]> {
    let mut channels: BTreeMap<u32, [f64; 3]> = BTreeMap::new();
    for (value, channel) in values {
        let [n, sum, square] = channels.entry(channel).or_default();
        (*n, *sum, *square) = (*n + 1.0, *sum + value, *square + value * value);
    }
    channels.into_values().collect()
}

/// How many independent values say as much: their number n over the design effect 1 + (m - 1) icc,
/// with icc the intra-channel correlation by a one-way analysis of variance, and m the mean number of
/// values per channel, weighted by itself.
fn independent(values: impl Iterator<Item = (f64, u32)>) -> f64 {
    let of_channels = sums_of_channels(values);
    let total = |of: fn(&[f64; 3]) -> f64| of_channels.iter().map(of).sum::<f64>();
    let (n, groups) = (total(|[n, ..]| *n), of_channels.len() as f64);
    let inside = n - groups;
    if inside <= 0.0 || groups < 2.0 {
        return n;
    }

    // mean squares between and within channels
    let mean = total(|[_, sum, _]| *sum) / n;
    let off = |[n, sum, _]: &[f64; 3]| n * (sum / n - mean).powi(2);
    let between = of_channels.iter().map(off).sum::<f64>();
    let within = total(|[n, sum, square]| square - sum * sum / n);
    let (between, within) = (between / (groups - 1.0), within / inside);

    // n_0: the number of values per channel that the analysis uses where numbers are unequal
    let squares = total(|[n, ..]| n * n);
    let n_0 = (n - squares / n) / (groups - 1.0);
    let icc = (between - within) / (between + (n_0 - 1.0) * within);
    let icc = if icc.is_finite() { icc.clamp(0.0, 1.0) } else { 0.0 };
    n / (1.0 + (squares / n - 1.0) * icc)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    /// Healthy energies of one channel: what differs between kinds is the channel's own `gain` and
    /// how its signals scatter.
    #[derive(Clone, Copy, Debug)]
    enum Kind {
        /// Noise through a filter: a sum of squares, few of them dominate.
        Noise,
        /// Frequency scatters uniformly within its range: bounded, besides noise.
        Uniform,
        /// Channels differ in gain, log-normally.
        Gains(f64),
    }

    impl Kind {
        fn gain(self, rng: &mut ChaCha8Rng) -> f64 {
            let z: f64 = StandardNormal.sample(rng);
            if let Kind::Gains(sd) = self { (sd * z).exp() } else { 1.0 }
        }

        fn energy(self, gain: f64, rng: &mut ChaCha8Rng) -> f64 {
            let shift = if let Kind::Uniform = self { rng.random_range(-8.0..8.0) } else { 0.0 };
            let sum: f64 = [3.0, 2.0, 1.0, 1.0, 0.5, 0.5, 0.5, 0.5]
                .iter()
                .enumerate()
                .map(|(i, weight)| {
                    let z: f64 = StandardNormal.sample(rng);
                    weight * (z + if i == 0 { shift } else { 0.0 }).powi(2)
                })
                .sum();
            1e-3 * gain * sum
        }

        fn sample(self, channels: usize, each: usize, seed: u64) -> (Vec<f64>, Vec<u32>) {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let (mut energies, mut numbers) = (Vec::new(), Vec::new());
            for c in 0..channels {
                let gain = self.gain(&mut rng);
                for _ in 0..each {
                    energies.push(self.energy(gain, &mut rng));
                    numbers.push(c as u32);
                }
            }
            (energies, numbers)
        }
    }

    /// A million healthy energies of so many channels that it hardly matters which, sorted.
    fn fresh(kind: Kind) -> Vec<f64> {
        let (mut all, _) = kind.sample(200_000, 5, 999);
        all.sort_unstable_by(f64::total_cmp);
        all
    }

    /// Share of 200 windows in which the rate of false alarms among `all` met the target at a
    /// confidence of 95 %, and its mean over the target. `independent`: pretend that no two signals
    /// share a channel.
    fn realised(
        (kind, all): (Kind, &[f64]),
        (channels, each): (usize, usize),
        rate: f64,
        independent: bool,
    ) -> (f64, f64) {
        let seeds = 200;
        let (mut met, mut mean) = (0, 0.0);
        for seed in 0..seeds {
            let (energies, mut numbers) = kind.sample(channels, each, seed);
            if independent {
                numbers = (0..energies.len() as u32).collect();
            }
            let t = quantile(&energies, &numbers, rate, 0.95).unwrap();
            let above = all.len() - all.partition_point(|&e| e <= t.value);
            let r = above as f64 / all.len() as f64;
            met += usize::from(r <= rate);
            mean += r / rate / seeds as f64;
        }
        (met as f64 / seeds as f64, mean)
    }

    #[test]
    fn a_threshold_that_is_widened_far_says_so() {
        let widened =
            |by: Option<f64>| Threshold { widened: by, n_signals: 40, ..Threshold::none() };
        assert!(widened(Some(3.0)).wide_in_words().is_some_and(|what| what.contains("40 signals")));
        assert_eq!(widened(Some(1.5)).wide_in_words(), None);
        assert_eq!(widened(None).wide_in_words(), None);
    }

    #[test]
    fn the_realised_false_alarm_rate_meets_its_target_at_the_confidence_and_not_by_much_more() {
        for kind in [Kind::Noise, Kind::Uniform, Kind::Gains(0.3)] {
            let all = fresh(kind);
            for shape in [(2475, 1), (64, 40)] {
                for rate in [1e-2, 4e-4] {
                    let (met, mean) = realised((kind, &all), shape, rate, false);
                    assert!(met >= 0.88, "{kind:?} {shape:?} {rate}: met in {met}");
                    assert!(mean >= 0.2, "{kind:?} {shape:?} {rate}: {mean} of the target");
                }
            }
        }
    }

    #[test]
    fn channels_that_differ_are_not_mistaken_for_many_independent_signals() {
        let all = fresh(Kind::Gains(0.3));
        let of = |independent| realised((Kind::Gains(0.3), &all), (32, 150), 1e-2, independent);
        let (met, mean) = of(false);
        assert!(met >= 0.92 && mean >= 1.0 / 3.0, "met in {met}, mean {mean}");
        let (naive, _) = of(true);
        assert!(naive <= 0.8, "the naive bound holds in {naive}: the data test nothing");
    }

    #[test]
    fn the_effective_number_lies_between_channels_and_signals() {
        let effective = |kind: Kind| {
            let (energies, channels) = kind.sample(64, 40, 3);
            quantile(&energies, &channels, 1e-2, 0.95).unwrap().n_effective
        };
        assert!(effective(Kind::Noise) > 1500.0, "{}", effective(Kind::Noise));
        let clustered = effective(Kind::Gains(1.0));
        assert!((64.0..400.0).contains(&clustered), "{clustered}");
    }

    #[test]
    fn neither_order_nor_unit_nor_json_matter() {
        let (energies, channels) = Kind::Gains(0.2).sample(20, 25, 5);
        let t = quantile(&energies, &channels, 1e-3, 0.95).unwrap();
        let back: Vec<f64> = energies.iter().rev().copied().collect();
        let channels_back: Vec<u32> = channels.iter().rev().copied().collect();
        assert_eq!(quantile(&back, &channels_back, 1e-3, 0.95).unwrap(), t);
        assert_eq!(max(&back, &channels_back, 1.0), max(&energies, &channels, 1.0));
        let many: Vec<f64> = energies.iter().map(|e| e * 1e12).collect();
        let scaled = quantile(&many, &channels, 1e-3, 0.95).unwrap();
        assert!((scaled.value / t.value / 1e12 - 1.0).abs() < 1e-9);
        let json = serde_json::to_string(&t).unwrap();
        assert!(json.contains(r#""method":"quantile""#));
        assert_eq!(serde_json::from_str::<Threshold>(&json).unwrap(), t);
    }

    /// Tests thesis (3-4).
    #[test]
    fn max_is_mu_times_the_largest_healthy_energy_and_the_boundary_is_healthy() {
        let t = max(&[1.0, 3.0, 2.0], &[0, 1, 1], 2.0).unwrap();
        assert_eq!((t.value, t.n_signals, t.n_channels), (6.0, 3, 2));
        assert!(!t.is_faulty(6.0) && t.is_faulty(6.000001));
        assert!(t.is_faulty(f64::INFINITY) && t.is_faulty(f64::NAN));
        assert!(max(&[1.0], &[0], 1.0).is_ok());
    }

    #[test]
    fn few_signals_one_channel_and_equal_energies_still_give_a_threshold() {
        let (energies, channels) = Kind::Noise.sample(1, 20, 7);
        let t = quantile(&energies, &channels, 0.01, 0.95).unwrap();
        let largest = energies.iter().copied().fold(0.0, f64::max);
        assert!(t.value > largest && t.value < 100.0 * largest, "{t:?}");
        let t = quantile(&[5.0; 100], &[3; 100], 0.01, 0.95).unwrap();
        assert!((t.value - 5.0).abs() < 1e-12, "{t:?}");
        let mut sparse = vec![0.0; 100];
        sparse[7] = 1.0;
        let channels: Vec<u32> = (0..100).collect();
        if let Ok(t) = quantile(&sparse, &channels, 0.01, 0.95) {
            assert!(t.value.is_finite() && t.value > 0.0);
        }
    }

    #[test]
    fn senseless_energies_are_errors() {
        let (e, c) = (vec![1.0; 30], vec![0; 30]);
        for bad in [f64::NAN, f64::INFINITY, -1.0] {
            let mut e = e.clone();
            e[4] = bad;
            for result in [quantile(&e, &c, 0.01, 0.95), max(&e, &c, 1.0)] {
                assert!(matches!(result, Err(DetectError::NotAnEnergy { index: 4, .. })));
            }
        }
        assert!(matches!(
            quantile(&e[..10], &c[..10], 0.01, 0.95),
            Err(DetectError::TooFewSignals { found: 10, .. })
        ));
        assert!(max(&[], &[], 1.0).is_err());
        assert!(matches!(max(&[0.0; 5], &[0; 5], 1.0), Err(DetectError::NoEnergy { .. })));
    }
}
