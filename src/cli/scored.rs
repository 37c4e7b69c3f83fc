//! What `inkling score` says on a terminal.

use super::report::printable as name;
use crate::fault::HEALTHY;
use crate::score::episodes::EpisodesReport;
use crate::score::{Calibration, Report};
use std::io::Write;

/// A share of so many signals; of none there is none.
fn or_dash(of: u64, share: f64, digits: usize) -> String {
    if of == 0 { "-".into() } else { format!("{share:.digits$}") }
}

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

fn print_detection(report: &Report, out: &mut impl Write) -> std::io::Result<()> {
    let d = &report.detection;
    writeln!(out, "detection")?;
    writeln!(out, "  {:<24} {:>10} {:>10}", "", "healthy", "faulty")?;
    writeln!(out, "  {:<24} {:>10} {:>10}", "truly healthy, said:", d.tn, d.fp)?;
    writeln!(out, "  {:<24} {:>10} {:>10}", "truly faulty, said:", d.fn_, d.tp)?;
    writeln!(
        out,
        "  accuracy {:.4}, recall {}, false alarms {} of the healthy",
        d.accuracy(),
        or_dash(d.tp + d.fn_, d.recall(), 4),
        or_dash(d.tn + d.fp, d.false_alarm_rate(), 5)
    )?;
    writeln!(out, "  {:<10} {:>10} {:>10} {:>8}", "state", "signals", "flagged", "share")?;
    for (state, s) in &report.by_state {
        let share = s.flagged as f64 / s.signals.max(1) as f64;
        let what = if state == HEALTHY { "false alarms" } else { "recall" };
        let state = name(state);
        writeln!(out, "  {state:<10} {:>10} {:>10} {share:>8.4}  {what}", s.signals, s.flagged)?;
    }
    Ok(())
}

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
    writeln!(
        out,
        "  class right {:.4}, category right {:.4}",
        iso.accuracy, iso.category_accuracy
    )?;
    let c = &report.certain;
    writeln!(
        out,
        "  certainty >= {}: accuracy {:.4} on {:.1} % of them",
        c.bound,
        c.accuracy,
        100.0 * c.coverage
    )
}

fn print_calibration(calibration: &Calibration, out: &mut impl Write) -> std::io::Result<()> {
    write!(out, "calibration: ECE {:.4}", calibration.ece)?;
    match calibration.classwise_ece {
        Some(ece) => writeln!(out, ", class-wise {ece:.4}")?,
        None => writeln!(out, " (class-wise needs output.weights = true)")?,
    }
    writeln!(
        out,
        "  {:<10} {:>10} {:>8} {:>8} {:>8}",
        "said", "signals", "stated", "right", "ECE"
    )?;
    for (class, c) in &calibration.by_class {
        writeln!(
            out,
            "  {:<10} {:>10} {:>8.4} {:>8.4} {:>8.4}",
            name(class),
            c.signals,
            c.certainty,
            c.right,
            c.ece
        )?;
    }
    Ok(())
}

fn print_severity(report: &Report, out: &mut impl Write) -> std::io::Result<()> {
    writeln!(out, "severity (signals named as what they are)")?;
    writeln!(
        out,
        "  {:<14} {:>10} {:>10} {:>8} {:>16}",
        "class", "signals", "rmse", "R²", "within 1.96 sd"
    )?;
    let number = |v: Option<f64>| v.map_or("-".to_owned(), |v| format!("{v:.4}"));
    for (class, s) in report.severity.iter().chain(&report.severity_by_category) {
        let (r2, covered) = (number(s.r2), number(s.coverage95));
        writeln!(
            out,
            "  {:<14} {:>10} {:>10.5} {r2:>8} {covered:>16}",
            name(class),
            s.signals,
            s.rmse
        )?;
    }
    let all: f64 = report.severity.values().map(|s| s.signals as f64).sum();
    let covered = report.severity.values().map(|s| Some(s.signals as f64 * s.coverage95?));
    if let Some(covered) = covered.sum::<Option<f64>>() {
        writeln!(out, "  {:<14} {all:>10} {:>36.4}", "all", covered / all)?;
    }
    Ok(())
}

fn print_episodes(e: &EpisodesReport, out: &mut impl Write) -> std::io::Result<()> {
    let bursts = |v: Option<f64>| v.map_or("-".to_owned(), |v| format!("{v}"));
    writeln!(out, "episodes")?;
    writeln!(
        out,
        "  recall {:.4} of {}, {} false in {} healthy signals ({:.2} per million)",
        e.recall, e.faults, e.false_episodes, e.healthy_signals, e.false_per_million
    )?;
    writeln!(
        out,
        "  raised {} bursts after full size in the median, {} after the onset",
        bursts(e.delay_bursts),
        bursts(e.delay_from_onset_bursts)
    )?;
    writeln!(
        out,
        "  {:<10} {:>8} {:>8} {:>15} {:>12} {:>8}",
        "state", "faults", "found", "category right", "class right", "delay"
    )?;
    for (state, s) in &e.by_state {
        let delay = bursts(s.delay_bursts);
        writeln!(
            out,
            "  {:<10} {:>8} {:>8} {:>15} {:>12} {delay:>8}",
            name(state),
            s.faults,
            s.found,
            s.category_right,
            s.fault_right
        )?;
    }
    Ok(())
}
