//! `inkling score`: compares verdicts with labels, and critiques with what was hidden in their recordings.

use super::copies::{self, Table};
use super::exit::{Exit, Failure};
use super::progress::complain;
use super::report_page::write_text;
use super::{output, results, scored};
use inkling_core::design::IsolateSettings;
use inkling_core::fault::{Categories, HEALTHY, category};
use inkling_core::labels::{Channels, Label, Labels, Met, Span};
use inkling_core::model::faults::Catalogue;
use inkling_core::promise::Promise;
use inkling_core::verdict::{Outcome, VerdictColumns};
use inkling_io::truth_file::Seal;
use inkling_io::verdict_reader::VerdictReader;
use inkling_io::{
    design_file, episode_table, labels_file, outputs, printable, regular_file, stored,
    summary_file, truth_file,
};
use inkling_lab::score::blind::{Blind, CritiqueAnswer, Truth};
use inkling_lab::score::curves::Curves;
use inkling_lab::score::episodes::{DetectedEpisode, EpisodeScore};
use inkling_lab::score::severity::SeverityScore;
use inkling_lab::score::{Prediction, Report, Score};
use serde_json::json;
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

/// Categories whose classes are all sized by the same quantity: a share of the nozzle's cross-section, and a
/// viscosity factor.
const ONE_QUANTITY: [&str; 2] = ["blocked_nozzle", "dried_nozzle"];

pub fn run(args: Args) -> Result<Exit, Failure> {
    if let Some(page) = &args.report {
        outputs::check_file(page, outputs::ResultFile::Page)?;
    }
    if !args.truth.is_empty() {
        return critiques(&args);
    }
    let promise = args.design.as_deref().map(promise).transpose()?;
    let labels_path = match (&args.labels, &promise) {
        (Some(path), _) if !args.verdicts.is_empty() => path,
        (None, Some(promise)) if args.verdicts.is_empty() => {
            return tell(&args, None, None, Some(promise));
        }
        _ => {
            return Err(Failure::usage(
                "verdicts and --labels belong together: give both, or --design alone",
            ));
        }
    };
    // labels that do not fit the recordings at all are refused after the verdicts have been read
    let labels = labels_file::read(labels_path)?;
    let files = results::find(&args.verdicts, "a score")?;
    let mut scoring = Scoring::new(&labels, args.report.is_some());
    let documents: Vec<serde_json::Value> =
        files.iter().map(|file| summary_file::of_table(&file.path)).collect();
    let of = files.iter().zip(&documents);
    let tables: Vec<Table> =
        of.map(|(file, document)| Table { path: &file.path, document }).collect();
    for (table, left_out) in tables.iter().zip(copies::left_out(&tables)) {
        match left_out {
            Some(note) => complain(&format!("warning: {note}")),
            None => scoring.add_file(table.path)?,
        }
    }
    labels_file::check(labels_path, &labels, &scoring.met)?;
    let report = scoring.report();
    if report.by_state.is_empty() {
        return Err(Failure::new(format!(
            "{}: none of its rows covers a verdict ({} judged, {} rejected), so there is nothing to score: do \
             printhead names, channels and times agree? `inkling inspect` shows a recording's",
            labels_path.display(),
            report.unlabelled,
            report.rejected
        )));
    }
    if let Some(unused) = scoring.met.unused(&labels) {
        complain(&format!("note: {}: {}", labels_path.display(), printable::line(&unused, 400)));
    }
    tell(&args, Some(&report), scoring.curves.as_ref(), promise.as_ref())
}

/// Compares verdicts with labels row by row.
struct Scoring<'a> {
    labels: &'a Labels,
    onsets: Onsets,
    score: Score,
    severity: SeverityScore,
    of_categories: SeverityScore,
    /// The score of episodes, if there are tables of them.
    episodes: Option<EpisodeScore<'a>>,
    curves: Option<Curves>,
    met: Met,
}

/// A row of a verdict table, with the names to which its indices refer.
struct Row<'a> {
    c: &'a VerdictColumns,
    place: usize,
    classes: &'a [String],
    categories: &'a [String],
}

