//! `inkling identify`: thesis (3-1) alone, with what is and is not identifiable.

use super::dialects;
use super::effect::{self, Command};
use super::exit::{Exit, Failure};
use super::progress::{Progress, interruptible};
use super::report::printable;
use crate::design::{ClassSeen, Detectable};
use crate::identify::IdentifyError;
use crate::identify::averaging::{self, MeanSignal, SignalSet};
use crate::identify::grey_box::{self, Identification};
use crate::identify::whiteness::{self, Whiteness};
use crate::io::recording::Recording;
use crate::io::{Limits, inputs, labels_file, outputs, part_file};
use crate::model::Geometry;
use crate::pipeline::collect::Collector;
use crate::plot::{Axis, Figure, Mark, Series};
use crate::settings::Settings;
use serde::Serialize;
use serde_json::{Value, json};
use std::io::Write;
use std::path::{Path, PathBuf};

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
    let labels = args.labels.as_deref().map(labels_file::read).transpose().map_err(Failure::new)?;
    if let Some(dir) = &args.plot {
        outputs::check_directory(dir).map_err(Failure::usage)?;
    }
    let inputs = inputs::find_recordings(&args.recordings).map_err(Failure::new)?;
    let dialects = dialects::checked(&settings, &inputs)?;
    let control = interruptible();
    let progress = Progress::new(inputs.len(), 0);
    let mut collector = Collector::new(labels.as_ref(), settings.input.rails);
    let mut incomplete = false;
    for input in &inputs {
        let recording = Recording::open_with(&input.path, Limits::default(), &dialects)?;
        let damage = progress.during(&recording.name, recording.bytes, &control, || {
            collector.take(&recording, &control)
        })?;
        incomplete |= !damage.is_empty();
        progress.say_damage(&recording.name, &damage);
    }
    let set = collector.finish().ok_or_else(|| Failure::new(dialects::NO_BURSTS))?;
    incomplete |= ["rejected", "other_sampling"].iter().any(|k| set.signals.contains_key(*k));

    let mut said = Vec::new();
    let mut models: Vec<Value> = Vec::new();
    for (name, signals) in &set.healthy {
        match fit(signals, labels.is_some(), set.sample_period_s, &settings) {
            Ok((mean, fit)) => {
                let used = mean.n_signals;
                if fit.fit_percent < LEAST_FIT_PERCENT || !fit.at_bounds.is_empty() {
                    progress.say(&format!(
                        "warning: printhead {}: the model fits {:.1} % of the average{}; are these signals \
                         healthy, and is identify.grey_box of this printhead?",
                        printable(name),
                        fit.fit_percent,
                        if fit.at_bounds.is_empty() { "" } else { ", with a rate at its bound" }
                    ));
                }
                let simulated = fit.expected(set.sample_period_s, set.samples);
                let misfit: Vec<f64> = mean.y.iter().zip(&simulated).map(|(y, s)| y - s).collect();
                let white = whiteness::whiteness(&misfit, FITTED);
                let physical = settings.identify.geometry.map(|g| Physical::of(&fit, &g));
                print(&printable(name), (used, signals.len()), &fit, white, &mut said)?;
                if let Some(physical) = &physical {
                    physical.print(&mut said)?;
                }
                let seen = args.detectability.then(|| {
                    Detectable::of(&fit, set.samples, set.sample_period_s, &settings.detect)
                });
                let seen = seen.transpose().map_err(Failure::new)?;
                if let Some(seen) = &seen {
                    print_detectable(seen, &mut said)?;
                }
                if let Some(dir) = &args.plot {
                    plot(dir, name, (&mean.y, &simulated), set.sample_period_s, &fit)?;
                }
                let mut model = json!({
                    "printhead": name, "signals": used, "of": signals.len(),
                    "sample_period_s": set.sample_period_s, "samples": set.samples,
                    "drive_voltage_v": set.drive_voltage_v, "identification": fit,
                    "whiteness": white, "physical": physical,
                });
                if let Some(seen) = seen {
                    model["detectability"] = json!(seen);
                }
                models.push(model);
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
    super::output::report().write_all(&said)?;
    Ok(if incomplete { Exit::Incomplete } else { Exit::Done })
}

/// The average, and the fit of it.
fn fit(
    signals: &SignalSet,
    labelled: bool,
    dt_s: f64,
    settings: &Settings,
) -> Result<(MeanSignal, Identification), IdentifyError> {
    let chosen;
    let healthy = if labelled || settings.identify.grey_box.plain_mean {
        signals
    } else {
        let keep = averaging::agreeing(signals, settings.identify.least_agreeing)?;
        chosen = signals.select(&keep);
        &chosen
    };
    let mean = averaging::average(healthy)?;
    let fit =
        grey_box::identify_scattered(healthy, &mean, dt_s, &settings.identify.grey_box, None)?;
    Ok((mean, fit))
}

fn print(
    name: &str,
    (used, of): (usize, usize),
    fit: &Identification,
    white: Option<Whiteness>,
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
    if let Some(white) = white {
        let word =
            if white.p_value < 0.01 { "not white: the model misses something" } else { "white" };
        writeln!(
            out,
            "  misfit {word} (Ljung-Box {:.1} over {} lags, p = {:.2e})",
            white.ljung_box, white.lags, white.p_value
        )?;
    }
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

fn print_detectable(seen: &Detectable, out: &mut impl Write) -> std::io::Result<()> {
    let classes = |keep: fn(&ClassSeen) -> bool| {
        let kept: Vec<&str> = seen.classes.iter().filter(|c| keep(c)).map(|c| c.class).collect();
        if kept.is_empty() { "none".to_owned() } else { kept.join(" ") }
    };
    writeln!(
        out,
        "  filters of degree {} that a healthy signal does not excite: {}",
        seen.degree, seen.nullity
    )?;
    writeln!(out, "  detectable: {}", classes(|c| c.detectable))?;
    writeln!(
        out,
        "  strongly (a fault that pushes for good stays visible): {}",
        classes(|c| c.strongly)
    )?;
    for d in &seen.disturbances {
        let left = if d.still_seen.is_empty() { "none".into() } else { d.still_seen.join(" ") };
        writeln!(out, "  without {}: {} filters, detectable {left}", d.what, d.nullity)?;
    }
    if seen.blind_hz.is_empty() {
        writeln!(out, "  blind at no frequency")?;
    }
    for [from, to] in &seen.blind_hz {
        match to > from {
            true => writeln!(out, "  blind from {from:.0} to {to:.0} Hz")?,
            false => writeln!(out, "  blind at {from:.0} Hz")?,
        }
    }
    Ok(())
}

/// Averages of faulty signals, or of a mixture, are fitted worse than this; healthy ones far better.
const LEAST_FIT_PERCENT: f64 = 90.0;

/// Numbers that (3-1) fits to an average.
const FITTED: usize = 6;

/// Individual parameters of thesis (2-3)..(2-5): one decay gives ratios only, so they rest on the
/// restrictor's inertance and on A_n/A_r as the geometry has them.
#[derive(Debug, Serialize)]
struct Physical {
    restrictor_inertance_kg_per_m4: f64,
    nozzle_inertance_kg_per_m4: f64,
    restrictor_resistance_pa_s_per_m3: f64,
    nozzle_resistance_pa_s_per_m3: f64,
    compliance_m3_per_pa: f64,
    /// By the geometry alone, for comparison.
    compliance_by_geometry_m3_per_pa: f64,
    rests_on: &'static str,
}

impl Physical {
    fn of(fit: &Identification, geometry: &Geometry) -> Physical {
        let rates = fit.channel;
        let prior = geometry.ink_channel();
        let by_geometry = geometry.compliance_m3_per_pa();
        let i_r = 1.0 / (prior.a_per_s2 * by_geometry);
        let b_t = 1.0 / (rates.a_per_s2 * i_r);
        let i_n = 1.0 / (rates.b_per_s2 * b_t);
        Physical {
            restrictor_inertance_kg_per_m4: i_r,
            nozzle_inertance_kg_per_m4: i_n,
            restrictor_resistance_pa_s_per_m3: rates.g_per_s * i_r,
            nozzle_resistance_pa_s_per_m3: rates.d_per_s * i_n,
            compliance_m3_per_pa: b_t,
            compliance_by_geometry_m3_per_pa: by_geometry,
            rests_on: "the restrictor's inertance and the ratio A_n/A_r of identify.geometry",
        }
    }

    fn print(&self, out: &mut impl Write) -> std::io::Result<()> {
        let mut line = |what: &str, value: f64, unit: &str| {
            writeln!(out, "  {what:<22} {value:>13.6e} {unit}  prior-dependent")
        };
        line("I_r (as given)", self.restrictor_inertance_kg_per_m4, "kg/m^4")?;
        line("I_n", self.nozzle_inertance_kg_per_m4, "kg/m^4")?;
        line("R_r", self.restrictor_resistance_pa_s_per_m3, "Pa s/m³")?;
        line("R_n", self.nozzle_resistance_pa_s_per_m3, "Pa s/m³")?;
        line("B_t", self.compliance_m3_per_pa, "m³/Pa")?;
        writeln!(out, "  these rest on {}", self.rests_on)
    }
}

/// Fig. 3-3: measured against simulated.
fn plot(
    dir: &Path,
    printhead: &str,
    (measured, simulated): (&[f64], &[f64]),
    dt_s: f64,
    fit: &Identification,
) -> Result<(), Failure> {
    std::fs::create_dir_all(dir).map_err(|e| Failure::new(format!("{}: {e}", dir.display())))?;
    let series = |name: &str, mark, y: &[f64]| Series {
        name: name.into(),
        mark,
        points: y.iter().enumerate().map(|(k, &v)| (k as f64 * dt_s * 1e6, v)).collect(),
    };
    let figure = Figure {
        title: format!(
            "{}: the identified model fits {:.2} % of the average signal",
            printable(printhead),
            fit.fit_percent
        ),
        x: Axis::new("time since acquisition began, µs"),
        y: Axis::new("sensor signal, counts"),
        series: vec![
            series("measured, average", Mark::Points, measured),
            series("simulated", Mark::Line, simulated),
        ],
        thresholds: Vec::new(),
    };
    // a printhead's name is no path
    let safe = |c: char| if c.is_alphanumeric() || c == '-' { c } else { '_' };
    let name: String = printhead.chars().map(safe).take(80).collect();
    figure.write(dir, &format!("identify_{name}")).map_err(Failure::new)
}
