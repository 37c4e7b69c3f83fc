//! `inkling inspect`: what recordings hold, whether they are whole, and how messages of other loggers can be
//! read.
//!
//! In: recordings, each of which is read once from begin to end. Out: for each its bursts by
//! printhead (`contents`), its topics and proposed dialects (`topics`), doubts about the layout
//! (`ring_look`), and damage; as text or JSON. `--write` puts the proposed dialects into a settings
//! file. Nothing is judged.

use super::collected::checked_dialects;
use super::contents::Contents;
use super::exit::{Exit, Failure};
use super::progress::{Progress, interruptible, thousands};
use super::report::printable;
use super::{output, topics};
use crate::pipeline::Control;
use crate::pipeline::ring_look::{self, Known};
use crate::pipeline::visit::Pass;
use crate::settings::Settings;
use inkling_io::damage::note;
use inkling_io::dialect::guess::Proposal;
use inkling_io::file_error::FileError;
use inkling_io::recording::Recording;
use inkling_io::{Limits, inputs, part_file};
use std::collections::HashSet;
use std::io::Write;
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  inkling inspect night.mcap
  inkling inspect archive/ --json
  inkling inspect foreign.mcap
      lists its topics; of what looks like bursts its fields, and a block
      [[input.dialect]] for a settings file
  inkling inspect foreign.mcap --write settings.toml
      the same, and writes the block
  inkling inspect foreign.mcap --config settings.toml
      the same as its dialects read it")]
pub struct Args {
    /// Files, directories (searched for *.mcap) or glob patterns
    #[arg(required = true)]
    recordings: Vec<String>,
    /// Settings file whose input.dialect reads messages of others
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Write the blocks [[input.dialect]] that it proposes into a new settings file
    #[arg(long, value_name = "FILE", conflicts_with = "config")]
    write: Option<PathBuf>,
    /// One JSON document a recording
    #[arg(long)]
    json: bool,
}

/// Runs the verb. The exit status is 3 if a recording is not whole, or one of several cannot be
/// read.
pub fn run(args: Args) -> Result<Exit, Failure> {
    let settings = Settings::load(args.config.as_deref(), None, &[])?;
    let mut found = inputs::find_each_recording(&args.recordings)?;
    let unread = std::mem::take(&mut found.unread);
    let inputs = inputs::all_there(found)?;
    let dialects = checked_dialects(&settings, &inputs, |_| false)?;
    if let Some(file) = args.config.filter(|_| dialects.is_empty()) {
        let what = "there is no [[input.dialect]] in it, and nothing else of it has an effect here";
        return Err(Failure::usage(format!("--config {}: {what}", file.display())));
    }
    if let Some(file) = args.write.as_ref().filter(|file| file.exists()) {
        let what = "is there already; name a file that is not";
        return Err(Failure::usage(format!("--write {}: {what}", file.display())));
    }

    // each recording; one that cannot be read fails alone, unless it is the only one
    // recordings of one logger lead to the same proposal, which is kept once
    let (mut proposals, mut proposed_before) = (Vec::new(), HashSet::new());
    let control = interruptible();
    let progress = Progress::through(&inputs);
    let mut exit = Exit::Done;
    for (path, why) in &unread {
        progress.fail(&format!("inkling: {}: {why}", printable(&path.to_string_lossy())));
    }
    for input in &inputs {
        let looked = Recording::open_with(&input.path, Limits::default(), &dialects)
            .map_err(Failure::from)
            .and_then(|recording| one(&recording, &input.path, &control, &progress, args.json));
        match looked {
            Ok((ended, proposed)) => {
                if ended != Exit::Done {
                    exit = Exit::Incomplete;
                }
                let is_new = |proposal: &Proposal| proposed_before.insert(proposal.toml.clone());
                proposals.extend(proposed.into_iter().filter(is_new));
            }
            Err(failure) if inputs.len() == 1 || control.interrupted() => return Err(failure),
            Err(failure) => {
                progress.fail(&format!("inkling: {}", failure.message));
                exit = Exit::Incomplete;
            }
        }
    }
    if let Some(file) = &args.write {
        write(file, &proposals, &progress)?;
    }
    Ok(exit)
}

