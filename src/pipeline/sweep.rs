//! A sweep is the longest stretch of a printhead's time in which no channel is heard at two moments, within
//! bounds. Its bursts wait until the sweep is over, and are then judged about the level that it shows.
//!
//! In: from `heads`, burst by burst. Out: whether a burst begins the next sweep ([`Sweep::hear`]), whether
//! open sweeps have lasted as long as they may ([`SweepClock`]), and at the end the bursts of a sweep.
//!
//! A *moment* is one time of acquisition t_a. Several bursts of a printhead may share it, for a logger may
//! divide the channels of one moment into messages as it likes. A channel is *heard* when a burst holds it.
//!
//! A sweep ends with a moment that holds all channels that were known before the sweep. If no moment does, it ends
//! * before the moment in which one of its channels is heard again;
//! * before a burst that comes more than [`MOST_NS`] after its begin;
//! * when the recording goes on for as long without it;
//! * when more than [`MOST_SAMPLES`] samples of all printheads were heard since its begin;
//! * where the clock was set, and at the end of the recording (`heads` sees to that).
//!
//! None of this depends on how a moment's channels are divided into messages, unless one moment alone holds more
//! than [`MOST_SAMPLES`].

use super::batches::Slot;
use super::channel_subset::ChannelStretches;
use super::elapsed::Elapsed;
use inkling_core::burst::Burst;
use std::ops::Range;

/// Longest duration of a sweep, ns.
const MOST_NS: i64 = 1_000_000_000;
/// Largest number of samples of all printheads, 8 MiB as int16, that are heard while a sweep is open, since
/// its bursts wait in memory.
const MOST_SAMPLES: u64 = 4 << 20;
/// Samples that each signal counts beside its own, so that the number of short signals is bounded, too.
const OF_SIGNAL: u64 = 64;

/// How much was heard of all printheads up to now: says when open sweeps have lasted as long as they may.
#[derive(Debug, Default)]
pub(super) struct SweepClock {
    latest_ns: Option<i64>,
    /// Number of samples heard before the moment `latest_ns`, that of the last burst, and since it began. A sweep counts from
    /// `before`, whatever the order of messages within a moment.
    before: u64,
    now: u64,
    /// How long the recording has gone on, whatever its printheads' clocks say.
    elapsed: Elapsed,
    /// When the first of the open sweeps was heard last, ns elapsed, and their least begin in samples; both may be too
    /// early, as of sweeps that have ended meanwhile, but never too late. `None`: none is open.
    earliest: Option<(i64, u64)>,
}

impl SweepClock {
    /// Counts a burst of a group. Every burst must be counted before a sweep hears it.
    pub fn hear(&mut self, group: usize, burst: &Burst) {
        self.elapsed.hear(group, burst.t_acq_ns);
        if self.latest_ns != Some(burst.t_acq_ns) {
            self.latest_ns = Some(burst.t_acq_ns);
            self.before = self.before.saturating_add(std::mem::take(&mut self.now));
        }
        let samples = u64::from(burst.samples_per_channel) + OF_SIGNAL;
        self.count(u64::from(burst.channels).saturating_mul(samples));
    }

    /// Counts samples that are held in memory.
    pub fn count(&mut self, samples: u64) {
        self.now = self.now.saturating_add(samples);
        // a moment that holds more than may wait is divided, wherever that happens to be
        if self.now > MOST_SAMPLES {
            self.before = self.before.saturating_add(std::mem::take(&mut self.now));
        }
    }

    /// Whether an open sweep may be over, which [`SweepClock::is_over`] then tells of each.
    pub fn is_due(&self) -> bool {
        self.earliest.is_some_and(|earliest| self.is_past(earliest))
    }

    /// Whether a sweep was not heard for as long as one may last, or holds up too much.
    pub fn is_over(&self, sweep: &Sweep) -> bool {
        self.is_past((sweep.heard_ns, sweep.from_samples))
    }

    fn is_past(&self, (heard_ns, from_samples): (i64, u64)) -> bool {
        self.elapsed.now_ns.saturating_sub(heard_ns) > MOST_NS
            || self.before.saturating_sub(from_samples) > MOST_SAMPLES
    }

    /// Forgets all sweeps, before [`SweepClock::opened`] is told those that are still open.
    pub fn forget(&mut self) {
        self.earliest = None;
    }

    pub fn opened(&mut self, sweep: &Option<Sweep>) {
        let Some(Sweep { heard_ns, from_samples, .. }) = sweep else { return };
        let (earliest, least) = self.earliest.unwrap_or((*heard_ns, *from_samples));
        self.earliest = Some((earliest.min(*heard_ns), least.min(*from_samples)));
    }
}

