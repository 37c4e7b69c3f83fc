//! Simulates recordings with known truth. In: a scenario (a checked TOML file, [`scenario`]) and a seed. Out:
//! bursts, and labels that say which channels have which fault, when, and how severe it is.
//!
//! A scenario of kind `physics` simulates channels by thesis §2-2: sets of signals for training and test,
//! each signal from another channel ([`dataset`]), printheads over time ([`print_run`]), or both. A
//! scenario of kind `classes` simulates the data set of thesis §4-1 without physics: the parameters of
//! every ring-down are drawn from the box of its class ([`thesis_form`]). Two further experiments use a
//! physics scenario but are not among its recordings: effects that the model does not know ([`hidden`]), and
//! nozzles that are dried on purpose ([`drying`]).
//!
//! Shared are: one channel's signal (`sensor`), random streams (`draws`), and bursts and a recording that is
//! not yet made (`simulated`).
//!
//! Bursts are made when they are asked for, so memory does not grow with the length of a run. The same
//! scenario and seed give the same bytes.

pub mod dataset;
mod draws;
pub mod drying;
#[cfg(test)]
mod fixtures;
pub mod hidden;
pub mod print_run;
pub mod scenario;
mod sensor;
mod simulated;
pub mod thesis_form;

use inkling_core::labels::{Channels, Label};
use scenario::Kind;

pub use scenario::Scenario;
pub use simulated::SimulatedRecording;

impl Scenario {
    /// The recordings of this scenario, not yet made: the sets `train`, `test` and `calibration`, then
    /// `print_run`, as far as the scenario asks for them.
    pub fn recordings(&self, seed: u64) -> Vec<SimulatedRecording> {
        match &self.kind {
            Kind::Classes(classes) => thesis_form::recordings(classes, &self.recording, seed),
            Kind::Physics(physics) => {
                let mut recordings = dataset::recordings(physics, &self.recording, seed);
                recordings.extend(print_run::recording(physics, &self.recording, seed));
                recordings
            }
        }
    }

