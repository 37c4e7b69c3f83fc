//! `inkling score`: compares verdicts with labels, and critiques with what was hidden in their recordings.
//!
//! In one of three forms:
//! * verdict tables and `--labels`: each row of the tables is compared with the label of its
//!   printhead, channel and time (`Scoring`); so are the episodes beside the tables. The sums are
//!   those of `inkling_lab::score`, which computes the figures from them; `scored` prints these.
//! * `--design` alone or beside that: the promise of the design, computed from itself, without any
//!   verdict.
//! * `--truth`: critiques against the truths that `inkling simulate --hide` sealed
//!   (`score_critiques`).
//!
//! Out: text, or JSON (`--json`).

use super::copies::{self, Table};
use super::exit::{Exit, Failure};
use super::progress::complain;
use super::{results, score_critiques, scored};
use inkling_core::design::{Design, IsolateSettings};
use inkling_core::fault::category;
use inkling_core::labels::{Labels, RecordedSpans, Span, known_states};
use inkling_core::model::faults::Catalogue;
use inkling_core::promise::Promise;
use inkling_core::verdict::{Outcome, VerdictColumns};
use inkling_io::verdict_reader::{self, VerdictReader};
use inkling_io::{design_file, episode_table, labels_file, printable, stored, summary_file};
use inkling_lab::score::episodes::{DetectedEpisode, EpisodeScore};
use inkling_lab::score::severity::SeverityScore;
use inkling_lab::score::{Prediction, Report, Score};
use serde_json::json;
use std::collections::BTreeSet;
use std::io::Write;
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  inkling score verdicts/ --labels labels.csv
      with the episode tables beside the verdicts
  inkling score night.verdicts.parquet --labels labels.csv \\
      --json | jq .detection
  inkling score --design design.json
      no verdicts: which faults the design can find, and which it mistakes for
      each other
  inkling score critique/critique.json --truth blind/sealed/truth.json

With --truth, critiques are scored against what `inkling simulate --hide` put into their \
recordings: as many truths as critiques, in the same order. Right: every effect by its name \
(nothing: `none`; outside the catalogue: `unknown`). Tied: only names that the truth says \
nobody could tell apart. Unknown: `unknown`, or a tie with another name. Missed: an effect has no \
name. A truth that was changed after it was sealed is refused.")]
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
    /// Say also what this design promises, from itself alone: the smallest fault of each class that it
    /// finds, classes that it mistakes for each other
    #[arg(long, value_name = "DESIGN", conflicts_with = "truth")]
    design: Option<PathBuf>,
}

/// Categories whose classes are all sized by the same quantity (a share of the nozzle's
/// cross-section in the first, a viscosity factor in the second), so that severities can be scored
/// over the whole category.
const ONE_QUANTITY: [&str; 2] = ["blocked_nozzle", "dried_nozzle"];

