//! Collects signals from recordings, for the verbs that learn from them.
//!
//! [`Collector`]: for `train`, `identify` and `thesis`, a bounded sample of usable signals for each label and
//! printhead, as a [`TrainingSet`]. The signals with the lowest hashes stay, so the sample mostly does not depend
//! on the signals' order.
//!
//! [`Observer`]: for `critique`, a bounded sample of signals that may be healthy, with what was recorded beside
//! them, as [`Observations`]. Of longer signals fewer are held.
//!
//! Both are given one recording after another (`take`), and hand out what they hold at the end (`finish`). The
//! first burst with a signal that labels do not leave out decides the sampling; others are only counted.

use super::Result;
use super::visit::{self, Pass};
use crate::settings::INT16_RAILS;
use inkling_core::burst::Burst;
use inkling_core::design::{TrainingSet, same_period};
use inkling_core::fault::{HEALTHY, IGNORE};
use inkling_core::identify::reservoir::Reservoir;
use inkling_core::labels::{Labels, RecordedSpans, Span};
use inkling_core::verdict::unusable_signal;
use inkling_io::damage::Damage;
use inkling_lab::critique::observations::{Observations, Sampler};
use std::collections::BTreeMap;
use std::sync::atomic::Ordering;

/// Maximum number of signals kept per printhead: of healthy signals, and of signals with each other label.
const MOST_HEALTHY: usize = 32_768;
const MOST_FAULTY: usize = 8_192;
/// Maximum number of sets, one for each printhead and label.
const MOST_SETS: usize = 512;

/// What signals count under that have another sampling than the first one.
pub const OTHER_SAMPLING: &str = "other_sampling";

fn sampling_of(burst: &Burst) -> (f64, usize) {
    (burst.sample_period_s, burst.samples_per_channel as usize)
}

#[derive(Default)]
pub struct Collector<'a> {
    /// `None`: every signal counts as healthy.
    labels: Option<&'a Labels>,
    rails: [f64; 2],
    sampling: Option<(f64, usize)>,
    first: Option<(f64, usize)>,
    /// The samples of signals, by (label, printhead).
    sets: BTreeMap<(String, String), Reservoir>,
    /// Number of signals seen, by label; of those that were not collected, by the reason.
    signals: BTreeMap<String, u64>,
    /// The printheads, times and channels that were seen, which labels may cover.
    pub met: RecordedSpans,
    /// A sentence about the first recording with signals of another sampling.
    pub other_sampling: Option<String>,
}

impl<'a> Collector<'a> {
    pub fn new(labels: Option<&'a Labels>, rails: [f64; 2]) -> Collector<'a> {
        Collector { labels, rails, ..Collector::default() }
    }

    /// Takes the signals of a recording. Returns its damage. An unusable burst counts as one rejected signal.
    pub fn take(&mut self, pass: Pass) -> Result<Vec<Damage>> {
        let mut signal = Vec::new();
        let lost = pass.bursts(|burst| {
            pass.control.signals.fetch_add(u64::from(burst.channels), Ordering::Relaxed);
            let (t_ns, first_channel) = (burst.t_acq_ns, burst.first_channel);
            let last_channel = first_channel.saturating_add(burst.channels.saturating_sub(1));
            let span = Span { from_ns: t_ns, to_ns: t_ns, first_channel, last_channel };
            self.met.see(&burst.printhead, span);
            self.first.get_or_insert(sampling_of(burst));
            for row in 0..burst.channels as usize {
                let label = self.take_signal(burst, row, &mut signal);
                if label == OTHER_SAMPLING && self.other_sampling.is_none() {
                    self.other_sampling = self.differs(burst, &pass.recording.name);
                }
                self.count(label, 1);
            }
        })?;
        if lost.unusable_bursts > 0 {
            self.count("rejected", lost.unusable_bursts);
        }
        Ok(lost.all_damage(pass.recording))
    }

    /// Returns what the signal counts under: its label, or the reason why it was not collected.
    fn take_signal(&mut self, burst: &Burst, row: usize, signal: &mut Vec<f64>) -> &'a str {
        let beside = burst.beside(row);
        // what the labels say of this signal; without labels it is healthy
        let label = match self.labels {
            None => Some((HEALTHY, None)),
            Some(labels) => labels
                .row_at(&burst.printhead, beside.channel, burst.t_acq_ns)
                .map(|label| (label.state.as_str(), label.severity)),
        };
        let Some((state, severity)) = label.filter(|(state, _)| *state != IGNORE) else {
            return if label.is_some() { IGNORE } else { "unlabelled" };
        };

        let (period, n) = *self.sampling.get_or_insert(sampling_of(burst));
        if n != sampling_of(burst).1 || !same_period(period, burst.sample_period_s) {
            return OTHER_SAMPLING;
        }
        signal.resize(n, 0.0);
        burst.copy_signal(row, signal);
        if unusable_signal(signal, self.rails).is_some() {
            return "rejected";
        }

        let key = (state.to_owned(), burst.printhead.to_string());
        if self.sets.len() < MOST_SETS || self.sets.contains_key(&key) {
            let most = if state == HEALTHY { MOST_HEALTHY } else { MOST_FAULTY };
            let reservoir = self.sets.entry(key).or_insert_with(|| Reservoir::new(n, most));
            reservoir.offer(beside, signal, severity.unwrap_or(f64::NAN));
        } else {
            self.count("beyond_the_limit_of_sets", 1);
        }
        state
    }

