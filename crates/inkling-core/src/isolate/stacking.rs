//! Learns a [`Posterior`] from labelled signals and from what the physics predicts for them.
//!
//! In: labelled features per class, and the physics' ln densities of them. Out: the posterior's
//! learned densities, the weights of the physics, and the temperature:
//!
//! 1. Cross-validation gives, for each example, the learned densities that have not seen it.
//! 2. `share`, the weight of the physics, predicts the held-out examples best, by expectation
//!    maximisation: first one for all classes, then one per class with the first as its prior.
//! 3. The temperature, 1 or more, makes the held-out posteriors likeliest.

use super::class_density::{ClassDensity, mean_and_scatter};
use super::posterior::{Posterior, ln_or_none, sum_of, to_posterior};
use super::tuned;
use crate::numbers::FEW;
use nalgebra::{DMatrix, DVector};
use std::sync::OnceLock;

#[derive(Clone, Debug)]
pub struct Examples {
    /// Of each signal, relative to the healthy ring.
    pub features: Vec<DVector<f64>>,
    /// Covariance of a fit's noise at the class's mean.
    pub noise: DMatrix<f64>,
    /// Whether they suffice for the ends of a range; inherited by a subset for cross-validation.
    pub tell_ends: bool,
}

impl Examples {
    pub fn new(features: Vec<DVector<f64>>, noise: DMatrix<f64>) -> Examples {
        let tell_ends = features.len() >= tuned::TELL_ENDS;
        Examples { features, noise, tell_ends }
    }
}

/// Of each example of a class the ln density in every class.
type Rows = Vec<Vec<f64>>;

const TEMPERATURES: [f64; 10] = [1.0, 1.1, 1.2, 1.35, 1.5, 1.75, 2.0, 2.5, 3.5, 5.0];

/// Plausible is a temperature whose ln likelihood is lower than the largest by this at most: 1.645²
/// / 2, that is 95 % confidence on one side.
const PLAUSIBLE: f64 = 1.35;

/// With so many examples of every class, two folds suffice.
const FEWEST_HALVED: usize = 100;

impl Posterior {
    /// Learns the densities without the physics. `None`: a class has too few examples.
    pub fn learn(examples: &[Examples]) -> Option<Posterior> {
        // the physics has a density of 0 everywhere
        let far = vec![f64::NEG_INFINITY; examples.len()];
        let rows = |e: &Examples| vec![far.clone(); e.features.len()];
        let none: Vec<Rows> = examples.iter().map(rows).collect();
        let examples: Vec<Option<Examples>> = examples.iter().cloned().map(Some).collect();
        Posterior::stack(&examples, &none, &vec![false; examples.len()])
    }

    /// Learns the densities where only some classes have a density by the physics (`in_physics`),
    /// and only some have examples. `physics`: per class and example, the physics' ln density of
    /// that example in every class (n_f numbers). `None`: a class has neither density. The prior of
    /// the one weight of all classes counts as `few` examples that the physics alone explains; that
    /// weight, as `few` examples, is the prior of each class's own (stacking, Wolpert 1992). So the
    /// physics keeps its weight as far as it predicts the examples.
    pub fn stack(
        examples: &[Option<Examples>],
        physics: &[Rows],
        in_physics: &[bool],
    ) -> Option<Posterior> {
        // few examples are divided into more folds, so that each fold leaves out few
        let learned = some_densities(examples);
        let fewest = examples.iter().flatten().map(|e| e.features.len()).min().unwrap_or(0);
        let parts = if fewest < FEWEST_HALVED { fewest.clamp(2, 10) } else { 2 };
        let unseen = unseen(examples, physics, parts);
        if (0..examples.len()).any(|k| learned[k].is_none() && !in_physics[k]) {
            return None;
        }

        // An example's ln density in its own class as learned without it, and by the physics. Only
        // classes with both densities say anything of the weight of all.
        let pairs = |k: usize| unseen[k].iter().zip(&physics[k]).map(move |(l, p)| (l[k], p[k]));
        let has_both = |k: &usize| learned[*k].is_some() && in_physics[*k];
        let of_all = share(1.0, (0..examples.len()).filter(has_both).flat_map(pairs));
        let physics_share: Vec<f64> = (0..examples.len())
            .map(|k| match (&learned[k], in_physics[k]) {
                (_, false) => 0.0,
                (None, true) => 1.0,
                (Some(_), true) => share(of_all, pairs(k)),
            })
            .collect();

        let held_out = temperature(fewest < tuned::TELL_ENDS, &unseen, physics, &physics_share);
        let temperature = if fewest >= FEW { held_out } else { 1.0 };
        let ln_shares = OnceLock::new();
        Some(Posterior { temperature, classes: learned, physics_share, of_own: None, ln_shares })
    }
}

