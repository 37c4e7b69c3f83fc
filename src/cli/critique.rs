//! `inkling critique`: what the model gets wrong and why, the extended model, and what it gains.
//!
//! In: recordings of healthy signals. Out: the files of `FILES` in the directory of `--out`. The
//! critique itself is made by `inkling_lab::critique`; here the signals are collected, the files
//! written, and the result told.
//!
//! The steps (`run_on`): a bounded sample of the signals is collected (`Observer`); the engine
//! looks for causes and measures what each gains on signals held out; the files of an earlier
//! critique are removed; if causes were found on ink channels, a design is trained that knows them
//! (`extended_design`); all is written, `critique.json` last.

use super::collected::{NO_BURSTS, RecordingSource, Recordings};
use super::effect::{self, Command};
use super::exit::{Exit, Failure};
use super::extended_design;
use super::progress::{Progress, counted, end_of_work};
use super::report_page::{write_json, write_text};
use crate::pipeline::Control;
use crate::pipeline::collect::Observer;
use crate::report::{Column, columns};
use crate::settings::Settings;
use inkling_io::outputs::ResultFile;
use inkling_io::plain_columns::{count, flag, number, text};
use inkling_io::verdict_table::TableError;
use inkling_io::{design_file, labels_file, outputs, plain_columns, printable};
use inkling_lab::critique::engine::{self, MOST_SAMPLES, Rings};
use inkling_lab::critique::finding::{Critique, Evidence, Gain, GainFigures, HeldOut, Verdict};
use inkling_lab::critique::work::{self, Now, Work};
use inkling_lab::critique::{decay, report};
use inkling_lab::plot::digits;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

const EXTENDED_DESIGN: &str = "extended.design.json";
/// The files of a critique. Those of an earlier run are removed first, so that none lies beside those of this
/// one. `critique.json` is the first to go and the last to be written: if it is there, all are.
const FILES: [(&str, ResultFile); 4] = [
    ("critique.json", ResultFile::Critique),
    (EXTENDED_DESIGN, ResultFile::Design),
    ("evidence.parquet", ResultFile::Companion),
    ("report.html", ResultFile::CritiquePage),
];

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  inkling critique healthy.mcap -o critique/
  inkling critique night.mcap --labels labels.csv -o critique/
  inkling critique pendulum.mcap --plant oscillator -o critique/

