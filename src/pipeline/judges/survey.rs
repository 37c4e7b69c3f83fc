//! Finds where the first windows of some groups lie, and which of their bursts are to be learned from, without
//! holding any samples.
//!
//! In: the bursts from the first one on whose group has no judge. Out: the groups that begin there ([`starts`]); and
//! for a window of each the times of the bursts that are learned from, and the blocks that hold them ([`choose`]).
//!
//! A window ends `identify.first` after it begins, or earlier, at one of [`BINS`] equal parts of it, where it holds
//! [`ENOUGH`] times as many signals as are kept. Which of its bursts are kept is drawn by a hash of the time since
//! the head's first burst. So neither dates nor numbers and order of channels, names or other printheads matter,
//! nor the order of bursts in the file.

use super::super::Result;
use super::super::channel_subset::ChannelStretches;
use super::super::groups::GroupKey;
use super::super::run::Replay;
use super::super::visit;
use super::windows::Ahead;
use inkling_core::burst::Burst;
use inkling_core::identify::reservoir::drawn_by;
use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::ops::ControlFlow;

/// Maximum number of groups that are learned together, which bounds memory.
const MOST_GROUPS: usize = 64;
/// Groups that begin within this time, ns, or so many signals, are learned together.
const TOGETHER_NS: i64 = 1_000_000_000;
const TOGETHER_SIGNALS: u64 = 1 << 18;
/// A window is divided into so many parts; it may end at the end of each.
const BINS: i64 = 64;
/// A window of so many times the signals that are kept is long enough.
const ENOUGH: u64 = 16;
/// Least number of signals that are kept, and how many of each channel.
const FEWEST: usize = 1024;
const OF_CHANNEL: usize = 32;
/// Maximum bytes of one window's signals.
const MOST_BYTES: usize = 96 << 20;

/// Time of the earliest burst, ns, and sample period, s, of each group that begins where reading ahead begins.
pub fn starts(
    ahead: &Ahead,
    is_new: impl Fn(&Burst, &GroupKey) -> bool,
) -> Result<BTreeMap<GroupKey, (i64, f64)>> {
    let mut starts: BTreeMap<GroupKey, (i64, f64)> = BTreeMap::new();
    let (mut first, mut latest, mut signals) = (i64::MAX, i64::MIN, 0);
    ahead.read(None, |_, burst| {
        let t_ns = burst.t_acq_ns;
        let key = GroupKey::of(burst);
        let has_room = starts.len() < MOST_GROUPS || starts.contains_key(&key);
        if has_room && is_new(burst, &key) {
            let (earliest, _) = starts.entry(key).or_insert((t_ns, burst.sample_period_s));
            *earliest = t_ns.min(*earliest);
            first = first.min(t_ns);
        }
        if starts.is_empty() {
            return ControlFlow::Continue(()); // the block holds earlier bursts of groups that have judges
        }
        latest = latest.max(t_ns);
        signals += u64::from(burst.channels);
        // later bursts come no more than the reorder time before the latest one so far
        let passed = latest.saturating_sub(first);
        let together = passed >= TOGETHER_NS || signals >= TOGETHER_SIGNALS;
        match ahead.reorder_ns.is_some_and(|reorder| together && passed >= reorder) {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }
    })?;
    Ok(starts)
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
    pub blocks: HashSet<u64>,
    /// Number of signals to keep at most.
    pub most: usize,
    /// Whether a burst lay in it, or later.
    pub is_reached: bool,
}

impl Window {
    pub fn new(key: GroupKey, start_ns: i64, [from_ns, to_ns]: [i64; 2]) -> Window {
        let (chosen, blocks) = (BTreeSet::new(), HashSet::new());
        Window { key, start_ns, from_ns, to_ns, chosen, blocks, most: 0, is_reached: false }
    }
}

/// The bursts of one moment of a group.
#[derive(Debug, Default)]
struct Moment {
    signals: u64,
    blocks: HashSet<u64>,
}

#[derive(Debug)]
struct Draw<'w> {
    window: &'w mut Window,
    /// Number of signals in each part of the window.
    bins: Vec<u64>,
    channels: ChannelStretches,
    /// The moments with the lowest hashes so far, and the number of their signals.
    moments: BTreeMap<(u64, i64), Moment>,
    signals: u64,
    /// Maximum number of signals that may be kept.
    most: u64,
}

