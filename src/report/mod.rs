//! The report that a person looks at. From the verdicts, episodes and summaries of any number of
//! recordings it tells which channels to clean, since when they are faulty, and whether the
//! verdicts can be trusted.
//!
//! In, from the verbs `report` and `replay` (`cli/results.rs`): the [`Source`] and the episodes of
//! each recording, then all verdicts once ([`Survey`]). Out: a [`Report`], and from it the page
//! (`html`), the list on a terminal (`print`) and the table of faults. The report must never judge
//! by itself: the episodes decide what is a fault.
//!
//! The steps, each in a file:
//! 1. `survey` reads the verdicts once: counts, a map of each printhead (`map`), and a `watch` of
//!    each channel that had an episode.
//! 2. `coverage` and `false_alarms` say what was judged, and how well.
//! 3. `story` links the episodes of each channel into one story per fault; `trend` says whether the
//!    fault grows. `fault` makes an entry of the cleaning list of each story.
//! 4. `neighbours`, `notes`, `changes` and `drift` look over channels, printheads and nights.
//! 5. `page` writes all that with `heads`, `tables`, `maps` and `figures`.
//!
//! `evaluation` and `promised` are other pages made by the same means, for the verb `score`.

mod bins;
mod changes;
mod coverage;
mod drift;
mod evaluation;
mod false_alarms;
mod fault;
mod figures;
mod heads;
mod light;
mod list;
mod map;
mod maps;
mod neighbours;
mod night;
mod notes;
mod page;
mod promised;
mod settings;
mod source;
mod story;
mod survey;
mod tables;
mod trend;
mod watch;
mod words;

pub use changes::Changes;
pub use evaluation::html as evaluation;
pub use fault::{Fault, certain_trend, forecast_in_words, size, trend_in_words, what};
pub use list::print;
pub use maps::waterfalls;
pub use page::html;
pub use promised::print as print_promise;
pub use settings::ReportSettings;
pub use source::{LostRecording, Source};
pub use survey::{Names, Survey};
pub use words::{Column, clock, columns, first_of, grouped, three_digits};

use coverage::Coverage;
use drift::ModelPoint;
use false_alarms::FalseAlarms;
use neighbours::Group;
use night::{Span, whole};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use story::Rates;
use survey::Tally;

/// Counts of one recording: a line of the page's table of recordings.
#[derive(Clone, Debug)]
pub struct RecordingLine {
    pub name: String,
    /// Index of the recording among the sources, by which the spells of the stories refer to it.
    /// The lines themselves are sorted by time.
    pub source: usize,
    /// From the recording's first to its last signal; `None` if it has none.
    pub span: Option<Span>,
    /// Number of judged signals.
    pub judged: u64,
    /// Rejected signals by reason.
    pub rejected: BTreeMap<String, u64>,
    /// Number of messages by the file's own statistics.
    pub expected: Option<u64>,
    /// Number of bursts that were found.
    pub bursts: Option<u64>,
    /// Number of places where the file is damaged.
    pub damaged_places: u64,
    /// The first of these places, in words.
    pub damage: Option<String>,
    /// Files that are missing beside the verdicts ([`Source::missing`]).
    pub missing: Vec<&'static str>,
    /// Counts by printhead.
    pub heads: BTreeMap<Arc<str>, HeadCount>,
}

/// Counts of one printhead in one recording.
#[derive(Clone, Debug, Default)]
pub struct HeadCount {
    pub tally: Tally,
    /// Number of channels with an episode in the recording.
    pub faulty_channels: u64,
}

/// Everything that the page, the terminal's list and the table of faults show.
#[derive(Debug)]
pub struct Report {
    /// The recordings in the order of time.
    pub recordings: Vec<RecordingLine>,
    /// The faults of all channels, the most urgent first.
    pub faults: Vec<Fault>,
    /// Neighbouring channels that may have failed together.
    pub groups: Vec<Group>,
    /// Sentences that the reader should know before anything is cleaned.
    pub notes: Vec<String>,
    /// What was judged, and what was not.
    pub coverage: Coverage,
    pub false_alarms: FalseAlarms,
    /// The healthy models that judged, in the order of time.
    pub drift: Vec<ModelPoint>,
    pub survey: Survey,
}

