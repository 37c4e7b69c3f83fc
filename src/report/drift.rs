//! The healthy ring of each printhead over time and temperature: resonance and damping of every
//! healthy model that judged a recording.
//!
//! In: the JSON documents of the recordings' summaries, whose `models` have poles. Out:
//! [`ModelPoint`]s, which `figures::drift` draws, and the relative change per kelvin
//! (`per_kelvin`).

use super::source::Source;
use super::trend::Moments;
use chrono::DateTime;
use std::collections::BTreeSet;

/// Most models that are kept; further ones, in the order of the recordings, are left out.
const MOST_POINTS: usize = 20_000;

/// Resonance and damping of one healthy model.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelPoint {
    /// The printhead that the model is of; `None` for the design's pooled model.
    pub printhead: Option<String>,
    /// When the model's use began; `None` for a model of a design.
    pub valid_from_ns: Option<i64>,
    /// Ink temperature of the window that the model was learned on; `None` if it was not recorded.
    pub temperature_c: Option<f64>,
    pub frequency_hz: f64,
    pub damping_per_s: f64,
}

/// The models in the order of time, each of them once: that of a design stands in many documents.
pub fn points(sources: &[Source]) -> Vec<ModelPoint> {
    let mut seen = BTreeSet::new();
    let mut points = Vec::new();
    for model in sources.iter().flat_map(|s| s.document["models"].as_array().into_iter().flatten())
    {
        let poles = &model["poles"];
        let positive = |key: &str| poles[key].as_f64().filter(|v| v.is_finite() && *v > 0.0);
        let (Some(frequency_hz), Some(damping_per_s)) =
            (positive("frequency_hz"), positive("damping_per_s"))
        else {
            continue;
        };
        let point = ModelPoint {
            printhead: model["printhead"].as_str().map(str::to_owned),
            valid_from_ns: model["valid_from"]
                .as_str()
                .and_then(|text| DateTime::parse_from_rfc3339(text).ok()?.timestamp_nanos_opt()),
            temperature_c: model["temperature_c"].as_f64().filter(|t| t.is_finite()),
            frequency_hz,
            damping_per_s,
        };
        // models are the same if printhead, time and poles agree to the last bit
        let bits = (frequency_hz.to_bits(), damping_per_s.to_bits());
        if seen.insert((point.printhead.clone(), point.valid_from_ns, bits))
            && points.len() < MOST_POINTS
        {
            points.push(point);
        }
    }
    points.sort_by_key(|p| p.valid_from_ns);
    points
}

/// Relative change of a quantity per K (its slope by least squares over its mean); `None` with
/// fewer than three temperatures, or if these hardly vary (a sum of squares of at most .25 K²).
pub fn per_kelvin(points: &[&ModelPoint], of: fn(&ModelPoint) -> f64) -> Option<f64> {
    let pairs: Vec<(f64, f64)> =
        points.iter().filter_map(|p| Some((p.temperature_c?, of(p)))).collect();
    let Moments { y0, sxx, slope, .. } = Moments::of(&pairs);
    (pairs.len() >= 3 && sxx > 0.25).then(|| slope / y0)
}
