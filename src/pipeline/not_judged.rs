//! What could not be judged of a recording, which whoever reads of it is told before anything else.
//!
//! In: the report of a finished recording, from `finish` ([`note`]). Out: the same, with a sentence
//! * for each printhead of which nothing could be judged, or for the recording, if less than half of its signals
//!   could be judged (`rejected`);
//! * for each printhead whose samples (`doubted`) or times (`without_times`) are not what they are taken for;
//! * and for each topic that nobody reads though a dialect nearly fits it (`nobody_reads`).
//!
//! Such a sentence gives the run exit status 4: nobody may take silence for health. What concerns only some of a
//! printhead, and other topics that look like bursts, are told without that.

use super::judges::{Judges, Refusal};
use super::recording_report::RecordingReport;
use super::ring_look::{self, Doubt, Known};
use super::run::Replay;
use super::tally::{Counts, PrintheadTally, Tally};
use crate::report::{percent, rfc3339};
use crate::settings::Settings;
use inkling_core::burst::UnusableBurst;
use inkling_core::episodes::Untimely;
use inkling_core::numbers::LITTLE;
use inkling_core::verdict::Reason;
use inkling_io::peek::UnreadChannel;
use inkling_io::recording::Recording;
use serde::Serialize;

/// A printhead, topic or recording of which hardly anything was judged.
#[derive(Clone, Debug, Default, Serialize)]
pub struct NotJudged {
    /// The printhead that the sentence is about; `None`: it is about the recording, or about a topic.
    pub printhead: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub topic: Option<String>,
    /// Number of signals of the printhead or the recording; 0 for a topic, whose signals nobody has counted.
    pub signals: u64,
    pub judged: u64,
    /// A sentence without its full stop: how many of how many signals, why, and what to do.
    pub what: String,
}

impl NotJudged {
    /// A sentence about a printhead of which no signals are counted.
    pub fn of_printhead(printhead: &str, what: String) -> NotJudged {
        NotJudged { printhead: Some(printhead.into()), what, ..NotJudged::default() }
    }

    fn of_topic(topic: String, what: String) -> NotJudged {
        NotJudged { topic: Some(topic), what, ..NotJudged::default() }
    }
}

/// Maximum number of printheads, and of topics, that are told by name.
const MOST_NAMED: usize = 64;

