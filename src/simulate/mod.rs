//! Recordings with known truth. In: a scenario and a seed. Out: bursts, and labels that say what
//! is true of them.
//!
//! thesis §2-2 as a simulator ([`print_run`], [`dataset`]), and the data set of thesis §4-1 in a
//! form of its own ([`thesis_form`]). Bursts are made one by one: memory does not grow with the
//! length of a run. The same scenario and seed give the same bytes; each purpose draws from its
//! own stream, so that changing one part does not reshuffle another.

mod burst_shape;
pub mod dataset;
pub mod print_run;
pub mod scenario;
mod sensor;
pub mod thesis_form;

use crate::burst::Burst;
use crate::labels::Label;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

pub use scenario::{Compression, RecordingOptions, Scenario, ScenarioError};

use scenario::Kind;

/// One recording of a scenario, not yet made: its bursts come in time order, as they are asked for.
pub struct SimulatedRecording {
    /// File stem: `train`, `test`, `calibration`, `print_run`.
    pub stem: String,
    /// How many bursts will come.
    pub burst_count: u64,
    pub bursts: Box<dyn Iterator<Item = Burst> + Send>,
    pub options: RecordingOptions,
}

impl Scenario {
    /// The recordings of this scenario.
    pub fn recordings(&self, seed: u64) -> Vec<SimulatedRecording> {
        let mut recordings = match &self.kind {
            Kind::Classes(classes) => thesis_form::recordings(classes, &self.recording, seed),
            Kind::Physics(physics) => dataset::recordings(physics, &self.recording, seed),
        };
        if let Kind::Physics(physics) = &self.kind {
            recordings.extend(print_run::recording(physics, &self.recording, seed));
        }
        recordings
    }

    /// What is true of all recordings of this scenario: one `*` row per printhead, healthy, then
    /// the fault rows.
    pub fn labels(&self, seed: u64) -> Vec<Label> {
        match &self.kind {
            Kind::Classes(classes) => thesis_form::labels(classes, seed),
            Kind::Physics(physics) => {
                let mut labels = dataset::labels(physics, seed);
                labels.extend(print_run::labels(physics, &self.recording, seed));
                // stable: the `*` rows go first, all others keep their order
                labels.sort_by_key(|label| label.channel.is_some());
                labels
            }
        }
    }
}

/// What random numbers are drawn for. Each (purpose, part) is a stream of its own; the numbers
/// are part of what "the same seed" means and never change.
#[derive(Clone, Copy)]
enum Purpose {
    Truth = 1,
    Spread = 2,
    Shot = 3,
    Noise = 4,
    Temperature = 5,
    Drive = 6,
    Neighbours = 7,
}

/// The random numbers of one purpose in one part of a scenario (a set, or a printhead of a run).
fn stream(seed: u64, purpose: Purpose, part: u32) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(((purpose as u64) << 32) | u64::from(part));
    rng
}

/// Parts for [`stream`]: the sets; printheads of a print run count on from `PRINT_RUN`.
mod part {
    pub const TRAIN: u32 = 0;
    pub const TEST: u32 = 1;
    pub const CALIBRATION: u32 = 2;
    pub const PRINT_RUN: u32 = 16;
}

fn healthy_everywhere(printhead: &str) -> Label {
    Label {
        printhead: printhead.to_owned(),
        channel: None,
        from_ns: None,
        to_ns: None,
        state: crate::fault::HEALTHY.to_owned(),
        severity: None,
    }
}
