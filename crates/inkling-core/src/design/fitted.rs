//! Rings fitted to signals.
//!
//! In: the signals of one printhead, its model. Out: channel and features of each signal that rings.

use super::HealthyModel;
use crate::identify::averaging::SignalSet;
use crate::model::ring_fit::{Products, RingFitter};
use nalgebra::Vector4;

/// Channel and features of every signal that a ring fits (the phase free), corrected to the model's
/// temperature.
pub(super) fn fitted(
    model: &HealthyModel,
    set: &SignalSet,
    fitter: &RingFitter,
) -> Vec<(u32, Vector4<f64>)> {
    let per_k = Vector4::from(model.features_per_k(fitter));
    let (mut signal, mut columns, mut i) = (Vec::new(), Products::default(), 0);
    let mut found = Vec::new();
    model.each_deviation(set, |deviation, drive| {
        let (channel, warmer) = (set.channel[i], model.warmer(set.temperature_c[i]));
        i += 1;
        model.per_drive(deviation, drive, warmer, &mut signal);
        if let Some(fit) = fitter.fit(&signal, true, &mut columns) {
            found.push((channel, Vector4::from(fit.features.coordinates()) - warmer * per_k));
        }
    });
    found
}
