//! The evaluation as a page, drawn like the report: how well verdicts agree with labels, and what a
//! design promises. `inkling score --report` writes it.
//!
//! In: a score (`inkling_lab::score::Report`) with its curves, or the promise of a design, or both.
//! Out: HTML. Each section has a figure whose title tells its main number: ROC and DET with the
//! threshold that was used, delay against false alarms, confusion, reliability of certainties, risk
//! against coverage, true and stated severities. Nothing is estimated here but intervals of shares
//! (`wilson`).

use super::figures::drawn;
use super::promised;
use super::words::{counted, percent, thousands};
use inkling_core::fault;
use inkling_core::promise::Promise;
use inkling_lab::plot::page::{Row, name, note, page, section, sentence, table, wide};
use inkling_lab::plot::{Axis, Figure, Mark, Series};
use inkling_lab::score::Report;
use inkling_lab::score::curves::{Curves, EventDelay, Operating, wilson};
use std::collections::BTreeSet;

/// Number of thresholds, at most, at which the curve of delays is drawn.
const MOST_THRESHOLDS: usize = 120;
/// Most classes that get a figure of severities.
const MOST_CLASSES: usize = 12;

/// The page: the agreement with labels, if there are any, and the promise of the design, if one was computed.
pub fn html(scored: Option<(&Report, &Curves)>, promise: Option<&Promise>) -> String {
    let parts = [
        "<h1>Evaluation</h1>\n".to_owned(),
        scored.map_or(String::new(), |(report, curves)| against_labels(report, curves)),
        promise.map_or(String::new(), promised::html),
    ];
    page("Evaluation of verdicts", &parts.concat())
}

/// The sections about the agreement with labels.
fn against_labels(report: &Report, curves: &Curves) -> String {
    let judged = thousands(curves.healthy() + curves.faulty());
    let [unlabelled, rejected] = [report.unlabelled, report.rejected].map(thousands);
    let parts = [
        sentence(&in_short(report)),
        note(&format!(
            "{judged} labelled signals judged; {unlabelled} unlabelled and {rejected} rejected ones are not scored. \
             What the labels call true is taken for true."
        )),
        detection(curves),
        delays(report, curves),
        confusion(curves),
        reliability(report),
        risk(report, curves),
        severities(report, curves),
    ];
    parts.concat()
}

/// The page's first sentence: hits and false alarms, right names, episodes found.
fn in_short(report: &Report) -> String {
    let d = &report.detection;
    let (faulty, healthy) = (d.tp + d.fn_, d.fp + d.tn);
    let (hits, alarms) = (percent(d.tp, faulty), percent(d.fp, healthy));
    let [faulty, healthy] = [faulty, healthy].map(thousands);
    let mut text = format!(
        "{hits} of {faulty} faulty signals are flagged, and {alarms} of {healthy} healthy ones"
    );
    let isolation = &report.isolation;
    if isolation.confusion.iter().flatten().any(|n| *n > 0) {
        let [class, category] =
            [isolation.accuracy, isolation.category_accuracy].map(|v| 100.0 * v);
        text += &format!(
            "; the best class is right in {class:.1} % of those with one, its category in {category:.1} %"
        );
    }
    if let Some(e) = &report.episodes {
        let (faults, found) = (counted(e.faults, "fault"), 100.0 * e.recall);
        let wrong = e.false_episodes;
        text += &format!("; of {faults} {found:.1} % were found as episodes, {wrong} false");
    }
    text + "."
}

