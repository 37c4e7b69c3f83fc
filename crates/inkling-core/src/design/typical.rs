//! Learning the bounds on what is typical of each class ([`crate::isolate::typical`]), from labelled signals,
//! and from the physics for classes of which none are labelled.
//!
//! In: a design with its posterior, labelled signals. Out: [`Typical`]: the directions in which classes
//! differ beside their rings, how far each class scatters along them, and a bound on the misfit that remains.
//! Signals that leave more than the bound are no ring of the class.

use super::leftover::Leftovers;
use super::{Design, DesignError, HealthyModel, TrainingSet};
use crate::identify::averaging::SignalSet;
use crate::isolate::typical::{RingMisfit, Typical, directions, misfit_bound};
use crate::model::inner_product::dot;
use crate::numbers::tuned::few;
use std::collections::BTreeMap;

/// At most so many signals of a class and printhead are used.
const MOST_SIGNALS: usize = 256;
/// At most so many principal directions of the misfit are kept.
const MOST_DIRECTIONS: usize = 8;
/// Number of severities at which the physics predicts the decays of a class.
const SEVERITIES: usize = 9;

/// Learns the bounds of every class of a design. `None`: the design has no posterior, which they would serve.
/// An error if a model does not ring.
pub(super) fn learn(design: &Design, set: &TrainingSet) -> Result<Option<Typical>, DesignError> {
    if design.posterior.is_none() {
        return Ok(None);
    }

    // Of healthy signals and of every class, what the signals leave beside their rings. A class without
    // labelled signals gets the decays that the physics predicts for the kinds that it stands for.
    let healthy = left_of(design, &set.healthy)?;
    let mut classes = Vec::new();
    for class in &design.classes {
        let labelled = set.faulty.get(&class.name);
        let mut left = labelled.map_or(Ok(Leftovers::default()), |sets| left_of(design, sets))?;
        let labelled = left.rows.len();
        if labelled == 0 {
            for kind in class.class().of {
                left.extend(by_physics(design, &kind)?);
            }
        }
        classes.push(OfClass { left, labelled });
    }

    // The principal directions of all classes' misfits together, and the variance of each class along each of
    // them. Few labelled signals say little of a class's own variance: it gets the widest of all classes.
    let rows: Vec<Vec<f64>> =
        classes.iter().flat_map(|of| of.left.rows.iter().take(MOST_SIGNALS).cloned()).collect();
    let mut typical =
        Typical { directions: directions(&rows, MOST_DIRECTIONS), ..Typical::default() };
    let spreads: Vec<Vec<f64>> =
        classes.iter().map(|of| typical.directions.iter().map(|d| of.along(d)).collect()).collect();
    let widest: Vec<f64> = (0..typical.directions.len())
        .map(|j| spreads.iter().map(|of| of[j]).fold(0.0, f64::max))
        .collect();
    typical.spread = classes
        .iter()
        .zip(spreads)
        .map(|(of, own)| if (1..few()).contains(&of.labelled) { widest.clone() } else { own })
        .collect();

    // Bounds on what remains, never below that of healthy signals.
    let misfits = |left: &Leftovers, k: usize| -> Vec<f64> {
        let each = left.rows.iter().zip(&left.size);
        each.map(|(left, &size)| typical.misfit_of(RingMisfit { values: left, size }, k)).collect()
    };
    let bounds = classes.iter().enumerate().map(|(k, of)| {
        let of_noise = misfit_bound(&misfits(&healthy, k));
        let own = misfits(&of.left, k);
        match of.labelled {
            // the physics' decays are free of noise: their misfit adds to that of the noise
            0 => of_noise + 2.0 * own.iter().copied().fold(0.0, f64::max),
            // too few for a bound of their own
            n if n < few() => own.iter().copied().fold(of_noise, f64::max) * 1.5,
            _ => misfit_bound(&own).max(of_noise),
        }
    });
    typical.misfit = bounds.collect();
    Ok(Some(typical))
}

/// What signals of one class leave beside their rings.
struct OfClass {
    left: Leftovers,
    /// Number of labelled signals among them; 0: all are predictions of the physics.
    labelled: usize,
}

impl OfClass {
    /// Variance along a direction beyond the noise's, for a ring as large as the healthy one.
    fn along(&self, direction: &[f64]) -> f64 {
        // misfits are in units of the noise; predictions of the physics have none
        let noise = if self.labelled > 0 { 1.0 } else { 0.0 };
        let each = self.left.rows.iter().zip(&self.left.size);
        let sum: f64 =
            each.map(|(row, size)| (dot(row, direction).powi(2) - noise) / (size * size)).sum();
        (sum / self.left.rows.len().max(1) as f64).max(0.0)
    }
}

/// The misfits of one model's signals beside their rings, without the model's leftover, in standard
/// deviations of a sample's noise.
fn left_by(model: &HealthyModel, set: &SignalSet) -> Result<Leftovers, DesignError> {
    let left = Leftovers::of(model, &model.rings()?, set, None);
    Ok(left.without(&model.leftover).over(model.noise_beside()))
}

/// The same misfits of the first signals of each printhead.
fn left_of(design: &Design, sets: &BTreeMap<String, SignalSet>) -> Result<Leftovers, DesignError> {
    let mut all = Leftovers::default();
    for (model, set) in design.with_models(sets) {
        all.extend(left_by(model, &set.first(MOST_SIGNALS))?);
    }
    Ok(all)
}

/// The same misfits of decays that the physics predicts for a class, free of noise: severities from the
/// smallest to the largest that the class's name stands for.
fn by_physics(design: &Design, class: &str) -> Result<Leftovers, DesignError> {
    let (Some(physics), model) = (&design.physics, &design.pooled) else {
        return Ok(Leftovers::default());
    };
    let sampling = (design.sample_period_s, design.samples);
    let Some(law) = physics.laws.law(class) else { return Ok(Leftovers::default()) };
    let [low, high] = law.range.map(|severity| law.scale(severity));
    // signals at the reference drive and temperature, one for each severity
    let mut set = SignalSet::new(design.samples);
    for i in 0..SEVERITIES {
        let place = low + (high - low) * (i as f64 + 0.5) / SEVERITIES as f64;
        let severity = law.severity_at(place);
        let Some(d) = physics.deviation(class, severity, sampling) else { continue };
        let y: Vec<f32> = model.expected.iter().zip(&d).map(|(e, d)| (e + d) as f32).collect();
        set.push(&y, i as u32, 1.0, f64::NAN);
    }
    left_by(model, &set)
}

impl HealthyModel {
    /// Standard deviation of the white noise, counts per sample, whose effect on fitted rings is that of the
    /// model's noise.
    pub(super) fn noise_of_fits(&self) -> f64 {
        self.sensitivity.as_ref().map_or(self.noise, |of| of.noise_of_one_sample())
    }

    /// Standard deviation of one sample's noise, counts, from the misfit of healthy signals beside their
    /// rings; where there is no second test, the model's noise.
    pub(super) fn noise_beside(&self) -> f64 {
        match &self.misfit {
            Some(misfit) => (misfit.square / self.expected.len() as f64).sqrt(),
            None => self.noise,
        }
    }
}
