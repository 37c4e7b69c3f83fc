//! Recordings read one after another, for the verbs that learn of their signals.

use super::dialects;
use super::exit::Failure;
use super::progress::{Progress, interruptible};
use crate::design::TrainingSet;
use crate::io::Limits;
use crate::io::damage::Damage;
use crate::io::dialect::Dialects;
use crate::io::inputs::{self, Input};
use crate::io::recording::Recording;
use crate::labels::Labels;
use crate::pipeline::collect::Collector;
use crate::pipeline::{Control, PipelineError};
use crate::settings::Settings;
use std::sync::Arc;

pub struct Recordings {
    inputs: Vec<Input>,
    dialects: Dialects,
    pub control: Arc<Control>,
    pub progress: Progress,
}

impl Recordings {
    /// Files, directories, glob patterns.
    pub fn find(patterns: &[String], settings: &Settings) -> Result<Recordings, Failure> {
        let inputs = inputs::find_recordings(patterns)?;
        let dialects = dialects::checked(settings, &inputs, |_| false)?;
        let control = interruptible();
        let progress = Progress::new(inputs.len(), 0);
        Ok(Recordings { inputs, dialects, control, progress })
    }

    /// Takes one after another; whether some of them were damaged.
    pub fn each(
        &self,
        mut take: impl FnMut(&Recording, &Control) -> Result<Vec<Damage>, PipelineError>,
    ) -> Result<bool, Failure> {
        let mut damaged = false;
        for input in &self.inputs {
            let recording = Recording::open_with(&input.path, Limits::default(), &self.dialects)?;
            let (name, control): (_, &Control) = (&recording.name, &self.control);
            let job = || take(&recording, control);
            let damage = self.progress.during(name, recording.bytes, control, job)?;
            damaged |= !damage.is_empty();
            self.progress.say_damage(name, &damage);
        }
        Ok(damaged)
    }
}

/// Signals to learn of.
pub struct Collected {
    pub set: TrainingSet,
    /// Something was damaged, or could not be used.
    pub incomplete: bool,
    pub progress: Progress,
}

/// Of all recordings; with labels by what these say.
pub fn collected(
    patterns: &[String],
    settings: &Settings,
    labels: Option<&Labels>,
) -> Result<Collected, Failure> {
    let recordings = Recordings::find(patterns, settings)?;
    let mut collector = Collector::new(labels, settings.input.rails);
    let damaged = recordings.each(|recording, control| collector.take(recording, control))?;
    let set = collector.finish().ok_or_else(|| Failure::new(dialects::NO_BURSTS))?;
    let unused = ["rejected", "other_sampling"].iter().any(|k| set.signals.contains_key(*k));
    Ok(Collected { set, incomplete: damaged || unused, progress: recordings.progress })
}
