//! Checks the dialects of the settings against all recordings before any is judged: a dialect that never
//! takes effect, or a path in it that leads nowhere, is a mistake in the settings.

use super::exit::Failure;
use crate::settings::Settings;
use inkling_io::Limits;
use inkling_io::damage::RecordingError;
use inkling_io::dialect::Dialects;
use inkling_io::inputs::Input;
use inkling_io::recording::{Other, Recording};
use std::collections::BTreeSet;
use std::path::Path;

/// The failure of recordings without bursts.
pub const NO_BURSTS: &str =
    "no inkling.Burst messages found; `inkling inspect` shows what there is and how to read it";

/// Most topics that are named if a dialect fits none.
const MOST_TOPICS: usize = 12;

/// The dialects of the settings, if each fits some message. `is_known`: whether an earlier run judged a
/// recording by these dialects and it has not changed since; it is not opened again.
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
    // `used`: dialects that fit a message; `all`: whether every recording was looked at in full
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
        // if a dialect fits other recordings, an older one with another schema fails by itself
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

/// Opens a recording; returns it with the numbers of the dialects that it uses, and whether all of it was
/// looked at.
fn look(path: &Path, dialects: &Dialects) -> Result<(Recording, Vec<usize>, bool), RecordingError> {
    let recording = Recording::open_with(path, Limits::default(), dialects)?;
    let used = recording.dialects_used(dialects.len())?;
    Ok((recording, used.numbers, used.all))
}

/// A topic with its schema and encoding, for a message.
fn shown(other: &Other) -> String {
    let schema = if other.schema.is_empty() { "no schema" } else { &other.schema };
    format!("{} ({schema}, {})", other.topic, other.message_encoding)
}

/// The end of the message about an unused dialect: which topics there are.
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