/// Notes in a report what was not judged: the printheads, each once, or the recording, and the topics that look
/// like bursts and that nothing reads, without those that the settings ignore.
pub fn note(report: &mut RecordingReport, by: (&Replay, &Recording), judges: &Judges) {
    let (replay, recording) = by;
    let settings = &replay.settings;
    let (of_most, of_some): (Vec<_>, Vec<_>) =
        doubts(report, by).into_iter().partition(|doubt| doubt.is_of_most);
    let (mostly_untimely, untimely): (Vec<_>, Vec<_>) =
        report.episodes.untimely.iter().partition(|of| 2 * of.lost() >= of.signals);

    // 1. what was judged in vain, or not at all: the first sentence about a printhead stays, since a doubt about its
    // samples explains the rest
    let doubted = of_most.into_iter().map(|doubt| doubted(doubt, &report.tally));
    let rejected = rejected(&report.tally, judges, &report.refusals);
    let without_times = |of: &Untimely| without_times(of, settings);
    let untimely_all = mostly_untimely.into_iter().map(without_times);
    let mut all: Vec<NotJudged> = Vec::new();
    for told in doubted.chain(rejected).chain(untimely_all) {
        if all.iter().all(|known| known.printhead != told.printhead) {
            all.push(told);
        }
    }

    // 2. times that are of no use for some signals, where nothing else was odd about them
    let is_odd =
        |name: &str| report.odd_times.iter().any(|of| of.printhead.as_deref() == Some(name));
    let untimely = untimely.into_iter().filter(|of| !is_odd(&of.printhead));
    let mut odd_times: Vec<NotJudged> = untimely.map(without_times).collect();
    odd_times.extend(twice(report.episodes.counts.signals_repeated, report.tally.counts.signals));

    // 3. printheads of which some was judged, unless a warning or one of these sentences says more
    let of_some = of_some.into_iter().map(|Doubt { printhead, what, .. }| {
        NotJudged::of_printhead(&printhead, format!("{printhead}: {what}"))
    });
    let is_new = |told: &NotJudged| {
        let has_moved = told.printhead.as_deref().is_some_and(|name| report.has_moved(name));
        !has_moved && all.iter().all(|known| known.printhead != told.printhead)
    };
    let partly = partly(&report.tally, judges, &report.refusals).filter(is_new);
    let mut some: Vec<NotJudged> = of_some.chain(partly).collect();

    // 4. topics; those that a dialect nearly fits count as not judged
    let (by_dialect, others): (Vec<_>, Vec<_>) =
        unread(&report.tally, by).partition(|topic| topic.by_dialect);
    all.extend(by_dialect.into_iter().map(nobody_reads));
    some.extend(others.into_iter().map(nobody_reads));

    some.extend(judges.wide_thresholds(true).map(|(printhead, what)| {
        NotJudged::of_printhead(&printhead, format!("{printhead}: {what}"))
    }));
    some.extend(recording.silent.iter().map(|topic| {
        let what =
            format!("topic {topic}: has no messages, so that nothing is known of its printhead");
        NotJudged::of_topic(topic.clone(), what)
    }));
    let unusable = report.tally.counts.unusable_bursts;
    let first = recording.first_unusable().filter(|_| unusable > 0);
    some.extend(first.map(|first| no_burst(unusable, &first)));

    report.odd_times.extend(odd_times);
    report.unread.extend(some);
    report.not_judged = all;
}

/// Why printheads' signals may not be what they are taken for.
fn doubts(report: &RecordingReport, (replay, recording): (&Replay, &Recording)) -> Vec<Doubt> {
    let of_other_unit = report.moved.iter().filter_map(|of| {
        Some(Doubt {
            printhead: of.printhead.to_string(),
            what: of.of_other_unit()?,
            is_of_most: true,
            is_settled_by_design: false,
        })
    });
    let without_rings = report.moved.iter().filter(|of| of.no_rings_since_ns.is_some());
    let without_rings: Vec<&str> = without_rings.map(|of| &*of.printhead).collect();
    let by_design = match replay.design {
        Some(_) => Known::But(&without_rings),
        None => Known::Nothing,
    };
    ring_look::doubts(recording, by_design).into_iter().chain(of_other_unit).collect()
}

/// The topics that look like bursts and that nothing reads, without those that the settings ignore.
fn unread(
    tally: &Tally,
    (replay, recording): (&Replay, &Recording),
) -> impl Iterator<Item = UnreadChannel> {
    let input = &replay.settings.input;
    let ignored = input.ignored();
    let printheads: Vec<&str> = tally.printheads.keys().map(|name| &**name).collect();
    let topics = recording.unread(&input.dialects(), &printheads).into_iter();
    topics.filter(move |topic| !ignored.has(&topic.topic)).take(MOST_NAMED)
}

/// The sentence about signals that were there already, where they are many.
fn twice(repeated: u64, signals: u64) -> Option<NotJudged> {
    let what = format!(
        "{repeated} of {signals} signals came twice, with the same time, channel and samples: what is counted of signals \
         counts them twice. Two recorders of one printhead, or a recording that was merged with itself?"
    );
    (repeated as f64 > LITTLE * signals as f64).then(|| NotJudged {
        signals,
        judged: signals,
        what,
        ..NotJudged::default()
    })
}

