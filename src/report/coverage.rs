//! Which part of the recordings was judged, and which was not. The page may say that nothing needs care only about what
//! was judged, so it says, too, what was not.
//!
//! In: a [`Survey`] that has seen all verdicts, the JSON documents of the recordings' summaries,
//! and the recordings that have no verdicts. Out: a [`Coverage`], which the page, the terminal
//! (`first`) and the JSON output tell.
//!
//! A gap is something that was not judged, in words. Three functions find gaps: `gaps`, by what the
//! summaries say and what the counts of each recording show; `not_measured`, printheads and channels
//! that were not measured in the last night, or channels silent since the first half of their
//! latest recording; `doubtful`, channels of which nothing certain is known now.

use super::counts::{ChannelCount, Tally};
use super::night::{Span, last_night, whole};
use super::source::{LostRecording, Source};
use super::survey::{Head, Survey};
use super::words::{clock, counted, first_of, joined, numbered, of_some, percent, thousands};
use inkling_core::verdict::Reason;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Most gaps and lost recordings that a sentence names one by one.
const MOST_NAMED: usize = 4;

/// Something that was not judged, or is not known well enough.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Gap {
    /// What was not judged and why, for the latest of the recordings concerned.
    pub what: String,
    /// The printhead concerned; `None` for a gap of a whole recording or of a topic.
    pub printhead: Option<Arc<str>>,
    /// Name of the latest recording concerned.
    pub recording: String,
    /// Index of that recording among the sources; several recordings may have one name.
    #[serde(skip)]
    pub source: usize,
    /// Number of recordings concerned.
    pub recordings: u64,
}

impl Gap {
    /// A gap of a printhead in one recording, the source with the index `at`.
    fn of_head(head: &Head, what: String, at: usize, sources: &[Source]) -> Option<Gap> {
        let recording = sources.get(at)?.name.clone();
        Some(Gap { what, printhead: Some(head.name.clone()), recording, source: at, recordings: 1 })
    }
}

/// Counts of what was judged, and what was not. It is written under `coverage` in the JSON output.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub struct Coverage {
    pub gaps: Vec<Gap>,
    /// Recordings without verdicts.
    pub lost: Vec<LostRecording>,
    /// Number of channels of which at least one signal was judged.
    pub channels: u64,
    /// Number of channels of which no signal was judged.
    pub unknown_channels: u64,
    /// Number of judged signals.
    pub judged: u64,
    /// Number of signals that were not judged, and of rows that the survey left out.
    pub not_judged: u64,
    /// Number of recordings that were damaged, or whose table of episodes or summary is missing.
    pub not_whole: u64,
    /// Number of recordings whose faults are not known, because their table of episodes is missing.
    pub without_faults: u64,
    /// Number of recordings, with verdicts or without, whose damage somebody has acknowledged. The report does not begin
    /// with them; yet with them not all is known.
    pub acknowledged: u64,
    /// The part of `not_judged` and `not_whole` that is in recordings whose damage is acknowledged.
    #[serde(skip)]
    acknowledged_not_judged: u64,
    #[serde(skip)]
    acknowledged_not_whole: u64,
    /// Number of all recordings with verdicts.
    #[serde(skip)]
    recordings: u64,
}

/// How much is known: it decides what a report that names no channel to clean may say.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Extent {
    NothingJudged,
    /// No recording has its table of episodes.
    FaultsUnknown,
    Partial,
    /// Everything was judged, and no recording is damaged or incomplete.
    Complete,
}

