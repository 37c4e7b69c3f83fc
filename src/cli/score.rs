//! `inkling score`: verdicts against labels, critiques against what was hidden.

use super::exit::{Exit, Failure};
use super::progress::complain;
use super::report_page::write_text;
use super::scored;
use crate::design::IsolateSettings;
use crate::fault::{HEALTHY, category};
use crate::io::truth_file::Seal;
use crate::io::verdict_reader::VerdictReader;
use crate::io::{
    design_file, episode_table, inputs, labels_file, outputs, printable, regular_file, stored,
    truth_file,
};
use crate::labels::{Label, Labels};
use crate::score::blind::{Blind, Said as SaidCritique, True};
use crate::score::curves::Curves;
use crate::score::episodes::{EpisodeScore, SaidEpisode};
use crate::score::promise::Promise;
use crate::score::severity::SeverityScore;
use crate::score::{Report, Said, Score};
use crate::verdict::{Outcome, VerdictColumns};
use std::collections::HashMap;
use std::io::Write;
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  inkling score verdicts/ --labels labels.csv
      with the episode tables beside the verdicts
  inkling score night.verdicts.parquet --labels labels.csv \\
      --json | jq .detection
  inkling score verdicts/ --labels labels.csv --report evaluation.html
      the same as a page with curves
  inkling score --design design.json
      no verdicts: which faults the design can find, and which it mistakes for
      each other
  inkling score critique/critique.json --truth blind/sealed/truth.json

With --truth, critiques are scored against what `inkling simulate --hide` put into their \
recordings: as many truths as critiques, in the same order. Right: every effect by its name \
(nothing: `none`; outside the catalogue: `unknown`). Honest tie: only names that the truth says \
nobody could tell apart. Withheld: `unknown`. A truth that was changed after it was sealed is \
refused.")]
pub struct Args {
    /// Verdict files, or directories of them; with --truth, critique.json files
    #[arg(required_unless_present = "design")]
    verdicts: Vec<String>,
    /// What is true of the channels
    #[arg(long, value_name = "CSV", required_unless_present_any = ["truth", "design"])]
    labels: Option<PathBuf>,
    /// What was hidden in the recordings of the critiques
    #[arg(long, value_name = "TRUTH", num_args = 1.., conflicts_with = "labels")]
    truth: Vec<PathBuf>,
    /// As JSON
    #[arg(long)]
    json: bool,
    /// A page with curves: ROC, DET, delays, reliability, risk against coverage, severities
    #[arg(long, value_name = "FILE", conflicts_with = "truth")]
    report: Option<PathBuf>,
    /// Say also what this design promises, from itself alone: the smallest fault of each class that it
    /// finds, classes that it mistakes for each other
    #[arg(long, value_name = "DESIGN", conflicts_with = "truth")]
    design: Option<PathBuf>,
}

/// Categories whose classes are sized by one quantity: a share of the nozzle's cross-section, a
/// viscosity factor.
const ONE_QUANTITY: [&str; 2] = ["blocked_nozzle", "dried_nozzle"];

