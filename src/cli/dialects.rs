//! Dialects are checked against all recordings before any is judged: one that never takes effect, or a
//! path that leads nowhere, is a mistake in the settings.

use super::exit::Failure;
use crate::settings::Settings;
use inkling_io::Limits;
use inkling_io::damage::RecordingError;
use inkling_io::dialect::Dialects;
use inkling_io::inputs::Input;
use inkling_io::recording::{Other, Recording};
use std::collections::BTreeSet;
use std::path::Path;

pub const NO_BURSTS: &str =
    "no inkling.Burst messages found; `inkling inspect` shows what there is and how to read it";

/// Topics named where a dialect fits none.
const MOST_TOPICS: usize = 12;

/// The dialects of the settings, if they can do what they say. `is_known`: an earlier run judged that recording by these
/// dialects, and it has not changed since; it is not opened again.
pub fn checked(
    settings: &Settings,
    inputs: &[Input],
    is_known: impl Fn(&Input) -> bool,
) -> Result<Dialects, Failure> {
    let dialects = settings.input.dialects();
    if dialects.is_empty() {
        return Ok(dialects);
    }
    let (known, new): (Vec<&Input>, Vec<&Input>) = inputs.iter().partition(|input| is_known(input));
    // they were checked then, and what some of them need is not asked again
    let (mut used, mut all) = (BTreeSet::new(), known.is_empty());
    let (mut there, mut wrong) = (BTreeSet::new(), None);
    for input in new {
        match look(&input.path, &dialects) {
            Ok((recording, numbers, known)) => {
                used.extend(numbers);
                all &= known;
                there.extend(recording.others.iter().map(shown));
            }
            Err(e @ RecordingError::Dialect { .. }) => wrong = wrong.or(Some(e)),
            Err(_) => all = false, // whoever reads it will say
        }
    }
    match wrong {
        // an older recording of another schema fails alone, where others are read
        Some(e) if used.is_empty() && known.is_empty() => return Err(e.into()),
        Some(_) => all = false,
        None => {}
    }
    let unused = dialects.without(|number| used.contains(&number));
    match unused.as_slice() {
        [] => Ok(dialects),
        _ if !all => Ok(dialects), // what could not be looked at may need them
        unused => Err(Failure::usage(format!(
            "{}: no messages that it fits and that are not inkling.Burst already{}",
            unused.join(", "),
            topics(&there)
        ))),
    }
}

fn look(path: &Path, dialects: &Dialects) -> Result<(Recording, Vec<usize>, bool), RecordingError> {
    let recording = Recording::open_with(path, Limits::default(), dialects)?;
    let used = recording.dialects_used(dialects.len())?;
    Ok((recording, used.numbers, used.all))
}

fn shown(other: &Other) -> String {
    let schema = if other.schema.is_empty() { "no schema" } else { &other.schema };
    format!("{} ({schema}, {})", other.topic, other.message_encoding)
}

fn topics(there: &BTreeSet<String>) -> String {
    let named: Vec<&str> = there.iter().take(MOST_TOPICS).map(String::as_str).collect();
    match named.is_empty() {
        true => "; the recordings have no other topics".into(),
        false => {
            let more = there.len().saturating_sub(MOST_TOPICS);
            let more = if more > 0 { format!(" and {more} more") } else { String::new() };
            format!("; topics that exist: {}{more}", named.join(", "))
        }
    }
}
