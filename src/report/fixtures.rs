//! What the tests of this room begin with: verdicts and episodes of a printhead `p`, written down by hand.

use super::recording_counts::{Names, RecordingCounts};
use super::survey::Survey;
use super::watch::{BurstCounts, Flagged, Spell, Watch, Watched};
use inkling_core::episodes::Episode;
use inkling_core::verdict::{Outcome, VerdictColumns};

/// No classes and no categories, for verdicts that name nothing.
pub const NAMELESS: Names<'static> = Names { classes: &[], categories: &[] };

/// The verdicts of one burst, a channel and its outcome each.
pub fn verdicts(t_ns: i64, of: impl IntoIterator<Item = (u32, Outcome)>) -> VerdictColumns {
    let (channel, outcome): (Vec<u32>, Vec<Outcome>) = of.into_iter().unzip();
    let n = channel.len();
    let mut columns = VerdictColumns {
        acquired_at_ns: vec![t_ns; n],
        printhead: vec![0; n],
        printheads: vec!["p".into()],
        channel,
        outcome,
        ..VerdictColumns::default()
    };
    columns.fill_up();
    columns
}

/// An episode of channel 7.
pub fn spell(recording: usize, began: i64, ended: Option<i64>, category: &str) -> Spell {
    let episode = Episode {
        printhead: "p".into(),
        channel: 7,
        category: Some(category.into()),
        raised_at_ns: began + 1,
        began_at_ns: began,
        ended_at_ns: ended,
        bursts: 10,
        certainty: Some(0.9),
        severity_first: Some(1.2),
        severity_max: Some(1.5),
        severity_last: Some(1.4),
        severity_sd: Some(0.1),
        ..Episode::default()
    };
    Spell { recording, episode, counts: BurstCounts::default() }
}

/// The survey of recordings without episodes: the verdicts of each.
pub fn surveyed(recordings: &[Vec<VerdictColumns>]) -> Survey {
    let mut survey = Survey::new(&vec![Vec::new(); recordings.len()]);
    for (recording, verdicts) in recordings.iter().enumerate() {
        let mut counts = RecordingCounts::new(&[]);
        verdicts.iter().for_each(|of| counts.add(of, NAMELESS));
        survey.absorb(recording, counts);
    }
    survey
}

/// The watch of a channel with these episodes, of whose judged bursts each is in a recording at a time; flagged ones
/// say something.
pub fn watch_of(spells: Vec<Spell>, bursts: &[(usize, i64, Option<Flagged<'_>>)]) -> Watch {
    let mut watch = Watch::new(spells.clone());
    for recording in 0..=bursts.iter().map(|of| of.0).max().unwrap_or(0) {
        let of_it = spells.iter().filter(|spell| spell.recording == recording);
        let mut watched = Watched::new(of_it.map(|spell| &spell.episode).collect());
        let here = bursts.iter().filter(|of| of.0 == recording);
        here.for_each(|(_, t_ns, flagged)| watched.add_burst(*t_ns, *flagged));
        watch.absorb(recording, &watched);
    }
    watch
}
