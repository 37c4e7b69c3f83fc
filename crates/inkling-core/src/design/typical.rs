//! Learning the bounds on what is typical of each class ([`crate::isolate::typical`]): from
//! labelled signals, and from the physics for classes of which none are labelled.
//!
//! In, from `train`: a design with its posterior, labelled signals. Out: [`Typical`], by which
//! `named_ring` decides whether a signal is a ring of its best class:
//! 1. the misfits of healthy signals and of all classes beside their rings (`leftover`);
//! 2. the principal directions of all classes' misfits together, which exceed the noise;
//! 3. the variance of each class along each direction;
//! 4. per class a bound on the mean square of a misfit less what is usual along the directions.

use super::leftover::Misfits;
use super::{Design, HealthyModel, Result, TrainingSet};
use crate::burst::Beside;
use crate::identify::SignalSet;
use crate::isolate::typical::{Typical, directions, misfit_bound};
use crate::model::inner_product::dot;
use crate::numbers::FEW;
use std::collections::BTreeMap;

/// Per class and printhead.
const MOST_SIGNALS: usize = 256;
const MOST_DIRECTIONS: usize = 8;
/// Number of severities at which the physics predicts the decays of one law.
const SEVERITIES: usize = 9;

/// Learns the bounds of every class. `None`: the design has no posterior, which alone uses them.
pub(super) fn learn(design: &Design, set: &TrainingSet) -> Result<Option<Typical>> {
    if design.posterior.is_none() {
        return Ok(None);
    }

    // Step 1. A class without labelled signals gets decays that the physics predicts for its laws.
    let healthy = left_of(design, &set.healthy)?;
    let mut classes = Vec::new();
    for class in &design.classes {
        let labelled = set.faulty.get(&class.name);
        let mut left = labelled.map_or(Ok(Misfits::default()), |sets| left_of(design, sets))?;
        let labelled = left.rows.len();
        if labelled == 0 {
            for kind in class.class().of {
                left.extend(by_physics(design, &kind)?);
            }
        }
        classes.push(ClassMisfits { left, labelled });
    }

    // Steps 2 and 3. Few labelled signals say little of their class: it gets the largest variance.
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
        .map(|(of, own)| if (1..FEW).contains(&of.labelled) { widest.clone() } else { own })
        .collect();

    // step 4: never below the bound that healthy signals give if judged as of the class
    let misfits = |left: &Misfits, k: usize| -> Vec<f64> {
        let each = left.rows.iter().zip(&left.size);
        each.map(|(left, &size)| typical.misfit_of(left, size, k)).collect()
    };
    let bounds = classes.iter().enumerate().map(|(k, of)| {
        let of_noise = misfit_bound(&misfits(&healthy, k));
        let own = misfits(&of.left, k);
        match of.labelled {
            // Predictions have no noise; the factors 2 and 1.5 are margins (somewhat arbitrary).
            0 => of_noise + 2.0 * own.iter().copied().fold(0.0, f64::max),
            // too few labelled signals for a prediction bound
            n if n < FEW => own.iter().copied().fold(of_noise, f64::max) * 1.5,
            _ => misfit_bound(&own).max(of_noise),
        }
    });
    typical.misfit = bounds.collect();
    Ok(Some(typical))
}

struct ClassMisfits {
    /// In standard deviations of the noise.
    left: Misfits,
    /// Number of labelled signals among them; 0: all are predictions of the physics.
    labelled: usize,
}

impl ClassMisfits {
    /// Variance of the misfits along a direction (N, unit norm) beyond the noise's, in units of the
    /// noise's variance, for a ring of the healthy amplitude; at least 0.
    fn along(&self, direction: &[f64]) -> f64 {
        let noise = if self.labelled > 0 { 1.0 } else { 0.0 };
        let each = self.left.rows.iter().zip(&self.left.size);
        let sum: f64 =
            each.map(|(row, size)| (dot(row, direction).powi(2) - noise) / (size * size)).sum();
        (sum / self.left.rows.len().max(1) as f64).max(0.0)
    }
}

/// What the signals of one model leave beside their rings, without the model's leftover, in
/// standard deviations of a sample's noise.
fn left_by(model: &HealthyModel, set: &SignalSet) -> Result<Misfits> {
    let left = Misfits::of(model, &model.rings()?, set, None);
    Ok(left.without(&model.leftover).over(model.noise_beside()))
}

/// The same for the first `MOST_SIGNALS` signals of each printhead.
fn left_of(design: &Design, sets: &BTreeMap<String, SignalSet>) -> Result<Misfits> {
    let mut all = Misfits::default();
    for (model, set) in design.with_models(sets) {
        all.extend(left_by(model, &set.first(MOST_SIGNALS))?);
    }
    Ok(all)
}

/// The same for decays that the physics predicts for the middles of `SEVERITIES` equal parts of a
/// law's range. `class`: the law's name. Empty: there is no physics or no such law.
fn by_physics(design: &Design, class: &str) -> Result<Misfits> {
    let (Some(physics), model) = (&design.physics, &design.pooled) else {
        return Ok(Misfits::default());
    };
    let sampling = (design.sample_period_s, design.samples);
    let Some(law) = physics.laws.law(class) else { return Ok(Misfits::default()) };
    let [low, high] = law.range.map(|severity| law.scale(severity));
    let mut set = SignalSet::new(design.samples);
    for i in 0..SEVERITIES {
        let place = low + (high - low) * (i as f64 + 0.5) / SEVERITIES as f64;
        let severity = law.severity_at(place);
        let Some(d) = physics.deviation(class, severity, sampling) else { continue };
        let y: Vec<f32> = model.expected.iter().zip(&d).map(|(e, d)| (e + d) as f32).collect();
        set.push(&y, 1.0, &Beside::alone(i as u32, 0));
    }
    left_by(model, &set)
}
