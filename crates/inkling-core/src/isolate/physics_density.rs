//! The physics' density of a ring's features in each fault class, and in each alternative that is
//! no class. thesis §2-2.
//!
//! In: once the fault curves ([`super::fault_physics`]) and the distribution of severities in each
//! class; then the four features x of a signal and the [`Conditions`] under which it was acquired.
//! Out: a [`Comparison`]: ln density of x in every class and every alternative, and the densities
//! at the single nodes, by which [`super::severity`] estimates how severe the fault is. The density
//! in a class is an integral over severities, a sum over the nodes of its curve:
//!
//! ```text
//! p(x | class) = sum over nodes i of share_i p(x | node i),    sum of share_i = 1
//! ```
//!
//! p(x | node i) is a Gaussian about the curve. share_i mixes three distributions of the severity,
//! weighted in numbers of signals: uniform over the range that the class's name means
//! (`name_counts`), as the labelled signals have it (n), and uniform over the whole curve (1).

use super::alternatives::Alternative;
use super::fault_curve::{Conditions, HealthySpread, Node};
use super::node_columns::{self, ComparedBlock, NODES, NodeColumns, NodeDensities, OfNodes};
use super::posterior::sum_of;
use super::tuned;
use crate::model::faults::Law;
use crate::processor::for_processor;
use crate::verdict::Appearance;
use nalgebra::{Matrix4, Vector2, Vector4};

#[derive(Clone, Debug)]
pub struct FaultCurves {
    /// Per class its kinds of fault (empty: of no law, or none that rings), and behind the classes
    /// the alternatives, each as if it were a class.
    classes: Vec<Vec<SeverityPrior>>,
    /// In the order in which they stand behind the classes.
    alternatives: Vec<Weighted>,
    pub(super) curves: Vec<NodeColumns>,
    /// Of each curve.
    pub(super) guesses: Vec<Guess>,
    healthy: HealthySpread,
}

/// How uncertain sizes are beyond what a signal tells, since no label of the kind has one.
#[derive(Clone, Copy, Debug, Default)]
pub struct Guess {
    /// The severity of no fault.
    pub none: f64,
    /// Standard deviation, as a share of what the fault changes.
    pub share: f64,
}

#[derive(Clone, Debug)]
struct Weighted {
    what: Alternative,
    weight: f64,
    ln_weight: f64,
}

/// One kind of fault that a class stands for.
#[derive(Clone, Debug)]
pub struct SeverityPrior {
    pub curve: usize,
    /// Probability of each node; the sum over all kinds of the class is about 1.
    pub share: Vec<OfNodes>,
}

#[derive(Clone, Copy, Debug)]
pub struct Member<'a> {
    pub law: &'a Law,
    pub curve: usize,
}

#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct LabelledSeverities {
    /// Number of signals, where all of one channel count together as one.
    pub n: f64,
    /// Quantiles of the severities, ascending; at most 64.
    pub severities: Vec<f64>,
}

const MOST_QUANTILES: usize = 64;

impl LabelledSeverities {
    /// Of pairs of severity and weight; severities that are not finite are left out.
    pub fn new(mut severities: Vec<(f64, f64)>) -> LabelledSeverities {
        severities.retain(|(s, _)| s.is_finite());
        severities.sort_unstable_by(|p, q| p.0.total_cmp(&q.0));
        let n: f64 = severities.iter().map(|(_, w)| w).sum();
        let kept = severities.len().min(MOST_QUANTILES);
        let (mut quantiles, mut below) = (Vec::with_capacity(kept), 0.0);
        // below quantile number i lies the share (i + 1/2) / kept of the weight
        for (severity, weight) in severities {
            below += weight;
            while quantiles.len() < kept
                && below * kept as f64 >= (quantiles.len() as f64 + 0.5) * n
            {
                quantiles.push(severity);
            }
        }
        LabelledSeverities { n, severities: quantiles }
    }
}

impl FaultCurves {
    pub fn new(classes: usize, healthy: HealthySpread) -> FaultCurves {
        FaultCurves {
            classes: vec![Vec::new(); classes],
            alternatives: Vec::new(),
            curves: Vec::new(),
            guesses: Vec::new(),
            healthy,
        }
    }