impl Coverage {
    /// The coverage of these recordings. `sources`: in the order of the survey's indices.
    pub fn of(survey: &Survey, sources: &[Source], lost: Vec<LostRecording>) -> Coverage {
        let tallies = || survey.heads.iter().flat_map(|head| head.tallies.values());
        let is_whole = |of: &&Source| of.missing.is_empty() && of.damaged_places() == 0;
        let is_known = |of: &&Source| of.known.is_some();
        let rejected = |recording: usize| {
            let of_heads = survey.heads.iter().filter_map(|head| head.tallies.get(&recording));
            of_heads.map(|tally| tally.rejected).sum::<u64>()
                + survey.left_out.get(&recording).copied().unwrap_or_default()
        };
        let known = sources.iter().enumerate().filter(|(_, of)| is_known(of));
        let lost_known = lost.iter().filter(|of| of.known).count();
        Coverage {
            acknowledged: (sources.iter().filter(is_known).count() + lost_known) as u64,
            acknowledged_not_judged: known.map(|(recording, _)| rejected(recording)).sum(),
            acknowledged_not_whole: sources
                .iter()
                .filter(|of| is_known(of) && !is_whole(of))
                .count() as u64,
            gaps: [gaps(survey, sources), not_measured(survey, sources), doubtful(survey, sources)]
                .concat(),
            lost,
            channels: survey.channels().filter(|c| c.judged > 0).count() as u64,
            unknown_channels: survey.channels().filter(|c| c.judged == 0).count() as u64,
            judged: tallies().map(|t| t.judged).sum(),
            not_judged: tallies().map(|t| t.rejected).sum::<u64>()
                + survey.left_out.values().sum::<u64>(),
            not_whole: sources.iter().filter(|of| !is_whole(of)).count() as u64,
            without_faults: sources.iter().filter(|of| !of.has_episodes()).count() as u64,
            recordings: sources.len() as u64,
        }
    }

    /// The first gap of a printhead that is told of the recording with this index among the sources.
    pub fn gap(&self, printhead: &Arc<str>, recording: usize) -> Option<&Gap> {
        let of_it = |gap: &&Gap| gap.source == recording;
        self.gaps.iter().filter(of_it).find(|gap| gap.printhead.as_ref() == Some(printhead))
    }

    pub fn extent(&self) -> Extent {
        if self.judged == 0 {
            Extent::NothingJudged
        } else if self.without_faults >= self.recordings {
            Extent::FaultsUnknown
        } else if self.is_complete() {
            Extent::Complete
        } else {
            Extent::Partial
        }
    }

    /// Whether everything in the recordings was judged, and no recording is damaged or incomplete.
    pub fn is_complete(&self) -> bool {
        let nothing_missing =
            self.gaps.is_empty() && self.lost.is_empty() && self.acknowledged == 0;
        nothing_missing && self.not_judged + self.not_whole == 0
    }

    /// The text that the report begins with: what was not judged. `None` if all is known but for what is acknowledged.
    pub fn first(&self) -> Option<String> {
        let (named, rest) = (self.named(), self.rest());
        match (named.as_str(), rest.as_str()) {
            ("", _) if self.judged == 0 => Some("Nothing was judged.".into()),
            (named, _) if self.judged == 0 => Some(format!("Nothing was judged. {named}.")),
            ("", "") => None,
            ("", rest) => Some(format!("Not all is known: {rest}.")),
            (named, "") => Some(format!("Not judged. {named}.")),
            (named, rest) => Some(format!("Not judged. {named}. In all, {rest}.")),
        }
    }

    /// The gaps and the lost recordings by name; empty if there are none.
    fn named(&self) -> String {
        let of_gap = |gap: &Gap| match gap.recordings {
            1 => format!("{}: {}", gap.recording, gap.what),
            n => format!("{}, the last of {n} recordings: {}", gap.recording, gap.what),
        };
        let of_lost = |lost: &LostRecording| format!("{}: {}", lost.name, lost.why);
        let lost = self.lost.iter().filter(|lost| !lost.known);
        let all: Vec<String> = self.gaps.iter().map(of_gap).chain(lost.map(of_lost)).collect();
        first_of(&all, MOST_NAMED, "; ")
    }

    /// Numbers of signals, channels and recordings that are not fully known; empty if there are none.
    fn rest(&self) -> String {
        let Coverage { without_faults, unknown_channels, .. } = *self;
        let not_judged = self.not_judged - self.acknowledged_not_judged;
        let not_whole = self.not_whole - self.acknowledged_not_whole;
        let share = percent(not_judged, self.judged + not_judged);
        let recordings = counted(without_faults, "recording");
        let signals = counted(not_judged, "signal");
        let channels = counted(unknown_channels, "channel");
        let broken = counted(not_whole, "recording");
        let was = if not_judged == 1 { "was" } else { "were" };
        let is = if not_whole == 1 { "is" } else { "are" };
        let parts = of_some([
            (without_faults, format!("the faults of {recordings} are not known")),
            (not_judged, format!("{signals} ({share}) {was} not judged")),
            (unknown_channels, format!("of {channels} nothing is known")),
            (not_whole, format!("{broken} {is} not whole")),
        ]);
        joined(parts, ", ")
    }
}

