//! The report's tables. In: a [`Report`]. Out: markup.

use super::fault::{Fault, size, trend_in_words, what};
use super::words::{clock, counted, counted_as, percent, thousands};
use super::{RecordingLine, Report};
use crate::episodes::share;
use crate::plot::page::{escaped, name};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::sync::Arc;

/// Rows of a list; the rest is in `report.faults.parquet`.
const MOST_FAULTS: usize = 300;
/// Recordings, the newest.
const MOST_RECORDINGS: usize = 400;
/// Printheads with a column of their own: those with most faults.
const MOST_COLUMNS: usize = 12;
/// Earlier faults of a channel.
const MOST_BOUTS: usize = 4;
/// Letters of a recording's damage.
const MOST_OF_DAMAGE: usize = 200;

/// The cleaning list, or the faults that are over.
pub fn faults(list: &[&Fault], with_action: bool) -> String {
    let (action, change, last) = match with_action {
        true => ("<th class=n>urgency</th><th>do</th>", "<th>change</th>", ""),
        false => ("", "", "<th>healthy since (UTC)</th>"),
    };
    let mut text = format!(
        "<div class=\"wide\"><table><tr><th class=n>#</th><th>printhead</th><th class=n>channel</th>\
         {action}<th>what</th><th>how bad</th>{change}<th>since (UTC)</th><th>episodes</th>\
         <th class=n>certainty</th>{last}</tr>\n"
    );
    for (k, fault) in list.iter().take(MOST_FAULTS).enumerate() {
        let s = &fault.story;
        let (mut action, mut change, mut last): (String, String, String) = Default::default();
        if with_action {
            action = format!(
                "<td class=n>{:.2}</td><td><b>{}</b></td>",
                fault.urgency,
                escaped(&fault.action)
            );
            change = format!("<td class=w>{}</td>", or_dash(escaped(&trend_in_words(s))));
        } else {
            last = format!("<td class=t>{}</td>", s.ended_at_ns.map(clock).unwrap_or_default());
        }
        let _ = writeln!(
            text,
            "<tr><td class=n>{}</td>{}<td class=n>{}</td>{action}<td class=w>{}</td><td class=w>{}</td>{change}\
             <td class=t>{}</td><td class=h>{}</td><td class=n>{}</td>{last}</tr>",
            k + 1,
            name_cell(&s.printhead),
            s.channel,
            escaped(&what(s)),
            or_dash(escaped(&size(s))),
            clock(s.began_at_ns),
            escaped(&history(fault)),
            s.certainty.map_or("–".into(), share),
        );
    }
    text += "</table></div>\n";
    if list.len() > MOST_FAULTS {
        let more = thousands((list.len() - MOST_FAULTS) as u64);
        let _ = writeln!(text, "<p>And {more} more in <code>report.faults.parquet</code>.</p>");
    }
    text
}

fn or_dash(text: String) -> String {
    if text.is_empty() { "–".into() } else { text }
}

/// `28 in 28 recordings, still on`; cures shown as cures.
fn history(fault: &Fault) -> String {
    let s = &fault.story;
    let episodes = thousands(s.spells.len() as u64);
    let mut text = format!("{episodes} in {}", counted(s.recordings.into(), "recording"));
    if s.cures > 0 {
        text += &format!(", cured {}", counted_as(s.cures.into(), "once", "times"));
    }
    text += match (s.ended_at_ns, s.cures) {
        (None, 0) => "; still on",
        (None, _) => "; on again",
        (Some(_), 0) => "",
        (Some(_), _) => "; healthy now",
    };
    for bout in fault.earlier.iter().rev().take(MOST_BOUTS) {
        let until = bout.to_ns.map_or(String::new(), |to| format!(" to {}", clock(to)));
        text += &format!("; before it {} from {}{until}", bout.what, clock(bout.from_ns));
    }
    if fault.earlier.len() > MOST_BOUTS {
        let more = (fault.earlier.len() - MOST_BOUTS) as u64;
        text += &format!("; and {} more", counted(more, "earlier fault"));
    }
    text
}

/// Short names in one line.
fn name_cell(text: &str) -> String {
    const SHORT: usize = 24;
    let class = if text.chars().count() <= SHORT { " class=t" } else { "" };
    format!("<td{class}>{}</td>", name(text))
}

/// Recordings down, printheads across: faulty channels and flagged share; then the data's quality.
pub fn recordings(report: &Report) -> String {
    let columns = columns(report);
    let mut text = String::from(
        "<div class=\"wide\"><table><tr><th>recording</th><th>from (UTC)</th><th class=n>judged</th>",
    );
    for column in &columns {
        let _ = write!(text, "<th class=n>{}</th>", name(column));
    }
    text += "<th>data quality</th></tr>\n";
    let from = report.recordings.len().saturating_sub(MOST_RECORDINGS);
    for line in &report.recordings[from..] {
        let _ = write!(
            text,
            "<tr>{}<td class=t>{}</td><td class=n>{}</td>",
            name_cell(&line.name),
            line.from_ns.map_or("–".into(), clock),
            thousands(line.judged)
        );
        for column in &columns {
            let _ = match line.heads.get(column) {
                None => write!(text, "<td class=n>–</td>"),
                Some(h) => write!(
                    text,
                    "<td class=n><b>{}</b> · {}</td>",
                    h.faulty_channels,
                    percent(h.flagged, h.judged)
                ),
            };
        }
        let _ = writeln!(text, "<td>{}</td></tr>", escaped(&quality(line)));
    }
    text += "</table></div>\n";
    if from > 0 {
        let _ = writeln!(
            text,
            "<p>The newest {MOST_RECORDINGS}; {} before them.</p>",
            thousands(from as u64)
        );
    }
    let left_out = heads(report) - columns.len();
    if left_out > 0 {
        let _ = writeln!(
            text,
            "<p>The printheads with most faults; {} more have no column.</p>",
            counted(left_out as u64, "printhead")
        );
    }
    text
}

fn heads(report: &Report) -> usize {
    report.survey.heads.iter().filter(|head| !head.tallies.is_empty()).count()
}

/// Of a few printheads all, by name; of many those with most faults.
fn columns(report: &Report) -> Vec<Arc<str>> {
    let mut faults: BTreeMap<&Arc<str>, usize> = BTreeMap::new();
    report.faults.iter().for_each(|f| *faults.entry(&f.story.printhead).or_default() += 1);
    let heads = report.survey.heads.iter().filter(|head| !head.tallies.is_empty());
    let mut names: Vec<Arc<str>> = heads.map(|head| head.name.clone()).collect();
    names.sort_by_key(|n| (std::cmp::Reverse(faults.get(n).copied().unwrap_or(0)), n.clone()));
    names.truncate(MOST_COLUMNS);
    names.sort();
    names
}

/// What is wrong with a recording; `whole` where nothing is.
fn quality(line: &RecordingLine) -> String {
    let mut parts: Vec<String> =
        line.rejected.iter().map(|(why, n)| format!("{} {why}", thousands(*n))).collect();
    if let Some((expected, found)) = line.expected.zip(line.bursts)
        && expected > found
    {
        parts.push(format!("{} of {} bursts found", thousands(found), thousands(expected)));
    }
    if let Some(first) = line.damage.first() {
        let first: String = first.chars().take(MOST_OF_DAMAGE).collect();
        parts.push(match line.damage.len() {
            1 => format!("damaged: {first}"),
            n => format!("damaged in {n} places: {first}"),
        });
    }
    parts.extend(line.missing.iter().map(|what| format!("no {what} file")));
    if parts.is_empty() { "whole".into() } else { parts.join("; ") }
}
