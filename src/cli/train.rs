//! `inkling train`: learns a design from labelled recordings.
//!
//! In: recordings, labels (what is true of which channels and when), and settings. Out: the design
//! file, and a table that says of each labelled class how many of its signals are detected, and how
//! those held out would be named.
//!
//! The steps are those of [`learn`]: labels and their states are checked; the signals of all
//! recordings are collected by printhead and label; healthy signals that are no ring-downs are
//! refused; `Design::train` learns the design; each labelled class is reviewed, and a class that
//! would hardly be named is refused. [`learn`] also serves programs that train on bursts in memory
//! (`called`).

use super::collected::{Collected, RecordingSource, collected};
use super::effect::{self, Command};
use super::exit::{Exit, Failure};
use super::output;
use super::progress::{Progress, counted, thousands};
use super::replay::PRESETS;
use super::report::printable;
use crate::report::{Column, columns};
use crate::settings::{Preset, Settings};
use inkling_core::design::{ClassReview, Design, DesignError, Judged};
use inkling_core::detect::DetectMethod;
use inkling_core::fault::is_reserved;
use inkling_core::identify::IdentifyError;
use inkling_core::identify::SignalSet;
use inkling_core::labels::{Label, Labels};
use inkling_core::model::ring_down::Poles;
use inkling_core::model::row_layout::RowLayout;
use inkling_io::labels_file::{self, LabelSource, States};
use inkling_io::{design_file, outputs};
use serde_json::json;
use std::io::Write;
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  inkling train library.mcap --labels labels.csv -o design.json
  inkling train logs/ --labels labels.csv -o design.json \\
      --set detect.false_alarm_rate=1e-3
  inkling train logs/ --labels labels.csv --new-class Stecker -o design.json
      a class of your own, beside those that the physics knows

Labels: CSV with printhead,channel,from,to,state,severity; printhead is a name or *; channel a \
number, a range such as 0-20, or *; state is `healthy`, `ignore` (not learned from), a fault class, \
or a name of your own that --new-class or [isolate.classes] declares. Of each labelled class it is \
told how many of its signals are detected, and how many would be named if they had not been \
labelled.")]
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
    /// A class of your own that nothing else declares, repeatable
    #[arg(long = "new-class", value_name = "NAME")]
    new_class: Vec<String>,
    /// As JSON
    #[arg(long)]
    json: bool,
    /// Any setting of pipeline.toml, repeatable
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Choices that belong together; --set wins over them
    #[arg(long, value_parser = PRESETS)]
    preset: Option<String>,
}

/// Runs the verb: checks the settings and the place of the design, learns, writes, and tells.
pub fn run(args: Args) -> Result<Exit, Failure> {
    let preset = args.preset.as_ref().map(|_| Preset::Thesis);
    let settings = Settings::load(args.config.as_deref(), preset, &args.set)?;
    effect::check(&args.set, &settings, Command::Train)?;
    outputs::check_file(&args.out, outputs::ResultFile::Design)?;
    let learned = learn(TrainingInput {
        recordings: RecordingSource::Named(&args.recordings),
        labels: LabelSource::File(&args.labels),
        new_class: &args.new_class,
        settings: &settings,
    })?;
    if !args.json {
        let progress = Progress::new(1, 0);
        learned.warnings.iter().for_each(|what| progress.say(&format!("warning: {what}")));
    }
    design_file::write(&args.out, &learned.design).map_err(Failure::new)?;
    match args.json {
        true => output::event(&document(&args, &learned))?,
        false => tell(&args, &learned)?,
    }
    Ok(if learned.incomplete { Exit::Incomplete } else { Exit::Done })
}

/// What a design is learned from.
pub struct TrainingInput<'a> {
    pub recordings: RecordingSource<'a>,
    pub labels: LabelSource<'a>,
    pub new_class: &'a [String],
    pub settings: &'a Settings,
}

