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
    let widened = |by: Option<f64>| Threshold { widened: by, n_signals: 40, ..Threshold::none() };
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
