//! The tap at the writer: rows in the recording's order become evidence over time.

use super::PipelineError;
use super::baseline::InUse;
use super::batches::Judged;
use super::job::{Replay, Watch};
use crate::design::{Design, Judge};
use crate::episodes::{Counts, Episode, Looks, Named, RingChange, Tracker};
use crate::io::episode_table::EpisodeWriter;
use crate::io::verdict_table::TimestampUnit;
use crate::isolate::IsolateMethod;
use crate::verdict::{Reason, VerdictColumns};
use std::path::Path;

/// Episodes that are kept for the terminal.
const MOST_LISTED: usize = 1 << 14;

/// Follows the rows of one recording.
pub struct EpisodeTap<'a> {
    baselines: Option<&'a InUse>,
    tracker: Tracker,
    /// Where somebody watches: its own tracker, since the table's waits for bursts that come late.
    watched: Option<(&'a Watch<'a>, Tracker)>,
    table: EpisodeWriter,
    /// By their numbers; `None`: not met yet.
    models: Vec<Option<Known>>,
    listed: Vec<Episode>,
}

/// What evidence asks of a model.
#[derive(Clone, Copy)]
struct Known {
    frequency_hz: f64,
    damping_per_s: f64,
    /// Its threshold over the median of healthy statistics.
    in_medians: f32,
}

/// What came out, for the report and the summary.
#[derive(Debug, Default)]
pub struct EpisodeReport {
    pub counts: Counts,
    /// The first of them.
    pub listed: Vec<Episode>,
}

/// What is to be finished together with the verdicts.
pub struct Finished {
    pub report: EpisodeReport,
    pub table: EpisodeWriter,
}

impl<'a> EpisodeTap<'a> {
    pub fn create(
        replay: &Replay,
        baselines: Option<&'a InUse>,
        watch: Option<&'a Watch<'a>>,
        path: &Path,
        unit: TimestampUnit,
    ) -> Result<EpisodeTap<'a>, PipelineError> {
        let settings = &replay.settings;
        let design = replay.design.as_ref();
        let classes = design.map(Design::fault_classes).unwrap_or_default();
        // weights of the other methods know no priors
        let priors = match settings.isolate.method {
            IsolateMethod::Posterior => settings.isolate.prior_weights(&replay.classes())?,
            _ => vec![1.0 / classes.len().max(1) as f64; classes.len()],
        };
        let certainty = settings.isolate.certainty;
        let tracker = || Tracker::new(&classes, &priors, certainty, &settings.episodes);
        Ok(EpisodeTap {
            baselines,
            tracker: tracker(),
            watched: watch.map(|watch| (watch, tracker().at_once())),
            table: EpisodeWriter::create(path, unit)?,
            models: Vec::new(),
            listed: Vec::new(),
        })
    }

    /// What is said of flagged signals is taken from it.
    pub fn add(&mut self, judged: &mut Judged) -> Result<(), PipelineError> {
        judged.judges.iter().for_each(|judge| self.meet(judge));
        let c = &judged.columns;
        let mut flagged = std::mem::take(&mut judged.flagged).into_iter().peekable();
        let mut from = 0;
        while from < c.len() {
            let to = (from + 1..c.len()).find(|&row| !follows(c, row)).unwrap_or(c.len());
            let ratio = |row: usize| match (c.statistic[row], c.threshold[row]) {
                (Some(statistic), Some(threshold)) if threshold > 0.0 => statistic / threshold,
                _ => f32::NAN,
            };
            let printhead = &c.printheads[c.printhead[from] as usize];
            let own = |baselines: &InUse| {
                (from..to)
                    .map(|row| baselines.knows(printhead, c.channel[row], c.acquired_at_ns[row]))
                    .collect()
            };
            // a burst has one; of rejected signals nothing is asked
            let model = c.model[from..to].iter().flatten().copied().next().unwrap_or_default();
            let known = |model: u16| self.models.get(usize::from(model)).copied().flatten();
            let mut looks = Looks {
                t_ns: c.acquired_at_ns[from],
                first_channel: c.channel[from],
                model,
                in_medians: known(model).map(|of| of.in_medians).unwrap_or_default(),
                ratios: (from..to).map(ratio).collect(),
                own: self.baselines.map(own).unwrap_or_default(),
                named: Vec::new(),
            };
            while let Some(flagged) = flagged.next_if(|f| (f.row as usize) < to) {
                let row = flagged.row as usize;
                let ring = flagged.ring.zip(c.model[row].and_then(known));
                let ring = ring.map(|([ln_damping, ln_frequency], healthy)| RingChange {
                    ln_frequency,
                    ln_damping,
                    healthy_frequency_hz: healthy.frequency_hz,
                    healthy_damping_per_s: healthy.damping_per_s,
                });
                looks.named.push(Named {
                    row: (row - from) as u32, // a batch is far smaller
                    weights: flagged.weights,
                    appearance: flagged.appearance,
                    fits_none: matches!(c.reason[row], Some(Reason::UnknownFault | Reason::NoRing)),
                    candidate: c.candidate[row],
                    severity: c.severity[row],
                    severity_sd: c.severity_sd[row],
                    ring,
                });
            }
            if let Some((watch, tracker)) = &mut self.watched {
                tracker.push(printhead, looks.clone());
                tracker.take_ended();
                tracker.take_raised().iter().for_each(|episode| (watch.raised)(episode));
            }
            self.tracker.push(printhead, looks);
            from = to;
        }
        self.take_ended()
    }

    fn meet(&mut self, judge: &Judge) {
        let number = usize::from(judge.index);
        if self.models.len() <= number {
            self.models.resize(number + 1, None);
        }
        let poles = judge.model.identification.poles;
        self.models[number].get_or_insert_with(|| Known {
            frequency_hz: poles.frequency_hz,
            damping_per_s: poles.damping_per_s,
            in_medians: judge.model.in_medians(),
        });
    }

    fn take_ended(&mut self) -> Result<(), PipelineError> {
        let ended = self.tracker.take_ended();
        if !ended.is_empty() {
            let room = MOST_LISTED.saturating_sub(self.listed.len());
            self.listed.extend(ended.iter().take(room).cloned());
            self.table.write(ended)?;
        }
        Ok(())
    }

    /// The recording is over: whatever is still on has no end.
    pub fn finish(self) -> Result<Finished, PipelineError> {
        let EpisodeTap { tracker, mut table, mut listed, .. } = self;
        let (last, counts) = tracker.finish();
        listed.extend(last.iter().take(MOST_LISTED.saturating_sub(listed.len())).cloned());
        table.write(last)?;
        listed.sort_by(|a, b| {
            (&a.printhead, a.began_at_ns, a.channel).cmp(&(&b.printhead, b.began_at_ns, b.channel))
        });
        Ok(Finished { report: EpisodeReport { counts, listed }, table })
    }
}

/// Whether a row is the next channel of the same burst as the row before it.
fn follows(c: &VerdictColumns, row: usize) -> bool {
    c.acquired_at_ns[row] == c.acquired_at_ns[row - 1]
        && c.printhead[row] == c.printhead[row - 1]
        && c.channel[row].checked_sub(1) == Some(c.channel[row - 1])
}