/// A design, and what is to be told about it.
pub struct TrainedDesign {
    pub design: Design,
    /// For each labelled class, how many of its signals are detected, and how they would be named.
    pub reviews: Vec<ClassReview>,
    pub warnings: Vec<String>,
    /// A sentence about rows of the labels that cover no signal; `None` if there are none.
    pub unused: Option<String>,
    /// Whether something was damaged or could not be used.
    pub incomplete: bool,
}

/// Reads labels and recordings, trains a design, and checks that each labelled class can be named.
///
/// # Errors
/// A usage failure if the labels or the settings are wrong, if fewer signals are healthy than are needed, or if a class
/// would hardly be named. Else a failure, also if no signal at all is healthy: names or times do not agree then.
pub fn learn(lesson: TrainingInput) -> Result<TrainedDesign, Failure> {
    let TrainingInput { recordings, labels: written, new_class, settings } = lesson;

    // 1. labels are checked twice: their states before the recordings are read, their printheads
    // and times after that, against what the recordings hold
    let labels = labels(written, new_class, settings)?;
    let collected = collected(recordings, settings, Some(&labels))?;
    let Collected { mut set, met, incomplete, .. } = collected;
    labels_file::check(written.name(), &labels, &met)?;
    let unused = met.unused(&labels);
    let path = written.name().display();
    if set.healthy.is_empty() {
        let found = set.signals.iter().map(|(label, n)| format!("{n} {}", printable(label)));
        let found = found.collect::<Vec<_>>().join(", ");
        return Err(Failure::new(format!(
            "no signal is labelled `healthy` (found: {found}); do printhead names and times of {path} \
             agree with the recordings? `inkling inspect` shows them"
        )));
    }

    // 2. train; healthy signals that are no ring-downs are refused first: by a design nobody would look at that again
    set.healthy.iter().try_for_each(|(name, signals)| refuse_no_rings(name, signals))?;
    let grey_box = &settings.identify.grey_box;
    let mut warnings = set.check_temperatures(grey_box);
    let (mut design, of_design) =
        Design::train(&set, grey_box, &settings.detect, &settings.isolate)
            .map_err(|e| not_trained(&e, written.name()))?;
    warnings.extend(of_design);
    design.chosen = settings.kept_by_design();

    // 3. review each labelled class; a class that would hardly be named is refused, as its faults
    // would not be told
    let reviews = design.review_classes(&set, grey_box, &settings.isolate).map_err(Failure::new)?;
    refuse_hardly_named(&reviews, written.name())?;
    warnings.extend(reviews.iter().filter(|class| class.is_hardly_detected()).map(hardly_detected));
    warnings.extend(reviews.iter().filter(|class| class.is_sized_otherwise()).map(sized_otherwise));
    Ok(TrainedDesign { design, reviews, warnings, unused, incomplete })
}

/// Refuses healthy signals that do not look like ring-downs: nothing can be learned from noise, or
/// from rows that are no channels because the layout is wrong. [`RowLayout`] measures how neighbouring
/// samples correlate and how alike the signals are. Fewer than 16 signals are not looked at; the
/// training refuses so few by itself.
fn refuse_no_rings(printhead: &str, signals: &SignalSet) -> Result<(), Failure> {
    /// Maximum number of signals that are looked at, and the number below which nothing can be
    /// told.
    const MOST: usize = 256;
    const FEWEST: usize = 16;
    // the first signals are enough; a signal counts as a channel here, laid out one after the other
    // (`false`)
    let rows = signals.len().min(MOST);
    if rows < FEWEST {
        return Ok(());
    }
    let samples = &signals.data[..rows * signals.samples];
    let samples: Vec<f64> = samples.iter().map(|&y| y.into()).collect();
    let implausible = RowLayout::of(&samples, rows, false).filter(|of| !of.is_plausible());
    let Some(RowLayout { neighbours, alike, .. }) = implausible else { return Ok(()) };
    let (printhead, alike) = (printable(printhead), alike.max(0.0));
    Err(Failure::new(format!(
        "{printhead}: the signals labelled `healthy` are no ring-downs as laid out: neighbouring samples of a signal \
         correlate {neighbours:.2}, and signals have {alike:.2} of their energy in common; look at `format`, `layout`, \
         `channels` and `samples_per_channel`, and at the labels"
    )))
}

