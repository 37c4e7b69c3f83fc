//! The report that a person looks at. From the verdicts, episodes and summaries of any number of
//! recordings it tells which channels to clean, since when they are faulty, and whether the
//! verdicts can be trusted.
//!
//! In: the [`Source`] and the episodes of each recording, then all verdicts once ([`Survey`]). Out: a
//! [`Report`], and from it the page (`html`), the list on a terminal (`print`) and the table of
//! faults. The report never judges by itself: the episodes decide what is a fault.
//!
//! The steps, each in a file:
//! 1. `clocks` puts times right that a wrong clock gave; `recording_counts` reads the verdicts of a recording once, and `survey` adds
//!    them up: `counts`, a map of each printhead (`map`), and a `watch` of each channel that had an episode.
//! 2. `coverage` and `false_alarms` say what was judged, and how well.
//! 3. `story` links the episodes of each channel into one story per fault; `naming` says until when its
//!    signals carry its name, and `trend` whether the fault grows. `fault` makes an entry of the cleaning list of each story.
//! 4. `notes`, `head_changes`, `changes` and `drift` look over channels, printheads and nights.
//! 5. `page` writes all that with `heads`, `tables`, `maps` and `figures`, and `account` as one document.
//!
//! What people have acknowledged (`acknowledged`) is heeded in steps 2 and 3: a replaced channel's stories end there,
//! known faults and known damage are marked, and are no news.
//!
//! `promised` words what a design promises, for the verbs `score` and `identify`.

mod account;
mod acknowledged;
mod bins;
mod changes;
mod clocks;
mod counts;
mod coverage;
mod drift;
mod false_alarms;
mod fault;
mod figures;
#[cfg(test)]
mod fixtures;
mod head_changes;
mod heads;
mod light;
mod list;
mod map;
mod maps;
mod naming;
mod night;
mod notes;
mod page;
mod promised;
mod recording_counts;
mod settings;
mod source;
mod story;
mod survey;
mod tables;
mod trend;
mod watch;
mod words;

pub use acknowledged::{
    Acknowledged, COLUMNS as ACKNOWLEDGED_COLUMNS, in_words as acknowledged_in_words,
    time as acknowledged_time,
};
pub use changes::Changes;
pub use clocks::{Clocks, WrongStretch};
pub use fault::{Fault, certain_trend, forecast_in_words, size, trend_in_words, what};
pub use head_changes::HeadChange;
pub use list::print;
pub use maps::waterfalls;
pub use night::{Span, whole};
pub use notes::Note;
pub use page::html;
pub use promised::print as print_promise;
pub use recording_counts::{Names, RecordingCounts};
pub use settings::ReportSettings;
pub use source::{LostRecording, Source};
pub use story::Story;
pub use survey::Survey;
pub use words::{
    Column, alike, channels, clock, columns, first_of, grouped, numbered, percent, rfc3339,
    three_digits,
};

use counts::Tally;
use coverage::Coverage;
use drift::ModelPoint;
use false_alarms::FalseAlarms;
use fault::hours_to_visible;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use story::Rates;
use watch::{Spell, Watch};

/// Counts of one recording: a line of the page's table of recordings.
#[derive(Clone, Debug)]
pub struct RecordingLine {
    pub name: String,
    /// Index of the recording among the sources, by which spells refer to it.
    pub source: usize,
    /// From the recording's first to its last signal, ns since 1970; `None` if it has none.
    pub span: Option<Span>,
    /// Number of judged signals.
    pub judged: u64,
    /// What is wrong with the data, in words; empty if nothing is.
    pub flaws: String,
    pub is_damaged: bool,
    /// Whether somebody has acknowledged that.
    pub is_known: bool,
    pub has_episodes: bool,
    /// Counts by printhead.
    pub heads: BTreeMap<Arc<str>, HeadCount>,
}

/// Counts of one printhead in one recording.
#[derive(Clone, Debug, Default)]
pub struct HeadCount {
    pub tally: Tally,
    /// Number of channels with an episode in the recording.
    pub faulty_channels: u64,
    /// Whether the printhead was taken out since.
    pub is_gone: bool,
}

/// Of fewer channels most say nothing of what they share.
const FEWEST: usize = 4;