Writes report.html, critique.json and evidence.parquet; of an ink channel with \
a cause found also extended.design.json, for `inkling replay --design`. All outputs of one \
recording are taken as one system.")]
pub struct Args {
    /// Files, directories (searched for *.mcap) or glob patterns
    #[arg(required = true)]
    recordings: Vec<String>,
    /// Where the critique goes
    #[arg(short, long, value_name = "DIR")]
    out: PathBuf,
    /// Only signals that it says are healthy; without it, outliers are found and left out
    #[arg(long, value_name = "CSV")]
    labels: Option<PathBuf>,
    /// What rings
    #[arg(long, value_enum, default_value_t = PlantArg::InkChannel)]
    plant: PlantArg,
    /// Settings file
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Any setting of pipeline.toml, repeatable
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum PlantArg {
    /// Thesis (2-2)
    InkChannel,
    /// A damped oscillator seen through its displacement
    Oscillator,
}

pub fn run(args: Args) -> Result<Exit, Failure> {
    run_on(&args, RecordingSource::Named(&args.recordings))
}

/// Reads the signals, runs the critique, extends the design if causes were found, and writes
/// everything. The exit status is 3 if some signals could not be used. The recordings that `args`
/// names are not read, but those that are `given`.
pub fn run_on(args: &Args, given: RecordingSource) -> Result<Exit, Failure> {
    // 1. what can be wrong is checked before any recording is read
    outputs::check_files(&args.out, FILES)?;
    let settings = Settings::load(args.config.as_deref(), None, &args.set)?;
    effect::check(&args.set, &settings, Command::Critique)?;
    let labels = args.labels.as_deref().map(labels_file::read).transpose()?;
    let recordings = Recordings::find(given, &settings)?;

    // 2. collect the signals; of an oscillator's decays, which may be long, more samples are taken
    let oscillator = args.plant == PlantArg::Oscillator;
    let most_samples = if oscillator { decay::MOST_SAMPLES } else { MOST_SAMPLES };
    let mut observer = Observer::new(labels.as_ref(), settings.input.rails, most_samples);
    observer.whole_bursts = oscillator;
    let damaged = recordings.each(|pass| observer.take(pass))?;
    let mut data = observer.finish().ok_or_else(|| Failure::new(NO_BURSTS))?;
    let (rejected, other_sampling) = (observer.rejected, observer.other_sampling);
    let left_out = rejected + other_sampling;
    let Recordings { progress, control, .. } = recordings;
    if left_out > 0 {
        progress.say(&format!(
            "warning: left out: {other_sampling} signals of another sample period than the first of them, or far \
             shorter than the others, {rejected} that cannot be used (no numbers, saturated, damaged)"
        ));
    }

    // 3. the critique, which shows its stages and can be ended at any step
    let progress = Arc::new(progress);
    data.work = watched(&control, &progress);
    let rings = if oscillator { Rings::Oscillator } else { Rings::InkChannel };
    let mut outcome = engine::critique(&data, rings, labels.is_some()).map_err(Failure::new)?;
    outcome.critique.signals.rejected = left_out;
    if oscillator && observer.is_cut {
        let cut = format!(
            "some records are longer than {} samples, and what comes later was not looked at: record or resample them more \
             slowly, or cut them",
            data.samples
        );
        progress.say(&format!("warning: {cut}"));
        outcome.critique.remarks.push(cut);
    }

    // 4. now that there is a result, that of an earlier run is removed; then the design is
    // extended, as only ink channels have designs, and only causes extend them
    outputs::remove_earlier(&args.out, &FILES.map(|(name, _)| name)).map_err(Failure::new)?;
    if !oscillator && !outcome.critique.causes.is_empty() {
        data.work.begins(work::DESIGN);
        let samples = data.samples;
        let design = match observer.is_cut {
            true => Err(format!(
                "it would be one of signals of {samples} samples, and some of these are longer"
            )),
            false => extended_design::train(&data, &outcome, &settings),
        };
        match design {
            Ok(design) => {
                let path = args.out.join(EXTENDED_DESIGN);
                design_file::write(&path, &design).map_err(Failure::new)?;
                outcome.critique.extended_model = Some(EXTENDED_DESIGN.into());
            }
            Err(why) => progress.say(&format!("warning: no extended design: {why}")),
        }
    }

    write(&args.out, &outcome.critique)?;
    let mut out = super::output::report();
    print(&args.out, &outcome.critique, &mut out)?;
    Ok(if damaged || left_out > 0 { Exit::Incomplete } else { Exit::Done })
}

/// Tells the stages of the critique's work with the share that is done, and ends the work when it is interrupted:
/// nothing is open then, and what computes has no other end.
fn watched(control: &Arc<Control>, progress: &Arc<Progress>) -> Work {
    let (control, progress) = (control.clone(), progress.clone());
    let (end, told) = (end_of_work(), AtomicBool::new(false));
    Work::told(move |now| {
        if control.interrupted() {
            if !told.swap(true, Ordering::Relaxed) {
                progress.say("inkling: interrupted; nothing was written");
            }
            end();
        }
        if let Now::Begins((what, share)) = now {
            progress.say(&format!("{:>3.0} %  {what} ...", 100.0 * share));
        }
    })
}

/// Writes the table and the page first and `critique.json` last, so that the other files are complete if
/// that one exists.
fn write(dir: &Path, critique: &Critique) -> Result<(), Failure> {
    write_evidence(&dir.join("evidence.parquet"), critique).map_err(Failure::new)?;
    write_text(&dir.join("report.html"), &report::html(critique))?;
    write_json(&dir.join("critique.json"), critique)
}

/// Writes the evidence: one row per candidate cause and selection step, whether or not it was
/// accepted.
fn write_evidence(path: &Path, critique: &Critique) -> Result<(), TableError> {
    let rows = &critique.evidence;
    let why_not: Vec<String> = rows.iter().map(Evidence::why_not_in_words).collect();
    let columns = vec![
        ("step", count(rows.iter().map(|e| e.step))),
        ("id", text(rows.iter().map(|e| e.id.name()))),
        ("statistic", number(rows.iter().map(|e| e.statistic))),
        ("threshold", number(rows.iter().map(|e| e.threshold))),
        ("p", number(rows.iter().map(|e| e.p))),
        ("delta_bic", number(rows.iter().map(|e| e.delta_bic))),
        ("strength_dl", number(rows.iter().map(|e| e.strength_dl))),
        ("value", number(rows.iter().map(|e| e.value))),
        ("sd", number(rows.iter().map(|e| e.sd))),
        ("tested", flag(rows.iter().map(|e| e.tested()))),
        ("accepted", flag(rows.iter().map(|e| e.accepted()))),
        ("why_not", text(why_not.iter().map(String::as_str))),
    ];
    plain_columns::write(path, columns)
}

/// Prints the critique's sentence, a table of causes, the gain, and what could not be tested. DL:
/// detection limit, the size at which an effect is just found.
fn print(dir: &Path, critique: &Critique, out: &mut impl Write) -> std::io::Result<()> {
    writeln!(out, "{}", printable::line(&critique.sentence, 4000))?;
    if !critique.causes.is_empty() {
        let heads = [
            Column::Words("cause", 22),
            Column::Words("parameter", 18),
            Column::Words("value (95 % interval)", 40),
            Column::Number("strength", 8),
            Column::Last("tied with"),
        ];
        let of_cause = critique.causes.iter().map(|c| {
            let value = critique.measured(c);
            let strength = format!("{} DL", digits::significant(c.strength_dl, 2));
            [c.id.to_string(), c.parameter.to_string(), value, strength, c.tied_words()]
        });
        columns(out, heads, of_cause)?;
    }
    print_gain(critique, out)?;
    let untested = report::grouped(&critique.not_testable);
    if !untested.is_empty() {
        writeln!(out, "  not testable: {}", untested.join("; "))?;
    }
    for remark in &critique.remarks {
        writeln!(out, "  {}", printable::line(remark, 4000))?;
    }
    writeln!(out, "  {}", dir.join("critique.json").display())
}

/// Prints what the extended model gains on signals to which nothing was fitted: the figures of the
/// plain model (before) and of the extended one (after).
fn print_gain(critique: &Critique, out: &mut impl Write) -> std::io::Result<()> {
    let Gain { held_out: HeldOut { signals, channels, by, .. }, before, after, .. } =
        &critique.gain;
    if *signals == 0 {
        return Ok(());
    }
    let signals = counted(*signals as u64, "signal");
    write!(out, "  on {signals} of {} ", counted(*channels as u64, "channel"))?;
    writeln!(out, "that nothing was fitted to (by {by}):")?;
    if critique.verdict == Verdict::None {
        return print_figures("", before, out);
    }
    print_figures("before", before, out)?;
    print_figures("after", after, out)
}

fn print_figures(when: &str, g: &GainFigures, out: &mut impl Write) -> std::io::Result<()> {
    let GainFigures { chi2_per_dof, nrmse_percent, detection_auc, .. } = g;
    let (whiteness, false_alarms) = (digits::p_is(g.whiteness_p), 100.0 * g.false_alarms);
    write!(out, "  {when:<8} chi²/dof {chi2_per_dof:.4}, ")?;
    write!(out, "nrmse {nrmse_percent:.2} %, whiteness {whiteness}")?;
    if detection_auc.is_finite() {
        write!(out, ", false alarms {false_alarms:.2} %, detection AUC {detection_auc:.3}")?;
    }
    writeln!(out)
}
