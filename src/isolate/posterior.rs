//! A posterior over the fault classes, from the features of a fitted ring.
//!
//! In: labelled features per class. Out: class densities; for a signal's features the probability of
//! each class, given that the signal is faulty, and whether it fits any class at all.

use super::class_density::ClassDensity;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

/// Labelled features of one class: (ln amplitude, ln damping, ln frequency) of fits with the phase
/// held, or with the phase free and last. `noise`: the covariance of a fit at the class's mean.
#[derive(Clone, Debug)]
pub struct Examples {
    pub features: Vec<Vec<f64>>,
    pub noise: DMatrix<f64>,
}

/// Densities of the classes.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Posterior {
    /// Whether the phase is a feature: chosen in training, by which predicts held-out labels better.
    pub phase: bool,
    /// Log densities are divided by this before they are compared: 1 where the densities are right,
    /// more where they promise too much. Chosen in training on held-out signals.
    pub temperature: f64,
    /// Squared distance from every class beyond which a signal fits none.
    pub reach: f64,
    pub classes: Vec<ClassDensity>,
}

/// Temperatures tried.
const TEMPERATURES: [f64; 7] = [1.0, 1.1, 1.2, 1.35, 1.5, 1.75, 2.0];

/// A signal further than this from every class fits none (1e-5 of chi-squared, 4 degrees of freedom),
/// unless training signals lie further out themselves: sizes of a fault lie on a curve, not on an axis.
const FITS_NONE: f64 = 28.5;
/// Room beyond the outermost training signal.
const ROOM: f64 = 4.0;

impl Posterior {
    /// Learns the densities of the same signals fitted with the phase held and free, and keeps what
    /// predicts better. `None`: a class without examples, or all of one.
    pub fn learn(held: &[Examples], free: &[Examples]) -> Option<Posterior> {
        let (of_held, of_free) = (held_out(held), held_out(free));
        let phase = of_free.0 > of_held.0;
        let examples = if phase { free } else { held };
        let classes = densities(examples)?;
        let temperature = if phase { of_free.1 } else { of_held.1 };
        let outermost = examples
            .iter()
            .flat_map(|class| &class.features)
            .map(|x| nearest(&classes, x))
            .fold(0.0, f64::max);
        let reach = FITS_NONE.max(ROOM * outermost);
        Some(Posterior { phase, temperature, reach, classes })
    }

    /// Coordinates of the features that it takes.
    pub fn coordinates(&self) -> usize {
        if self.phase { 4 } else { 3 }
    }

    /// Refused if it could not have been learned.
    pub fn check(&self, classes: usize) -> Result<(), String> {
        if self.classes.len() != classes {
            return Err(format!("`posterior` has {} classes of {classes}", self.classes.len()));
        }
        if !(1.0..=100.0).contains(&self.temperature) {
            return Err(format!("`posterior.temperature` = {}: 1 to 100", self.temperature));
        }
        if !(self.reach.is_finite() && self.reach > 0.0) {
            return Err(format!("`posterior.reach` = {}: must be positive", self.reach));
        }
        self.classes.iter().try_for_each(|class| class.check(self.coordinates()))
    }

    /// Posterior of each class; sums to 1. `priors`: of each class.
    pub fn weigh(&self, features: &[f64], priors: &[f64], weights: &mut [f64]) {
        weigh(&self.classes, self.temperature, features, weights);
        weights.iter_mut().zip(priors).for_each(|(w, prior)| *w *= prior);
        let sum: f64 = weights.iter().sum();
        weights.iter_mut().for_each(|w| *w /= sum);
    }

    /// No class is near: an unknown fault.
    pub fn fits_none(&self, features: &[f64]) -> bool {
        nearest(&self.classes, features) > self.reach
    }
}

/// Squared distance from the nearest class.
fn nearest(classes: &[ClassDensity], x: &[f64]) -> f64 {
    classes.iter().map(|class| class.distance(x)).fold(f64::INFINITY, f64::min)
}

fn weigh(classes: &[ClassDensity], temperature: f64, x: &[f64], weights: &mut [f64]) {
    for (w, class) in weights.iter_mut().zip(classes) {
        *w = class.ln_density(x) / temperature;
    }
    let most = weights.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    weights.iter_mut().for_each(|w| *w = (*w - most).exp());
    let sum: f64 = weights.iter().sum();
    weights.iter_mut().for_each(|w| *w /= sum);
}

