//! The level of each healthy channel of a printhead: where the features of its signals lie relative
//! to the mean of the printhead's channels, as far as the difference lasts.
//!
//! In, from `train`: a printhead's labelled healthy signals. Out: [`ChannelLevels`], by which
//! `train` moves faults that were labelled on a few channels to where they would be on others: else
//! the density of their class would be as narrow as these few.
//!
//! Feature by feature, with m_c the mean of the n_c signals of channel c, m the mean of all m_c, w
//! the variance of signals within channels and b that of channels: level_c = (m_c - m) b / (b + w /
//! n_c), the best linear predictor in a one-way analysis of variance with random effects.

use super::{HealthyModel, Result};
use crate::identify::SignalSet;
use nalgebra::Vector4;
use std::collections::BTreeMap;

/// Fewer channels than this do not tell how channels differ.
const FEWEST: usize = 5;

/// Features (ln amplitude, ln damping, ln frequency, phase), by ascending channel number.
#[derive(Debug)]
pub(super) struct ChannelLevels(Vec<(u32, Vector4<f64>)>);

impl ChannelLevels {
    /// At most so many signals of a channel are used, the first ones.
    pub const MOST: usize = 64;

    /// `None`: fewer than `FEWEST` channels have two healthy signals that a ring fits.
    pub fn learn(model: &HealthyModel, healthy: &SignalSet) -> Result<Option<ChannelLevels>> {
        let mut seen: BTreeMap<u32, usize> = BTreeMap::new();
        let mut is_early = |i: &usize| {
            let seen = seen.entry(healthy.channel[*i]).or_default();
            *seen += 1;
            *seen <= ChannelLevels::MOST
        };
        let few: Vec<usize> = (0..healthy.len()).filter(|i| is_early(i)).collect();
        let few = healthy.select(&few);

        let mut channels: BTreeMap<u32, Vec<Vector4<f64>>> = BTreeMap::new();
        for (i, x) in model.fitted(&few)? {
            channels.entry(few.channel[i]).or_default().push(x);
        }
        channels.retain(|_, looks| looks.len() >= 2);
        if channels.len() < FEWEST {
            return Ok(None);
        }
        Ok(Some(ChannelLevels::of(&channels)))
    }

    /// The levels from the features of each channel's signals, at least two per channel.
    fn of(channels: &BTreeMap<u32, Vec<Vector4<f64>>>) -> ChannelLevels {
        let mean = |of: &[Vector4<f64>]| of.iter().sum::<Vector4<f64>>() / of.len() as f64;
        let scatter = |of: &[Vector4<f64>]| {
            let at = mean(of);
            of.iter().map(|x| (x - at).map(|v| v * v)).sum::<Vector4<f64>>()
        };
        let looks = channels.values().map(Vec::len).sum::<usize>();

        // w
        let of_signals = channels.values().map(|of| scatter(of)).sum::<Vector4<f64>>()
            / (looks - channels.len()) as f64;

        // b: the variance of the means, less the part that the scatter of single signals gives by
        // chance, w times the mean over channels of 1 / signals; at least 0
        let means: Vec<Vector4<f64>> = channels.values().map(|of| mean(of)).collect();
        let middle = mean(&means);
        let by_chance =
            channels.values().map(|of| 1.0 / of.len() as f64).sum::<f64>() / channels.len() as f64;
        let of_channels = (scatter(&means) / (means.len() - 1) as f64 - of_signals * by_chance)
            .map(|v| v.max(0.0));

        // `reliability`: of a channel's mean, b / (b + w / n_c)
        let level = |(mean, looks): (&Vector4<f64>, &Vec<Vector4<f64>>)| {
            let noise = of_signals / looks.len() as f64;
            let reliability =
                of_channels.zip_map(&(of_channels + noise), |v, all| v / all.max(1e-300));
            (mean - middle).component_mul(&reliability)
        };
        let levels = means.iter().zip(channels.values()).map(level);
        ChannelLevels(channels.keys().copied().zip(levels).collect())
    }

    /// The level of a channel. `None`: the channel had fewer than two healthy signals with a ring.
    pub fn at(&self, channel: u32) -> Option<Vector4<f64>> {
        let found = self.0.binary_search_by_key(&channel, |(c, _)| *c);
        found.ok().map(|at| self.0[at].1)
    }

    /// Features `x` of a channel's signal number `i`, moved from the channel's level to that of
    /// another channel that depends on `i`. Signals of a channel without a level stay as they are.
    pub fn elsewhere(&self, channel: u32, i: usize, x: &Vector4<f64>) -> Vector4<f64> {
        // Consecutive signals go to channels far apart. The step is a prime, so all channels are
        // reached; if their number is a multiple of it, the next round begins one channel later.
        const STRIDE: usize = 101;
        let n = self.0.len();
        let round = if n.is_multiple_of(STRIDE) { i / (n / STRIDE) } else { 0 };
        let (_, other) = self.0[(i * STRIDE + round) % n];
        self.at(channel).map_or(*x, |own| x - own + other)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::normal::draws;

    #[test]
    fn as_many_signals_as_channels_reach_every_channel_once() {
        for n in [2_u32, 40, 101, 202, 309, 10_403] {
            let level = |k: u32| (k, Vector4::repeat(f64::from(k)));
            let levels = ChannelLevels((0..n).map(level).collect());
            let mut reached: Vec<u32> = (0..n as usize)
                .map(|i| levels.elsewhere(0, i, &Vector4::zeros())[0] as u32)
                .collect();
            reached.sort_unstable();
            assert_eq!(reached, (0..n).collect::<Vec<u32>>(), "{n} channels");
        }
    }

    /// 40 channels of 20 signals each. `differ`: standard deviation of the channels' levels;
    /// `scatter`: of signals about them.
    fn channels(differ: f64, scatter: f64) -> BTreeMap<u32, Vec<Vector4<f64>>> {
        let mut normal = draws(3);
        let mut signals = |c: u32| {
            let at = Vector4::from_fn(|_, _| differ * normal());
            (c, (0..20).map(|_| at + Vector4::from_fn(|_, _| scatter * normal())).collect())
        };
        (0..40).map(&mut signals).collect()
    }

    #[test]
    fn what_lasts_is_moved_and_what_does_not_stays() {
        let spread = |levels: &ChannelLevels| {
            let moved = |i: usize| levels.elsewhere(3, i, &Vector4::zeros())[2];
            let all: Vec<f64> = (0..400).map(moved).collect();
            let mean = all.iter().sum::<f64>() / 400.0;
            (all.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / 400.0).sqrt()
        };
        let lasting = spread(&ChannelLevels::of(&channels(0.01, 0.005)));
        assert!((0.007..0.013).contains(&lasting), "{lasting}");
        let none = spread(&ChannelLevels::of(&channels(0.0, 0.005)));
        assert!(none < 0.0005, "{none}");
    }

    #[test]
    fn a_channels_level_is_where_its_signals_lie() {
        let channels = channels(0.01, 0.005);
        let levels = ChannelLevels::of(&channels);
        let mean = |of: &[Vector4<f64>]| of.iter().sum::<Vector4<f64>>() / of.len() as f64;
        let middle = channels.values().map(|of| mean(of)).sum::<Vector4<f64>>() / 40.0;
        for (channel, signals) in &channels {
            let off = mean(signals) - middle - levels.at(*channel).unwrap();
            // a level is shrunk by what noise alone may make of the mean of 20 signals
            assert!(off.amax() < 0.002, "{channel}: {off}");
        }
        assert_eq!(levels.at(99), None);
    }
}
