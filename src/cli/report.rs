//! What a finished replay says: one line per printhead, and the faults with since when.

use super::progress::thousands;
use crate::fault;
use crate::pipeline::RecordingReport;
use crate::pipeline::tally::{FaultyChannel, PrintheadTally};
use chrono::DateTime;
use std::io::{self, Write};

/// Faulty channels listed per printhead; the rest is counted.
const MOST_LISTED: usize = 12;
/// Printheads listed.
const MOST_PRINTHEADS: usize = 256;
/// A channel that passed the gate in fewer bursts is counted, not listed: it may be chance.
const LEAST_BURSTS: u64 = 3;

pub fn print(report: &RecordingReport, classes: &[String], out: &mut impl Write) -> io::Result<()> {
    let counts = &report.tally.counts;
    writeln!(out, "{}", report.name)?;
    writeln!(
        out,
        "  {} signals in {} bursts, {} models, {:.1} s, {} signals/s",
        thousands(counts.signals),
        thousands(counts.bursts),
        report.models,
        report.seconds,
        thousands((counts.signals as f64 / report.seconds.max(1e-9)) as u64),
    )?;
    if let Some(behind) = report.behind {
        writeln!(
            out,
            "  replayed at the recorded pace, at most {:.3} s behind",
            behind.as_secs_f64()
        )?;
    }
    let rejected: u64 = counts.rejected.values().sum();
    if rejected > 0 {
        let each: Vec<String> =
            counts.rejected.iter().map(|(why, n)| format!("{} {why}", thousands(*n))).collect();
        writeln!(out, "  rejected: {}", each.join(", "))?;
    }
    writeln!(
        out,
        "  {:<20} {:>8} {:>10} {:>8}  faults (channel, since, bursts)",
        "printhead", "channels", "signals", "faulty"
    )?;
    let printheads = &report.tally.printheads;
    for (name, printhead) in printheads.iter().take(MOST_PRINTHEADS) {
        print_printhead(&printable(name), printhead, classes, out)?;
    }
    if printheads.len() > MOST_PRINTHEADS {
        writeln!(
            out,
            "  and {} printheads more",
            thousands((printheads.len() - MOST_PRINTHEADS) as u64)
        )?;
    }
    writeln!(out, "  verdicts: {}", report.verdicts.display())
}

fn print_printhead(
    name: &str,
    printhead: &PrintheadTally,
    classes: &[String],
    out: &mut impl Write,
) -> io::Result<()> {
    let share = 100.0 * printhead.passed as f64 / printhead.judged.max(1) as f64;
    write!(
        out,
        "  {name:<20} {:>8} {:>10} {share:>6.2} %",
        printhead.channels.len(),
        thousands(printhead.signals)
    )?;
    let mut lasting: Vec<(&u32, &FaultyChannel)> =
        printhead.faulty.iter().filter(|(_, f)| f.bursts >= LEAST_BURSTS).collect();
    if lasting.is_empty() {
        writeln!(out, "  none")?;
        return Ok(());
    }
    lasting.sort_by_key(|(channel, f)| (f.first_ns, **channel));
    for (i, (channel, f)) in lasting.iter().take(MOST_LISTED).enumerate() {
        let indent =
            if i == 0 { "" } else { "                                                    " };
        let named = f.classes.iter().max_by_key(|(class, n)| (**n, u16::MAX - **class));
        let (class, share) = match named {
            Some((class, n)) => (classes[*class as usize].as_str(), *n as f64 / f.bursts as f64),
            None => ("faulty, not named", 1.0),
        };
        let words = if share < 0.5 { "at best; mostly not named" } else { fault::in_words(class) };
        writeln!(
            out,
            "{indent}  {channel:>5}  {}  {:>5}  {class} ({words})",
            clock(f.first_ns),
            f.bursts
        )?;
    }
    if lasting.len() > MOST_LISTED {
        writeln!(out, "{:52}  and {} channels more", "", lasting.len() - MOST_LISTED)?;
    }
    Ok(())
}

fn clock(t_ns: i64) -> String {
    DateTime::from_timestamp_nanos(t_ns).format("%Y-%m-%d %H:%M:%S").to_string()
}

/// A name from a recording, without what could move a terminal's cursor.
pub fn printable(name: &str) -> String {
    name.chars().map(|c| if c.is_control() { '\u{fffd}' } else { c }).take(64).collect()
}
