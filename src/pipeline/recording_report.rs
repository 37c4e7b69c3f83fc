//! The report of a recording that was judged, and in it what could not be judged, which whoever reads of a
//! recording is told before anything else.
//!
//! In: a finished recording, from `finish` ([`note_not_judged`]). Out: its report, with a sentence
//! * for each printhead of which nothing could be judged, or for the recording, if less than half of its signals
//!   could be judged (`rejected`);
//! * for each printhead whose samples (`doubted`) or times (`without_times`) are not what they are taken for;
//! * and for each topic that nobody reads though a dialect nearly fits it (`nobody_reads`).
//!
//! Such a sentence gives the run exit status 4: nobody may take silence for health. Other topics that look like
//! bursts are only warned about.

use super::episodes::EpisodeReport;
use super::head_movement::HeadMovement;
use super::judges::{Judges, Refusal};
use super::pacer::PaceReport;
use super::ring_look::{self, Doubt};
use super::run::Replay;
use super::tally::{Counts, PrintheadTally, Tally};
use super::timings::{PhaseTiming, StageTiming};
use crate::report::{WrongStretch, rfc3339};
use crate::settings::Settings;
use inkling_core::burst::UnusableBurst;
use inkling_core::episodes::Untimely;
use inkling_core::numbers::LITTLE;
use inkling_core::state::Memory;
use inkling_core::verdict::Reason;
use inkling_io::damage::Damage;
use inkling_io::journal::{Outcome, Stamp};
use inkling_io::peek::UnreadChannel;
use inkling_io::recording::Recording;
use inkling_io::verdict_arrays::VerdictArrays;
use serde::Serialize;
use serde_json::{Map, Value, json};
use std::path::PathBuf;
use std::sync::Arc;

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

/// What a judged recording gave, for the terminal, the journal and the summary.
#[derive(Debug)]
pub struct RecordingReport {
    pub name: String,
    pub digest: String,
    pub stamp: Stamp,
    pub tally: Tally,
    pub damage: Vec<Damage>,
    pub refusals: Vec<Refusal>,
    /// Printheads of which nothing was judged, or the recording itself, if less than half of it was.
    pub not_judged: Vec<NotJudged>,
    /// Topics that look like bursts and that nothing reads, if no dialect nearly fits them.
    pub unread: Vec<NotJudged>,
    /// What was odd about the times of printheads' bursts.
    pub odd_times: Vec<NotJudged>,
    /// The bursts whose times stand in no order with others.
    pub wrong_times: Vec<WrongStretch>,
    pub moved: Vec<HeadMovement>,
    /// Printheads, each with what to know about its verdicts.
    pub warnings: Vec<(Arc<str>, String)>,
    /// Those of them about what all channels of a printhead did, or what its channels are.
    pub head_changes: Vec<(Arc<str>, String)>,
    pub models: usize,
    pub seconds: f64,
    /// Path of the verdict table; empty: the rows stay in memory.
    pub verdicts: PathBuf,
    pub episodes: EpisodeReport,
    /// How the pace was kept; `None`: bursts were handed on as fast as possible.
    pub paced: Option<PaceReport>,
    pub phases: Vec<PhaseTiming>,
    pub timings: Vec<StageTiming>,
    /// With `--baseline`: what is remembered for the next recording.
    pub baselines: Option<Memory>,
    /// Whether following the recording was ended while nobody had closed it.
    pub cut_off: bool,
    pub arrays: Option<VerdictArrays>,
}

impl RecordingReport {
    /// Whether a warning about all channels of a printhead explains what its windows and signals show.
    pub fn has_moved(&self, printhead: &str) -> bool {
        self.moved.iter().any(|of| *of.printhead == *printhead && of.is_of_all_channels())
    }

    pub fn outcome(&self) -> Outcome {
        match self {
            _ if !self.not_judged.is_empty() => Outcome::NotJudged,
            _ if !self.damage.is_empty() => Outcome::Damaged,
            _ if !self.tally.counts.rejected.is_empty() => Outcome::Damaged,
            _ if !self.refusals.is_empty() => Outcome::WindowRefused,
            _ => Outcome::Judged,
        }
    }

    /// Adds how the run went to the metadata's document, which so becomes the summary.
    pub(super) fn summary(&self, document: &mut Map<String, Value>, recording: &Recording) {
        let mut say = |key: &str, value: Value| document.insert(key.into(), value);
        say("damage", json!(self.damage));
        say("expected", json!(recording.expected));
        say("refused_windows", json!(self.refusals));
        say("not_judged", json!(self.not_judged));
        say("unread", json!(self.unread));
        say("odd_times", json!(self.odd_times));
        say("wrong_times", json!(self.wrong_times));
        let rates = json!({
            "seconds": self.seconds,
            "signals_per_s": self.tally.counts.signals as f64 / self.seconds,
            "bytes_per_s": recording.bytes as f64 / self.seconds,
            "paced_bursts": self.paced.map(|paced| paced.bursts),
            "behind_s": self.paced.map(|paced| paced.behind.as_secs_f64()),
        });
        say("rates", rates);
        say("phases", json!(self.phases));
        say("timings", json!(self.timings));
        let warning = |(printhead, what): &(Arc<str>, String)| json!({"printhead": &**printhead, "what": what});
        say("warnings", self.warnings.iter().map(warning).collect());
        say("head_changes", self.head_changes.iter().map(warning).collect());
        say("episodes", json!(self.episodes.counts));
        say("moved_together", json!(self.moved));
        if let Some(memory) = &self.baselines {
            // what is known of other printheads says nothing of this recording
            let own = memory.printheads.iter();
            let own = own.filter(|(name, _)| self.tally.printheads.contains_key(name.as_str()));
            let channels: usize = own.map(|(_, of)| of.channels.len()).sum();
            say("baseline", json!({ "channels_remembered": channels }));
        }
    }
}