impl Draw<'_> {
    fn of<'w>(window: &'w mut Window, replay: &Replay) -> Draw<'w> {
        let fit = MOST_BYTES / (size_of::<f32>() * window.key.samples.max(1) as usize);
        let most = replay.settings.identify.window_signals.min(fit.max(64)) as u64;
        let (channels, moments) = (ChannelStretches::default(), BTreeMap::new());
        Draw { window, bins: vec![0; BINS as usize], channels, moments, signals: 0, most }
    }

    /// Length of a part of the window, ns.
    fn part_ns(&self) -> i64 {
        (self.window.to_ns.saturating_sub(self.window.from_ns) / BINS).max(1)
    }

    fn see(&mut self, block: u64, burst: &Burst, signals: u64) {
        let t_ns = burst.t_acq_ns;
        self.window.is_reached |= t_ns >= self.window.from_ns;
        if !(self.window.from_ns..self.window.to_ns).contains(&t_ns) {
            return;
        }
        let part = (t_ns - self.window.from_ns) / self.part_ns();
        self.bins[part.min(BINS - 1) as usize] += signals;
        self.channels.add(burst.first_channel..burst.first_channel.saturating_add(burst.channels));

        let since = t_ns.saturating_sub(self.window.start_ns);
        let moment = self.moments.entry((drawn_by(since), t_ns)).or_default();
        moment.signals += signals;
        moment.blocks.insert(block);
        self.signals += signals;
        // twice as many are held, since some may turn out to lie behind the window's end
        while self.signals > 2 * self.most && self.moments.len() > 1 {
            self.signals -= self.moments.pop_last().map_or(0, |(_, last)| last.signals);
        }
    }

    /// Whether no later burst can belong to the window, which ends where it holds enough.
    fn is_over(&mut self, sure_ns: i64) -> bool {
        let (part_ns, from_ns) = (self.part_ns(), self.window.from_ns);
        let mut seen = 0;
        for (part, signals) in (1..).zip(&self.bins) {
            seen += signals;
            let to_ns = from_ns.saturating_add(part * part_ns);
            if to_ns > sure_ns {
                return self.window.to_ns <= sure_ns;
            }
            if seen >= ENOUGH * self.most {
                self.window.to_ns = to_ns;
                return true;
            }
        }
        self.window.to_ns <= sure_ns
    }

    /// Chooses moments in the order of their hashes, until they hold as many signals as are kept.
    fn end(self) {
        let Draw { window, channels, moments, most, .. } = self;
        let of_channels = OF_CHANNEL * channels.channels() as usize;
        window.most = (most as usize).min(of_channels.max(FEWEST));
        let mut signals = 0;
        for ((_, t_ns), moment) in moments {
            if t_ns >= window.to_ns || moment.signals == 0 {
                continue;
            }
            signals += moment.signals as usize;
            if signals > window.most && !window.chosen.is_empty() {
                break;
            }
            window.chosen.insert(t_ns);
            window.blocks.extend(moment.blocks);
        }
    }
}

/// Chooses of each window the bursts to learn from, with labels those that hold healthy signals.
pub fn choose(replay: &Replay, ahead: &Ahead, windows: &mut [Window]) -> Result<()> {
    let mut draws: BTreeMap<GroupKey, Draw> = BTreeMap::new();
    for window in windows {
        draws.insert(window.key.clone(), Draw::of(window, replay));
    }
    let (mut latest, mut look_at) = (i64::MIN, i64::MIN);
    ahead.read(None, |block, burst| {
        if let Some(draw) = draws.get_mut(&GroupKey::of(burst)) {
            draw.see(block, burst, usable(replay, burst));
        }
        latest = latest.max(burst.t_acq_ns);
        let Some(reorder_ns) = ahead.reorder_ns.filter(|_| latest >= look_at) else {
            return ControlFlow::Continue(());
        };
        let sure_ns = latest.saturating_sub(reorder_ns);
        look_at = latest.saturating_add(draws.values().map(Draw::part_ns).min().unwrap_or(0));
        // every window is asked, since each notes where it ends
        let are_over = draws.values_mut().fold(true, |over, draw| draw.is_over(sure_ns) && over);
        if are_over { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    })?;
    draws.into_values().for_each(Draw::end);
    Ok(())
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
