//! The threshold from unlabelled signals, some of which are faulty (contaminated training data).
//!
//! In: detection statistics of a window's signals, of which up to two in five may be of faulty
//! channels, and the channel that each came from. Out: the [`Threshold`] that healthy signals
//! exceed at a chosen rate, with a chosen confidence.
//!
//! 1. Count the ln of the statistics, in units of their median, in a histogram. Signals of one
//!    channel resemble each other, so each signal weighs n_independent / n.
//! 2. Fit a mixture of healthy and faulty signals to the histogram (`mixture.rs`), and take the
//!    quantile of its healthy part at the stated rate.
//! 3. Jackknife: divide the channels into eight groups, and take the standard error of
//!    ln(threshold) from how the fits without each group differ.
//! 4. Raise the estimate by Student's t times this standard error.

use super::DetectError;
use super::mixture::{Counts, Mixture};
use super::threshold::{Method, Threshold, check_energies, distinct, sums_of_channels};
use crate::model::median::median;
use crate::model::normal::chi_squared_3;
use crate::model::student::student_quantile;

pub use super::mixture::{Degrees, Spread};

const GROUPS: usize = 8;
/// Three signals for each group.
const FEWEST: usize = 24;

/// `statistics`: one per signal, 0 or more, in any unit; `channels`: the channel of each; `degrees`, `spread`: the laws of
/// the healthy part; `rate`: share of healthy signals that may exceed the threshold; `confidence`: .5 or more. An error
/// if there are too few signals or channels, a statistic is no number, or there is no threshold above 0.
pub fn contaminated(
    statistics: &[f64],
    channels: &[u32],
    (degrees, spread): (Degrees, Spread),
    rate: f64,
    confidence: f64,
) -> Result<Threshold, DetectError> {
    check_energies(statistics)?;
    // a one-sided statistic is 0 below the middle, which says nothing about the tail
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
    let median = median(&mut counted.iter().map(|(s, _)| *s).collect::<Vec<_>>());
    if median <= 0.0 {
        return Err(DetectError::NoEnergy { signals: statistics.len() });
    }

    // the stated rate refers to all signals
    let rate = rate * statistics.len() as f64 / counted.len() as f64;
    let (all, of_groups) = histograms(&counted, median);

    let mixture = Mixture::fit(&all, degrees, spread);
    let estimate = mixture.ln_exceeded(rate);
    let without = of_groups
        .iter()
        .filter(|of| of.sum() > 0.0)
        .map(|of| mixture.fit_again(&all.without(of)).ln_exceeded(rate));
    let widening = jackknifed(&without.collect::<Vec<_>>(), confidence);

    let value = median * (estimate + widening).exp();
    // With few channels a faulty one cannot be told from a healthy one far out in a heavy tail: so it is noted how far
    // the threshold lies above that of many channels, where such a threshold is known.
    let of_many = match degrees {
        Degrees::Three => median * chi_squared_3(rate) / chi_squared_3(0.5),
        Degrees::OneSided => f64::INFINITY,
    };
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
        widened: Some(widening.exp().max(value / of_many)),
        ..Threshold::default()
    })
}

fn histograms(counted: &[(f64, u32)], median: f64) -> (Counts, Vec<Counts>) {
    let weight = independent(counted) / counted.len() as f64;
    let (mut all, mut of_groups) = (Counts::NONE, vec![Counts::NONE; GROUPS]);
    for ((s, _), group) in counted.iter().zip(groups(counted)) {
        of_groups[group].add(s / median, weight);
        all.add(s / median, weight);
    }
    (all, of_groups)
}

/// Student's t times sqrt((n - 1) / n sum (e_i - mean)²) of the n estimates e_i, in ln s.
fn jackknifed(without: &[f64], confidence: f64) -> f64 {
    let n = without.len() as f64;
    let mean = without.iter().sum::<f64>() / n;
    let square: f64 = without.iter().map(|ln| (ln - mean).powi(2)).sum();
    match without.len() {
        0 | 1 => 0.0,
        _ => student_quantile(confidence, n - 1.0) * ((n - 1.0) / n * square).sqrt(),
    }
}