/// The sentence about messages of which none is a burst.
fn no_burst(unusable: u64, first: &UnusableBurst) -> NotJudged {
    let UnusableBurst { printhead, why, what, .. } = first;
    let of = if printhead.is_empty() { "".into() } else { format!(" of {printhead}") };
    let what =
        format!("{unusable} messages are no bursts; the first{of} is {}: {what}", why.as_str());
    NotJudged { signals: unusable, what, ..NotJudged::default() }
}

/// The sentence about a topic that looks like bursts and that nothing reads.
pub fn nobody_reads(of: UnreadChannel) -> NotJudged {
    let UnreadChannel { topic, schema, encoding, messages, by_dialect, undecodable } = of;
    let messages = messages.map_or(String::new(), |n| format!("{n} "));
    let schema = if schema.is_empty() { "".into() } else { format!(" of {schema}") };
    let why = match (by_dialect, undecodable) {
        (true, _) => "look like those that [[input.dialect]] reads, and its topic or its schema does not fit: \
             nobody judged them. Let it fit"
            .to_owned(),
        (false, None) => "look like bursts, and nothing reads them: `inkling inspect` proposes a block \
             [[input.dialect]]. Add it"
            .to_owned(),
        (false, Some(why)) => format!(
            "are called like bursts, and nothing can read them: {why}"
        ),
    };
    let what = format!(
        "topic {topic}: its {messages}messages{schema} ({encoding}) {why}, or say that they are not meant: --set \
         'input.ignore=[\"{topic}\"]'"
    );
    NotJudged::of_topic(topic, what)
}

/// The sentence about a printhead whose times are of no use for some of its signals.
fn without_times(of: &Untimely, settings: &Settings) -> NotJudged {
    let Untimely { printhead, signals, at_one_time, too_late, t_ns } = of;
    let lost = of.lost();
    // the commoner of the two causes is told
    let what = match at_one_time < too_late {
        false => format!(
            "{lost} of {signals} signals of {printhead} have the time of another one of their channel ({}), so that no \
             fault can be followed over them. Several printheads of one name (`printhead` in [[input.dialect]]), no time (`time`), or \
             a recorder whose clock stands?",
            rfc3339(*t_ns)
        ),
        true => format!(
            "{lost} of {signals} signals of {printhead} come more than {} signals after later ones, so that no fault can be \
             followed over them: raise episodes.reorder_signals, or sort the recording by time",
            settings.episodes.reorder_signals
        ),
    };
    let (signals, judged) = (*signals, signals - lost);
    let printhead = Some(printhead.to_string());
    NotJudged { printhead, topic: None, signals, judged, what }
}

fn doubted(doubt: Doubt, tally: &Tally) -> NotJudged {
    let Doubt { printhead, what, is_settled_by_design, .. } = doubt;
    let signals = tally.printheads.get(&*printhead).map_or(0, |head| head.signals);
    let or_design = match is_settled_by_design {
        true => ", or a design of such signals is given (`inkling train`),",
        false => "",
    };
    let what = format!(
        "{printhead}: {what}. Until that is put right{or_design} its verdicts say nothing of nozzles"
    );
    NotJudged { printhead: Some(printhead), signals, what, ..NotJudged::default() }
}

