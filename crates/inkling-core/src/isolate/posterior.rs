//! A posterior over the fault classes, from the features of a fitted ring: the default method of
//! isolation.
//!
//! In, for training (`design/train.rs`): labelled features per class, and the ln densities that the
//! physics predicts for them. Out: a [`Posterior`], which a design stores. In, for a signal
//! (`design/named_ring.rs`): its features x and the physics' ln densities of x. Out: the
//! probability of each class, given that the signal is of one of them:
//!
//! ```text
//! P(class | x)  proportional to  prior(class) p(x | class)^(1 / temperature)
//! p(x | class)  =  share by_physics(x | class)  +  (1 - share) learned(x | class)
//! ```
//!
//! `learned` is a [`ClassDensity`] from the class's examples, `by_physics` of
//! [`super::physics_density`]. How training finds the rest:
//!
//! 1. Cross-validation gives, for each example, the learned densities that have not seen it
//!    (`unseen`).
//! 2. `share`, the weight of the physics, is that which predicts the held-out examples best, by
//!    expectation maximisation (`share`): first one for all classes, then one per class with the
//!    first as its prior.
//! 3. The temperature is that which makes the held-out posteriors likeliest (`temperature`). It is
//!    1 or more, so it only takes certainty away.

use super::class_density::{ClassDensity, scattered};
use super::tuned;
use crate::model::simd_math::exp;
use crate::numbers::tuned::few;
use crate::processor::for_processor;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};
use std::sync::OnceLock;

/// Labelled examples of one class.
#[derive(Clone, Debug)]
pub struct Examples {
    /// (ln amplitude, ln damping, ln frequency, phase) of each signal, relative to the healthy
    /// ring.
    pub features: Vec<DVector<f64>>,
    /// Covariance of a fit's noise at the class's mean.
    pub noise: DMatrix<f64>,
    /// Whether the examples suffice to estimate the ends of a range, so that the class's density may be
    /// uniform along an axis ([`ClassDensity`]). A subset for cross-validation inherits this, so that it is
    /// judged like the whole.
    pub tell_ends: bool,
}

impl Examples {
    /// The examples of a class; whether they are enough for the ends of a range follows from their
    /// number.
    pub fn new(features: Vec<DVector<f64>>, noise: DMatrix<f64>) -> Examples {
        let tell_ends = features.len() >= tuned::TELL_ENDS;
        Examples { features, noise, tell_ends }
    }
}

/// The class densities of the features, and what turns them into a posterior.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Posterior {
    /// Temperature scaling: ln densities are divided by this before they are compared; 1 where the
    /// densities are calibrated, more where they are overconfident. Training chooses it on held-out
    /// signals. It is 1, too, where some labelled class has fewer than `few` examples.
    pub temperature: f64,
    /// The densities learned from labelled signals; `None`: no signal of the class was labelled, and the
    /// physics' density is used alone.
    pub classes: Vec<Option<ClassDensity>>,
    /// Weight of the physics' density in each class's mixture; empty: 0 in all classes.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub physics_share: Vec<f64>,
    /// A posterior over features relative to their own channels' healthy levels, for signals of
    /// channels whose level is known; `None`: none was learned.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    of_own: Option<Box<Posterior>>,
    /// Per class ln of the weight of the physics' density, and ln of that of the learned one; computed once.
    #[serde(skip)]
    ln_shares: OnceLock<Vec<[f64; 2]>>,
}

/// Number of features of a fitted ring: ln amplitude, ln damping, ln frequency, phase.
const FEATURES: usize = 4;

/// The temperatures among which one is chosen.
const TEMPERATURES: [f64; 10] = [1.0, 1.1, 1.2, 1.35, 1.5, 1.75, 2.0, 2.5, 3.5, 5.0];

/// A temperature is plausible if its ln likelihood is lower than the largest by this at most:
/// 1.645² / 2, that is 95 % confidence on one side.
const PLAUSIBLE: f64 = 1.35;