/// ROC and DET of single signals, each with the threshold that was used.
fn detection(curves: &Curves) -> String {
    let (healthy, faulty) = (curves.healthy(), curves.faulty());
    if healthy == 0 || faulty == 0 {
        return "<p>Without healthy and faulty signals there are no curves of detection.</p>\n"
            .into();
    }
    let meaning = "Line: what other thresholds would do; dot: the threshold that was used, with 95 % intervals as \
                   if signals were independent. ROC: hits against false alarms; its area is the chance that a faulty \
                   signal's statistic exceeds a healthy one's. DET: the same as misses, on logarithmic axes; none is \
                   drawn as half a signal.";

    // The threshold that was used, with intervals of its misses and false alarms.
    let at = curves.working_point();
    let misses = wilson(at.misses * faulty as f64, faulty as f64);
    let alarms = wilson(at.false_alarms * healthy as f64, healthy as f64);
    // ROC: hits, which are 1 - misses, against false alarms.
    let operating = curves.operating();
    let series = with_working_point(
        operating.iter().map(|o| (o.false_alarms, 1.0 - o.misses)).collect(),
        (at.false_alarms, 1.0 - at.misses),
        (alarms, [1.0 - misses[1], 1.0 - misses[0]]),
    );
    let roc = Figure::new(
        format!("ROC: area {:.4}", curves.area()),
        Axis::within(-0.01, 1.0, "healthy signals flagged, share"),
        Axis::within(0.0, 1.02, "faulty signals flagged, share"),
        series,
    );

    // DET. Logarithmic axes have no 0: no signal is drawn as half a signal.
    let [least_x, least_y] = [healthy, faulty].map(|n| 0.5 / n as f64);
    let clip = |low: f64, [a, b]: [f64; 2]| [a.max(low), b.max(low)];
    let place = |o: &Operating| (o.false_alarms.max(least_x), o.misses.max(least_y));
    let series = with_working_point(
        operating.iter().map(place).collect(),
        place(&at),
        (clip(least_x, alarms), clip(least_y, misses)),
    );
    let share = |of: f64, all: u64| percent((of * all as f64).round() as u64, all);
    let (missed, flagged) = (share(at.misses, faulty), share(at.false_alarms, healthy));
    let det = Figure::new(
        format!(
            "DET: at the threshold used {missed} of the faulty are missed, {flagged} of the healthy flagged"
        ),
        Axis::log("healthy signals flagged, share"),
        Axis::log("faulty signals missed, share"),
        series,
    );
    section("Detection, signal by signal", &[note(meaning), drawn(&roc), drawn(&det)].concat())
}

/// The series of a curve, of the point that was used, and of its intervals along both axes.
fn with_working_point(
    curve: Vec<(f64, f64)>,
    (x, y): (f64, f64),
    ([left, right], [low, high]): ([f64; 2], [f64; 2]),
) -> Vec<Series> {
    vec![
        Series::new("", Mark::Line, curve),
        Series::new("", Mark::Spans, vec![(x, low), (x, high), (left, y), (right, y)]),
        Series::new("", Mark::Dots, vec![(x, y)]),
    ]
}

/// The delay of detection against false alarms, counted by faults: a fault is found once, at its
/// first flagged signal. Below stand the same numbers for episodes, if there are any.
fn delays(report: &Report, curves: &Curves) -> String {
    if curves.events() == 0 || curves.healthy() == 0 {
        return String::new();
    }
    let used = curves.delays(&[1.0])[0];
    let (faults, found) = (counted(curves.events() as u64, "labelled fault"), 100.0 * used.found);
    let meaning = format!(
        "{faults}, {found:.1} % of them found at the threshold used: at the first flagged signal, and credited for \
         no other. Lines: other thresholds. Bursts are counted in the order of the file, from the labelled onset; \
         faults grow. No false alarm is drawn as half a one."
    );
    let of_episodes = report.episodes.as_ref().map(|e| {
        let bursts = |b: Option<f64>| b.map_or("–".into(), |b| format!("{b}"));
        format!(
            "<p>Episodes, from the evidence of several bursts: {:.1} % found, {:.2} false per million \
             healthy signals, {} bursts after the onset in the median, {} after full size.</p>\n",
            100.0 * e.recall,
            e.false_per_million,
            bursts(e.delay_from_onset_bursts),
            bursts(e.delay_bursts)
        )
    });
    let figure = drawn(&delay_figure(report, curves, &used));
    let part = note(&meaning) + &figure + &of_episodes.unwrap_or_default();
    section("Delay against false alarms, fault by fault", &part)
}

