//! Collects labelled signals from recordings, for training and identification. What is collected is bounded,
//! and does not depend on the order of the signals.

use super::{Control, PipelineError, visit};
use inkling_core::burst::Burst;
use inkling_core::design::{TrainingSet, same_period};
use inkling_core::fault::{HEALTHY, IGNORE};
use inkling_core::identify::reservoir::Reservoir;
use inkling_core::labels::{Labels, Met, Span};
use inkling_core::verdict::unusable_signal;
use inkling_io::damage::Damage;
use inkling_io::recording::Recording;
use std::collections::BTreeMap;

/// Maximum number of signals kept per printhead: of healthy ones, and of each faulty label.
const MOST_HEALTHY: usize = 32_768;
const MOST_FAULTY: usize = 8_192;
/// Maximum number of sets, one for each printhead and label.
const MOST_SETS: usize = 512;

/// The time and channels of a burst.
fn span_of(burst: &Burst) -> Span {
    let first_channel = burst.first_channel;
    let last_channel = first_channel.saturating_add(burst.channels.saturating_sub(1));
    Span { from_ns: burst.t_acq_ns, to_ns: burst.t_acq_ns, first_channel, last_channel }
}

/// Collects the signals of recordings by printhead and label.
#[derive(Default)]
pub struct Collector<'a> {
    /// `None`: every signal counts as healthy.
    labels: Option<&'a Labels>,
    rails: [f64; 2],
    /// Sample period, s, and samples of the first burst; signals of another sampling are not collected.
    sampling: Option<(f64, usize)>,
    /// The samples of signals, by (label, printhead).
    sets: BTreeMap<(String, String), Reservoir>,
    /// Number of signals seen, by label; of those that were not collected, by the reason.
    signals: BTreeMap<String, u64>,
    /// The printheads, times and channels that were seen, which labels may cover.
    pub met: Met,
}

impl<'a> Collector<'a> {
    pub fn new(labels: Option<&'a Labels>, rails: [f64; 2]) -> Collector<'a> {
        Collector { labels, rails, ..Collector::default() }
    }

    /// Takes the signals of a recording that have the first burst's sampling. Returns what was damaged or is
    /// missing. An unusable burst counts as one rejected signal.
    pub fn take(
        &mut self,
        recording: &Recording,
        control: &Control,
    ) -> Result<Vec<Damage>, PipelineError> {
        let mut signal = Vec::new();
        let lost = visit::all(recording, control, |burst| {
            self.met.see(&burst.printhead, span_of(burst));
            let n = burst.samples_per_channel as usize;
            // the first burst decides the sampling
            let (period, samples) = *self.sampling.get_or_insert((burst.sample_period_s, n));
            if samples != n || !same_period(period, burst.sample_period_s) {
                self.count("other_sampling", u64::from(burst.channels));
                return;
            }
            signal.resize(n, 0.0);
            for row in 0..burst.channels {
                let beside = burst.beside(row as usize);
                // what the labels say of this signal; without labels it is healthy
                let known = match self.labels {
                    None => Some((HEALTHY, None)),
                    Some(labels) => labels
                        .row_at(&burst.printhead, beside.channel, burst.t_acq_ns)
                        .map(|label| (label.state.as_str(), label.severity)),
                };

                let Some((state, severity)) = known else {
                    self.count("unlabelled", 1);
                    continue;
                };
                if state == IGNORE {
                    self.count(IGNORE, 1);
                    continue;
                }
                burst.copy_signal(row as usize, &mut signal);
                if unusable_signal(&signal, self.rails).is_some() {
                    self.count("rejected", 1);
                    continue;
                }
                self.count(state, 1);

                let key = (state.to_owned(), burst.printhead.to_string());
                if !self.sets.contains_key(&key) && self.sets.len() >= MOST_SETS {
                    self.count("beyond_the_limit_of_sets", 1);
                    continue;
                }
                let most = if state == HEALTHY { MOST_HEALTHY } else { MOST_FAULTY };
                let reservoir = self.sets.entry(key).or_insert_with(|| Reservoir::new(n, most));
                reservoir.offer(beside, &signal, severity.unwrap_or(f64::NAN));
            }
        })?;
        if lost.unusable_bursts > 0 {
            self.count("rejected", lost.unusable_bursts);
        }
        Ok(lost.all_damage(recording))
    }

    /// Counts signals under a label.
    fn count(&mut self, label: &str, n: u64) {
        match self.signals.get_mut(label) {
            Some(count) => *count += n,
            None => drop(self.signals.insert(label.into(), n)),
        }
    }

    /// What was collected, with drives relative to the mean voltage of the healthy
    /// signals. `None`: no burst was seen.
    pub fn finish(self) -> Option<TrainingSet> {
        let (sample_period_s, samples) = self.sampling?;

        let (sum, n) = self
            .sets
            .iter()
            .filter(|((state, _), _)| state == HEALTHY)
            .map(|(_, reservoir)| reservoir.voltage_sum())
            .fold((0.0, 0), |(sum, n), (s, m)| (sum + s, n + m));
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
