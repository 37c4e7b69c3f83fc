//! A light for each printhead at the top of the page, the worst first, with the number of channels
//! to clean, or else how much of the printhead is known.
//!
//! In: a [`Report`]. Out: HTML. Green never means that nobody looked (`known`).

use super::Report;
use super::counts::Tally;
use super::light::Light;
use super::survey::Head;
use super::tables::LinkTargets;
use super::words::{counted, percent};
use inkling_lab::plot::page::{escaped, name};
use std::cmp::Reverse;

/// Most printheads that get a light.
const MOST_LIGHTS: usize = 96;

/// A printhead is not green if a larger share of its last recording's signals was not judged, or of all its signals
/// was flagged outside of episodes. Not tuned.
const MOST_UNKNOWN: f64 = 0.1;

/// The lights of all printheads, with links to their maps.
pub fn lights(report: &Report, drawn: &LinkTargets) -> String {
    let heads = report.survey.heads_with_signals();
    let mut all: Vec<_> = heads.map(|head| (head, lit(report, head))).collect();
    all.sort_by_key(|(head, (light, _))| (Reverse(*light), head.name.clone()));
    let mut text = String::from("<p class=\"heads\">");
    for (head, (light, words)) in all.iter().take(MOST_LIGHTS) {
        let called = match drawn.maps.get(&head.name) {
            Some(map) => format!("<a href=\"#m{map}\">{}</a>", name(&head.name)),
            None => name(&head.name),
        };
        text += &format!("<span>{}{called}: {}</span> ", light.dot(), escaped(words));
    }
    text += "</p>\n";
    if all.len() > MOST_LIGHTS {
        let more = counted((all.len() - MOST_LIGHTS) as u64, "printhead");
        text += &format!("<p>And {more} more.</p>\n");
    }
    text
}

/// The light of a printhead, and the words beside it: those of its worst open fault, if it has any.
fn lit(report: &Report, head: &Head) -> (Light, String) {
    let open = || report.open().filter(|fault| fault.story.printhead == head.name);
    let news = || open().filter(|fault| fault.story.known.is_none());
    let channels = counted(head.channels.len() as u64, "channel");
    let (light, words) = match news().map(Light::of).max() {
        Some(worst) => (worst, format!("{} of {channels} to clean", news().count())),
        None => known(report, head, &channels),
    };
    match open().count() - news().count() {
        0 => (light, words),
        n => (light, format!("{words} beside {}", counted(n as u64, "known fault"))),
    }
}

/// The light of a printhead with nothing to clean: green only if enough was judged to say so of its
/// present state, otherwise grey with the first reason against green.
fn known(report: &Report, head: &Head, channels: &str) -> (Light, String) {
    let judged: u64 = head.tallies.values().map(|t| t.judged).sum();
    let all: u64 = head.tallies.values().map(Tally::signals).sum();
    let never = head.channels.iter().filter(|channel| channel.judged == 0).count();
    let now_unknown = head.channels.iter().filter(|channel| !channel.is_known_now()).count();
    // the printhead's last recording, what was judged of it, and what is missing from it
    let (recording, last) = head.latest().map_or((0, Tally::default()), |(k, of)| (k, of.clone()));
    let gap = report.coverage.gap(&head.name, recording);
    let mut lines = report.recordings.iter().filter(|line| line.heads.contains_key(&head.name));
    let is_lost = lines.any(|line| !line.has_episodes);
    let share = percent(judged, all);
    let stray: u64 = head.outside().map(|(_, flagged)| flagged).sum();

    // The reasons for grey, the gravest first.
    let grey = match gap {
        _ if head.is_gone => "taken out: nothing was heard of it since".to_owned(),
        _ if judged == 0 => "not judged".to_owned(),
        _ if last.judged == 0 => "not judged in its last recording".to_owned(),
        Some(gap) => gap.what.clone(),
        _ if is_lost => "what was found is not known".to_owned(),
        _ if 2 * judged < all => format!("only {share} of its signals judged"),
        _ if never > 0 => format!("{never} of {channels} never judged"),
        _ if last.rejected as f64 > MOST_UNKNOWN * last.signals() as f64 => {
            let share = percent(last.rejected, last.signals());
            format!("{share} of its signals not judged in its last recording")
        }
        _ if now_unknown > 0 => {
            format!("{now_unknown} of {channels} mostly not judged in its last recording")
        }
        _ if stray as f64 > MOST_UNKNOWN * judged as f64 => {
            let share = percent(stray, judged);
            format!("{share} of its signals flagged, on no channel often enough to call it faulty")
        }
        _ if judged < all => {
            let words = format!("{channels}, no open fault in the {share} that were judged");
            return (Light::Green, words);
        }
        _ => return (Light::Green, format!("{channels}, no open fault")),
    };
    (Light::Grey, grey)
}
