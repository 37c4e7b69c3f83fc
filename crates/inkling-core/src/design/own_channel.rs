//! What is needed to judge a signal against its own channel's level: where the features of the
//! channel's signals lie while it is healthy.
//!
//! In, from `pipeline/head.rs`, sweep by sweep: the levels of one printhead's channels, as followed
//! by [`crate::state`], and the design's fault curves. Out: [`OwnChannels`], which the filter stage
//! judges by and the isolate stage names by.
//!
//! Covariance and curves depend on the number of looks behind a level (a look is one observed signal
//! of the channel). They cost time, so they are computed for a few numbers of looks only (`LEVELS`),
//! once per printhead in an [`OwnBasis`].

use super::tuned;
use crate::isolate::physics_density::FaultCurves;
use crate::model::normal::chi_squared_3;
use crate::state::{Head, OwnLevel};
use nalgebra::{Matrix4, Vector4};
use std::sync::Arc;

/// Numbers of looks behind a level for which covariance and fault curves are computed (somewhat
/// arbitrary). With fewer than 4 a channel is known by its printhead's level alone.
const LEVELS: [f64; 4] = [0.0, 4.0, 16.0, 48.0];

/// What a printhead's channels have in common; made anew only when its state has changed much.
#[derive(Debug, Default)]
pub struct OwnBasis {
    /// Covariance of a healthy signal's four features about its channel's level, besides the
    /// signal's own noise, for each of [`LEVELS`].
    scatter: [Matrix4<f64>; LEVELS.len()],
    /// Fault curves for each of [`LEVELS`] but the first; empty where the design has no physics.
    curves: Vec<Arc<FaultCurves>>,
    /// Share of the variance between healthy signals, noise apart, that lies between channels and
    /// lasts, 0 to 1; the rest is drawn anew for each drop.
    lasting: f64,
    /// Quantile of chi-squared with three degrees of freedom: the threshold if scatter is Gaussian.
    gate: f64,
    /// Whether the channels lie so much farther apart than in training that the design's threshold
    /// does not hold for channels of which nothing else is known.
    is_aged: bool,
}

