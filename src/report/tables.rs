//! The tables of the page: the cleaning list, the faults that are over, and the recordings.
//!
//! In: a [`Report`], and which figures and maps were drawn. Out: HTML, for `page`. The cleaning
//! list can be sorted in four ways without a script: each row carries its rank under each order as
//! a CSS variable (`--a` to `--d`), and the style sheet sorts rows by the variable whose button is
//! checked.

use super::acknowledged;
use super::fault::{Fault, forecast_in_words, instead_in_words, size, trend_in_words, what};
use super::light::Light;
use super::source::MOST_OF_DAMAGE;
use super::words::{clock, counted, counted_as, percent, thousands};
use super::{HeadCount, RecordingLine, Report};
use inkling_core::episodes::share;
use inkling_lab::plot::page::{Row, escaped, name, table, wide};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// Most rows of a list of faults; all faults are in `report.faults.parquet`.
const MOST_FAULTS: usize = 300;
/// Most recordings in the table, the newest ones.
const MOST_RECORDINGS: usize = 400;
/// Most printheads with a column of their own: those with the most faults.
const MOST_COLUMNS: usize = 12;
/// Most earlier faults of a channel that are listed.
const MOST_EARLIER: usize = 4;

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
        text += &format!(
            "<input class=\"by\" type=\"radio\" name=\"by\" id=\"by{k}\"{checked}><label for=\"by{k}\">{words}</label>"
        );
    }
    let by_place = ranks(shown, |f| (f.story.printhead.clone(), f.story.channel));
    let newest = ranks(shown, |f| std::cmp::Reverse(f.story.began_at_ns));
    let by_what = ranks(shown, |f| (f.story.category.is_none(), what(&f.story)));
    let row = |(k, fault): (usize, &&Fault)| {
        row(report, fault, drawn, Some([k, by_place[k], newest[k], by_what[k]]))
    };
    let heads = ["", "channel", "do", "what", "since (UTC)", "certainty"];
    text + &table("list cards", &heads, shown.iter().enumerate().map(row))
        + "</div>\n"
        + &more(list)
}