/// Everything that the page, the terminal's list and the table of faults show.
#[derive(Debug)]
pub struct Report {
    /// The recordings in the order of time.
    pub recordings: Vec<RecordingLine>,
    /// The faults of all channels, the most urgent first.
    pub faults: Vec<Fault>,
    /// Sentences that the reader should know before anything is cleaned.
    pub notes: Vec<Note>,
    /// Pairs of recordings, by name, that hold the same channels at the same times; `notes` has some.
    pub overlapping: Vec<[String; 2]>,
    /// What happened to whole printheads, the newest first.
    pub head_changes: Vec<HeadChange>,
    /// What was judged, and what was not.
    pub coverage: Coverage,
    pub false_alarms: FalseAlarms,
    /// The healthy models that judged.
    pub drift: Vec<ModelPoint>,
    pub survey: Survey,
}

impl RecordingLine {
    /// Number of signals that were not judged.
    pub fn rejected(&self) -> u64 {
        self.heads.values().map(|head| head.tally.rejected).sum()
    }
}

impl Report {
    /// `survey`: has seen all verdicts of the `sources`, in their order; `lost`: recordings without verdicts.
    pub fn new(
        sources: &[Source],
        mut survey: Survey,
        lost: Vec<LostRecording>,
        acknowledged: &Acknowledged,
        settings: ReportSettings,
    ) -> Report {
        for head in &mut survey.heads {
            let last = head.latest().and_then(|(_, of)| of.span);
            head.is_gone = last.is_some_and(|(_, to_ns)| acknowledged.is_gone(&head.name, to_ns));
        }
        let coverage = Coverage::of(&survey, sources, lost);
        let false_alarms = FalseAlarms::of(&survey, sources);

        // The stories of each channel, linked with the rates of all channels.
        let rates = rates(&survey, &false_alarms);
        let faults = |head: &survey::Head| {
            let moved = head_changes::Movements::of(head, sources);
            let at_once = ends_at_once(head);
            let stories = |of: &Watch| stories(head, of, (&moved, &at_once), &rates, acknowledged);
            let of_channel = |of: &Watch| Fault::of_channel(stories(of), &settings);
            head.watches.iter().flat_map(of_channel).collect::<Vec<_>>()
        };
        let mut faults: Vec<Fault> = survey.heads.iter().flat_map(faults).collect();
        fault::sort(&mut faults);

        // What is told over channels and recordings.
        let mut notes = notes::notes(&survey, &faults, sources);
        notes.extend(acknowledged.mistakes.iter().cloned().map(Note::of_all));
        let mut recordings = lines(sources, &survey);
        recordings.sort_by_cached_key(|line| (line.span.map(|span| span.0), line.name.clone()));
        let drift = drift::points(sources);
        let head_changes = head_changes::of(&recordings, sources);
        let name = |recording: usize| sources[recording].name.clone();
        let pairs = notes::overlapping_recordings(&survey).into_iter();
        let overlapping = pairs.map(|(a, b)| [name(a), name(b)]).collect();
        Report {
            recordings,
            faults,
            notes,
            overlapping,
            head_changes,
            coverage,
            false_alarms,
            drift,
            survey,
        }
    }

    /// The last faults of channels that are healthy again and need no cleaning.
    pub fn over(&self) -> impl Iterator<Item = &Fault> {
        self.past().filter(|fault| fault.story.replaced_at_ns.is_none())
    }

    /// Those that went with a channel or printhead that was replaced.
    pub fn replaced(&self) -> impl Iterator<Item = &Fault> {
        self.past().filter(|fault| fault.story.replaced_at_ns.is_some())
    }

    fn past(&self) -> impl Iterator<Item = &Fault> {
        self.faults.iter().filter(|fault| fault.is_latest && !fault.is_open())
    }

    /// The faults that are to be cleaned, on or recurring, the most urgent first, at most one of a channel.
    pub fn open(&self) -> impl Iterator<Item = &Fault> {
        self.faults.iter().filter(|fault| fault.is_open())
    }

    /// Those of them that nobody has acknowledged as known.
    pub fn news(&self) -> impl Iterator<Item = &Fault> {
        self.open().filter(|fault| fault.story.known.is_none())
    }
}