    fn differs(&self, burst: &Burst, recording: &str) -> Option<String> {
        let of = |(period_s, n): (f64, usize)| format!("{n} samples, one each {period_s:e} s");
        let (first, other) = (of(self.sampling?), of(sampling_of(burst)));
        let printhead = &burst.printhead;
        Some(format!("{recording}: signals of {printhead} have {other}, and the first had {first}"))
    }

    fn count(&mut self, label: &str, n: u64) {
        match self.signals.get_mut(label) {
            Some(count) => *count += n,
            None => drop(self.signals.insert(label.into(), n)),
        }
    }

    /// What was collected, with drives relative to the mean voltage of the healthy signals that were kept.
    /// `None`: no burst was seen.
    pub fn finish(self) -> Option<TrainingSet> {
        let (sample_period_s, samples) = self.sampling.or(self.first)?;

        let healthy = self.sets.iter().filter(|((state, _), _)| state == HEALTHY);
        let voltages = healthy.map(|(_, reservoir)| reservoir.voltage_sum());
        let (sum, n) = voltages.fold((0.0, 0), |(sum, n), (s, m)| (sum + s, n + m));
        let drive_voltage_v = (n > 0).then(|| sum / n as f64);

        let mut set = TrainingSet {
            sample_period_s,
            samples,
            drive_voltage_v,
            signals: self.signals,
            ..TrainingSet::default()
        };
        for ((state, printhead), reservoir) in self.sets {
            let signals = reservoir.to_set(drive_voltage_v);
            if state == HEALTHY {
                set.healthy.insert(printhead, signals);
            } else {
                set.faulty.entry(state).or_default().insert(printhead, signals);
            }
        }
        Some(set)
    }
}

/// Most signals that an [`Observer`] holds, if all are as long as the first: two processors criticise so many, with several
/// causes in them, in half a minute.
const MOST_SIGNALS: usize = 1536;
/// Work per signal grows with the square of its samples: of signals longer than this fewer are held, down to
/// [`FEWEST_SIGNALS`].
const USUAL_SAMPLES: usize = 128;
const FEWEST_SIGNALS: usize = 512;

/// The rails of the converter that gave a signal. Those of 16 bit are the default; a signal that goes beyond
/// them came from another converter, for which no rails are known. Only a critique widens the rails so.
fn rails_of(signal: &[f64], rails: [f64; 2]) -> [f64; 2] {
    let is_wider = |y: &f64| *y < rails[0] || *y > rails[1];
    match rails == INT16_RAILS && signal.iter().any(is_wider) {
        true => [f64::NEG_INFINITY, f64::INFINITY],
        false => rails,
    }
}