/// Reads labels. Their states must be known or declared (`--new-class`, `isolate.classes`,
/// `isolate.physics`); classes that the settings group under one name get that name, as the design
/// knows them by it.
fn labels(
    written: LabelSource,
    new_class: &[String],
    settings: &Settings,
) -> Result<Labels, Failure> {
    let isolate = &settings.isolate;
    let own = isolate.classes.keys().map(String::as_str).chain(isolate.physics.own_classes());

    for name in new_class {
        let is_taken = is_reserved(name)
            || isolate.classes.contains_key(name)
            || isolate.physics.law(name).is_some();
        if name.is_empty() {
            return Err(Failure::usage("--new-class: an empty name is none; give one"));
        }
        if is_taken {
            let what = "that name has a meaning already; give another";
            return Err(Failure::usage(format!("--new-class {}: {what}", printable(name))));
        }
    }
    let declared: Vec<&str> = own.chain(new_class.iter().map(String::as_str)).collect();
    let states = States::Declared(&declared);
    let labels = labels_file::read_states(written, states)?;

    // a new class without a label is probably misspelt
    let unused = |name: &&String| !labels.rows().iter().any(|row| row.state == **name);
    if let Some(name) = new_class.iter().find(unused) {
        let (name, path) = (printable(name), written.name().display());
        return Err(Failure::usage(format!(
            "--new-class {name}: has no effect here: no row of {path} has that state"
        )));
    }

    // states get the names under which the settings group classes
    let named = |row: &Label| Label {
        state: settings.isolate.name_of(&row.state).to_owned(),
        ..row.clone()
    };
    Ok(Labels::new(labels.rows().iter().map(named).collect()))
}

/// A failure of training. Too few healthy signals are blamed on the labels.
fn not_trained(e: &DesignError, labels: &Path) -> Failure {
    match e {
        DesignError::Identify(e @ IdentifyError::TooFewSignals { .. }) => {
            Failure::usage(format!("{}: {}", labels.display(), e.advice(true)))
        }
        e => Failure::new(e),
    }
}

fn refuse_hardly_named(reviews: &[ClassReview], labels: &Path) -> Result<(), Failure> {
    let why = |class: &ClassReview| {
        let name = printable(&class.name);
        class.why_hardly_named().map(|why| format!("class {name} would hardly be named: {why}"))
    };
    let all: Vec<String> = reviews.iter().filter_map(why).collect();
    if all.is_empty() {
        return Ok(());
    }
    let what = format!("look at these rows of {}, or label them `ignore`", labels.display());
    Err(Failure::usage(format!("{}; no design is written; {what}", all.join("; "))))
}

/// The warning about a class of which hardly any signals are detected.
fn hardly_detected(class: &ClassReview) -> String {
    let (name, Judged { signals, detected, .. }) = (printable(&class.name), &class.trained_on);
    format!(
        "class {name}: hardly detectable: {detected} of its {signals} labelled signals pass the chosen \
         detection, and what does not pass gets no name"
    )
}

/// The warning about a class whose labelled sizes are not those that its signals show.
fn sized_otherwise(class: &ClassReview) -> String {
    let (name, Judged { sized, sized_right, .. }) = (printable(&class.name), &class.trained_on);
    format!(
        "class {name}: the labelled size lies within the 95 % interval in {sized_right} of {sized} signals: sizes will be \
         those of the physics. Look at the labelled sizes and their unit, or leave them empty"
    )
}

