//! A light for each printhead at the top of the page, the worst first, with the number of channels
//! to clean, or else how much of the printhead is known.
//!
//! In: a [`Report`]. Out: HTML. A printhead with open faults has the light of the worst one. One
//! without is green only if enough of it was judged, and otherwise grey (`known`), so that green
//! never means that nobody looked.

use super::Report;
use super::fault::Fault;
use super::light::Light;
use super::survey::Head;
use super::tables::LinkTargets;
use super::words::{counted, percent};
use inkling_lab::plot::page::name;
use std::cmp::Reverse;
use std::fmt::Write;

/// Most printheads that get a light.
const MOST_LIGHTS: usize = 96;

/// A printhead is not green if a larger share of its last recording's signals was not judged. With a smaller
/// share, faults are merely found later, by as many more bursts. Chosen, not tuned.
const MOST_UNJUDGED: f64 = 0.1;

/// The lights of all printheads, with links to their maps.
pub fn lights(report: &Report, drawn: &LinkTargets) -> String {
    let heads = report.survey.heads.iter().filter(|head| !head.tallies.is_empty());
    let mut all: Vec<_> = heads.map(|head| (head, lit(report, head))).collect();
    all.sort_by_key(|(head, (light, _))| (Reverse(*light), head.name.clone()));
    let mut text = String::from("<p class=\"heads\">");
    for (head, (light, words)) in all.iter().take(MOST_LIGHTS) {
        let called = match drawn.maps.get(&head.name) {
            Some(map) => format!("<a href=\"#m{map}\">{}</a>", name(&head.name)),
            None => name(&head.name),
        };
        let _ = write!(text, "<span>{}{called}: {words}</span> ", light.dot());
    }
    text += "</p>\n";
    if all.len() > MOST_LIGHTS {
        let more = counted((all.len() - MOST_LIGHTS) as u64, "printhead");
        let _ = writeln!(text, "<p>And {more} more.</p>");
    }
    text
}

/// The light of a printhead, and the words beside it: those of its worst open fault, if it has any.
fn lit(report: &Report, head: &Head) -> (Light, String) {
    let open: Vec<&Fault> =
        report.open().filter(|fault| fault.story.printhead == head.name).collect();
    let channels = counted(head.channels.len() as u64, "channel");
    match open.iter().map(|fault| Light::of(fault)).max() {
        Some(worst) => (worst, format!("{} of {channels} to clean", open.len())),
        None => known(report, head, &channels),
    }
}

/// The light of a printhead with nothing to clean. It is green only if enough was judged to say so
/// of the printhead's present state; otherwise it is grey, and the first reason against green is
/// told.
fn known(report: &Report, head: &Head, channels: &str) -> (Light, String) {
    let judged: u64 = head.tallies.values().map(|t| t.judged).sum();
    let all = judged + head.tallies.values().map(|t| t.rejected).sum::<u64>();
    let never = head.channels.iter().filter(|channel| channel.judged == 0).count() as u64;
    // the printhead's last recording, what was judged of it, and what is missing from it
    let last = head.latest();
    let is_silent = last.is_some_and(|(_, of)| of.judged == 0);
    let gap = last.and_then(|(recording, _)| report.coverage.gap(&head.name, recording));
    let mut lines = report.recordings.iter().filter(|line| line.heads.contains_key(&head.name));
    let is_lost = lines.any(|line| line.missing.contains(&"episodes"));
    let unjudged_of_last = last.map_or(0, |(_, of)| of.rejected);
    let all_of_last = last.map_or(0, |(_, of)| of.judged + of.rejected);
    let now_unknown = head.channels.iter().filter(|channel| !channel.is_known_now()).count();
    let share = percent(judged, all);

    // The reasons for grey, the gravest first.
    let grey = match () {
        () if judged == 0 => "not judged".to_owned(),
        () if is_silent => "not judged in its last recording".to_owned(),
        () if gap.is_some() => gap.map(|gap| gap.what.clone()).unwrap_or_default(),
        () if is_lost => "what was found is not known".to_owned(),
        () if 2 * judged < all => format!("only {share} of its signals judged"),
        () if never > 0 => format!("{} of {channels} never judged", never),
        () if unjudged_of_last as f64 > MOST_UNJUDGED * all_of_last as f64 => {
            let share = percent(unjudged_of_last, all_of_last);
            format!("{share} of its signals not judged in its last recording")
        }
        () if now_unknown > 0 => {
            format!("{now_unknown} of {channels} mostly not judged in its last recording")
        }
        () if judged < all => {
            let words = format!("{channels}, nothing found in the {share} that were judged");
            return (Light::Green, words);
        }
        () => return (Light::Green, format!("{channels}, nothing found")),
    };
    (Light::Grey, grey)
}
