//! The nodes of a fault curve as a structure of arrays, so that a signal is compared with several
//! nodes at once.
//!
//! In: once the nodes of a curve; then a signal's features and conditions. Out: the densities at all
//! nodes that are not negligible (`Node::ln_density` in the tests), up to a factor. The steps:
//!
//! 1. Nodes are stored in blocks of [`NODES`].
//! 2. For each: the squared Mahalanobis distance and the height of the peak (`Block::compare`). In a
//!    node's axes the covariance is diagonal at any drive.
//! 3. Exponentials relative to the nearest node (`densities`), so that nothing underflows.
//!
//! Differences of features are taken in f64, all else in f32, of which a register holds twice as
//! many. The rounding changes a certainty in its sixth digit.

use super::fault_curve::{Conditions, Node};
use crate::model::simd_math::exp_single;
use nalgebra::Vector4;
use std::f32::consts::{PI, TAU};

/// Number of nodes in a block.
pub const NODES: usize = 16;
pub type OfNodes<T = f32> = [T; NODES];
#[derive(Clone, Debug)]
pub struct NodeColumns {
    pub nodes: Vec<Node>,
    blocks: Vec<Block>,
    ln_determinant: f64,
}

/// [`NODES`] nodes, field by field ([`Node`]), the last filled up with copies of density 0.
#[derive(Clone, Debug)]
struct Block {
    severity: OfNodes<f64>,
    mean: [OfNodes<f64>; 4],
    /// By feature and change, or feature and feature of the baseline.
    by_change: [[OfNodes; 2]; 4],
    by_baseline: [[OfNodes; 4]; 4],
    /// By axis and feature.
    to_axes: [[OfNodes; 4]; 4],
    spread: [OfNodes; 4],
    /// -2 ln of the determinant of the node's `to_axes` over the curve's largest, a part of the
    /// squared distance; infinity for copies. Without logarithms single precision would not do.
    lower: OfNodes,
}

/// A block of nodes that was compared with a signal. The density at node i is `height` e^{-`square`
/// / 2} / (2 pi)^2 times the curve's largest determinant.
#[derive(Clone, Copy, Debug)]
pub struct ComparedBlock {
    pub block: usize,
    /// Squared Mahalanobis distance plus `Block::lower`.
    pub square: OfNodes,
    /// 1 over the root of the product of the variances along the node's axes.
    pub height: OfNodes,
    least: f32,
}

/// Densities at a block's nodes, up to a factor of the curve; 0 where they are negligible.
#[derive(Clone, Copy, Debug)]
pub struct NodeDensities {
    pub block: usize,
    pub of: OfNodes,
}

impl NodeColumns {
    pub fn of(nodes: Vec<Node>) -> NodeColumns {
        let ln_determinants = nodes.iter().map(|node| node.ln_determinant);
        let ln_determinant = ln_determinants.fold(f64::NEG_INFINITY, f64::max);
        NodeColumns {
            blocks: nodes.chunks(NODES).map(|nodes| Block::of(nodes, ln_determinant)).collect(),
            ln_determinant,
            nodes,
        }
    }

    /// Arranges one value per node in blocks; 0 beyond the last node.
    pub fn in_blocks(of: &[f64]) -> Vec<OfNodes> {
        let lane = |values: &[f64], i: usize| values.get(i).copied().unwrap_or(0.0) as f32;
        of.chunks(NODES).map(|values| std::array::from_fn(|i| lane(values, i))).collect()
    }

    pub fn severities(&self, block: usize) -> &OfNodes<f64> {
        &self.blocks[block].severity
    }
}

impl Block {
    /// `ln_determinant`: the curve's largest.
    fn of(nodes: &[Node], ln_determinant: f64) -> Block {
        let of_nodes = |of: &dyn Fn(&Node) -> f64| -> OfNodes<f64> {
            std::array::from_fn(|i| of(&nodes[i.min(nodes.len() - 1)]))
        };
        let singles = |of: &dyn Fn(&Node) -> f64| -> OfNodes { of_nodes(of).map(|of| of as f32) };
        let mut lower = singles(&|node| 2.0 * (ln_determinant - node.ln_determinant));
        lower[nodes.len().min(NODES)..].fill(f32::INFINITY);
        Block {
            severity: of_nodes(&|node| node.severity),
            mean: std::array::from_fn(|k| of_nodes(&|node| node.mean[k])),
            by_change: std::array::from_fn(|k| {
                std::array::from_fn(|j| singles(&|node| node.by_change[(k, j)]))
            }),
            by_baseline: std::array::from_fn(|k| {
                std::array::from_fn(|j| singles(&|node| node.by_baseline[(k, j)]))
            }),
            to_axes: std::array::from_fn(|k| {
                std::array::from_fn(|j| singles(&|node| node.to_axes[(k, j)]))
            }),
            // a larger variance would say no more, and the product of two is still finite in f32
            spread: std::array::from_fn(|k| singles(&|node| node.spread[k].min(1e18))),
            lower,
        }
    }
}