/// Runs the verb: decides which of the three forms is asked for, and runs that.
pub fn run(args: Args) -> Result<Exit, Failure> {
    if !args.truth.is_empty() {
        return score_critiques::run(&args.verdicts, &args.truth, args.json);
    }
    let promise = args.design.as_deref().map(promise).transpose()?;
    let labels_path = match (&args.labels, &promise) {
        (Some(path), _) if !args.verdicts.is_empty() => path,
        (None, Some(promise)) if args.verdicts.is_empty() => {
            return tell(args.json, None, Some(promise));
        }
        _ => {
            let what = "verdicts and --labels belong together: give both, or --design alone";
            return Err(Failure::usage(what));
        }
    };

    // the labels and the tables; the labels as such are checked now, whether they fit the
    // recordings below
    let labels = labels_file::read(labels_path)?;
    let files = results::find(&args.verdicts, "a score")?;
    let mut scoring = Scoring::new(&labels);
    let documents: Vec<serde_json::Value> =
        files.iter().map(|file| summary_file::of_table(&file.path).unwrap_or_default()).collect();

    let mut known: BTreeSet<&str> = known_states().collect();
    for document in &documents {
        known.extend(
            document["classes"].as_array().into_iter().flatten().filter_map(|of| of.as_str()),
        );
    }
    let states: BTreeSet<&str> = labels.rows().iter().map(|row| row.state.as_str()).collect();
    for state in states.difference(&known) {
        let (path, state) = (labels_path.display(), printable::cell(state));
        complain(&format!(
            "warning: {path}: state `{state}` is neither `healthy`, nor a class of the verdicts: it counts as a fault"
        ));
    }

    // of several tables of one recording one is scored, so that no signal counts twice
    let tables = files.iter().zip(&documents);
    let tables: Vec<Table> =
        tables.map(|(file, document)| Table { path: &file.path, document }).collect();
    let mut scored: Vec<&Path> = Vec::new();
    for (table, left_out) in tables.iter().zip(copies::left_out(&tables)) {
        match left_out {
            Some(note) => complain(&format!("warning: {note}")),
            None => scored.push(table.path),
        }
    }

    // a fault may be found in another recording than that in which it began: all episodes come first
    scored.iter().try_for_each(|table| scoring.add_episodes(table))?;
    scored.iter().try_for_each(|table| scoring.add_rows(table))?;

    // labels of printheads or times that no recording has are a mistake
    labels_file::check(labels_path, &labels, &scoring.met)?;
    let (report, path) = (scoring.report(), labels_path.display());
    if report.by_state.is_empty() {
        let Report { unlabelled, rejected, .. } = report;
        return Err(Failure::new(format!(
            "{path}: none of its rows covers a verdict ({unlabelled} judged, {rejected} rejected), so there is \
             nothing to score: do printhead names, channels and times agree? `inkling inspect` shows a recording's"
        )));
    }
    if let Some(unused) = scoring.met.unused(&labels) {
        complain(&format!("note: {path}: {}", printable::line(&unused, 400)));
    }
    tell(args.json, Some(&report), promise.as_ref())
}

/// Compares verdicts with labels row by row. Its fields are sums that grow with each row.
struct Scoring<'a> {
    labels: &'a Labels,
    /// Confusion of detection and isolation, and calibration.
    score: Score,
    /// Errors of sizes by class, and by category for those of `ONE_QUANTITY`.
    severity: SeverityScore,
    of_categories: SeverityScore,
    /// The score of episodes, and whether a table of episodes was met yet.
    episodes: EpisodeScore<'a>,
    has_episodes: bool,
    /// The printheads, channels and times that were met, against which the labels are checked.
    met: RecordedSpans,
}

/// A row of a verdict table, with the names to which its candidate refers.
struct Row<'a> {
    /// The batch of rows that it is part of.
    c: &'a VerdictColumns,
    /// Its index in `c`.
    place: usize,
    classes: &'a [String],
}

