//! The page of the report, which `cli/report_page.rs` writes.
//!
//! In: a [`Report`]. Out: self-contained HTML, made with `inkling_lab::plot::page`. One sentence
//! comes first, then what to clean, then the recordings, maps and figures that this rests on, and
//! last the meaning of the words. Every text that comes from a file is escaped.
//!
//! The lists link to figures (`#t` and the fault's index), maps (`#m` and a number) and rows (`#r`
//! and the fault's index), so figures and maps are drawn first and put in later.

use super::changes::Changes;
use super::coverage::Extent;
use super::false_alarms::FalseAlarms;
use super::fault::{Fault, what};
use super::night::whole;
use super::story::Story;
use super::survey::Head;
use super::tables::LinkTargets;
use super::words::{clock, counted, first_of, of_some, percent, thousands};
use super::{HeadChange, RecordingLine, Report, figures, heads, maps, tables};
use inkling_core::fault;
use inkling_core::verdict::Reason;
use inkling_lab::plot::page::{escaped, list, name, note, page, section, sentence, table};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Once all maps together have more bytes than this no further one is drawn: the page is to be mailed.
const MOST_MAP_BYTES: usize = 3_500_000;
/// Most channels that are listed for each kind of change, and most printheads that were not judged.
const MOST_CHANGES: usize = 12;
/// Most earlier changes of printheads that are listed, the newest.
const MOST_HEAD_CHANGES: usize = 40;

/// The whole page.
pub fn html(report: &Report) -> String {
    let open: Vec<&Fault> = report.open().collect();
    let mut body = String::from("<h1>Nozzle report</h1>\n");
    let news: Vec<&Fault> = report.news().collect();
    for text in report.coverage.first().into_iter().chain(in_short(report, &news)) {
        body += &sentence(&text);
    }
    body += &note(&basis(report));
    let (of_last, before): (Vec<_>, Vec<_>) =
        report.head_changes.iter().partition(|of| of.is_of_last_night);
    for HeadChange { printhead, what, .. } in &of_last {
        body += &format!("<p class=\"warn\"><b>{}.</b> {}</p>\n", name(printhead), escaped(what));
    }
    for note in &report.notes {
        body += &format!("<p class=\"warn\"><b>Note.</b> {}</p>\n", escaped(&note.what));
    }

    // Figures and maps are drawn before the lists, because the lists link to those that exist.
    let trends = figures::trends(report);
    let (maps, of_heads) = draw_maps(report);
    let drawn = LinkTargets { trends: trends.keys().copied().collect(), maps: of_heads };
    body += &heads::lights(report, &drawn);
    body += &changed(report);
    body += "<h2>To clean</h2>\n";
    body += &match report.coverage.extent() {
        _ if !open.is_empty() => tables::to_clean(report, &open, &drawn),
        Extent::Complete => "<p>Nothing.</p>\n".into(),
        Extent::Partial => {
            "<p>No channel, as far as is known; what is not stands first.</p>\n".into()
        }
        Extent::NothingJudged | Extent::FaultsUnknown => "<p>Nobody knows.</p>\n".into(),
    };
    let over = tables::over(report, report.over().collect(), "healthy since (UTC)", &drawn);
    body += &section("Over: healthy again, and did not come back", &over);
    let replaced = tables::over(report, report.replaced().collect(), "replaced (UTC)", &drawn);
    body += &section("Over: went with what was replaced", &replaced);
    body += &section("Earlier changes of printheads", &head_changes(&before));
    body += &maps;
    let anchored =
        |(place, figure): (&usize, &String)| format!("<div id=\"t{place}\">{figure}</div>");
    let trends: Vec<String> = trends.iter().map(anchored).collect();
    let drift = figures::drift(&report.drift);
    body += &section("Faults over time", &trends.concat());
    body += &section("Drift of the healthy ring", &drift.concat());
    body += &false_alarms(&report.false_alarms);
    // a year of nights has hundreds of rows, and what they rest on is looked for last
    body += "<h2>Recordings and printheads</h2>\n";
    body += &note(
        "Of each printhead: channels with a fault episode, then the share of flagged signals.",
    );
    body += &tables::recordings(report);
    body += &explained();
    page("Nozzle report", &body)
}

