//! Judges signals about their own channels' levels, in the filter stage.
//!
//! In: batches with their statistics. Out: the statistics of the signals whose
//! channel's level is known, replaced.

use super::batches::AssignedBatch;
use super::statistics::Statistics;
use inkling_core::burst::{Acquisition, Burst};
use inkling_core::design::{Behind, Detection, Judge, JudgeKey, OwnChannels};
use inkling_core::verdict::Reason;
use nalgebra::{Matrix3, Vector4};
use std::sync::Arc;

/// The buffers of one worker.
#[derive(Default)]
pub struct OwnLevels {
    features: Vec<Vector4<f64>>,
    /// The metric of the signal before.
    metric: Option<Metric>,
}

impl OwnLevels {
    /// Judges again every signal of a batch whose channel's own level is known, and
    /// rejects those of frozen channels.
    pub fn judge(
        &mut self,
        batch: &AssignedBatch,
        statistics: &mut Statistics,
        statistic: &mut [Result<Detection, Reason>],
    ) {
        for (rows, acquisition, of) in batch.placed() {
            if let (Acquisition::Usable(burst), Ok(judge), Some(own)) =
                (acquisition, &of.judge, &of.own)
            {
                self.judge_burst(own, burst, judge, statistics, &mut statistic[rows]);
            }
        }
    }

    /// Judges again the signals of a burst.
    fn judge_burst(
        &mut self,
        own: &Arc<OwnChannels>,
        burst: &Burst,
        judge: &Judge,
        statistics: &mut Statistics,
        statistic: &mut [Result<Detection, Reason>],
    ) {
        let Some(detector) = judge.detector() else { return };
        if own.is_empty() {
            return;
        }

        statistics.features(judge, burst, &mut self.features);
        let drive = judge.drive(burst);
        let known = own.from(burst.first_channel, statistic.len());
        for (row, (found, known)) in statistic.iter_mut().zip(known).enumerate() {
            if own.is_frozen(burst.first_channel.saturating_add(row as u32)) {
                *found = found.and(Err(Reason::Frozen));
            }
            let (Ok(of_all), Some(known)) = (*found, known) else { continue };

            let features = &self.features[row];
            let metric = Metric::of(&mut self.metric, judge, own, known.behind, drive);
            // the closed form decides near the level; beyond, a fit does, if there is one
            let distance =
                metric.and_then(|metric| match detector.own_look(metric, features, known) {
                    (distance, true) => Some(distance),
                    (distance, false) => statistics
                        .own_distance((judge, burst, row), metric, (features, known))
                        .or(Some(distance)),
                });
            // without a distance the statistic is infinite, which is rejected below
            let ring =
                distance.map_or(f64::INFINITY, |distance| judge.of_own(distance, own, known));
            *found = match ring.is_finite() {
                true => Ok(Detection { ring, ..of_all }),
                false => Err(Reason::NonFinite),
            };
        }
    }
}

/// The metric of distances from own levels, as it was for the signal before: most signals have the same one.
struct Metric {
    judge: JudgeKey,
    own: Arc<OwnChannels>,
    behind: Behind,
    drive: f64,
    /// Inverse covariance; `None`: the covariance is singular.
    metric: Option<Matrix3<f64>>,
}

impl Metric {
    /// The metric for levels that are known as well as `behind` says, and for signals of one drive; it is
    /// computed anew only if something differs from `last`.
    fn of<'a>(
        last: &'a mut Option<Metric>,
        judge: &Judge,
        own: &Arc<OwnChannels>,
        behind: Behind,
        drive: f64,
    ) -> Option<&'a Matrix3<f64>> {
        // the metric depends on these four alone
        let is_it = |of: &&mut Metric| {
            (of.judge, of.behind, of.drive) == (judge.key(), behind, drive)
                && of.own.scatters_as(own)
        };
        if last.as_mut().filter(is_it).is_none() {
            let metric = judge.detector().and_then(|by| by.own_metric(own, behind, drive));
            *last = Some(Metric { judge: judge.key(), own: own.clone(), behind, drive, metric });
        }
        last.as_ref()?.metric.as_ref()
    }
}