/// Writes the proposed dialects as a settings file.
fn write(file: &Path, proposals: &[Proposal], progress: &Progress) -> Result<(), Failure> {
    let shown = file.display();
    if proposals.is_empty() {
        let why = "no message that is not read already looks like a burst";
        return Err(Failure::new(format!("--write {shown}: nothing is proposed: {why}")));
    }
    let blocks: Vec<&str> = proposals.iter().map(|proposal| proposal.toml.as_str()).collect();
    part_file::write(file, blocks.join("\n").as_bytes()).map_err(FileError::unwritten(file))?;
    let open: Vec<&str> = proposals.iter().flat_map(|p| &p.open).map(String::as_str).collect();
    progress.say(&match open.is_empty() {
        true => format!("{shown}: written; inkling replay ... --config {shown} reads by it"),
        false => format!("{shown}: written; fill in {} before it is used", open.join(", ")),
    });
    Ok(())
}

/// Inspects one recording, and prints what it holds. Returns `Done` if the recording is whole, else
/// `Incomplete`, and the dialects that are proposed for it. `path`: its name where it has none
/// itself.
fn one(
    recording: &Recording,
    path: &Path,
    control: &Control,
    progress: &Progress,
    as_json: bool,
) -> Result<(Exit, Vec<Proposal>), Failure> {
    // one pass counts bursts, and beside them the messages of every topic (`counting`)
    let mut contents = Contents::new(recording);
    let mut reader = recording.reader().counting();
    let damage = progress.during(&recording.name, recording.bytes, control, || {
        Pass { recording, control }
            .acquisitions(&mut reader, |acquisition| contents.see(acquisition))
    });
    let damage = damage.map_err(|_| Failure::new("interrupted"))?;
    damage.into_iter().for_each(|damage| note(&mut contents.damage, damage));
    let topics = topics::of(reader.topics(), &contents.printheads());

    // further damage is told by hashing the file, and by its statistics
    let digest = recording.digest().map_err(Failure::new)?;
    contents.damage.extend(digest.damage);
    contents.damage.extend(recording.missing(contents.bursts));
    // messages of another encoding are no damage
    contents.set_aside(topics.of_other_encoding());
    let whole = contents.damage.is_empty() && contents.unusable.is_empty();
    let exit = if whole { Exit::Done } else { Exit::Incomplete };

    let doubts = doubts(recording);
    if as_json {
        let mut document = contents.document(recording, &digest.text, exit);
        topics.describe(&mut document);
        document["doubts"] = doubts.into();
        output::event(&document)?;
        return Ok((exit, topics.proposals));
    }
    let mut out = std::io::stdout().lock();
    let name = Some(&recording.name).filter(|name| !name.is_empty());
    let name = printable(name.map_or(&*path.to_string_lossy(), String::as_str));
    let bytes = thousands(recording.bytes);
    writeln!(out, "{name}: {bytes} bytes, {}", digest.text)?;
    contents.print(recording, &mut out)?;
    topics.print(&mut out)?;
    for doubt in &doubts {
        writeln!(out, "  doubt    {}", printable(doubt))?;
    }
    for damage in &contents.damage {
        writeln!(out, "  damage   {damage}")?;
    }
    writeln!(out, "  {}", if whole { "whole" } else { "NOT whole" })?;
    Ok((exit, topics.proposals))
}

/// Sentences on why the signals may be no ring-downs as they are laid out.
fn doubts(recording: &Recording) -> Vec<String> {
    let doubts = ring_look::doubts(recording, Known::Nothing).into_iter();
    doubts.map(|doubt| format!("{}: {}", doubt.printhead, doubt.what)).collect()
}
