//! Channels that are labelled healthy and ring unlike the others of their printhead. Training takes them for what healthy
//! channels may do, so that no fault of their kind would ever be found.
//!
//! In: a design and the signals that it was learned from. Out: a warning for each printhead that has such channels.

use super::{Design, HealthyModel, tuned};
use crate::identify::SignalSet;
use crate::model::median::{median_of, robust_sd};
use crate::numbers::FEW;
use nalgebra::Vector2;
use std::collections::BTreeMap;

/// Signals of a channel that are looked at, at most.
const LOOKED_AT: usize = 4;
/// Channels that are named, at most.
const MOST_NAMED: usize = 8;

impl Design {
    pub(super) fn odd_channels(&self, healthy: &BTreeMap<String, SignalSet>) -> Vec<String> {
        let of_head = self.with_models(healthy).into_iter().zip(healthy.keys());
        of_head.filter_map(|((model, set), name)| warning(name, &levels(model, set))).collect()
    }
}

/// Where each channel rings: the medians of ln damping and ln frequency, from the model's ring.
fn levels(model: &HealthyModel, set: &SignalSet) -> BTreeMap<u32, Vector2<f64>> {
    let Ok(fitter) = model.fitter() else { return BTreeMap::new() };
    let mut seen: BTreeMap<u32, usize> = BTreeMap::new();
    let mut is_early = |i: &usize| {
        let of_channel = seen.entry(set.channel[*i]).or_default();
        *of_channel += 1;
        *of_channel <= LOOKED_AT
    };
    let chosen: Vec<usize> = (0..set.len()).filter(|i| is_early(i)).collect();
    let mut rings: BTreeMap<u32, Vec<Vector2<f64>>> = BTreeMap::new();
    // no fit from the healthy ring reaches one that lies far off
    model.each_own_ring((&fitter, None), (set, &chosen), |i, _, fit| {
        let Some(fit) = fit else { return };
        let at = fit.features.coordinates().fixed_rows::<2>(1).into_owned();
        rings.entry(set.channel[i]).or_default().push(at);
    });
    let middle =
        |of: Vec<Vector2<f64>>| Vector2::from_fn(|j, _| median_of(of.iter().map(|ring| ring[j])));
    rings.into_iter().map(|(channel, of)| (channel, middle(of))).collect()
}

fn warning(printhead: &str, levels: &BTreeMap<u32, Vector2<f64>>) -> Option<String> {
    if levels.len() < FEW {
        return None;
    }
    let mut off: BTreeMap<u32, f64> = BTreeMap::new();
    for j in 0..2 {
        let all: Vec<f64> = levels.values().map(|at| at[j]).collect();
        let middle = median_of(all.iter().copied());
        let sd = robust_sd(&all, middle);
        for (channel, at) in levels {
            let of_channel = off.entry(*channel).or_default();
            *of_channel = of_channel.max((at[j] - middle).abs() / sd);
        }
    }
    off.retain(|_, sds| *sds > tuned::ODD_CHANNEL);
    let farthest = off.values().copied().fold(0.0, f64::max);
    let named: Vec<String> = off.keys().take(MOST_NAMED).map(u32::to_string).collect();
    let more = match off.len() - named.len() {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    (!off.is_empty()).then(|| {
        format!(
            "printhead {printhead}: of the {} channels labelled healthy, {}{more} ring unlike the others, up to {farthest:.0} \
             standard deviations of these: a fault among them counts as healthy from now on. Are their rows right, and \
             is the first channel 0 or 1?",
            levels.len(),
            named.join(", ")
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_channel_far_off_the_others_is_named_and_the_widest_of_a_thousand_is_not() {
        // quantiles of the logistic law, whose tails are longer than a Gaussian's
        let quantile = |k: u32| ((f64::from(k) + 0.5) / (999.5 - f64::from(k))).ln();
        let level = |k: u32| Vector2::new(0.02 * quantile(k * 389 % 1000), 5e-4 * quantile(k));
        let mut levels: BTreeMap<u32, Vector2<f64>> = (0..1000).map(|k| (k, level(k))).collect();
        assert_eq!(warning("head", &levels), None);
        levels.insert(7, Vector2::new(0.4, -0.015));
        let told = warning("head", &levels).unwrap();
        assert!(told.contains("of the 1000 channels labelled healthy, 7 ring unlike"), "{told}");
        let few = levels.into_iter().take(FEW - 1).collect();
        assert_eq!(warning("head", &few), None);
    }
}