pub fn run(args: Args) -> Result<Exit, Failure> {
    if let Some(page) = &args.report {
        outputs::check_file(page).map_err(Failure::usage)?;
    }
    if !args.truth.is_empty() {
        return critiques(&args);
    }
    let promise = args.design.as_deref().map(promise).transpose()?;
    let labels_path = match (&args.labels, &promise) {
        (Some(path), _) if !args.verdicts.is_empty() => path,
        (None, Some(promise)) if args.verdicts.is_empty() => return promised(&args, promise),
        _ => {
            return Err(Failure::usage(
                "verdicts and --labels belong together: give both, or --design alone",
            ));
        }
    };
    let labels = labels_file::read(labels_path).map_err(Failure::new)?;
    let files = inputs::find_verdicts(&args.verdicts).map_err(Failure::new)?;
    let mut score = Score::default();
    let (mut severity, mut of_categories) = (SeverityScore::default(), SeverityScore::default());
    let mut episodes = EpisodeScore::new(&labels);
    let mut any_episodes = false;
    let onsets = onsets(&labels);
    let mut curves = args.report.is_some().then(Curves::default);
    for file in &files {
        let mut verdicts = VerdictReader::open(&file.path).map_err(Failure::new)?;
        let document: serde_json::Value = verdicts
            .metadata_json()
            .and_then(|json| serde_json::from_str(json).ok())
            .unwrap_or_default();
        if let Some(bound) = document["settings"]["isolate"]["certainty"].as_f64() {
            score.set_bound(bound);
        }
        let beside = episode_table::path_beside(&file.path);
        let has_episodes = stored::is_file(&beside);
        if has_episodes {
            add_episodes(&beside, &labels, &mut episodes)?;
            any_episodes = true;
        }
        while let Some(columns) = verdicts.next() {
            let c = columns.map_err(Failure::new)?;
            let classes = verdicts.classes();
            score.add_classes(classes);
            for row in 0..c.len() {
                if c.outcome[row] == Outcome::Rejected {
                    score.add_rejected();
                    continue;
                }
                let printhead = &c.printheads[c.printhead[row] as usize];
                let truth = labels.at(printhead, c.channel[row], c.acquired_at_ns[row]);
                let said = Said {
                    flagged: c.outcome[row] != Outcome::Healthy,
                    candidate: c.candidate[row].map(|k| classes[k as usize].as_str()),
                    certainty: class_certainty(&c, row).map(f64::from),
                    weights: c
                        .weights_start
                        .get(row)
                        .copied()
                        .flatten()
                        .map(|start| &c.weights[start as usize..]),
                };
                score.add(said, truth.map(|label| label.state.as_str()));
                if let (Some(curves), Some(label)) = (&mut curves, truth) {
                    let categories = verdicts.categories();
                    draw(curves, &c, row, label, &said, (classes, categories), &onsets);
                }
                if has_episodes {
                    let healthy = truth.is_some_and(|label| label.state == HEALTHY);
                    let (channel, t_ns) = (c.channel[row], c.acquired_at_ns[row]);
                    episodes.add_signal(printhead, channel, t_ns, healthy);
                }
                // a size is of the class that it was found for
                if let (Some(stated), Some(label)) = (c.severity[row], truth)
                    && let Some(size) = label.severity
                    && said.candidate == Some(label.state.as_str())
                {
                    let sd = c.severity_sd[row].map(f64::from);
                    severity.add(&label.state, stated.into(), sd, size);
                    let category = category(&label.state);
                    if ONE_QUANTITY.contains(&category) {
                        of_categories.add(category, stated.into(), sd, size);
                    }
                }
            }
        }
    }
    let mut report = score.report();
    report.severity = severity.report();
    report.severity_by_category = of_categories.report();
    report.episodes = any_episodes.then(|| episodes.report());
    if report.by_state.is_empty() {
        return Err(Failure::new(format!(
            "{}: none of its rows covers a verdict ({} judged, {} rejected), so there is nothing to score: do \
             printhead names, channels and times agree? `inkling inspect` shows a recording's",
            labels_path.display(),
            report.unlabelled,
            report.rejected
        )));
    }
    tell(&args, &report, curves.as_ref(), promise.as_ref())
}

/// The page, if one is wanted, and what is printed.
fn tell(
    args: &Args,
    report: &Report,
    curves: Option<&Curves>,
    promise: Option<&Promise>,
) -> Result<Exit, Failure> {
    if let (Some(curves), Some(page)) = (curves, &args.report) {
        write_text(page, &crate::report::evaluation(Some((report, curves)), promise))?;
    }
    let mut out = std::io::stdout().lock();
    if args.json {
        let mut told = serde_json::json!(report);
        if let Some(promise) = promise {
            told["promise"] = serde_json::json!(promise);
        }
        write_json(&told, &mut out)?;
    } else {
        scored::print(report, &mut out)?;
        if let Some(promise) = promise {
            crate::report::print_promise(promise, printable::line, &mut out)?;
        }
    }
    Ok(Exit::Done)
}