/// The sentences about printheads of which no signal could be judged; if there are none, about the recording,
/// if less than half of it could be judged.
fn rejected(tally: &Tally, judges: &Judges, refusals: &[Refusal]) -> Vec<NotJudged> {
    let named = tally.printheads.iter().filter(|(name, _)| !name.is_empty());
    let nothing = named.filter(|(_, head)| head.signals > 0 && head.known() == 0);
    let mut all: Vec<NotJudged> = nothing
        .take(MOST_NAMED)
        .map(|(name, head)| {
            let why = why(name, head, judges, refusals);
            let what = match head.signals {
                1 => format!("the only signal of {name} could not be judged: {why}"),
                n => format!("none of the {n} signals of {name} could be judged: {why}"),
            };
            let (printhead, signals) = (Some(name.to_string()), head.signals);
            NotJudged { printhead, signals, what, ..NotJudged::default() }
        })
        .collect();

    // a burst that cannot be used is one row, whatever it held
    let Counts { bursts, unusable_bursts, .. } = tally.counts;
    if all.is_empty() && 2 * unusable_bursts > bursts {
        let judged = bursts - unusable_bursts;
        let what = format!("only {judged} of {bursts} bursts could be used");
        let (signals, judged) = (tally.counts.signals, tally.counts.judged);
        all.push(NotJudged { signals, judged, what, ..NotJudged::default() });
    }

    // those of printheads that turned out to be others tell nothing of their nozzles
    let of_others: u64 = tally.printheads.values().map(|head| head.judged - head.known()).sum();
    let (signals, judged) = (tally.counts.signals, tally.counts.judged - of_others);
    if all.is_empty() && 2 * judged < signals {
        // the printhead with the most signals that say nothing of their nozzles gives the reason
        let worst = tally.printheads.iter().max_by_key(|(_, head)| head.signals - head.known());
        let why = worst.map_or(String::new(), |(name, head)| why(name, head, judges, refusals));
        let what = format!("only {judged} of {signals} signals could be judged: {why}");
        all.push(NotJudged { signals, judged, what, ..NotJudged::default() });
    }
    all
}

/// The sentences about printheads of which many signals could not be judged, and some could.
fn partly<'a>(
    tally: &'a Tally,
    judges: &'a Judges,
    refusals: &'a [Refusal],
) -> impl Iterator<Item = NotJudged> + 'a {
    // a burst that cannot be used is one row; it held about as many signals as the others do
    let Counts { bursts, unusable_bursts, signals, .. } = tally.counts;
    let held = (signals - unusable_bursts).checked_div(bursts - unusable_bursts).unwrap_or(1);
    let lost = move |of: &PrintheadTally| {
        let unusable = of.unusable_bursts();
        let rows = of.signals - of.known();
        (rows - unusable + unusable * held.max(1), unusable)
    };
    let lacking = tally.printheads.iter().filter(move |(name, of)| {
        let share = lost(of).0 as f64 / (lost(of).0 + of.known()) as f64;
        !name.is_empty() && of.known() > 0 && share > LITTLE
    });
    lacking.take(MOST_NAMED).map(move |(name, head)| {
        let (signals, judged) = (head.signals, head.known());
        let why = why(name, head, judges, refusals);
        let what = match lost(head) {
            (all, unusable) if 2 * unusable * held > all => {
                let share = percent(all, all + judged);
                format!("{unusable} bursts of {name}, about {share} of its signals, could not be used: {why}")
            }
            _ => format!("{} of {signals} signals of {name} could not be judged: {why}", signals - judged),
        };
        NotJudged { printhead: Some(name.to_string()), signals, judged, what, topic: None }
    })
}

/// Why a printhead's signals could not be judged: the commonest reason, with the numbers that differ from the
/// design's or the reason for which a window was refused.
fn why(name: &str, head: &PrintheadTally, judges: &Judges, refusals: &[Refusal]) -> String {
    let commonest = head.unknown.iter().max_by_key(|(_, n)| **n);
    let Some((&reason, _)) = commonest else { return "no reason is known".into() };
    let says = format!("{} ({})", reason.in_words(), reason.as_str());
    let refused = refusals.iter().find(|refusal| refusal.printhead == name);
    match (reason, judges.other_sampling(name), refused) {
        (Reason::DesignMismatch, Some(differs), _) => format!(
            "{says}: {differs}. Give the design of these recordings, or make one: `inkling train`"
        ),
        (Reason::DesignMismatch | Reason::NoModel, _, Some(refusal)) => {
            format!("{says}: {}", refusal.why)
        }
        (Reason::Saturated, ..) => {
            format!("{says}: these are input.rails, by default those of 16 bits")
        }
        _ => says,
    }
}
