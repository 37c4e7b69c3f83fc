//! Judging a signal against its own channel's level.
//!
//! In: where channels of one printhead are by themselves ([`crate::state`]), the design's fault curves. Out: per channel
//! its expected healthy features and the fault curves relative to them.

use crate::isolate::physics_density::FaultCurves;
use crate::model::normal::upper_tail;
use nalgebra::{Matrix4, Vector4};
use std::sync::Arc;

/// Numbers of looks behind a level for which fault curves are computed; a channel uses those of the largest
/// number that it reaches.
const LEVELS: [f64; 3] = [4.0, 16.0, 48.0];

/// What all channels of one printhead are judged by.
#[derive(Debug, Default)]
pub struct OwnBasis {
    /// Covariance of one channel's signals beyond the noise.
    shot: Matrix4<f64>,
    /// Fault curves for each of [`LEVELS`].
    curves: Vec<Arc<FaultCurves>>,
    gate: f64,
}

impl OwnBasis {
    /// `false_alarm_rate`: share of healthy signals that may be flagged.
    pub fn new(
        shot: Matrix4<f64>,
        curves: Option<&FaultCurves>,
        false_alarm_rate: f64,
    ) -> OwnBasis {
        let of = |curves: &FaultCurves| {
            let of = |&n: &f64| Some(Arc::new(curves.of_one_channel(&shot, n)?));
            LEVELS.iter().filter_map(of).collect()
        };
        let curves = curves.map_or(Vec::new(), of);
        OwnBasis { shot, curves, gate: chi_squared_3(false_alarm_rate) }
    }
}

/// Levels of one printhead's channels in a sweep, ready to judge by.
#[derive(Debug)]
pub struct OwnChannels {
    basis: Arc<OwnBasis>,
    /// By channel, ascending.
    channels: Vec<(u32, Known)>,
    /// Those that give the same bits again and again, ascending.
    frozen: Vec<u32>,
}

/// Where a channel is by itself.
#[derive(Clone, Copy, Debug)]
pub struct OwnLevel {
    pub channel: u32,
    /// Looks behind it.
    pub looks: f64,
    /// Its offset from the printhead's.
    pub at: Vector4<f64>,
}

/// One channel's level.
#[derive(Clone, Copy, Debug)]
pub struct Known {
    pub baseline: Vector4<f64>,
    /// Behind it.
    pub signals: f64,
}

/// One channel's level, and what its signals are isolated by about it.
#[derive(Clone, Debug)]
pub struct Own {
    pub baseline: Vector4<f64>,
    /// `None`: the design has no physics.
    pub curves: Option<Arc<FaultCurves>>,
}

impl OwnChannels {
    /// `channels`, ascending; `from`: the printhead's level.
    pub fn new(
        basis: Arc<OwnBasis>,
        channels: Vec<OwnLevel>,
        from: Vector4<f64>,
        mut frozen: Vec<u32>,
    ) -> OwnChannels {
        let known = channels.into_iter().filter(|of| of.looks >= LEVELS[0]);
        let known = known.map(|OwnLevel { channel, looks, at }| {
            (channel, Known { baseline: at + from, signals: looks })
        });
        frozen.sort_unstable();
        OwnChannels { basis, channels: known.collect(), frozen }
    }

    fn place(&self, channel: u32) -> Result<usize, usize> {
        self.channels.binary_search_by_key(&channel, |(k, _)| *k)
    }

    pub fn is_empty(&self) -> bool {
        self.channels.is_empty() && self.frozen.is_empty()
    }

    pub fn is_frozen(&self, channel: u32) -> bool {
        !self.frozen.is_empty() && self.frozen.binary_search(&channel).is_ok()
    }

    /// The levels of `n` channels from `first` on, one after the other.
    pub fn from(&self, first: u32, n: usize) -> impl Iterator<Item = Option<&Known>> {
        let at = self.place(first).unwrap_or_else(|next| next);
        let mut known = self.channels[at..].iter().peekable();
        (u64::from(first)..).take(n).map(move |channel| {
            known.next_if(|(k, _)| u64::from(*k) == channel).map(|(_, known)| known)
        })
    }

    /// What a channel's signals are isolated by.
    pub fn of(&self, channel: u32) -> Option<Own> {
        let (_, Known { baseline, signals }) = self.channels[self.place(channel).ok()?];
        let level = LEVELS.iter().rposition(|&n| signals >= n).unwrap_or(0);
        Some(Own { baseline, curves: self.basis.curves.get(level).cloned() })
    }

    /// Threshold on the squared distance from a level, at the allowed false-alarm rate.
    pub fn gate(&self) -> f64 {
        self.basis.gate
    }

    /// Whether the same covariance holds for both.
    pub fn scatters_as(&self, other: &OwnChannels) -> bool {
        Arc::ptr_eq(&self.basis, &other.basis)
    }

    /// Covariance of a healthy signal's four features about its level, besides the signal's own noise: from
    /// burst to burst, and the sampling error of the level. `noise`: of one signal at the reference drive.
    pub fn scatter(&self, signals: f64, noise: &Matrix4<f64>) -> Matrix4<f64> {
        self.basis.shot + (self.basis.shot + noise) / signals
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