/// Maximum number of printheads, and of topics, that are told by name.
const MOST_NAMED: usize = 64;

/// Notes in a report what was not judged: the printheads, each once, or the recording, and the topics that look
/// like bursts and that nothing reads, without those that the settings ignore.
pub fn note_not_judged(
    report: &mut RecordingReport,
    (replay, recording): (&Replay, &Recording),
    judges: &Judges,
) {
    let (tally, settings) = (&report.tally, &replay.settings);

    // printheads
    let has_design = replay.design.is_some();
    let doubts = ring_look::doubts(recording, has_design).into_iter();
    let (doubts, of_some): (Vec<_>, Vec<_>) = doubts.partition(|doubt| doubt.is_of_most);
    let of_other_unit = report.moved.iter().filter_map(|of| {
        Some(Doubt {
            printhead: of.printhead.to_string(),
            what: of.of_other_unit()?,
            is_of_most: true,
            is_settled_by_design: false,
        })
    });
    let doubts = doubts.into_iter().chain(of_other_unit);
    let doubts: Vec<NotJudged> = doubts.map(|doubt| doubted(doubt, tally)).collect();
    report.unread.extend(of_some.into_iter().map(|Doubt { printhead, what, .. }| NotJudged {
        what: format!("{printhead}: {what}"),
        printhead: Some(printhead),
        ..NotJudged::default()
    }));
    let rejected = rejected(tally, judges, &report.refusals);
    let is_known =
        |told: &NotJudged| report.odd_times.iter().any(|of| of.printhead == told.printhead);
    let untimely = report.episodes.untimely.iter().map(|head| without_times(head, settings));
    let (untimely, few): (Vec<_>, Vec<_>) =
        untimely.partition(|told| 2 * told.judged <= told.signals);
    let few: Vec<NotJudged> = few.into_iter().filter(|told| !is_known(told)).collect();
    report.odd_times.extend(few);
    report.odd_times.extend(twice(report.episodes.counts.signals_repeated, tally.counts.signals));

    let mut all: Vec<NotJudged> = Vec::new();
    // the first sentence about a printhead stays: a doubt about its samples explains the rest
    for told in doubts.into_iter().chain(rejected).chain(untimely) {
        if all.iter().all(|known| known.printhead != told.printhead) {
            all.push(told);
        }
    }

    // of printheads of which some was judged that is told, unless a warning or one of these sentences says more
    let is_new = |told: &NotJudged| {
        let said = told.printhead.as_deref().is_some_and(|name| report.has_moved(name));
        !said && all.iter().all(|known| known.printhead != told.printhead)
    };
    let partly = partly(tally, judges, &report.refusals).filter(is_new);
    report.unread.extend(partly.collect::<Vec<_>>());

    let ignored = settings.input.ignored();
    let printheads: Vec<&str> = tally.printheads.keys().map(|name| &**name).collect();
    let topics = recording.unread(&settings.input.dialects(), &printheads).into_iter();
    for topic in topics.filter(|topic| !ignored.has(&topic.topic)).take(MOST_NAMED) {
        // topics that a dialect nearly fits count as not judged; the others are only told of
        let list = if topic.by_dialect { &mut all } else { &mut report.unread };
        list.push(nobody_reads(topic));
    }
    report.unread.extend(judges.wide_thresholds(true).map(|(printhead, what)| {
        let what = format!("{printhead}: {what}");
        NotJudged { printhead: Some(printhead.to_string()), what, ..NotJudged::default() }
    }));
    report.unread.extend(recording.silent.iter().map(|topic| NotJudged {
        topic: Some(topic.clone()),
        what: format!("topic {topic}: has no messages, so that nothing is known of its printhead"),
        ..NotJudged::default()
    }));
    let unusable = tally.counts.unusable_bursts;
    if unusable > 0
        && let Some(first) = recording.first_unusable()
    {
        report.unread.push(no_burst(unusable, &first));
    }
    report.not_judged = all;
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
    NotJudged { topic: Some(topic), what, ..NotJudged::default() }
}

/// The sentence about a printhead whose times are of no use for some of its signals.
fn without_times(of: &Untimely, settings: &Settings) -> NotJudged {
    let Untimely { printhead, signals, at_one_time, too_late, t_ns } = of;
    // the commoner of the two causes is told
    let lost = at_one_time + too_late;
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
    let lacking = tally.printheads.iter().filter(|(name, of)| {
        let lost = of.signals - of.known();
        !name.is_empty() && of.known() > 0 && lost as f64 > LITTLE * of.signals as f64
    });
    lacking.take(MOST_NAMED).map(move |(name, head)| {
        let (signals, judged) = (head.signals, head.known());
        let why = why(name, head, judges, refusals);
        let lost = signals - judged;
        let what = format!("{lost} of {signals} signals of {name} could not be judged: {why}");
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
