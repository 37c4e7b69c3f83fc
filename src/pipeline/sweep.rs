//! A sweep is the longest stretch of a printhead's time in which no channel is heard twice, within bounds.
//! Its bursts are judged about one level.
//!
//! A sweep ends with a moment in which all channels that were known before it are heard; or else before the
//! moment in which one of its channels is heard again, after [`MOST_NS`], or when the recording holds
//! [`MOST_SAMPLES`] more samples. All four depend on times and channels alone, and not on how these are
//! divided into messages.

use super::batches::Slot;
use super::channel_stretches::ChannelStretches;
use inkling_core::burst::Burst;
use inkling_core::design::Judge;
use std::ops::Range;
use std::sync::Arc;

/// Longest duration of a sweep, ns.
const MOST_NS: i64 = 1_000_000_000;
/// Number of samples of all printheads, 8 MiB as int16, that may be heard while a sweep is open: its bursts
/// wait in memory. Each signal counts as [`OF_SIGNAL`] samples more than it has.
const MOST_SAMPLES: u64 = 4 << 20;
/// Samples that each signal is counted as beside its own.
const OF_SIGNAL: u64 = 64;

/// How much was heard of all printheads up to now, in time and samples: says when open sweeps must end.
#[derive(Debug, Default)]
pub(super) struct Clock {
    latest_ns: Option<i64>,
    /// Number of samples heard before the moment `latest_ns`, and in it. A sweep counts from `before`, so
    /// that its end does not depend on the order of messages within a moment.
    before: u64,
    now: u64,
    /// Begin of the earliest of the open sweeps, in time and, by itself, in samples; `None`: none is open.
    earliest: Option<(i64, u64)>,
}

impl Clock {
    /// Counts a burst.
    pub fn hear(&mut self, burst: &Burst) {
        if self.latest_ns.is_none_or(|latest| burst.t_acq_ns > latest) {
            self.latest_ns = Some(burst.t_acq_ns);
            self.before = self.before.saturating_add(std::mem::take(&mut self.now));
        }
        let samples = u64::from(burst.samples_per_channel) + OF_SIGNAL;
        self.now = self.now.saturating_add(u64::from(burst.channels).saturating_mul(samples));
        // a moment that holds more than may wait is divided, wherever that happens to be
        if self.now > MOST_SAMPLES {
            self.before = self.before.saturating_add(std::mem::take(&mut self.now));
        }
    }

    /// Whether at least one open sweep may have lasted as long as one may;
    /// cheap, so it is asked at each burst.
    pub fn is_due(&self, t_ns: i64) -> bool {
        self.earliest.is_some_and(|from| self.is_long(from, t_ns))
    }

    /// Whether this sweep has lasted as long as one may.
    pub fn is_over(&self, sweep: &Sweep, t_ns: i64) -> bool {
        self.is_long(sweep.from, t_ns)
    }

    /// Whether more time has passed, or more samples were heard, since then than a sweep may last.
    fn is_long(&self, (from_ns, from_samples): (i64, u64), t_ns: i64) -> bool {
        t_ns.saturating_sub(from_ns) > MOST_NS
            || self.before.saturating_sub(from_samples) > MOST_SAMPLES
    }

    /// Forgets the open sweeps, before they are told again by [`Clock::opened`].
    pub fn forget(&mut self) {
        self.earliest = None;
    }

    /// Takes a sweep, if there is one, into account as open.
    pub fn opened(&mut self, sweep: &Option<Sweep>) {
        let Some(Sweep { from, .. }) = sweep else { return };
        let (from_ns, from_samples) = self.earliest.unwrap_or(*from);
        self.earliest = Some((from_ns.min(from.0), from_samples.min(from.1)));
    }
}

