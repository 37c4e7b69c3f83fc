//! `inkling identify`: grey-box identification by thesis (3-1) alone, and which parameters are identifiable.

use super::collected::{Collected, RecordingSource, collected};
use super::effect::{self, Command};
use super::exit::{Exit, Failure};
use super::identified::Identified;
use super::report::printable;
use super::report_page::write_text;
use crate::settings::Settings;
use inkling_core::design::Detectability;
use inkling_core::identify::IdentifyError;
use inkling_core::identify::averaging::{self, MeanSignal, SignalSet};
use inkling_core::identify::grey_box::{self, Identification};
use inkling_core::identify::temperature::by_temperature;
use inkling_io::{labels_file, outputs};
use serde_json::{Value, json};
use std::borrow::Cow;
use std::io::Write;
use std::path::PathBuf;

/// A worse fit than this, in percent, leads to a warning: averages of faulty signals, or of a mixture, are
/// fitted worse, and healthy ones far better.
const LEAST_FIT_PERCENT: f64 = 90.0;

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  inkling identify healthy.mcap -o model.json
  inkling identify night.mcap --labels labels.csv -o model.json
  inkling identify healthy.mcap -o model.json --plot figures/
  inkling identify healthy.mcap -o model.json --detectability
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
    /// Directory for a plot of measured against simulated per printhead (SVG, PNG, CSV)
    #[arg(long, value_name = "DIR")]
    plot: Option<PathBuf>,
    /// Also which faults a filter of method I can see, and where it is blind
    #[arg(long)]
    detectability: bool,
    /// Settings file
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Any setting of pipeline.toml, repeatable
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
}

pub fn run(args: Args) -> Result<Exit, Failure> {
    let settings = Settings::load(args.config.as_deref(), None, &args.set)?;
    effect::check(&args.set, &settings, Command::Identify { detects: args.detectability })?;
    outputs::check_file(&args.out, outputs::ResultFile::Models)?;
    let labels = args.labels.as_deref().map(labels_file::read).transpose()?;
    if let Some(dir) = &args.plot {
        if *dir == args.out {
            return Err(Failure::usage(format!("--plot {}: --out has that name", dir.display())));
        }
        outputs::check_beside(dir, "identify_", args.out.is_file())?;
    }
    // a printhead that cannot be identified is left out with a warning; if none can be, that is the failure
    let Collected { set, met, mut incomplete, progress } =
        collected(RecordingSource::Named(&args.recordings), &settings, labels.as_ref())?;
    if let Some((path, labels)) = args.labels.as_deref().zip(labels.as_ref()) {
        labels_file::check(path, labels, &met)?;
    }
    let mut said = Vec::new();
    let mut models: Vec<Value> = Vec::new();
    for (name, signals) in &set.healthy {
        let dt_s = set.sample_period_s;
        let (healthy, mean, fit) = match fit(signals, labels.is_some(), dt_s, &settings) {
            Ok(fitted) => fitted,
            Err(e) => {
                incomplete = true;
                // the usual advice speaks of windows, which there are none of here
                let why = match (&e, labels.is_some()) {
                    (IdentifyError::TooFewSignals { .. }, false) => {
                        format!(
                            "{e}: give more recordings, or look at input.rails if they are saturated"
                        )
                    }
                    (e, labelled) => e.advice(labelled),
                };
                progress.say(&format!("warning: printhead {}: {why}", printable(name)));
                continue;
            }
        };
        // a poor fit, or a rate at its bound, casts doubt on the signals or on the settings
        if fit.fit_percent < LEAST_FIT_PERCENT || !fit.at_bounds.is_empty() {
            progress.say(&format!(
                "warning: printhead {}: the model fits {:.1} % of the average{}; are these signals \
                 healthy, and is identify.grey_box of this printhead?",
                printable(name),
                fit.fit_percent,
                if fit.at_bounds.is_empty() { "" } else { ", with a rate at its bound" }
            ));
        }
        let warmed = by_temperature(&healthy, &fit, dt_s, &settings.identify.grey_box);
        // if the signals of some temperature cannot be fitted by themselves, nothing is told by temperature
        let identified = Identified::new(name, &set, &settings, &mean, &fit, warmed.ok().flatten());
        let (grey_box, detect) = (&settings.identify.grey_box, &settings.detect);
        let seen =
            args.detectability.then(|| Detectability::of(&fit, &healthy, dt_s, grey_box, detect));
        let seen = seen.transpose().map_err(Failure::new)?;
        identified.print(signals.len(), seen.as_ref(), &mut said)?;
        if let Some(dir) = &args.plot {
            identified.plot(dir)?;
        }
        models.push(identified.json(signals.len(), seen.as_ref()));
    }
    if models.is_empty() {
        return Err(Failure::new("no printhead could be identified"));
    }
    let text = serde_json::to_string_pretty(&json!({ "models": models })).map_err(Failure::new)?;
    write_text(&args.out, &(text + "\n"))?;
    super::output::report().write_all(&said)?;
    Ok(if incomplete { Exit::Incomplete } else { Exit::Done })
}

/// The healthy signals, their average, and the fit to it. Without labels the signals that agree with the
/// majority are taken for healthy, unless the settings ask for a plain mean.
fn fit<'a>(
    signals: &'a SignalSet,
    labelled: bool,
    dt_s: f64,
    settings: &Settings,
) -> Result<(Cow<'a, SignalSet>, MeanSignal, Identification), IdentifyError> {
    let healthy = if labelled || settings.identify.grey_box.plain_mean {
        Cow::Borrowed(signals)
    } else {
        let keep = averaging::agreeing(signals, settings.identify.least_agreeing)?;
        Cow::Owned(signals.select(&keep))
    };
    let mean = averaging::average(&healthy)?;
    let fit =
        grey_box::identify_scattered(&healthy, &mean, dt_s, &settings.identify.grey_box, None)?;
    Ok((healthy, mean, fit))
}
