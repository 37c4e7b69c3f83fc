//! A signal against its own channel's baseline.
//!
//! In: baselines of one printhead, the design's curves. Out: per channel its expected healthy features
//! and the curves seen from there.

use super::baseline::{FEWEST, PrintheadBaselines};
use super::detector::SensitivityDetector;
use crate::isolate::physics_density::FaultCurves;
use nalgebra::{Matrix4, Vector4};
use std::collections::HashMap;
use std::sync::Arc;

/// Signals from which the next better known curves apply.
const LEVELS: [f64; 3] = [4.0, 16.0, 48.0];

/// Baselines of one printhead, ready to judge by.
#[derive(Debug)]
pub struct OwnChannels {
    /// Covariance of one channel's signals beyond the noise.
    shot: Matrix4<f64>,
    /// Per channel: baseline, signals, from when on.
    channels: HashMap<u32, (Vector4<f64>, f64, i64)>,
    /// The fault curves of a channel known by so many signals.
    curves: Vec<Arc<FaultCurves>>,
}

/// One channel's.
#[derive(Clone, Debug)]
pub struct Own {
    pub baseline: Vector4<f64>,
    pub signals: f64,
    shot: Matrix4<f64>,
    /// `None`: the design has no physics.
    pub curves: Option<Arc<FaultCurves>>,
}

impl OwnChannels {
    /// `from_ns`: of the channels that were not known before the recording.
    pub fn new(
        baselines: &PrintheadBaselines,
        from_ns: impl Fn(u32) -> i64,
        curves: Option<&FaultCurves>,
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
        OwnChannels { shot, channels, curves }
    }

    /// Channels that are known.
    pub fn channels(&self) -> usize {
        self.channels.len()
    }

    /// A channel's baseline, if it is known by then.
    pub fn of(&self, channel: u32, t_ns: i64) -> Option<Own> {
        let &(baseline, signals, from_ns) = self.channels.get(&channel)?;
        if t_ns < from_ns {
            return None;
        }
        let level = LEVELS.iter().rposition(|&n| signals >= n).unwrap_or(0);
        let curves = self.curves.get(level).cloned();
        Some(Own { baseline, signals, shot: self.shot, curves })
    }
}

impl Own {
    /// Covariance of a healthy signal's four features about the baseline, its noise apart: shots, and
    /// what the baseline itself is not known by. `noise`: of one signal at the reference drive.
    pub fn scatter(&self, noise: &Matrix4<f64>) -> Matrix4<f64> {
        self.shot + (self.shot + noise) / self.signals
    }
}

impl SensitivityDetector {
    /// (ln amplitude, ln damping, ln frequency, phase) to first order; the phase free.
    pub fn own_features(&self, deviation: &[f64], drive: f64) -> Vector4<f64> {
        Vector4::from_fn(|k, _| {
            self.own.projection[k].iter().zip(deviation).map(|(p, d)| p * d).sum::<f64>() / drive
        })
    }

    /// Covariance of the noise of these, at the reference drive.
    pub fn own_noise(&self) -> &Matrix4<f64> {
        &self.own.noise
    }
}
