//! The tables of the page: the cleaning list, the faults that are over, and the recordings.
//!
//! In: a [`Report`], and which figures and maps were drawn. Out: HTML, for `page`. The cleaning
//! list can be sorted in four ways without a script: each row carries its rank under each order as
//! a CSS variable (`--a` to `--d`), and the style sheet sorts rows by the variable whose button is
//! checked.

use super::fault::{Fault, forecast_in_words, size, trend_in_words, what};
use super::light::Light;
use super::words::{clock, counted, counted_as, percent, thousands};
use super::{HeadCount, RecordingLine, Report};
use inkling_core::episodes::share;
use inkling_lab::plot::page::{escaped, name};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::sync::Arc;

/// Most rows of a list of faults; all faults are in `report.faults.parquet`.
const MOST_FAULTS: usize = 300;
/// Most recordings in the table, the newest ones.
const MOST_RECORDINGS: usize = 400;
/// Most printheads with a column of their own: those with the most faults.
const MOST_COLUMNS: usize = 12;
/// Most earlier faults of a channel that are listed.
const MOST_BOUTS: usize = 4;
/// Most characters of the text about a recording's damage or loss.
const MOST_OF_DAMAGE: usize = 200;

/// The parts of the page that a list can link to.
#[derive(Debug, Default)]
pub struct LinkTargets {
    /// Faults whose size over time is drawn, by their indices in the report.
    pub trends: BTreeSet<usize>,
    /// The number of the map of each printhead that has one.
    pub maps: BTreeMap<Arc<str>, usize>,
}

/// Ways to sort the cleaning list, in the order of its buttons.
const SORTED_BY: [&str; 4] =
    ["most urgent first", "by printhead and channel", "newest first", "by what it is"];

/// The cleaning list with its buttons. `list`: the faults to clean, the most urgent first.
pub fn to_clean(report: &Report, list: &[&Fault], drawn: &LinkTargets) -> String {
    let shown = &list[..list.len().min(MOST_FAULTS)];
    let mut text = String::from("<div>");
    for (k, words) in SORTED_BY.iter().enumerate() {
        let checked = if k == 0 { " checked" } else { "" };
        let _ = write!(
            text,
            "<input class=\"by\" type=\"radio\" name=\"by\" id=\"by{k}\"{checked}><label for=\"by{k}\">{words}</label>"
        );
    }
    text += "<table class=\"list cards\"><tr class=\"head\"><th></th><th>channel</th><th>do</th><th>what</th>\
             <th>since (UTC)</th><th>certainty</th></tr>\n";
    let by_place = ranks(shown, |f| (f.story.printhead.clone(), f.story.channel));
    let newest = ranks(shown, |f| std::cmp::Reverse(f.story.began_at_ns));
    let by_what = ranks(shown, |f| (f.story.category.is_none(), what(&f.story)));
    for (k, fault) in shown.iter().enumerate() {
        let order = [k, by_place[k], newest[k], by_what[k]];
        text += &row(report, fault, drawn, Some(order));
    }
    text += "</table></div>\n";
    text + &more(list)
}

/// The table of the faults that are over.
pub fn over(report: &Report, list: &[&Fault], drawn: &LinkTargets) -> String {
    let mut text = String::from(
        "<table class=\"list cards\"><tr class=\"head\"><th></th><th>channel</th><th>healthy since (UTC)</th>\
         <th>what it was</th><th>from (UTC)</th><th>certainty</th></tr>\n",
    );
    list.iter().take(MOST_FAULTS).for_each(|fault| text += &row(report, fault, drawn, None));
    text + "</table>\n" + &more(list)
}

/// The line below a list that was cut.
fn more(list: &[&Fault]) -> String {
    match list.len().saturating_sub(MOST_FAULTS) {
        0 => String::new(),
        n => format!(
            "<p>And {} more in <code>report.faults.parquet</code>.</p>\n",
            thousands(n as u64)
        ),
    }
}