impl OwnBasis {
    /// For signals at a temperature `apart` K from that at which the channels were learned. `curves`: the design's;
    /// `false_alarm_rate`: share of healthy signals that may be flagged.
    pub fn new(
        state: &Head,
        apart: f64,
        curves: Option<&FaultCurves>,
        false_alarm_rate: f64,
    ) -> OwnBasis {
        // the scatter from drop to drop within a channel widens the curves of one channel
        let shot = state.shot();
        let of_looks = |curves: &FaultCurves| {
            let one = |&looks: &f64| Some(Arc::new(curves.of_one_channel(&shot, looks)?));
            LEVELS[1..].iter().filter_map(one).collect()
        };
        OwnBasis {
            scatter: LEVELS.map(|looks| state.scatter(looks, apart)),
            curves: curves.map_or(Vec::new(), of_looks),
            lasting: state.lasting_share(),
            gate: chi_squared_3(false_alarm_rate),
            is_aged: state.wider() > tuned::AGED,
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

#[derive(Clone, Copy, Debug, Default)]
pub struct OwnBaseline {
    /// ln amplitude, ln damping, ln frequency, phase, relative to the judge's ring.
    pub baseline: Vector4<f64>,
    pub behind: Behind,
    /// The squared distance over its bound, at least 1, while the channel is taken for faulty
    /// because its level drifted or lies apart from all others'; else 0.
    pub off: f64,
    /// Where its signals lie while it is faulty, if that is known.
    pub fault: Option<Vector4<f64>>,
}

/// The index in `LEVELS` of the largest number of looks that a level reaches.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Behind(usize);

impl Behind {
    fn of(looks: f64) -> Behind {
        Behind(LEVELS.iter().rposition(|&n| looks >= n).unwrap_or(0))
    }
}

#[derive(Clone, Debug)]
pub struct OwnReference {
    pub baseline: Vector4<f64>,
    /// `None`: the design has no physics, or fewer than 4 looks are behind the baseline.
    pub curves: Option<Arc<FaultCurves>>,
}

impl OwnChannels {
    /// `channels`: their levels relative to the printhead's, by ascending channel number; `from`:
    /// the printhead's level, in features relative to the judge's ring. A channel with fewer than 4
    /// looks gets no baseline, since judging it against all channels says as much; in an aged
    /// printhead it gets one, since the design's threshold does not hold there.
    pub fn new(
        basis: Arc<OwnBasis>,
        channels: Vec<OwnLevel>,
        from: Vector4<f64>,
        mut frozen: Vec<u32>,
    ) -> OwnChannels {
        let baseline = |OwnLevel { looks, at, off, fault, .. }| OwnBaseline {
            baseline: at + from,
            behind: Behind::of(looks),
            off,
            fault: fault.map(|at| at + from),
        };
        let baselines = channels.into_iter().map(|of| (of.channel, baseline(of)));
        let is_known = |of: &OwnBaseline| of.off > 0.0 || of.behind != Behind(0);
        let is_aged = basis.is_aged;
        let baselines = baselines.filter(|(_, of)| is_aged || is_known(of));
        frozen.sort_unstable();
        OwnChannels { basis, channels: baselines.collect(), frozen }
    }

    /// A sweep in which no channel's level is known, and only frozen channels are to be rejected.
    pub fn of_frozen(frozen: Vec<u32>) -> OwnChannels {
        OwnChannels::new(Arc::default(), Vec::new(), Vector4::zeros(), frozen)
    }

    /// Index of a channel's baseline; `Err`: where it would be inserted.
    fn place(&self, channel: u32) -> Result<usize, usize> {
        self.channels.binary_search_by_key(&channel, |(k, _)| *k)
    }

    /// Whether nothing has to be judged again.
    pub fn is_empty(&self) -> bool {
        self.channels.is_empty() && self.frozen.is_empty()
    }

    pub fn is_aged(&self) -> bool {
        self.basis.is_aged
    }

    pub fn is_frozen(&self, channel: u32) -> bool {
        !self.frozen.is_empty() && self.frozen.binary_search(&channel).is_ok()
    }

    /// The baselines of `n` consecutive channels from number `first` on.
    pub fn from(&self, first: u32, n: usize) -> impl Iterator<Item = Option<&OwnBaseline>> {
        let at = self.place(first).unwrap_or_else(|next| next);
        let mut baselines = self.channels[at..].iter().peekable();
        (u64::from(first)..).take(n).map(move |channel| {
            baselines.next_if(|(k, _)| u64::from(*k) == channel).map(|(_, own)| own)
        })
    }

    /// `None`: the channel has no baseline of its own.
    pub fn of(&self, channel: u32) -> Option<OwnReference> {
        let (_, OwnBaseline { baseline, behind, .. }) = self.channels[self.place(channel).ok()?];
        // the curves begin with the second of `LEVELS`
        let curves = behind.0.checked_sub(1).and_then(|k| self.basis.curves.get(k));
        Some(OwnReference { baseline, curves: curves.cloned() })
    }

    /// Threshold on the squared distance of a signal from its channel's level: `of_all` + l max(g -
    /// `of_all`, 0), with `of_all` the model's threshold on the squared distance from what all
    /// channels are expected to be, g the chi-squared quantile and l the lasting share. Where
    /// channels differ for good (l = 1), a signal scatters about its own level by noise, whose tail
    /// is Gaussian. Where the difference is drawn anew for each drop (l = 0), signals have the tail
    /// that `of_all` was learned from. Between the two: heuristic.
    pub fn gate(&self, of_all: f64) -> f64 {
        of_all + self.basis.lasting * (self.basis.gate - of_all).max(0.0)
    }

    /// Whether a metric made for one of the two sweeps serves the other.
    pub fn scatters_as(&self, other: &OwnChannels) -> bool {
        Arc::ptr_eq(&self.basis, &other.basis)
    }

    pub fn scatter(&self, behind: Behind) -> &Matrix4<f64> {
        &self.basis.scatter[behind.0]
    }
}
