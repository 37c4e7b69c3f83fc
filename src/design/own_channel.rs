//! Judging a signal against its own channel's baseline.
//!
//! In: baselines of one printhead, the design's fault curves. Out: per channel its expected healthy features and
//! the fault curves relative to them.

use super::baseline::{FEWEST, PrintheadBaselines};
use crate::isolate::physics_density::FaultCurves;
use crate::model::normal::upper_tail;
use nalgebra::{Matrix4, Vector4};
use std::collections::HashMap;
use std::sync::Arc;

/// Numbers of signals behind a baseline for which fault curves are computed; a channel uses those of the largest
/// number that it reaches.
const LEVELS: [f64; 3] = [4.0, 16.0, 48.0];

/// Baselines of one printhead, ready to judge by.
#[derive(Debug)]
pub struct OwnChannels {
    /// Covariance of one channel's signals beyond the noise.
    shot: Matrix4<f64>,
    /// Per channel its baseline, the number of signals behind it, and the time from which on it applies, ns.
    channels: HashMap<u32, (Vector4<f64>, f64, i64)>,
    /// Fault curves for each of [`LEVELS`].
    curves: Vec<Arc<FaultCurves>>,
    gate: f64,
}

/// One channel's baseline, and what signals are judged by about it.
#[derive(Clone, Debug)]
pub struct Own {
    pub baseline: Vector4<f64>,
    pub signals: f64,
    /// Threshold on the squared distance from the baseline, at the allowed false-alarm rate.
    pub gate: f64,
    shot: Matrix4<f64>,
    /// `None`: the design has no physics.
    pub curves: Option<Arc<FaultCurves>>,
}

impl OwnChannels {
    /// `from_ns`: the time from which on a channel's baseline applies. `false_alarm_rate`: share of healthy signals
    /// that may be flagged.
    pub fn new(
        baselines: &PrintheadBaselines,
        from_ns: impl Fn(u32) -> i64,
        curves: Option<&FaultCurves>,
        false_alarm_rate: f64,
    ) -> OwnChannels {
        let shot = Matrix4::from_fn(|i, j| baselines.shot[i][j]);
        let curves = curves.map_or(Vec::new(), |curves| {
            LEVELS
                .iter()
                .filter_map(|&n| Some(Arc::new(curves.of_one_channel(&shot, n)?)))
                .collect()
        });
        let channels = baselines
            .channels
            .iter()
            .filter(|(_, c)| c.signals >= f64::from(FEWEST) / 2.0)
            .map(|(&k, c)| (k, (Vector4::from(c.features), c.signals, from_ns(k))))
            .collect();
        OwnChannels { shot, channels, curves, gate: chi_squared_3(false_alarm_rate) }
    }

    /// Number of channels with a baseline.
    pub fn channels(&self) -> usize {
        self.channels.len()
    }

    /// Whether a channel's baseline applies at that time.
    pub fn knows(&self, channel: u32, t_ns: i64) -> bool {
        self.channels.get(&channel).is_some_and(|&(.., from_ns)| t_ns >= from_ns)
    }

    /// A channel's baseline, if one applies at that time.
    pub fn of(&self, channel: u32, t_ns: i64) -> Option<Own> {
        let &(baseline, signals, from_ns) = self.channels.get(&channel)?;
        if t_ns < from_ns {
            return None;
        }
        let level = LEVELS.iter().rposition(|&n| signals >= n).unwrap_or(0);
        let curves = self.curves.get(level).cloned();
        Some(Own { baseline, signals, gate: self.gate, shot: self.shot, curves })
    }
}

/// Upper quantile of chi-squared with three degrees of freedom. One channel's signals scatter by noise, whose tail is
/// Gaussian; the model's threshold was learned from channels that differ within bounds, whose tail is lighter.
fn chi_squared_3(rate: f64) -> f64 {
    let beyond = |x: f64| {
        2.0 * upper_tail(x.sqrt()) + (2.0 * x / std::f64::consts::PI).sqrt() * (-x / 2.0).exp()
    };
    let (mut low, mut high) = (0.0, 200.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if beyond(middle) > rate { low = middle } else { high = middle }
    }
    high
}

impl Own {
    /// Covariance of a healthy signal's four features about the baseline, besides the signal's own noise: from
    /// burst to burst, and the sampling error of the baseline. `noise`: of one signal at the reference drive.
    pub fn scatter(&self, noise: &Matrix4<f64>) -> Matrix4<f64> {
        self.shot + (self.shot + noise) / self.signals
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chi_squared_agrees_with_tables() {
        for (rate, x) in [(0.05, 7.815), (0.01, 11.345), (0.001, 16.266)] {
            assert!((chi_squared_3(rate) / x - 1.0).abs() < 1e-4, "{rate}");
        }
    }
}
