//! Printheads of which nothing, and recordings of which less than half, could be judged: whoever reads of a recording
//! is told so before anything else. In: the tally of a finished recording and what its models were refused for.
//! Out: a sentence each, with the numbers that differ.

use super::schedule::{Refusal, Schedule};
use super::tally::{PrintheadTally, Tally};
use crate::verdict::Reason;
use serde::{Deserialize, Serialize};

/// Printheads that are told by name.
const MOST_NAMED: usize = 64;

/// Of what hardly anything was judged.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct NotJudged {
    /// `None`: of the recording as a whole.
    pub printhead: Option<String>,
    pub signals: u64,
    pub judged: u64,
    /// A sentence without its full stop: how many signals of how many, why, and what to do.
    pub what: String,
}

pub fn not_judged(tally: &Tally, schedule: &Schedule, refusals: &[Refusal]) -> Vec<NotJudged> {
    let named = tally.printheads.iter().filter(|(name, _)| !name.is_empty());
    let nothing = named.filter(|(_, head)| head.signals > 0 && head.known() == 0);
    let mut all: Vec<NotJudged> = nothing
        .take(MOST_NAMED)
        .map(|(name, head)| {
            let why = why(name, head, schedule, refusals);
            let what = match head.signals {
                1 => format!("the only signal of {name} could not be judged: {why}"),
                n => format!("none of the {n} signals of {name} could be judged: {why}"),
            };
            NotJudged { printhead: Some(name.to_string()), signals: head.signals, judged: 0, what }
        })
        .collect();
    let (signals, judged) = (tally.counts.signals, known(tally));
    if all.is_empty() && 2 * judged < signals {
        let worst = tally.printheads.iter().max_by_key(|(_, head)| head.signals - head.known());
        let why = worst.map_or(String::new(), |(name, head)| why(name, head, schedule, refusals));
        let what = format!("only {judged} of {signals} signals could be judged: {why}");
        all.push(NotJudged { printhead: None, signals, judged, what });
    }
    all
}

/// Signals of a recording of whose nozzles something is known.
fn known(tally: &Tally) -> u64 {
    let of_other_heads = |head: &PrintheadTally| head.judged - head.known();
    tally.counts.judged - tally.printheads.values().map(of_other_heads).sum::<u64>()
}

/// The numbers that differ where there are some; else the commonest reason, and why a window was refused.
fn why(name: &str, head: &PrintheadTally, schedule: &Schedule, refusals: &[Refusal]) -> String {
    let commonest = head.unknown.iter().max_by_key(|(_, n)| **n);
    let Some((&reason, _)) = commonest else { return "no reason is known".into() };
    let says = format!("{} ({})", reason.in_words(), reason.as_str());
    let refused = refusals.iter().find(|refusal| refusal.printhead == name);
    match (reason, schedule.other_sampling(name), refused) {
        (Reason::DesignMismatch, Some(differs), _) => format!(
            "{says}: {differs}. Give the design of these recordings, or make one: `inkling train`"
        ),
        (Reason::DesignMismatch | Reason::NoModel, _, Some(refusal)) => {
            format!("{says}: {}", refusal.why)
        }
        _ => says,
    }
}

impl PrintheadTally {
    /// Signals of whose nozzles something is known.
    pub fn known(&self) -> u64 {
        self.signals - self.unknown.values().sum::<u64>()
    }
}
