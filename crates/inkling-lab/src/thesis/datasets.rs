//! The labelled data that chapter 4 is run on: simulated data by seed, recorded data by fold.
//! thesis §4-1.
//!
//! In: a seed (`part`), or a user's labelled signals (`Recorded::new`). Out to `measure`: a `Part`, the signals to learn from and those to test on. The two share no signal
//! and, of recordings, no channel.
//!
//! Simulated are two scenarios of `sample_logs/scenarios`, each of which has a training and a test
//! recording, and the drying experiment. Recordings are divided by channel into at most five folds
//! (`assigned`), so that no method can recognise a channel; each fold is tested on once.

use super::outcome::{DataSet, ThesisError};
use crate::plot::page::first_of;
use crate::simulate::scenario::{Classes, Kind, Physics};
use crate::simulate::{Scenario, SimulatedRecording, drying};
use inkling_core::burst::Beside;
use inkling_core::design::TrainingSet;
use inkling_core::fault::HEALTHY;
use inkling_core::identify::SignalSet;
use inkling_core::labels::Labels;
use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

const THESIS_FORM: &str = include_str!("../../../../sample_logs/scenarios/thesis.toml");
const PHYSICS: &str = include_str!("../../../../sample_logs/scenarios/physics.toml");
/// Name of the one printhead that all simulated signals are given.
const PRINTHEAD: &str = "dataset";
/// Faulty signals for the calibration error: of 2025 even a perfect posterior averages .013.
const CALIBRATION_SIGNALS: usize = 20_000;
/// Added to the seed for calibration signals, which must differ from those that are learned from.
const CALIBRATION_SEEDS: u64 = 1_000_000;
/// Most recorded signals of a printhead, healthy and of each class: 1-NN compares each with each.
const MOST_HEALTHY: usize = 5_000;
const MOST_OF_A_CLASS: usize = 1_000;
/// Largest number of parts that recordings are divided into.
const MOST_FOLDS: usize = 5;

/// The factors mu of (3-4) that thesis §4-2 takes for its simulated data, which recordings have, too, and for its
/// experiment.
const MU: f64 = 1.0;
const MU_OF_DRYING: f64 = 2.0;

/// The training and test signals of one seed of simulated data.
pub fn part(set: DataSet, seed: u64) -> Result<Part, ThesisError> {
    match set {
        DataSet::ThesisForm => of_scenario(&scenario(THESIS_FORM)?, seed),
        DataSet::ByModel => of_scenario(&scenario(PHYSICS)?, seed),
        DataSet::Drying => {
            let physics = physics()?;
            let (learn, test) = (dried(&physics, seed, 0), dried(&physics, seed, 1));
            Ok(Part { learn, test, calibration: None, mu: MU_OF_DRYING })
        }
        DataSet::Recordings => Err(ThesisError::Data("recordings have no seeds".into())),
    }
}

/// The signals to learn from, and those to test on.
#[derive(Debug)]
pub struct Part {
    pub learn: TrainingSet,
    pub test: TrainingSet,
    /// More faulty test signals, for the calibration error of the product's default.
    pub calibration: Option<TrainingSet>,
    /// The factor mu of thesis (3-4).
    pub mu: f64,
}

/// The physics scenario, whose channels and acquisition the drying experiment takes.
fn physics() -> Result<Physics, ThesisError> {
    match scenario(PHYSICS)?.kind {
        Kind::Physics(physics) => Ok(Physics::clone(&physics)),
        Kind::Classes(_) => Err(ThesisError::Data("a physics scenario is needed".into())),
    }
}

fn scenario(text: &str) -> Result<Scenario, ThesisError> {
    Scenario::from_toml(text).map_err(|e| ThesisError::Data(e.to_string()))
}

/// Training, test and calibration signals of a scenario: its first three recordings. A scenario of
/// classes has no third one; a set for calibration is simulated in addition.
fn of_scenario(scenario: &Scenario, seed: u64) -> Result<Part, ThesisError> {
    let missing = || ThesisError::Data("a training and a test set are needed".into());
    let labels = Labels::new(scenario.labels(seed));
    let mut sets = scenario.recordings(seed).into_iter().map(|r| of_recording(r, &labels));
    let (learn, test) = (sets.next().ok_or_else(missing)?, sets.next().ok_or_else(missing)?);
    let calibration = match &scenario.kind {
        // the physics scenario has a third set
        Kind::Physics(_) => sets.next(),
        Kind::Classes(classes) => Some(more_faulty(scenario, classes, seed).ok_or_else(missing)?),
    };
    Ok(Part { learn, test, calibration, mu: MU })
}

