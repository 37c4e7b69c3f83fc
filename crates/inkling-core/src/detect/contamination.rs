//! The threshold from unlabelled signals, some of which are faulty (contaminated training data).
//!
//! In, from `design/learn_distances.rs`: detection statistics of a window's signals, of which up to
//! two in five may be of faulty channels, and the channel of each. Out: the [`Threshold`] that
//! healthy signals exceed at a chosen rate, with a chosen confidence. Where all signals are known
//! to be healthy, [`super::threshold`] is used instead.
//!
//! The steps:
//!
//! 1. Count the ln of the statistics, in units of their median, in a histogram. Signals of one
//!    channel resemble each other, so each signal weighs n_independent / n, with the design effect
//!    of a one-way analysis of variance.
//! 2. Fit a mixture of healthy and faulty signals to the histogram (`mixture.rs`), and take the
//!    quantile of its healthy part at the stated rate: the estimate.
//! 3. Jackknife: divide the channels into eight groups, fit again without each group, and take the
//!    standard error of ln(threshold) from how the eight estimates differ.
//! 4. Raise the estimate by Student's t times this standard error.

use super::DetectError;
use super::mixture::{Counts, Mixture};
use super::threshold::{Method, Threshold, distinct};
use crate::model::median::median;
use crate::model::student::student_quantile;
use std::collections::BTreeMap;

pub use super::mixture::{Degrees, Spread};

/// Number of groups of the jackknife.
const GROUPS: usize = 8;
/// Smallest number of signals for the mixture model.
const FEWEST: usize = 24;

/// The threshold on a statistic: the value that at most a share `rate` of the window's healthy
/// signals exceed, with `confidence`.
///
/// `statistics`: one per signal, finite and at least 0, in any unit. `channels`: the channel of
/// each signal. `degrees`: how many squared features a statistic is the sum of; `spread`: from
/// which signals the distances' unit was estimated. `confidence`: .5 or more; less would lower the
/// estimate. Errors: a statistic that is no such number, fewer than 24 signals that count, a median
/// of 0, or a threshold that is not finite.
///
/// In the result `n_effective` is the estimated number of healthy signals, and `tail_shape` is 1 /
/// kappa of the mixture's healthy law.
pub fn contaminated(
    statistics: &[f64],
    channels: &[u32],
    (degrees, spread): (Degrees, Spread),
    rate: f64,
    confidence: f64,
) -> Result<Threshold, DetectError> {
    if let Some(index) = statistics.iter().position(|s| !(s.is_finite() && *s >= 0.0)) {
        return Err(DetectError::NotAnEnergy { value: statistics[index], index });
    }
    // A one-sided statistic is 0 for signals below the middle. These say nothing about the tail and
    // are left out; of a statistic of three features all signals count.
    let counted: Vec<(f64, u32)> = statistics
        .iter()
        .zip(channels)
        .filter(|(s, _)| degrees == Degrees::Three || **s > 0.0)
        .map(|(s, c)| (*s, *c))
        .collect();
    if counted.len() < FEWEST {
        let (found, needed) = (counted.len(), FEWEST);
        return Err(DetectError::TooFewSignals { found, needed, method: "window" });
    }
    // the histogram is in units of the median, so that the model's priors suit any statistic
    let median = median(&mut counted.iter().map(|(s, _)| *s).collect::<Vec<_>>());
    if median <= 0.0 {
        return Err(DetectError::NoEnergy { signals: statistics.len() });
    }

    // The stated rate refers to all signals, so of the counted ones a larger share may exceed the
    // threshold.
    let rate = rate * statistics.len() as f64 / counted.len() as f64;
    let weight = independent(&counted) / counted.len() as f64;

    // one histogram of all signals and one per group, so that the estimate can be repeated without each group
    let groups = groups(&counted);
    let mut of_groups = vec![Counts::default(); GROUPS];
    let mut all = Counts::default();
    for ((s, _), group) in counted.iter().zip(&groups) {
        of_groups[*group].add(s / median, weight);
        all.add(s / median, weight);
    }

    // the estimate, in ln (s / median), and the estimates without each group; for these the number
    // of components is not chosen again
    let mixture = Mixture::fit(&all, degrees, spread);
    let estimate = mixture.ln_exceeded(rate);
    let without = of_groups
        .iter()
        .filter(|of| !of.is_empty())
        .map(|of| mixture.fit_again(&all.without(of)).ln_exceeded(rate));
    let widening = jackknifed(&without.collect::<Vec<_>>(), confidence);

    // raise the estimate to the upper end of its one-sided confidence interval
    let value = median * (estimate + widening).exp();
    let numbers = distinct(channels.to_vec());
    if !value.is_finite() {
        return Err(DetectError::TooFewChannels { channels: numbers.len(), confidence });
    }
    Ok(Threshold {
        value,
        method: Method::Window,
        false_alarm_rate: Some(rate * counted.len() as f64 / statistics.len() as f64),
        confidence: Some(confidence),
        n_signals: statistics.len(),
        n_channels: numbers.len(),
        n_effective: mixture.healthy_share() * statistics.len() as f64,
        tail_shape: mixture.tail(),
        widened: Some(widening.exp()),
        ..Threshold::default()
    })
}

