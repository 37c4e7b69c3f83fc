//! The page of the report, which `cli/report_page.rs` writes.
//!
//! In: a [`Report`]. Out: self-contained HTML, made with `inkling_lab::plot::page`. One sentence
//! comes first, then what to clean, then the recordings, maps and figures that this rests on, and
//! last the meaning of the words. Every text that comes from a file is escaped.
//!
//! The lists link to figures (`#t` and the fault's index), maps (`#m` and a number) and rows (`#r`
//! and the fault's index), so figures and maps are drawn first and put in later.

use super::changes::Changes;
use super::fault::{Fault, what};
use super::night::whole;
use super::survey::Head;
use super::tables::LinkTargets;
use super::words::{clock, counted, first_of, percent, thousands};
use super::{Report, figures, heads, maps, tables};
use inkling_core::fault;
use inkling_core::verdict::Reason;
use inkling_lab::plot::page::{escaped, name, page, table};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::sync::Arc;

/// Once all maps together have more bytes than this no further map is drawn, and the page says so:
/// the page is to be mailed.
const MOST_MAP_BYTES: usize = 3_500_000;
/// Most groups of neighbours that are listed.
const MOST_GROUPS: usize = 30;
/// Most channels that are listed for each kind of change, and most printheads that were not judged.
const MOST_CHANGES: usize = 12;

/// The whole page.
pub fn html(report: &Report) -> String {
    let open: Vec<&Fault> = report.open().collect();
    let over: Vec<&Fault> = report.over().collect();
    let mut body = String::from("<h1>Nozzle report</h1>\n");
    let first = report.coverage.first();
    for sentence in first.iter().chain(sentence(report, &open).iter()) {
        let _ = writeln!(body, "<p class=\"sentence\">{}</p>", escaped(sentence));
    }
    let _ = writeln!(body, "<p class=\"note\">{}</p>", escaped(&basis(report)));
    for note in &report.notes {
        let _ = writeln!(body, "<p class=\"warn\"><b>Note.</b> {}</p>", escaped(note));
    }

    // Figures and maps are drawn before the lists, because the lists link to those that exist.
    let trends = figures::trends(report);
    let (maps, of_heads) = draw_maps(report);
    let drawn = LinkTargets { trends: trends.keys().copied().collect(), maps: of_heads };
    body += &heads::lights(report, &drawn);
    changed(report, &mut body);
    body += "<h2>To clean</h2>\n";
    match open.is_empty() {
        true if report.coverage.is_complete() => body += "<p>Nothing.</p>\n",
        true if report.coverage.knows_faults(report.recordings.len()) => {
            body += "<p>No channel, as far as is known; what is not stands first.</p>\n";
        }
        true => body += "<p>Nobody knows.</p>\n",
        false => body += &tables::to_clean(report, &open, &drawn),
    }
    together(report, &mut body);
    if !over.is_empty() {
        body += "<h2>Over: healthy again, and did not come back</h2>\n";
        body += &tables::over(report, &over, &drawn);
    }
    body += "<h2>Recordings and printheads</h2>\n<p class=\"note\">Of each printhead: channels with a fault \
             episode, then the share of flagged signals.</p>\n";
    body += &tables::recordings(report);
    body += &maps;
    let anchored =
        |(place, figure): (&usize, &String)| format!("<div id=\"t{place}\">{figure}</div>");
    section("Faults over time", &trends.iter().map(anchored).collect::<Vec<_>>(), &mut body);
    section("Drift of the healthy ring", &figures::drift(&report.drift), &mut body);
    false_alarms(report, &mut body);
    explain(&mut body);
    page("Nozzle report", &body)
}