/// A signal's features and conditions, by value, so that they stay in registers.
#[derive(Clone, Copy)]
struct Query {
    x: [f64; 4],
    changed: [f32; 2],
    /// The channel's own level; 0 where none is known.
    own: [f32; 4],
    /// Variance of the noise over that at the reference drive.
    noise: f32,
}

#[inline(always)] // compiled once per instruction set
pub(super) fn compare(
    of: &NodeColumns,
    x: &Vector4<f64>,
    conditions: Conditions,
    out: &mut Vec<ComparedBlock>,
) {
    let noise = (1.0 / (conditions.drive * conditions.drive)) as f32;
    let own = conditions.baseline.copied().unwrap_or_default();
    let (own, changed) = (own.map(|v| v as f32), conditions.changed.map(|v| v as f32));
    let query = Query { x: (*x).into(), changed: changed.into(), own: own.into(), noise };
    match conditions.baseline {
        None => compare_at::<false>(of, query, out),
        Some(_) => compare_at::<true>(of, query, out),
    }
}

/// `compare`, compiled once for curves that move with the baseline and once for others.
#[inline(always)] // compiled once per instruction set
fn compare_at<const OWN: bool>(of: &NodeColumns, query: Query, out: &mut Vec<ComparedBlock>) {
    out.clear();
    let mut nearest = f32::INFINITY;
    for (number, block) in of.blocks.iter().enumerate() {
        let (square, height) = block.compare::<OWN>(query);
        let least = least(&square);
        // negligible beside the nearest node so far; a NaN is, too
        if least <= nearest + 2.0 * NEGLIGIBLE {
            nearest = if least < nearest { least } else { nearest };
            out.push(ComparedBlock { block: number, square, height, least });
        }
    }
}

impl Block {
    #[inline(always)] // compiled once per instruction set
    fn compare<const OWN: bool>(&self, query: Query) -> (OfNodes, OfNodes) {
        let Query { x, changed, own, noise } = query;
        let (mut square, mut height) = ([0.0; NODES], [0.0; NODES]);
        for i in 0..NODES {
            let away = |k: usize| {
                let (by_change, by_baseline) = (&self.by_change[k], &self.by_baseline[k]);
                let mut moved = by_change[0][i] * changed[0] + by_change[1][i] * changed[1];
                if OWN {
                    moved += (by_baseline[0][i] * own[0] + by_baseline[1][i] * own[1])
                        + (by_baseline[2][i] * own[2] + by_baseline[3][i] * own[3]);
                }
                (x[k] - self.mean[k][i]) as f32 - moved
            };

            let mut d = [away(0), away(1), away(2), away(3)];
            // phases of fits lie within -pi .. pi, so one turn suffices
            let turn = if d[3] > PI { TAU } else { 0.0 } - if d[3] < -PI { TAU } else { 0.0 };
            d[3] -= turn;

            let along = |k: usize| {
                let to_axes = &self.to_axes[k];
                let along = to_axes[0][i] * d[0]
                    + to_axes[1][i] * d[1]
                    + to_axes[2][i] * d[2]
                    + to_axes[3][i] * d[3];
                along * along
            };
            let u = [along(0), along(1), along(2), along(3)];
            let spread = |k: usize| self.spread[k][i] + noise;
            let v = [spread(0), spread(1), spread(2), spread(3)];

            // the sum of u_k / v_k, with two divisions instead of four
            let (one, other) = (1.0 / (v[0] * v[1]), 1.0 / (v[2] * v[3]));
            let distance = (u[0] * v[1] + u[1] * v[0]) * one + (u[2] * v[3] + u[3] * v[2]) * other;
            square[i] = distance + self.lower[i];
            height[i] = one.sqrt() * other.sqrt();
        }
        (square, height)
    }
}

#[inline(always)] // compiled once per instruction set
fn least(of: &OfNodes) -> f32 {
    let less = |p: f32, q: f32| if q < p { q } else { p };
    let eight: [f32; 8] = std::array::from_fn(|i| less(less(f32::INFINITY, of[i]), of[i + 8]));
    let four: [f32; 4] = std::array::from_fn(|i| less(eight[i], eight[i + 4]));
    less(less(four[0], four[1]), less(four[2], four[3]))
}

/// The sum of all values, in a fixed order, so that it is the same on every processor.
#[inline(always)] // compiled once per instruction set
pub(super) fn sum<T: Copy + std::ops::Add<Output = T>>(of: &OfNodes<T>) -> T {
    let eight: [T; 8] = std::array::from_fn(|i| of[i] + of[i + 8]);
    let four: [T; 4] = std::array::from_fn(|i| eight[i] + eight[i + 4]);
    (four[0] + four[1]) + (four[2] + four[3])
}

