//! What changed since the night before, or since an earlier run of the report: which faults began,
//! came back, ended or got worse in the recordings since then, and of which printheads these
//! recordings judged nothing.
//!
//! In: the lines of the recordings and the faults of all channels. Out: [`Changes`], for the page
//! (`of`) and for the verbs that compare with an earlier run (`since`). Recordings are divided in
//! two, those before and those since then; each channel's last fault falls into one kind by whether
//! an episode of it lies in the earlier recordings, and by its onset, its end and its trend. Of the faults before
//! the last one only those are told that came and went since then.

use super::fault::{Fault, certain_trend};
use super::night::{Span, last_night, whole};
use super::story::Story;
use super::trend::Direction;
use super::watch::quantity;
use super::{HeadCount, RecordingLine};
use inkling_core::episodes::Episode;
use std::collections::BTreeSet;
use std::sync::Arc;

/// A size has changed if it differs by so many standard deviations, of both sizes together: by chance one in 400 does.
const CERTAIN: f64 = 3.0;

/// The last faults of all channels, sorted by what became of them.
#[derive(Debug)]
pub struct Changes<'a> {
    /// From the begin to the end of the recordings since then, ns.
    pub from_ns: i64,
    pub to_ns: i64,
    /// Number of recordings since then.
    pub recordings: usize,
    /// The changed faults by kind (key in JSON, words, faults), the most important kind first.
    pub kinds: [(&'static str, &'static str, Vec<&'a Fault>); 7],
    /// Number of faults that are on as before.
    pub still: usize,
    /// Number of faults that are over as before and came back before.
    pub may_return: usize,
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
            let is_missed = |count: &HeadCount| count.tally.judged > 0 && !count.is_gone;
            let heads = of.heads.iter().filter(|(_, count)| is_missed(count));
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

        // the latest episode in the recordings since then, and in the earlier ones
        let latest = |story: &'a Story, since: bool| -> Option<&'a Episode> {
            let mut spells = story.spells.iter().rev();
            spells.find(|of| known.contains(&of.recording) != since).map(|of| &of.episode)
        };
        let both = |story| Some((latest(story, false)?, latest(story, true)?));
        // a name that one episode lacks is lost only where the signals since then carry it no longer
        let is_other = |story: &'a Story| {
            both(story).is_some_and(|(was, is)| match (&was.category, &is.category) {
                (Some(was), Some(is)) => was != is,
                (Some(_), None) => story.lost.is_some(),
                (None, is) => is.is_some(),
            })
        };
        // by more than both sizes are uncertain
        let is_resized = |story: &'a Story, way: Direction| {
            both(story).is_some_and(|(was, is)| {
                // what has no name is sized as the class that it is most like
                let same = is.category.is_some() && quantity(was) == quantity(is);
                let sizes = was.severity_last.zip(is.severity_last).filter(|_| same);
                let sds = was.severity_sd.zip(is.severity_sd);
                sizes.zip(sds).is_some_and(|((was, is), (a, b))| {
                    let change = is - was;
                    let is_worse = way == Direction::Worse;
                    change.abs() > CERTAIN * a.hypot(b) && (change > 0.0) == is_worse
                })
            })
        };

        // The order of the cases matters: each fault counts once, and a new one is not also worse.
        let kind = |fault: &'a Fault| {
            let story = &fault.story;
            let is_shown = || story.spells.iter().any(|of| known.contains(&of.recording));
            let was_known = was_told(story).unwrap_or_else(is_shown);
            // a trend that no recording since then adds to was told before
            let is_seen = story.spells.iter().any(|of| !known.contains(&of.recording));
            let goes = |way: Direction| {
                let trend = certain_trend(story).is_some_and(|t| t.direction() == way);
                is_seen && (trend || is_resized(story, way))
            };
            match story.ended_at_ns {
                _ if story.replaced_at_ns.is_some() => "replaced",
                Some(_) if !was_known => "passed",
                _ if !fault.is_latest && !was_known => "passed",
                _ if !fault.is_latest => "followed by another",
                Some(end) if end > known_to_ns && story.ended_with_all => "changed",
                Some(end) if end > known_to_ns => "cured",
                Some(_) => "ended within the earlier recordings",
                None if !was_known => "new",
                // cured, and began again after the end of the earlier recordings
                None if story.cures > 0 && story.last_began_at_ns > known_to_ns => "back",
                None if is_other(story) => "changed",
                None if goes(Direction::Worse) => "worse",
                None if goes(Direction::Better) => "better",
                None => "as before",
            }
        };
        let of_kind = |key: &str| -> Vec<&'a Fault> {
            // what is known is no news, unless it is another fault by now
            let is_news = |of: &&'a Fault| of.story.known.is_none() || is_other(&of.story);
            let news = faults.iter().filter(is_news);
            news.filter(|fault| kind(fault) == key).collect()
        };
        let kinds = [
            ("new", "new"),
            ("back", "came back"),
            ("changed", "changed"),
            ("worse", "getting worse"),
            ("better", "getting better"),
            ("cured", "healthy again"),
            ("passed", "came and went"),
        ];
        let kinds = kinds.map(|(key, words)| (key, words, of_kind(key)));
        let told = kinds.iter().flat_map(|(_, _, of)| of).copied();
        let rest = |is_on: bool| {
            let is_it = |of: &&Fault| {
                of.is_open() && of.story.known.is_none() && of.story.ended_at_ns.is_none() == is_on
            };
            faults.iter().filter(is_it).count() - told.clone().filter(is_it).count()
        };
        Changes {
            from_ns,
            to_ns,
            recordings: last.iter().filter(|line| line.span.is_some()).count(),
            still: rest(true),
            may_return: rest(false),
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
    use super::super::watch::{Flagged, Spell};
    use super::*;

    /// The keys of the kinds that are told of one channel's two nights, and how many faults are on as before. `until`:
    /// when the first night's fault ended; `now`: the second night's episode; `was_told`: whether the first night was.
    fn told(until: Option<i64>, now: Spell, was_told: bool) -> (Vec<&'static str>, usize) {
        let on = |night: usize, k: i64| (night, 100 * night as i64 + k, Some(Flagged::default()));
        let first = (0..20).map(|k| match until {
            Some(end) if k >= end => (0, k, None),
            _ => on(0, k),
        });
        let bursts: Vec<_> = first.chain((0..20).map(|k| on(1, k))).collect();
        let spells = vec![spell(0, 0, until, "dried_nozzle"), now];
        let stories = stories(&watch_of(spells, &bursts), &Rates::default());
        let faults = Fault::of_channel(stories, &ReportSettings::default());
        let line = |source: usize| RecordingLine {
            name: source.to_string(),
            source,
            span: Some((100 * source as i64, 100 * source as i64 + 20)),
            judged: 20,
            flaws: String::new(),
            is_damaged: false,
            is_known: false,
            has_episodes: true,
            heads: Default::default(),
        };
        let told = |story: &Story| Some(was_told && story.began_at_ns < 100);
        let changes = Changes::since(&[line(0), line(1)], &faults, |name| name == "0", told);
        let kinds = changes.kinds.iter().filter(|kind| !kind.2.is_empty());
        (kinds.map(|kind| kind.0).collect(), changes.still)
    }

    #[test]
    fn a_fault_with_another_name_or_another_size_has_changed() {
        let now = |name: &str, size: f64| {
            let mut now = spell(1, 100, None, name);
            (now.episode.fault, now.episode.severity_last) = (None, Some(size));
            now
        };
        let told = |name: &str, size: f64| told(None, now(name, size), true);
        let before = spell(0, 0, None, "dried_nozzle").episode.severity_last.unwrap();
        assert_eq!(told("air_bubble", before), (vec!["changed"], 0));
        assert_eq!(told("dried_nozzle", before), (vec![], 1));
        assert_eq!(told("dried_nozzle", before + 2.0), (vec!["worse"], 0));
        assert_eq!(told("dried_nozzle", before - 2.0), (vec!["better"], 0));
    }

    #[test]
    fn a_fault_that_nobody_has_told_is_told_also_where_another_one_followed() {
        let now = || spell(1, 100, None, "air_bubble");
        assert_eq!(told(Some(10), now(), false), (vec!["new", "passed"], 0));
        assert_eq!(told(Some(10), now(), true), (vec!["new"], 0));
    }
}
