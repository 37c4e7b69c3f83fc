//! What each cause of decays is worth: the gain in ln likelihood, per decay and output, on stretches that
//! nothing was fitted to.
//!
//! In: decays and what was selected. Out: [`LogLikelihood`]. (1) The model with all that was found, the same
//! model without one cause at a time, and the plain oscillation are fitted to the stretches that are not held
//! out. (2) The noise of each model is the autoregression of what the model leaves there. (3) ln p of each
//! held-out sample, given the samples before it, is summed, and compared between models.

use super::decays::Decays;
use super::noise::Noise;
use super::plant::Fit;
use super::selection::Selected;
use super::stretches::Stretches;
use crate::critique::finding::{LogLikelihood, Worth};
use std::collections::BTreeMap;

/// The gain of all that was found, and of each named cause (all lines of one name together). `refitted`: the
/// plain oscillation and the final model, fitted in `noise`, which counts what is not held out.
pub fn measure(selected: &Selected, refitted: &[Fit; 2], noise: &Noise) -> Option<LogLikelihood> {
    let fit = &selected.fit;
    selected.named().next()?;
    let stretches = Stretches::of(fit.decays);
    let [plain, extended] = refitted.each_ref().map(|model| ln_held_out(model, &stretches));
    let mut by_cause = BTreeMap::new();
    for (_, chosen) in selected.named() {
        let id = chosen.candidate.id;
        by_cause.entry(id.name()).or_insert_with(|| {
            let left = fit.without(|i| fit.terms[i].id() == id).descend(noise);
            worth(&extended, &ln_held_out(&left, &stretches), fit.decays)
        });
    }
    Some(LogLikelihood { all: worth(&extended, &plain, fit.decays), by_cause })
}

/// ln p of the held-out samples, one vector for each stretch of each series.
fn ln_held_out(model: &Fit, stretches: &Stretches) -> Vec<Vec<f64>> {
    let decays = model.decays;
    let colours = model.noise_within(&stretches.fitted).colours;
    let of_series = |(i, series): (usize, &[f64])| -> Vec<Vec<f64>> {
        let ln = colours[i % decays.outputs].ln_densities(series);
        stretches.held_out.iter().map(|range| ln[range.clone()].to_vec()).collect()
    };
    model.misfit().chunks(decays.samples).enumerate().flat_map(of_series).collect()
}

/// ln p of one model less another's, per series, nats. The 95 % interval takes the samples' gains as independent
/// about their stretch's mean.
fn worth(own: &[Vec<f64>], others: &[Vec<f64>], decays: &Decays) -> Worth {
    let (mut gain, mut variance) = (0.0, 0.0);
    for (own, others) in own.iter().zip(others) {
        let gains: Vec<f64> = own.iter().zip(others).map(|(p, q)| p - q).collect();
        let sum: f64 = gains.iter().sum();
        let mean = sum / gains.len() as f64;
        gain += sum;
        variance += gains.iter().map(|g| (g - mean).powi(2)).sum::<f64>();
    }
    let series = (decays.bursts * decays.outputs) as f64;
    let (gain, half) = (gain / series, 1.96 * variance.sqrt() / series);
    Worth { gain, ci95: [gain - half, gain + half] }
}