#[derive(Debug)]
pub(super) struct Sweep {
    /// The window's judge, one for the whole sweep.
    pub judge: Arc<Judge>,
    /// Its begin, ns, and [`Clock`]'s count of samples then.
    from: (i64, u64),
    bursts: Vec<(Slot, Burst)>,
    /// Slots of bursts whose channels were all heard before in the same moment: they say nothing new, so only
    /// their slots are kept.
    repeated: Vec<Slot>,
    /// Channels heard before the latest moment, and in it.
    before: ChannelStretches,
    moment: ChannelStretches,
    latest_ns: i64,
}

/// The channel numbers of a burst.
pub(super) fn channels(of: &Burst) -> Range<u32> {
    of.first_channel..of.first_channel.saturating_add(of.channels)
}

impl Sweep {
    /// Begins a sweep with a burst.
    pub fn begin(slot: Slot, judge: Arc<Judge>, burst: &Burst, clock: &Clock) -> Sweep {
        Sweep::of(vec![(slot, burst.clone())], judge, burst.t_acq_ns, clock)
    }

    /// A sweep of bursts that all lie in one moment, `t_ns`.
    fn of(bursts: Vec<(Slot, Burst)>, judge: Arc<Judge>, t_ns: i64, clock: &Clock) -> Sweep {
        let mut moment = ChannelStretches::default();
        bursts.iter().for_each(|(_, burst)| moment.add(channels(burst)));
        Sweep {
            judge,
            from: (t_ns, clock.before),
            bursts,
            repeated: Vec::new(),
            before: ChannelStretches::default(),
            moment,
            latest_ns: t_ns,
        }
    }

    /// Adds a burst. If it begins the next sweep, `self` becomes that one, and the
    /// sweep that is over is returned.
    pub fn hear(&mut self, slot: Slot, burst: &Burst, clock: &Clock) -> Option<Sweep> {
        let (t_ns, of) = (burst.t_acq_ns, channels(burst));
        if t_ns > self.latest_ns {
            std::mem::take(&mut self.moment).into_iter().for_each(|of| self.before.add(of));
            self.latest_ns = t_ns;
        }
        // a late burst joins the sweep, and does not count for its end
        if t_ns < self.latest_ns {
            self.bursts.push((slot, burst.clone()));
            return None;
        }
        if self.moment.hold(&of) {
            self.repeated.push(slot);
            return None;
        }
        if !self.before.overlap(&of) {
            self.moment.add(of);
            self.bursts.push((slot, burst.clone()));
            return None;
        }
        // A channel is heard again. All bursts of this moment belong to the next sweep, also those that were
        // already added to this one.
        let of_moment = self.bursts.extract_if(.., |(_, of)| of.t_acq_ns == t_ns);
        let mut bursts: Vec<(Slot, Burst)> = of_moment.collect();
        bursts.push((slot, burst.clone()));
        let next = Sweep::of(bursts, self.judge.clone(), t_ns, clock);
        Some(std::mem::replace(self, next))
    }

    /// Whether its latest moment holds all of `channels`.
    pub fn holds_at_once(&self, channels: &ChannelStretches) -> bool {
        channels.iter().all(|of| self.moment.hold(of))
    }

    /// Whether it holds a later moment than `t_ns`.
    pub fn is_later(&self, t_ns: i64) -> bool {
        t_ns < self.latest_ns
    }

    /// Time of its latest burst, ns.
    pub fn to_ns(&self) -> i64 {
        self.bursts.iter().map(|(_, of)| of.t_acq_ns).max().unwrap_or(self.latest_ns)
    }

    /// Its bursts, sorted by time and first channel.
    pub fn bursts(&self) -> Vec<&Burst> {
        let mut bursts: Vec<&Burst> = self.bursts.iter().map(|(_, burst)| burst).collect();
        bursts.sort_by_key(|of| (of.t_acq_ns, of.first_channel));
        bursts
    }

    /// The slots of all its bursts, repeated ones included, in any order.
    pub fn slots(&self) -> impl Iterator<Item = Slot> {
        self.bursts.iter().map(|(slot, _)| *slot).chain(self.repeated.iter().copied())
    }
}