#[derive(Debug)]
pub(super) struct Sweep {
    /// Time of its first moment, ns.
    from_ns: i64,
    /// What [`SweepClock`] said when it was heard last, ns elapsed, and at its begin, in samples.
    heard_ns: i64,
    from_samples: u64,
    /// Its bursts, in the order in which they came, each with its place among those that wait for a judge.
    bursts: Vec<(Slot, Burst)>,
    /// Slots and moments (ns) of bursts whose channels were all heard already in the same moment: they are
    /// judged as the others, but say nothing new of the level.
    repeated: Vec<(Slot, i64)>,
    /// Its channels that were heard before its latest moment, and those heard in that moment.
    before: ChannelStretches,
    pub moment: ChannelStretches,
    pub latest_ns: i64,
}

pub(super) fn channels(of: &Burst) -> Range<u32> {
    of.first_channel..of.first_channel.saturating_add(of.channels)
}

impl Sweep {
    pub fn begin(slot: Slot, burst: &Burst, clock: &SweepClock) -> Sweep {
        Sweep::of(vec![(slot, burst.clone())], burst.t_acq_ns, clock)
    }

    fn of(bursts: Vec<(Slot, Burst)>, t_ns: i64, clock: &SweepClock) -> Sweep {
        let mut moment = ChannelStretches::default();
        bursts.iter().for_each(|(_, burst)| moment.add(channels(burst)));
        Sweep {
            from_ns: t_ns,
            heard_ns: clock.elapsed.now_ns,
            from_samples: clock.before,
            bursts,
            repeated: Vec::new(),
            before: ChannelStretches::default(),
            moment,
            latest_ns: t_ns,
        }
    }

    /// Adds a burst. If one of its channels was heard at an earlier moment of the sweep, the burst begins
    /// the next sweep: `self` becomes that one, and the sweep that is over is returned.
    pub fn hear(&mut self, slot: Slot, burst: &Burst, clock: &SweepClock) -> Option<Sweep> {
        let (t_ns, of) = (burst.t_acq_ns, channels(burst));
        self.heard_ns = clock.elapsed.now_ns;
        if t_ns > self.latest_ns {
            std::mem::take(&mut self.moment).0.into_iter().for_each(|of| self.before.add(of));
            self.latest_ns = t_ns;
        }
        // a burst that is a little late joins the sweep without counting for its end
        if t_ns < self.latest_ns {
            self.bursts.push((slot, burst.clone()));
            return None;
        }
        if self.moment.hold(&of) {
            self.repeated.push((slot, t_ns));
            return None;
        }
        // a burst that shares some of its channels with others of the moment is kept whole
        if !self.before.overlap(&of) {
            self.moment.add(of);
            self.bursts.push((slot, burst.clone()));
            return None;
        }
        // a channel is heard again: all bursts of this moment belong to the next sweep
        let of_moment = self.bursts.extract_if(.., |(_, of)| of.t_acq_ns == t_ns);
        let mut bursts: Vec<(Slot, Burst)> = of_moment.collect();
        bursts.push((slot, burst.clone()));
        let mut next = Sweep::of(bursts, t_ns, clock);
        next.repeated = self.repeated.extract_if(.., |(_, of)| *of == t_ns).collect();
        Some(std::mem::replace(self, next))
    }

    /// Whether a burst at that time comes too late for it to last on.
    pub fn is_past(&self, t_ns: i64) -> bool {
        t_ns.saturating_sub(self.from_ns) > MOST_NS
    }

    /// Time of its latest burst, ns; `latest_ns` may be the next sweep's moment already.
    pub fn to_ns(&self) -> i64 {
        self.bursts.iter().map(|(_, of)| of.t_acq_ns).max().unwrap_or(self.latest_ns)
    }

    /// Its bursts without the repeated ones, sorted by time and first channel.
    pub fn bursts(&self) -> Vec<&Burst> {
        let mut bursts: Vec<&Burst> = self.bursts.iter().map(|(_, burst)| burst).collect();
        bursts.sort_by_key(|of| (of.t_acq_ns, of.first_channel));
        bursts
    }

    /// The slots of all its bursts, repeated ones included, in any order.
    pub fn slots(&self) -> impl Iterator<Item = Slot> {
        self.bursts.iter().map(|(slot, _)| *slot).chain(self.repeated.iter().map(|(slot, _)| *slot))
    }
}