impl Posterior {
    /// Learns the densities from labelled signals of every class, without the physics. `None`: a class has
    /// too few examples.
    pub fn learn(examples: &[Examples]) -> Option<Posterior> {
        // the physics knows no class: a density of 0 everywhere, with weight 0
        let far = vec![f64::NEG_INFINITY; examples.len()];
        let none: Vec<Vec<Vec<f64>>> =
            examples.iter().map(|e| vec![far.clone(); e.features.len()]).collect();
        let examples: Vec<Option<Examples>> = examples.iter().cloned().map(Some).collect();
        Posterior::stack(&examples, &none, &vec![false; examples.len()])
    }

    /// Learns the densities where the physics has a density for some classes, and where some
    /// classes have no examples. `examples`: per class, `None` without any; `physics`: per class
    /// and example, the physics' ln density of that example in every class (n_f numbers); `known`:
    /// per class, whether the physics has a density for it. `None`: a class has neither density.
    ///
    /// A class's density is a mixture of the learned and the physics' one, with weights by
    /// expectation maximisation on held-out examples (stacking, Wolpert 1992). First one weight is
    /// found from the examples of all classes; its prior counts as `few` examples that the physics
    /// alone explains. Then each class gets its own weight, with the weight of all as the prior,
    /// which counts as `few` examples again. So the physics stands nearly alone at first, and keeps
    /// its weight as far as it predicts the examples.
    pub fn stack(
        examples: &[Option<Examples>],
        physics: &[Vec<Vec<f64>>],
        known: &[bool],
    ) -> Option<Posterior> {
        // Learn from all examples, and once more without each fold, for densities that have not
        // seen the example. Few examples are divided into more folds, so that each fold leaves out
        // few.
        let learned = some_densities(examples);
        let fewest = examples.iter().flatten().map(|e| e.features.len()).min().unwrap_or(0);
        let parts = if fewest < FEWEST_HALVED { fewest.clamp(2, 10) } else { 2 };
        let unseen = unseen(examples, physics, parts);
        if (0..examples.len()).any(|k| learned[k].is_none() && !known[k]) {
            return None;
        }

        // The physics' weights. Pairs: an example's ln density in its own class as learned without
        // it, and by the physics. Only classes with both densities (`told`) say anything of the
        // weight of all.
        let pairs = |k: usize| unseen[k].iter().zip(&physics[k]).map(move |(l, p)| (l[k], p[k]));
        let told = |k: &usize| learned[*k].is_some() && known[*k];
        // the weight over all classes is the prior of each, which matters where examples are few
        let of_all = share(1.0, (0..examples.len()).filter(told).flat_map(pairs));
        let physics_share: Vec<f64> = (0..examples.len())
            .map(|k| match (&learned[k], known[k]) {
                (_, false) => 0.0,
                (None, true) => 1.0,
                (Some(_), true) => share(of_all, pairs(k)),
            })
            .collect();

        // the temperature, of the mixtures with these weights
        let held_out = temperature(fewest < tuned::TELL_ENDS, &unseen, physics, &physics_share);
        let temperature = if fewest >= few() { held_out } else { 1.0 };
        let ln_shares = OnceLock::new();
        Some(Posterior { temperature, classes: learned, physics_share, of_own: None, ln_shares })
    }

    /// The same posterior, with one over features relative to the channels' own levels beside it.
    pub fn with_own(self, of_own: Option<Posterior>) -> Posterior {
        Posterior { of_own: of_own.map(Box::new), ..self }
    }

