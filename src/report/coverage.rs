//! What of the recordings was judged, and what was not: a page may say that nothing needs care of what was judged alone.
//! In: a [`Survey`], the recordings' documents, what could not be read. Out: [`Coverage`], which says it in sentences.

use super::source::{Lost, Source};
use super::survey::{Survey, Tally};
use super::words::{counted, counted_as, percent, thousands};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Gaps and recordings told by name in a sentence.
const MOST_NAMED: usize = 4;

/// A printhead of which nothing, or recordings of which less than half, was judged.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Gap {
    /// How many signals of what, and why, of the latest of its recordings.
    pub what: String,
    /// The latest of them.
    pub recording: String,
    pub recordings: u64,
}

#[derive(Clone, Debug, Default, serde::Serialize)]
pub struct Coverage {
    pub gaps: Vec<Gap>,
    /// Recordings without verdicts.
    pub lost: Vec<Lost>,
    /// Channels of which at least one signal was judged.
    pub channels: u64,
    /// Channels of which none was.
    pub unknown_channels: u64,
    pub judged: u64,
    pub not_judged: u64,
    /// Recordings that were damaged, or whose faults or counts are missing.
    pub not_whole: u64,
    /// Recordings whose faults nobody knows, as their table of episodes is missing.
    pub without_faults: u64,
}

impl Coverage {
    pub fn of(survey: &Survey, sources: &[Source], lost: Vec<Lost>) -> Coverage {
        let channels = || survey.heads.iter().flat_map(|head| &head.channels);
        let tallies = || survey.heads.iter().flat_map(|head| head.tallies.values());
        let is_whole = |source: &&Source| {
            let damage = source.document["damage"].as_array();
            source.missing.is_empty() && damage.is_none_or(Vec::is_empty)
        };
        Coverage {
            gaps: gaps(survey, sources),
            lost,
            channels: channels().filter(|c| c.judged > 0).count() as u64,
            unknown_channels: channels().filter(|c| c.judged == 0).count() as u64,
            judged: tallies().map(|t| t.judged).sum(),
            not_judged: tallies().map(Tally::not_judged).sum::<u64>() + survey.left_out,
            not_whole: sources.iter().filter(|source| !is_whole(source)).count() as u64,
            without_faults: sources.iter().filter(|s| s.missing.contains(&"episodes")).count()
                as u64,
        }
    }

    /// Whether of anything it is known what its faults are.
    pub fn knows_faults(&self, recordings: usize) -> bool {
        self.judged > 0 && self.without_faults < recordings as u64
    }

    /// Whatever there was, was judged.
    pub fn is_complete(&self) -> bool {
        self.gaps.is_empty() && self.lost.is_empty() && self.not_judged + self.not_whole == 0
    }

    /// What is said before anything else: what nobody judged. `None`: whatever there was, was judged.
    pub fn first(&self) -> Option<String> {
        let rest = if self.judged == 0 { String::new() } else { self.rest() };
        let sentences = match (self.named(), rest.as_str()) {
            (named, _) if named.is_empty() && self.judged == 0 => "Nothing was judged.".to_owned(),
            (named, _) if self.judged == 0 => format!("Nothing was judged. {named}."),
            (named, "") if named.is_empty() => return None,
            (named, rest) if named.is_empty() => format!("Not all is known: {rest}."),
            (named, "") => format!("Not judged. {named}."),
            (named, rest) => format!("Not judged. {named}. In all, {rest}."),
        };
        Some(sentences)
    }

    /// Whole printheads and recordings; empty: none.
    fn named(&self) -> String {
        let of_gap = |gap: &Gap| match gap.recordings {
            1 => format!("{}: {}", gap.recording, gap.what),
            n => format!("{}, the last of {n} recordings: {}", gap.recording, gap.what),
        };
        let of_lost = |lost: &Lost| format!("{}: {}", lost.name, lost.why);
        let all: Vec<String> =
            self.gaps.iter().map(of_gap).chain(self.lost.iter().map(of_lost)).collect();
        let more = match all.len().saturating_sub(MOST_NAMED) {
            0 => String::new(),
            n => format!("; and {n} more"),
        };
        let named: Vec<String> = all.iter().take(MOST_NAMED).cloned().collect();
        named.join("; ") + &more
    }

