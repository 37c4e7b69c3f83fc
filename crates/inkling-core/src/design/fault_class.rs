//! A fault class of a design, and how it is learned: its mean deviation from the healthy model
//! (thesis §3-3-2, rho before filtering), its identified model or its training signals.
//!
//! In, from `train`: labelled signals y of the class with their relative drives s, and the healthy
//! models y_hat of their printheads. Out: [`FaultClass`], from which `isolator` is made.

use super::fd_filter::{by_resonance, with_denominator};
use super::healthy_model::deviations;
use super::{HealthyModel, LearnSettings, Result};
use crate::detect::ResidualGenerator;
use crate::fault::Class;
use crate::identify::SignalSet;
use crate::identify::grey_box::{self, Identification};
use crate::identify::{Bounds, GreyBoxSettings};
use serde::{Deserialize, Serialize};

/// When a fault's model is identified, the rates are searched at least this factor to either side
/// of the guess: a nozzle of which the share s is blocked moves a/b and d by 1 / (1 - s), and 300 reaches
/// s = .997 (`[BN]` in `model/faults.toml`).
const LEAST_BOUND_FACTOR: f64 = 300.0;
/// Share of a class's own training signals that the bound of `model-matching` lets through.
const MATCHING_SHARE: f64 = 0.99;

/// Departs: thesis §3-3-2 keeps mean residuals. r = F (y - y_hat) is affine in y, so a mean
/// deviation is kept and filtered by whichever model judges: it survives re-identification.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct FaultClass {
    pub name: String,
    /// The group of classes that need the same thing to be done.
    pub category: String,
    /// Names of the laws that the class was declared to stand for (`isolate.classes`).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub of: Vec<String>,
    /// 0: the class is known by the physics alone.
    pub n_signals: u64,
    /// Per unit drive, N, counts; where nothing is labelled, as predicted for the middle severity.
    pub deviation: Vec<f64>,
    /// The class's own dynamics, if its mean is a damped oscillation (`model-matching`).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub model: Option<FaultModel>,
    /// Deviations of training signals per unit drive, N each, counts (`neighbours`).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub examples: Vec<Vec<f64>>,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct FaultModel {
    pub identification: Identification,
    /// What this model expects less what the healthy one does, per unit drive, N, counts.
    pub expected: Vec<f64>,
    pub generator: ResidualGenerator,
    /// Residual energy above which a signal is not of this class, counts²·s, per unit drive.
    pub bound: f64,
}

impl FaultClass {
    /// The mean deviation by least squares: sum s (y - s y_hat) / sum s².
    pub fn learn(name: &str, category: &str, sets: &[(&HealthyModel, &SignalSet)]) -> FaultClass {
        let samples = sets.first().map_or(0, |(_, set)| set.samples);
        let (mut sum, mut weight, mut n) = (vec![0.0; samples], 0.0, 0);
        for (model, set) in sets {
            model.each_deviation(set, |_, deviation, s| {
                sum.iter_mut().zip(deviation).for_each(|(sum, d)| *sum += s * d);
                weight += s * s;
                n += 1;
            });
        }
        sum.iter_mut().for_each(|v| *v /= weight);
        FaultClass {
            name: name.into(),
            category: category.into(),
            n_signals: n,
            deviation: sum,
            ..FaultClass::default()
        }
    }

    /// The class's name and category, and the laws that it stands for: that of its own name where
    /// none were declared. [`super::Design::fault_classes`] adds the unit.
    pub fn class(&self) -> Class {
        let (name, category) = (self.name.clone(), self.category.clone());
        let of = if self.of.is_empty() { vec![name.clone()] } else { self.of.clone() };
        Class { name, category, of, unit: None }
    }

    /// Identifies the class's dynamics: thesis (3-1) on the class's mean signal, within wider bounds.
    pub(super) fn identify(
        &self,
        healthy: &HealthyModel,
        grey_box: &GreyBoxSettings,
        dt_s: f64,
    ) -> Result<Identification> {
        let mean: Vec<f64> =
            healthy.expected.iter().zip(&self.deviation).map(|(y, d)| y + d).collect();
        let bound_factor = grey_box.bound_factor.max(LEAST_BOUND_FACTOR);
        let wider = GreyBoxSettings { bound_factor, bounds: Bounds::default(), ..grey_box.clone() };
        Ok(grey_box::identify(&mean, dt_s, 0.0, &wider, None)?)
    }

    /// Learns the class's own model, filter and bound, thesis §3-3-1: the residual energy up to
    /// which `share` of its training signals lie. An error if the mean is no damped oscillation.
    pub(super) fn learn_model(
        &mut self,
        healthy: &HealthyModel,
        sets: &[(&HealthyModel, &SignalSet)],
        settings: LearnSettings,
    ) -> Result<()> {
        let (dt_s, samples) = (settings.sample_period_s, self.deviation.len());
        let identification = self.identify(healthy, settings.grey_box, dt_s)?;
        let denominator = by_resonance(&healthy.identification, samples, settings.detect, dt_s)?;
        let generator = with_denominator(&identification.channel, denominator, dt_s)?;
        let expected: Vec<f64> = identification
            .expected(dt_s, samples)
            .iter()
            .zip(&healthy.expected)
            .map(|(y, h)| y - h)
            .collect();
        let mut model = FaultModel { identification, expected, generator, bound: 0.0 };

        let mut scratch = Vec::new();
        let mut energies: Vec<f64> =
            deviations(sets).iter().map(|d| model.energy(d, 1.0, &mut scratch)).collect();
        energies.sort_unstable_by(f64::total_cmp);
        let last = energies.len().saturating_sub(1);
        model.bound =
            energies.get((MATCHING_SHARE * last as f64).ceil() as usize).copied().unwrap_or(0.0);
        if !(model.bound.is_finite() && model.bound > 0.0) {
            return Err("its signals leave no residual energy".into());
        }
        self.model = Some(model);
        Ok(())
    }

    /// Keeps the training signals as deviations per unit drive, rounded to a hundredth of a count.
    pub(super) fn keep_examples(&mut self, sets: &[(&HealthyModel, &SignalSet)]) {
        self.examples = deviations(sets);
        for v in self.examples.iter_mut().flatten() {
            *v = (*v * 100.0).round() / 100.0;
        }
    }
}

impl FaultModel {
    /// Residual energy of a signal under this class's filter, counts²·s, per unit drive.
    /// `deviation`: from what the healthy model expects at `drive`, N, counts; `scratch`: a buffer.
    pub fn energy(&self, deviation: &[f64], drive: f64, scratch: &mut Vec<f64>) -> f64 {
        scratch.clear();
        scratch.extend(deviation.iter().zip(&self.expected).map(|(d, e)| d / drive - e));
        self.generator.energy(scratch)
    }
}