/// The signals of one sample period. A signal may be held up to twice as long as the first one was.
struct PeriodSignals {
    period_s: f64,
    most_samples: usize,
    sampler: Sampler,
}

impl PeriodSignals {
    /// None yet, of this sample period, s. `n`: samples of the first signal, which decides how many are held: of
    /// long ones fewer, by the square of their length.
    fn new(period_s: f64, n: usize, most_samples: usize, whole_bursts: bool) -> PeriodSignals {
        let kept = n.min(most_samples);
        let wanted = MOST_SIGNALS * USUAL_SAMPLES.pow(2) / kept.max(1).pow(2);
        let wanted = wanted.clamp(FEWEST_SIGNALS, MOST_SIGNALS);
        let most_samples = most_samples.min(2 * kept);
        let mut sampler = Sampler::new(period_s, wanted);
        sampler.whole_bursts = whole_bursts;
        PeriodSignals { period_s, most_samples, sampler }
    }
}

#[derive(Default)]
pub struct Observer<'a> {
    labels: Option<&'a Labels>,
    rails: [f64; 2],
    /// What is held; `None`: no signal that may be healthy came yet.
    sampler: Option<PeriodSignals>,
    /// Sample period of the first burst of all, s; `None`: no burst came yet.
    first_period_s: Option<f64>,
    /// Samples that are taken of a longer signal.
    most_samples: usize,
    /// Whether the signals of a burst are held together or not at all.
    pub whole_bursts: bool,
    /// Number of signals that cannot be used; an unusable burst counts as one.
    pub rejected: u64,
    /// Number of signals of another sample period or (known after [`Observer::finish`]) too short.
    pub other_sampling: u64,
    longest: usize,
    /// After [`Observer::finish`]: whether some signal was longer than what was taken of it.
    pub is_cut: bool,
}