/// `examples`: pairs of ln densities (learned, physics); `before`: the prior mean, which counts as
/// `few` examples. An example that has no density by either counts against the physics.
fn share(before: f64, examples: impl Iterator<Item = (f64, f64)> + Clone) -> f64 {
    let mut share = 0.5 * before;
    for _ in 0..50 {
        let (mut sum, mut n) = (FEW as f64 * before, FEW as f64);
        for (learned, physics) in examples.clone() {
            let all = mixed(learned, physics, share);
            if all.is_finite() {
                sum += (physics + share.ln() - all).exp();
            }
            n += 1.0;
        }
        share = (sum / n).clamp(1e-6, 1.0);
    }
    share
}

/// ln of the mixture of two densities, given by their ln. `share`: weight of the physics' density.
fn mixed(learned: f64, physics: f64, share: f64) -> f64 {
    sum_of(learned + (1.0 - share).ln(), physics + share.ln())
}

/// All examples but those whose number modulo `parts` is `part`; `None`: none is left.
fn without(class: &Examples, part: usize, parts: usize) -> Option<Examples> {
    let kept = class.features.iter().enumerate().filter(|(i, _)| i % parts != part);
    let features: Vec<DVector<f64>> = kept.map(|(_, x)| x.clone()).collect();
    let of = |features| Examples { features, noise: class.noise.clone(), ..*class };
    (!features.is_empty()).then(|| of(features))
}

/// Per class and example the ln density in every class, learned without the example's fold;
/// -infinity where none could be learned. `physics`: for its shape only, which the result has.
fn unseen(examples: &[Option<Examples>], physics: &[Rows], parts: usize) -> Vec<Rows> {
    let mut unseen = physics.to_vec();
    for part in 0..parts {
        let rest: Vec<_> =
            examples.iter().map(|e| e.as_ref().and_then(|e| without(e, part, parts))).collect();
        let rest = some_densities(&rest);
        for (class, rows) in examples.iter().zip(&mut unseen) {
            let Some(class) = class else { continue };
            for (x, row) in class.features.iter().zip(rows).skip(part).step_by(parts) {
                *row = rest.iter().map(|d| ln_or_none(d.as_ref(), x.as_slice())).collect();
            }
        }
    }
    unseen
}

/// The one of `TEMPERATURES` with the largest mean ln posterior of held-out examples in their own
/// class, classes weighted equally; if examples are `scarce` the highest plausible one, since too
/// low a one makes verdicts certain and wrong. `unseen`, `physics`: classes x examples x classes.
fn temperature(scarce: bool, unseen: &[Rows], physics: &[Rows], physics_share: &[f64]) -> f64 {
    let mut weights = vec![0.0; unseen.len()];
    let score = |temperature: f64| -> f64 {
        let of_class = |k: usize| -> f64 {
            let rows = unseen[k].iter().zip(&physics[k]);
            let sum: f64 = rows
                .map(|(learned, physics)| {
                    for (j, w) in weights.iter_mut().enumerate() {
                        *w = mixed(learned[j], physics[j], physics_share[j]);
                    }
                    to_posterior(temperature, &[], &mut weights);
                    weights[k].max(1e-6).ln()
                })
                .sum();
            sum / unseen[k].len().max(1) as f64
        };
        (0..unseen.len()).map(of_class).sum()
    };

    // times the mean number of labelled examples scores are about ln likelihoods (`PLAUSIBLE`)
    let labelled = unseen.iter().filter(|rows| !rows.is_empty()).count();
    let examples = unseen.iter().map(Vec::len).sum::<usize>() as f64 / labelled.max(1) as f64;
    let scores = TEMPERATURES.map(score).map(|score| score * examples);
    let most = scores.into_iter().fold(f64::NEG_INFINITY, f64::max);
    let least = if scarce { most - PLAUSIBLE } else { most };
    let highest = (0..scores.len()).rev().find(|&i| scores[i] >= least);
    highest.map_or(1.0, |i| TEMPERATURES[i])
}

fn some_densities(examples: &[Option<Examples>]) -> Vec<Option<ClassDensity>> {
    let some: Vec<Examples> = examples.iter().flatten().cloned().collect();
    let pooled = pooled_covariance(&some);
    let density = |class: &Examples| {
        ClassDensity::learn(&class.features, &class.noise, pooled.as_ref(), class.tell_ends)
    };
    examples.iter().map(|class| class.as_ref().and_then(density)).collect()
}