    /// Signals, channels and recordings of which not all is known; empty: none.
    fn rest(&self) -> String {
        let mut parts = Vec::new();
        if self.without_faults > 0 {
            let recordings = counted(self.without_faults, "recording");
            parts.push(format!("the faults of {recordings} are not known"));
        }
        if self.not_judged > 0 {
            let all = self.judged + self.not_judged;
            let signals = counted_as(self.not_judged, "1 signal", "signals");
            let verb = if self.not_judged == 1 { "was" } else { "were" };
            parts.push(format!("{signals} ({}) {verb} not judged", percent(self.not_judged, all)));
        }
        if self.unknown_channels > 0 {
            parts
                .push(format!("of {} nothing is known", counted(self.unknown_channels, "channel")));
        }
        if self.not_whole > 0 {
            parts.push(format!("{} not whole", is_or_are(self.not_whole)));
        }
        parts.join(", ")
    }
}

fn is_or_are(recordings: u64) -> String {
    match recordings {
        1 => "1 recording is".into(),
        n => format!("{} recordings are", thousands(n)),
    }
}

/// By printhead, with how many recordings it is so in; the recordings themselves where no printhead stands for them.
fn gaps(survey: &Survey, sources: &[Source]) -> Vec<Gap> {
    let mut by_head: BTreeMap<Option<Arc<str>>, Vec<(usize, String)>> = BTreeMap::new();
    for (recording, source) in sources.iter().enumerate() {
        let tallies = || {
            let of_head = |head: &'_ super::survey::Head| head.tallies.get(&recording).cloned();
            survey.heads.iter().filter_map(move |h| Some((h.name.clone(), of_head(h)?)))
        };
        let mut all = Tally::default();
        let mut is_told = false;
        for (name, tally) in tallies() {
            (all.judged, all.rejected) = (all.judged + tally.judged, all.rejected + tally.rejected);
            if tally.judged == 0 && tally.not_judged() > 0 && !name.is_empty() {
                is_told = true;
                let why = why(source, Some(&name), &tally);
                by_head.entry(Some(name)).or_default().push((recording, why));
            }
        }
        let is_empty = all == Tally::default() && survey.left_out == 0;
        if !is_told && (all.judged < all.not_judged() || is_empty) {
            by_head.entry(None).or_default().push((recording, why(source, None, &all)));
        }
    }
    let gap = |(_, mut of): (_, Vec<(usize, String)>)| {
        let recordings = of.len() as u64;
        let (recording, what) = of.pop()?;
        Some(Gap { what, recording: sources[recording].name.clone(), recordings })
    };
    by_head.into_iter().filter_map(gap).collect()
}

/// As its summary says it, or else by its counts.
fn why(source: &Source, printhead: Option<&str>, tally: &Tally) -> String {
    let told = source.document["not_judged"].as_array().into_iter().flatten();
    let mut told = told.filter(|of| of["printhead"].as_str() == printhead);
    if let Some(what) = told.next().and_then(|of| of["what"].as_str()) {
        return what.to_owned();
    }
    let (n, all) = (tally.not_judged(), tally.judged + tally.not_judged());
    if all == 0 {
        return "no signal was found in it".into();
    }
    let of = printhead.map_or(String::new(), |name| format!(" of {name}"));
    let commonest = tally.reasons.iter().max_by_key(|(_, n)| **n);
    let why = commonest.map_or(String::new(), |(reason, _)| format!(": {}", reason.in_words()));
    format!("{} of {} signals{of} were not judged{why}", thousands(n), thousands(all))
}
