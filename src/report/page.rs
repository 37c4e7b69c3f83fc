//! The page. In: a [`Report`]. Out: HTML, self-contained. First one sentence, then what to clean, then what
//! that rests on, then the words explained.

use super::fault::{Fault, what};
use super::story::Strange;
use super::words::{clock, counted, percent, thousands};
use super::{Report, figures, maps, tables};
use crate::plot::page::{escaped, name, page};
use std::collections::BTreeMap;
use std::fmt::Write;

/// Of all maps; what would be more is left out, and said so. A page is to be mailed.
const MOST_MAP_BYTES: usize = 3_500_000;
/// Groups of neighbours told.
const MOST_GROUPS: usize = 30;

pub fn html(report: &Report) -> String {
    let open: Vec<&Fault> = report.open().collect();
    let over: Vec<&Fault> = report.over().collect();
    let mut body = format!(
        "<h1>Nozzle report</h1>\n<p class=\"sentence\">{}</p>\n<p class=\"note\">{}</p>\n",
        escaped(&sentence(report, &open)),
        escaped(&basis(report))
    );
    for note in &report.notes {
        let _ = writeln!(body, "<p class=\"warn\"><b>Note.</b> {}</p>", escaped(note));
    }
    body += "<h2>To clean, most urgent first</h2>\n";
    match open.is_empty() {
        true => body += "<p>Nothing.</p>\n",
        false => body += &tables::faults(&open, true),
    }
    together(report, &mut body);
    if !over.is_empty() {
        body += "<h2>Over: healthy again, and did not come back</h2>\n";
        body += &tables::faults(&over, false);
    }
    body += "<h2>Recordings and printheads</h2>\n<p class=\"note\">In each cell: channels with a fault \
             episode, then the share of flagged signals.</p>\n";
    body += &tables::recordings(report);
    draw_maps(report, &mut body);
    section("Faults over time", &figures::trends(report), &mut body);
    section("Drift of the healthy ring", &figures::drift(&report.drift), &mut body);
    false_alarms(report, &mut body);
    explain(&mut body);
    page("Nozzle report", &body)
}

/// `6 of 192 channels need care ...`
fn sentence(report: &Report, open: &[&Fault]) -> String {
    let channels: usize = report.survey.heads.iter().map(|head| head.channels.len()).sum();
    let heads = report.survey.heads.iter().filter(|head| !head.tallies.is_empty()).count();
    let of = format!(
        "{} on {}",
        counted(channels as u64, "channel"),
        counted(heads as u64, "printhead")
    );
    let Some(first) = open.first() else { return format!("Of {of} none needs care.") };
    let mut kinds: BTreeMap<String, u64> = BTreeMap::new();
    for fault in open {
        let kind = fault.story.category.as_deref().map(|c| c.replace('_', " "));
        let unnamed = match fault.story.strange {
            Some(Strange::NoRing) => "at the sensor line",
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
    format!(
        "{} of {of} {verb} care ({}{now}); first {} channel {}, {}: {}.",
        thousands(open.len() as u64),
        kinds.join(", "),
        first.story.printhead,
        first.story.channel,
        what(&first.story),
        first.action
    )
}

/// What it rests on.
fn basis(report: &Report) -> String {
    let lines = &report.recordings;
    let judged: u64 = lines.iter().map(|line| line.judged).sum();
    let rejected: u64 = lines.iter().flat_map(|line| line.heads.values()).map(|h| h.rejected).sum();
    let from = lines.iter().filter_map(|line| line.from_ns).min();
    let to = lines.iter().filter_map(|line| line.to_ns).max();
    let damaged = lines.iter().filter(|line| !line.damage.is_empty()).count() as u64;
    let mut text = format!(
        "{}, {} signals judged, {} rejected",
        counted(lines.len() as u64, "recording"),
        thousands(judged),
        percent(rejected, judged + rejected)
    );
    if let (Some(from), Some(to)) = (from, to) {
        text = format!("{text}; {} to {} UTC", clock(from), clock(to));
    }
    if damaged > 0 {
        text += &format!("; {} damaged", counted(damaged, "recording"));
    }
    if report.survey.left_out > 0 {
        text += &format!(
            "; {} signals of more printheads or channels than are told apart",
            thousands(report.survey.left_out)
        );
    }
    text + "."
}

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

fn draw_maps(report: &Report, body: &mut String) {
    let heads: Vec<_> = report.survey.heads.iter().filter(|h| !h.tallies.is_empty()).collect();
    *body += "<h2>Maps of the printheads</h2>\n<p class=\"note\">Channels across, time down; each cell \
              shows the worst of its bursts, so that a single bad one stays visible. White bars: nobody \
              measured. Frames: fault episodes, with the letter of their category; pointing at one tells \
              more.</p>\n";
    *body += &maps::key(&report.survey.categories);
    let (before, mut left_out) = (body.len(), 0);
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
                let _ = writeln!(body, "<h3>{}</h3>\n{maps}", name(&head.name));
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
}

fn section(title: &str, figures: &[String], body: &mut String) {
    if !figures.is_empty() {
        let _ = writeln!(body, "<h2>{title}</h2>\n{}", figures.join("\n"));
    }
}

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
    *body += "<p>Flagged most often without an episode:</p>\n<table><tr><th>printhead</th>\
              <th class=n>channel</th><th class=n>flagged</th><th class=n>judged</th></tr>\n";
    for of in &f.often {
        let _ = writeln!(
            body,
            "<tr><td>{}</td><td class=n>{}</td><td class=n>{}</td><td class=n>{}</td></tr>",
            name(&of.printhead),
            of.channel,
            thousands(of.flagged),
            thousands(of.judged)
        );
    }
    *body += "</table>\n";
}

fn explain(body: &mut String) {
    *body += "<h2>What the words mean</h2>\n<dl>\n";
    for (word, meaning) in [
        (
            "episode",
            "a channel that looked faulty over several bursts of one recording; a single odd burst \
             raises none",
        ),
        (
            "fault, since",
            "its episodes linked over all recordings. Between two of them the channel was cured if its \
             bursts were as seldom flagged as healthy ones; where nobody measured, nothing was cured. \
             After a cure it is the same fault again if a new one of that sort would hardly begin on just \
             this channel in so few bursts",
        ),
        ("±", "one standard deviation"),
        (
            "change",
            "the line through the severities since the last cure, in brackets its 95 % interval. Told only \
             where that interval holds no 0 and an hour or more was seen: else there is no trend yet. Where \
             the later half does not follow the line, the later half alone counts",
        ),
        ("points", "hundredths of the whole: from 20 % to 23 % is 3 points"),
        (
            "certainty",
            "the probability of the named class, or of the category where no class is named",
        ),
        (
            "urgency, 0 to 1 (the list's order)",
            "certainty × how much of a drop is lost, as it will be in a day if it keeps changing (or ahead as \
             long as it was seen, if that is less); half \
             of it where a fault that comes and goes is healthy now. Of equally urgent channels what is on \
             comes first, then by printhead and channel",
        ),
        ("rejected", "not judged: samples missing, saturated or damaged, or no model fits"),
        ("threshold", "signals beyond it are flagged"),
    ] {
        let _ = writeln!(body, "<dt>{word}</dt><dd>{meaning}.</dd>");
    }
    *body += "</dl>\n<table><tr><th>class</th><th>in words</th><th>how bad is</th></tr>\n";
    for (class, words, quantity) in figures::quantities() {
        let _ = writeln!(body, "<tr><td>{class}</td><td>{words}</td><td>{quantity}</td></tr>");
    }
    *body += "</table>\n";
}