/// The page's first sentence: `6 of 192 channels on 3 printheads need care ...`, if anything was judged. `open`: the
/// faults that are to be cleaned, but for those that are known.
fn in_short(report: &Report, open: &[&Fault]) -> Option<String> {
    let coverage = &report.coverage;
    let judged = |head: &&Head| head.tallies.values().any(|tally| tally.judged > 0);
    let heads = report.survey.heads.iter().filter(judged).count();
    let channels = counted(coverage.channels, "channel");
    let of = format!("{channels} on {}", counted(heads as u64, "printhead"));

    // Nothing is to be cleaned: how much that says depends on how much is known.
    let known = match report.open().count() - open.len() {
        0 => String::new(),
        n => format!(" beyond {}", counted(n as u64, "known fault")),
    };
    let Some(first) = open.first() else {
        return match coverage.extent() {
            Extent::NothingJudged => None,
            Extent::FaultsUnknown => Some("What needs care is not known.".into()),
            Extent::Complete => Some(format!("Of {of} none needs care{known}.")),
            Extent::Partial => {
                Some(format!("What is known of {of} names no channel to clean{known}."))
            }
        };
    };

    // How many faults there are of each kind, the most frequent kind first.
    let mut kinds: BTreeMap<String, u64> = BTreeMap::new();
    for Story { category, reason, lost, .. } in open.iter().map(|fault| &fault.story) {
        let kind = match (category, reason) {
            _ if lost.is_some() => "no longer named".to_owned(),
            (Some(category), _) => category.replace('_', " "),
            (None, Some(Reason::NoRing)) => "at the sensor line".into(),
            (None, _) => "not named".into(),
        };
        *kinds.entry(kind).or_default() += 1;
    }
    let mut kinds: Vec<(String, u64)> = kinds.into_iter().collect();
    kinds.sort_by_key(|(_, n)| std::cmp::Reverse(*n));
    let is_noun = |kind: &str| ["nozzle", "bubble", "channel"].iter().any(|of| kind.ends_with(of));
    let kinds: Vec<String> = kinds
        .iter()
        .map(|(kind, n)| if is_noun(kind) { counted(*n, kind) } else { format!("{n} {kind}") })
        .collect();
    let verb = if open.len() == 1 { "needs" } else { "need" };
    let come_and_go = open.iter().filter(|f| f.story.ended_at_ns.is_some()).count() as u64;
    let now = match come_and_go {
        0 => String::new(),
        n => format!("; {} of them come and go, and are healthy now", thousands(n)),
    };
    let (n, kinds, Fault { action, story, .. }) =
        (thousands(open.len() as u64), kinds.join(", "), first);
    let first = format!("{} channel {}, {}", story.printhead, story.channel, what(story));
    Some(format!("{n} of {of} {verb} care ({kinds}{now}); first {first}: {action}."))
}

/// What the report rests on, in one sentence: recordings, signals, time span, damage.
fn basis(report: &Report) -> String {
    let lines = &report.recordings;
    let judged: u64 = lines.iter().map(|line| line.judged).sum();
    let rejected: u64 = lines.iter().map(RecordingLine::rejected).sum();
    let damaged = lines.iter().filter(|line| line.is_damaged).count() as u64;
    let recordings = counted(lines.len() as u64, "recording");
    let (signals, share) = (thousands(judged), percent(rejected, judged + rejected));
    let mut parts = vec![format!("{recordings}, {signals} signals judged, {share} rejected")];
    let span = whole(lines.iter().filter_map(|line| line.span));
    parts.extend(span.map(|(from, to)| format!("{} to {} UTC", clock(from), clock(to))));
    let lost = report.coverage.lost.len() as u64;
    let left_out: u64 = report.survey.left_out.values().sum();
    let of_channels = "signals of more printheads or channels than are told apart";
    parts.extend(of_some([
        (lost, format!("{} without verdicts", counted(lost, "recording"))),
        (damaged, format!("{} damaged", counted(damaged, "recording"))),
        (left_out, format!("{} {of_channels}", thousands(left_out))),
    ]));
    parts.join("; ") + "."
}

/// The section of the maps, and the number of each printhead's map, which is part of its address.
fn draw_maps(report: &Report) -> (String, BTreeMap<Arc<str>, usize>) {
    let mut body = String::from("<h2>Maps of the printheads</h2>\n");
    body += &note(
        "Channels across, time down; each cell shows the worst of its bursts, so that a single bad one stays visible. \
         White bars: nobody measured. Frames: fault episodes, with the letter of their category (S: at the sensor \
         line, U: not named); pointing at one tells more.",
    );
    body += &maps::key(&report.survey.categories);
    let (before, mut left_out, mut drawn_of) = (body.len(), 0, BTreeMap::new());
    for head in report.survey.heads_with_signals() {
        let drawn = match body.len() - before {
            bytes if bytes > MOST_MAP_BYTES => Ok(String::new()),
            _ => maps::map(head, &report.faults, &report.survey.categories),
        };
        match drawn {
            Ok(map) if map.is_empty() => left_out += 1,
            Ok(map) => {
                let number = drawn_of.len();
                drawn_of.insert(head.name.clone(), number);
                body += &format!("<h3 id=\"m{number}\">{}</h3>\n{map}\n", name(&head.name));
            }
            Err(e) => body += &format!("<p>{}: {}</p>\n", name(&head.name), escaped(&e)),
        }
    }
    if left_out > 0 {
        let heads = counted(left_out, "printhead");
        body += &format!("<p>{heads} more are not drawn: those with most faults come first.</p>\n");
    }
    (body, drawn_of)
}