/// What a gap concerns: a printhead (first), a topic (second), or, if both are `None`, a whole recording.
type Subject = (Option<Arc<str>>, Option<String>);

/// A gap of one recording: the time of the last signal of its printhead, or else of the recording (`None`: there is none),
/// the recording's index, and the gap in words.
type Occurrence = (Option<i64>, usize, String);

/// The gaps of all recordings, merged by what they concern. Each text is that of the latest
/// recording concerned, by the last signal of the printhead concerned, or else of all.
fn gaps(survey: &Survey, sources: &[Source]) -> Vec<Gap> {
    let mut all: BTreeMap<Subject, Vec<Occurrence>> = BTreeMap::new();
    // of a recording whose damage is acknowledged nothing is missed
    for (recording, source) in sources.iter().enumerate().filter(|(_, of)| of.known.is_none()) {
        let span = |head: &Head| head.tallies.get(&recording)?.span;
        let of_all = whole(survey.heads.iter().filter_map(span));
        for (of, what) in of_recording(survey, recording, source) {
            let of_head = of.0.as_ref().and_then(|name| span(survey.get(name)?));
            let until = of_head.or(of_all).map(|(_, to_ns)| to_ns);
            all.entry(of).or_default().push((until, recording, what));
        }
    }
    let gap = |((printhead, _), places): (Subject, Vec<Occurrence>)| {
        let recordings = places.len() as u64;
        let (_, source, what) = places.into_iter().max()?;
        let recording = sources[source].name.clone();
        Some(Gap { what, printhead, recording, source, recordings })
    };
    all.into_iter().filter_map(gap).collect()
}

/// What was not judged of one recording: as its summary says, or else from the counts of its signals.
fn of_recording(survey: &Survey, recording: usize, source: &Source) -> BTreeMap<Subject, String> {
    let mut gaps = BTreeMap::new();
    let told = ["not_judged", "unread"].map(|key| source.document[key].as_array());
    for told in told.into_iter().flatten().flatten() {
        let text = |key: &str| told[key].as_str();
        let of = (text("printhead").map(Arc::from), text("topic").map(str::to_owned));
        let Some(what) = text("what") else { continue };
        // of one printhead several things may have to be told
        let all: &mut String = gaps.entry(of).or_default();
        all.push_str(if all.is_empty() { "" } else { "; " });
        all.push_str(what);
    }

    // Printheads of which nothing was judged, unless the summary named them.
    let mut all = Tally::default();
    let heads = survey.heads.iter();
    for (name, tally) in heads.filter_map(|of| Some((&of.name, of.tallies.get(&recording)?))) {
        (all.judged, all.rejected) = (all.judged + tally.judged, all.rejected + tally.rejected);
        for (reason, n) in &tally.reasons {
            *all.reasons.entry(*reason).or_default() += n;
        }
        if tally.judged == 0 && tally.rejected > 0 && !name.is_empty() {
            gaps.entry((Some(name.clone()), None)).or_insert_with(|| by_counts(Some(name), tally));
        }
    }

    // The recording as a whole: without any signal, or with less than half judged where no
    // printhead explains it. Where the summary knows of signals, why they are not here is told elsewhere.
    let is_empty = all == Tally::default()
        && !survey.left_out.contains_key(&recording)
        && source.document["counts"]["signals"].as_u64().unwrap_or_default() == 0;
    let is_told = gaps.keys().any(|(printhead, _)| printhead.is_some());
    if is_empty || !is_told && all.judged < all.rejected {
        gaps.entry((None, None)).or_insert_with(|| by_counts(None, &all));
    }
    gaps
}

