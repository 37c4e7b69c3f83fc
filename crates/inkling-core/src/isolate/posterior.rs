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
    /// receives those of the mixtures, before temperature and priors.
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

        for (k, (w, class)) in weights.iter_mut().zip(&self.classes).enumerate() {
            let learned = ln_or_none(class.as_ref(), features);
            let [of_physics, of_learned] = ln_shares[k];
            let mixed = |physics: &f64| sum_of(learned + of_learned, physics + of_physics);
            *w = physics.get(k).map_or(learned, mixed);
        }
        ln_densities.clear();
        ln_densities.extend_from_slice(weights);
        to_posterior(self.temperature, priors, weights);
    }
}

/// ln of the ratio of two numbers from which on the smaller does not change the sum.
pub(super) const ROUNDED_AWAY: f64 = 40.0;

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
    weights.iter_mut().for_each(|w| *w = ((*w - most) / temperature).exp());
    weights.iter_mut().zip(priors).for_each(|(w, prior)| *w *= prior);
    let sum: f64 = weights.iter().sum();
    weights.iter_mut().for_each(|w| *w /= sum);
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
