//! Signals of many temperatures, as labels give them, brought to one.
//!
//! In, from `learn`: a model that knows about what a kelvin does, and signals in counts with the temperatures at which
//! they were recorded. Out: what a kelvin does to the features of a ring, and the same signals as they would be at the
//! model's temperature.
//!
//! A straight line, added to every signal, would do for a few kelvin alone: 10 K move a resonance by a hundredth, and
//! after seven periods the signal by a fourteenth of one. What the line misses would count as the scatter of healthy
//! channels, in which faults hide. So the ring of each signal is fitted where it is, and replaced by the ring that it
//! would be: ln damping and ln frequency move by so much a kelvin, as [`super::moved_model`] moves judges.

use super::{HealthyModel, Result};
use crate::identify::SignalSet;
use crate::model::ring_fit::{Features, Fit, FitBuffers, RingFitter};
use crate::state::at_least_as_wide;
use nalgebra::{Matrix4, Vector4};
use std::collections::BTreeMap;

pub(super) struct AtOneTemperature {
    pub warmth: Warmth,
    /// At the model's temperature, counts.
    pub signals: SignalSet,
}

/// What a kelvin does to the features of rings.
pub(super) struct Warmth {
    per_k: Vector4<f64>,
    /// The covariance of that over channels; `None`: not known.
    differs: Option<Matrix4<f64>>,
}

impl HealthyModel {
    /// What a kelvin changes of a signal beside its ring, N, counts; empty: nothing is known.
    pub(super) fn beside_per_k(&self, fitter: &RingFitter) -> Vec<f64> {
        let of_ring = fitter.tangent(&Features::HEALTHY) * self.features_per_k(fitter);
        let response = self.temperature_response.iter().flatten();
        response.zip(&of_ring).map(|(all, of_ring)| all - of_ring).collect()
    }

    /// Writes signal `i` of a set per unit drive, N, counts, less `slope`, N, counts, for each K by which it is warmer than
    /// the model; an empty one takes nothing off.
    pub(super) fn less_warmth(&self, (set, i): (&SignalSet, usize), slope: &[f64], y: &mut [f64]) {
        let at = set.signal(i).iter().map(|v| (f64::from(*v) - self.offset) / set.drive[i]);
        y.iter_mut().zip(at).for_each(|(y, v)| *y = v);
        let warmer = self.warmer(set.temperature_c[i]);
        y.iter_mut().zip(slope).for_each(|(y, slope)| *y -= warmer * slope);
    }

    /// Calls `see` with the index of each of the `chosen` signals of a set, the signal per unit drive, N, counts, and the
    /// ring that was fitted to it (the phase free), both at its own temperature, less what that changes beside rings.
    /// `near`: the ring to start from at the model's temperature; `None`: the coarse search.
    pub(super) fn each_own_ring(
        &self,
        (fitter, near): (&RingFitter, Option<Features>),
        (set, chosen): (&SignalSet, &[usize]),
        mut see: impl FnMut(usize, &[f64], Option<Fit>),
    ) {
        let (per_k, beside) = (self.features_per_k(fitter), self.beside_per_k(fitter));
        let start = |i: &usize| {
            let warmer = self.warmer(set.temperature_c[*i]);
            near.map(|near| Features::from(near.coordinates() + warmer * per_k))
        };
        let starts: Vec<Option<Features>> = chosen.iter().map(start).collect();
        let copy = |k: usize, y: &mut [f64]| self.less_warmth((set, chosen[k]), &beside, y);
        let fits = fitter.fit_all(true, &mut FitBuffers::default(), &starts, copy);
        let mut y = vec![0.0; set.samples];
        for (&i, fit) in chosen.iter().zip(fits) {
            self.less_warmth((set, i), &beside, &mut y);
            see(i, &y, fit);
        }
    }

    /// A signal that no ring fits moves as the healthy ring does.
    pub(super) fn at_one_temperature(&self, set: &SignalSet) -> Result<AtOneTemperature> {
        let (fitter, all) = (self.fitter()?, (0..set.len()).collect::<Vec<_>>());
        let mut rings: Vec<Option<Vector4<f64>>> = vec![None; set.len()];
        let start = (&fitter, Some(Features::HEALTHY));
        self.each_own_ring(start, (set, &all), |i, _, fit| {
            rings[i] = fit.map(|fit| fit.features.coordinates());
        });
        let warmer = |i: usize| self.warmer(set.temperature_c[i]);
        let known = (0..set.len()).filter_map(|i| Some((set.channel[i], warmer(i), rings[i]?)));
        let of_model = || Warmth { per_k: self.features_per_k(&fitter), differs: None };
        let warmth = within_channels(known).unwrap_or_else(of_model);

        let temperature_c = vec![self.temperature_c.unwrap_or(f64::NAN); set.len()];
        let mut signals = SignalSet { temperature_c, ..set.clone() };
        let (beside, mut own) = (self.beside_per_k(&fitter), vec![0.0; set.samples]);
        let ring = |at: Vector4<f64>| fitter.tangent(&Features::from(at)).column(0).into_owned();
        for (i, y) in signals.data.chunks_exact_mut(set.samples).enumerate() {
            self.less_warmth((set, i), &beside, &mut own);
            let by = warmer(i) * warmth.per_k;
            let here = rings[i].unwrap_or(by);
            let (from, to) = (ring(here), ring(here - by));
            for (k, y) in y.iter_mut().enumerate() {
                *y = (self.offset + set.drive[i] * (own[k] + to[k] - from[k])) as f32;
            }
        }
        Ok(AtOneTemperature { warmth, signals })
    }