    /// Refuses a stored posterior that could not have been learned. `classes`: how many the design
    /// has.
    pub fn check(&self, classes: usize) -> Result<(), String> {
        if self.classes.len() != classes {
            return Err(format!("`posterior` has {} classes of {classes}", self.classes.len()));
        }
        if !(1.0..=100.0).contains(&self.temperature) {
            return Err(format!("`posterior.temperature` = {}: 1 to 100", self.temperature));
        }
        let share = |k: usize| self.physics_share.get(k).copied().unwrap_or(0.0);
        let stands = |(k, class): (usize, &Option<ClassDensity>)| match class {
            Some(_) => (0.0..=1.0).contains(&share(k)),
            None => share(k) == 1.0,
        };
        if !self.classes.iter().enumerate().all(stands) {
            return Err(
                "`posterior`: a class has no density, or `physics_share` is no share".into()
            );
        }
        self.classes.iter().flatten().try_for_each(|class| class.check(FEATURES))?;
        self.of_own.as_ref().map_or(Ok(()), |of_own| of_own.check(classes))
    }

    /// The posterior for signals of a channel whose healthy level is known; their features are relative to
    /// that level.
    pub fn of_own(&self) -> Option<&Posterior> {
        self.of_own.as_deref()
    }

    /// Writes the posterior of each class into `weights` (one number per class). They sum to 1, or
    /// are NaN if the features have no density in any class. `features`: of the signal, four;
    /// `physics`: the physics' ln densities of these in every class, empty where there is no
    /// physics; `priors`: of each class.
    ///
    /// `ln_densities` receives the ln density of the features in every class, before temperature
    /// and priors. A learned density that is negligible is left out, and -infinity stands where
    /// nothing is left.
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

        // ln of the physics' part of each class's density. The largest class density is no less
        // than the largest of these parts.
        let of_physics = |k: usize| physics.get(k).map(|physics| physics + ln_shares[k][0]);
        let largest_part =
            (0..physics.len()).filter_map(of_physics).fold(f64::NEG_INFINITY, f64::max);

        // Most classes are so far away that their learned densities need not be computed. To see
        // which, `weights` holds the squared distances from the classes at first. Classes that are
        // nearly all physics are left out of `nearest`, as their learned density says little.
        let mut nearest = f64::INFINITY;
        for (k, (square, class)) in weights.iter_mut().zip(&self.classes).enumerate() {
            *square = class.as_ref().map_or(f64::INFINITY, |class| class.square(features));
            if share(k) < MOSTLY_PHYSICS {
                nearest = nearest.min(*square);
            }
        }

        // then the ln density of each class
        for (k, (w, class)) in weights.iter_mut().zip(&self.classes).enumerate() {
            let near = *w < nearest + self.temperature * FAR || nearest == f64::INFINITY;
            let physics = of_physics(k);
            // A learned density does not count either if its upper bound is negligible beside the physics'
            // part of the same class, or beside the largest such part.
            let ln_learned = ln_shares[k][1];
            let counts = |class: &&ClassDensity| {
                let highest = ln_learned + class.ln_highest() - 0.5 * *w;
                physics.is_none_or(|ln| {
                    highest > ln - NOTHING && highest > largest_part - self.temperature * NOTHING
                })
            };
            // without any physics the learned density stands alone, else the two are mixed
            let learned = ln_or_none(class.as_ref().filter(|_| near).filter(counts), features);
            *w = physics.map_or(learned, |physics| sum_of(learned + ln_learned, physics));
        }
        ln_densities.clear();
        ln_densities.extend_from_slice(weights);
        to_posterior(self.temperature, priors, weights);
    }
}

/// A class whose squared distance exceeds the nearest class's by this, times the temperature, is
/// negligible: its density is smaller by a factor of e^-60, which is far more than peak densities
/// differ by.
const FAR: f64 = 120.0;
/// ln of the ratio of two densities beyond which the smaller is negligible: e^-17 is below the last digit of
/// a certainty.
const NOTHING: f64 = 17.0;
/// Difference of two ln densities from which on the smaller does not change the sum: e^-40 added to 1 leaves
/// 1.
pub(super) const ROUNDED_AWAY: f64 = 40.0;
/// A class with at least this weight of the physics does not make other classes count as too far
/// away, however near the features are to its learned density.
const MOSTLY_PHYSICS: f64 = 0.999;

