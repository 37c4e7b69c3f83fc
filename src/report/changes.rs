//! What changed since the night before, or since an earlier run of the report: which faults began,
//! came back, ended or got worse in the recordings since then, and of which printheads these
//! recordings judged nothing.
//!
//! In: the lines of the recordings and the faults of all channels. Out: [`Changes`], for the page
//! (`of`) and for the verbs that compare with an earlier run (`since`). Recordings are divided in
//! two, those before and those since then; each channel's last fault falls into one kind by whether
//! an episode of it lies in the earlier recordings, and by its onset, its end and its trend. Of the faults before
//! the last one only those are told that came and went since then.

use super::RecordingLine;
use super::fault::{Fault, certain_trend};
use super::night::{Span, last_night, whole};
use super::story::Story;
use super::trend::Direction;
use std::collections::BTreeSet;
use std::sync::Arc;

/// The last faults of all channels, sorted by what became of them.
#[derive(Debug)]
pub struct Changes<'a> {
    /// From the begin to the end of the recordings since then, ns.
    pub from_ns: i64,
    pub to_ns: i64,
    /// Number of recordings since then.
    pub recordings: usize,
    /// The changed faults by kind (key in JSON, words, faults), the most important kind first.
    pub kinds: [(&'static str, &'static str, Vec<&'a Fault>); 6],
    /// Number of faults that are to be cleaned as before.
    pub still: usize,
    /// Printheads that earlier recordings judged, and that no recording since then judged.
    pub silent: Vec<Arc<str>>,
}

impl<'a> Changes<'a> {
    /// The changes of the last night (`night::last_night`); `None` if there is no night before.
    pub fn of(lines: &[RecordingLine], faults: &'a [Fault]) -> Option<Changes<'a>> {
        let mut spans: Vec<Span> = lines.iter().filter_map(|line| line.span).collect();
        spans.sort_unstable();
        let (first_ns, to_ns) = whole(spans.iter().copied())?;
        let from_ns = last_night(&spans, to_ns);
        if first_ns >= from_ns {
            return None;
        }
        let is_last = |line: &&RecordingLine| line.span.is_some_and(|(from, _)| from >= from_ns);
        let (last, before) = lines.iter().partition(is_last);
        Some(Changes::between(before, last, (from_ns, to_ns), faults, |_| None))
    }

    /// The changes since the recordings whose names `is_known` accepts, which an earlier run saw. `was_told`:
    /// whether that run has told of a fault; `None`: it did not say, and has told of those that its recordings
    /// show.
    pub fn since(
        lines: &[RecordingLine],
        faults: &'a [Fault],
        is_known: impl Fn(&str) -> bool,
        was_told: impl Fn(&Story) -> Option<bool>,
    ) -> Changes<'a> {
        let (before, last): (Vec<_>, Vec<_>) = lines.iter().partition(|line| is_known(&line.name));
        let span = whole(last.iter().filter_map(|line| line.span)).unwrap_or_default();
        Changes::between(before, last, span, faults, was_told)
    }

    /// The changes from the recordings `before` to the recordings `last`, which have the given span.
    fn between(
        before: Vec<&RecordingLine>,
        last: Vec<&RecordingLine>,
        (from_ns, to_ns): Span,
        faults: &'a [Fault],
        was_told: impl Fn(&Story) -> Option<bool>,
    ) -> Changes<'a> {
        let judged = |of: &RecordingLine| -> BTreeSet<Arc<str>> {
            let heads = of.heads.iter().filter(|(_, count)| count.tally.judged > 0);
            heads.map(|(name, _)| name.clone()).collect()
        };
        // the numbers by which spells refer to recordings
        let known: BTreeSet<usize> = before.iter().map(|line| line.source).collect();
        let known_to_ns =
            before.iter().filter_map(|line| line.span).map(|of| of.1).max().unwrap_or(i64::MIN);
        let of_before: BTreeSet<Arc<str>> = before.iter().flat_map(|of| judged(of)).collect();

        // An earlier recording that reaches into the time since then tells of that time, too.
        let until_now = before.iter().filter(|of| of.span.is_some_and(|(_, to)| to >= from_ns));
        let of_last: BTreeSet<Arc<str>> =
            last.iter().chain(until_now).flat_map(|of| judged(of)).collect();

        // the name that the recordings since then give, where the earlier ones gave another
        let is_other = |story: &Story| {
            let name = |since: bool| {
                let spells = story.spells.iter().rev();
                let mut spells = spells.filter(|of| known.contains(&of.recording) != since);
                spells.find_map(|of| of.episode.category.as_ref())
            };
            name(true).zip(name(false)).is_some_and(|(is, was)| is != was)
        };

        // The order of the cases matters: each fault counts once, and a new one is not also worse.
        let kind = |fault: &Fault| {
            let story = &fault.story;
            let is_shown = || story.spells.iter().any(|of| known.contains(&of.recording));
            let was_known = was_told(story).unwrap_or_else(is_shown);
            // a trend that no recording since then adds to was told before
            let is_seen = story.spells.iter().any(|of| !known.contains(&of.recording));
            let is_worse =
                is_seen && certain_trend(story).is_some_and(|t| t.direction() == Direction::Worse);
            match story.ended_at_ns {
                Some(_) if !was_known => "passed",
                _ if !fault.is_latest && !was_known => "passed",
                _ if !fault.is_latest => "followed by another",
                Some(end) if end > known_to_ns => "cured",
                Some(_) => "ended within the earlier recordings",
                None if !was_known => "new",
                // cured, and began again after the end of the earlier recordings
                None if story.last_began_at_ns > known_to_ns => "back",
                None if is_other(story) => "changed",
                None if is_worse => "worse",
                None => "as before",
            }
        };
        let of_kind = |key: &str| -> Vec<&'a Fault> {
            // what is known is no news, unless it is another fault by now
            let is_news = |of: &&Fault| of.story.known.is_none() || is_other(&of.story);
            let news = faults.iter().filter(is_news);
            news.filter(|fault| kind(fault) == key).collect()
        };
        let kinds = [
            ("new", "new"),
            ("back", "came back"),
            ("changed", "another fault now"),
            ("worse", "getting worse"),
            ("cured", "healthy again"),
            ("passed", "came and went"),
        ];
        let kinds = kinds.map(|(key, words)| (key, words, of_kind(key)));
        let told = kinds.iter().filter(|(key, ..)| *key != "cured");
        let told = told.flat_map(|(_, _, of)| of);
        let told = told.filter(|of| of.is_open() && of.story.known.is_none());
        Changes {
            from_ns,
            to_ns,
            recordings: last.iter().filter(|line| line.span.is_some()).count(),
            // one that comes and goes is to be cleaned though it is healthy now
            still: faults.iter().filter(|of| of.is_open() && of.story.known.is_none()).count()
                - told.count(),
            kinds,
            silent: of_before.difference(&of_last).cloned().collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixtures::{spell, watch_of};
    use super::super::settings::ReportSettings;
    use super::super::story::{Rates, stories};
    use super::super::watch::Flagged;
    use super::*;

    #[test]
    fn a_fault_that_is_called_otherwise_since_then_is_another() {
        let changed = |name: &str| {
            let spells = vec![spell(0, 0, None, "dried_nozzle"), spell(1, 100, None, name)];
            let bursts: Vec<_> = [0, 1, 2, 100, 101, 102]
                .map(|t| ((t / 100) as usize, t, Some(Flagged::default())))
                .into();
            let stories = stories(&watch_of(spells, &bursts), &Rates::default());
            let faults = Fault::of_channel(stories, &ReportSettings::default());
            let line = |source: usize| RecordingLine {
                name: source.to_string(),
                source,
                span: Some((100 * source as i64, 100 * source as i64 + 2)),
                judged: 3,
                flaws: String::new(),
                is_damaged: false,
                is_known: false,
                has_episodes: true,
                heads: Default::default(),
            };
            let lines = [line(0), line(1)];
            let changes = Changes::since(&lines, &faults, |name| name == "0", |_| None);
            let of = |key: &str| {
                changes.kinds.iter().find(|kind| kind.0 == key).map_or(0, |kind| kind.2.len())
            };
            (of("changed"), changes.still)
        };
        assert_eq!(changed("air_bubble"), (1, 0));
        assert_eq!(changed("dried_nozzle"), (0, 1));
    }
}
