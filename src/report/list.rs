//! The cleaning list on a terminal. In: a [`Report`]. Out: a line per channel, most urgent first.

use super::words::{clock, counted, counted_as};
use super::{Fault, Report, size, trend_in_words, what};
use std::io::{self, Write};

/// Lines of the list.
const MOST_LISTED: usize = 40;

/// `printable`: at most so many letters of a text, as the terminal may show them.
pub fn print(
    report: &Report,
    printable: impl Fn(&str, usize) -> String,
    out: &mut impl Write,
) -> io::Result<()> {
    let open: Vec<&Fault> = report.open().collect();
    let over = report.faults.len() - open.len();
    let recordings = counted(report.recordings.len() as u64, "recording");
    if open.is_empty() {
        writeln!(out, "nothing to clean after {recordings}")?;
    } else {
        let channels = counted(open.len() as u64, "channel");
        writeln!(out, "to clean after {recordings}: {channels}, most urgent first")?;
        writeln!(
            out,
            "  {:<20} {:>7}  {:<19}  {:<14} what",
            "printhead", "channel", "since", "do"
        )?;
    }
    for fault in open.iter().take(MOST_LISTED) {
        let story = &fault.story;
        let mut parts = vec![what(story), size(story), trend_in_words(story)];
        parts.push(match (story.ended_at_ns, story.cures) {
            (None, 0) => String::new(),
            (None, cures) => {
                format!("cured {} and back", counted_as(cures.into(), "once", "times"))
            }
            (_, cures) => {
                format!("healthy now, but came back {}", counted_as(cures.into(), "once", "times"))
            }
        });
        parts.retain(|part| !part.is_empty());
        writeln!(
            out,
            "  {:<20} {:>7}  {:<19}  {:<14} {}",
            printable(&story.printhead, 64),
            story.channel,
            clock(story.began_at_ns),
            printable(&fault.action, 64),
            printable(&parts.join("; "), 400)
        )?;
    }
    if open.len() > MOST_LISTED {
        writeln!(out, "  and {} channels more", open.len() - MOST_LISTED)?;
    }
    for group in report.groups.iter().take(MOST_LISTED) {
        writeln!(out, "  together: {}", printable(&group.sentence, 400))?;
    }
    if over > 0 {
        writeln!(out, "  {} over, healthy since", counted(over as u64, "fault"))?;
    }
    Ok(())
}
