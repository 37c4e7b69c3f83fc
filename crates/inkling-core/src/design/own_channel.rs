//! Judging a signal against its own channel's level: the place where the channel's features lie while it is
//! healthy.
//!
//! In: the levels of one printhead's channels, as followed by [`crate::state`], and the design's fault
//! curves. Out: per channel its expected healthy features, the covariance of its healthy signals about them,
//! and the fault curves relative to them.
//!
//! How well a level is known depends on the number of looks behind it, and so do the covariance and the
//! curves. They are computed for a few numbers of looks only (`LEVELS`).

use super::tuned;
use crate::isolate::physics_density::FaultCurves;
use crate::model::bisection::bisected;
use crate::model::normal::upper_tail;
use crate::state::{Head, OwnLevel};
use nalgebra::{Matrix4, Vector4};
use std::sync::Arc;

/// Numbers of looks behind a level for which covariance and fault curves are computed. A channel uses those
/// of the largest number that it reaches. A channel in the first place (fewer than 4 looks) is known by its
/// head's level only, so it gets no fault curves of its own.
const LEVELS: [f64; 4] = [0.0, 4.0, 16.0, 48.0];

/// What all channels of one printhead have in common when they are judged by their own levels. Several sweeps
/// may share one.
#[derive(Debug, Default)]
pub struct OwnBasis {
    /// Covariance of a healthy signal's four features about its channel's level, besides the signal's own
    /// noise, for each of [`LEVELS`].
    scatter: [Matrix4<f64>; LEVELS.len()],
    /// Fault curves for each of [`LEVELS`] but the first; empty where the design has no physics.
    curves: Vec<Arc<FaultCurves>>,
    /// Share of the variance between healthy signals that lies between channels and lasts, 0 to 1; the rest
    /// is drawn anew for each drop.
    lasting: f64,
    /// Threshold on the squared distance (chi-squared with three degrees of freedom) of a signal that
    /// scatters about its level by Gaussian noise alone.
    gate: f64,
    /// The channels lie so far from each other that the design's threshold, which was learned when they lay
    /// closer together, does not hold for channels of which nothing else is known.
    is_aged: bool,
}

impl OwnBasis {
    /// The basis of a printhead in this state. `curves`: those of the design, for a channel of which nothing
    /// is known; `false_alarm_rate`: share of healthy signals that may be flagged.
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

/// The levels of one printhead's channels in one sweep, ready to judge by.
#[derive(Debug)]
pub struct OwnChannels {
    basis: Arc<OwnBasis>,
    /// Baselines by channel number, ascending.
    channels: Vec<(u32, OwnBaseline)>,
    /// Channels that repeat the same bits again and again, ascending.
    frozen: Vec<u32>,
}

/// A channel's own healthy features, which its signals are judged against.
#[derive(Clone, Copy, Debug, Default)]
pub struct OwnBaseline {
    /// Expected healthy features: ln amplitude, ln damping, ln frequency, phase from the judge's ring.
    pub baseline: Vector4<f64>,
    /// How many looks the baseline rests on.
    pub behind: Behind,
    /// How far beyond its bound the channel's level lay from the baseline when it left it, relative to the
    /// bound; 0: the level still lies there.
    pub off: f64,
}

/// The index in `LEVELS` of the largest number of looks that a level reaches.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Behind(usize);

impl Behind {
    fn of(looks: f64) -> Behind {
        Behind(LEVELS.iter().rposition(|&n| looks >= n).unwrap_or(0))
    }
}

/// What a channel's signals are isolated by: its own healthy features, and the fault curves about them.
#[derive(Clone, Debug)]
pub struct Own {
    pub baseline: Vector4<f64>,
    /// `None`: the design has no physics, or fewer looks than the second of `LEVELS` are behind the baseline.
    pub curves: Option<Arc<FaultCurves>>,
}

impl OwnChannels {
    /// Makes the baselines of a sweep's channels. `channels`: their levels relative to the printhead's,
    /// ascending; `from`: the printhead's level in the features of the judge; `frozen`: channels that repeat
    /// themselves.
    ///
    /// A channel gets no baseline where judging it against all channels says as much: if hardly anything of
    /// what differs lasts, or if nothing is known of the channel itself. In an aged head every channel gets
    /// one, since the design's threshold does not hold there.
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

