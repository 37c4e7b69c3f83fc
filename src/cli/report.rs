//! The text that a finished replay prints about a recording: its counts, a line per printhead, and
//! fault episodes. In: the pipeline's [`RecordingReport`], from `judge`. Out: text for a terminal,
//! in which names from files are made harmless. (The page of `inkling report` is made elsewhere:
//! `report_page`.)

use super::progress::{counted, first_few, thousands};
use crate::pipeline::RecordingReport;
use crate::pipeline::tally::PrintheadTally;
use crate::report::{alike, channels, clock};
use inkling_core::episodes::{Counts, Episode};
use inkling_io::printable;
use std::io::{self, Write};

/// Most episodes that are listed per printhead; the rest is counted.
const MOST_LISTED: usize = 12;
/// Most printheads that are listed.
const MOST_PRINTHEADS: usize = 256;

/// How much is printed about a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Detail {
    /// All printheads and their episodes.
    All,
    /// The counts, and one line about what was flagged, for one of several recordings: the cleaning list at
    /// the end of the run names the channels.
    Line,
}

/// Prints the report of a recording.
pub fn print(report: &RecordingReport, detail: Detail, out: &mut impl Write) -> io::Result<()> {
    print_counts(report, out)?;
    match detail {
        Detail::All => print_printheads(report, out),
        Detail::Line => print_flagged(report, out),
    }
}

/// Prints the counts of signals and the speed, and what was rejected.
fn print_counts(report: &RecordingReport, out: &mut impl Write) -> io::Result<()> {
    let (counts, seconds) = (&report.tally.counts, report.seconds);
    let rate = (counts.signals as f64 / seconds.max(1e-9)) as u64;
    let (signals, bursts) = (counted(counts.signals, "signal"), counted(counts.bursts, "burst"));
    let rate = thousands(rate);
    writeln!(out, "{}", printable_path(&report.name))?;
    writeln!(out, "  {signals} in {bursts}, {seconds:.1} s, {rate} signals/s")?;
    if let Some(paced) = report.paced {
        let behind_s = paced.behind.as_secs_f64();
        writeln!(out, "  at the pace that was asked for, at most {behind_s:.3} s behind")?;
    }
    let rejected: u64 = counts.rejected.values().sum();
    if rejected > 0 {
        let each: Vec<String> =
            counts.rejected.iter().map(|(why, n)| format!("{} {why}", thousands(*n))).collect();
        writeln!(out, "  rejected: {}", each.join(", "))?;
    }
    Ok(())
}

/// Prints the share of flagged signals and the number of episodes of the whole recording.
fn print_flagged(report: &RecordingReport, out: &mut impl Write) -> io::Result<()> {
    let flagged: u64 = report.tally.printheads.values().map(|p| p.flagged).sum();
    let share = 100.0 * flagged as f64 / report.tally.counts.judged.max(1) as f64;
    let Counts { episodes, still_on, .. } = report.episodes.counts;
    if report.tally.counts.judged == 0 {
        return writeln!(out, "  nothing could be judged");
    }
    let (episodes, still_on) = (counted(episodes, "fault episode"), thousands(still_on));
    write!(out, "  flagged {share:.2} %, {episodes}, ")?;
    writeln!(out, "{still_on} of them still on at the end")
}

/// Prints a line per printhead with its episodes below it, and where the verdicts are.
fn print_printheads(report: &RecordingReport, out: &mut impl Write) -> io::Result<()> {
    writeln!(out, "  {:<20} {:>8} {:>10} {:>8}", "printhead", "channels", "signals", "flagged")?;
    let printheads = &report.tally.printheads;
    for (name, printhead) in printheads.iter().take(MOST_PRINTHEADS) {
        print_printhead(&printable(name), printhead, out)?;
        let of_it = report.episodes.listed.iter().filter(|e| e.printhead == *name);
        let mut of_it: Vec<&Episode> = of_it.collect();
        of_it.sort_by_key(|e| (e.channel, e.began_at_ns));
        print_episodes(&of_it, out)?;
    }
    if !report.episodes.listed.is_empty() {
        let words = "times UTC; ± one standard deviation; certainty: of that class, from 0 to 1";
        writeln!(out, "  {words}")?;
    }
    let more = printheads.len().saturating_sub(MOST_PRINTHEADS) as u64;
    if more > 0 {
        writeln!(out, "  and {} printheads more", thousands(more))?;
    }
    let counts = &report.episodes.counts;
    let left_out =
        counts.signals_too_late + counts.signals_at_one_time + counts.signals_beyond_limit;
    if left_out > 0 {
        let left_out = thousands(left_out);
        writeln!(out, "  {left_out} signals left out of the episodes: see its summary.json")?;
    }
    writeln!(out, "  verdicts: {}", printable::line(&report.verdicts.to_string_lossy(), 4096))
}

/// Prints the line of one printhead.
fn print_printhead(name: &str, printhead: &PrintheadTally, out: &mut impl Write) -> io::Result<()> {
    let share = 100.0 * printhead.flagged as f64 / printhead.judged.max(1) as f64;
    let flagged = match printhead.known() {
        0 => "not judged".to_owned(),
        _ => format!("{share:>6.2} %"),
    };
    // channels are counted as they are judged
    let channels = match (printhead.channels.len(), printhead.judged) {
        (0, _) | (_, 0) => "-".to_owned(),
        (channels, _) => thousands(channels as u64),
    };
    let signals = thousands(printhead.signals);
    writeln!(out, "  {name:<20} {channels:>8} {signals:>10} {flagged}")
}

/// Prints the episodes of a printhead: since when, until when, in how many bursts, and what was found.
fn print_episodes(episodes: &[&Episode], out: &mut impl Write) -> io::Result<()> {
    let lines = episodes.iter().map(|e| {
        let (since, bursts) = (clock(e.began_at_ns), thousands(e.bursts));
        let until = e.ended_at_ns.map_or("still on".to_owned(), clock);
        let begin = format!("channel {}: ", e.channel);
        let said = e.explanation.strip_prefix(&begin).unwrap_or(&e.explanation);
        let when = format!("{since} to {until:<19} {bursts:>7}");
        (e.channel, (when, printable::line(said, 1000)))
    });
    let lines = alike(lines)
        .into_iter()
        .map(|(of, (when, said))| format!("{when}  {}: {said}", channels(&of)));
    first_few(lines, MOST_LISTED, |more| format!("and {more} lines more"))
        .try_for_each(|line| writeln!(out, "    {line}"))
}

/// A name from a file, made safe for a terminal and cut.
pub fn printable(name: &str) -> String {
    printable::line(name, 64)
}

/// A path, made safe for a terminal and cut.
pub fn printable_path(path: &str) -> String {
    printable::line(path, 4096)
}
