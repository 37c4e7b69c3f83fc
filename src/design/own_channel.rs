//! Judging a signal against its own channel's baseline.
//!
//! In: baselines of one printhead, the design's fault curves. Out: per channel its expected healthy features and
//! the fault curves relative to them.

use super::baseline::{FEWEST, PrintheadBaselines};
use crate::isolate::physics_density::FaultCurves;
use crate::model::normal::upper_tail;
use nalgebra::{Matrix4, Vector4};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Numbers of signals behind a baseline for which fault curves are computed; a channel uses those of the largest
/// number that it reaches.
const LEVELS: [f64; 3] = [4.0, 16.0, 48.0];

/// Baselines of one printhead, ready to judge by.
#[derive(Debug)]
pub struct OwnChannels {
    /// Covariance of one channel's signals beyond the noise.
    shot: Matrix4<f64>,
    channels: BTreeMap<u32, Known>,
    /// Fault curves for each of [`LEVELS`].
    curves: Vec<Arc<FaultCurves>>,
    gate: f64,
}

/// One channel's baseline.
#[derive(Clone, Copy, Debug)]
pub struct Known {
    pub baseline: Vector4<f64>,
    /// Behind it.
    pub signals: f64,
}

/// One channel's baseline, and what its signals are isolated by about it.
#[derive(Clone, Debug)]
pub struct Own {
    pub baseline: Vector4<f64>,
    /// `None`: the design has no physics.
    pub curves: Option<Arc<FaultCurves>>,
}

impl OwnChannels {
    /// `false_alarm_rate`: share of healthy signals that may be flagged.
    pub fn new(
        baselines: &PrintheadBaselines,
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
            .map(|(&k, c)| (k, Known { baseline: c.features.into(), signals: c.signals }))
            .collect();
        OwnChannels { shot, channels, curves, gate: chi_squared_3(false_alarm_rate) }
    }

    /// Number of channels with a baseline.
    pub fn channels(&self) -> usize {
        self.channels.len()
    }

    pub fn knows(&self, channel: u32) -> bool {
        self.channels.contains_key(&channel)
    }

    /// The baselines of `n` channels from `first` on, one after the other.
    pub fn from(&self, first: u32, n: usize) -> impl Iterator<Item = Option<&Known>> {
        let mut known = self.channels.range(first..).peekable();
        (u64::from(first)..).take(n).map(move |channel| {
            known.next_if(|(k, _)| u64::from(**k) == channel).map(|(_, known)| known)
        })
    }

    /// What a channel's signals are isolated by.
    pub fn of(&self, channel: u32) -> Option<Own> {
        let &Known { baseline, signals } = self.channels.get(&channel)?;
        let level = LEVELS.iter().rposition(|&n| signals >= n).unwrap_or(0);
        Some(Own { baseline, curves: self.curves.get(level).cloned() })
    }

    /// Threshold on the squared distance from a baseline, at the allowed false-alarm rate.
    pub fn gate(&self) -> f64 {
        self.gate
    }

    /// Covariance of a healthy signal's four features about its baseline, besides the signal's own noise: from
    /// burst to burst, and the sampling error of the baseline. `noise`: of one signal at the reference drive.
    pub fn scatter(&self, signals: f64, noise: &Matrix4<f64>) -> Matrix4<f64> {
        self.shot + (self.shot + noise) / signals
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
