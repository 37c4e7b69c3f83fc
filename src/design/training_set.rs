//! Labelled signals, and the rings that are fitted to them.

use super::detector::ring_of;
use super::{DesignError, Extension, HealthyModel};
use crate::identify::averaging::SignalSet;
use crate::isolate::posterior::Examples;
use crate::model::ring_fit::{Features, Products, RingFitter};
use std::collections::BTreeMap;

/// Labelled signals of one sampling, by printhead; drives relative to `drive_voltage_v`.
#[derive(Debug, Default)]
pub struct TrainingSet {
    pub sample_period_s: f64,
    pub samples: usize,
    pub drive_voltage_v: Option<f64>,
    pub healthy: BTreeMap<String, SignalSet>,
    /// By class, then printhead.
    pub faulty: BTreeMap<String, BTreeMap<String, SignalSet>>,
    /// Signals seen, by label.
    pub signals: BTreeMap<String, u64>,
    /// What was taken off them.
    pub extension: Option<Extension>,
}

/// Features of a class's signals and the noise of a fit at their mean.
pub(super) fn examples(
    sets: &[(&HealthyModel, &SignalSet)],
) -> Result<Option<Examples>, DesignError> {
    let (mut features, mut columns) = (Vec::new(), Products::default());
    let mut noise = None;
    for (model, set) in sets {
        let dt_s = model.generator.dt_s;
        let fitter = RingFitter::new(ring_of(&model.identification)?, dt_s, set.samples);
        let mut sum = [0.0; 4];
        let mut fitted = 0.0;
        let per_k = model.features_per_k(&fitter);
        let (mut signal, mut i) = (Vec::new(), 0);
        model.each_deviation(set, |deviation, drive| {
            let warmer = model.warmer(set.temperature_c[i]);
            i += 1;
            model.per_drive(deviation, drive, warmer, &mut signal);
            if let Some(fit) = fitter.fit(&signal, true, &mut columns) {
                let mut x = fit.features.coordinates();
                x.iter_mut().zip(per_k).for_each(|(x, slope)| *x -= warmer * slope);
                sum.iter_mut().zip(x).for_each(|(s, v)| *s += v);
                fitted += 1.0;
                features.push(x.to_vec());
            }
        });
        let mean = sum.map(|s| s / f64::max(fitted, 1.0));
        let at = Features {
            ln_amplitude: mean[0],
            ln_damping: mean[1],
            ln_frequency: mean[2],
            phase_rad: mean[3],
        };
        noise = fitter.noise_covariance(&at, true, model.noise).or(noise);
    }
    let enough = !features.is_empty();
    Ok(noise.filter(|_| enough).map(|noise| Examples::new(features, noise)))
}
