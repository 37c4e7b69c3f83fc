//! `inkling inspect`: what is in recordings, whether they are whole, and how to read what is not ours.

use super::contents::{Contents, MOST_ROWS};
use super::dialects;
use super::exit::{Exit, Failure};
use super::output;
use super::progress::{Progress, interruptible, thousands};
use super::report::printable;
use super::topics::{self, Topics};
use crate::io::damage::note;
use crate::io::recording::Recording;
use crate::io::{Limits, inputs};
use crate::pipeline::Control;
use crate::settings::Settings;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  inkling inspect night.mcap
  inkling inspect archive/ --json
  inkling inspect foreign.mcap
      lists its topics; of what looks like bursts a block [[input.dialect]] for
      a settings file
  inkling inspect foreign.mcap --config settings.toml
      the same as its dialects read it")]
pub struct Args {
    /// Files, directories (searched for *.mcap) or glob patterns
    #[arg(required = true)]
    recordings: Vec<String>,
    /// Settings file whose input.dialect reads messages of others
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// One JSON document a recording
    #[arg(long)]
    json: bool,
}

pub fn run(args: Args) -> Result<Exit, Failure> {
    let settings = Settings::load(args.config.as_deref(), None, &[])?;
    let inputs = inputs::find_recordings(&args.recordings).map_err(Failure::new)?;
    let dialects = dialects::checked(&settings, &inputs)?;
    if let Some(file) = args.config.filter(|_| dialects.is_empty()) {
        return Err(Failure::usage(format!(
            "--config {}: there is no [[input.dialect]] in it, and nothing else of it has an effect here",
            file.display()
        )));
    }
    let control = interruptible();
    let progress = Progress::new(inputs.len(), 0);
    let mut exit = Exit::Done;
    for input in &inputs {
        let looked = Recording::open_with(&input.path, Limits::default(), &dialects)
            .map_err(Failure::from)
            .and_then(|recording| one(&recording, &input.path, &control, &progress, args.json));
        match looked {
            Ok(Exit::Done) => {}
            Ok(_) => exit = Exit::Incomplete,
            Err(failure) if inputs.len() == 1 || control.interrupted() => return Err(failure),
            Err(failure) => {
                progress.fail(&format!("inkling: {}", failure.message));
                exit = Exit::Incomplete;
            }
        }
    }
    Ok(exit)
}

fn one(
    recording: &Recording,
    path: &Path,
    control: &Control,
    progress: &Progress,
    as_json: bool,
) -> Result<Exit, Failure> {
    let mut contents = Contents::default();
    contents.damage.clone_from(&recording.damage);
    let topics = progress.during(&recording.name, recording.bytes, control, || {
        look(recording, control, &mut contents)
    });
    if control.interrupted() {
        return Err(Failure::new("interrupted"));
    }
    let digest = recording.digest().map_err(Failure::new)?;
    contents.damage.extend(digest.damage);
    contents.damage.extend(recording.missing(contents.bursts));
    // what is of another encoding lies there whole
    contents.set_aside(topics.of_other_encoding());
    let whole = contents.damage.is_empty() && contents.unusable.is_empty();
    let exit = if whole { Exit::Done } else { Exit::Incomplete };
    if as_json {
        let mut document = contents.document(recording, &digest.text, exit);
        topics.describe(&mut document);
        output::event(&document)?;
        return Ok(exit);
    }
    let mut out = std::io::stdout().lock();
    let name =
        if recording.name.is_empty() { path.to_string_lossy() } else { (&*recording.name).into() };
    let (name, bytes) = (printable(&name), thousands(recording.bytes));
    writeln!(out, "{name}: {bytes} bytes, {}", digest.text)?;
    contents.print(recording, &mut out)?;
    topics.print(&mut out)?;
    for d in &contents.damage {
        writeln!(out, "  damage   bytes {} to {}: {}", d.from_byte, d.to_byte, d.what)?;
    }
    writeln!(out, "  {}", if whole { "whole" } else { "NOT whole" })?;
    Ok(exit)
}

fn look(recording: &Recording, control: &Control, contents: &mut Contents) -> Topics {
    let mut reader = recording.reader().counting();
    for block in recording.blocks() {
        if control.interrupted() {
            break;
        }
        let block = match block {
            Ok(block) => block,
            Err(damage) => {
                note(&mut contents.damage, damage);
                continue;
            }
        };
        reader.load(&block);
        while let Some(piece) = reader.next_piece(MOST_ROWS) {
            if control.interrupted() {
                break;
            }
            contents.see(piece);
        }
        control.bytes_read.store(block.offset + block.bytes, Ordering::Relaxed);
    }
    topics::of(reader.census())
}