/// With at least so many examples of every class, cross-validation with two folds suffices.
const FEWEST_HALVED: usize = 100;

/// The physics' mixture weight that maximises the likelihood of held-out examples times a prior, by
/// 50 rounds of expectation maximisation. `examples`: pairs of ln densities (learned, physics);
/// `before`: the prior mean of the weight, which counts as `few` examples. An example that has no
/// density by either counts, and counts against the physics.
fn share(before: f64, examples: impl Iterator<Item = (f64, f64)> + Clone) -> f64 {
    let mut share = 0.5 * before;
    for _ in 0..50 {
        let (mut sum, mut n) = (few() as f64 * before, few() as f64);
        // expectation: the probability that the example comes from the physics' density
        for (learned, physics) in examples.clone() {
            let all = mixed(learned, physics, share);
            if all.is_finite() {
                sum += (physics + share.ln() - all).exp();
            }
            n += 1.0;
        }
        // maximisation: the mean of these probabilities, those of the prior's `few` examples
        // included
        share = (sum / n).clamp(1e-6, 1.0);
    }
    share
}

/// ln of the mixture of two densities, given by their ln. `share`: weight of the physics' density.
fn mixed(learned: f64, physics: f64, share: f64) -> f64 {
    sum_of(learned + (1.0 - share).ln(), physics + share.ln())
}

/// ln of the sum of two numbers that are given by their ln.
fn sum_of(p: f64, q: f64) -> f64 {
    let (most, other) = if p > q { (p, q) } else { (q, p) };
    if other < most - ROUNDED_AWAY || most == f64::NEG_INFINITY {
        return most;
    }
    most + ((p - most).exp() + (q - most).exp()).ln()
}

/// ln density in a class; -infinity where the class has no density.
fn ln_or_none(class: Option<&ClassDensity>, x: &[f64]) -> f64 {
    class.map_or(f64::NEG_INFINITY, |class| class.ln_density(x))
}

/// All examples of a class but those of fold number `part` of `parts`; `None`: none is left.
/// Examples belong to the folds in turn.
fn without(class: &Examples, part: usize, parts: usize) -> Option<Examples> {
    let kept = class.features.iter().enumerate().filter(|(i, _)| i % parts != part);
    let features: Vec<DVector<f64>> = kept.map(|(_, x)| x.clone()).collect();
    let of = |features| Examples { features, noise: class.noise.clone(), ..*class };
    (!features.is_empty()).then(|| of(features))
}