/// How many independent signals say as much as these: n / (1 + (m - 1) r), with m signals per channel,
/// and r their intraclass correlation (of ln s) by a one-way analysis of variance.
fn independent(counted: &[(f64, u32)]) -> f64 {
    let ln = |(s, channel): &(f64, u32)| (s.max(f64::MIN_POSITIVE).ln(), *channel);
    let channels = sums_of_channels(counted.iter().map(ln));
    // without two channels, or two signals of one, the correlation cannot be estimated
    let (n, k) = (counted.len() as f64, channels.len() as f64);
    if k < 2.0 || n <= k {
        return n;
    }
    let [sum, square] = channels.iter().fold([0.0; 2], |[a, b], of| [a + of[1], b + of[2]]);
    let of_means: f64 = channels.iter().map(|[n, sum, _]| sum * sum / n).sum();

    // mean squares between and within channels, and m for unequal numbers of signals
    let between = (of_means - sum * sum / n) / (k - 1.0);
    let within = (square - of_means) / (n - k);
    let each = (n - channels.iter().map(|[n, ..]| n * n).sum::<f64>() / n) / (k - 1.0);
    let alike = ((between - within) / (between + (each - 1.0) * within)).clamp(0.0, 1.0);
    n / (1.0 + (each - 1.0) * alike)
}

/// The jackknife's groups, to which channels are assigned in turn; the signals where there is only one channel.
fn groups(counted: &[(f64, u32)]) -> Vec<usize> {
    let numbers = distinct(counted.iter().map(|(_, c)| *c).collect());
    let group = |(i, (_, channel)): (usize, &(f64, u32))| match numbers.len() {
        1 => i % GROUPS,
        _ => numbers.partition_point(|n| n < channel) % GROUPS,
    };
    counted.iter().enumerate().map(group).collect()
}

#[cfg(test)]
mod tests {
    use super::super::sensitivity::core_of;
    use super::*;
    use nalgebra::Vector3;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{ChiSquared, Distribution, StandardNormal};

    /// How healthy signals scatter: their three features are Gaussian, uniform with little noise,
    /// or Student's t with 5 degrees of freedom.
    #[derive(Clone, Copy, Debug, PartialEq)]
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
        all
    }

    #[test]
    fn stated_rate_holds_and_faults_of_any_or_of_one_size_or_two_are_no_healthy_tail() {
        use Faults::{OneSize, OverDecades, TwoSizes};
        // The least recall by signals without a heavy tail, and by those with one: a Student tail
        // lies over some of the faults of any size, and reaches beyond the nearest of one size.
        let few = &[0.1, 0.38][..];
        for (faults, shares, least, least_of_student) in [
            (OverDecades, &[0.0, 0.1, 0.4][..], 0.99, 0.2),
            (OneSize(9.0), few, 0.97, 0.0),
            (OneSize(15.0), few, 0.97, 0.8),
            (OneSize(40.0), few, 0.97, 0.8),
            (TwoSizes(15.0, 100.0), few, 0.97, 0.8),
        ] {
            for &share in shares {
                for kind in [Healthy::Gaussian, Healthy::Bounded, Healthy::Student] {
                    let of = over_windows(kind, share, faults);
                    assert!(of.false_alarms <= 2.0 * STATED, "{kind:?} {share} {faults:?}: {of:?}");
                    let least = if kind == Healthy::Student { least_of_student } else { least };
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
        (0..60).map(of_head).sum::<f64>() / 60.0
    }

    #[test]
    fn a_faulty_one_of_few_channels_is_found_or_the_threshold_says_that_it_tells_little() {
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        for channels in [5, 6, 12, 24] {
            let places: Vec<f64> =
                (0..channels).map(|_| square(Healthy::Gaussian, 0.0, &mut rng)).collect();
            let of: Vec<u32> = (0..60 * channels).map(|i| i % channels).collect();
            let statistic = |channel: &u32| match *channel == channels - 1 {
                true => 2800.0,
                false => places[*channel as usize],
            };
            let all: Vec<f64> =
                of.iter().map(|c| statistic(c) * rng.random_range(0.9..1.1)).collect();
            let of = contaminated(&all, &of, (Degrees::Three, Spread::Own), STATED, 0.95).unwrap();
            assert_ne!(of.value < 2500.0, of.is_blind(), "{channels}: {of:?}");
        }
    }

    #[test]
    fn few_channels_that_differ_for_good_are_not_taken_for_many() {
        // Of eight channels the core is five, chosen for lying close together.
        for (channels, within, most) in
            [(8, 0.1, 3.0), (12, 0.1, 2.0), (12, 0.5, 2.0), (60, 0.1, 2.0)]
        {
            let rate = beyond(channels, within);
            assert!(rate <= most * STATED, "{channels} channels, {within}: {rate}");
        }
    }
}
