//! `inkling identify`: grey-box identification by thesis (3-1) alone, and which parameters are identifiable.
//!
//! In: recordings, labels if there are any, and the settings `identify.grey_box` and
//! `identify.geometry`. Out: the file of models (JSON, one entry per printhead), and text on stdout. What is done for one
//! printhead stands in `identified`; here the signals are collected, and each printhead gets its turn.

use super::collected::{Collected, RecordingSource, collected};
use super::effect::{self, Command};
use super::exit::{Exit, Failure};
use super::identified::Identified;
use super::report::printable;
use super::report_page::write_json;
use crate::settings::Settings;
use inkling_core::identify::IdentifyError;
use inkling_core::identify::grey_box::Identification;
use inkling_io::{labels_file, outputs};
use serde_json::{Value, json};
use std::io::Write;
use std::path::PathBuf;

/// A worse fit than this, in percent, leads to a warning: averages of faulty signals, or of a mixture, are
/// fitted worse, and healthy ones far better.
const LEAST_FIT_PERCENT: f64 = 90.0;

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  inkling identify healthy.mcap -o model.json
  inkling identify night.mcap --labels labels.csv -o model.json
  inkling identify healthy.mcap -o model.json \\
      --set identify.grey_box.a_per_s2=4e10")]
pub struct Args {
    /// Files, directories (searched for *.mcap) or glob patterns
    #[arg(required = true)]
    recordings: Vec<String>,
    /// Where the models go (JSON)
    #[arg(short, long, value_name = "FILE")]
    out: PathBuf,
    /// Only signals that it says are healthy; without it, those that agree with the majority
    #[arg(long, value_name = "CSV")]
    labels: Option<PathBuf>,
    /// Settings file
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Any setting of pipeline.toml, repeatable
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
}

/// Runs the verb. Nothing is written or printed before all printheads had their turn.
pub fn run(args: Args) -> Result<Exit, Failure> {
    // settings, and the places of the results
    let settings = Settings::load(args.config.as_deref(), None, &args.set)?;
    effect::check(&args.set, &settings, Command::Identify)?;
    outputs::check_file(&args.out, outputs::ResultFile::Models)?;
    let labels = args.labels.as_deref().map(labels_file::read).transpose()?;

    // the healthy signals of all recordings, by printhead
    let Collected { set, met, mut incomplete, progress } =
        collected(RecordingSource::Named(&args.recordings), &settings, labels.as_ref())?;
    if let Some((path, labels)) = args.labels.as_deref().zip(labels.as_ref()) {
        labels_file::check(path, labels, &met)?;
    }

    // each printhead in turn; one that cannot be identified is left out with a warning, and if none
    // can be identified, that is the failure
    let mut text = Vec::new();
    let mut models: Vec<Value> = Vec::new();
    for (name, signals) in &set.healthy {
        let warn =
            |what: &str| progress.say(&format!("warning: printhead {}: {what}", printable(name)));
        let labelled = labels.is_some();
        let identified = Identified::of(name, signals, labelled, &set, &settings.identify);
        let identified = match identified {
            Ok(identified) => identified,
            Err(e) => {
                incomplete = true;
                // the usual advice speaks of windows, which there are none of here
                let is_few = matches!(e, IdentifyError::TooFewSignals { .. }) && !labelled;
                let more = "give more recordings, or look at input.rails if they are saturated";
                warn(&if is_few { format!("{e}: {more}") } else { e.advice(labelled) });
                continue;
            }
        };
        let Identification { fit_percent, at_bounds, .. } = &identified.identification;
        // a poor fit, or a rate at its bound, casts doubt on the signals or on the settings
        if *fit_percent < LEAST_FIT_PERCENT || !at_bounds.is_empty() {
            let bound = if at_bounds.is_empty() { "" } else { ", with a rate at its bound" };
            warn(&format!(
                "the model fits {fit_percent:.1} % of the average{bound}; are these signals \
                 healthy, and is identify.grey_box of this printhead?"
            ));
        }
        identified.print(&mut text)?;
        models.push(json!(identified));
    }
    if models.is_empty() {
        return Err(Failure::new("no printhead could be identified"));
    }
    write_json(&args.out, &json!({ "models": models }))?;
    super::output::report().write_all(&text)?;
    Ok(if incomplete { Exit::Incomplete } else { Exit::Done })
}