impl<'a> Scoring<'a> {
    fn new(labels: &'a Labels, with_curves: bool) -> Scoring<'a> {
        Scoring {
            labels,
            onsets: onsets(labels),
            score: Score::default(),
            severity: SeverityScore::default(),
            of_categories: SeverityScore::default(),
            episodes: None,
            curves: with_curves.then(Curves::default),
            met: Met::default(),
        }
    }

    /// Scores a verdict table, and the episodes beside it if there are any.
    fn add_file(&mut self, path: &Path) -> Result<(), Failure> {
        let mut verdicts = VerdictReader::open(path).map_err(Failure::new)?;
        let document: serde_json::Value = verdicts
            .metadata_json()
            .and_then(|json| serde_json::from_str(json).ok())
            .unwrap_or_default();
        let bound = document["settings"]["isolate"]["certainty"].as_f64();
        self.score.bound = bound.or(self.score.bound);
        // own classes of the physics belong to categories that only the settings know
        let laws = &document["settings"]["isolate"]["physics"];
        let laws: Catalogue = serde_json::from_value(laws.clone()).unwrap_or_default();
        let categories = laws.categories();
        let beside = episode_table::path_beside(path);
        let has_episodes = stored::is_file(&beside);
        if has_episodes {
            let score = self.episodes.get_or_insert_with(|| EpisodeScore::new(self.labels));
            add_episodes(&beside, score, &categories)?;
        }
        self.score.categories = categories;
        while let Some(columns) = verdicts.next() {
            let c = &columns.map_err(Failure::new)?;
            let (classes, categories) = (verdicts.classes(), verdicts.categories());
            self.score.add_classes(classes);
            for place in 0..c.len() {
                self.add_row(&Row { c, place, classes, categories }, has_episodes);
            }
        }
        Ok(())
    }

    /// Scores one row. Rejected rows are only counted.
    fn add_row(&mut self, row: &Row, has_episodes: bool) {
        let (c, labels) = (row.c, self.labels);
        let printhead = &c.printheads[c.printhead[row.place] as usize];
        let (channel, t_ns) = (c.channel[row.place], c.acquired_at_ns[row.place]);
        if c.outcome[row.place] == Outcome::Rejected {
            self.score.rejected += 1;
            return;
        }
        // one signal that was met, against which the labels are checked
        let span =
            Span { from_ns: t_ns, to_ns: t_ns, first_channel: channel, last_channel: channel };
        self.met.see(printhead, span);
        let truth = labels.at(printhead, channel, t_ns);
        let prediction = row.prediction();
        self.score.add(prediction, truth.map(|label| label.state.as_str()));
        if let Some(episodes) = self.episodes.as_mut().filter(|_| has_episodes) {
            episodes.add_signal(printhead, channel, t_ns, truth);
        }
        let Some(label) = truth else { return };
        if let Some(curves) = &mut self.curves {
            draw(curves, row, label, &prediction, &self.onsets);
        }
        // a size can only be compared if the class that it was found for is the true one
        if let (Some(stated), Some(size)) = (c.severity[row.place], label.severity)
            && prediction.candidate == Some(label.state.as_str())
        {
            let sd = c.severity_sd[row.place].map(f64::from);
            self.severity.add(&label.state, stated.into(), sd, size);
            let category = category(&label.state);
            if ONE_QUANTITY.contains(&category) {
                self.of_categories.add(category, stated.into(), sd, size);
            }
        }
    }

    fn report(&self) -> Report {
        Report {
            severity: self.severity.report(),
            severity_by_category: self.of_categories.report(),
            episodes: self.episodes.as_ref().map(EpisodeScore::report),
            ..self.score.report()
        }
    }
}

impl<'a> Row<'a> {
    fn prediction(&self) -> Prediction<'a> {
        let (c, place) = (self.c, self.place);
        let start = c.weights_start.get(place).copied().flatten();
        Prediction {
            flagged: c.outcome[place] != Outcome::Healthy,
            candidate: c.candidate[place].map(|k| self.classes[k as usize].as_str()),
            certainty: self.class_certainty().map(f64::from),
            weights: start.map(|start| &c.weights[start as usize..]),
        }
    }

    /// The certainty of the candidate class: its weight, if weights were written. Otherwise it is the
    /// column's, unless only a category is named: the certainty is then that of the category, and says
    /// nothing about the class.
    fn class_certainty(&self) -> Option<f32> {
        let (c, place) = (self.c, self.place);
        // the weights of a row lie in one column for all rows, from its start on, one per class
        let own = c.weights_start.get(place).copied().flatten().zip(c.candidate[place]);
        if let Some((start, class)) = own {
            return c.weights.get(start as usize + usize::from(class)).copied();
        }
        let of_category = c.category[place].is_some() && c.fault[place].is_none();
        c.certainty[place].filter(|_| !of_category)
    }

    /// The class or category that the row names, or else its outcome.
    fn word(&self) -> &'a str {
        let (c, place) = (self.c, self.place);
        let named = match (c.outcome[place], c.fault[place], c.category[place]) {
            (Outcome::Faulty, Some(class), _) => self.classes.get(usize::from(class)),
            (Outcome::Faulty, None, Some(category)) => self.categories.get(usize::from(category)),
            _ => None,
        };
        named.map_or(c.outcome[place].as_str(), String::as_str)
    }
}