/// The figure of delays over all thresholds. `used`: the delays at the threshold that was used.
fn delay_figure(report: &Report, curves: &Curves, used: &EventDelay) -> Figure {
    let operating = curves.operating();
    let every = operating.len().div_ceil(MOST_THRESHOLDS).max(1);
    let mut factors: Vec<f64> = operating.iter().step_by(every).map(|o| o.factor).collect();
    factors.push(1.0); // what was used is on the line
    factors.sort_by(|a, b| b.total_cmp(a));
    let all = curves.delays(&factors);
    let least = 0.5 / curves.healthy() as f64;
    let line = |of: fn(&EventDelay) -> Option<f64>| -> Vec<(f64, f64)> {
        all.iter().filter_map(|d| Some((d.false_alarms.max(least), of(d)?))).collect()
    };

    // The lines, and the dots on and beside them.
    let mut shown = vec![
        Series::new("half of all faults found", Mark::Line, line(|d| d.median_bursts)),
        Series::new("nine of ten found", Mark::Line, line(|d| d.most_bursts)),
    ];
    let x = used.false_alarms.max(least);
    let at = [used.median_bursts, used.most_bursts].into_iter().flatten().map(|y| (x, y)).collect();
    shown.push(Series::new("single signals, the threshold used", Mark::Dots, at));
    if let Some((e, y)) =
        report.episodes.as_ref().and_then(|e| Some((e, e.delay_from_onset_bursts?)))
    {
        let rate = e.false_episodes as f64 / e.healthy_signals.max(1) as f64;
        shown.push(Series::new("episodes, half found", Mark::Dots, vec![(rate.max(least), y)]));
    }

    // The title says the same in words.
    let within = |bursts: Option<f64>| match bursts {
        None => "after more bursts than there were".to_owned(),
        Some(0.0) => "at their onset".to_owned(),
        Some(n) => format!("within {}", counted(n as u64, "burst")),
    };
    let [half, most] = [used.median_bursts, used.most_bursts].map(within);
    Figure::new(
        format!("At the threshold used half of the faults are flagged {half}, nine of ten {most}"),
        Axis::log("false alarms, share of the healthy signals"),
        Axis::new("bursts from the labelled onset"),
        shown,
    )
}

/// The confusion matrix: true states in rows, what was said in columns.
fn confusion(curves: &Curves) -> String {
    let counts = &curves.confusion;
    if counts.is_empty() {
        return String::new();
    }
    let truths: BTreeSet<&String> = counts.keys().map(|(truth, _)| truth).collect();
    let words: BTreeSet<&String> = counts.keys().map(|(_, word)| word).collect();

    // Healthy, undecided, then categories and a user's own classes, then the thesis's classes.
    let rank = |word: &str| match word {
        fault::HEALTHY => 0,
        "undecided" => 1,
        class if fault::CLASSES.contains(&class) => 3,
        _ => 2,
    };
    let mut words: Vec<&String> = words.into_iter().collect();
    words.sort_by_key(|word| (rank(word), *word));
    let of_word = words.iter().map(|word| format!(">{}", name(&word.replace('_', " "))));
    let heads: Vec<String> = [String::new()].into_iter().chain(of_word).collect();
    let row = |truth: &String| {
        let cell = |word: &&String| match counts.get(&(truth.clone(), (*word).clone())) {
            None | Some(0) => "·".to_owned(),
            Some(n) if truth == *word => format!("<b>{}</b>", thousands(*n)),
            Some(n) => thousands(*n),
        };
        Row::from([name(truth)].into_iter().chain(words.iter().map(cell)))
    };
    let meaning =
        "Rows: true; columns: said. A category stands where the class was not certain enough.";
    let table = table("", &heads, truths.into_iter().map(row));
    section("What was said of what", &(note(meaning) + &wide(&table)))
}