/// The table of faults that are over; empty if there are none. `ended`: what their end is called.
pub fn over(report: &Report, list: Vec<&Fault>, ended: &str, drawn: &LinkTargets) -> String {
    if list.is_empty() {
        return String::new();
    }
    let heads = ["", "channel", ended, "what it was", "from (UTC)", "certainty"];
    let rows = list.iter().take(MOST_FAULTS).map(|fault| row(report, fault, drawn, None));
    table("list cards", &heads, rows) + &more(&list)
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

/// The rank of each fault, by its place in `list`, when the list is sorted by a key.
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
fn row(report: &Report, fault: &Fault, drawn: &LinkTargets, order: Option<[usize; 4]>) -> Row {
    let (s, light, place) = (&fault.story, Light::of(fault), place(report, fault));
    let (style, third, trend) = match order {
        Some([a, b, c, d]) => {
            let action = format!("<b>{}</b>", escaped(&fault.action));
            let third = action + &small(&format!("urgency {:.2}", fault.urgency));
            (format!(" style=\"--a:{a};--b:{b};--c:{c};--d:{d}\""), third, trend_in_words(s))
        }
        None => (String::new(), s.ended_at_ns.map(clock).unwrap_or_default(), String::new()),
    };
    let [instead, forecast] =
        [instead_in_words(s), forecast_in_words(s)].map(Option::unwrap_or_default);
    let known = s.known.as_deref().map_or(String::new(), acknowledged::in_words);
    let more = [size(s), instead, trend, forecast, known];
    let more = more.iter().filter(|more| !more.is_empty()).map(|more| small(more));
    Row {
        attributes: format!(" id=\"r{place}\"{style}"),
        cells: vec![
            light.dot() + light.word(),
            whose(fault, place, drawn),
            third,
            escaped(&what(s)) + &more.collect::<String>(),
            clock(s.began_at_ns) + &small(&history(fault)),
            s.certainty.map_or("–".into(), share),
        ],
    }
}

/// A line of small print in a cell.
fn small(text: &str) -> String {
    format!("<br><span class=\"small\">{}</span>", escaped(text))
}

/// Index of a fault that is borrowed from the report (it is found by its address).
pub fn place(report: &Report, fault: &Fault) -> usize {
    report.faults.iter().position(|other| std::ptr::eq(other, fault)).unwrap_or_default()
}

/// Printhead and channel of a fault, with links to its map and to the figure of its size.
fn whose(fault: &Fault, place: usize, drawn: &LinkTargets) -> String {
    let s = &fault.story;
    let mut text = format!("{} <b>{}</b>", name(&s.printhead), s.channel);
    if let Some(map) = drawn.maps.get(&s.printhead) {
        text += &format!("<br><span class=\"small\"><a href=\"#m{map}\">map</a></span>");
    }
    if drawn.trends.contains(&place) {
        text += &format!(" <span class=\"small\"><a href=\"#t{place}\">size over time</a></span>");
    }
    text
}

/// The history of a fault, `28 episodes in 28 recordings; still on`.
fn history(fault: &Fault) -> String {
    let s = &fault.story;
    let episodes = counted(s.spells.len() as u64, "episode");
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
    for bout in fault.earlier.iter().rev().take(MOST_EARLIER) {
        let until = bout.to_ns.map_or(String::new(), |to| format!(" to {}", clock(to)));
        text += &format!("; before it {} from {}{until}", bout.what, clock(bout.from_ns));
    }
    if fault.earlier.len() > MOST_EARLIER {
        let more = (fault.earlier.len() - MOST_EARLIER) as u64;
        text += &format!("; and {} more", counted(more, "earlier fault"));
    }
    text
}

/// The cell of a recording's name, with its light; a short name is not broken over lines.
fn name_cell(light: Light, text: &str) -> String {
    const SHORT: usize = 24;
    let class = if text.chars().count() <= SHORT { "t" } else { "" };
    format!("<span class=\"{class}\">{}{}</span>", light.dot(), name(text))
}

/// The light of a recording: grey if most of it was not judged, green if its data have no flaws.
fn light(line: &RecordingLine) -> Light {
    match () {
        () if line.judged < line.rejected() || line.judged == 0 => Light::Grey,
        () if line.flaws.is_empty() => Light::Green,
        () => Light::Amber,
    }
}

/// The table of recordings, the newest ones last, then those without verdicts. Each printhead has a column with
/// the number of faulty channels and the share of flagged signals.
pub fn recordings(report: &Report) -> String {
    let (columns, left_out) = columns(report);
    let of_heads = columns.iter().map(|column| format!(">{}", name(column)));
    let heads = ["recording", "from (UTC)", ">judged"].map(str::to_owned).into_iter();
    let heads: Vec<String> = heads.chain(of_heads).chain(["data quality".to_owned()]).collect();
    let from = report.recordings.len().saturating_sub(MOST_RECORDINGS);
    let judged = report.recordings[from..].iter().map(|line| {
        let of_head = |column: &Arc<str>| match line.heads.get(column) {
            None => "–".to_owned(),
            Some(HeadCount { tally, .. }) if tally.judged == 0 => "not judged".into(),
            Some(HeadCount { tally, faulty_channels, .. }) => {
                format!("<b>{faulty_channels}</b> · {}", percent(tally.flagged, tally.judged))
            }
        };
        let begin = line.span.map_or("–".into(), |(from, _)| clock(from));
        let begin = format!("<span class=\"t\">{begin}</span>");
        let first = [name_cell(light(line), &line.name), begin, thousands(line.judged)];
        let flaws = if line.flaws.is_empty() { "whole".into() } else { escaped(&line.flaws) };
        Row::from(first.into_iter().chain(columns.iter().map(of_head)).chain([flaws]))
    });
    let lost = report.coverage.lost.iter().take(MOST_RECORDINGS).map(|lost| {
        let why: String = lost.why.chars().take(MOST_OF_DAMAGE).collect();
        let first = [name_cell(Light::Grey, &lost.name), "–".into(), "0".into()];
        let nothing = columns.iter().map(|_| "–".to_owned());
        let known = if lost.known { " (acknowledged)" } else { "" };
        let why = format!("not judged: {}{known}", escaped(&why));
        Row::from(first.into_iter().chain(nothing).chain([why]))
    });
    let mut text = wide(&table("cards", &heads, judged.chain(lost)));
    if from > 0 {
        let before = thousands(from as u64);
        text += &format!("<p>The newest {MOST_RECORDINGS}; {before} before them.</p>\n");
    }
    if left_out > 0 {
        let heads = counted(left_out as u64, "printhead");
        text += &format!("<p>The printheads with most faults; {heads} more have no column.</p>\n");
    }
    text
}

/// The printheads that have a column, those with the most faults, and the number of others.
fn columns(report: &Report) -> (Vec<Arc<str>>, usize) {
    let mut faults: BTreeMap<&Arc<str>, usize> = BTreeMap::new();
    report.faults.iter().for_each(|f| *faults.entry(&f.story.printhead).or_default() += 1);
    let heads = report.survey.heads_with_signals();
    let mut names: Vec<Arc<str>> = heads.map(|head| head.name.clone()).collect();
    names.sort_by_key(|n| (std::cmp::Reverse(faults.get(n).copied().unwrap_or(0)), n.clone()));
    let left_out = names.len().saturating_sub(MOST_COLUMNS);
    names.truncate(MOST_COLUMNS);
    names.sort();
    (names, left_out)
}
