//! A posterior over the fault classes, from the features of a fitted ring: the default method of
//! isolation. A design stores it; [`super::stacking`] learns it.
//!
//! In: the features x of a signal, and the physics' ln densities of x ([`super::physics_density`]).
//! Out: the probability of each class, given that the signal is of one of them:
//!
//! ```text
//! P(class | x)  proportional to  prior(class) p(x | class)^(1 / temperature)
//! p(x | class)  =  share by_physics(x | class)  +  (1 - share) learned(x | class)
//! ```

use super::class_density::ClassDensity;
use crate::model::simd_math::exp;
use crate::processor::for_processor;
use serde::{Deserialize, Serialize};
use std::sync::OnceLock;

#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Posterior {
    /// Divides ln densities: more than 1 where they are overconfident. It is 1, too, where some
    /// labelled class has fewer than `few` examples.
    pub temperature: f64,
    /// Learned from labelled signals; `None`: the class has none, and the physics stands alone.
    pub classes: Vec<Option<ClassDensity>>,
    /// Weight of the physics in each class's mixture; empty: 0 in all classes.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub physics_share: Vec<f64>,
    /// The posterior over features relative to their own channels' healthy levels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub of_own: Option<Box<Posterior>>,
    /// Per class ln of the physics' weight, and of the learned one's; computed once.
    #[serde(skip)]
    pub(super) ln_shares: OnceLock<Vec<[f64; 2]>>,
}

impl Posterior {
    pub fn with_own(self, of_own: Option<Posterior>) -> Posterior {
        Posterior { of_own: of_own.map(Box::new), ..self }
    }

    /// `weights` receives the posterior of each class, NaN if the features have no density in any.
    /// `physics`: its ln densities of the four features, empty where there is none; `ln_densities`
    /// receives those of the mixtures, before temperature and priors, -infinity where negligible.
    pub fn weigh(
        &self,
        features: &[f64],
        physics: &[f64],
        priors: &[f64],
        ln_densities: &mut Vec<f64>,
        weights: &mut [f64],
    ) {
        let share = |k: usize| self.physics_share.get(k).copied().unwrap_or(0.0);
        let ln_shares = self.ln_shares.get_or_init(|| {
            let of = |k: usize| [share(k).ln(), (1.0 - share(k)).ln()];
            (0..self.classes.len()).map(of).collect()
        });

        // the largest density is no less than the largest of the physics' parts
        let of_physics = |k: usize| physics.get(k).map(|physics| physics + ln_shares[k][0]);
        let largest_part =
            (0..physics.len()).filter_map(of_physics).fold(f64::NEG_INFINITY, f64::max);

        // Most classes are so far away that their learned densities need not be computed: `weights`
        // holds the squared distances at first. `nearest` leaves out classes of nearly pure
        // physics.
        let mut nearest = f64::INFINITY;
        for (k, (square, class)) in weights.iter_mut().zip(&self.classes).enumerate() {
            *square = class.as_ref().map_or(f64::INFINITY, |class| class.square(features));
            if share(k) < MOSTLY_PHYSICS {
                nearest = nearest.min(*square);
            }
        }

        for (k, (w, class)) in weights.iter_mut().zip(&self.classes).enumerate() {
            let near = *w < nearest + self.temperature * FAR || nearest == f64::INFINITY;
            let physics = of_physics(k);
            // nor do those whose upper bound is negligible beside the physics, of this class or any
            let ln_learned = ln_shares[k][1];
            let counts = |class: &&ClassDensity| {
                let highest = ln_learned + class.ln_highest() - 0.5 * *w;
                physics.is_none_or(|ln| {
                    highest > ln - NEGLIGIBLE
                        && highest > largest_part - self.temperature * NEGLIGIBLE
                })
            };
            let learned = ln_or_none(class.as_ref().filter(|_| near).filter(counts), features);
            *w = physics.map_or(learned, |physics| sum_of(learned + ln_learned, physics));
        }
        ln_densities.clear();
        ln_densities.extend_from_slice(weights);
        to_posterior(self.temperature, priors, weights);
    }
}

/// A class whose squared distance exceeds the nearest one's by this, times the temperature, has a
/// density smaller by a factor of e^-60: far more than peak densities differ by.
const FAR: f64 = 120.0;
/// ln ratio of two densities beyond which a certainty does not show the smaller in any digit.
const NEGLIGIBLE: f64 = 17.0;
/// ln of the ratio of two numbers from which on the smaller does not change the sum.
pub(super) const ROUNDED_AWAY: f64 = 40.0;
/// A class with at least this weight of the physics makes no other class count as too far away.
const MOSTLY_PHYSICS: f64 = 0.999;

/// ln of the sum of two numbers that are given by their ln.
pub(super) fn sum_of(p: f64, q: f64) -> f64 {
    let (most, other) = if p > q { (p, q) } else { (q, p) };
    if other < most - ROUNDED_AWAY || most == f64::NEG_INFINITY {
        return most;
    }
    most + ((p - most).exp() + (q - most).exp()).ln()
}

pub(super) fn ln_or_none(class: Option<&ClassDensity>, x: &[f64]) -> f64 {
    class.map_or(f64::NEG_INFINITY, |class| class.ln_density(x))
}

/// In place; NaN if all are -infinity. `priors`: empty: all are alike.
pub(super) fn to_posterior(temperature: f64, priors: &[f64], weights: &mut [f64]) {
    let most = weights.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let by = 1.0 / temperature;
    for chunk in weights.chunks_mut(CLASSES) {
        let mut less = [f64::NEG_INFINITY; CLASSES];
        less.iter_mut().zip(&*chunk).for_each(|(less, w)| *less = (w - most) * by);
        chunk.copy_from_slice(&exp_lanes(less)[..chunk.len()]);
    }
    weights.iter_mut().zip(priors).for_each(|(w, prior)| *w *= prior);
    let sum: f64 = weights.iter().sum();
    weights.iter_mut().for_each(|w| *w /= sum);
}

const CLASSES: usize = 16;

for_processor! {
    /// Exponentials of some numbers at once; 0 for numbers below -700.
    fn exp_lanes(of: [f64; CLASSES]) -> [f64; CLASSES] { portable }
}

#[inline(always)] // body of `exp_lanes`, compiled once per instruction set
fn portable(of: [f64; CLASSES]) -> [f64; CLASSES] {
    const LEAST: f64 = -700.0;
    // a NaN is not less, so it remains one
    of.map(|x| if x < LEAST { 0.0 } else { exp(x) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn odds_are_those_of_the_densities_and_the_priors() {
        // more classes than are taken together
        let densities: Vec<f64> = (0..40).map(|k| -700.0 - 0.1 * f64::from(k % 7)).collect();
        let priors: Vec<f64> = (0..40).map(|k| 1.0 + f64::from(k % 3)).collect();
        for temperature in [1.0, 2.5] {
            let mut weights = densities.clone();
            to_posterior(temperature, &priors, &mut weights);
            assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            for k in 1..40 {
                let odds = ((densities[k] - densities[0]) / temperature).exp() * priors[k];
                let found = weights[k] / weights[0] * priors[0];
                assert!((found / odds - 1.0).abs() < 1e-9, "{k}: {found}, not {odds}");
            }
            let mut alike = densities.clone();
            to_posterior(temperature, &[], &mut alike);
            let odds = ((densities[6] - densities[0]) / temperature).exp();
            assert!((alike[6] / alike[0] / odds - 1.0).abs() < 1e-9);
        }
    }
}