/// What a design says of itself, by the default settings of isolation.
fn promise(path: &Path) -> Result<Promise, Failure> {
    let (design, _) = design_file::read(path).map_err(Failure::new)?;
    let promise = design.promise(&IsolateSettings::default()).map_err(Failure::new)?;
    promise.ok_or_else(|| {
        Failure::new(format!(
            "{}: promises nothing that could be computed: it was trained without the physics of faults \
             (isolate.method = posterior) or without detect.method = sensitivity",
            path.display()
        ))
    })
}

/// A design alone.
fn promised(args: &Args, promise: &Promise) -> Result<Exit, Failure> {
    if let Some(page) = &args.report {
        write_text(page, &crate::report::evaluation(None, Some(promise)))?;
    }
    let mut out = std::io::stdout().lock();
    match args.json {
        true => write_json(&serde_json::json!({ "promise": promise }), &mut out)?,
        false => crate::report::print_promise(promise, printable::line, &mut out)?,
    }
    Ok(Exit::Done)
}

fn write_json(told: &serde_json::Value, out: &mut impl Write) -> Result<(), Failure> {
    serde_json::to_writer_pretty(&mut *out, told)
        .map_err(|e| Failure::from(std::io::Error::from(e)))?;
    Ok(writeln!(out)?)
}

fn add_episodes(path: &Path, labels: &Labels, score: &mut EpisodeScore) -> Result<(), Failure> {
    for e in episode_table::read(path).map_err(Failure::new)? {
        let said = SaidEpisode {
            printhead: &e.printhead,
            channel: e.channel,
            category: e.category.as_deref(),
            fault: e.fault.as_deref(),
            raised_at_ns: e.raised_at_ns,
            began_at_ns: e.began_at_ns,
        };
        score.add_episode(said, labels);
    }
    Ok(())
}

/// Of a labelled state on a channel, by its start: when the fault began that it is a part of.
type Onsets = HashMap<(String, Option<u32>, Option<i64>), Option<i64>>;

/// A fault that grows is labelled row after row: what follows without a gap is the same fault.
fn onsets(labels: &Labels) -> Onsets {
    let mut faulty: Vec<&Label> = labels.rows().iter().filter(|l| l.state != HEALTHY).collect();
    faulty.sort_by_key(|l| (&l.printhead, l.channel, l.from_ns));
    let mut onsets = Onsets::new();
    let mut before: Option<(&Label, Option<i64>)> = None;
    for label in faulty {
        let goes_on = |&(last, _): &(&Label, Option<i64>)| {
            let same = (&last.printhead, last.channel) == (&label.printhead, label.channel);
            same && last.to_ns.is_none_or(|to| label.from_ns.is_none_or(|from| from <= to))
        };
        let onset = before.filter(goes_on).map_or(label.from_ns, |(_, onset)| onset);
        onsets.insert((label.printhead.clone(), label.channel, label.from_ns), onset);
        before = Some((label, onset));
    }
    onsets
}

fn onset(onsets: &Onsets, label: &Label) -> Option<i64> {
    let key = (label.printhead.clone(), label.channel, label.from_ns);
    onsets.get(&key).copied().unwrap_or(label.from_ns)
}

