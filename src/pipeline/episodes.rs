//! The tap at the writer: rows in the recording's order become evidence over time.

use super::PipelineError;
use super::baseline::InUse;
use super::replay::Replay;
use super::schedule::Schedule;
use super::stages::Judged;
use crate::design::Design;
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
    table: EpisodeWriter,
    /// Per model: frequency, damping.
    healthy: Vec<[f64; 2]>,
    /// Per model: its threshold over the median of healthy statistics.
    in_medians: Vec<f32>,
    listed: Vec<Episode>,
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
        schedule: &Schedule,
        baselines: Option<&'a InUse>,
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
        let poles = schedule.judges.iter().map(|judge| judge.model.identification.poles);
        Ok(EpisodeTap {
            baselines,
            tracker: Tracker::new(
                &classes,
                &priors,
                settings.isolate.certainty,
                &settings.episodes,
            ),
            table: EpisodeWriter::create(path, unit)?,
            healthy: poles.map(|p| [p.frequency_hz, p.damping_per_s]).collect(),
            in_medians: schedule.judges.iter().map(|judge| judge.model.in_medians()).collect(),
            listed: Vec::new(),
        })
    }

    /// What is said of flagged signals is taken from it.
    pub fn add(&mut self, judged: &mut Judged) -> Result<(), PipelineError> {
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
            let known = |baselines: &InUse| {
                (from..to)
                    .map(|row| baselines.knows(printhead, c.channel[row], c.acquired_at_ns[row]))
                    .collect()
            };
            // a burst has one; of rejected signals nothing is asked
            let model = c.model[from..to].iter().flatten().copied().next().unwrap_or_default();
            let mut looks = Looks {
                t_ns: c.acquired_at_ns[from],
                first_channel: c.channel[from],
                model,
                in_medians: self.in_medians.get(usize::from(model)).copied().unwrap_or_default(),
                ratios: (from..to).map(ratio).collect(),
                own: self.baselines.map(known).unwrap_or_default(),
                named: Vec::new(),
            };
            while let Some(flagged) = flagged.next_if(|f| (f.row as usize) < to) {
                let row = flagged.row as usize;
                let healthy = c.model[row].and_then(|m| self.healthy.get(usize::from(m)));
                let ring = flagged.ring.zip(healthy);
                let ring = ring.map(|([ln_damping, ln_frequency], healthy)| RingChange {
                    ln_frequency,
                    ln_damping,
                    healthy_frequency_hz: healthy[0],
                    healthy_damping_per_s: healthy[1],
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
            self.tracker.push(printhead, looks);
            from = to;
        }
        self.take_ended()
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
