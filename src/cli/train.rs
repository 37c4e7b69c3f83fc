//! `inkling train`: labelled recordings to a design.

use super::collected::{Collected, collected};
use super::effect::{self, Command};
use super::exit::{Exit, Failure};
use super::progress::thousands;
use super::replay::PresetArg;
use super::report::printable;
use crate::design::Design;
use crate::detect::DetectMethod;
use crate::fault::{CLASSES, HEALTHY};
use crate::io::{design_file, labels_file};
use crate::labels::{Label, Labels};
use crate::settings::{Preset, Settings};
use std::collections::BTreeSet;
use std::io::Write;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  inkling train library.mcap --labels labels.csv -o design.json
  inkling train logs/ --labels labels.csv -o design.json \\
      --set detect.false_alarm_rate=1e-3

Labels: CSV with printhead,channel,from,to,state,severity; state is `healthy` or a fault class, \
your own class names are welcome.")]
pub struct Args {
    /// Files, directories (searched for *.mcap) or glob patterns
    #[arg(required = true)]
    recordings: Vec<String>,
    /// What is true of the channels
    #[arg(long, value_name = "CSV")]
    labels: PathBuf,
    /// Where the design goes
    #[arg(short, long, value_name = "DESIGN")]
    out: PathBuf,
    /// Settings file
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Any setting of pipeline.toml, repeatable
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Choices that belong together; --set wins over them
    #[arg(long, value_enum)]
    preset: Option<PresetArg>,
}

pub fn run(args: Args) -> Result<Exit, Failure> {
    let preset = args.preset.map(|PresetArg::Thesis| Preset::Thesis);
    let settings = Settings::load(args.config.as_deref(), preset, &args.set)?;
    effect::check(&args.set, &settings, Command::Train)?;
    let labels = labels_file::read(&args.labels).map_err(Failure::new)?;
    let named = |row: &Label| Label {
        state: settings.isolate.name_of(&row.state).to_owned(),
        ..row.clone()
    };
    let labels = Labels::new(labels.rows().iter().map(named).collect());
    let Collected { set, incomplete, progress } =
        collected(&args.recordings, &settings, Some(&labels))?;
    if !settings.isolate.classes.is_empty() {
        undeclared(&labels, &settings).iter().for_each(|label| {
            progress.say(&format!(
                "warning: label \"{}\" is none of the thesis's classes and not declared in \
                 isolate.classes: it becomes a class of its own, without sizes",
                printable(label)
            ))
        });
    }
    if set.healthy.is_empty() {
        let seen: Vec<String> =
            set.signals.iter().map(|(l, n)| format!("{n} {}", printable(l))).collect();
        return Err(Failure::new(format!(
            "no signal is labelled `healthy` (found: {}); do printhead names and times of {} agree \
             with the recordings? `inkling inspect` shows them",
            seen.join(", "),
            args.labels.display()
        )));
    }
    let (design, warnings) =
        Design::train(&set, &settings.identify.grey_box, &settings.detect, &settings.isolate)
            .map_err(Failure::new)?;
    warnings.iter().for_each(|w| progress.say(&format!("warning: {w}")));
    design_file::write(&args.out, &design).map_err(Failure::new)?;
    tell(&args, &design)?;
    Ok(if incomplete { Exit::Incomplete } else { Exit::Done })
}

fn tell(args: &Args, design: &Design) -> std::io::Result<()> {
    let mut out = super::output::report();
    writeln!(
        out,
        "{}: {} models, {} classes",
        args.out.display(),
        design.models.len() + 1,
        design.classes.len()
    )?;
    for (label, n) in &design.signals {
        writeln!(out, "  {:>10} {}", thousands(*n), printable(label))?;
    }
    let poles = design.pooled.identification.poles;
    writeln!(
        out,
        "  pooled model: resonance {:.3} kHz, damping {:.4e} 1/s, real pole {:.3e} 1/s",
        poles.frequency_hz / 1e3,
        poles.damping_per_s,
        poles.lambda_per_s
    )?;
    let t = &design.pooled.threshold;
    let unit = match design.detect.method {
        DetectMethod::Sensitivity => "squared distance",
        DetectMethod::ResidualEnergy => "counts²·s",
        DetectMethod::ResidualMaximum => "counts",
        DetectMethod::Practice => "half-widths of the healthy range",
    };
    writeln!(out, "  threshold {:.4e} {unit} ({})", t.value, t.in_words())
}

/// Labels that name no class that anyone has declared.
fn undeclared<'a>(labels: &'a Labels, settings: &Settings) -> BTreeSet<&'a str> {
    let is_known = |state: &str| {
        [HEALTHY].iter().chain(&CLASSES).any(|known| *known == state)
            || settings.isolate.classes.contains_key(state)
    };
    labels.rows().iter().map(|row| row.state.as_str()).filter(|state| !is_known(state)).collect()
}