/// A set of the same classes from another seed, with `CALIBRATION_SIGNALS` faulty signals in all.
fn more_faulty(scenario: &Scenario, classes: &Classes, seed: u64) -> Option<TrainingSet> {
    let mut more = classes.clone();
    more.n_per_fault = CALIBRATION_SIGNALS.div_ceil(classes.fault_classes().len().max(1));
    more.n_healthy = 1;
    let more = Scenario { kind: Kind::Classes(Arc::new(more)), ..scenario.clone() };
    let seed = seed.wrapping_add(CALIBRATION_SEEDS);
    let labels = Labels::new(more.labels(seed));
    more.recordings(seed).into_iter().nth(1).map(|recording| of_recording(recording, &labels))
}

/// All signals of a recording with their labelled states; without a label they count as healthy.
fn of_recording(recording: SimulatedRecording, labels: &Labels) -> TrainingSet {
    let mut set = TrainingSet::default();
    for burst in recording.bursts {
        (set.sample_period_s, set.samples) =
            (burst.sample_period_s, burst.samples_per_channel as usize);
        let mut y = vec![0.0; set.samples];
        for row in 0..burst.channels {
            let channel = burst.first_channel + row;
            let label = labels.at(&burst.printhead, channel, burst.t_acq_ns);
            burst.copy_signal(row as usize, &mut y);
            let signal: Vec<f32> = y.iter().map(|&v| v as f32).collect();
            add(&mut set, label.map_or(HEALTHY, |label| &label.state), &signal, channel);
        }
    }
    set
}

/// One drying experiment. `repeat`: 0 to learn from, 1 to test on.
fn dried(physics: &Physics, seed: u64, repeat: u32) -> TrainingSet {
    let mut set = TrainingSet {
        sample_period_s: physics.acquisition.sample_period_s(),
        samples: physics.acquisition.samples,
        ..TrainingSet::default()
    };
    for (channel, (state, counts)) in
        drying::experiment(physics, seed, repeat).into_iter().enumerate()
    {
        let signal: Vec<f32> = counts.iter().map(|&v| f32::from(v)).collect();
        add(&mut set, state, &signal, channel as u32);
    }
    set
}

/// Adds a signal (counts) to a set, at the reference drive and without a temperature.
fn add(set: &mut TrainingSet, state: &str, signal: &[f32], channel: u32) {
    let samples = set.samples;
    let sets = match state {
        HEALTHY => &mut set.healthy,
        fault => set.faulty.entry(fault.into()).or_default(),
    };
    let own = sets.entry(PRINTHEAD.into()).or_insert_with(|| SignalSet::new(samples));
    own.push(signal, 1.0, &Beside::alone(channel, 0));
    *set.signals.entry(state.into()).or_default() += 1;
}

/// Each signal with its state: N samples in counts, divided by its relative drive.
pub fn each(set: &TrainingSet) -> impl Iterator<Item = (&str, Vec<f64>)> {
    set.sets().flat_map(|(state, _, signals)| {
        (0..signals.len()).map(move |i| {
            let drive = signals.drive[i];
            (state, signals.signal(i).iter().map(|&v| f64::from(v) / drive).collect())
        })
    })
}

/// Number of healthy signals of a set.
pub fn healthy(set: &TrainingSet) -> usize {
    set.healthy.values().map(SignalSet::len).sum()
}

/// Number of faulty signals of a set.
pub fn faulty(set: &TrainingSet) -> usize {
    set.faulty.values().flat_map(BTreeMap::values).map(SignalSet::len).sum()
}

/// All healthy signals and `n` of the faulty ones: the training sizes of thesis Tables 4-6 and 4-7.
/// Each class and printhead keeps its share of the n, and of its signals the first ones.
pub fn with_faulty(set: &TrainingSet, n: usize) -> TrainingSet {
    let all = faulty(set).max(1);
    let (mut passed, mut kept) = (0, 0);
    set.with(|state, _, signals| {
        if state == HEALTHY {
            return (0..signals.len()).collect();
        }
        // rounding the running total instead of each share makes the shares add up to n
        passed += signals.len();
        let until = (passed * n + all / 2) / all;
        let own = until - kept;
        kept = until;
        (0..own.min(signals.len())).collect()
    })
}