/// One judged row with a known truth, for the curves. `names`: of classes and categories.
fn draw(
    curves: &mut Curves,
    c: &VerdictColumns,
    row: usize,
    label: &Label,
    said: &Said,
    (classes, categories): (&[String], &[String]),
    onsets: &Onsets,
) {
    let is_healthy = label.state == HEALTHY;
    let printhead = || c.printheads[c.printhead[row] as usize].clone();
    let event = (!is_healthy).then(|| (printhead(), c.channel[row], onset(onsets, label)));
    if let Some((statistic, threshold)) = c.statistic[row].zip(c.threshold[row]) {
        curves.add(f64::from(statistic) / f64::from(threshold), event);
    }
    let word = match (c.outcome[row], c.fault[row], c.category[row]) {
        (Outcome::Faulty, Some(class), _) => classes.get(usize::from(class)),
        (Outcome::Faulty, None, Some(category)) => categories.get(usize::from(category)),
        _ => None,
    };
    curves.add_said(&label.state, word.map_or(c.outcome[row].as_str(), String::as_str));
    if let (false, Some(candidate)) = (is_healthy, said.candidate) {
        if let Some(certainty) = said.certainty {
            curves.add_certainty(certainty, candidate == label.state);
        }
        if let (Some(stated), Some(size), true) =
            (c.severity[row], label.severity, candidate == label.state)
        {
            curves.add_severity(&label.state, size, stated.into());
        }
    }
}

/// Critiques against truths, pair by pair.
fn critiques(args: &Args) -> Result<Exit, Failure> {
    if args.verdicts.len() != args.truth.len() {
        return Err(Failure::usage(format!(
            "{} critiques and {} truths: give one truth per critique, in the same order",
            args.verdicts.len(),
            args.truth.len()
        )));
    }
    let mut blind = Blind::default();
    let mut lines = Vec::new();
    for (path, truth_path) in args.verdicts.iter().zip(&args.truth) {
        let bad = |what: &dyn std::fmt::Display| Failure::new(format!("{path}: {what}"));
        let bytes = regular_file::read(Path::new(path), regular_file::MOST_CRITIQUE_BYTES)
            .map_err(|e| bad(&format!("cannot be read: {e}")))?;
        let said: SaidCritique = serde_json::from_slice(&bytes)
            .map_err(|e| bad(&format!("is no critique.json: {}", printable::of_parser(&e))))?;
        said.check().map_err(|what| bad(&format!("is no critique.json: {what}")))?;
        let (truth, seal) = truth_file::read(truth_path).map_err(Failure::new)?;
        let no_truth =
            |what: String| Failure::new(format!("{}: is no truth: {what}", truth_path.display()));
        let truth: True =
            serde_json::from_value(truth).map_err(|e| no_truth(printable::of_parser(&e)))?;
        truth.check().map_err(no_truth)?;
        if seal == Seal::Missing {
            complain(&format!(
                "warning: {}: not sealed: no truth.sha256 beside its directory, so nobody can tell \
                 whether it was changed",
                truth_path.display()
            ));
        }
        let names = |ids: Vec<&str>| {
            if ids.is_empty() { "nothing".to_owned() } else { ids.join(" + ") }
        };
        let hidden = names(truth.effects.iter().map(|e| e.id.as_str()).collect());
        let causes = names(said.causes.iter().map(|c| c.id.as_str()).collect());
        let outcome = blind.add(&said, &truth).word();
        lines.push(format!(
            "{path}: {outcome} (hidden: {hidden}; said: {}, {causes})",
            said.verdict
        ));
    }
    let mut out = std::io::stdout().lock();
    if args.json {
        serde_json::to_writer_pretty(&mut out, &blind.json())
            .map_err(|e| Failure::from(std::io::Error::from(e)))?;
        writeln!(out)?;
    } else {
        lines.iter().try_for_each(|line| writeln!(out, "{}", printable::line(line, 4000)))?;
        writeln!(out, "\n{}", printable::lines(&blind.markdown(), 1_000_000))?;
    }
    Ok(Exit::Done)
}

/// Certainty of the candidate class: its own weight where weights were written. Where only a category
/// is named the column is the category's, and says nothing of the class.
fn class_certainty(c: &VerdictColumns, row: usize) -> Option<f32> {
    let own = c.weights_start.get(row).copied().flatten().zip(c.candidate[row]);
    if let Some((start, class)) = own {
        return c.weights.get(start as usize + usize::from(class)).copied();
    }
    let of_category = c.category[row].is_some() && c.fault[row].is_none();
    c.certainty[row].filter(|_| !of_category)
}