/// Covariance of all examples about the mean of their own class. `None`: no class has two.
fn pooled_covariance(examples: &[Examples]) -> Option<DMatrix<f64>> {
    let size = examples.first()?.noise.nrows();
    let (mut scatter, mut degrees) = (DMatrix::zeros(size, size), 0.0);
    for class in examples {
        scatter = mean_and_scatter(&class.features, scatter).1;
        degrees += (class.features.len() as f64 - 1.0).max(0.0);
    }
    (degrees > 0.0).then(|| scatter / degrees)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::normal::draws;

    /// Drawn examples of three classes, which differ in the third coordinate.
    fn examples(n: usize, seed: u64) -> Vec<Examples> {
        let mut normal = draws(seed);
        let mut row = |class: usize| {
            let at = |k: usize| if k == 2 { 0.15 * class as f64 } else { 0.0 };
            DVector::from_fn(3, |k, _| at(k) + 0.1 * normal())
        };
        let mut class = |class: usize| {
            let features = (0..n).map(|_| row(class)).collect();
            Examples::new(features, DMatrix::identity(3, 3) * 0.0025)
        };
        (0..3).map(&mut class).collect()
    }

    #[test]
    fn what_is_pooled_is_the_covariance_about_each_class_itself() {
        let sd = [0.1, 0.3, 0.2];
        let drawn = |far: f64, seed: u64| {
            let mut normal = draws(seed);
            let rows = (0..2000).map(|_| DVector::from_fn(3, |k, _| far + sd[k] * normal()));
            Examples::new(rows.collect(), DMatrix::identity(3, 3))
        };
        let pooled = pooled_covariance(&[drawn(0.0, 1), drawn(50.0, 2), drawn(-9.0, 3)]).unwrap();
        for k in 0..3 {
            assert!((pooled[(k, k)] / (sd[k] * sd[k]) - 1.0).abs() < 0.1, "{pooled}");
        }
        let one = Examples { features: vec![DVector::repeat(3, 1.0)], ..drawn(0.0, 4) };
        assert!(pooled_covariance(&[one]).is_none(), "of one nothing is known");
    }

    #[test]
    fn posterior_is_calibrated_on_fresh_signals() {
        let held = examples(400, 2);
        let posterior = Posterior::learn(&held).unwrap();
        let (mut claimed, mut right, mut n) = (0.0, 0.0, 0.0);
        let mut weights = [0.0; 3];
        for (truth, class) in examples(3000, 3).iter().enumerate() {
            for x in &class.features {
                posterior.weigh(x.as_slice(), &[], &[1.0 / 3.0; 3], &mut Vec::new(), &mut weights);
                assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
                let best = (0..3).max_by(|&i, &j| weights[i].total_cmp(&weights[j])).unwrap();
                claimed += weights[best];
                right += f64::from(u8::from(best == truth));
                n += 1.0;
            }
        }
        assert!((claimed - right).abs() / n < 0.015, "claimed {claimed}, right {right} of {n}");
    }

    /// ln densities of `examples` in every class by a physics that is right, or whose third coordinate is off
    /// by `off`.
    fn by_physics(examples: &[Examples], off: f64) -> Vec<Vec<Vec<f64>>> {
        let ln = |x: &DVector<f64>, k: usize| -> f64 {
            let at = |j: usize| if j == 2 { 0.15 * k as f64 + off } else { 0.0 };
            (0..x.len()).map(|j| -0.5 * ((x[j] - at(j)) / 0.1).powi(2) + 1.383_65).sum()
        };
        let class =
            |e: &Examples| e.features.iter().map(|x| (0..3).map(|k| ln(x, k)).collect()).collect();
        examples.iter().map(class).collect()
    }

    #[test]
    fn the_physics_stands_alone_at_first_and_yields_where_it_is_wrong() {
        let stacked = |n: usize, off: f64| {
            let examples = examples(n, 6);
            let physics = by_physics(&examples, off);
            let labelled: Vec<_> = examples.into_iter().map(Some).collect();
            Posterior::stack(&labelled, &physics, &[true; 3]).unwrap().physics_share
        };
        let none = |n: usize| vec![Vec::new(); n];
        let alone = Posterior::stack(&[None, None, None], &none(3), &[true; 3]).unwrap();
        assert_eq!(alone.physics_share, [1.0; 3]);
        assert!(Posterior::stack(&[None, None], &none(2), &[true, false]).is_none());
        assert!(stacked(5, 0.0).iter().all(|share| *share > 0.6));
        assert!(stacked(200, 0.0).iter().all(|share| *share > 0.5));
        assert!(stacked(200, 1.0).iter().all(|share| *share < 0.1));
    }
}
