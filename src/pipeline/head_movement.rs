//! Records how far all channels of a printhead moved together over a recording, and whether the printhead was
//! another one at times, and words the warnings about that.
//!
//! In: what `head` finds, sweep by sweep. Out: an entry of `moved_together` in summary.json, and sentences
//! that `finish` adds to the warnings. Nothing here changes a verdict.

use crate::report::clock;
use crate::settings::IdentifySettings;
use inkling_core::model::median::median;
use inkling_core::numbers::LITTLE;
use inkling_core::state::{Features, Head, OtherChannel};
use inkling_lab::plot::digits::significant;
use serde::Serialize;
use std::sync::Arc;

/// Warned about is a printhead whose channels lie this many times as far from each other as the model's did.
const MOST_SCATTER: f64 = 2.0;

#[derive(Clone, Debug, Default, Serialize)]
pub struct HeadMovement {
    pub printhead: Arc<str>,
    /// Number of sweeps that were judged by a moved judge.
    pub bursts: u64,
    /// The largest change of the level from the base ring, with its sign: 0.1 is 10 % more.
    pub amplitude: f64,
    pub damping: f64,
    pub frequency: f64,
    /// When the level first lay beyond the bounds, ns.
    pub beyond_since_ns: Option<i64>,
    /// Number of sweeps that were rejected because it was another head, and when the first of them was, ns.
    pub strange: u64,
    pub strange_since_ns: Option<i64>,
    /// When all channels turned out to be others than those that were remembered, ns.
    pub swapped_ns: Option<i64>,
    /// The largest ratio of how far its channels lie from each other to how far the model's did; and when it
    /// first surely exceeded [`MOST_SCATTER`], ns.
    pub scatter: f64,
    pub scatter_since_ns: Option<i64>,
    /// Since when most signals held more than a ring, so that the level was not known, ns.
    pub no_rings_since_ns: Option<i64>,
    /// How large these were beside the expected ones, if most of them had the form of those and were far smaller.
    pub size: Option<f64>,
    /// Channels that ring otherwise since a pause, as other channels in their places would.
    pub replaced: Vec<ReplacedChannel>,
    /// The level of the first rejected sweep: ln amplitude, ln damping, ln frequency, phase in rad.
    pub strange_at: Option<[f64; 4]>,
    /// The drive with which it was recorded, over the design's.
    pub strange_drive: Option<f64>,
}

/// A channel that was replaced, and how its ring differs from before: relative changes, .1 is 10 % more.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ReplacedChannel {
    pub channel: u32,
    pub since_ns: i64,
    pub amplitude: f64,
    pub damping: f64,
    pub frequency: f64,
}

impl From<OtherChannel> for ReplacedChannel {
    fn from(of: OtherChannel) -> ReplacedChannel {
        let [amplitude, damping, frequency, _] = of.by.map(f64::exp_m1).into();
        ReplacedChannel {
            channel: of.channel,
            since_ns: of.since_ns,
            amplitude,
            damping,
            frequency,
        }
    }
}

impl ReplacedChannel {
    fn in_words(&self) -> String {
        format!(
            "channel {} rings otherwise since {}, as a replaced channel would: damping {:+.1} %, resonance {:+.2} %, \
             amplitude {:+.1} % against before; if nobody replaced it, look at it: a slight fault that came in the pause is \
             taken for healthy from now on",
            self.channel,
            at(self.since_ns),
            100.0 * self.damping,
            100.0 * self.frequency,
            100.0 * self.amplitude,
        )
    }
}

/// Most replaced channels of a printhead that are told one by one.
const MOST_REPLACED: usize = 16;

impl HeadMovement {
    pub fn new(printhead: Arc<str>) -> HeadMovement {
        HeadMovement { printhead, scatter: 1.0, ..HeadMovement::default() }
    }

    pub fn is_told(&self) -> bool {
        self.bursts > 0 || !self.replaced.is_empty() || self.is_of_all_channels()
    }

    /// Whether a warning explains that many channels are flagged at once.
    pub fn is_of_all_channels(&self) -> bool {
        let since = [self.beyond_since_ns, self.swapped_ns, self.scatter_since_ns];
        let since = since.into_iter().chain([self.no_rings_since_ns]);
        self.strange > 0 || since.flatten().next().is_some()
    }

    /// Takes in a sweep in which most signals hold more than a ring. `sizes`: of those that have the form of the
    /// expected ones.
    pub fn note_no_rings(&mut self, t_ns: i64, no_rings: usize, mut sizes: Vec<f64>) {
        if self.no_rings_since_ns.is_none() {
            self.no_rings_since_ns = Some(t_ns);
            let size = (2 * sizes.len() > no_rings).then(|| median(&mut sizes));
            self.size = size.filter(|size| size.abs() < LITTLE);
        }
    }

