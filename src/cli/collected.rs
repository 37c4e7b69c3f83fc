//! Reads recordings one after another, for the verbs that learn from their signals.

use super::dialects;
use super::exit::Failure;
use super::progress::{Progress, interruptible};
use crate::pipeline::collect::Collector;
use crate::pipeline::{Control, PipelineError};
use crate::settings::Settings;
use inkling_core::design::TrainingSet;
use inkling_core::labels::{Labels, Met};
use inkling_io::Limits;
use inkling_io::damage::Damage;
use inkling_io::dialect::Dialects;
use inkling_io::inputs::{self, Input};
use inkling_io::recording::Recording;
use std::sync::Arc;

/// Where the recordings of a verb come from.
pub enum RecordingSource<'a> {
    /// Files, directories or glob patterns.
    Named(&'a [String]),
    InMemory(Box<Recording>),
}

/// The recordings of a verb, and what is needed to read them.
pub struct Recordings {
    inputs: Vec<Input>,
    in_memory: Option<Box<Recording>>,
    dialects: Dialects,
    pub control: Arc<Control>,
    pub progress: Progress,
}

impl Recordings {
    /// Finds the recordings and checks the dialects of the settings against them.
    pub fn find(given: RecordingSource, settings: &Settings) -> Result<Recordings, Failure> {
        let (inputs, in_memory) = match given {
            RecordingSource::Named(patterns) => (inputs::find_recordings(patterns)?, None),
            RecordingSource::InMemory(recording) => (Vec::new(), Some(recording)),
        };
        let dialects = match in_memory {
            None => dialects::checked(settings, &inputs, |_| false)?,
            Some(_) => Dialects::default(),
        };
        let (control, progress) = (interruptible(), Progress::new(inputs.len(), 0));
        Ok(Recordings { inputs, in_memory, dialects, control, progress })
    }

    /// Hands one recording after another to `take`; returns whether some of them were damaged.
    pub fn each(
        &self,
        mut take: impl FnMut(&Recording, &Control) -> Result<Vec<Damage>, PipelineError>,
    ) -> Result<bool, Failure> {
        let mut is_damaged = |recording: &Recording| {
            let (name, control): (_, &Control) = (&recording.name, &self.control);
            let job = || take(recording, control);
            let damage = self.progress.during(name, recording.bytes, control, job)?;
            self.progress.say_damage(name, &damage);
            Ok::<bool, Failure>(!damage.is_empty())
        };
        let mut damaged = self.in_memory.as_deref().map_or(Ok(false), &mut is_damaged)?;
        for input in &self.inputs {
            let recording = Recording::open_with(&input.path, Limits::default(), &self.dialects)?;
            damaged |= is_damaged(&recording)?;
        }
        Ok(damaged)
    }
}

/// Signals to learn from.
pub struct Collected {
    pub set: TrainingSet,
    /// The printheads, channels and times that were met, against which labels can be checked.
    pub met: Met,
    /// Whether something was damaged or could not be used.
    pub incomplete: bool,
    pub progress: Progress,
}

/// Collects the signals of all recordings, sorted by the labels if there are any.
pub fn collected(
    given: RecordingSource,
    settings: &Settings,
    labels: Option<&Labels>,
) -> Result<Collected, Failure> {
    let recordings = Recordings::find(given, settings)?;
    let mut collector = Collector::new(labels, settings.input.rails);
    let damaged = recordings.each(|recording, control| collector.take(recording, control))?;
    let met = std::mem::take(&mut collector.met);
    let set = collector.finish().ok_or_else(|| Failure::new(dialects::NO_BURSTS))?;
    let unused = ["rejected", "other_sampling"].iter().any(|k| set.signals.contains_key(*k));
    Ok(Collected { set, met, incomplete: damaged || unused, progress: recordings.progress })
}