impl<'a> Scoring<'a> {
    fn new(labels: &'a Labels) -> Scoring<'a> {
        Scoring {
            labels,
            score: Score::default(),
            severity: SeverityScore::default(),
            of_categories: SeverityScore::default(),
            episodes: EpisodeScore::new(labels),
            has_episodes: false,
            met: RecordedSpans::default(),
        }
    }

    /// Takes from a verdict table's metadata by which settings its verdicts are scored.
    fn use_settings_of(&mut self, path: &Path) {
        let document = verdict_reader::document_of(path).unwrap_or_default();
        let isolate = &document["settings"]["isolate"];
        // from which certainty on the verdicts were called certain
        self.score.bound = isolate["certainty"].as_f64().or(self.score.bound);
        // the user's own classes belong to categories that only these settings know
        let laws: Catalogue =
            serde_json::from_value(isolate["physics"].clone()).unwrap_or_default();
        self.score.categories = laws.categories();
    }

    /// Adds the episodes beside a verdict table, if there are any.
    fn add_episodes(&mut self, path: &Path) -> Result<(), Failure> {
        self.use_settings_of(path);
        let beside = episode_table::path_beside(path);
        if stored::is_file(&beside) {
            self.has_episodes = true;
            for e in episode_table::read(&beside).map_err(Failure::new)? {
                let detected = DetectedEpisode {
                    printhead: &e.printhead,
                    channel: e.channel,
                    category: e.category.as_deref(),
                    fault: e.fault.as_deref(),
                    raised_at_ns: e.raised_at_ns,
                    began_at_ns: e.began_at_ns,
                };
                self.episodes.add_episode(detected, &self.score.categories);
            }
        }
        Ok(())
    }

    /// Scores the rows of a verdict table, batch by batch, after all episodes were added.
    fn add_rows(&mut self, path: &Path) -> Result<(), Failure> {
        self.use_settings_of(path);
        let mut verdicts = VerdictReader::open(path).map_err(Failure::new)?;
        let has_episodes = stored::is_file(&episode_table::path_beside(path));
        while let Some(columns) = verdicts.next() {
            let c = &columns.map_err(Failure::new)?;
            let classes = verdicts.classes();
            self.score.add_classes(classes);
            for place in 0..c.len() {
                self.add_row(&Row { c, place, classes }, has_episodes);
            }
        }
        Ok(())
    }

    /// Scores one row: adds it to all sums that it belongs to. Rejected rows are only counted.
    /// `has_episodes`: whether the row's table has a table of episodes beside it.
    fn add_row(&mut self, row: &Row, has_episodes: bool) {
        let (c, labels) = (row.c, self.labels);
        let printhead = &c.printheads[c.printhead[row.place] as usize];
        let (channel, t_ns) = (c.channel[row.place], c.acquired_at_ns[row.place]);
        if c.outcome[row.place] == Outcome::Rejected {
            self.score.rejected += 1;
            return;
        }
        // this signal was met: a span of one time and one channel
        let span =
            Span { from_ns: t_ns, to_ns: t_ns, first_channel: channel, last_channel: channel };
        self.met.see(printhead, span);

        // detection and isolation; a row without a label is counted as such
        let truth = labels.at(printhead, channel, t_ns);
        let prediction = row.prediction();
        self.score.add(prediction, truth.map(|label| label.state.as_str()));
        if has_episodes {
            self.episodes.add_signal(printhead, channel, t_ns, truth);
        }
        let Some(label) = truth else { return };
        // sizes have the unit of their class, so one can only be compared if its class is the true
        // one
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

    /// The figures of all rows so far.
    fn report(&self) -> Report {
        Report {
            severity: self.severity.report(),
            severity_by_category: self.of_categories.report(),
            episodes: self.has_episodes.then(|| self.episodes.report()),
            ..self.score.report()
        }
    }
}

impl<'a> Row<'a> {
    /// What the row says of its signal, in the form that the score compares with a label. The
    /// certainty is that of the candidate class: its weight, if weights were written
    /// (`output.weights`), else the column `certainty`, unless the row names only a category: the
    /// column then holds that of the category, which says nothing about the class.
    fn prediction(&self) -> Prediction<'a> {
        let (c, place) = (self.c, self.place);
        // the row's weights are the first of these, one per class; those of later rows follow
        let start = c.weights_start.get(place).copied().flatten();
        let weights = start.map(|start| &c.weights[start as usize..]);
        let of_category = c.category[place].is_some() && c.fault[place].is_none();
        let certainty = match weights.zip(c.candidate[place]) {
            Some((weights, class)) => weights.get(usize::from(class)).copied(),
            None => c.certainty[place].filter(|_| !of_category),
        };
        Prediction {
            flagged: c.outcome[place] != Outcome::Healthy,
            candidate: c.candidate[place].map(|k| self.classes[k as usize].as_str()),
            certainty: certainty.map(f64::from),
            weights,
        }
    }
}

/// Prints the result: the score (`report`), the promise of a design, or both.
fn tell(json: bool, report: Option<&Report>, promise: Option<&Promise>) -> Result<Exit, Failure> {
    let mut out = std::io::stdout().lock();
    if json {
        let mut document = report.map_or_else(|| json!({}), |report| json!(report));
        if let Some(promise) = promise {
            document["promise"] = json!(promise);
        }
        writeln!(out, "{document:#}")?;
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

/// The promise of the design at `path`.
fn promise(path: &Path) -> Result<Promise, Failure> {
    let (design, _) = design_file::read(path)?;
    promise_of(&design)
        .map_err(|e| Failure { message: format!("{}: {}", path.display(), e.message), ..e })
}

/// The promise of a design (what it can find, from itself alone), with the default settings of isolation. A
/// failure if it was trained by methods that promise nothing.
pub fn promise_of(design: &Design) -> Result<Promise, Failure> {
    let promise = design.promise(&IsolateSettings::default()).map_err(Failure::new)?;
    promise.ok_or_else(|| {
        Failure::new(
            "promises nothing that could be computed: it was trained without the physics of faults \
             (isolate.method = posterior) or without detect.method = sensitivity",
        )
    })
}
