//! The threshold on a detection statistic, learned from signals that are all taken for healthy.
//!
//! In: the statistics of healthy training signals (*energies*, after the thesis; only their order
//! and ratios matter), and the channel that each came from. Out: a [`Threshold`], above which a
//! signal counts as faulty. By default, windows, of which some signals may be faulty, go to
//! [`super::contamination`].
//!
//! [`max`] is thesis (3-4), mu times the largest energy. Departs: that grows with the number of
//! training signals. So the default is [`quantile`]: the energy that healthy signals exceed at a
//! chosen rate, with a confidence bound.
//!
//! 1. The largest energies (a tenth by default) are the tail. Signals of one channel resemble each
//!    other, so the tail counts as fewer, independent signals (design effect).
//! 2. A generalised Pareto distribution is fitted to the excesses over the tail's lower end
//!    (`pareto_tail.rs`); the result is a posterior of the quantile.
//! 3. The threshold is that posterior's upper end at the chosen confidence.

use super::DetectError;
use super::pareto_tail::{Effective, ParetoTail};
use crate::numbers::LITTLE;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

const MIN_SIGNALS: usize = 20;
/// The tail is `little` (a tenth) of all signals, but lies between these two. It is at least twice
/// the number expected beyond the threshold, and half of all signals at most (this bound wins).
const MIN_TAIL: usize = 50;
const MAX_TAIL: usize = 5000;
/// A window's threshold of more than this many times its estimate, or that of many channels, hides small faults.
const WIDE: f64 = 2.0;
/// One of more than this many times, ten times as far out, leaves only gross faults to be found. Arbitrary: of 5 to 16
/// channels of the sample the factor was at most 30 where a faulty one among them was found, and 290 and more where it
/// was not.
const BLIND: f64 = 100.0;
/// The channels are too few if the upper end of the posterior exceeds its median by this factor.
const MAX_FACTOR: f64 = 1e3;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Method {
    Quantile,
    #[default]
    Max,
    /// From a window of unlabelled signals: [`super::contamination`].
    Window,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Threshold {
    /// The threshold, in the statistic's unit (`DetectMethod`). A signal on it is still healthy.
    pub value: f64,
    pub method: Method,
    /// Factor mu of (3-4); with method `max` only.
    pub mu: Option<f64>,
    /// Largest share of healthy signals above `value`, with the probability `confidence`; not for `max`.
    pub false_alarm_rate: Option<f64>,
    pub confidence: Option<f64>,
    pub n_signals: usize,
    pub n_channels: usize,
    /// All signals, counted as independent ones by which of them lie in the tail; with method `window`
    /// the estimated number of healthy ones.
    pub n_effective: f64,
    /// Number of signals to which the tail was fitted; 0 with methods `max` and `window`.
    pub n_tail: usize,
    /// Shape xi of the tail (posterior mean), above 0 heavier than exponential; with method `window` 1
    /// / kappa (`mixture.rs`).
    pub tail_shape: f64,
    /// With method `window`: the factor by which `value` exceeds its estimate, or the threshold that many channels of
    /// Gaussian scatter have, whichever is larger.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub widened: Option<f64>,
}

impl Threshold {
    pub fn none() -> Threshold {
        Threshold { value: f64::INFINITY, ..Threshold::default() }
    }

    pub fn scaled(&self, factor: f64) -> Threshold {
        Threshold { value: self.value * factor, ..self.clone() }
    }

    /// Whether only gross faults exceed it, as the window tells too little of healthy signals.
    pub fn is_blind(&self) -> bool {
        self.widened.is_some_and(|by| by > BLIND)
    }

    pub fn wide_in_words(&self) -> Option<String> {
        let widened = self.widened.filter(|by| *by > WIDE)?.sqrt();
        let found =
            if self.is_blind() { "only gross faults are found" } else { "slight faults may pass" };
        Some(format!(
            "{} signals of {} channels say so little of how far healthy ones scatter that the threshold lies {widened:.1} \
             times as far out as that of many: {found}; a design (`inkling train`), of other printheads of this kind if \
             need be, says more",
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
/// all printheads. An error for energies that are none, or if the bound tells nothing.
pub fn quantile(
    energies: &[f64],
    channels: &[u32],
    false_alarm_rate: f64,
    confidence: f64,
) -> Result<Threshold, DetectError> {
    let sample = Sample::new(energies, channels, MIN_SIGNALS, "quantile")?;
    let n = energies.len();

    let tail = ((LITTLE * n as f64) as usize)
        .clamp(MIN_TAIL, MAX_TAIL)
        // a quantile that lies inside the sample needs signals of the tail on both sides of it
        .max((2.0 * false_alarm_rate * n as f64).ceil() as usize)
        .min(n / 2);

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

struct Sample {
    /// The energies, the largest first, each with its channel. Of a single channel every signal
    /// counts as a channel of its own, for want of others.
    descending: Vec<(f64, u32)>,
    channels: usize,
}

impl Sample {
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

    fn effective(&self, tail: usize) -> f64 {
        self.independent(self.descending.len(), |i| f64::from(u8::from(i < tail)))
    }

    /// [`independent`] of the `value`s of the `n` largest signals, by their places in that order.
    fn independent(&self, n: usize, value: impl Fn(usize) -> f64) -> f64 {
        let channels = self.descending[..n].iter().map(|(_, channel)| *channel);
        independent(channels.enumerate().map(|(i, channel)| (value(i), channel)))
    }
}

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

/// n over the design effect 1 + (m - 1) icc: icc is the intra-channel correlation by a one-way
/// analysis of variance, m the mean number of values per channel, weighted by itself.
fn independent(values: impl Iterator<Item = (f64, u32)>) -> f64 {
    let of_channels = sums_of_channels(values);
    let total = |of: fn(&[f64; 3]) -> f64| of_channels.iter().map(of).sum::<f64>();
    let (n, groups) = (total(|[n, ..]| *n), of_channels.len() as f64);
    let inside = n - groups;
    if inside <= 0.0 || groups < 2.0 {
        return n;
    }

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
mod tests;
