//! Signals of recordings, for the verbs that learn of them.

use super::dialects;
use super::exit::Failure;
use super::progress::{Progress, interruptible};
use crate::design::TrainingSet;
use crate::io::recording::Recording;
use crate::io::{Limits, inputs};
use crate::labels::Labels;
use crate::pipeline::collect::Collector;
use crate::settings::Settings;

pub struct Collected {
    pub set: TrainingSet,
    /// Something was damaged, or could not be used.
    pub incomplete: bool,
    pub progress: Progress,
}

/// `recordings`: files, directories, glob patterns.
pub fn collected(
    recordings: &[String],
    settings: &Settings,
    labels: Option<&Labels>,
) -> Result<Collected, Failure> {
    let inputs = inputs::find_recordings(recordings).map_err(Failure::new)?;
    let dialects = dialects::checked(settings, &inputs)?;
    let control = interruptible();
    let progress = Progress::new(inputs.len(), 0);
    let mut collector = Collector::new(labels, settings.input.rails);
    let mut damaged = false;
    for input in &inputs {
        let recording = Recording::open_with(&input.path, Limits::default(), &dialects)?;
        let damage = progress.during(&recording.name, recording.bytes, &control, || {
            collector.take(&recording, &control)
        })?;
        damaged |= !damage.is_empty();
        progress.say_damage(&recording.name, &damage);
    }
    let set = collector.finish().ok_or_else(|| Failure::new(dialects::NO_BURSTS))?;
    let unused = ["rejected", "other_sampling"].iter().any(|k| set.signals.contains_key(*k));
    Ok(Collected { set, incomplete: damaged || unused, progress })
}