    /// What is true of the scenario's recordings: first, for each printhead, a row for all its channels (`*`)
    /// that says healthy, then the rows of single channels with a fault.
    pub fn labels(&self, seed: u64) -> Vec<Label> {
        match &self.kind {
            Kind::Classes(classes) => thesis_form::labels(classes, seed),
            Kind::Physics(physics) => {
                let mut labels = dataset::labels(physics, seed);
                labels.extend(print_run::labels(physics, &self.recording, seed));
                // the `*` rows of the print run come to the front, too
                labels.sort_by_key(|label| label.channel != Channels::All);
                labels
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::fixtures::{PHYSICS, SAMPLE, replaced, scenario};
    use super::*;
    use inkling_core::fault::HEALTHY;
    use inkling_core::labels::Labels;
    use inkling_core::model::faults;
    use std::collections::BTreeMap;

    /// `physics.toml`, the benchmark whose numbers are frozen so that nobody tunes them, with fewer signals.
    fn smaller() -> String {
        replaced(
            PHYSICS,
            &[
                ("healthy = 2475", "healthy = 40"),
                ("per_fault = 225", "per_fault = 5"),
                ("calibration_test = 20000", "calibration_test = 60"),
                ("printheads = 4", "printheads = 2"),
                ("channels = 256", "channels = 24"),
                ("bursts_per_channel = 400", "bursts_per_channel = 50"),
                ("faulty_channels = 0.05", "faulty_channels = 0.5"),
            ],
        )
    }

    /// All signals, counts by (stem, printhead, channel, time).
    fn signals(scenario: &Scenario, seed: u64) -> BTreeMap<(String, String, u32, i64), Vec<f64>> {
        let mut signals = BTreeMap::new();
        for recording in scenario.recordings(seed) {
            let mut last = i64::MIN;
            for burst in recording.bursts {
                assert!(burst.t_acq_ns >= last, "bursts come in time order");
                last = burst.t_acq_ns;
                for row in 0..burst.channels {
                    let mut y = vec![0.0; burst.samples_per_channel as usize];
                    burst.copy_signal(row as usize, &mut y);
                    let channel = burst.first_channel + row;
                    let stem = recording.stem.clone();
                    let key = (stem, burst.printhead.to_string(), channel, burst.t_acq_ns);
                    assert!(signals.insert(key, y).is_none(), "each signal once");
                }
            }
        }
        signals
    }

    #[test]
    fn the_same_seed_gives_the_same_bursts_and_labels_and_another_gives_others() {
        for scenario in [scenario(&smaller()), scenario(SAMPLE)] {
            let bytes = |seed| -> Vec<String> {
                let bursts = scenario.recordings(seed).into_iter().flat_map(|r| r.bursts);
                bursts.map(|burst| format!("{burst:?}")).collect()
            };
            assert_eq!(bytes(7), bytes(7));
            assert_eq!(scenario.labels(7), scenario.labels(7));
            assert!(bytes(7).iter().zip(bytes(8)).all(|(x, y)| *x != y));
        }
    }

    #[test]
    fn a_longer_run_begins_like_a_shorter_one_and_a_set_ignores_the_run() {
        let sets_only = PHYSICS.split("[print_run]").next().unwrap();
        let first = |text| format!("{:?}", scenario(text).recordings(5)[0].bursts.next());
        assert_eq!(first(sets_only), first(PHYSICS));
        let longer = replaced(SAMPLE, &[("bursts_per_channel = 60", "bursts_per_channel = 70")]);
        let [short, long] = [SAMPLE, &longer].map(|text| signals(&scenario(text), 1));
        assert!(long.len() > short.len());
        assert!(short.iter().all(|(key, y)| long[key] == *y));
    }

    /// A scenario without noise and spread, in which every signal is known from its label alone.
    fn silent(text: &str) -> Scenario {
        scenario(&replaced(
            text,
            &[
                (
                    "a = 0.004\nb = 0.004\ng = 0.05\nd = 0.08\ngain = 0.025",
                    "a = 0\nb = 0\ng = 0\nd = 0\ngain = 0",
                ),
                ("gain = 0.004\nstate = 0.004", "gain = 0\nstate = 0"),
                ("noise_sd_counts = 17.6", "noise_sd_counts = 0"),
                ("swing_c = 4.0", "swing_c = 0"),
                (
                    "levels_v = [24.0, 30.0]\nshares = [0.3, 0.7]",
                    "levels_v = [30.0]\nshares = [1.0]",
                ),
            ],
        ))
    }

    #[test]
    fn every_signal_is_what_its_label_says() {
        for text in [SAMPLE, &smaller()] {
            let scenario = silent(text);
            let scenario::Kind::Physics(physics) = &scenario.kind else { panic!() };
            let acquisition = &physics.acquisition;
            let decay = |rates: &inkling_core::model::InkChannel| {
                let x_a = acquisition.actuation().acquisition_state(rates, 1.0);
                let mut decay = vec![0.0; 128];
                let dt_s = acquisition.sample_period_s();
                inkling_core::model::ring_down::ring_down_into(rates, &x_a, dt_s, &mut decay);
                decay
            };
            let peak = |y: &[f64]| y.iter().fold(0.0_f64, |m, y| m.max(y.abs()));
            let healthy_peak = peak(&decay(&physics.channel));
            let labels = Labels::new(scenario.labels(11));
            let (mut faulty, mut healthy) = (0, 0);
            for ((stem, printhead, channel, t_ns), y) in signals(&scenario, 11) {
                let label = labels.at(&printhead, channel, t_ns).unwrap();
                let rates = if label.state == HEALTHY {
                    healthy += 1;
                    assert_eq!(peak(&y), 400.0, "the nominal healthy channel peaks at 400 counts");
                    physics.channel
                } else {
                    faulty += 1;
                    faults::apply(&label.state, label.severity.unwrap(), &physics.channel).unwrap()
                };
                for (y, expected) in y.iter().zip(decay(&rates)) {
                    let expected = expected * 400.0 / healthy_peak;
                    assert!((y - expected).abs() < 0.5 + 1e-6, "{stem} {label:?}");
                }
            }
            assert!(faulty > 100 && healthy > 100, "{faulty} {healthy}");
        }
    }

    #[test]
    fn the_frozen_benchmark_has_its_numbers() {
        let scenario = scenario(PHYSICS);
        let labels = scenario.labels(1);
        let set = |from: u32, to: u32, class: &str| {
            let of_set = |l: &&Label| {
                l.printhead == dataset::PRINTHEAD
                    && matches!(l.channel, Channels::One(c) if (from..to).contains(&c))
                    && l.state == class
            };
            labels.iter().filter(of_set).count()
        };
        for class in inkling_core::fault::CLASSES {
            assert_eq!(set(0, 4500, class), 225);
            assert_eq!(set(4500, 9000, class), 225);
            // multinomial: 2222 +- 44
            assert!((2000..2450).contains(&set(9000, 29000, class)));
        }
        assert!(labels.iter().all(|l| l.severity.is_some() == (l.state != HEALTHY)));
        let stems: Vec<String> = scenario.recordings(1).into_iter().map(|r| r.stem).collect();
        assert_eq!(stems, ["train", "test", "calibration", "print_run"]);
        let of_run =
            |l: &&Label| l.printhead != dataset::PRINTHEAD && matches!(l.channel, Channels::One(_));
        let mut channels: Vec<_> =
            labels.iter().filter(of_run).map(|l| (&l.printhead, l.channel)).collect();
        channels.dedup();
        assert_eq!(channels.len(), 51); // round(0.05 x 4 x 256)
    }
}
