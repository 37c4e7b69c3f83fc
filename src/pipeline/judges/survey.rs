//! Finds where the first windows of some groups lie, and which of their moments are to be learned from, without
//! holding any samples.
//!
//! In: the bursts from the first one on whose group has no judge. Out: the groups that begin there ([`starts`]); and
//! of a window of each the times of the bursts that are learned from ([`choose`]).
//!
//! A window ends `identify.first` after it begins, or earlier, at the end of the first of its [`PARTS`] equal parts by
//! which it holds [`ENOUGH`] times as many signals as may be kept. Which of its moments are kept is drawn by a hash of
//! the time since the group's first burst. So neither dates nor numbers and order of channels, names or other
//! printheads matter, nor the order of bursts in the file.

use super::super::Result;
use super::super::channel_subset::ChannelStretches;
use super::super::elapsed::Elapsed;
use super::super::groups::{GroupKey, Groups};
use super::super::numbers::{ENOUGH, FEWEST, JUMP_NS, OF_CHANNEL, STEADY};
use super::super::run::Replay;
use super::super::visit;
use super::windows::Ahead;
use inkling_core::burst::Burst;
use inkling_core::identify::reservoir::drawn_by;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::ControlFlow;

/// Maximum number of groups that are learned together, which bounds memory.
const MOST_GROUPS: usize = 64;
/// Groups that begin within so many signals, or before all that were found have shown where they begin, or within the
/// time [`TOGETHER_NS`], are learned together.
const TOGETHER_SIGNALS: u64 = 1 << 18;
const TOGETHER_NS: i64 = 1_000_000_000;
/// A group that has shown fewer moments after this time, ns, has no more to show.
const MOST_WAIT_NS: i64 = 20_000_000_000;
/// A window is divided into so many parts; it may end at the end of each.
const PARTS: i64 = 64;
/// Maximum bytes of one window's signals.
const MOST_BYTES: usize = 96 << 20;

/// The earliest moments of a group.
#[derive(Debug)]
struct Begin {
    sample_period_s: f64,
    moments: BTreeSet<i64>,
}

impl Begin {
    /// The earliest moment that is not dated apart from most.
    fn start_ns(&self) -> i64 {
        let median = self.moments.iter().nth(self.moments.len() / 2).copied().unwrap_or(0);
        let near = self.moments.iter().find(|t| t.abs_diff(median) <= JUMP_NS as u64);
        near.copied().unwrap_or(median)
    }
}

/// Time of the first burst, ns, and sample period, s, of each group that begins where reading ahead begins.
pub fn starts(
    ahead: &Ahead,
    is_new: impl Fn(&Burst, &GroupKey) -> bool,
) -> Result<BTreeMap<GroupKey, (i64, f64)>> {
    let mut begins: BTreeMap<GroupKey, Begin> = BTreeMap::new();
    let (mut groups, mut elapsed, mut began_ns, mut signals) =
        (Groups::default(), Elapsed::default(), None, 0);
    ahead.read(None, |_, burst| {
        if let Some(group) = groups.of(burst) {
            elapsed.hear(group, burst.t_acq_ns);
        }
        let key = GroupKey::of(burst);
        let has_room = begins.len() < MOST_GROUPS || begins.contains_key(&key);
        if has_room && is_new(burst, &key) {
            let sample_period_s = burst.sample_period_s;
            let new = || Begin { sample_period_s, moments: BTreeSet::new() };
            let begin = begins.entry(key).or_insert_with(new);
            begin.moments.insert(burst.t_acq_ns);
            if begin.moments.len() > 2 * STEADY as usize {
                begin.moments.pop_last();
            }
        }
        if begins.is_empty() {
            return ControlFlow::Continue(()); // the block holds earlier bursts of groups that have judges
        }
        signals += u64::from(burst.channels);
        let since = elapsed.now_ns - *began_ns.get_or_insert(elapsed.now_ns);
        let is_steady = |of: &Begin| of.moments.len() >= STEADY as usize;
        let are_steady = since >= MOST_WAIT_NS || begins.values().all(is_steady);
        let together = since >= TOGETHER_NS || signals >= TOGETHER_SIGNALS;
        let is_sure = ahead.reorder_ns.is_some_and(|reorder| since >= reorder);
        match is_sure && together && are_steady {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }
    })?;
    let start = |(key, of): (GroupKey, Begin)| (key, (of.start_ns(), of.sample_period_s));
    Ok(begins.into_iter().map(start).collect())
}

/// A window of a group, a half-open span of time, and what was chosen of it.
#[derive(Debug)]
pub struct Window {
    pub key: GroupKey,
    /// Time of the group's first burst, ns.
    pub start_ns: i64,
    pub from_ns: i64,
    pub to_ns: i64,
    /// Times of the bursts to learn from.
    pub chosen: BTreeSet<i64>,
    /// Number of signals to keep at most.
    pub most: usize,
    /// Whether a burst lay in it, or later.
    pub is_reached: bool,
}

impl Window {
    pub fn new(key: GroupKey, start_ns: i64, [from_ns, to_ns]: [i64; 2]) -> Window {
        Window {
            key,
            start_ns,
            from_ns,
            to_ns,
            chosen: BTreeSet::new(),
            most: 0,
            is_reached: false,
        }
    }
}

/// A part of a window: how many signals it holds, and of its moments those with the lowest hashes, as many as hold
/// what may be kept, each with its number of signals.
#[derive(Debug, Default)]
struct Part {
    signals: u64,
    kept: u64,
    moments: BTreeMap<(u64, i64), u64>,
}

impl Part {
    fn add(&mut self, moment: (u64, i64), signals: u64, most: u64) {
        self.signals += signals;
        self.kept += signals;
        *self.moments.entry(moment).or_default() += signals;
        while let Some(last) = self.moments.last_entry()
            && self.kept - last.get() >= most
        {
            self.kept -= last.remove();
        }
    }
}

