//! Simulates the data set of thesis §4-1 in the thesis's form, without the physics of a channel. In: a
//! `classes` scenario. Out: the recordings `train` and `test` as bursts of one printhead, and a label per
//! faulty channel.
//!
//! Each signal is y(t) = A (e^{-sigma t} cos(2 pi f t + phi0) + rho e^{-lambda t}) plus white noise, rounded
//! to counts, where A, sigma and f are uniform in the box of the signal's class and phi0, rho and lambda are
//! the same for all. Sets, channels and bursts are arranged by `dataset.rs`.

use super::dataset::{Set, Truth, labels_of, recordings_of, train_and_test};
use super::draws::{Purpose, stream};
use super::scenario::{ClassBox, Classes, RecordingOptions};
use super::simulated::{SimulatedRecording, digitise};
use inkling_core::burst::Burst;
use inkling_core::labels::Label;
use rand::RngExt;
use rand_distr::StandardNormal;
use std::f64::consts::TAU;
use std::sync::Arc;

/// Training and test set. Severities do not exist in this scenario: they are NaN.
fn sets(classes: &Classes, seed: u64) -> Vec<Set> {
    let fault_classes = classes.fault_classes().len();
    let numbers = [classes.n_healthy, classes.n_per_fault, fault_classes];
    train_and_test(seed, numbers, |_, _| f64::NAN)
}

/// The labels of the scenario's sets, without severities.
pub(super) fn labels(classes: &Classes, seed: u64) -> Vec<Label> {
    let names = classes.fault_classes();
    labels_of(&sets(classes, seed), |truth| truth.class.map(|i| (names[i].0.clone(), None)))
}

/// The recordings of the scenario's sets, not yet made.
pub(super) fn recordings(
    classes: &Arc<Classes>,
    options: &RecordingOptions,
    seed: u64,
) -> Vec<SimulatedRecording> {
    let common = Burst {
        sample_period_s: classes.sample_period_s(),
        samples_per_channel: classes.n as u32,
        ..Burst::default()
    };
    recordings_of(sets(classes, seed), options, common, |part| {
        let form = classes.clone();
        let boxes: Vec<ClassBox> =
            form.fault_classes().into_iter().map(|(_, class)| class).collect();
        let mut spread = stream(seed, Purpose::Spread, part);
        let mut noise = stream(seed, Purpose::Noise, part);
        move |truth: &Truth, counts: &mut Vec<i16>| {
            let class = truth.class.map_or(&form.classes.healthy, |i| &boxes[i]);
            let mut within = |[low, high]: [f64; 2]| low + (high - low) * spread.random::<f64>();
            let amplitude_counts = within(class.amplitude_counts);
            let (sigma_per_s, freq_hz) = (within(class.sigma_per_s), within(class.freq_hz));
            counts.extend((0..form.n).map(|k| {
                let white: f64 = noise.sample(StandardNormal);
                let t_s = k as f64 * form.sample_period_s();
                let ringing =
                    (-sigma_per_s * t_s).exp() * (TAU * freq_hz * t_s + form.phi0_rad).cos();
                let y = amplitude_counts * (ringing + form.rho * (-form.lambda_per_s * t_s).exp());
                digitise(y + form.noise_sd_counts * white)
            }));
        }
    })
}

#[cfg(test)]
mod tests {
    use super::super::fixtures::{THESIS, scenario};
    use super::super::scenario::{Kind, Scenario};
    use super::*;
    use inkling_core::labels::Labels;
    use std::collections::BTreeMap;

    fn classes(scenario: &Scenario) -> Arc<Classes> {
        let Kind::Classes(classes) = &scenario.kind else { panic!("a classes scenario") };
        classes.clone()
    }

    /// The signals of a recording by their labels' class.
    fn by_class(scenario: &Scenario, recording: usize) -> BTreeMap<String, Vec<Vec<f64>>> {
        let labels = Labels::new(scenario.labels(4));
        let mut signals = BTreeMap::<_, Vec<_>>::new();
        for burst in scenario.recordings(4).swap_remove(recording).bursts {
            for row in 0..burst.channels {
                let label = labels.at(&burst.printhead, burst.first_channel + row, burst.t_acq_ns);
                let mut y = vec![0.0; 128];
                burst.copy_signal(row as usize, &mut y);
                signals.entry(label.unwrap().state.clone()).or_default().push(y);
            }
        }
        signals
    }

    #[test]
    fn train_and_test_have_the_thesis_numbers_and_differ() {
        let scenario = scenario(THESIS);
        let sets = [0, 1].map(|recording| by_class(&scenario, recording));
        for set in &sets {
            assert_eq!(set["healthy"].len(), 2475);
            for (class, _) in classes(&scenario).fault_classes() {
                assert_eq!(set[&class].len(), 225);
            }
        }
        assert_ne!(sets[0]["EC"][0], sets[1]["EC"][0]);
    }

    #[test]
    fn class_means_are_the_formula_averaged_over_the_box() {
        let scenario = scenario(THESIS);
        let (classes, test) = (classes(&scenario), by_class(&scenario, 1));
        let mut boxes = classes.fault_classes();
        boxes.push(("healthy".to_owned(), classes.classes.healthy.clone()));
        for (class, of) in boxes {
            let signals = &test[&class];
            let count = signals.len() as f64;
            // the average over the box, on a grid of the test's own
            let grid =
                |[low, high]: [f64; 2], i: i32| low + (high - low) * (f64::from(i) + 0.5) / 40.0;
            let amplitude = 0.5 * (of.amplitude_counts[0] + of.amplitude_counts[1]);
            let mut chi2 = 0.0;
            for k in 0..128 {
                let t = k as f64 * 100e-6 / 128.0;
                let (mut mean, mut square) = (0.0, 0.0);
                for i in 0..40 {
                    for j in 0..40 {
                        let (sigma, f) = (grid(of.sigma_per_s, i), grid(of.freq_hz, j));
                        let y = amplitude
                            * ((-sigma * t).exp() * (TAU * f * t + 0.4).cos()
                                + 0.06 * (-37e3 * t).exp());
                        mean += y / 1600.0;
                        square += y * y / 1600.0;
                    }
                }
                let spread = square - mean * mean;
                let of_amplitude = (of.amplitude_counts[1] - of.amplitude_counts[0]).powi(2) / 12.0
                    * square
                    / (amplitude * amplitude);
                let variance = spread.max(0.0) + of_amplitude + 17.6 * 17.6 + 1.0 / 12.0;
                let measured = signals.iter().map(|y| y[k]).sum::<f64>() / count;
                assert!((measured - mean).abs() < 5.0 * (variance / count).sqrt(), "{class} {k}");
                chi2 += (measured - mean).powi(2) * count / variance;
            }
            // the samples of a class vary together, so the band must be wide
            assert!(chi2 / 128.0 < 3.5 && chi2 / 128.0 > 0.2, "{class} {chi2}");
        }
    }
}