impl<'a> Observer<'a> {
    pub fn new(labels: Option<&'a Labels>, rails: [f64; 2], most_samples: usize) -> Observer<'a> {
        Observer { labels, rails, most_samples, ..Observer::default() }
    }

    /// Takes the signals of a recording that have the sample period of the first one. Returns its damage.
    pub fn take(&mut self, pass: Pass) -> Result<Vec<Damage>> {
        let mut signal = Vec::new();
        let lost = pass.bursts(|burst| {
            let (n, period_s) = (burst.samples_per_channel as usize, burst.sample_period_s);
            self.first_period_s.get_or_insert(period_s);
            pass.control.signals.fetch_add(u64::from(burst.channels), Ordering::Relaxed);
            signal.resize(n, 0.0);
            for row in 0..burst.channels as usize {
                let beside = burst.beside(row);
                if !visit::is_healthy(self.labels, burst, beside.channel) {
                    continue;
                }
                let (most, whole) = (self.most_samples, self.whole_bursts);
                let held = self
                    .sampler
                    .get_or_insert_with(|| PeriodSignals::new(period_s, n, most, whole));
                if !same_period(held.period_s, period_s) {
                    self.other_sampling += 1;
                    continue;
                }
                burst.copy_signal(row, &mut signal);
                if unusable_signal(&signal, rails_of(&signal, self.rails)).is_some() {
                    self.rejected += 1;
                    continue;
                }
                let kept = &signal[..n.min(held.most_samples)];
                held.sampler.offer(&burst.printhead, beside, kept);
                self.longest = self.longest.max(n);
            }
        })?;
        self.rejected += lost.unusable_bursts;
        Ok(lost.all_damage(pass.recording))
    }

    /// Hands out what was collected. `None`: no burst was seen. Counts are complete only after this call.
    pub fn finish(&mut self) -> Option<Observations> {
        let none = self.first_period_s.map(|period_s| Sampler::new(period_s, 0));
        let sampler = self.sampler.take().map(|held| held.sampler).or(none)?;
        // signals that are shorter than the common length are dropped at the end
        let held = sampler.len();
        let data = sampler.finish();
        self.other_sampling += (held - data.len()) as u64;
        self.is_cut = self.longest > data.samples;
        Some(data)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::Control;
    use inkling_core::burst::{Format, Layout};
    use inkling_core::labels::{Channels, Label};
    use inkling_io::memory_recording::of_bursts;
    use inkling_io::recording::Recording;

    /// A recording of two bursts of one channel and 8 samples each, the second one of half the
    /// sample period; and labels by which the first one is of this state (`None`: of no known one)
    /// and the second one healthy.
    fn of_two_periods(first: Option<&str>) -> (Recording, Labels) {
        let burst = |t_acq_ns: i64, period_s: f64| {
            let signal: Vec<f32> = (0..8u8).map(f32::from).collect();
            let burst = Burst::of(&[signal], period_s, Format::S16Le, Layout::ChannelMajor);
            Burst { t_acq_ns, ..burst }
        };
        let recording = of_bursts("memory", &[burst(1_000, 1e-6), burst(2_000, 5e-7)]).unwrap();
        let row = |from_ns: i64, state: &str| Label {
            printhead: "p".into(),
            channel: Channels::All,
            from_ns: Some(from_ns),
            to_ns: Some(from_ns + 500),
            state: state.into(),
            severity: None,
        };
        let rows = first.map(|state| row(1_000, state)).into_iter().chain([row(2_000, HEALTHY)]);
        (recording, Labels::new(rows.collect()))
    }

    #[test]
    fn signals_that_labels_leave_out_do_not_decide_the_sampling() {
        for (first, counted) in [(Some(IGNORE), IGNORE), (None, "unlabelled")] {
            let (recording, labels) = of_two_periods(first);
            let control = Control::default();
            let pass = Pass { recording: &recording, control: &control };

            let mut collector = Collector::new(Some(&labels), INT16_RAILS);
            collector.take(pass).unwrap();
            assert_eq!(control.signals.load(Ordering::Relaxed), 2, "all that are read are counted");
            let set = collector.finish().unwrap();
            assert_eq!((set.sample_period_s, set.healthy["p"].len()), (5e-7, 1));
            let signals = [(counted.to_owned(), 1), (HEALTHY.to_owned(), 1)];
            assert_eq!(set.signals, signals.into(), "none counts as of another sampling");

            let mut observer = Observer::new(Some(&labels), INT16_RAILS, 64);
            observer.take(pass).unwrap();
            let data = observer.finish().unwrap();
            assert_eq!((data.len(), data.dt_s, observer.other_sampling), (1, 5e-7, 0));
        }
    }

    #[test]
    fn where_the_labels_leave_all_out_bursts_were_met_all_the_same() {
        let (recording, labels) = (of_two_periods(None).0, Labels::new(Vec::new()));
        let control = Control::default();
        let pass = Pass { recording: &recording, control: &control };
        let mut collector = Collector::new(Some(&labels), INT16_RAILS);
        collector.take(pass).unwrap();
        assert!(collector.finish().is_some_and(|set| set.healthy.is_empty()));
        let mut observer = Observer::new(Some(&labels), INT16_RAILS, 64);
        observer.take(pass).unwrap();
        assert!(observer.finish().is_some_and(|data| data.is_empty()));
    }

    #[test]
    fn rails_of_16_bit_bind_16_bit_alone_and_told_ones_bind_all() {
        let usable = |peak: f64, rails| {
            let clipped = |k: i32| (2.0 * peak * f64::cos(0.3 * f64::from(k))).clamp(-peak, peak);
            let signal: Vec<f64> = (0..64).map(clipped).collect();
            unusable_signal(&signal, rails_of(&signal, rails)).is_none()
        };
        assert!(!usable(32_767.0, INT16_RAILS), "it stays at the rail");
        assert!(usable(1e6, INT16_RAILS), "no converter of 16 bit gave that");
        assert!(!usable(2048.0, [-2048.0, 2048.0]) && !usable(1e6, [-2048.0, 2048.0]));
    }
}
