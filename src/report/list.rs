//! The cleaning list on a terminal, which `report` and `replay` print.
//!
//! In: a [`Report`]. Out: text: what was not judged and the notes, then one line for each fault
//! to see to, most urgent first, of all channels of which it says the same, then channels that are healthy again.

use super::acknowledged;
use super::coverage::Extent;
use super::fault::instead_in_words;
use super::words::{Column, alike, clock, columns, counted, counted_as, joined};
use super::{
    Fault, HeadChange, Report, certain_trend, forecast_in_words, size, trend_in_words, what,
};
use std::io::{self, Write};

/// Most lines of the list, and of the notes.
const MOST_LISTED: usize = 40;
/// Most channels that are named as healthy again.
const MOST_OVER: usize = 8;

/// Writes the list. `printable`: makes a text safe for the terminal and cuts it to a number of characters.
pub fn print(
    report: &Report,
    printable: impl Fn(&str, usize) -> String,
    out: &mut impl Write,
) -> io::Result<()> {
    let open: Vec<&Fault> = report.open().collect();
    let over = report.over().count();
    if let Some(first) = report.coverage.first() {
        writeln!(out, "{}", printable(&first, 2000))?;
    }
    let changes = report.head_changes.iter().filter(|of| of.is_of_last_night);
    for HeadChange { printhead, what, .. } in changes.take(MOST_LISTED) {
        writeln!(out, "{}: {}", printable(printhead, 64), printable(what, 600))?;
    }
    for note in report.notes.iter().take(MOST_LISTED) {
        writeln!(out, "note: {}", printable(&note.what, 600))?;
    }
    let recordings = counted(report.recordings.len() as u64, "recording");
    match report.coverage.extent() {
        _ if !open.is_empty() => to_clean(&open, &recordings, &printable, out)?,
        // the sentence about the coverage has said so
        Extent::NothingJudged => {}
        Extent::FaultsUnknown => {
            writeln!(out, "what is to be cleaned after {recordings} is not known")?;
        }
        Extent::Complete => writeln!(out, "nothing to clean after {recordings}")?,
        Extent::Partial => {
            writeln!(out, "what is known after {recordings} names no channel to clean")?;
        }
    }
    if over > 0 {
        let name = |fault: &Fault| {
            format!("{} {}", printable(&fault.story.printhead, 64), fault.story.channel)
        };
        let named: Vec<String> = report.over().take(MOST_OVER).map(name).collect();
        let more = if over > named.len() { ", ..." } else { "" };
        let channels = counted(over as u64, "channel");
        writeln!(out, "  {channels} healthy again: {}{more}", named.join(", "))?;
    }
    Ok(())
}

/// Writes the table of the channels to clean. `recordings`: their number, in words.
fn to_clean(
    open: &[&Fault],
    recordings: &str,
    printable: impl Fn(&str, usize) -> String,
    out: &mut impl Write,
) -> io::Result<()> {
    let channels = counted(open.len() as u64, "channel");
    let known = match open.iter().filter(|fault| fault.story.known.is_some()).count() {
        0 => String::new(),
        known => format!(" ({known} acknowledged as known)"),
    };
    writeln!(out, "to clean after {recordings}: {channels}{known}, most urgent first")?;
    let heads = [
        Column::Number("urgency", 7),
        Column::Words("printhead", 20),
        Column::Number("channel", 7),
        Column::Words("since", 20),
        Column::Words("do", 15),
        Column::Last("what"),
    ];
    let of_fault = open.iter().map(|fault| {
        let (urgency, story) = (format!("{:.2}", fault.urgency), &fault.story);
        let head = printable(&story.printhead, 64);
        let (action, what) = (printable(&fault.action, 64), printable(&in_words(fault), 400));
        (story.channel, [urgency, head, clock(story.began_at_ns), action, what])
    });
    let lines = alike(of_fault);
    let more = lines.len().saturating_sub(MOST_LISTED);
    let of_channels = |(channels, line): (String, [String; 5])| {
        let [urgency, head, since, action, what] = line;
        [urgency, head, channels, since, action, what]
    };
    columns(out, heads, lines.into_iter().take(MOST_LISTED).map(of_channels))?;
    if more > 0 {
        writeln!(out, "  and {} more", counted(more as u64, "line"))?;
    }
    Ok(())
}

/// The last column of a fault's line.
fn in_words(fault: &Fault) -> String {
    let story = &fault.story;
    let mut parts = vec![what(story), size(story)];
    parts.extend(instead_in_words(story));
    parts.extend(certain_trend(story).map(|_| trend_in_words(story)));
    parts.extend(forecast_in_words(story));
    let times = counted_as(story.cures.into(), "once", "times");
    parts.push(match (story.ended_at_ns, story.cures) {
        (None, 0) => String::new(),
        (None, _) => format!("cured {times} and back"),
        _ => format!("healthy now, but came back {times}"),
    });
    parts.extend(story.known.as_deref().map(acknowledged::in_words));
    if !fault.earlier.is_empty() {
        let n = counted(fault.earlier.len() as u64, "other fault");
        parts.push(format!("{n} before it"));
    }
    joined(parts, "; ")
}