/// The page's first sentence: `6 of 192 channels on 3 printheads need care ...`. `open`: the faults
/// to clean, the most urgent first. `None` if nothing was judged.
fn sentence(report: &Report, open: &[&Fault]) -> Option<String> {
    let coverage = &report.coverage;
    let judged = |head: &&Head| head.tallies.values().any(|tally| tally.judged > 0);
    let heads = report.survey.heads.iter().filter(judged).count();
    let of = format!(
        "{} on {}",
        counted(coverage.channels, "channel"),
        counted(heads as u64, "printhead")
    );

    // Nothing is to be cleaned: how much that says depends on how much is known.
    let Some(first) = open.first() else {
        return match coverage {
            _ if coverage.judged == 0 => None,
            _ if !coverage.knows_faults(report.recordings.len()) => {
                Some("What needs care is not known.".into())
            }
            _ if coverage.is_complete() => Some(format!("Of {of} none needs care.")),
            _ => Some(format!("What is known of {of} names no channel to clean.")),
        };
    };

    // How many faults there are of each kind, the most frequent kind first.
    let mut kinds: BTreeMap<String, u64> = BTreeMap::new();
    for fault in open {
        let kind = fault.story.category.as_deref().map(|c| c.replace('_', " "));
        let unnamed = match fault.story.strange {
            Some(Reason::NoRing) => "at the sensor line",
            _ => "not named",
        };
        *kinds.entry(kind.unwrap_or_else(|| unnamed.into())).or_default() += 1;
    }
    let mut kinds: Vec<(String, u64)> = kinds.into_iter().collect();
    kinds.sort_by_key(|(_, n)| std::cmp::Reverse(*n));
    let kinds: Vec<String> = kinds.iter().map(|(kind, n)| format!("{n} {kind}")).collect();
    let verb = if open.len() == 1 { "needs" } else { "need" };
    let come_and_go = open.iter().filter(|f| f.story.ended_at_ns.is_some()).count() as u64;
    let now = match come_and_go {
        0 => String::new(),
        n => format!("; {} of them come and go, and are healthy now", thousands(n)),
    };
    Some(format!(
        "{} of {of} {verb} care ({}{now}); first {} channel {}, {}: {}.",
        thousands(open.len() as u64),
        kinds.join(", "),
        first.story.printhead,
        first.story.channel,
        what(&first.story),
        first.action
    ))
}

/// What the report rests on, in one sentence: recordings, signals, time span, damage.
fn basis(report: &Report) -> String {
    let lines = &report.recordings;
    let judged: u64 = lines.iter().map(|line| line.judged).sum();
    let rejected: u64 =
        lines.iter().flat_map(|line| line.heads.values()).map(|h| h.tally.rejected).sum();
    let damaged = lines.iter().filter(|line| line.damaged_places > 0).count() as u64;
    let mut text = format!(
        "{}, {} signals judged, {} rejected",
        counted(lines.len() as u64, "recording"),
        thousands(judged),
        percent(rejected, judged + rejected)
    );
    if let Some((from, to)) = whole(lines.iter().filter_map(|line| line.span)) {
        text = format!("{text}; {} to {} UTC", clock(from), clock(to));
    }
    if !report.coverage.lost.is_empty() {
        let lost = counted(report.coverage.lost.len() as u64, "recording");
        text += &format!("; {lost} without verdicts");
    }
    if damaged > 0 {
        text += &format!("; {} damaged", counted(damaged, "recording"));
    }
    let left_out = report.survey.left_out.values().sum();
    if left_out > 0 {
        text += &format!(
            "; {} signals of more printheads or channels than are told apart",
            thousands(left_out)
        );
    }
    text + "."
}

/// The list of neighbours that may have failed together.
fn together(report: &Report, body: &mut String) {
    if report.groups.is_empty() {
        return;
    }
    *body += "<h3>Neighbours that may have failed together</h3>\n<ul>\n";
    for group in report.groups.iter().take(MOST_GROUPS) {
        let _ = writeln!(body, "<li>{}</li>", escaped(&group.sentence));
    }
    *body += "</ul>\n";
}

/// The section of the maps, and the number of each printhead's map that was drawn, which is part of
/// the map's address in the page.
fn draw_maps(report: &Report) -> (String, BTreeMap<Arc<str>, usize>) {
    let heads: Vec<_> = report.survey.heads.iter().filter(|h| !h.tallies.is_empty()).collect();
    let mut body = String::from(
        "<h2>Maps of the printheads</h2>\n<p class=\"note\">Channels across, time down; each cell \
              shows the worst of its bursts, so that a single bad one stays visible. White bars: nobody \
              measured. Frames: fault episodes, with the letter of their category (S: at the sensor line, U: not \
              named); pointing at one tells more.</p>\n",
    );
    body += &maps::key(&report.survey.categories);
    let (before, mut left_out, mut drawn_of) = (body.len(), 0, BTreeMap::new());
    for head in &heads {
        let faults: Vec<&Fault> =
            report.faults.iter().filter(|f| f.story.printhead == head.name).collect();
        let drawn = match body.len() - before {
            bytes if bytes > MOST_MAP_BYTES => Ok(String::new()),
            _ => maps::maps(head, &faults, &report.survey.categories),
        };
        match drawn {
            Ok(maps) if maps.is_empty() => left_out += 1,
            Ok(maps) => {
                let number = drawn_of.len();
                drawn_of.insert(head.name.clone(), number);
                let _ = writeln!(body, "<h3 id=\"m{number}\">{}</h3>\n{maps}", name(&head.name));
            }
            Err(e) => {
                let _ = writeln!(body, "<p>{}: {}</p>", name(&head.name), escaped(&e));
            }
        }
    }
    if left_out > 0 {
        let _ = writeln!(
            body,
            "<p>{} more are not drawn: those with most faults come first.</p>",
            counted(left_out, "printhead")
        );
    }
    (body, drawn_of)
}