    /// The curves for one channel whose own healthy level, its baseline ([`Conditions::baseline`],
    /// not needed here), is the mean of the features of `signals` healthy signals. `shot`:
    /// covariance of one channel's signals beyond the noise. `None`: a covariance is singular. This
    /// is a Kalman update: the channel's own changes have the prior covariance S of all channels,
    /// and the baseline = slope changes + error observes them. With the gain K = S slope' (slope S
    /// slope' + error)^-1 they are K baseline, with the covariance S - K slope S.
    pub fn of_one_channel(&self, shot: &Matrix4<f64>, signals: f64) -> Option<FaultCurves> {
        let HealthySpread { slope, channels, phase, noise, .. } = &self.healthy;
        // covariance of the baseline's error, and of the baseline in all
        let of_baseline = (noise + shot) / signals;
        let mut all = slope * channels * slope.transpose() + of_baseline;
        all[(3, 3)] += phase;
        let gain = channels * slope.transpose() * all.try_inverse()?;
        let left = channels - gain * slope * channels;
        // rounding leaves the covariance not quite symmetric
        let left = (left + left.transpose()) * 0.5;
        let mut own = self.clone();
        for curve in &mut own.curves {
            let nodes = curve.nodes.iter().map(|node| node.of_one_channel(&gain, &left, shot));
            *curve = NodeColumns::of(nodes.collect::<Option<_>>()?);
        }
        Some(own)
    }

    pub fn add(&mut self, curve: Vec<Node>, guess: Guess) -> usize {
        self.curves.push(NodeColumns::of(curve));
        self.guesses.push(guess);
        self.curves.len() - 1
    }

    /// Gives class number `k` the curves of its members, which are equally likely, with severities
    /// distributed as the header says. `seen` counts only if all are of one kind, with one unit.
    pub fn set(&mut self, k: usize, members: &[Member], seen: Option<&LabelledSeverities>) {
        let mut curves: Vec<usize> = members.iter().map(|member| member.curve).collect();
        curves.sort_unstable();
        curves.dedup();
        let seen = seen.filter(|_| curves.len() == 1);
        let n = seen.map_or(0.0, |seen| seen.n);
        let of_curve = |&curve: &usize| {
            let nodes = &self.curves[curve].nodes;
            let own: Vec<&Law> =
                members.iter().filter(|m| m.curve == curve).map(|m| m.law).collect();
            let part = own.len() as f64 / members.len() as f64;
            // Each distribution is scaled to the sum 1 and counts as so many signals, over the
            // number of all; without mass on the curve it adds nothing.
            let mut share = vec![0.0; nodes.len()];
            let mut add = |counted: f64, shares: Vec<f64>| {
                let sum: f64 = shares.iter().sum();
                if sum > 0.0 {
                    let by = counted / sum / (tuned::NAME_COUNTS + n + tuned::ONE_EXAMPLE);
                    share.iter_mut().zip(shares).for_each(|(share, s)| *share += by * s);
                }
            };
            for law in &own {
                add(tuned::NAME_COUNTS * part / own.len() as f64, uniform_in_range(nodes, law));
            }
            if let Some(seen) = seen {
                add(n, as_labelled(nodes, own[0], seen));
            }
            let of_curve = nodes.iter().map(|node| node.length * node.weight);
            add(tuned::ONE_EXAMPLE * part, of_curve.collect());
            SeverityPrior { curve, share: NodeColumns::in_blocks(&share) }
        };
        self.classes[k] = curves.iter().map(of_curve).collect();
    }

    /// `weight`: its a priori share of what is flagged; `share`: of each node, up to a factor.
    pub(super) fn add_alternative(
        &mut self,
        what: Alternative,
        weight: f64,
        curve: Vec<Node>,
        share: &[f64],
    ) {
        let sum: f64 = share.iter().sum();
        let share: Vec<f64> = share.iter().map(|share| share / sum).collect();
        let curve = self.add(curve, Guess::default());
        self.classes.push(vec![SeverityPrior { curve, share: NodeColumns::in_blocks(&share) }]);
        self.alternatives.push(Weighted { what, weight, ln_weight: weight.ln() });
    }

    /// `ring`: how ln damping and ln frequency of the healthy ring have changed.
    pub fn changed(&self, ring: [f64; 2]) -> Vector2<f64> {
        self.healthy.change * Vector2::from(ring)
    }