/// The stories of a channel: of what it was before each time at which it, or its printhead, was replaced, of what ended on
/// most channels at once, and of what it is now.
fn stories(
    head: &survey::Head,
    watch: &Watch,
    (moved, at_once): (&head_changes::Movements, &BTreeSet<i64>),
    rates: &Rates,
    acknowledged: &Acknowledged,
) -> Vec<Story> {
    let ends_ns = |recording: usize| {
        let span = head.tallies.get(&recording).and_then(|of| of.span);
        span.map_or(i64::MIN, |(_, to_ns)| to_ns)
    };
    let first = &watch.spells[0].episode;
    let heard_ns = head.latest().and_then(|(_, of)| of.span).map_or(i64::MIN, |(_, to_ns)| to_ns);
    let (mut all, mut rest) = (Vec::new(), Some(watch.clone()));
    let others_ns = acknowledged.replaced_ns(&first.printhead, first.channel, heard_ns);
    let others_ns = others_ns.into_iter().chain(moved.swapped_ns.iter().copied());
    let ends = watch.spells.iter().filter_map(|of| of.episode.ended_at_ns);
    let shared_ns = ends.filter(|end_ns| at_once.contains(end_ns)).map(|end_ns| (end_ns, None));
    let mut divisions: Vec<(i64, Option<i64>)> =
        others_ns.map(|at_ns| (at_ns, Some(at_ns))).chain(shared_ns).collect();
    divisions.sort_unstable();
    for (at_ns, replaced_at_ns) in divisions {
        let Some(watch) = rest.take() else { break };
        let [before, after] = watch.divided(at_ns, ends_ns);
        let gone = before.iter().flat_map(|watch| story::stories(watch, rates));
        all.extend(gone.map(|story| Story { replaced_at_ns, ..story }));
        rest = after;
    }
    all.extend(rest.iter().flat_map(|watch| story::stories(watch, rates)));
    for story in &mut all {
        story.known = acknowledged.knows(story).map(str::to_owned);
        story.ended_with_all = story.ended_at_ns.is_some_and(|end_ns| {
            moved.together_ns.iter().any(|[from_ns, to_ns]| {
                story.began_at_ns < *from_ns && (*from_ns..=*to_ns).contains(&end_ns)
            })
        });
    }
    all
}

/// The times at which episodes of most of a printhead's channels end in the same burst: an amplifier that was off, say, is no
/// fault of each of them, is not expected back, and is not the beginning of a later one.
fn ends_at_once(head: &survey::Head) -> BTreeSet<i64> {
    let mut ends: BTreeMap<i64, usize> = BTreeMap::new();
    for spell in head.watches.iter().flat_map(|of| &of.spells) {
        spell.episode.ended_at_ns.into_iter().for_each(|ns| *ends.entry(ns).or_default() += 1);
    }
    let is_of_most = |channels: &usize| 2 * channels > head.channels.len().max(FEWEST);
    ends.into_iter().filter(|(_, n)| is_of_most(n)).map(|(end_ns, _)| end_ns).collect()
}

/// The rates over all channels, against which `story` weighs the bursts of one channel.
fn rates(survey: &Survey, false_alarms: &FalseAlarms) -> Rates {
    let mut categories: BTreeMap<String, u64> = BTreeMap::new();
    let spells = survey.watches().flat_map(|watch| &watch.spells);
    for category in spells.filter_map(|spell| spell.episode.category.clone()) {
        *categories.entry(category).or_default() += 1;
    }
    Rates {
        faulty_channels: survey.watches().count() as u64,
        judged: survey.channels().map(|c| c.judged).sum(),
        false_alarms: false_alarms.rate(),
        categories,
    }
}

/// A line of counts for each source.
fn lines(sources: &[Source], survey: &Survey) -> Vec<RecordingLine> {
    // channels with an episode, by recording and printhead
    let mut faulty: BTreeMap<(usize, &Arc<str>), BTreeSet<u32>> = BTreeMap::new();
    for Spell { recording, episode, .. } in survey.watches().flat_map(|watch| &watch.spells) {
        faulty.entry((*recording, &episode.printhead)).or_default().insert(episode.channel);
    }
    let line = |(recording, source): (usize, &Source)| {
        let count = |head: &survey::Head| {
            let tally = head.tallies.get(&recording)?.clone();
            let channels = faulty.get(&(recording, &head.name)).map_or(0, BTreeSet::len);
            let (faulty_channels, is_gone) = (channels as u64, head.is_gone);
            Some((head.name.clone(), HeadCount { tally, faulty_channels, is_gone }))
        };
        let heads: BTreeMap<Arc<str>, HeadCount> = survey.heads.iter().filter_map(count).collect();
        RecordingLine {
            name: source.name.clone(),
            source: recording,
            span: whole(heads.values().filter_map(|h| h.tally.span)),
            judged: heads.values().map(|h| h.tally.judged).sum(),
            flaws: source.flaws(),
            is_damaged: source.damaged_places() > 0,
            is_known: source.known.is_some(),
            has_episodes: source.has_episodes(),
            heads,
        }
    };
    sources.iter().enumerate().map(line).collect()
}