impl Report {
    /// The report of the recordings of which `survey` has seen all verdicts. `sources`: these
    /// recordings, in the order of the survey's indices; `lost`: recordings without verdicts.
    pub fn new(
        sources: &[Source],
        survey: Survey,
        lost: Vec<LostRecording>,
        settings: ReportSettings,
    ) -> Report {
        let coverage = Coverage::of(&survey, sources, lost);
        let false_alarms = FalseAlarms::of(&survey, sources);

        // The stories of each channel, linked with the rates of all channels.
        let rates = rates(&survey, &false_alarms);
        let mut faults: Vec<Fault> = survey
            .heads
            .iter()
            .flat_map(|head| &head.watches)
            .flat_map(|watch| Fault::of_channel(story::stories(watch, &rates), &settings))
            .collect();
        fault::sort(&mut faults);

        // What is told over channels and recordings.
        let observed = neighbours::Observed::of(&survey, &faults);
        let groups = neighbours::groups(&faults, &observed, &settings);
        let notes = notes::notes(&survey, &faults, sources);
        let mut recordings = lines(sources, &survey, &faults);
        recordings.sort_by_cached_key(|line| (line.span.map(|span| span.0), line.name.clone()));
        let drift = drift::points(sources);
        Report { recordings, faults, groups, notes, coverage, false_alarms, drift, survey }
    }

    /// The last faults of channels that are healthy again and need no cleaning.
    pub fn over(&self) -> impl Iterator<Item = &Fault> {
        self.faults.iter().filter(|fault| fault.is_latest && !fault.is_open())
    }

    /// The faults that are to be cleaned, the most urgent first. Each channel occurs at most once.
    pub fn open(&self) -> impl Iterator<Item = &Fault> {
        self.faults.iter().filter(|fault| fault.is_open())
    }
}

/// How often faults begin, healthy signals are flagged, and each category occurs, over all
/// channels: what `story` weighs the bursts of one channel against.
fn rates(survey: &Survey, false_alarms: &FalseAlarms) -> Rates {
    let mut categories: BTreeMap<String, u64> = BTreeMap::new();
    let watches = || survey.heads.iter().flat_map(|head| &head.watches);
    for spell in watches().flat_map(|watch| &watch.spells) {
        if let Some(category) = &spell.episode.category {
            *categories.entry(category.clone()).or_default() += 1;
        }
    }
    let channels = survey.heads.iter().flat_map(|head| &head.channels);
    Rates {
        faulty_channels: watches().count() as u64,
        judged: channels.map(|c| c.judged).sum(),
        false_alarms: false_alarms.rate(),
        categories,
    }
}

/// A line of counts for each source: from the survey by printhead, and from the JSON document of
/// the recording's summary.
fn lines(sources: &[Source], survey: &Survey, faults: &[Fault]) -> Vec<RecordingLine> {
    // channels with an episode, by recording and printhead
    let mut faulty: BTreeMap<(usize, Arc<str>), BTreeSet<u32>> = BTreeMap::new();
    for story in faults.iter().map(|fault| &fault.story) {
        for spell in &story.spells {
            let key = (spell.recording, story.printhead.clone());
            faulty.entry(key).or_default().insert(story.channel);
        }
    }
    let line = |(recording, source): (usize, &Source)| {
        let count = |head: &survey::Head| {
            let tally = head.tallies.get(&recording)?.clone();
            let channels = faulty.get(&(recording, head.name.clone())).map_or(0, BTreeSet::len);
            Some((head.name.clone(), HeadCount { tally, faulty_channels: channels as u64 }))
        };
        let heads: BTreeMap<Arc<str>, HeadCount> = survey.heads.iter().filter_map(count).collect();
        let counts = &source.document["counts"];
        let rejected = counts["rejected"].as_object().into_iter().flatten();
        let damage = &source.document["damage"];
        RecordingLine {
            name: source.name.clone(),
            source: recording,
            span: whole(heads.values().filter_map(|h| h.tally.span)),
            judged: heads.values().map(|h| h.tally.judged).sum(),
            rejected: rejected.filter_map(|(why, n)| Some((why.clone(), n.as_u64()?))).collect(),
            expected: source.document["expected"].as_u64(),
            bursts: counts["bursts"].as_u64(),
            damaged_places: damage["places"].as_u64().unwrap_or(0),
            damage: damage["first"].as_str().map(str::to_owned),
            missing: source.missing.clone(),
            heads,
        }
    };
    sources.iter().enumerate().map(line).collect()
}
