//! inkling within another program: its verbs, its training and its judge, on files or on bursts in
//! memory. The Python package (`python/`) calls these functions.
//!
//! They print nothing on stderr, the caller interrupts them by a [`Control`], and errors and
//! warnings are returned in the words of the command line. Each function runs the code of the verb
//! itself; options are given as the words that the command line would have.
//!
//! Each of these functions is to run on a thread of its own, within [`called`]: messages are
//! collected per thread, and a panic must not end the other program.

use super::collected::RecordingSource;
use super::exit::{Exit, Failure};
use super::progress::{called_by, take_messages};
use super::train::{self, TrainedDesign, TrainingInput};
use super::{Cli, critique, effect, notes, output, parse, replay, score};
use crate::pipeline::{self, Control, Replay};
use crate::settings::Settings;
use clap::Parser;
use inkling_core::design::Design;
use inkling_core::state::Memory;
use inkling_io::baseline_file::BaselineFile;
use inkling_io::labels_file::LabelSource;
use inkling_io::outputs::{self, ResultFile};
use inkling_io::recording::Recording;
use inkling_io::verdict_arrays::VerdictArrays;
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Arc;

/// Recordings, named or in memory.
pub type Recordings<'a> = RecordingSource<'a>;

/// Does `work` on this thread, which `control` can interrupt. A panic becomes a failure. From the
/// first call on the whole process is quiet (`--quiet`).
pub fn called<T>(
    control: &Arc<Control>,
    work: impl FnOnce() -> Result<T, Failure>,
) -> Result<T, Failure> {
    output::be_quiet();
    let done = called_by(control, || catch_unwind(AssertUnwindSafe(work)));
    // an interruption may unwind the thread (`progress::end_of_work`), so not every panic is a fault
    // of ours
    let interrupted = |_: Box<dyn Any + Send>| match control.interrupted() {
        true => Err(Failure::new("interrupted")),
        false => Err(Failure::new("a computation panicked; this is our bug")),
    };
    done.unwrap_or_else(interrupted)
}

/// The result of a verb that did not fail.
pub struct Ended {
    pub exit: Exit,
    /// Sentences about what makes the result less certain or less complete.
    pub warnings: Vec<String>,
}

/// Runs a verb. `words`: the command line from the verb's name on.
pub fn verb(words: &[String]) -> Result<Ended, Failure> {
    ended(parsed::<Cli>(words)?.verb.run())
}

/// Adds to a verb's result the messages that were collected on this thread.
fn ended(done: Result<Exit, Failure>) -> Result<Ended, Failure> {
    let (exit, warnings) = with_messages(done)?;
    Ok(Ended { exit, warnings })
}

/// A result with the messages that were collected on this thread; a failure has them below its own,
/// one per line.
fn with_messages<T>(done: Result<T, Failure>) -> Result<(T, Vec<String>), Failure> {
    let mut messages = take_messages();
    done.map_err(|Failure { exit, message }| {
        messages.insert(0, message);
        Failure { exit, message: messages.join("\n") }
    })
    .map(|result| (result, messages))
}

/// Parses words as the command line does. The failure has the parser's message without its usual
/// advice.
fn parsed<C: Parser>(words: &[String]) -> Result<C, Failure> {
    let words = ["inkling"].into_iter().chain(words.iter().map(String::as_str));
    parse(words).map_err(|e: clap::Error| {
        let text = e.render().to_string();
        let what = text.split("\n\nFor more information").next().unwrap_or(&text);
        Failure::usage(what.trim_start_matches("error: ").trim_end())
    })
}

/// `inkling train` without writing its file: returns the design and what is to be told about it.
/// `new_class`: the values of `--new-class`; `set`: settings as KEY=VALUE.
pub fn learn(
    recordings: Recordings,
    labels: LabelSource,
    new_class: &[String],
    set: &[String],
) -> Result<TrainedDesign, Failure> {
    let settings = Settings::load(None, None, set)?;
    effect::check(set, &settings, effect::Command::Train)?;
    let lesson = TrainingInput { recordings, labels, new_class, settings: &settings };
    let (mut learned, mut warnings) = with_messages(train::learn(lesson))?;
    warnings.append(&mut learned.warnings);
    Ok(TrainedDesign { warnings, ..learned })
}

// The options of one verb as a command line of their own, without the verb's name.
#[derive(Debug, Parser)]
struct VerbOptions<A: clap::Args> {
    #[command(flatten)]
    args: A,
}

/// The arguments of a verb on bursts in memory. The required name of a recording is filled with a dummy.
fn options_of<A: clap::Args>(options: &[String]) -> Result<A, Failure> {
    let words = [&["array".to_owned()], options].concat();
    Ok(parsed::<VerbOptions<A>>(&words)?.args)
}

/// What `inkling score --design FILE --json` tells of a design, under its key `promise`.
pub fn promise(design: &Design) -> Result<String, Failure> {
    Ok(serde_json::to_string(&score::promise_of(design)?).map_err(std::io::Error::from)?)
}

/// How `inkling replay OPTIONS` judges by a design. `digest`: the digest of the design's file.
pub fn judging(design: Design, digest: String, options: &[String]) -> Result<Replay, Failure> {
    replay::judging(options_of(options)?, (design, digest))
}

/// The verdicts of bursts in memory.
pub struct Judged {
    pub rows: VerdictArrays,
    /// The state after these bursts, if there was one before.
    pub state: Option<Memory>,
    /// Sentences about what makes the verdicts less certain or fewer.
    pub warnings: Vec<String>,
}

/// Judges bursts in memory as `replay` says ([`judging`]); the rows are those that `inkling replay`
/// writes.
pub fn judge(replay: &Replay, recording: &Recording, control: &Control) -> Result<Judged, Failure> {
    let mut report = pipeline::judge(replay, recording, control)?;
    let mut warnings = notes::not_judged(&report);
    let counted = notes::warnings(&report).into_iter().chain(notes::always(&report));
    let counted = counted.chain(notes::damage(&report));
    warnings.extend(counted.map(|message| message.what));
    let rows = report.arrays.take().ok_or_else(|| Failure::new("no rows; this is our bug"))?;
    Ok(Judged { rows, state: report.baselines, warnings })
}

pub fn critique(recording: Recording, options: &[String]) -> Result<Ended, Failure> {
    ended(critique::run_on(&options_of(options)?, RecordingSource::InMemory(Box::new(recording))))
}

/// Reads what `--baseline FILE` reads: the state of printheads and channels for a design, or a new state if
/// there is no file.
pub fn read_state(path: &Path, design: &str) -> Result<Memory, Failure> {
    let (file, state) = BaselineFile::read(path, Some(design))?;
    file.of_this_design()?;
    Ok(state)
}

/// Writes the state as `--baseline FILE` does. A file of another design, or of anything else, is not
/// overwritten.
pub fn write_state(path: &Path, state: &Memory) -> Result<(), Failure> {
    outputs::check_file(path, ResultFile::Baselines)?;
    let (file, _) = BaselineFile::read(path, state.design.as_deref())?;
    Ok(file.of_this_design()?.write(state)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn negative_numbers_are_values_as_on_the_command_line() {
        let options = ["--pace".to_owned(), "-5".to_owned()];
        let refused = options_of::<replay::Args>(&options).unwrap_err().message;
        assert!(refused.contains("invalid value '-5' for '--pace"), "{refused}");
    }
}
