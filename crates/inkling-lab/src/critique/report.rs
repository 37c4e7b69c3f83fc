//! The critique as one page for a reader.
//!
//! In: a [`Critique`]. Out: the text of `report.html`. The page is self-contained: its figures are SVG, and
//! it loads nothing and runs nothing. Every text that may come from outside is escaped, since names in a
//! recording may be anything. The page must never compute a finding of its own.

use super::finding::{
    Cause, Critique, Detection, FAULT, Gain, GainFigures, HeldOut, Mode, NotTestable, Verdict,
};
use super::pictures;
use crate::plot::digits::{chance, measured, short, significant};
use crate::plot::page::{escaped, list, note, page, section, sentence, table};

/// Explains the columns of the causes' table. The counts of recordings are those of `docs/design/measured.md`.
const OF_CAUSES: &str = "Strength in DL, detection limits: 1 DL is the size at which a test of this one \
    effect alone would find it in 90 of 100 recordings. Among all candidates it was found in 33 of 64 \
    simulated recordings at 1 DL, in 157 of 157 from 2 DL on. Delta BIC, Bayesian information criterion \
    without the cause minus with it: twice the gain in log-likelihood, less a price for each parameter; 10 \
    is strong evidence. Gain per held-out signal: how much larger the logarithm of its probability is by a \
    model with this cause than by one without it, with its 95 % interval; where that reaches below 0, the \
    cause is there and not worth modelling. Matters for detection: yes where nozzle faults are found better with the extension, \
    and the cause is one that moves signals by themselves, not all of them alike.";

const OF_GAIN: &str = "Misfit: measured minus simulated. Chi² per degree of freedom: its mean square over \
    what noise and the scatter of channels allow. NRMSE: root of its mean square over the signal's. AUC, \
    area under the ROC curve: the chance that a signal with a small nozzle fault (damping off by FAULT_SD \
    standard deviations of healthy channels, put into held-out signals) looks more faulty than a healthy \
    one; 0.5 is guessing, 1 never wrong. Threshold: meant for 1 % of healthy signals of channels never heard.";

pub fn html(c: &Critique) -> String {
    let signals = &c.signals;
    let used = format!(
        "{} of {} signals used, of {} channels; {} left out as outliers, {} rejected.",
        signals.used, signals.found, signals.channels, signals.outliers, signals.rejected
    );
    let parts = [
        format!("<h1>Model critique: {}</h1>\n", c.verdict.as_str()),
        sentence(&c.sentence),
        note(&used),
        causes(c),
        plant(c),
        section("What remains, and what would settle it", &list(lines(&c.remarks))),
        equation(c),
        gain(&c.gain),
        pictures::drawn(&c.figures),
        section("Not testable on these recordings", &list(lines(&grouped(&c.not_testable)))),
    ];
    page("Model critique", &parts.concat())
}

fn in_brackets([low, high]: [f64; 2]) -> String {
    format!(" [{}, {}]", short(low), short(high))
}

fn causes(c: &Critique) -> String {
    if c.causes.is_empty() {
        return String::new();
    }
    let title = match c.verdict {
        Verdict::Unknown => "The nearest names, which do not explain it",
        Verdict::Tie => "One of these",
        _ => "What it is",
    };
    // the same in each of them
    let explained = c.causes.iter().find_map(|cause| cause.explains);
    let explained = explained
        .map(|share| format!("<p>That explains {} % of it.</p>\n", short(100.0 * share)))
        .unwrap_or_default();
    let row = |cause: &Cause| {
        let mut name = format!("<b>{}</b>", cause.id);
        if cause.is_tied() {
            name += &format!("<br>or {}", escaped(&cause.tied_words()));
        }
        let worth = c.gain.worth(cause.id).map_or("not measured".into(), |worth| {
            format!("{}{}", short(worth.gain), in_brackets(worth.ci95))
        });
        [
            name,
            escaped(&cause.parameter),
            escaped(&c.measured(cause)),
            format!("{} DL", significant(cause.strength_dl, 2)),
            short(cause.delta_bic),
            worth,
            match (cause.matters_for_detection, c.gain.detection()) {
                (true, _) => "yes".into(),
                (false, Detection::NotMeasured) => "–".into(),
                (false, _) => "no".into(),
            },
        ]
    };
    let heads = [
        "cause",
        "parameter",
        ">value (95 % interval)",
        ">strength",
        ">delta BIC",
        ">gain per held-out signal",
        "matters for detection",
    ];
    [
        format!("<h2>{title}</h2>\n{explained}"),
        table("", &heads, c.causes.iter().map(row)),
        note(OF_CAUSES),
    ]
    .concat()
}

fn lines(all: &[String]) -> impl Iterator<Item = String> {
    all.iter().map(|line| escaped(line))
}