/// A gap for each printhead that was not measured in the last night (`night::last_night`), or some
/// of whose channels were not, or fell silent in the first half of their latest recording.
fn not_measured(survey: &Survey, sources: &[Source]) -> Vec<Gap> {
    let tallies = survey.heads.iter().flat_map(|head| head.tallies.values());
    let mut spans: Vec<Span> = tallies.filter_map(|of| of.span).collect();
    spans.sort_unstable();
    let Some((_, to_ns)) = whole(spans.iter().copied()) else { return Vec::new() };
    let from_ns = last_night(&spans, to_ns);
    let gap = |head: &Head| {
        // One that was taken out since is not missed.
        if head.is_gone {
            return None;
        }
        // A printhead whose latest recording ended before the night, or that fell silent in the first half of it, is told
        // as a whole.
        let (recording, tally) = head.latest()?;
        let name = &head.name;
        // the times of a printhead whose clock is odd say nothing beside those of others
        let odd = sources[recording].document["odd_times"].as_array();
        let is_odd =
            |of: &Head| odd.into_iter().flatten().any(|told| told["printhead"] == *of.name);
        let others = survey.heads.iter().filter(|of| !is_odd(of));
        let spans = others.filter_map(|of| of.tallies.get(&recording)?.span);
        let (began, ended) = whole(spans.chain(tally.span))?;
        let half = began.saturating_add(ended.saturating_sub(began) / 2);
        // of one that was heard at a single moment nobody knows whether it fell silent
        let is_silent = |of: &Span| {
            let was_heard = tally.judged > 0 && of.0 < of.1;
            was_heard && !is_odd(head) && of.1 < half && of.1 >= from_ns
        };
        if let Some((_, last)) = tally.span.filter(is_silent) {
            let (last, ended) = (clock(last), clock(ended));
            let what = format!(
                "{name} after {last}: it fell silent then, and the recording goes on to {ended}"
            );
            return Gap::of_head(head, what, recording, sources);
        }
        // channels of which nothing was ever judged are told elsewhere
        let judged = || head.channels.iter().filter(|of| of.judged > 0);
        let silent = |of: &&ChannelCount| !of.is_measured(from_ns, &head.tallies);
        let silent: Vec<u32> = judged().filter(silent).map(|of| of.channel).collect();
        let what = match silent[..] {
            [] => return None,
            _ if tally.span?.1 < from_ns => format!(
                "{name} was not heard in the last night: this was its last recording. If it was taken out, say so: \
                 `inkling acknowledge OUT --replaced HEAD --from TIME`"
            ),
            _ => format!(
                "{} of {name}: not heard to the end of the last night ({} of its {})",
                numbered(&silent),
                silent.len(),
                counted(judged().count() as u64, "channel")
            ),
        };
        Gap::of_head(head, what, recording, sources)
    };
    survey.heads.iter().filter_map(gap).collect()
}

/// Gaps of channels that cannot be called healthy though they may have no episode: those flagged in most of
/// their signals, and those of which less than half was judged in their latest recording. Printheads of which
/// nothing was judged in that recording are told elsewhere.
fn doubtful(survey: &Survey, sources: &[Source]) -> Vec<Gap> {
    let flagged = "flagged in most of the latest signals, but no recording has enough of them to tell a fault: record \
        longer, or merge recordings (`mcap merge`)";
    let mut all = Vec::new();
    for head in &survey.heads {
        let mut tell = |channels: &[u32], at: usize, words: &str| {
            let is_judged = head.tallies.get(&at).is_some_and(|tally| tally.judged > 0);
            if is_judged && !channels.is_empty() {
                let what = format!("{} of {}: {words}", numbered(channels), head.name);
                all.extend(Gap::of_head(head, what, at, sources));
            }
        };

        // what is flagged is told for the printhead's latest recording
        let channels = head.channels.iter().filter(|of| of.is_doubtful()).map(|of| of.channel);
        if let Some((at, _)) = head.latest() {
            tell(&channels.collect::<Vec<_>>(), at, flagged);
        }

        // Reasons are counted by printhead, so a channel's reason is known only where its printhead has a single one.
        let mut unknown: BTreeMap<usize, Vec<u32>> = BTreeMap::new();
        for of in head.channels.iter().filter(|of| !of.is_known_now()) {
            unknown.entry(of.latest()).or_default().push(of.channel);
        }
        for (at, channels) in unknown {
            let reasons = head.tallies.get(&at).map(|tally| &tally.reasons);
            let only = reasons.filter(|of| of.len() == 1).and_then(|of| of.keys().next());
            let why = only.map_or(String::new(), |reason| format!(" ({})", reason.in_words()));
            tell(&channels, at, &format!("mostly not judged{why}"));
        }
    }
    all
}