fn densities(examples: &[Examples]) -> Option<Vec<ClassDensity>> {
    let pooled = pooled_covariance(examples)?;
    examples
        .iter()
        .map(|class| {
            let features: Vec<DVector<f64>> =
                class.features.iter().map(|x| DVector::from_row_slice(x)).collect();
            ClassDensity::learn(&features, &class.noise, Some(&pooled))
        })
        .collect()
}

/// Mean log posterior of the true class on the half that was not learned from, both halves, at the
/// temperature that makes it largest; and that temperature.
fn held_out(examples: &[Examples]) -> (f64, f64) {
    let half = |odd: usize| -> Vec<Examples> {
        let pick = |class: &Examples| Examples {
            features: class.features.iter().skip(odd).step_by(2).cloned().collect(),
            noise: class.noise.clone(),
        };
        examples.iter().map(pick).collect()
    };
    let mut scores = [0.0; TEMPERATURES.len()];
    let mut weights = vec![0.0; examples.len()];
    for (learn, test) in [(0, 1), (1, 0)] {
        let Some(classes) = densities(&half(learn)) else { return (f64::NEG_INFINITY, 1.0) };
        for (truth, class) in half(test).iter().enumerate() {
            for x in &class.features {
                for (score, temperature) in scores.iter_mut().zip(TEMPERATURES) {
                    weigh(&classes, temperature, x, &mut weights);
                    *score += weights[truth].max(1e-6).ln() / class.features.len() as f64;
                }
            }
        }
    }
    let best = (0..scores.len()).max_by(|&i, &j| scores[i].total_cmp(&scores[j])).unwrap_or(0);
    (scores[best], TEMPERATURES[best])
}

/// Covariance of all examples about their own class's mean.
fn pooled_covariance(examples: &[Examples]) -> Option<DMatrix<f64>> {
    let size = examples.first()?.noise.nrows();
    let (mut scatter, mut degrees) = (DMatrix::zeros(size, size), 0.0);
    for class in examples {
        let n = class.features.len() as f64;
        let rows: Vec<DVector<f64>> =
            class.features.iter().map(|x| DVector::from_row_slice(x)).collect();
        let mean = rows.iter().fold(DVector::zeros(size), |s, x| s + x) / n.max(1.0);
        for x in &rows {
            let d = x - &mean;
            scatter += &d * d.transpose();
        }
        degrees += (n - 1.0).max(0.0);
    }
    (degrees > 0.0).then(|| scatter / degrees)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    /// Classes that differ in the third coordinate and, where it tells, in the fourth.
    fn examples(n: usize, phase: Option<f64>, seed: u64) -> Vec<Examples> {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let size = if phase.is_some() { 4 } else { 3 };
        (0..3)
            .map(|class| Examples {
                features: (0..n)
                    .map(|_| {
                        let mut x: Vec<f64> = (0..size).map(|_| 0.1 * normal()).collect();
                        x[2] += 0.15 * class as f64;
                        if let Some(step) = phase {
                            x[3] += step * class as f64;
                        }
                        x
                    })
                    .collect(),
                noise: DMatrix::identity(size, size) * 0.0025,
            })
            .collect()
    }

    #[test]
    fn phase_is_used_where_it_tells_the_classes_apart() {
        let held = examples(100, None, 1);
        assert!(Posterior::learn(&held, &examples(100, Some(0.3), 1)).unwrap().phase);
    }

    #[test]
    fn posterior_is_calibrated_on_fresh_signals() {
        let held = examples(400, None, 2);
        let posterior = Posterior::learn(&held, &held).unwrap();
        let (mut claimed, mut right, mut n) = (0.0, 0.0, 0.0);
        let mut weights = [0.0; 3];
        for (truth, class) in examples(3000, None, 3).iter().enumerate() {
            for x in &class.features {
                posterior.weigh(x, &[1.0 / 3.0; 3], &mut weights);
                assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
                let best = (0..3).max_by(|&i, &j| weights[i].total_cmp(&weights[j])).unwrap();
                claimed += weights[best];
                right += f64::from(u8::from(best == truth));
                n += 1.0;
            }
        }
        assert!((claimed - right).abs() / n < 0.015, "claimed {claimed}, right {right} of {n}");
    }

    #[test]
    fn what_is_far_from_every_class_fits_none() {
        let held = examples(100, None, 4);
        let posterior = Posterior::learn(&held, &examples(100, Some(0.0), 4)).unwrap();
        let far = [3.0, 0.0, 0.0, 0.0];
        let near = [0.0, 0.0, 0.15, 0.0];
        let size = if posterior.phase { 4 } else { 3 };
        assert!(posterior.fits_none(&far[..size]));
        assert!(!posterior.fits_none(&near[..size]));
    }
}