/// Adds the section of what changed since the night before, if there was one. It stands before the
/// cleaning list.
fn changed(report: &Report, body: &mut String) {
    let Some(changes) = Changes::of(&report.recordings, &report.faults) else { return };
    let _ = writeln!(
        body,
        "<h2>What changed since the night before</h2>\n<p class=\"note\">In {} from {} to {} UTC.</p>\n<ul>",
        counted(changes.recordings as u64, "recording"),
        clock(changes.from_ns),
        clock(changes.to_ns)
    );
    let mut is_any = false;
    for (_, words, faults) in changes.kinds() {
        if faults.is_empty() {
            continue;
        }
        is_any = true;
        let (first, rest) = words.split_at(1);
        let words = format!("{}{rest}", first.to_uppercase());
        let all: Vec<String> = faults.iter().map(|fault| change(report, fault)).collect();
        let some = first_of(&all, MOST_CHANGES, "; ");
        let _ = writeln!(body, "<li><b>{words}:</b> {some}.</li>");
    }
    if !changes.silent.is_empty() {
        is_any = true;
        let names: Vec<String> =
            changes.silent.iter().take(MOST_CHANGES).map(|of| name(of)).collect();
        let _ = writeln!(
            body,
            "<li><b>Not judged last night:</b> {}; what is known of them is older.</li>",
            names.join(", ")
        );
    }
    let still = counted(changes.still as u64, "channel");
    match (is_any, changes.still) {
        (true, 0) => {}
        (true, _) => *body += &format!("<li>{still} as before.</li>\n"),
        (false, 0) => *body += "<li>Nothing, of what was judged.</li>\n",
        (false, _) => {
            *body += &format!("<li>Nothing, of what was judged: {still} as before.</li>\n");
        }
    }
    *body += "</ul>\n";
}

/// The words for a changed fault, `black-2 channel 0, empty ink channel (EC)`, with a link to the
/// fault's row.
fn change(report: &Report, fault: &Fault) -> String {
    let s = &fault.story;
    let place = tables::place(report, fault);
    format!(
        "<a href=\"#r{place}\">{} channel {}</a>, {}",
        name(&s.printhead),
        s.channel,
        escaped(&what(s))
    )
}

/// Adds a section of figures, if there are any.
fn section(title: &str, figures: &[String], body: &mut String) {
    if !figures.is_empty() {
        let _ = writeln!(body, "<h2>{title}</h2>\n{}", figures.join("\n"));
    }
}

/// Adds the section of false alarms, with the channels that are flagged most often.
fn false_alarms(report: &Report, body: &mut String) {
    let f = &report.false_alarms;
    let per_million = |share: f64| thousands((1e6 * share).round() as u64);
    let [low, high] = f.interval();
    let _ = writeln!(
        body,
        "<h2>False alarms</h2>\n<p>Outside of every episode {} of {} signals were flagged: {} of a million \
         (95 %: {} to {}, from the scatter over channels){}. Faults too short for an episode are \
         counted as false alarms here: it is an upper estimate.</p>",
        thousands(f.flagged),
        thousands(f.judged),
        per_million(f.flagged as f64 / f.judged.max(1) as f64),
        per_million(low),
        per_million(high),
        match f.promised {
            None => String::new(),
            Some((low, high)) if low == high => {
                format!("; the threshold is meant for {}", per_million(low))
            }
            Some((low, high)) => {
                format!(
                    "; the thresholds are meant for {} to {}",
                    per_million(low),
                    per_million(high)
                )
            }
        }
    );
    if f.often.is_empty() {
        return;
    }
    let often = f.often.iter().map(|(printhead, of)| {
        let [flagged, judged] = [of.flagged, of.judged].map(thousands);
        [name(printhead), of.channel.to_string(), flagged, judged]
    });
    let often = table(["printhead", ">channel", ">flagged", ">judged"], often);
    let _ = writeln!(body, "<p>Flagged most often without an episode:</p>\n{often}");
}

/// Adds the section that explains the page's words and the classes. `glossary.txt` has a line for
/// each word, and below it one for its meaning.
fn explain(body: &mut String) {
    *body += "<h2>What the words mean</h2>\n<dl>\n";
    let lines: Vec<&str> = include_str!("glossary.txt").lines().map(str::trim).collect();
    for [word, meaning] in lines.as_chunks().0 {
        let _ = writeln!(body, "<dt>{word}</dt><dd>{meaning}.</dd>");
    }
    let of_class = fault::CLASSES
        .map(|class| [class, fault::in_words(class), fault::quantity(class)].map(str::to_owned));
    let _ = writeln!(body, "</dl>\n{}", table(["class", "in words", "how bad is"], of_class));
}