    pub fn class(&self, k: usize) -> &[SeverityPrior] {
        self.classes.get(k).map_or(&[], Vec::as_slice)
    }

    /// A priori share, of what is flagged, of what is of no class.
    pub fn of_no_class(&self) -> f64 {
        tuned::NO_CLASS + self.alternatives.iter().map(|of| of.weight).sum::<f64>()
    }

    /// What an alternative is, by its number in [`Comparison::ln_alternatives`].
    pub fn alternative(&self, number: usize) -> &Alternative {
        &self.alternatives[number].what
    }

    /// The contrast that explains the features best, whatever its weight, if by the physics it is
    /// about as likely as a class: a twin, which one decay does not tell from it. `ln_class`: by
    /// the physics, since labelled signals make a class narrower and say nothing of the twin.
    pub fn twin(&self, ln_alternatives: &[f64], ln_class: f64) -> Option<usize> {
        let contrasts = self.alternatives.iter().zip(ln_alternatives).enumerate();
        let contrasts =
            contrasts.filter(|(_, (of, _))| matches!(of.what, Alternative::Contrast(_)));
        let densities = contrasts.map(|(number, (of, ln))| (number, ln - of.ln_weight));
        let (number, ln) = densities.max_by(|p, q| p.1.total_cmp(&q.1))?;
        (ln_class.is_finite() && ln >= ln_class + Appearance::AS_WELL.ln()).then_some(number)
    }

    pub fn compare(&self, features: &[f64], conditions: Conditions, out: &mut Comparison) {
        let x = Vector4::from_column_slice(features);
        compare(self, &x, conditions, out);
    }
}

for_processor! {
    fn compare(of: &FaultCurves, x: &Vector4<f64>, conditions: Conditions, out: &mut Comparison) { portable }
}

#[inline(always)] // body of `compare`, compiled once per instruction set
fn portable(of: &FaultCurves, x: &Vector4<f64>, conditions: Conditions, out: &mut Comparison) {
    let Comparison { ln_densities, ln_alternatives, of_curves, compared } = out;
    ln_densities.clear();
    ln_densities.resize(of.classes.len(), 0.0);
    of_curves.resize(of.curves.len(), CurveComparison::default());

    // of every curve the densities at the nodes, up to the factor e^`ln_scale`
    for (columns, of) in of.curves.iter().zip(&mut *of_curves) {
        node_columns::compare(columns, x, conditions, compared);
        of.ln_scale =
            node_columns::densities(columns, compared, &mut of.densities) - LN_TAU_SQUARED;
    }

    // per class the mean of the densities over its severities, of each kind up to e^`ln_scale`
    for (kinds, ln_density) in of.classes.iter().zip(&mut *ln_densities) {
        let of_kind = |sizes: &SeverityPrior| {
            let of = &of_curves[sizes.curve];
            // negligible where all nodes are, or the class has none of these severities
            let expectation = sizes.expectation(&of.densities);
            (expectation > f32::MIN_POSITIVE.into()).then(|| of.ln_scale + expectation.ln())
        };
        *ln_density = kinds.iter().filter_map(of_kind).fold(f64::NEG_INFINITY, sum_of);
    }

    // the alternatives are moved to their own list, weighted
    let classes = of.classes.len() - of.alternatives.len();
    ln_alternatives.clear();
    ln_alternatives.extend(
        ln_densities.drain(classes..).zip(&of.alternatives).map(|(p, of)| p + of.ln_weight),
    );
}

/// A signal compared with all fault curves; buffers that are used again.
#[derive(Clone, Debug, Default)]
pub struct Comparison {
    /// ln density of the features in every class; -infinity where all nodes are negligible.
    pub ln_densities: Vec<f64>,
    /// ln of the density in every alternative times the alternative's weight.
    pub ln_alternatives: Vec<f64>,
    pub of_curves: Vec<CurveComparison>,
    compared: Vec<ComparedBlock>,
}

#[derive(Clone, Debug, Default)]
pub struct CurveComparison {
    /// Of those blocks that are not negligible.
    pub densities: Vec<NodeDensities>,
    /// ln of the factor that `densities` leave out.
    ln_scale: f64,
}

