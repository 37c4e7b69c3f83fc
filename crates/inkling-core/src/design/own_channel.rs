//! Judging a signal against its own channel's level.
//!
//! In: where channels of one printhead are by themselves ([`crate::state`]), the design's fault curves. Out: per channel
//! its expected healthy features and the fault curves relative to them.

use super::tuned;
use crate::isolate::physics_density::FaultCurves;
use crate::model::normal::upper_tail;
use crate::state::{Head, OwnLevel};
use nalgebra::{Matrix4, Vector4};
use std::sync::Arc;

/// Numbers of looks behind a level for which fault curves are computed; a channel uses those of the largest
/// number that it reaches. With the first nothing but its head's level is known of it.
const LEVELS: [f64; 4] = [0.0, 4.0, 16.0, 48.0];

/// What all channels of one printhead are judged by.
#[derive(Debug, Default)]
pub struct OwnBasis {
    /// Covariance of a healthy signal's four features about its channel's level, besides the signal's own noise, for
    /// each of [`LEVELS`].
    scatter: [Matrix4<f64>; LEVELS.len()],
    /// Fault curves for each of [`LEVELS`] but the first.
    curves: Vec<Arc<FaultCurves>>,
    /// Share of what healthy signals differ by that is their channels' own for good.
    lasting: f64,
    /// Threshold on the squared distance of what scatters by noise alone.
    gate: f64,
    /// Its channels lie so far from each other that the design's threshold does not hold for those of which
    /// nothing else is known.
    is_aged: bool,
}

impl OwnBasis {
    /// `false_alarm_rate`: share of healthy signals that may be flagged.
    pub fn new(state: &Head, curves: Option<&FaultCurves>, false_alarm_rate: f64) -> OwnBasis {
        let shot = state.shot();
        let of = |curves: &FaultCurves| {
            let of = |&n: &f64| Some(Arc::new(curves.of_one_channel(&shot, n)?));
            LEVELS[1..].iter().filter_map(of).collect()
        };
        OwnBasis {
            scatter: LEVELS.map(|looks| state.scatter(looks)),
            curves: curves.map_or(Vec::new(), of),
            lasting: state.lasting_share(),
            gate: chi_squared_3(false_alarm_rate),
            is_aged: state.wider() > tuned::aged(),
        }
    }
}

/// Levels of one printhead's channels in a sweep, ready to judge by.
#[derive(Debug)]
pub struct OwnChannels {
    basis: Arc<OwnBasis>,
    /// By channel, ascending.
    channels: Vec<(u32, OwnBaseline)>,
    /// Those that give the same bits again and again, ascending.
    frozen: Vec<u32>,
}

/// A channel's own healthy features, which its signals are judged against.
#[derive(Clone, Copy, Debug, Default)]
pub struct OwnBaseline {
    pub baseline: Vector4<f64>,
    /// How many looks it rests on.
    pub behind: Behind,
    /// How far beyond the bound the channel's level lies from there; 0: it is there.
    pub off: f64,
}

/// The place in `LEVELS` of the largest number of looks that a level rests on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Behind(usize);

impl Behind {
    fn of(looks: f64) -> Behind {
        Behind(LEVELS.iter().rposition(|&n| looks >= n).unwrap_or(0))
    }
}

/// A channel's own healthy features, and the fault curves about them, by which its signals are isolated.
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
        let baselines = channels.into_iter().map(|OwnLevel { channel, looks, at, off }| {
            (channel, OwnBaseline { baseline: at + from, behind: Behind::of(looks), off })
        });
        let (any, all) = (basis.lasting >= tuned::least_lasting(), basis.is_aged);
        let baselines =
            baselines.filter(|(_, of)| any && (all || of.off > 0.0 || of.behind != Behind(0)));
        frozen.sort_unstable();
        OwnChannels { basis, channels: baselines.collect(), frozen }
    }

    /// Of channels of whose levels nothing is known.
    pub fn of_frozen(frozen: Vec<u32>) -> OwnChannels {
        OwnChannels::new(Arc::default(), Vec::new(), Vector4::zeros(), frozen)
    }

    fn place(&self, channel: u32) -> Result<usize, usize> {
        self.channels.binary_search_by_key(&channel, |(k, _)| *k)
    }

    pub fn is_empty(&self) -> bool {
        self.channels.is_empty() && self.frozen.is_empty()
    }

    /// What all channels are expected to be holds no more: they lie too far from each other.
    pub fn is_aged(&self) -> bool {
        self.basis.is_aged
    }

    pub fn is_frozen(&self, channel: u32) -> bool {
        !self.frozen.is_empty() && self.frozen.binary_search(&channel).is_ok()
    }

    /// The baselines of `n` channels from `first` on, one after the other; `None`: the channel has none of its own.
    pub fn from(&self, first: u32, n: usize) -> impl Iterator<Item = Option<&OwnBaseline>> {
        let at = self.place(first).unwrap_or_else(|next| next);
        let mut baselines = self.channels[at..].iter().peekable();
        (u64::from(first)..).take(n).map(move |channel| {
            baselines.next_if(|(k, _)| u64::from(*k) == channel).map(|(_, own)| own)
        })
    }

    /// The baseline and the fault curves that a channel's signals are isolated by.
    pub fn of(&self, channel: u32) -> Option<Own> {
        let (_, OwnBaseline { baseline, behind, .. }) = self.channels[self.place(channel).ok()?];
        let curves = behind.0.checked_sub(1).and_then(|k| self.basis.curves.get(k));
        Some(Own { baseline, curves: curves.cloned() })
    }

    /// Threshold on the squared distance from a level, at the allowed false-alarm rate. `of_all`: that on the distance of
    /// signals from what all channels are expected to be.
    ///
    /// One channel's signals scatter by noise, whose tail is Gaussian, and never lighter than that of all channels together;
    /// what is drawn anew for each drop has the tail that `of_all` was learned from.
    pub fn gate(&self, of_all: f64) -> f64 {
        of_all + self.basis.lasting * (self.basis.gate - of_all).max(0.0)
    }

    /// Whether the same covariance holds for both.
    pub fn scatters_as(&self, other: &OwnChannels) -> bool {
        Arc::ptr_eq(&self.basis, &other.basis)
    }

    /// Covariance of a healthy signal's four features about its level, besides the signal's own noise: from
    /// burst to burst, and the sampling error of the level.
    pub fn scatter(&self, behind: Behind) -> &Matrix4<f64> {
        &self.basis.scatter[behind.0]
    }
}

/// Upper quantile of chi-squared with three degrees of freedom.
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