/// Cross-validation with `parts` folds: per class and example the ln learned density of that
/// example in every class, learned without the example's fold; -infinity in classes of which no
/// density could be learned. `physics`: only its shape is used (classes x examples x classes),
/// which the result has, too.
fn unseen(
    examples: &[Option<Examples>],
    physics: &[Vec<Vec<f64>>],
    parts: usize,
) -> Vec<Vec<Vec<f64>>> {
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

/// The temperature, chosen from `TEMPERATURES` by the mean ln posterior of held-out examples in
/// their own class, with all classes weighted equally and equal priors: the likeliest one, or if
/// examples are `scarce` the highest that is plausible. The likeliest is too low as often as it is
/// too high; where examples are many, it is off by little. Too low a temperature makes verdicts
/// certain and wrong. `unseen`, `physics`: ln densities, classes x examples x classes;
/// `physics_share`: per class.
fn temperature(
    scarce: bool,
    unseen: &[Vec<Vec<f64>>],
    physics: &[Vec<Vec<f64>>],
    physics_share: &[f64],
) -> f64 {
    let mut weights = vec![0.0; unseen.len()];
    // per class the mean ln posterior of its held-out examples, summed over the classes
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

    // The scores are sums of the classes' means. Times the mean number of examples of the labelled
    // classes they are about ln likelihoods, which `PLAUSIBLE` refers to.
    let labelled = unseen.iter().filter(|rows| !rows.is_empty()).count();
    let examples = unseen.iter().map(Vec::len).sum::<usize>() as f64 / labelled.max(1) as f64;
    let scores = TEMPERATURES.map(score).map(|score| score * examples);
    let most = scores.into_iter().fold(f64::NEG_INFINITY, f64::max);
    let least = if scarce { most - PLAUSIBLE } else { most };
    let highest = (0..scores.len()).rev().find(|&i| scores[i] >= least);
    highest.map_or(1.0, |i| TEMPERATURES[i])
}

/// The learned densities of the classes; `None` for a class that has too few examples.
fn some_densities(examples: &[Option<Examples>]) -> Vec<Option<ClassDensity>> {
    let some: Vec<Examples> = examples.iter().flatten().cloned().collect();
    let pooled = pooled_covariance(&some);
    let density = |class: &Examples| {
        ClassDensity::learn(&class.features, &class.noise, pooled.as_ref(), class.tell_ends)
    };
    examples.iter().map(|class| class.as_ref().and_then(density)).collect()
}

/// Turns ln densities into a posterior, in place; into NaN if all of them are -infinity. `priors`: of each
/// class; empty: all are alike.
fn to_posterior(temperature: f64, priors: &[f64], weights: &mut [f64]) {
    // relative to the largest, so that no exponential overflows
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

/// Number of classes whose exponentials are taken together.
const CLASSES: usize = 16;

for_processor! {
    /// Exponentials of some numbers at once; 0 for numbers below -700.
    fn exp_lanes(of: [f64; CLASSES]) -> [f64; CLASSES] { portable }
}

#[inline(always)] // body of `exp_lanes`, compiled once per instruction set
fn portable(of: [f64; CLASSES]) -> [f64; CLASSES] {
    /// Below this the exponential counts as 0.
    const LEAST: f64 = -700.0;
    // a NaN is not less, so it remains one
    of.map(|x| if x < LEAST { 0.0 } else { exp(x) })
}

/// Covariance of all examples about the mean of their own class, the classes pooled. `None`: no
/// class has two examples.
fn pooled_covariance(examples: &[Examples]) -> Option<DMatrix<f64>> {
    let size = examples.first()?.noise.nrows();
    let (mut scatter, mut degrees) = (DMatrix::zeros(size, size), 0.0);
    for class in examples {
        scatter = scattered(&class.features, scatter).1;
        degrees += (class.features.len() as f64 - 1.0).max(0.0);
    }
    (degrees > 0.0).then(|| scatter / degrees)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::normal::draws;

    /// Drawn examples of three classes, which differ in the third coordinate and, if `phase` is given, in the
    /// fourth.
    fn examples(n: usize, phase: Option<f64>, seed: u64) -> Vec<Examples> {
        let mut normal = draws(seed);
        let size = if phase.is_some() { 4 } else { 3 };
        (0..3)
            .map(|class| {
                let row = |_| {
                    let mut x = DVector::from_fn(size, |_, _| 0.1 * normal());
                    x[2] += 0.15 * class as f64;
                    if let Some(step) = phase {
                        x[3] += step * class as f64;
                    }
                    x
                };
                let noise = DMatrix::identity(size, size) * 0.0025;
                Examples::new((0..n).map(row).collect(), noise)
            })
            .collect()
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

    #[test]
    fn posterior_is_calibrated_on_fresh_signals() {
        let held = examples(400, None, 2);
        let posterior = Posterior::learn(&held).unwrap();
        let (mut claimed, mut right, mut n) = (0.0, 0.0, 0.0);
        let mut weights = [0.0; 3];
        for (truth, class) in examples(3000, None, 3).iter().enumerate() {
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
            let examples = examples(n, None, 6);
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