/// How far the one-sided confidence interval of the estimate reaches above it, in ln s, by the
/// jackknife: Student's t at `confidence` times the standard error sqrt((n - 1) / n sum (e_i -
/// mean)²). `without`: the n estimates e_i, each without one group. With fewer than two of them it
/// is 0, as nothing is known of the error.
fn jackknifed(without: &[f64], confidence: f64) -> f64 {
    let n = without.len() as f64;
    let mean = without.iter().sum::<f64>() / n;
    let square: f64 = without.iter().map(|ln| (ln - mean).powi(2)).sum();
    match without.len() {
        0 | 1 => 0.0,
        _ => student_quantile(confidence, n - 1.0) * ((n - 1.0) / n * square).sqrt(),
    }
}

/// How many independent signals say as much as these (pairs of statistic and channel). Signals of
/// one channel have a share of their variance (of ln s) in common, the intraclass correlation r of
/// a one-way analysis of variance. With m signals of each channel the variance of a mean is 1 +
/// (m - 1) r times that of as many independent signals (the design effect), so n signals are worth
/// n / (1 + (m - 1) r).
fn independent(counted: &[(f64, u32)]) -> f64 {
    // per channel: number of signals, and sum and square sum of their ln s
    let mut channels: BTreeMap<u32, [f64; 3]> = BTreeMap::new();
    for (s, channel) in counted {
        let z = s.max(f64::MIN_POSITIVE).ln();
        let [n, sum, square] = channels.entry(*channel).or_default();
        (*n, *sum, *square) = (*n + 1.0, *sum + z, *square + z * z);
    }
    // without two channels, or two signals of one, the correlation cannot be estimated
    let (n, k) = (counted.len() as f64, channels.len() as f64);
    if k < 2.0 || n <= k {
        return n;
    }
    let [sum, square] = channels.values().fold([0.0; 2], |[a, b], of| [a + of[1], b + of[2]]);
    let of_means: f64 = channels.values().map(|[n, sum, _]| sum * sum / n).sum();

    // mean squares between and within channels, and the mean number m of signals per channel as the
    // analysis of variance has it for unequal numbers
    let between = (of_means - sum * sum / n) / (k - 1.0);
    let within = (square - of_means) / (n - k);
    let each = (n - channels.values().map(|[n, ..]| n * n).sum::<f64>() / n) / (k - 1.0);
    let alike = ((between - within) / (between + (each - 1.0) * within)).clamp(0.0, 1.0);
    n / (1.0 + (each - 1.0) * alike)
}

