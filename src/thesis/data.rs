//! Labelled signals in memory: the simulator's sets without files.
//!
//! In: a recording of a scenario and its labels. Out: signals with their classes, and the training
//! set that a design is made from.

use crate::design::TrainingSet;
use crate::fault::HEALTHY;
use crate::identify::averaging::SignalSet;
use crate::labels::Labels;
use crate::simulate::SimulatedRecording;
use std::collections::BTreeMap;

const PRINTHEAD: &str = "dataset";

/// Signals and what is true of them, in the order in which they were drawn.
#[derive(Clone, Debug, Default)]
pub struct Signals {
    pub dt_s: f64,
    pub samples: usize,
    pub y: Vec<Vec<f64>>,
    /// `healthy` or a fault class, one per signal.
    pub state: Vec<String>,
}

impl Signals {
    pub fn of(recording: SimulatedRecording, labels: &Labels) -> Signals {
        let mut signals = Signals::default();
        for burst in recording.bursts {
            signals.dt_s = burst.sample_period_s;
            signals.samples = burst.samples_per_channel as usize;
            for row in 0..burst.channels {
                let label = labels.at(&burst.printhead, burst.first_channel + row, burst.t_acq_ns);
                let mut y = vec![0.0; signals.samples];
                burst.copy_signal(row as usize, &mut y);
                signals.y.push(y);
                signals.state.push(label.map_or(HEALTHY.into(), |l| l.state.clone()));
            }
        }
        signals
    }

    pub fn len(&self) -> usize {
        self.y.len()
    }

    pub fn is_empty(&self) -> bool {
        self.y.is_empty()
    }

    /// Each signal and its state.
    pub fn each(&self) -> impl Iterator<Item = (&[f64], &str)> {
        self.y.iter().zip(&self.state).map(|(y, s)| (y.as_slice(), s.as_str()))
    }

    pub fn is_faulty(&self, i: usize) -> bool {
        self.state[i] != HEALTHY
    }

    pub fn faulty(&self) -> usize {
        self.state.iter().filter(|s| *s != HEALTHY).count()
    }

    /// All healthy signals and the first `faulty` of the others: thesis Table 4-6's training sizes.
    pub fn training(&self, faulty: usize) -> TrainingSet {
        let mut set = TrainingSet {
            sample_period_s: self.dt_s,
            samples: self.samples,
            ..TrainingSet::default()
        };
        let mut left = faulty;
        for (i, (y, state)) in self.each().enumerate() {
            let sets: &mut BTreeMap<String, SignalSet> = if state == HEALTHY {
                &mut set.healthy
            } else if left > 0 {
                left -= 1;
                set.faulty.entry(state.into()).or_default()
            } else {
                continue;
            };
            let signal: Vec<f32> = y.iter().map(|&v| v as f32).collect();
            sets.entry(PRINTHEAD.into()).or_insert_with(|| SignalSet::new(self.samples)).push(
                &signal,
                i as u32,
                1.0,
                f64::NAN,
            );
            *set.signals.entry(state.into()).or_default() += 1;
        }
        set
    }
}