/// The rank of each fault, by its place in `list`, when the list is sorted by a key. Faults with
/// equal keys keep their order.
fn ranks<K: Ord>(list: &[&Fault], key: impl Fn(&Fault) -> K) -> Vec<usize> {
    let mut places: Vec<usize> = (0..list.len()).collect();
    places.sort_by_key(|&place| key(list[place]));

    // `places` says which fault has a rank; turn it round to which rank a fault has.
    let mut ranks = vec![0; list.len()];
    places.into_iter().enumerate().for_each(|(rank, place)| ranks[place] = rank);
    ranks
}

/// A fault's row. `order`: its rank under each order of the cleaning list; `None` for a fault that
/// is over, which has another third column and tells no trend.
fn row(report: &Report, fault: &Fault, drawn: &LinkTargets, order: Option<[usize; 4]>) -> String {
    let (s, light) = (&fault.story, Light::of(fault));
    let place = place(report, fault);
    let [a, b, c, d] = order.unwrap_or_default();
    let style = match order {
        Some(_) => format!(" style=\"--a:{a};--b:{b};--c:{c};--d:{d}\""),
        None => String::new(),
    };
    let action = match order {
        Some(_) => format!(
            "<b>{}</b><br><span class=\"small\">urgency {:.2}</span>",
            escaped(&fault.action),
            fault.urgency
        ),
        None => s.ended_at_ns.map(clock).unwrap_or_default(),
    };
    let done = if order.is_some() { "do" } else { "healthy since" };
    let mut is = escaped(&what(s));
    let trend = if order.is_some() { trend_in_words(s) } else { String::new() };
    for more in [size(s), trend, forecast_in_words(s).unwrap_or_default()] {
        if !more.is_empty() {
            let _ = write!(is, "<br><span class=\"small\">{}</span>", escaped(&more));
        }
    }
    format!(
        "<tr id=\"r{place}\"{style}><td>{}{}</td><td data-l=\"channel\">{}</td><td data-l=\"{done}\">{action}</td>\
         <td data-l=\"what\">{is}</td><td data-l=\"since\">{}<br><span class=\"small\">{}</span></td>\
         <td data-l=\"certainty\">{}</td></tr>\n",
        light.dot(),
        light.word(),
        whose(fault, place, drawn),
        clock(s.began_at_ns),
        escaped(&history(fault)),
        s.certainty.map_or("–".into(), share),
    )
}

/// Index of a fault in the report. The fault is found by its address, so `fault` must be borrowed
/// from the report.
pub fn place(report: &Report, fault: &Fault) -> usize {
    report.faults.iter().position(|other| std::ptr::eq(other, fault)).unwrap_or_default()
}

/// Printhead and channel of a fault, with links to its map and to the figure of its size.
fn whose(fault: &Fault, place: usize, drawn: &LinkTargets) -> String {
    let s = &fault.story;
    let mut text = format!("{} <b>{}</b>", name(&s.printhead), s.channel);
    if let Some(map) = drawn.maps.get(&s.printhead) {
        let _ = write!(text, "<br><span class=\"small\"><a href=\"#m{map}\">map</a></span>");
    }
    if drawn.trends.contains(&place) {
        let _ =
            write!(text, " <span class=\"small\"><a href=\"#t{place}\">size over time</a></span>");
    }
    text
}

/// The history of a fault, `28 in 28 recordings; still on`: the number of episodes and recordings,
/// cures, and the channel's earlier faults.
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

/// The cell of a recording's name, with the recording's light; a short name is not broken over
/// lines.
fn name_cell(light: Light, text: &str) -> String {
    const SHORT: usize = 24;
    let class = if text.chars().count() <= SHORT { " class=t" } else { "" };
    format!("<td{class}>{}{}</td>", light.dot(), name(text))
}

/// The light of a recording: grey if most of it was not judged, green if nothing is wrong with its
/// data, else amber.
fn light(line: &RecordingLine) -> Light {
    let rejected: u64 = line.heads.values().map(|head| head.tally.rejected).sum();
    match quality(line) {
        _ if line.judged < rejected || line.judged == 0 => Light::Grey,
        words if words == WHOLE => Light::Green,
        _ => Light::Amber,
    }
}

/// What `quality` says of a recording with which nothing is wrong.
const WHOLE: &str = "whole";

