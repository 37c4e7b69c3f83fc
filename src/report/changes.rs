//! What changed since the night before, or since an earlier run: what began, came back, became healthy or got worse in the
//! recordings since then, and what they do not tell of. In: recordings and faults. Out: [`Changes`].

use super::RecordingLine;
use super::fault::{Fault, certain_trend};
use super::night::last_night;
use super::trend::Direction;
use std::collections::BTreeSet;
use std::sync::Arc;

#[derive(Debug, Default)]
pub struct Changes<'a> {
    pub from_ns: i64,
    pub to_ns: i64,
    /// Recordings since then.
    pub recordings: usize,
    pub new: Vec<&'a Fault>,
    pub back: Vec<&'a Fault>,
    pub worse: Vec<&'a Fault>,
    pub healthy: Vec<&'a Fault>,
    /// Open as before.
    pub still: usize,
    /// Printheads of earlier recordings that those since then judged nothing of.
    pub silent: Vec<Arc<str>>,
}

impl<'a> Changes<'a> {
    /// `None`: there is no night before.
    pub fn of(lines: &[RecordingLine], faults: &'a [Fault]) -> Option<Changes<'a>> {
        let mut spans: Vec<(i64, i64)> =
            lines.iter().filter_map(|line| line.from_ns.zip(line.to_ns)).collect();
        spans.sort_unstable();
        let to_ns = spans.iter().map(|span| span.1).max()?;
        let from_ns = last_night(&spans, to_ns);
        if spans.first()?.0 >= from_ns {
            return None;
        }
        let is_last = |line: &&RecordingLine| line.from_ns.is_some_and(|from| from >= from_ns);
        let (last, before) = lines.iter().partition(is_last);
        Some(Changes::between(before, last, [from_ns, to_ns], faults))
    }

    /// Since the recordings of which `is_known` is true, by their names. The others may be of the same time, or earlier.
    pub fn since(
        lines: &[RecordingLine],
        faults: &'a [Fault],
        is_known: impl Fn(&str) -> bool,
    ) -> Changes<'a> {
        let (before, last): (Vec<_>, Vec<_>) = lines.iter().partition(|line| is_known(&line.name));
        let from_ns = last.iter().filter_map(|line| line.from_ns).min().unwrap_or_default();
        let to_ns = last.iter().filter_map(|line| line.to_ns).max().unwrap_or(from_ns);
        Changes::between(before, last, [from_ns, to_ns], faults)
    }

    fn between(
        before: Vec<&RecordingLine>,
        last: Vec<&RecordingLine>,
        [from_ns, to_ns]: [i64; 2],
        faults: &'a [Fault],
    ) -> Changes<'a> {
        let judged = |of: &RecordingLine| -> BTreeSet<Arc<str>> {
            let heads = of.heads.iter().filter(|(_, count)| count.judged > 0);
            heads.map(|(name, _)| name.clone()).collect()
        };
        // as spells number them
        let known: BTreeSet<usize> = before.iter().map(|line| line.source).collect();
        let known_to_ns = before.iter().filter_map(|line| line.to_ns).max().unwrap_or(i64::MIN);
        let of_last: BTreeSet<Arc<str>> = last.iter().flat_map(|of| judged(of)).collect();
        let of_before: BTreeSet<Arc<str>> = before.iter().flat_map(|of| judged(of)).collect();
        // what was known of the same time is no older
        let until_now = before.iter().filter(|of| of.to_ns.is_some_and(|to| to >= from_ns));
        let of_last: BTreeSet<Arc<str>> =
            of_last.into_iter().chain(until_now.flat_map(|of| judged(of))).collect();
        let mut changes = Changes {
            from_ns,
            to_ns,
            recordings: last.len(),
            silent: of_before.difference(&of_last).cloned().collect(),
            ..Changes::default()
        };
        for fault in faults.iter().filter(|fault| fault.is_latest) {
            let story = &fault.story;
            let was_known = story.spells.iter().any(|of| known.contains(&of.recording));
            let is_worse = certain_trend(story).is_some_and(|t| t.direction() == Direction::Worse);
            match story.ended_at_ns {
                Some(end) if end > known_to_ns => changes.healthy.push(fault),
                Some(_) => {}
                None if !was_known => changes.new.push(fault),
                None if story.last_began_at_ns > known_to_ns => changes.back.push(fault),
                None if is_worse => changes.worse.push(fault),
                None => changes.still += 1,
            }
        }
        changes
    }
}