/// A user's labelled signals, divided by channel into parts, and in sentences what was left out.
pub struct Recorded {
    pub(super) parts: Vec<Part>,
    pub(super) left_out: Vec<String>,
}

/// A channel, by the name of its printhead and its number.
type Place = (String, u32);

impl Recorded {
    /// Divides recorded signals into parts by channel. Fails unless healthy signals and at least two fault
    /// classes remain that can be learned and tested on different channels.
    pub fn new(set: &TrainingSet) -> Result<Recorded, ThesisError> {
        // the channels of each state, and the fold of each channel, whatever its states
        let (few, mut left_out) = fewer(set);
        let mut channels: BTreeMap<&str, BTreeSet<Place>> = BTreeMap::new();
        for (state, printhead, signals) in few.sets() {
            let own = channels.entry(state).or_default();
            own.extend(signals.channel.iter().map(|&channel| (printhead.to_owned(), channel)));
        }

        let fold_of = assigned(&channels);

        // A class whose channels are all in one fold could not be learned on the other channels.
        let mut is_left_out = BTreeSet::new();
        for (state, own) in &channels {
            let within: BTreeSet<usize> = own.iter().map(|place| fold_of[place]).collect();
            if within.len() < 2 {
                is_left_out.insert((*state).to_owned());
                let why = match own.len() {
                    1 => "one channel alone: learned on others, it would be tested on nothing",
                    _ => "channels that other classes hold together in one part",
                };
                left_out.push(format!("{state} is on {why}; it is left out"));
            }
        }

        // Chapter 4 compares classes, so it needs healthy signals and two classes.
        let faults =
            channels.keys().filter(|state| **state != HEALTHY && !is_left_out.contains(**state));
        if faults.count() < 2 || !channels.contains_key(HEALTHY) || is_left_out.contains(HEALTHY) {
            const MOST_TOLD: usize = 3;
            let told = if left_out.is_empty() { "" } else { "; " };
            let told = told.to_owned() + &first_of(&left_out, MOST_TOLD, "; ");
            return Err(ThesisError::Data(format!(
                "chapter 4 tells fault classes from each other on channels that were not learned from: it needs labelled healthy \
                 signals and two fault classes, each on two channels at least{told}"
            )));
        }

        let part_of = |is_in: &dyn Fn(usize) -> bool| {
            few.with(|state, printhead, signals| {
                let chosen = |&i: &usize| {
                    let place = (printhead.to_owned(), signals.channel[i]);
                    !is_left_out.contains(state)
                        && fold_of.get(&place).is_some_and(|&fold| is_in(fold))
                };
                (0..signals.len()).filter(chosen).collect()
            })
        };
        let part = |k: usize| Part {
            learn: part_of(&|fold| fold != k),
            test: part_of(&|fold| fold == k),
            calibration: None,
            mu: MU,
        };
        let folds: BTreeSet<usize> = fold_of.values().copied().collect();
        let all = folds.len();
        let mut parts: Vec<Part> = folds.into_iter().map(part).collect();
        parts.retain(|part| faulty(&part.test) > 0);
        // what such a part holds is learned from all the same
        if parts.len() < all {
            let without = all - parts.len();
            left_out.push(format!(
                "{without} of {all} parts hold no faulty signal: nothing is tested on them"
            ));
        }
        Ok(Recorded { parts, left_out })
    }

    /// Number of parts, which is the number of rounds.
    pub fn folds(&self) -> usize {
        self.parts.len()
    }
}

/// Thins the signals of each state and printhead out, evenly, and says in sentences where.
fn fewer(set: &TrainingSet) -> (TrainingSet, Vec<String>) {
    let mut left_out = Vec::new();
    let few = set.with(|state, printhead, signals| {
        let most = if state == HEALTHY { MOST_HEALTHY } else { MOST_OF_A_CLASS };
        let (all, kept) = (signals.len(), signals.len().min(most));
        if kept < all {
            left_out.push(format!("of {all} signals of {state} on {printhead} {kept} are used"));
        }
        (0..kept).map(|k| k * all / kept).collect()
    });
    (few, left_out)
}

