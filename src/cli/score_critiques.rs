//! `inkling score CRITIQUE... --truth TRUTH...`: compares critiques with what was hidden in their
//! recordings.
//!
//! In: files `critique.json`, and for each the truth that `inkling simulate --hide` sealed. Out: how
//! right each critique is (`inkling_lab::score::blind`) and how many are, as text or JSON.

use super::exit::{Exit, Failure};
use super::progress::complain;
use inkling_io::file_error::FileError;
use inkling_io::truth_file::{self, Seal};
use inkling_io::{printable, regular_file};
use inkling_lab::score::blind::{self, CritiqueAnswer, Outcome};
use inkling_lab::score::truth::Truth;
use serde_json::json;
use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Scores critiques against truths, pair by pair: the n-th critique against the n-th truth. Prints
/// a line per pair and how often each outcome is met, or JSON.
pub fn run(critiques: &[String], truths: &[PathBuf], json: bool) -> Result<Exit, Failure> {
    let (n, of) = (critiques.len(), truths.len());
    if n != of {
        return Err(Failure::usage(format!(
            "{n} critiques and {of} truths: give one truth per critique, in the same order"
        )));
    }
    let (mut lines, mut documents) = (Vec::new(), Vec::new());
    let mut counts = BTreeMap::<Outcome, u32>::new();
    for (path, truth_path) in critiques.iter().zip(truths) {
        let (answer, truth) = (read_critique(path)?, read_truth(truth_path)?);
        let outcome = blind::outcome(&answer, &truth);
        *counts.entry(outcome).or_default() += 1;
        let names = |ids: Vec<&str>| match ids.is_empty() {
            true => "nothing".to_owned(),
            false => ids.join(" + "),
        };
        let hidden = names(truth.effects.iter().map(|e| e.id.as_str()).collect());
        let causes = names(answer.causes.iter().map(|c| c.id.as_str()).collect());
        let (word, verdict) = (outcome.word(), answer.verdict.as_str());
        lines.push(format!("{path}: {word} (hidden: {hidden}; said: {verdict}, {causes})"));
        documents.push(json!({"critique": path, "outcome": outcome, "hidden": truth.effects}));
    }
    let mut out = std::io::stdout().lock();
    if json {
        writeln!(out, "{:#}", json!(documents))?;
    } else {
        lines.iter().try_for_each(|line| writeln!(out, "{}", printable::line(line, 4000)))?;
        let counts = counts.iter().map(|(outcome, n)| format!("{n} {}", outcome.word()));
        writeln!(out, "{}", counts.collect::<Vec<_>>().join(", "))?;
    }
    Ok(Exit::Done)
}

/// Reads what a critique says.
fn read_critique(path: &str) -> Result<CritiqueAnswer, Failure> {
    let wrong = |what: String| Failure::new(format!("{path}: {what}"));
    let none = |what: String| wrong(format!("is no critique.json: {what}"));
    let bytes = regular_file::read(Path::new(path), regular_file::MOST_CRITIQUE_BYTES)
        .map_err(|e| Failure::new(FileError::unread(Path::new(path))(e)))?;
    let answer: CritiqueAnswer =
        serde_json::from_slice(&bytes).map_err(|e| none(printable::of_parser(&e)))?;
    answer.check().map_err(none)?;
    Ok(answer)
}

/// Reads a truth. One that was changed after it was sealed is refused.
fn read_truth(path: &Path) -> Result<Truth, Failure> {
    let name = path.display();
    let none = |what: String| Failure::new(format!("{name}: is no truth: {what}"));
    let (truth, seal) = truth_file::read(path).map_err(Failure::new)?;
    let truth: Truth = serde_json::from_value(truth).map_err(|e| none(printable::of_parser(&e)))?;
    if seal == Seal::Missing {
        complain(&format!(
            "warning: {name}: not sealed: no truth.sha256 beside its directory, so nobody can tell \
             whether it was changed"
        ));
    }
    Ok(truth)
}