    /// The same model, but a kelvin does this to the features of its ring.
    pub(super) fn with(self, warmth: Warmth) -> Result<HealthyModel> {
        let fitter = self.fitter()?;
        let of_ring = fitter.tangent(&Features::HEALTHY) * warmth.per_k;
        let beside = self.beside_per_k(&fitter);
        let response = beside.iter().zip(&of_ring).map(|(beside, ring)| beside + ring).collect();
        let channels_per_k = warmth.differs.map(Into::into);
        Ok(HealthyModel { temperature_response: Some(response), channels_per_k, ..self })
    }
}

/// The slope of features over temperature, per K, from each channel's own differences alone: channels lie apart by more
/// than a kelvin moves them, and not all of them are labelled healthy at all temperatures. Each element is a channel, K
/// above the model's temperature, and four features. `None`: no channel has two temperatures.
///
/// Channel c has the slope b_c with weight s_c = sum (K - mean K)², and rings scatter about the channels' lines with
/// covariance V. Then sum s_c (b_c - b)(b_c - b)' is (C - 1) V + D (S - sum s_c² / S) on average, with S = sum s_c, the slope b
/// of all C channels, and the covariance D of the slopes, which it is solved for (DerSimonian and Laird 1986).
fn within_channels(rings: impl Iterator<Item = (u32, f64, Vector4<f64>)>) -> Option<Warmth> {
    struct Slope {
        weight: f64,
        per_k: Vector4<f64>,
    }
    let mut channels: BTreeMap<u32, Vec<(f64, Vector4<f64>)>> = BTreeMap::new();
    rings.for_each(|(channel, warmer, x)| channels.entry(channel).or_default().push((warmer, x)));
    let (mut slopes, mut rest, mut freedom) = (Vec::new(), Matrix4::zeros(), 0.0);
    for of in channels.values() {
        let n = of.len() as f64;
        let mean_k = of.iter().map(|(warmer, _)| warmer).sum::<f64>() / n;
        let mean = of.iter().map(|(_, x)| x).sum::<Vector4<f64>>() / n;
        let weight: f64 = of.iter().map(|(warmer, _)| (warmer - mean_k).powi(2)).sum();
        if weight <= 0.0 {
            continue;
        }
        let products = of.iter().map(|(warmer, x)| (warmer - mean_k) * (x - mean));
        let per_k = products.sum::<Vector4<f64>>() / weight;
        let off = of.iter().map(|(warmer, x)| x - mean - (warmer - mean_k) * per_k);
        rest += off.map(|off| off * off.transpose()).sum::<Matrix4<f64>>();
        freedom += n - 2.0;
        slopes.push(Slope { weight, per_k });
    }

    let all: f64 = slopes.iter().map(|of| of.weight).sum();
    let per_k = slopes.iter().map(|of| of.weight * of.per_k).sum::<Vector4<f64>>() / all;
    let squares: f64 = slopes.iter().map(|of| of.weight.powi(2)).sum();
    let apart = slopes.iter().map(|of| (of.weight, of.per_k - per_k));
    let apart: Matrix4<f64> = apart.map(|(weight, off)| off * off.transpose() * weight).sum();
    let by_chance = rest / f64::max(freedom, 1.0) * (slopes.len() as f64 - 1.0);
    // one channel does not tell how channels differ, and two looks at each do not tell how they scatter
    let is_known = slopes.len() > 1 && freedom > 0.0;
    let differs =
        is_known.then(|| at_least_as_wide(0.0, &((apart - by_chance) / (all - squares / all))));
    (all > 0.0).then_some(Warmth { per_k, differs })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    #[test]
    fn slopes_and_how_channels_differ_in_them_are_found_beside_their_levels_and_scatter() {
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        for differs in [0.0, 0.002] {
            let mut rings = Vec::new();
            for channel in 0..200 {
                let (level, slope) = (0.05 * normal(), -0.02 + differs * normal());
                // not all are labelled at all temperatures
                for k in (channel % 7)..12 {
                    let warmer = 1.3 * f64::from(k) - 8.0;
                    let x = level + slope * warmer + 0.003 * normal();
                    rings.push((channel, warmer, Vector4::repeat(x)));
                }
            }
            let found = within_channels(rings.into_iter()).unwrap();
            assert!((found.per_k[1] + 0.02).abs() < 4.0 * (differs + 2e-4) / 200f64.sqrt());
            let sd = found.differs.unwrap()[(1, 1)].sqrt();
            assert!((sd - differs).abs() < 1e-4 + 0.15 * differs, "{sd} for {differs}");
        }
        let alone = (0..5).map(|channel| (channel, 1.0, Vector4::zeros()));
        assert!(within_channels(alone).is_none(), "each at one temperature");
    }
}