    /// A sweep in which no channel's level is known, and only frozen channels are to be rejected.
    pub fn of_frozen(frozen: Vec<u32>) -> OwnChannels {
        OwnChannels::new(Arc::default(), Vec::new(), Vector4::zeros(), frozen)
    }

    /// Index of a channel's baseline; `Err`: where it would have to be inserted.
    fn place(&self, channel: u32) -> Result<usize, usize> {
        self.channels.binary_search_by_key(&channel, |(k, _)| *k)
    }

    pub fn is_empty(&self) -> bool {
        self.channels.is_empty() && self.frozen.is_empty()
    }

    /// Whether the channels lie too far from each other for the design's threshold on the distance from all
    /// channels.
    pub fn is_aged(&self) -> bool {
        self.basis.is_aged
    }

    pub fn is_frozen(&self, channel: u32) -> bool {
        !self.frozen.is_empty() && self.frozen.binary_search(&channel).is_ok()
    }

    /// The baselines of `n` consecutive channels from number `first` on; `None` for a channel without its
    /// own.
    pub fn from(&self, first: u32, n: usize) -> impl Iterator<Item = Option<&OwnBaseline>> {
        // One binary search for the first channel, then both lists are walked in parallel.
        let at = self.place(first).unwrap_or_else(|next| next);
        let mut baselines = self.channels[at..].iter().peekable();
        (u64::from(first)..).take(n).map(move |channel| {
            baselines.next_if(|(k, _)| u64::from(*k) == channel).map(|(_, own)| own)
        })
    }

    /// The baseline and the fault curves that a channel's signals are isolated by.
    pub fn of(&self, channel: u32) -> Option<Own> {
        let (_, OwnBaseline { baseline, behind, .. }) = self.channels[self.place(channel).ok()?];
        // the curves begin with the second of `LEVELS`
        let curves = behind.0.checked_sub(1).and_then(|k| self.basis.curves.get(k));
        Some(Own { baseline, curves: curves.cloned() })
    }

    /// Threshold on the squared distance of a signal from its channel's level, at the allowed false-alarm
    /// rate. `of_all`: the threshold on the distance from what all channels are expected to be.
    ///
    /// Where channels differ for good, a signal scatters about its own level by noise, whose tail is
    /// Gaussian: the chi-squared quantile holds. Where the difference is drawn anew for each drop, signals
    /// have the tail that `of_all` was learned from. Between the two the threshold is interpolated by the
    /// lasting share, and it is never below `of_all`.
    pub fn gate(&self, of_all: f64) -> f64 {
        of_all + self.basis.lasting * (self.basis.gate - of_all).max(0.0)
    }

    /// Whether the same covariances hold for both, so that a metric made for one serves the other.
    pub fn scatters_as(&self, other: &OwnChannels) -> bool {
        Arc::ptr_eq(&self.basis, &other.basis)
    }

    /// Covariance of a healthy signal's four features about its level, besides the signal's own noise: the
    /// scatter from burst to burst, plus the sampling error of a level with so many looks behind it.
    pub fn scatter(&self, behind: Behind) -> &Matrix4<f64> {
        &self.basis.scatter[behind.0]
    }
}

/// Upper quantile of chi-squared with three degrees of freedom: the value that is exceeded at `rate`.
fn chi_squared_3(rate: f64) -> f64 {
    // the survival function in closed form, inverted by bisection
    let beyond = |x: f64| {
        2.0 * upper_tail(x.sqrt()) + (2.0 * x / std::f64::consts::PI).sqrt() * (-x / 2.0).exp()
    };
    let [_, high] = bisected(0.0, 200.0, 60, |x| beyond(x) > rate);
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
