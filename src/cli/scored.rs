//! The result of `inkling score` as text on a terminal. In: the figures that `inkling_lab::score`
//! computed ([`Report`]). Out: a block of text for each part: detection, isolation, calibration,
//! severity, episodes.

use super::report::printable as name;
use crate::report::{Column, columns};
use inkling_core::fault::HEALTHY;
use inkling_lab::score::episodes::EpisodesReport;
use inkling_lab::score::{Calibration, Report};
use std::io::Write;

/// A share with four decimals.
fn digits(share: f64) -> String {
    format!("{share:.4}")
}

/// A share of `of` signals with so many digits; a dash if there are no signals to be a share of.
fn or_dash(of: u64, share: f64, digits: usize) -> String {
    if of == 0 { "-".into() } else { format!("{share:.digits$}") }
}

/// Prints all parts of a score. Parts for which there is no data are left out.
pub fn print(report: &Report, out: &mut impl Write) -> std::io::Result<()> {
    print_detection(report, out)?;
    if report.isolation.confusion.iter().flatten().any(|&n| n > 0) {
        print_isolation(report, out)?;
        print_calibration(&report.calibration, out)?;
    }
    if !report.severity.is_empty() {
        print_severity(report, out)?;
    }
    if let Some(episodes) = &report.episodes {
        print_episodes(episodes, out)?;
    }
    writeln!(out, "{} unlabelled, {} rejected, not scored", report.unlabelled, report.rejected)
}

/// Prints the counts of detection, and the share of flagged signals by true state.
fn print_detection(report: &Report, out: &mut impl Write) -> std::io::Result<()> {
    let d = &report.detection;
    let recall = or_dash(d.tp + d.fn_, d.recall(), 4);
    let false_alarms = or_dash(d.tn + d.fp, d.false_alarm_rate(), 5);
    writeln!(out, "detection")?;
    writeln!(out, "  {:<24} {:>10} {:>10}", "", "healthy", "faulty")?;
    writeln!(out, "  {:<24} {:>10} {:>10}", "truly healthy, said:", d.tn, d.fp)?;
    writeln!(out, "  {:<24} {:>10} {:>10}", "truly faulty, said:", d.fn_, d.tp)?;
    write!(out, "  accuracy {:.4}, recall {recall}, ", d.accuracy())?;
    writeln!(out, "false alarms {false_alarms} of the healthy")?;
    let heads = [
        Column::Words("state", 10),
        Column::Number("signals", 10),
        Column::Number("flagged", 10),
        Column::Number("share", 8),
        Column::Last(""),
    ];
    let of_state = report.by_state.iter().map(|(state, s)| {
        let share = s.flagged as f64 / s.signals.max(1) as f64;
        let what = if state == HEALTHY { "false alarms" } else { "recall" };
        [name(state), s.signals.to_string(), s.flagged.to_string(), digits(share), what.into()]
    });
    columns(out, heads, of_state)
}

/// Prints the confusion matrix of the best class, its accuracy, and the accuracy of those signals
/// whose certainty reaches the bound.
fn print_isolation(report: &Report, out: &mut impl Write) -> std::io::Result<()> {
    let iso = &report.isolation;
    writeln!(out, "isolation (rows: truth, columns: best class)")?;
    write!(out, "  {:<6}", "")?;
    iso.classes.iter().try_for_each(|c| write!(out, " {:>7}", name(c)))?;
    writeln!(out)?;
    for (class, row) in iso.classes.iter().zip(&iso.confusion) {
        write!(out, "  {:<6}", name(class))?;
        row.iter().try_for_each(|n| write!(out, " {n:>7}"))?;
        writeln!(out)?;
    }
    let [class, category] = [iso.accuracy, iso.category_accuracy].map(digits);
    writeln!(out, "  class right {class}, category right {category}")?;
    let c = &report.certain;
    let (bound, accuracy, share) = (c.bound, digits(c.accuracy), 100.0 * c.coverage);
    writeln!(out, "  certainty >= {bound}: accuracy {accuracy} on {share:.1} % of them")
}

/// Prints how well stated certainties agree with the share that is right. ECE: expected calibration
/// error, the mean distance between the two over bins of the certainty.
fn print_calibration(calibration: &Calibration, out: &mut impl Write) -> std::io::Result<()> {
    write!(out, "calibration: ECE {:.4}", calibration.ece)?;
    match calibration.classwise_ece {
        Some(ece) => writeln!(out, ", class-wise {ece:.4}"),
        None => writeln!(out, " (class-wise needs output.weights = true)"),
    }
}

/// Prints the errors of severities, and how often their 95 % intervals (1.96 standard deviations)
/// hold the true severity: by class, by those categories that have one unit, and over all classes.
fn print_severity(report: &Report, out: &mut impl Write) -> std::io::Result<()> {
    writeln!(out, "severity (signals named as what they are)")?;
    let heads = [
        Column::Words("class", 14),
        Column::Number("signals", 10),
        Column::Number("rmse", 10),
        Column::Number("R²", 8),
        Column::Number("within 1.96 sd", 16),
    ];
    let all = report.severity.iter().chain(&report.severity_by_category);
    let of_class = all.map(|(class, s)| {
        let [r2, covered] = [s.r2, s.coverage95].map(|v| v.map_or("-".to_owned(), digits));
        [name(class), s.signals.to_string(), format!("{:.5}", s.rmse), r2, covered]
    });
    columns(out, heads, of_class)?;
    // the mean coverage over all classes, weighted by signals; none if a class has no intervals
    let all: f64 = report.severity.values().map(|s| s.signals as f64).sum();
    let covered = report.severity.values().map(|s| Some(s.signals as f64 * s.coverage95?));
    if let Some(covered) = covered.sum::<Option<f64>>() {
        writeln!(out, "  {:<14} {all:>10} {:>36.4}", "all", covered / all)?;
    }
    Ok(())
}

/// Prints how many labelled faults were found as episodes, and how many bursts late.
fn print_episodes(e: &EpisodesReport, out: &mut impl Write) -> std::io::Result<()> {
    let bursts = |v: Option<f64>| v.map_or("-".to_owned(), |v| v.to_string());
    let EpisodesReport { recall, faults, false_episodes, healthy_signals, .. } = e;
    writeln!(out, "episodes")?;
    write!(out, "  recall {recall:.4} of {faults}, {false_episodes} false in {healthy_signals} ")?;
    writeln!(out, "healthy signals ({:.2} per million)", e.false_per_million)?;
    let [full, onset] = [e.delay_bursts, e.delay_from_onset_bursts].map(bursts);
    writeln!(out, "  raised {full} bursts after full size in the median, {onset} after the onset")?;
    let heads = [
        Column::Words("state", 10),
        Column::Number("faults", 8),
        Column::Number("found", 8),
        Column::Number("category right", 15),
        Column::Number("class right", 12),
        Column::Number("delay", 8),
    ];
    let of_state = e.by_state.iter().map(|(state, s)| {
        let [faults, found, category, class] =
            [s.faults, s.found, s.category_right, s.fault_right].map(|n| n.to_string());
        [name(state), faults, found, category, class, bursts(s.delay_bursts)]
    });
    columns(out, heads, of_state)
}
