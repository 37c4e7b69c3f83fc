//! Judges signals about their own channels' levels, in the filter stage, with `--baseline`. Without it no own
//! level is known, and only the signals of frozen channels are rejected here.
//!
//! In: batches with the statistics about the level that all channels have in common (`statistics`). Out: the
//! same, with other first statistics where the channel's own level is known.
//!
//! The new statistic is the squared distance x' M x of the signal's features (ln amplitude, ln damping, ln
//! frequency) from the channel's level. M is the inverse of the covariance of a healthy signal about that
//! level: the scatter from drop to drop, how well the level is known, and the noise at the signal's drive. The
//! distance is scaled to the model's threshold (`Judge::of_own`). Near the level the features in closed form
//! do; beyond, a ring is fitted.

use super::batches::{AssignedBatch, Detected};
use super::distances::Distances;
use inkling_core::burst::Acquisition;
use inkling_core::design::{Behind, Detection, JudgeKey, OwnChannels};
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
    /// `statistic`: one entry per signal of the batch. Signals of frozen channels are rejected.
    pub fn judge(
        &mut self,
        batch: &AssignedBatch,
        distances: &mut Distances,
        statistic: &mut [Detected],
    ) {
        for (rows, acquisition, of) in batch.placed() {
            let (Acquisition::Usable(burst), Ok(judge), Some(own)) =
                (acquisition, &of.judge, &of.own)
            else {
                continue;
            };
            let Some(detector) = judge.detector().filter(|_| !own.is_empty()) else { continue };
            let statistic = &mut statistic[rows];
            distances.features(judge, burst, &mut self.features);
            let drive = judge.drive(burst);
            let known = own.from(burst.first_channel, statistic.len());
            for (row, (found, known)) in statistic.iter_mut().zip(known).enumerate() {
                if own.is_frozen(burst.first_channel.saturating_add(row as u32)) {
                    *found = found.and(Err(Reason::Frozen));
                }
                let (Ok(of_all), Some(known)) = (*found, known) else { continue };

                let features = &self.features[row];
                let key = (judge.key(), known.behind, drive);
                if self.metric.as_ref().is_none_or(|of| of.key != key || !of.own.scatters_as(own)) {
                    let metric = detector.own_metric(own, known.behind, drive);
                    self.metric = Some(Metric { key, own: own.clone(), metric });
                }
                let metric = self.metric.as_ref().and_then(|of| of.metric.as_ref());
                let distance =
                    metric.and_then(|metric| match detector.own_look(metric, features, known) {
                        (distance, true) => Some(distance),
                        (distance, false) => distances
                            .own_distance((judge, burst, row), metric, (features, known))
                            .or(Some(distance)),
                    });

                // a channel that was cured is healthy at once, and not once its level has followed
                let is_over = known.off > 0.0
                    && metric.is_some_and(|metric| detector.is_over(metric, features, known));
                let off = if is_over { 0.0 } else { known.off };
                // without a metric there is no distance, and the signal is rejected
                let ring =
                    distance.map_or(f64::INFINITY, |distance| judge.of_own(distance, own, off));
                *found = match ring.is_finite() {
                    true => Ok(Detection { ring, ..of_all }),
                    false => Err(Reason::NonFinite),
                };
            }
        }
    }
}

/// The metric of distances from own levels, as it was for the signal before: most signals have the same one.
struct Metric {
    /// Judge, how many looks are behind the level, in a few steps, and drive: with `own`, all that it depends on.
    key: (JudgeKey, Behind, f64),
    own: Arc<OwnChannels>,
    /// Inverse covariance; `None`: the covariance is singular.
    metric: Option<Matrix3<f64>>,
}
