//! `inkling identify`: thesis (3-1) alone, with what is and is not identifiable.

use super::exit::{Exit, Failure};
use super::progress::{Progress, interruptible};
use super::report::printable;
use crate::identify::averaging::{self, SignalSet};
use crate::identify::grey_box::{self, Identification};
use crate::io::recording::Recording;
use crate::io::{Limits, inputs, labels_file, part_file};
use crate::pipeline::collect::Collector;
use crate::settings::Settings;
use serde_json::{Value, json};
use std::io::Write;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  inkling identify healthy.mcap -o model.json
  inkling identify night.mcap --labels labels.csv -o model.json
  inkling identify healthy.mcap -o model.json --set identify.grey_box.a_per_s2=4e10")]
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

pub fn run(args: Args) -> Result<Exit, Failure> {
    let settings = Settings::load(args.config.as_deref(), None, &args.set)?;
    let labels = args.labels.as_deref().map(labels_file::read).transpose().map_err(Failure::new)?;
    let inputs = inputs::find_recordings(&args.recordings).map_err(Failure::new)?;
    let control = interruptible();
    let progress = Progress::new(inputs.len(), 0);
    let mut collector = Collector::new(labels.as_ref(), settings.input.rails);
    let mut incomplete = false;
    for input in &inputs {
        let recording = Recording::open(&input.path, Limits::default()).map_err(Failure::new)?;
        let damage = progress.during(&recording.name, recording.bytes, &control, || {
            collector.take(&recording, &control)
        })?;
        incomplete |= !damage.is_empty();
        progress.say_damage(&recording.name, &damage);
    }
    let set = collector.finish().ok_or_else(|| Failure::new("no inkling.Burst messages found"))?;
    incomplete |= ["rejected", "other_sampling"].iter().any(|k| set.signals.contains_key(*k));

    let mut said = Vec::new();
    let mut models: Vec<Value> = Vec::new();
    for (name, signals) in &set.healthy {
        match fit(signals, labels.is_some(), set.sample_period_s, &settings) {
            Ok((used, fit)) => {
                print(&printable(name), used, signals.len(), &fit, &mut said)?;
                models.push(json!({
                    "printhead": name, "signals": used, "of": signals.len(),
                    "sample_period_s": set.sample_period_s, "samples": set.samples,
                    "drive_voltage_v": set.drive_voltage_v, "identification": fit,
                }));
            }
            Err(e) => {
                incomplete = true;
                progress.say(&format!("warning: printhead {}: {e}", printable(name)));
            }
        }
    }
    if models.is_empty() {
        return Err(Failure::new("no printhead could be identified"));
    }
    let text = serde_json::to_string_pretty(&json!({ "models": models })).map_err(Failure::new)?;
    let failed = |e: std::io::Error| Failure::new(format!("{}: {e}", args.out.display()));
    let (part, mut file) = part_file::PartFile::create(&args.out).map_err(failed)?;
    writeln!(file, "{text}").map_err(failed)?;
    part.finish(&file).map_err(failed)?;
    std::io::stdout().lock().write_all(&said)?;
    Ok(if incomplete { Exit::Incomplete } else { Exit::Done })
}

/// How many signals were averaged, and the fit of their average.
fn fit(
    signals: &SignalSet,
    labelled: bool,
    dt_s: f64,
    settings: &Settings,
) -> Result<(usize, Identification), crate::identify::IdentifyError> {
    let chosen;
    let healthy = if labelled {
        signals
    } else {
        let keep = averaging::agreeing(signals, settings.identify.least_agreeing)?;
        chosen = signals.select(&keep);
        &chosen
    };
    let mean = averaging::average(healthy)?;
    let fit =
        grey_box::identify(&mean.y, dt_s, mean.standard_error(), &settings.identify.grey_box)?;
    Ok((mean.n_signals, fit))
}

fn print(
    name: &str,
    used: usize,
    of: usize,
    fit: &Identification,
    out: &mut impl Write,
) -> std::io::Result<()> {
    let (poles, sd) = (&fit.poles, &fit.uncertainty);
    writeln!(out, "{name}: average of {used} of {of} signals, fit {:.2} %", fit.fit_percent)?;
    let mut line = |what: &str, value: f64, sd: f64, unit: &str| {
        writeln!(out, "  {what:<22} {value:>13.6e} ± {:>9.2e} {unit} (95 %)", 1.96 * sd)
    };
    line("resonance f", poles.frequency_hz, sd.frequency_sd_hz, "Hz")?;
    line("damping sigma", poles.damping_per_s, sd.damping_sd_per_s, "1/s")?;
    line("real pole lambda", poles.lambda_per_s, sd.lambda_sd_per_s, "1/s")?;
    for (k, unit) in ["1/s", "1/s²", "1/s³"].iter().enumerate() {
        line(&format!("p{}", 2 - k), fit.cubic[k], sd.cubic_sd[k], unit)?;
    }
    writeln!(
        out,
        "  ended by {:?} after {} steps, {} of {} starts agree; misfit {:.3} counts rms",
        fit.convergence, fit.iterations, fit.starts_agreeing, fit.starts, fit.misfit_rms
    )?;
    let listed = [
        ("held fixed", &fit.held_fixed),
        ("at its bound", &fit.at_bounds),
        ("not identifiable", &fit.not_identifiable),
    ];
    for (what, items) in listed {
        for item in items {
            writeln!(out, "  {what}: {item}")?;
        }
    }
    Ok(())
}
