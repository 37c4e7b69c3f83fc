//! Healthy signals out of recordings, with what was recorded beside them, for the critique; bounded.

use super::{Control, PipelineError, visit};
use crate::critique::observations::{Observations, Sampler};
use crate::design::same_period;
use crate::fault::HEALTHY;
use crate::io::damage::Damage;
use crate::io::recording::Recording;
use crate::labels::Labels;
use crate::verdict::unusable_signal;
use std::sync::atomic::Ordering;

/// Bytes of signals that are held, and signals at most: a critique needs no more.
const HELD_BYTES: usize = 64 << 20;
const MOST_SIGNALS: usize = 8192;
/// Work per signal grows with the square of its samples: of signals longer than these fewer are held.
const USUAL_SAMPLES: usize = 128;
const FEWEST_SIGNALS: usize = 512;

/// Collects what a critique looks at.
pub struct Observer<'a> {
    /// `None`: every signal may be healthy.
    labels: Option<&'a Labels>,
    rails: [f64; 2],
    sampler: Option<(f64, usize, Sampler)>,
    most_samples: usize,
    pub rejected: u64,
    pub not_healthy: u64,
    pub other_sampling: u64,
}

impl<'a> Observer<'a> {
    /// Of longer signals the first `most_samples` are taken.
    pub fn new(labels: Option<&'a Labels>, rails: [f64; 2], most_samples: usize) -> Observer<'a> {
        Observer {
            labels,
            rails,
            sampler: None,
            most_samples,
            rejected: 0,
            not_healthy: 0,
            other_sampling: 0,
        }
    }

    /// Takes the signals of a recording that fit the first burst's sampling; says what was lost.
    pub fn take(
        &mut self,
        recording: &Recording,
        control: &Control,
    ) -> Result<Vec<Damage>, PipelineError> {
        let mut signal = Vec::new();
        let mut lost = visit::all(recording, control, |burst| {
            let n = burst.samples_per_channel as usize;
            let (period, samples, sampler) = self.sampler.get_or_insert_with(|| {
                let kept = n.min(self.most_samples);
                let wanted = MOST_SIGNALS * USUAL_SAMPLES.pow(2) / kept.max(1).pow(2);
                let wanted = wanted.clamp(FEWEST_SIGNALS, MOST_SIGNALS);
                let capacity = wanted.min(HELD_BYTES / (4 * kept.max(1)));
                (burst.sample_period_s, n, Sampler::new(burst.sample_period_s, kept, capacity))
            });
            control.signals.fetch_add(u64::from(burst.channels), Ordering::Relaxed);
            if *samples != n || !same_period(*period, burst.sample_period_s) {
                self.other_sampling += u64::from(burst.channels);
                return;
            }
            signal.resize(n, 0.0);
            for row in 0..burst.channels as usize {
                let beside = burst.beside(row);
                if let Some(labels) = self.labels {
                    let label = labels.at(&burst.printhead, beside.channel, beside.t_acq_ns);
                    if label.is_none_or(|l| l.state != HEALTHY) {
                        self.not_healthy += 1;
                        continue;
                    }
                }
                burst.copy_signal(row, &mut signal);
                if unusable_signal(&signal, self.rails).is_some() {
                    self.rejected += 1;
                    continue;
                }
                let kept = &signal[..n.min(self.most_samples)];
                sampler.offer(&burst.printhead, beside, kept);
            }
        })?;
        self.rejected += lost.unusable_bursts;
        lost.damage.extend(recording.damage.iter().cloned());
        lost.damage.extend(recording.missing(lost.bursts));
        Ok(lost.damage)
    }

    /// Whether the signals are longer than what was taken of them.
    pub fn is_cut(&self) -> bool {
        self.sampler.as_ref().is_some_and(|(_, samples, _)| *samples > self.most_samples)
    }

    /// `None`: no burst was seen.
    pub fn finish(self) -> Option<Observations> {
        Some(self.sampler?.2.finish())
    }
}