/// Writes the page, if one is wanted, and prints the result.
fn tell(
    args: &Args,
    report: Option<&Report>,
    curves: Option<&Curves>,
    promise: Option<&Promise>,
) -> Result<Exit, Failure> {
    if let Some(page) = &args.report {
        write_text(page, &crate::report::evaluation(report.zip(curves), promise))?;
    }
    let mut out = output::result(args.report.is_some());
    if args.json {
        let mut told = report.map_or_else(|| json!({}), |report| json!(report));
        if let Some(promise) = promise {
            told["promise"] = json!(promise);
        }
        writeln!(out, "{told:#}")?;
        return Ok(Exit::Done);
    }
    if let Some(report) = report {
        scored::print(report, &mut out)?;
    }
    if let Some(promise) = promise {
        crate::report::print_promise(promise, printable::line, &mut out)?;
    }
    Ok(Exit::Done)
}

/// The promise of a design, with the default settings of isolation.
fn promise(path: &Path) -> Result<Promise, Failure> {
    let (design, _) = design_file::read(path)?;
    let promise = design.promise(&IsolateSettings::default()).map_err(Failure::new)?;
    promise.ok_or_else(|| {
        Failure::new(format!(
            "{}: promises nothing that could be computed: it was trained without the physics of faults \
             (isolate.method = posterior) or without detect.method = sensitivity",
            path.display()
        ))
    })
}

/// Scores the episodes of one table.
fn add_episodes(
    path: &Path,
    score: &mut EpisodeScore,
    categories: &Categories,
) -> Result<(), Failure> {
    for e in episode_table::read(path).map_err(Failure::new)? {
        let detected = DetectedEpisode {
            printhead: &e.printhead,
            channel: e.channel,
            category: e.category.as_deref(),
            fault: e.fault.as_deref(),
            raised_at_ns: e.raised_at_ns,
            began_at_ns: e.began_at_ns,
        };
        score.add_episode(detected, categories);
    }
    Ok(())
}

/// The onset of a fault by printhead, channels and start of each label that is a part of it.
type Onsets = HashMap<(String, Channels, Option<i64>), Option<i64>>;

/// The onsets of labelled faults. A fault that grows is labelled by several rows, so labels of faults that
/// follow each other without a gap are one fault.
fn onsets(labels: &Labels) -> Onsets {
    let mut faulty: Vec<&Label> = labels.rows().iter().filter(|l| l.is_fault()).collect();
    faulty.sort_by_key(|l| (&l.printhead, l.channel, l.from_ns));
    let mut onsets = Onsets::new();
    let mut before: Option<(&Label, Option<i64>)> = None;
    for label in faulty {
        // `None` as a label's end or start means unlimited
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

/// Adds a judged row with a label to the curves.
fn draw(curves: &mut Curves, row: &Row, label: &Label, prediction: &Prediction, onsets: &Onsets) {
    let (c, place) = (row.c, row.place);
    // detection: statistic over threshold, and for a faulty signal the labelled fault that it belongs to
    let is_healthy = label.state == HEALTHY;
    let printhead = || c.printheads[c.printhead[place] as usize].clone();
    let event = (!is_healthy).then(|| (printhead(), c.channel[place], onset(onsets, label)));
    if let Some((statistic, threshold)) = c.statistic[place].zip(c.threshold[place]) {
        curves.add(f64::from(statistic) / f64::from(threshold), event);
    }
    // isolation: certainty and severity count only for faulty signals with a candidate
    curves.add_confusion(&label.state, row.word());
    let Some(candidate) = prediction.candidate.filter(|_| !is_healthy) else { return };
    let is_right = candidate == label.state;
    if let Some(certainty) = prediction.certainty {
        curves.add_certainty(certainty, is_right);
    }
    if let (Some(stated), Some(size), true) = (c.severity[place], label.severity, is_right) {
        curves.add_severity(&label.state, size, stated.into());
    }
}

/// Scores critiques against truths, pair by pair.
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
        let answer: CritiqueAnswer = serde_json::from_slice(&bytes)
            .map_err(|e| bad(&format!("is no critique.json: {}", printable::of_parser(&e))))?;
        answer.check().map_err(|what| bad(&format!("is no critique.json: {what}")))?;
        let (truth, seal) = truth_file::read(truth_path).map_err(Failure::new)?;
        let no_truth =
            |what: String| Failure::new(format!("{}: is no truth: {what}", truth_path.display()));
        let truth: Truth =
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
        let causes = names(answer.causes.iter().map(|c| c.id.as_str()).collect());
        let outcome = blind.add(&answer, &truth).word();
        lines.push(format!(
            "{path}: {outcome} (hidden: {hidden}; said: {}, {causes})",
            answer.verdict
        ));
    }
    let mut out = std::io::stdout().lock();
    if args.json {
        writeln!(out, "{:#}", blind.json())?;
    } else {
        lines.iter().try_for_each(|line| writeln!(out, "{}", printable::line(line, 4000)))?;
        writeln!(out, "\n{}", printable::lines(&blind.markdown(), 1_000_000))?;
    }
    Ok(Exit::Done)
}