/// A node whose ln density is lower than the largest by more than this is negligible.
const NEGLIGIBLE: f32 = 30.0;

/// Writes the densities at the nodes that are not negligible, relative to the nearest node, to
/// `out`. Returns ln of the factor that they leave out, without 1 / (2 pi)².
#[inline(always)] // compiled once per instruction set
pub(super) fn densities(
    columns: &NodeColumns,
    compared: &[ComparedBlock],
    out: &mut Vec<NodeDensities>,
) -> f64 {
    out.clear();
    let nearest =
        compared.iter().fold(f32::INFINITY, |m, of| if of.least < m { of.least } else { m });
    for ComparedBlock { block, square, height, least } in compared {
        // a NaN is never below, so it does not count
        let near = *least < nearest + 2.0 * NEGLIGIBLE;
        if !near {
            continue;
        }
        let mut densities = [0.0; NODES];
        for i in 0..NODES {
            let less = 0.5 * (nearest - square[i]);
            let counts = less > -NEGLIGIBLE;
            let exp = exp_single(if counts { less } else { 0.0 });
            densities[i] = if counts { height[i] * exp } else { 0.0 };
        }
        out.push(NodeDensities { block: *block, of: densities });
    }
    columns.ln_determinant - 0.5 * f64::from(nearest)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use std::f64::consts::TAU;

    #[test]
    fn columns_say_what_nodes_say_one_by_one() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        let nodes = Node::drawn(37, &mut rng);
        let columns = NodeColumns::of(nodes.clone());
        let own = Vector4::new(0.01, -0.02, 0.001, 0.03);
        let mut compared = Vec::new();
        let (mut near, mut padded) = (0, 0);
        for _ in 0..200 {
            let at = &nodes[rng.random_range(0..nodes.len())];
            let off = Vector4::from_fn(|_, _| rng.random_range(-0.05..0.05));
            let changed = nalgebra::Vector2::from_fn(|_, _| rng.random_range(-0.02..0.02));
            let baseline = rng.random_bool(0.5).then_some(&own);
            let conditions = Conditions { drive: rng.random_range(0.5..1.2), changed, baseline };
            let x = at.mean + off;
            compare(&columns, &x, conditions, &mut compared);
            let mut total = 0.0;
            for of in &compared {
                for (i, node) in nodes[of.block * NODES..].iter().take(NODES).enumerate() {
                    let density = f64::from(of.height[i]).ln() + columns.ln_determinant
                        - 0.5 * f64::from(of.square[i]);
                    let want = node.ln_density(&x, conditions) + 2.0 * TAU.ln();
                    assert!(
                        (density - want).abs() < 1e-6 * (4.0 + f64::from(of.square[i])),
                        "{density} {want}"
                    );
                    total += node.ln_density(&x, conditions).exp();
                    near += 1;
                }
                // the last block is filled up with what lies infinitely far from everything
                for square in of.square.iter().skip(nodes.len() - of.block * NODES) {
                    assert_eq!(*square, f32::INFINITY);
                    padded += 1;
                }
            }
            // the nodes that were not compared are negligible
            let all: f64 = nodes.iter().map(|node| node.ln_density(&x, conditions).exp()).sum();
            assert!(all - total <= 1e-9 * all.max(1e-300), "{all} {total}");
        }
        assert!(near > 1000 && padded > 10, "{near} {padded}");
    }

    #[test]
    fn densities_are_those_of_the_nodes_up_to_the_factor_returned() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(4);
        let mut nodes = Node::drawn(300, &mut rng);
        // a node where a fit tells nothing: its determinant is one that f32 does not hold beside the others
        let mut wide = nodes[0].clone();
        wide.mean = Vector4::new(-1.5, 3.0, -0.15, 0.0);
        (wide.to_axes, wide.ln_determinant) = (wide.to_axes * 1e-10, wide.ln_determinant - 92.1);
        nodes.push(wide);
        let lone = Vector4::new(-1e9, 0.0, 0.0, 0.0);
        let columns = NodeColumns::of(nodes.clone());
        let (mut compared, mut densities) = (Vec::new(), Vec::new());
        for at in nodes.iter().step_by(7).map(|node| node.mean).chain([lone]) {
            let x = at + Vector4::from_fn(|_, _| rng.random_range(-0.02..0.02));
            compare(&columns, &x, Conditions::as_made(), &mut compared);
            let scale = super::densities(&columns, &compared, &mut densities);
            let sum: f64 = densities.iter().flat_map(|of| of.of).map(f64::from).sum();
            let all: f64 =
                nodes.iter().map(|node| node.ln_density(&x, Conditions::as_made()).exp()).sum();
            let found = scale + sum.ln() - 2.0 * TAU.ln();
            assert!((found - all.ln()).abs() < 1e-5, "{found} {}", all.ln());
        }
    }
}