    /// Takes in a level; of ln amplitude, ln damping and ln frequency the values farthest from 0 are kept.
    pub fn note_level(&mut self, level: &Features) {
        let farthest = [&mut self.amplitude, &mut self.damping, &mut self.frequency];
        for (most, level) in farthest.into_iter().zip(level.iter()) {
            // what is kept is a relative change, the level a logarithm
            if level.abs() > most.ln_1p().abs() {
                *most = level.exp_m1();
            }
        }
    }

    pub fn note_scatter(&mut self, t_ns: i64, of: &Head) {
        self.scatter = self.scatter.max(of.wider());
        if of.surely_wider() > MOST_SCATTER {
            self.scatter_since_ns.get_or_insert(t_ns);
        }
    }

    /// Notes a sweep that was rejected because most channels lay at `level`, where this head never was.
    pub fn note_strange(&mut self, t_ns: i64, level: Features, drive: f64) {
        self.strange += 1;
        self.strange_drive.get_or_insert(drive);
        self.strange_since_ns.get_or_insert(t_ns);
        self.strange_at.get_or_insert(level.into());
    }

    pub fn warnings(&self, identify: &IdentifySettings) -> Vec<String> {
        let beyond = self.beyond_since_ns.map(|since_ns| {
            format!(
                "since {} all channels have moved together beyond a quarter in amplitude, or the bounds of \
                 identify.max_damping_drift = {:.1} % and max_frequency_drift = {:.2} %: damping {:+.1} %, resonance {:+.2} %, amplitude \
                 {:+.1} % at most; look at ink, temperature and supply, not at single channels, which are \
                 judged about what all have in common",
                at(since_ns),
                100.0 * identify.max_damping_drift,
                100.0 * identify.max_frequency_drift,
                100.0 * self.damping,
                100.0 * self.frequency,
                100.0 * self.amplitude,
            )
        });
        let strange = self.strange_since_ns.zip(self.strange_at).map(|(since_ns, level)| {
            // amplitudes are counted per unit drive, so that a drive in another unit looks like another gain
            let drive = self.strange_drive.filter(|of| (of.ln() + level[0]).abs() < LITTLE);
            let drive = drive.map_or(String::new(), |of| {
                let times = significant(of, 3);
                format!(" (a drive of {times} times the design's was recorded: in another unit?)")
            });
            format!(
                "most channels ring as this printhead never did, in {} passes over its channels from {} on: {} times as \
                 large{drive}, damping {:+.0} %, resonance {:+.1} %, phase {:+.0}°; those signals are rejected \
                 (head_changed). Look at wiring, gain, drive and clock; for another printhead of that name train a \
                 design, or judge it by --identify windows",
                self.strange,
                at(since_ns),
                significant(level[0].exp(), 3),
                100.0 * level[1].exp_m1(),
                100.0 * level[2].exp_m1(),
                level[3].to_degrees(),
            )
        });
        let swapped = self.swapped_ns.map(|from_ns| {
            format!(
                "from {} on its channels are others than those that --baseline remembers: another printhead of that \
                 name, whose channels are learned anew",
                at(from_ns),
            )
        });
        let scatter = self.scatter_since_ns.map(|since_ns| {
            format!(
                "from {} on its channels lie up to {:.1} times as far from each other as those that its model was learned \
                 from: each has aged its own way, or more than half of them are faulty. They are judged by what most of \
                 them do; train a design on what they are now, or look at single channels with --identify windows",
                at(since_ns),
                self.scatter,
            )
        });
        let no_rings = self.no_rings_since_ns.filter(|_| self.size.is_none()).map(|since_ns| {
            format!(
                "from {} on most of its signals hold more than the ring that the design knows, such as noise, hum or another \
                 form: what all its channels have in common is not known, and faults may pass; look at amplifier, cable and supply",
                at(since_ns)
            )
        });
        let replaced = self.replaced.iter().take(MOST_REPLACED).map(ReplacedChannel::in_words);
        let more = self.replaced.len().saturating_sub(MOST_REPLACED);
        let more = (more > 0).then(|| format!("{more} channels more ring otherwise"));
        let of_all = [beyond, strange, swapped, scatter, no_rings].into_iter().flatten();
        of_all.chain(replaced).chain(more).collect()
    }
}

impl HeadMovement {
    /// Why its verdicts say nothing of nozzles, if its signals are those of another unit.
    pub fn of_other_unit(&self) -> Option<String> {
        let (since_ns, size) = self.no_rings_since_ns.zip(self.size)?;
        Some(format!(
            "from {} on most of its signals have the form that the design knows, and {} times the size, too small to be \
             told from its noise: those of another unit (volts instead of counts), or of another gain",
            at(since_ns),
            significant(size, 2)
        ))
    }
}

pub(super) fn at(t_ns: i64) -> String {
    format!("{} UTC", clock(t_ns))
}
