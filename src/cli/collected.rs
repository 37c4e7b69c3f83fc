//! Reads recordings one after another, for the verbs that learn from their signals; and checks the dialects of
//! the settings against all recordings before any is read: a dialect that never takes effect, or a path in it
//! that leads nowhere, is a mistake in the settings.
//!
//! In: the names of recordings, or one in memory, and the settings. Out: to `train`, `identify` and
//! `thesis` their signals by printhead and label ([`collected`]); to `critique` one recording after
//! another ([`Recordings::each`]); to `replay` and `inspect` the checked dialects
//! ([`checked_dialects`]).
//!
//! A *dialect* says how messages of another logger become bursts (`[[input.dialect]]`).

use super::exit::Failure;
use super::progress::{Progress, interruptible};
use crate::pipeline::collect::{Collector, OTHER_SAMPLING};
use crate::pipeline::ring_look::{self, Doubt, Known};
use crate::pipeline::visit::Pass;
use crate::pipeline::{Control, PipelineError, nobody_reads};
use crate::report::first_of;
use crate::settings::Settings;
use inkling_core::design::TrainingSet;
use inkling_core::labels::{Labels, RecordedSpans};
use inkling_io::damage::{Damage, RecordingError};
use inkling_io::dialect::Dialects;
use inkling_io::inputs::{self, Input};
use inkling_io::recording::{OtherChannel, Recording};
use inkling_io::{Limits, printable};
use std::collections::BTreeSet;
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
    /// Finds the recordings and checks the dialects of the settings against them. A recording in
    /// memory has bursts already, so no dialect is used for it.
    pub fn find(given: RecordingSource, settings: &Settings) -> Result<Recordings, Failure> {
        let (inputs, in_memory) = match given {
            RecordingSource::Named(patterns) => (inputs::find_recordings(patterns)?, None),
            RecordingSource::InMemory(recording) => (Vec::new(), Some(recording)),
        };
        let dialects = match in_memory {
            None => checked_dialects(settings, &inputs, |_| false)?,
            Some(_) => Dialects::default(),
        };
        let (control, progress) = (interruptible(), Progress::through(&inputs));
        Ok(Recordings { inputs, in_memory, dialects, control, progress })
    }

    /// Hands one recording after another to `take`, which returns what of the recording is damaged
    /// or missing; tells that damage, and returns whether there was any. The first recording that
    /// cannot be opened is a failure.
    pub fn each(
        &self,
        mut take: impl FnMut(Pass) -> Result<Vec<Damage>, PipelineError>,
    ) -> Result<bool, Failure> {
        let mut is_damaged = |recording: &Recording| {
            let (name, control): (_, &Control) = (&recording.name, &self.control);
            let job = || take(Pass { recording, control });
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
    pub met: RecordedSpans,
    /// Whether something was damaged or could not be used: the verb then ends with exit status 3.
    pub incomplete: bool,
    /// For further messages of the verb.
    pub progress: Progress,
}

/// Collects the signals of all recordings by printhead and label. `labels`: `None` if all signals
/// count as healthy. A failure if the recordings hold no burst.
pub fn collected(
    given: RecordingSource,
    settings: &Settings,
    labels: Option<&Labels>,
) -> Result<Collected, Failure> {
    let recordings = Recordings::find(given, settings)?;
    let mut collector = Collector::new(labels, settings.input.rails);
    let ignored = settings.input.ignored();
    let damaged = recordings.each(|pass| {
        let damage = collector.take(pass)?;
        let heads = collector.met.printheads();
        let unread = pass.recording.unread(&recordings.dialects, &heads).into_iter();
        for topic in unread.filter(|topic| !ignored.has(&topic.topic)) {
            let what = nobody_reads(topic).what;
            recordings.progress.say(&format!("warning: {}: {what}", pass.recording.name));
        }
        for Doubt { printhead, what, .. } in ring_look::doubts(pass.recording, Known::But(&[])) {
            let (name, head) = (&pass.recording.name, printable::cell(&printhead));
            recordings.progress.say(&format!("warning: {name}: {head}: {what}"));
        }
        Ok(damage)
    })?;
    let met = std::mem::take(&mut collector.met);
    if let Some(what) = &collector.other_sampling {
        let more = "those are left out. Train designs of one sampling each";
        recordings.progress.say(&format!("warning: {}: {more}", printable::line(what, 400)));
    }
    let set = collector.finish().ok_or_else(|| Failure::new(NO_BURSTS))?;
    let mut unused = ["rejected", OTHER_SAMPLING].iter().any(|k| set.signals.contains_key(*k));
    if let Some(n) = set.signals.get("beyond_the_limit_of_sets") {
        let of = "of more printheads and labels than there is room for";
        recordings.progress.say(&format!("warning: left out: {n} signals {of}"));
        unused = true;
    }
    Ok(Collected { set, met, incomplete: damaged || unused, progress: recordings.progress })
}

/// The failure of recordings without bursts.
pub const NO_BURSTS: &str =
    "no bursts found; `inkling inspect` shows what there is and how to read it";

/// Most topics that are named if a dialect fits none.
const MOST_TOPICS: usize = 12;

/// The dialects of the settings. It is a usage failure if one of them fits no message of any
/// recording, or if a path in one leads nowhere: but only where every recording could be looked at,
/// since a recording that could not may be the one that needs it. `is_known`: whether an earlier
/// run judged a recording by these dialects and it has not changed since; such a recording is not
/// opened again.
pub fn checked_dialects(
    settings: &Settings,
    inputs: &[Input],
    is_known: impl Fn(&Input) -> bool,
) -> Result<Dialects, Failure> {
    let dialects = settings.input.dialects();
    if dialects.is_empty() {
        return Ok(dialects);
    }
    let (known, new): (Vec<&Input>, Vec<&Input>) = inputs.iter().partition(|input| is_known(input));

    // 1. look at the new recordings. `used`: dialects that fit a message; `all`: whether every
    // recording was looked at in full; `there`: topics that nothing reads; `wrong`: the first
    // dialect that fits a topic and not its messages
    let (mut used, mut all) = (BTreeSet::new(), known.is_empty());
    let (mut there, mut wrong) = (BTreeSet::new(), None);
    for input in new {
        let looked = Recording::open_with(&input.path, Limits::default(), &dialects)
            .and_then(|recording| Ok((recording.dialects_used(dialects.len())?, recording)));
        match looked {
            Ok((fitting, recording)) => {
                used.extend(fitting.numbers);
                all &= fitting.all;
                there.extend(recording.others.iter().map(shown));
            }
            Err(e @ RecordingError::Dialect { .. }) => wrong = wrong.or(Some(e)),
            Err(_) => all = false, // whoever reads it will say
        }
    }

    // 2. a dialect that does not fit its messages is a mistake, unless dialects fit other
    // recordings: an older recording with another schema then fails by itself
    if let Some(e) = wrong {
        if used.is_empty() && known.is_empty() {
            return Err(e.into());
        }
        all = false;
    }

    // 3. a dialect that fits nothing
    let unused = dialects.without(|number| used.contains(&number));
    if unused.is_empty() || !all {
        return Ok(dialects); // what could not be looked at may need them
    }
    let (unused, topics) = (unused.join(", "), topics(there));
    Err(Failure::usage(format!(
        "{unused}: no messages that it fits and that are not inkling.Burst already{topics}"
    )))
}

/// A topic with its schema and encoding, for a message.
fn shown(other: &OtherChannel) -> String {
    let schema = if other.schema.is_empty() { "no schema" } else { &other.schema };
    format!("{} ({schema}, {})", other.topic, other.message_encoding)
}

/// The end of the message about an unused dialect: which topics there are.
fn topics(there: BTreeSet<String>) -> String {
    let named: Vec<String> = there.into_iter().collect();
    match named.is_empty() {
        true => "; the recordings have no other topics".into(),
        false => format!("; topics that exist: {}", first_of(&named, MOST_TOPICS, ", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use inkling_core::burst::{Burst, Format, Layout};
    use inkling_io::memory_recording;

    #[test]
    fn signals_of_too_many_printheads_are_told_by_the_exit_status() {
        let incomplete = |printheads: usize| {
            let burst = |k: usize| Burst {
                printhead: format!("k-{k}").into(),
                ..Burst::of(&[vec![1.0, 2.0]], 1e-6, Format::S16Le, Layout::ChannelMajor)
            };
            let bursts: Vec<Burst> = (0..printheads).map(burst).collect();
            let recording = memory_recording::of_bursts("x", &bursts).unwrap();
            let given = RecordingSource::InMemory(Box::new(recording));
            collected(given, &Settings::default(), None).ok().unwrap().incomplete
        };
        assert_eq!([incomplete(512), incomplete(513)], [false, true]);
    }
}