/// How many signals of a printhead or a recording were not judged, with the most frequent reason.
fn by_counts(printhead: Option<&str>, tally: &Tally) -> String {
    let (n, all) = (tally.rejected, tally.signals());
    if all == 0 {
        return "no signal was found in it".into();
    }
    let of = printhead.map_or(String::new(), |name| format!(" of {name}"));
    let reason = tally.commonest_reason();
    let why = reason.map_or(String::new(), |reason| format!(": {}", reason.in_words()));
    let advice = match reason {
        Some(Reason::DesignMismatch) => "; `inkling train` on its own recordings makes a design",
        _ => "",
    };
    format!("{} of {} signals{of} were not judged{why}{advice}", thousands(n), thousands(all))
}

#[cfg(test)]
mod tests {
    use super::super::fixtures::{surveyed, verdicts};
    use super::*;
    use inkling_core::verdict::Outcome;

    /// A row of printhead `p`: recording, time, channel, and why it was not judged.
    type Looked = (usize, i64, u32, Option<Reason>);

    /// The gaps of recordings with these names and rows.
    fn gaps_of(names: &[&str], rows: &[Looked]) -> Coverage {
        let mut recordings = vec![Vec::new(); names.len()];
        for &(recording, t_ns, channel, reason) in rows {
            let outcome = if reason.is_some() { Outcome::Rejected } else { Outcome::Healthy };
            let mut columns = verdicts(t_ns, [(channel, outcome)]);
            columns.reason = vec![reason];
            recordings[recording].push(columns);
        }
        let survey = surveyed(&recordings);
        let source = |name: &&str| Source { name: (*name).to_owned(), ..Source::default() };
        Coverage::of(&survey, &names.iter().map(source).collect::<Vec<_>>(), Vec::new())
    }

    #[test]
    fn the_latest_recording_is_told_whatever_the_order_and_the_names() {
        let why = Some(Reason::Saturated);
        let rows = [(0, 2_000, 1, why), (0, 2_001, 1, why), (1, 1_000, 1, why)];
        let p: Arc<str> = "p".into();
        for names in [["night2", "night1"], ["x", "x"]] {
            let coverage = gaps_of(&names, &rows);
            let gap = coverage.gap(&p, 0).unwrap();
            assert_eq!((gap.recording.as_str(), gap.recordings), (names[0], 2));
            assert!(gap.what.starts_with("2 of 2 signals of p"), "{}", gap.what);
            assert!(coverage.gap(&p, 1).is_none());
        }
    }

    #[test]
    fn a_channel_is_told_with_its_own_latest_recording_and_reason() {
        // channel 7 is mostly saturated in `a` and not in `b`, in which channel 1 has no number
        let mut rows: Vec<Looked> = (0..8).map(|t| (0, t, 7, Some(Reason::Saturated))).collect();
        rows.extend([(0, 8, 7, None), (0, 9, 7, None), (0, 9, 1, None)]);
        rows.extend([(1, 100, 1, Some(Reason::NonFinite)), (1, 101, 1, None), (1, 102, 1, None)]);
        let told = |gap: &Gap| gap.what.contains("mostly not judged");
        let coverage = gaps_of(&["a", "b"], &rows);
        let gap = coverage.gaps.iter().find(|gap| told(gap)).unwrap();
        let words = Reason::Saturated.in_words();
        assert_eq!(gap.what, format!("channel 7 of p: mostly not judged ({words})"));
        assert_eq!(gap.recording, "a");
    }

    #[test]
    fn an_empty_recording_is_told_beside_one_with_rows_left_out() {
        let mut survey = Survey::new(&[Vec::new(), Vec::new()]);
        survey.left_out.insert(0, 3);
        let sources = ["a", "b"].map(|name| Source { name: name.into(), ..Source::default() });
        let coverage = Coverage::of(&survey, &sources, Vec::new());
        let told: Vec<_> = coverage.gaps.iter().map(|gap| gap.recording.as_str()).collect();
        assert_eq!((told, coverage.not_judged), (vec!["b"], 3));
    }
}