/// The result as JSON (`--json`).
fn document(args: &Args, learned: &TrainedDesign) -> serde_json::Value {
    let TrainedDesign { design, reviews, warnings, unused, .. } = learned;
    let poles = design.pooled.identification.poles;
    let class = |class: &ClassReview| {
        let ClassReview { name, labelled, trained_on, held_out, .. } = class;
        // what is left after the right name is removed are the wrong ones
        let mut mistaken = held_out.named.clone();
        let named = mistaken.remove(name).unwrap_or(0);
        json!({
            "class": name,
            "labelled": labelled,
            "looked_at": trained_on.signals,
            "detected": trained_on.detected,
            "held_out": held_out.signals,
            "named": named,
            "mistaken_for": mistaken,
        })
    };
    json!({
        "design": args.out,
        "models": design.models.len() + 1,
        "classes": design.class_names(),
        "signals": design.signals,
        "labelled_classes": reviews.iter().map(class).collect::<Vec<_>>(),
        "resonance_hz": poles.frequency_hz,
        "damping_per_s": poles.damping_per_s,
        "threshold": design.pooled.threshold.value,
        "warnings": warnings,
        "labels_without_signals": unused,
    })
}

/// Prints the result: counts of signals, the classes, the model of all printheads and its threshold.
fn tell(args: &Args, learned: &TrainedDesign) -> std::io::Result<()> {
    let TrainedDesign { design, reviews, unused, .. } = learned;
    let mut out = output::report();
    let printheads = counted(design.models.len() as u64, "printhead");
    let classes = design.classes.len();
    writeln!(out, "{}: {printheads}, {classes} classes", args.out.display())?;
    for (label, n) in &design.signals {
        writeln!(out, "  {:>10} {}", thousands(*n), printable(label))?;
    }
    if let Some(unused) = unused {
        writeln!(out, "  labels: {}", inkling_io::printable::line(unused, 400))?;
    }
    tell_classes(reviews, &mut out)?;
    let Poles { frequency_hz, damping_per_s, lambda_per_s } = design.pooled.identification.poles;
    write!(out, "  all printheads together: resonance {:.3} kHz, ", frequency_hz / 1e3)?;
    writeln!(out, "damping {damping_per_s:.4e} 1/s, real pole {lambda_per_s:.3e} 1/s")?;
    let t = &design.pooled.threshold;
    let unit = match design.detect.method {
        DetectMethod::Sensitivity => "squared distance",
        DetectMethod::ResidualEnergy => "counts²·s",
        DetectMethod::ResidualMaximum => "counts",
    };
    writeln!(out, "  threshold {:.4e} {unit} ({})", t.value, t.in_words())
}

/// Prints for each labelled class how many of its signals are detected, and how those held out would be
/// named.
fn tell_classes(reviews: &[ClassReview], out: &mut impl Write) -> std::io::Result<()> {
    let name = |class: &ClassReview| printable(&class.name);
    let Some(width) = reviews.iter().map(|class| name(class).chars().count()).max() else {
        return Ok(());
    };
    let share = |part: usize, whole: usize| match whole {
        0 => "-".to_owned(),
        _ => format!("{:.1} %", 100.0 * part as f64 / whole as f64),
    };
    let heads = [
        Column::Words("class", width.max(5)),
        Column::Number("labels", 10),
        Column::Number("detected", 9),
        Column::Number("held out:    named", 19),
        Column::Last("mistaken for"),
    ];
    let of_class = reviews.iter().map(|class| {
        let ClassReview { labelled, trained_on, held_out, .. } = class;
        let detected = share(trained_on.detected, trained_on.signals);
        let named = share(held_out.named(&class.name), held_out.signals);
        let mistaken = held_out.mistaken_for(&class.name).map_or("-".to_owned(), |(other, n)| {
            format!("{} {}", printable(other), share(n, held_out.signals))
        });
        [name(class), thousands(*labelled), detected, named, mistaken]
    });
    columns(out, heads, of_class)
}
