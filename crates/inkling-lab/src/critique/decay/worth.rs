//! What each cause of decays is worth: the gain in ln likelihood, per decay and output, on stretches that
//! nothing was fitted to.
//!
//! In: decays and what was selected. Out: [`LogLikelihood`]. (1) The model with all that was found, the same
//! model without one cause at a time, and the plain oscillation are fitted to the stretches that are not held
//! out. (2) The noise of each model is the autoregression of what the model leaves there. (3) ln p of each
//! held-out sample, given the samples before it, is summed, and compared between models.

use super::decays::Decays;
use super::fit::Fit;
use super::noise::{Colour, Noise};
use super::selection::Selected;
use super::stretches::Stretches;
use crate::critique::finding::{LogLikelihood, Worth};
use std::collections::BTreeMap;

/// ln p of the held-out samples, one vector for each stretch of each series.
struct Judged(Vec<Vec<f64>>);

/// The gain of all that was found, and of each named cause (all lines of one name together). `refitted`: the
/// plain oscillation and the final model, fitted in `noise`, which counts what is not held out.
pub fn measure(selected: &Selected, refitted: &[Fit; 2], noise: &Noise) -> Option<LogLikelihood> {
    let fit = &selected.fit;
    selected.named().next()?;
    let stretches = Stretches::of(fit.decays);
    let [plain, extended] = refitted.each_ref().map(|model| Judged::of(model, stretches));
    let mut by_cause = BTreeMap::new();
    for (_, chosen) in selected.named() {
        let id = chosen.candidate.id;
        by_cause.entry(id.name()).or_insert_with(|| {
            let left = fit.without(|i| fit.terms[i].id() == id).descend(noise);
            extended.worth(&Judged::of(&left, stretches), fit.decays)
        });
    }
    Some(LogLikelihood { all: extended.worth(&plain, fit.decays), by_cause })
}

impl Judged {
    fn of(model: &Fit, stretches: Stretches) -> Judged {
        let decays = model.decays;
        let misfit = model.misfit();
        let spent = model.parameters() as f64 / decays.outputs as f64;
        let colours: Vec<Colour> = (0..decays.outputs)
            .map(|output| {
                let series = decays.of_output(&misfit, output);
                let ranges = || stretches.ranges(false).into_iter();
                let fitted = series.flat_map(|s| ranges().map(move |range| &s[range]));
                Colour::of(&fitted.collect::<Vec<&[f64]>>(), spent)
            })
            .collect();

        let mut all = Vec::new();
        for (i, series) in misfit.chunks(decays.samples).enumerate() {
            let ln = colours[i % decays.outputs].ln_densities(series);
            all.extend(stretches.ranges(true).into_iter().map(|range| ln[range].to_vec()));
        }
        Judged(all)
    }

    /// ln p of this model less another's, per series, nats. The 95 % interval takes the samples' gains as
    /// independent about their stretch's mean.
    fn worth(&self, other: &Judged, decays: &Decays) -> Worth {
        let (mut gain, mut variance) = (0.0, 0.0);
        for (own, others) in self.0.iter().zip(&other.0) {
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
}