/// The table of recordings, the newest ones last, and below them those without verdicts. Each
/// printhead has a column with the number of faulty channels and the share of flagged signals; the
/// last column tells the quality of the data.
pub fn recordings(report: &Report) -> String {
    let (columns, left_out) = columns(report);
    let mut text = String::from(
        "<div class=\"wide\"><table class=\"cards\"><tr class=\"head\"><th>recording</th><th>from (UTC)</th><th class=n>judged</th>",
    );
    for column in &columns {
        let _ = write!(text, "<th class=n>{}</th>", name(column));
    }
    text += "<th>data quality</th></tr>\n";
    let from = report.recordings.len().saturating_sub(MOST_RECORDINGS);
    for line in &report.recordings[from..] {
        let _ = write!(
            text,
            "<tr>{}<td class=t data-l=\"from\">{}</td><td class=n data-l=\"judged\">{}</td>",
            name_cell(light(line), &line.name),
            line.span.map_or("–".into(), |(from, _)| clock(from)),
            thousands(line.judged)
        );
        for column in &columns {
            let cell = match line.heads.get(column) {
                None => "–".into(),
                Some(HeadCount { tally, .. }) if tally.judged == 0 => "not judged".into(),
                Some(HeadCount { tally, faulty_channels }) => {
                    format!("<b>{faulty_channels}</b> · {}", percent(tally.flagged, tally.judged))
                }
            };
            let _ = write!(text, "<td class=n data-l=\"{}\">{cell}</td>", name(column));
        }
        let _ = writeln!(text, "<td data-l=\"data\">{}</td></tr>", escaped(&quality(line)));
    }
    for lost in report.coverage.lost.iter().take(MOST_RECORDINGS) {
        let _ = writeln!(
            text,
            "<tr>{}<td class=t data-l=\"from\">–</td><td class=n data-l=\"judged\">0</td>{}\
             <td data-l=\"data\">not judged: {}</td></tr>",
            name_cell(Light::Grey, &lost.name),
            "<td class=n>–</td>".repeat(columns.len()),
            escaped(&lost.why.chars().take(MOST_OF_DAMAGE).collect::<String>())
        );
    }
    text += "</table></div>\n";
    if from > 0 {
        let _ = writeln!(
            text,
            "<p>The newest {MOST_RECORDINGS}; {} before them.</p>",
            thousands(from as u64)
        );
    }
    if left_out > 0 {
        let _ = writeln!(
            text,
            "<p>The printheads with most faults; {} more have no column.</p>",
            counted(left_out as u64, "printhead")
        );
    }
    text
}

/// The printheads that have a column, by name: all of them, or those with the most faults if there
/// are too many; and the number of those without a column.
fn columns(report: &Report) -> (Vec<Arc<str>>, usize) {
    let mut faults: BTreeMap<&Arc<str>, usize> = BTreeMap::new();
    report.faults.iter().for_each(|f| *faults.entry(&f.story.printhead).or_default() += 1);
    let heads = report.survey.heads.iter().filter(|head| !head.tallies.is_empty());
    let mut names: Vec<Arc<str>> = heads.map(|head| head.name.clone()).collect();
    names.sort_by_key(|n| (std::cmp::Reverse(faults.get(n).copied().unwrap_or(0)), n.clone()));
    let left_out = names.len().saturating_sub(MOST_COLUMNS);
    names.truncate(MOST_COLUMNS);
    names.sort();
    (names, left_out)
}

/// What is wrong with the data of a recording, in words; [`WHOLE`] if nothing is.
fn quality(line: &RecordingLine) -> String {
    let mut parts: Vec<String> =
        line.rejected.iter().map(|(why, n)| format!("{} {why}", thousands(*n))).collect();
    if let Some((expected, found)) = line.expected.zip(line.bursts)
        && expected > found
    {
        parts.push(format!("{} of {} bursts found", thousands(found), thousands(expected)));
    }
    if line.damaged_places > 0 {
        let first = line.damage.as_deref().unwrap_or_default();
        let first: String = first.chars().take(MOST_OF_DAMAGE).collect();
        parts.push(match line.damaged_places {
            1 => format!("damaged: {first}"),
            n => format!("damaged in {} places: {first}", thousands(n)),
        });
    }
    parts.extend(line.missing.iter().map(|what| format!("no {what} file")));
    if parts.is_empty() { WHOLE.into() } else { parts.join("; ") }
}
