//! The healthy ring of each printhead over temperature: resonance and damping of every healthy model that judged a
//! recording and was learned at a known temperature.
//!
//! In: the JSON documents of the recordings' summaries, whose `models` have poles. Out:
//! [`ModelPoint`]s, which `figures::drift` draws, and the relative change per kelvin
//! (`per_kelvin`).

use super::source::Source;
use super::trend::Moments;
use serde_json::Value;
use std::collections::BTreeSet;

/// Most models that are kept; further ones, in the order of the recordings, are left out.
const MOST_POINTS: usize = 20_000;

/// Resonance and damping of one healthy model.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelPoint {
    /// The printhead that the model is of; `None` for the design's pooled model.
    pub printhead: Option<String>,
    /// Ink temperature of the window that the model was learned on.
    pub temperature_c: f64,
    pub frequency_hz: f64,
    pub damping_per_s: f64,
}

/// The models, each of them once: that of a design stands in many documents.
pub fn points(sources: &[Source]) -> Vec<ModelPoint> {
    let mut seen = BTreeSet::new();
    let models = sources.iter().flat_map(|of| of.document["models"].as_array()).flatten();
    // models are the same if printhead, time and poles agree to the last bit
    let is_new = |(model, point): &(&Value, ModelPoint)| {
        let bits = (point.frequency_hz.to_bits(), point.damping_per_s.to_bits());
        seen.insert((point.printhead.clone(), model["valid_from"].to_string(), bits))
    };
    let points = models.filter_map(|model| Some((model, point(model)?))).filter(is_new);
    points.map(|(_, point)| point).take(MOST_POINTS).collect()
}

/// A model as it stands in a summary; `None` if it has no temperature or no ring.
fn point(model: &Value) -> Option<ModelPoint> {
    let positive = |key: &str| model["poles"][key].as_f64().filter(|v| v.is_finite() && *v > 0.0);
    Some(ModelPoint {
        printhead: model["printhead"].as_str().map(str::to_owned),
        temperature_c: model["temperature_c"].as_f64().filter(|t| t.is_finite())?,
        frequency_hz: positive("frequency_hz")?,
        damping_per_s: positive("damping_per_s")?,
    })
}

/// Relative change of a quantity per K (its slope by least squares over its mean), of temperatures and values; `None`
/// with fewer than three of them, or if temperatures hardly vary (a sum of squares of at most .25 K²).
pub fn per_kelvin(pairs: &[(f64, f64)]) -> Option<f64> {
    let Moments { y0, sxx, slope, .. } = Moments::of(pairs);
    (pairs.len() >= 3 && sxx > 0.25).then(|| slope / y0)
}