/// The fold of each channel, from the channels of each state. The number of folds is five, or that
/// of the channels if there are fewer, but at least two.
///
/// A channel may have several states, and all of its signals go to one fold. Greedy: states with
/// few channels come first, since they have the least choice. Each of their channels that has no
/// fold yet goes to the fold that holds the fewest channels of this state, and among equal ones the
/// fewest of all.
fn assigned(channels: &BTreeMap<&str, BTreeSet<Place>>) -> BTreeMap<Place, usize> {
    let all: BTreeSet<&Place> = channels.values().flatten().collect();
    let folds = all.len().clamp(2, MOST_FOLDS);
    let mut fold_of: BTreeMap<Place, usize> = BTreeMap::new();
    let mut by_number: Vec<_> = channels.values().collect();
    by_number.sort_by_key(|own| own.len());
    let mut of_all = vec![0; folds];

    // `held`: how many channels of this state each fold holds, first those from other states
    for own in by_number {
        let mut held = vec![0; folds];
        own.iter().filter_map(|place| fold_of.get(place)).for_each(|&fold| held[fold] += 1);
        for place in own {
            if let Entry::Vacant(new) = fold_of.entry(place.clone()) {
                let fold = (0..folds).min_by_key(|&fold| (held[fold], of_all[fold])).unwrap_or(0);
                held[fold] += 1;
                of_all[fold] += 1;
                new.insert(fold);
            }
        }
    }
    fold_of
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_drying_experiment_has_the_texts_numbers_and_shares_no_signal() {
        let Part { learn, test, .. } = part(DataSet::Drying, 1).unwrap();
        for set in [&learn, &test] {
            let of = |state: &str| set.sets().filter(|s| s.0 == state).map(|s| s.2.len()).sum();
            let numbers: [usize; 3] = [of(HEALTHY), of("IDN"), of("DDN")];
            assert_eq!(numbers, [48, 39, 60]);
        }
        let seen: Vec<Vec<f64>> = each(&test).map(|(_, y)| y).collect();
        assert!(each(&learn).all(|(_, y)| !seen.contains(&y)));
        for (n, classes) in [(99, [60, 39]), (50, [30, 20]), (10, [6, 4])] {
            let few = with_faulty(&learn, n);
            let own: Vec<usize> = few.faulty.values().map(|s| s[PRINTHEAD].len()).collect();
            assert_eq!((own, healthy(&few)), (classes.to_vec(), 48));
        }
    }

    #[test]
    fn a_channel_is_tested_on_once_and_never_by_what_learned_from_it() {
        let mut set = TrainingSet { samples: 2, sample_period_s: 1e-6, ..TrainingSet::default() };
        for time in 0..3 {
            for channel in 0..30 {
                let state = match channel {
                    0 => "AB1",
                    1..4 => "SDN",
                    // healthy at first, faulty later
                    4..12 if time > 0 => "BN",
                    _ => HEALTHY,
                };
                add(&mut set, state, &[channel as f32, time as f32], channel);
            }
        }
        let Recorded { parts, left_out } = Recorded::new(&set).unwrap();
        assert!(left_out.len() == 1 && left_out[0].starts_with("AB1"), "{left_out:?}");
        let (mut tested, mut classes) = (BTreeSet::new(), BTreeMap::new());
        for part in &parts {
            let channels = |set: &TrainingSet| -> BTreeSet<u32> {
                set.sets().flat_map(|(_, _, s)| s.channel.iter().copied()).collect()
            };
            let (learned, own) = (channels(&part.learn), channels(&part.test));
            assert!(learned.is_disjoint(&own));
            assert_eq!(part.learn.faulty.len(), 2, "each class is learned for each part");
            part.test.faulty.keys().for_each(|name| *classes.entry(name.clone()).or_insert(0) += 1);
            assert!(own.iter().all(|&channel| tested.insert(channel)));
        }
        assert_eq!(tested.len(), 29);
        assert_eq!((classes["SDN"], classes["BN"], parts.len()), (3, 5, 5));
        let one = set.with(|state, _, s| {
            (0..s.len()).filter(|_| state == HEALTHY || state == "BN").collect()
        });
        assert!(Recorded::new(&one).err().unwrap().to_string().contains("two fault classes"));
        // three classes on two of three channels each: two parts could not hold them all, so there must be
        // three
        let mut few = TrainingSet { samples: 2, sample_period_s: 1e-6, ..TrainingSet::default() };
        for (state, two) in [("EC", [1, 3]), ("BN", [1, 2]), ("DDN", [2, 3]), (HEALTHY, [1, 2])] {
            two.into_iter().for_each(|channel| add(&mut few, state, &[0.0; 2], channel));
        }
        let Recorded { parts, left_out } = Recorded::new(&few).unwrap();
        assert!(parts.len() == 3 && left_out.is_empty(), "{left_out:?}");
    }
}