/// The list of what happened to printheads before the last night; empty if nothing did.
fn head_changes(before: &[&HeadChange]) -> String {
    let item = |of: &&HeadChange| {
        let at = of.as_of_ns.map(clock).unwrap_or_default();
        format!("{at}, <b>{}</b>: {}", name(&of.printhead), escaped(&of.what))
    };
    match before.len() {
        0 => String::new(),
        _ => list(before.iter().take(MOST_HEAD_CHANGES).map(item)),
    }
}

/// The section of what changed since the night before; empty if there was none.
fn changed(report: &Report) -> String {
    let Some(changes) = Changes::of(&report.recordings, &report.faults) else {
        return String::new();
    };
    let mut items = Vec::new();
    for (_, words, faults) in changes.kinds.iter().filter(|kind| !kind.2.is_empty()) {
        let all: Vec<String> = faults.iter().map(|fault| change(report, fault)).collect();
        let (some, (first, rest)) = (first_of(&all, MOST_CHANGES, "; "), words.split_at(1));
        items.push(format!("<b>{}{rest}:</b> {some}.", first.to_uppercase()));
    }
    let names = changes.silent.iter().take(MOST_CHANGES).map(|of| name(of));
    let names = names.collect::<Vec<_>>().join(", ");
    if !changes.silent.is_empty() {
        items.push(format!(
            "<b>Not judged last night:</b> {names}; what is known of them is older."
        ));
    }
    let still = counted(changes.still as u64, "channel");
    items.extend(match (items.is_empty(), changes.still) {
        (false, 0) => None,
        (false, _) => Some(format!("{still} as before.")),
        (true, 0) => Some("Nothing, of what was judged.".to_owned()),
        (true, _) => Some(format!("Nothing, of what was judged: {still} as before.")),
    });
    let recordings = counted(changes.recordings as u64, "recording");
    let (from, to) = (clock(changes.from_ns), clock(changes.to_ns));
    let when = note(&format!("In {recordings} from {from} to {to} UTC."));
    section("What changed since the night before", &(when + &list(items)))
}

/// A changed fault, `black-2 channel 0, empty ink channel (EC)`, with a link to its row.
fn change(report: &Report, fault: &Fault) -> String {
    let (place, story) = (tables::place(report, fault), &fault.story);
    let (head, what) = (name(&story.printhead), escaped(&what(story)));
    format!("<a href=\"#r{place}\">{head} channel {}</a>, {what}", story.channel)
}

/// The section of false alarms.
fn false_alarms(f: &FalseAlarms) -> String {
    let per_million = |share: f64| thousands((1e6 * share).round() as u64);
    let meant = match f.promised {
        None => String::new(),
        Some((one, other)) if one == other => {
            format!("; the threshold is meant for {}", per_million(one))
        }
        Some((least, most)) => {
            let [least, most] = [least, most].map(per_million);
            format!("; the thresholds are meant for {least} to {most}")
        }
    };
    format!(
        "<h2>False alarms</h2>\n<p>Outside of every episode {} of {} signals were flagged: {} of a \
         million{meant}. Faults too short for an episode are counted as false alarms here: it is an upper \
         estimate.</p>\n",
        thousands(f.flagged),
        thousands(f.judged),
        per_million(f.flagged as f64 / f.judged.max(1) as f64),
    )
}

/// The section that explains words and classes. `glossary.txt` has lines of a word and of its meaning.
fn explained() -> String {
    let lines: Vec<&str> = include_str!("glossary.txt").lines().map(str::trim).collect();
    let words = lines.as_chunks().0.iter();
    let words = words.map(|[word, meaning]| format!("<dt>{word}</dt><dd>{meaning}.</dd>\n"));
    let of_class = fault::CLASSES
        .map(|class| [class, fault::in_words(class), fault::quantity(class)].map(str::to_owned));
    format!(
        "<h2>What the words mean</h2>\n<dl>\n{}</dl>\n{}\n",
        words.collect::<String>(),
        table("", &["class", "in words", "how bad is"], of_class)
    )
}