/// The reliability diagram of the stated certainties, with 95 % intervals, and a table by class.
fn reliability(report: &Report) -> String {
    let bins: Vec<(f64, f64, u64)> =
        report.calibration.bins.iter().copied().filter(|bin| bin.2 > 0).collect();
    if bins.is_empty() {
        return String::new();
    }
    let bars = bins.iter().flat_map(|&(stated, right, n)| {
        let [low, high] = wilson(right * n as f64, n as f64);
        [(stated, low), (stated, high)]
    });
    let off = 100.0 * report.calibration.ece;
    let figure = Figure::new(
        format!("Stated certainty is off by {off:.1} points on average (ECE)"),
        Axis::within(0.0, 1.0, "stated certainty of the best class"),
        Axis::within(0.0, 1.02, "share that is right"),
        vec![
            Series::new("", Mark::Line, vec![(0.0, 0.0), (1.0, 1.0)]),
            Series::new("", Mark::Bars, bars.collect()),
        ],
    );
    let of_class = report.calibration.by_class.iter().map(|(class, c)| {
        let [stated, right, ece] = [c.certainty, c.right, c.ece].map(|v| format!("{v:.3}"));
        [name(class), thousands(c.signals), stated, right, ece]
    });
    let heads = ["said", ">signals", ">certainty stated", ">right", ">off by (ECE)"];
    let parts = [
        note("Line: as it should be; bars: measured, 95 %."),
        drawn(&figure),
        table("", &heads, of_class),
    ];
    section("Reliability of certainties", &parts.concat())
}

/// The share of wrong classes against the share of signals that are kept, over all bounds.
fn risk(report: &Report, curves: &Curves) -> String {
    let points = curves.risk();
    if points.len() < 2 {
        return String::new();
    }
    let c = &report.certain;
    let (bound, kept, wrong) = (c.bound, 100.0 * c.coverage, 100.0 * (1.0 - c.accuracy));
    let figure = Figure::new(
        format!(
            "Certainty {bound} keeps {kept:.1} % of the named signals, {wrong:.2} % of them wrong"
        ),
        Axis::within(0.0, 1.0, "share kept, the most certain first"),
        Axis::new("share of these with the wrong class"),
        vec![
            Series::new("", Mark::Line, points),
            Series::new("", Mark::Dots, vec![(c.coverage, 1.0 - c.accuracy)]),
        ],
    );
    let meaning = note("Line: other bounds on certainty; dot: the bound that was used.");
    section("Risk against coverage", &(meaning + &drawn(&figure)))
}

/// A figure for each class: stated against true severities.
fn severities(report: &Report, curves: &Curves) -> String {
    let classes = curves.severities().filter(|(_, of)| of.len() > 1).take(MOST_CLASSES);
    let figure = |(class, points): (&str, &[(f64, f64)])| {
        let told = report.severity.get(class);
        let finding = told.map_or(String::new(), |s| {
            let covered = s.coverage95.map_or(String::new(), |share| {
                format!(", 95 % intervals hold {:.1} %", 100.0 * share)
            });
            format!(": root mean square error {:.4}{covered}", s.rmse)
        });
        let (low, high) = points
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), p| (a.min(p.0), b.max(p.0)));
        let title = format!("{class}, {}{finding}", fault::in_words(class));
        drawn(&Figure::new(
            title.chars().take(150).collect(),
            Axis::new(&format!("true {}", fault::quantity(class))),
            Axis::new("stated"),
            vec![
                Series::new("", Mark::Line, vec![(low, low), (high, high)]),
                Series::new("", Mark::Points, points.to_vec()),
            ],
        ))
    };
    let figures: String = classes.map(figure).collect();
    let meaning = note("Line: as it should be; dots: signals that were named as what they are.");
    match figures.is_empty() {
        true => figures,
        false => section("Severities, true and stated", &(meaning + &figures)),
    }
}