/// The jackknife's group of each signal. All signals of a channel are in one group, since channels
/// differ lastingly; the channels are assigned to the groups in turn, and with fewer than eight
/// channels some groups stay empty. If there is only one channel, its signals are assigned in turn.
fn groups(counted: &[(f64, u32)]) -> Vec<usize> {
    let numbers = distinct(counted.iter().map(|(_, c)| *c).collect());
    match numbers.len() < 2 {
        true => (0..counted.len()).map(|i| i % GROUPS).collect(),
        false => {
            let place = |c: u32| numbers.partition_point(|n| *n < c);
            counted.iter().map(|(_, c)| place(*c) % GROUPS).collect()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::sensitivity::core_of;
    use super::*;
    use nalgebra::Vector3;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{ChiSquared, Distribution, StandardNormal};

    #[derive(Clone, Copy, Debug, PartialEq)]
    /// How healthy signals scatter: their three features are Gaussian, uniform with little noise,
    /// or Student's t with 5 degrees of freedom.
    enum Healthy {
        Gaussian,
        Bounded,
        Student,
    }

    /// Squared distance of a drawn signal that lies `off` standard deviations from the middle.
    fn square(kind: Healthy, off: f64, rng: &mut ChaCha8Rng) -> f64 {
        let mut x = [0.0; 3].map(|_: f64| rng.sample::<f64, _>(StandardNormal));
        match kind {
            Healthy::Gaussian => {}
            Healthy::Bounded => x = x.map(|v| 0.3 * v + rng.random_range(-1.6..1.6)),
            Healthy::Student => {
                let scale = (ChiSquared::new(5.0).unwrap().sample(rng) / 3.0_f64).sqrt();
                x = x.map(|v| v / scale);
            }
        }
        x[0] += off;
        x.iter().map(|v| v * v).sum()
    }

    /// How far the faulty signals of a window lie off, in standard deviations of a healthy feature.
    #[derive(Clone, Copy, Debug)]
    enum Faults {
        /// Log-uniform over orders of magnitude.
        OverDecades,
        /// All so many standard deviations off.
        OneSize(f64),
        /// Half of them the first number of standard deviations off, half the second.
        TwoSizes(f64, f64),
    }

    /// Shares of fresh healthy and of fresh faulty signals above a threshold.
    #[derive(Clone, Copy, Debug, Default)]
    struct Rates {
        false_alarms: f64,
        recall: f64,
    }

    /// The rate of false alarms that the thresholds are asked for.
    const STATED: f64 = 1e-3;

    /// The realised rates of the threshold learned from a window of 2560 signals of 128 channels.
    fn rates(kind: Healthy, share: f64, faults: Faults, seed: u64) -> Rates {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let fault = |rng: &mut ChaCha8Rng| {
            let off = match faults {
                Faults::OverDecades => rng.random_range(1.8_f64..6.0).exp(),
                Faults::OneSize(off) => off,
                Faults::TwoSizes(p, q) => [p, q][usize::from(rng.random_bool(0.5))],
            };
            square(kind, off, rng)
        };
        let all: Vec<f64> = (0..2560)
            .map(|_| match rng.random_bool(share) {
                true => fault(&mut rng),
                false => square(kind, 0.0, &mut rng),
            })
            .collect();
        let channels: Vec<u32> = (0..2560).map(|i| i % 128).collect();
        let threshold = contaminated(&all, &channels, (Degrees::Three, Spread::Own), STATED, 0.95)
            .unwrap()
            .value;
        let (healthy, faulty) = (20_000, 2_000);
        let false_alarms = (0..healthy).filter(|_| square(kind, 0.0, &mut rng) > threshold).count();
        let hits = (0..faulty).filter(|_| fault(&mut rng) > threshold).count();
        Rates {
            false_alarms: false_alarms as f64 / f64::from(healthy),
            recall: hits as f64 / f64::from(faulty),
        }
    }

    /// The mean rates over four windows.
    fn over_windows(kind: Healthy, share: f64, faults: Faults) -> Rates {
        const WINDOWS: u64 = 4;
        let mut all = Rates::default();
        for i in 0..WINDOWS {
            let one = rates(kind, share, faults, 4200 + i);
            all.false_alarms += one.false_alarms / WINDOWS as f64;
            all.recall += one.recall / WINDOWS as f64;
        }
        println!("{kind:?}, {share} {faults:?}: {all:?}");
        all
    }

    #[test]
    fn stated_rate_holds_without_faults_and_with_faults_of_any_size() {
        for kind in [Healthy::Gaussian, Healthy::Bounded, Healthy::Student] {
            for share in [0.0, 0.1, 0.4] {
                let of = over_windows(kind, share, Faults::OverDecades);
                assert!(of.false_alarms <= 2.0 * STATED, "{kind:?} {share}: {of:?}");
                // a heavy Student tail lies over some of the faults
                let least = if kind == Healthy::Student { 0.2 } else { 0.99 };
                assert!(of.recall >= least, "{kind:?} {share}: {of:?}");
            }
        }
    }

    #[test]
    fn faults_of_one_size_or_two_are_no_healthy_tail() {
        let (near, far) = (Faults::OneSize(9.0), Faults::OneSize(40.0));
        for faults in [near, Faults::OneSize(15.0), far, Faults::TwoSizes(15.0, 100.0)] {
            for share in [0.1, 0.38] {
                for kind in [Healthy::Gaussian, Healthy::Bounded, Healthy::Student] {
                    let of = over_windows(kind, share, faults);
                    assert!(of.false_alarms <= 2.0 * STATED, "{kind:?} {share} {faults:?}: {of:?}");
                    // a heavy Student tail reaches beyond the nearest of the faults
                    let least = match (kind, faults) {
                        (Healthy::Student, Faults::OneSize(9.0)) => 0.0,
                        (Healthy::Student, _) => 0.8,
                        _ => 0.97,
                    };
                    assert!(of.recall >= least, "{kind:?} {share} {faults:?}: {of:?}");
                }
            }
        }
    }

    /// Share of signals beyond the threshold, on average over 60 heads whose channels differ for good: a
    /// signal lies `within` standard deviations from its channel's place, and channels one from each other.
    /// Distances are by the core's spread, as in a window.
    fn beyond(channels: u32, within: f64) -> f64 {
        let of_head = |head: u64| {
            let mut normal = crate::model::normal::draws(77_000 + head);
            let mut all: Vec<(Vector3<f64>, u32)> = Vec::new();
            for channel in 0..channels {
                let place = Vector3::from_fn(|_, _| normal());
                let signal = |_| (place + within * Vector3::from_fn(|_, _| normal()), channel);
                all.extend((0..60).map(signal));
            }
            let (places, of): (Vec<Vector3<f64>>, Vec<u32>) = all.into_iter().unzip();
            let core = core_of(&places);
            let metric = core.covariance.try_inverse().unwrap();
            let square = |x: &Vector3<f64>| (x - core.mean).dot(&(metric * (x - core.mean)));
            let squares: Vec<f64> = places.iter().map(square).collect();
            let threshold =
                contaminated(&squares, &of, (Degrees::Three, Spread::Own), STATED, 0.95).unwrap();
            squares.iter().filter(|s| **s > threshold.value).count() as f64 / squares.len() as f64
        };
        (0..HEADS).map(of_head).sum::<f64>() / HEADS as f64
    }

    const HEADS: u64 = 60;

    #[test]
    fn few_channels_that_differ_for_good_are_not_taken_for_many() {
        // Of eight channels the core is five, chosen for lying close together.
        for (channels, within, most) in
            [(8, 0.1, 3.0), (12, 0.1, 2.0), (12, 0.5, 2.0), (60, 0.1, 2.0)]
        {
            let rate = beyond(channels, within);
            println!("{channels} channels, {within}: {rate:.5}");
            assert!(rate <= most * STATED, "{channels} channels, {within}: {rate}");
        }
    }
}