#[derive(Debug)]
struct Draw<'w> {
    window: &'w mut Window,
    part_ns: i64,
    /// The parts up to the one at whose end the window ends.
    parts: Vec<Part>,
    channels: ChannelStretches,
    /// Maximum number of signals that may be kept.
    most: u64,
    /// The latest burst's time, ns, and how long the recording had gone on then; `None`: there was none yet.
    latest: Option<(i64, i64)>,
}

impl Draw<'_> {
    fn of<'w>(window: &'w mut Window, replay: &Replay) -> Draw<'w> {
        let fit = MOST_BYTES / (size_of::<f32>() * window.key.samples.max(1) as usize);
        let most = replay.settings.identify.window_signals.min(fit.max(64)) as u64;
        let part_ns = (window.to_ns.saturating_sub(window.from_ns) / PARTS).max(1);
        let parts = (0..PARTS).map(|_| Part::default()).collect();
        Draw { window, part_ns, parts, channels: ChannelStretches::default(), most, latest: None }
    }

    fn see(&mut self, burst: &Burst, signals: u64, elapsed_ns: i64) {
        let t_ns = burst.t_acq_ns;
        let latest = self.latest.map_or(t_ns, |(latest, _)| latest);
        if t_ns.abs_diff(latest) <= JUMP_NS as u64 {
            self.latest = Some((t_ns.max(latest), elapsed_ns));
            self.window.is_reached |= t_ns >= self.window.from_ns;
        }
        if !(self.window.from_ns..self.window.to_ns).contains(&t_ns) || signals == 0 {
            return;
        }
        let part = (t_ns.saturating_sub(self.window.from_ns) / self.part_ns) as usize;
        let part = part.min(PARTS as usize - 1);
        let since = t_ns.saturating_sub(self.window.start_ns);
        let Some(of) = self.parts.get_mut(part) else { return }; // behind the window's end
        of.add((drawn_by(since), t_ns), signals, self.most);
        // more channels than this do not make more signals be kept
        if OF_CHANNEL * u64::from(self.channels.channels()) < self.most {
            self.channels
                .add(burst.first_channel..burst.first_channel.saturating_add(burst.channels));
        }
        self.shorten();
    }

    /// Drops the parts behind the first one by which the window holds enough.
    fn shorten(&mut self) {
        let mut seen = 0;
        for (part, of) in self.parts.iter().enumerate() {
            seen += of.signals;
            if seen >= ENOUGH * self.most {
                self.parts.truncate(part + 1);
                return;
            }
        }
    }

    fn end_ns(&self) -> i64 {
        match self.parts.len() as i64 {
            PARTS => self.window.to_ns,
            parts => self.window.from_ns.saturating_add(parts * self.part_ns),
        }
    }

    /// Whether no later burst can belong to the window: the group's own clock says so, or so much time has passed
    /// for others since the group was heard.
    fn is_over(&self, reorder_ns: i64, elapsed_ns: i64) -> bool {
        let Some((latest, heard_ns)) = self.latest else { return elapsed_ns > MOST_WAIT_NS };
        let silent = elapsed_ns.saturating_sub(heard_ns);
        latest.saturating_add(silent).saturating_sub(reorder_ns) >= self.end_ns()
    }

    /// Chooses moments in the order of their hashes, until they hold as many signals as are kept.
    fn end(self) {
        let most = (OF_CHANNEL * u64::from(self.channels.channels())).max(FEWEST).min(self.most);
        let (end_ns, Draw { window, parts, .. }) = (self.end_ns(), self);
        (window.most, window.to_ns) = (most as usize, end_ns);
        let moments: BTreeMap<(u64, i64), u64> =
            parts.into_iter().flat_map(|of| of.moments).collect();
        let mut signals = 0;
        for ((_, t_ns), of_moment) in moments {
            signals += of_moment;
            if signals > most && !window.chosen.is_empty() {
                break;
            }
            window.chosen.insert(t_ns);
        }
    }
}

/// Chooses of each window the moments to learn from, with labels such as hold healthy signals. Returns the index of
/// the last block that was looked at.
pub fn choose(replay: &Replay, ahead: &Ahead, windows: &mut [Window]) -> Result<u64> {
    let mut draws: BTreeMap<GroupKey, Draw> = BTreeMap::new();
    for window in windows {
        draws.insert(window.key.clone(), Draw::of(window, replay));
    }
    let (mut groups, mut elapsed, mut last) = (Groups::default(), Elapsed::default(), 0);
    ahead.read(None, |block, burst| {
        let is_next = block != std::mem::replace(&mut last, block);
        if let Some(group) = groups.of(burst) {
            elapsed.hear(group, burst.t_acq_ns);
        }
        if let Some(draw) = draws.get_mut(&GroupKey::of(burst)) {
            draw.see(burst, usable(replay, burst), elapsed.now_ns);
        }
        // it is asked once in a block, which is often enough
        let are_over =
            |reorder_ns: i64| draws.values().all(|draw| draw.is_over(reorder_ns, elapsed.now_ns));
        match is_next && ahead.reorder_ns.is_some_and(are_over) {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }
    })?;
    draws.into_values().for_each(Draw::end);
    Ok(last)
}

/// Number of signals of a burst that labels say are healthy; without labels all.
fn usable(replay: &Replay, burst: &Burst) -> u64 {
    let labels = replay.labels.as_ref();
    if labels.is_none() {
        return u64::from(burst.channels);
    }
    let channels = (0..burst.channels).map(|row| burst.first_channel.saturating_add(row));
    channels.filter(|&channel| visit::is_healthy(labels, burst, channel)).count() as u64
}