impl SeverityPrior {
    #[inline(always)] // compiled once per instruction set
    fn expectation(&self, densities: &[NodeDensities]) -> f64 {
        let mut sums = [0.0; NODES];
        for of in densities {
            let share = &self.share[of.block];
            for i in 0..NODES {
                sums[i] += share[i] * of.of[i];
            }
        }
        node_columns::sum(&sums).into()
    }
}

/// Per node the length, in the coordinate of [`Law::scale`], of that part of its interval which
/// lies in the range that the law's name means, times the node's weight. Not normalised.
pub(super) fn uniform_in_range(nodes: &[Node], law: &Law) -> Vec<f64> {
    let [one, other] = law.range.map(|severity| law.scale(severity));
    let (low, high) = (one.min(other), one.max(other));
    let inside = |node: &Node| {
        let half = 0.5 * node.length;
        node.weight * (high.min(node.place + half) - low.max(node.place - half)).max(0.0)
    };
    nodes.iter().map(inside).collect()
}

/// Per node a kernel density of the labels times the node's length and weight. Not normalised.
fn as_labelled(nodes: &[Node], law: &Law, seen: &LabelledSeverities) -> Vec<f64> {
    let places: Vec<f64> = seen.severities.iter().map(|&s| law.scale(s)).collect();
    let width = bandwidth(&places, seen.n);
    let density = |node: &Node| {
        let kernel = |at: &f64| (-0.5 * ((node.place - at) / width).powi(2)).exp();
        node.length * node.weight * places.iter().map(kernel).sum::<f64>()
    };
    nodes.iter().map(density).collect()
}

/// `places`: the labelled severities in the coordinate of [`Law::scale`]; `n`: number of signals,
/// which may exceed that of quantiles. sd n^-.35 is narrower than Silverman's rule, because
/// severities fill a range; the exponent, and the .1 for one severity, are somewhat arbitrary.
fn bandwidth(places: &[f64], n: f64) -> f64 {
    let m = places.len() as f64;
    if places.len() < 2 {
        return 0.1;
    }
    let mean = places.iter().sum::<f64>() / m;
    let sd = (places.iter().map(|p| (p - mean).powi(2)).sum::<f64>() / (m - 1.0)).sqrt();
    (sd * n.powf(-0.35)).max(1e-3)
}

pub const LN_TAU_SQUARED: f64 = 3.675_754_132_818_691;

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn severities_are_smoothed_in_their_own_unit_and_less_the_more_there_are() {
        let places = [0.3, 0.5, 0.6, 0.9];
        let width = bandwidth(&places, 4.0);
        for (by, off) in [(1.0, 7.0), (3.0, -2.0)] {
            let moved = places.map(|p| by * p + off);
            assert!((bandwidth(&moved, 4.0) / (by * width) - 1.0).abs() < 1e-9);
        }
        assert!(bandwidth(&places, 400.0) < 0.25 * width);
        // the variance of two severities that lie a unit apart is a half
        let two = bandwidth(&[0.0, 1.0], 1.0);
        assert!((two * two - 0.5).abs() < 1e-12, "{two}");
        assert!(bandwidth(&[0.4], 1.0) > 0.0 && bandwidth(&[0.4; 9], 9.0) > 0.0);
    }

    #[test]
    fn severities_of_a_name_are_shared_out_to_the_nodes_whole() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(6);
        let mut nodes = Node::drawn(50, &mut rng);
        // from -6 to 6, without a gap
        for (i, node) in nodes.iter_mut().enumerate() {
            (node.place, node.length) = (-6.0 + 0.24 * (i as f64 + 0.5), 0.24);
        }
        for class in crate::fault::CLASSES {
            let law = crate::model::faults::law(class).unwrap();
            let [low, high] = law.range.map(|s| law.scale(s).clamp(-6.0, 6.0));
            let shares = uniform_in_range(&nodes, law);
            assert!((shares.iter().sum::<f64>() - (high - low)).abs() < 1e-12, "{class}");
            for (node, share) in nodes.iter().zip(&shares) {
                let outside = node.place + 0.12 < low || node.place - 0.12 > high;
                assert!((0.0..=0.24 + 1e-12).contains(share) && !(outside && *share > 0.0));
            }
        }
    }
}
