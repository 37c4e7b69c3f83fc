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
use nalgebra::Vector4;
use std::collections::BTreeMap;

pub(super) struct AtOneTemperature {
    /// What a kelvin does to the features of a ring.
    pub per_k: Vector4<f64>,
    /// At the model's temperature, counts.
    pub signals: SignalSet,
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
        let per_k = within_channels(known).unwrap_or_else(|| self.features_per_k(&fitter));

        let temperature_c = vec![self.temperature_c.unwrap_or(f64::NAN); set.len()];
        let mut signals = SignalSet { temperature_c, ..set.clone() };
        let (beside, mut own) = (self.beside_per_k(&fitter), vec![0.0; set.samples]);
        let ring = |at: Vector4<f64>| fitter.tangent(&Features::from(at)).column(0).into_owned();
        for (i, y) in signals.data.chunks_exact_mut(set.samples).enumerate() {
            self.less_warmth((set, i), &beside, &mut own);
            let by = warmer(i) * per_k;
            let here = rings[i].unwrap_or(by);
            let (from, to) = (ring(here), ring(here - by));
            for (k, y) in y.iter_mut().enumerate() {
                *y = (self.offset + set.drive[i] * (own[k] + to[k] - from[k])) as f32;
            }
        }
        Ok(AtOneTemperature { per_k, signals })
    }

    /// The same model, but a kelvin does this to the features of its ring.
    pub(super) fn with_per_k(self, per_k: Vector4<f64>) -> Result<HealthyModel> {
        let fitter = self.fitter()?;
        let of_ring = fitter.tangent(&Features::HEALTHY) * per_k;
        let beside = self.beside_per_k(&fitter);
        let response = beside.iter().zip(&of_ring).map(|(beside, ring)| beside + ring).collect();
        Ok(HealthyModel { temperature_response: Some(response), ..self })
    }
}

/// The slope of features over temperature, per K, from each channel's own differences alone: channels lie apart by more
/// than a kelvin moves them, and not all of them are labelled healthy at all temperatures. Each element is a channel, K
/// above the model's temperature, and four features. `None`: no channel has two temperatures.
fn within_channels(rings: impl Iterator<Item = (u32, f64, Vector4<f64>)>) -> Option<Vector4<f64>> {
    let mut channels: BTreeMap<u32, Vec<(f64, Vector4<f64>)>> = BTreeMap::new();
    rings.for_each(|(channel, warmer, x)| channels.entry(channel).or_default().push((warmer, x)));
    let (mut together, mut square) = (Vector4::zeros(), 0.0);
    for of in channels.values() {
        let n = of.len() as f64;
        let mean_k = of.iter().map(|(warmer, _)| warmer).sum::<f64>() / n;
        let mean = of.iter().map(|(_, x)| x).sum::<Vector4<f64>>() / n;
        for (warmer, x) in of {
            together += (warmer - mean_k) * (x - mean);
            square += (warmer - mean_k).powi(2);
        }
    }
    (square > 0.0).then(|| together / square)
}