/// The modes of an oscillator.
fn plant(c: &Critique) -> String {
    let Some(plant) = &c.plant else { return String::new() };
    let row = |mode: &Mode| {
        [
            escaped(&measured(mode.frequency_hz, mode.ci95, "Hz")),
            short(mode.damping_per_s),
            format!("{} %", short(100.0 * mode.share)),
        ]
    };
    let heads = [">frequency (95 % interval)", ">damping, 1/s", ">share of the movement's square"];
    format!("<h2>What rings</h2>\n{}", table("", &heads, plant.modes.iter().map(row)))
}

fn equation(c: &Critique) -> String {
    if c.equation.is_empty() {
        return String::new();
    }
    let heading = if c.causes.is_empty() { "The model" } else { "The extended model" };
    let as_a_design = c.extended_model.as_ref().map(|name| {
        format!(
            "<p>As a design: <code>{}</code>, for <code>inkling replay --design</code>.</p>\n",
            escaped(name)
        )
    });
    format!(
        "<h2>{heading}</h2>\n<pre class=\"wide\">{}</pre>\n{}",
        escaped(&c.equation),
        as_a_design.unwrap_or_default()
    )
}

/// A row of the gain's table: name, value, and the value's interval.
type GainRow = (&'static str, fn(&GainFigures) -> f64, fn(&GainFigures) -> Option<[f64; 2]>);

const GAIN_ROWS: [GainRow; 6] = [
    ("chi² per degree of freedom (1: right)", |g| g.chi2_per_dof, |g| g.chi2_per_dof_interval),
    ("misfit, % of the signal (NRMSE)", |g| g.nrmse_percent, |g| g.nrmse_percent_interval),
    (WHITENESS, |g| g.whiteness_p, |_| None),
    ("detection threshold", |g| g.threshold, |_| None),
    ("false alarms, share of the healthy", |g| g.false_alarms, |g| g.false_alarms_interval),
    ("detection of a small fault, AUC", |g| g.detection_auc, |g| g.detection_auc_interval),
];

/// The table of gains; a single column where nothing was extended, without rows that were not measured.
fn gain(gain: &Gain) -> String {
    let (held, before, after) = (&gain.held_out, &gain.before, &gain.after);
    if held.signals == 0 {
        return String::new();
    }
    let is_measured = |row: &&GainRow| !(row.1(before).is_nan() && row.1(after).is_nan());
    let rows = || GAIN_ROWS.iter().filter(is_measured);
    let one = rows().all(|row| row.1(after).is_nan() || row.1(after) == row.1(before));
    let cell = |(name, value, interval): &GainRow, g: &GainFigures| {
        let text = if *name == WHITENESS { chance(value(g)) } else { short(value(g)) };
        escaped(&(text + &interval(g).map(in_brackets).unwrap_or_default()))
    };
    let (heading, heads) = match one {
        true => ("How well the model predicts", &["", ">on these signals"][..]),
        false => ("What the extension buys", &["", ">before", ">after"][..]),
    };
    let shown = &[before, after][..heads.len() - 1];
    let row = |row: &GainRow| {
        let cells = shown.iter().map(|figures| cell(row, figures));
        std::iter::once(row.0.to_owned()).chain(cells).collect::<Vec<_>>()
    };
    [
        format!("<h2>{heading}</h2>\n"),
        note(&held_out(held)),
        note(&OF_GAIN.replace("FAULT_SD", &FAULT.to_string())),
        table("", heads, rows().map(row)),
    ]
    .concat()
}

const WHITENESS: &str = "chance that white noise looks like the misfit, p";

/// How the signals were held out that the gain is measured on.
fn held_out(held: &HeldOut) -> String {
    if held.by.starts_with("time:") {
        return format!(
            "On {} decays that nothing was fitted to in part (by {}); in brackets 95 % intervals.",
            held.signals, held.by
        );
    }
    format!(
        "On {} signals of {} channels that nothing was fitted to (by {}; the models were fitted to {} \
         signals of {} channels); in brackets 95 % intervals.",
        held.signals, held.channels, held.by, held.fitted_signals, held.fitted_channels
    )
}

/// One line per reason why causes could not be tested, in the order in which reasons first come.
pub fn grouped(not_testable: &[NotTestable]) -> Vec<String> {
    let mut groups: Vec<(&str, Vec<&str>)> = Vec::new();
    for n in not_testable {
        match groups.iter_mut().find(|(needs, _)| *needs == n.needs) {
            Some((_, names)) => names.push(n.id.name()),
            None => groups.push((&n.needs, vec![n.id.name()])),
        }
    }
    let line = |(needs, names): (&str, Vec<&str>)| {
        let verb = if names.len() == 1 { "needs" } else { "need" };
        format!("{} {verb} {needs}", names.join(", "))
    };
    groups.into_iter().map(line).collect()
}

#[cfg(test)]
#[path = "report_tests.rs"]
mod tests;
