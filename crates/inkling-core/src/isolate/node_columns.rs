//! The nodes of a fault curve as a structure of arrays with bounding boxes, so that a signal is
//! compared with several nodes at once, and only with those near it.
//!
//! In: once the nodes of a curve; then a signal's features and conditions. Out: the densities at all
//! nodes that are not negligible (`Node::ln_density` in the tests), up to a factor. The steps:
//!
//! 1. Nodes are stored in blocks of [`NODES`], each with its bounding box in the features. A block
//!    is left out where the features lie far outside of its box in one coordinate (`near`).
//! 2. For the other nodes: the squared Mahalanobis distance and the height of the peak
//!    (`Block::compare`). In a node's axes the covariance is diagonal at any drive.
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
/// Number of boxes that are tested together.
const BOXES: usize = 16;
type OfBoxes = [f32; BOXES];
/// Squared distance in one coordinate, in variances, beyond which a density is e^-30 of its peak.
const FAR: f32 = 60.0;
/// Number of coordinates of the boxes: all features but the phase, which is periodic.
const COORDINATES: usize = 3;

#[derive(Clone, Debug)]
pub struct NodeColumns {
    pub nodes: Vec<Node>,
    boxes: Vec<Boxes>,
    blocks: Vec<Block>,
    ln_determinant: f64,
}

/// Bounding boxes of [`BOXES`] blocks; beyond the last block they are empty.
type Boxes = [Bounds; COORDINATES];

/// The smallest and the largest mean of each block's nodes in one coordinate.
#[derive(Clone, Copy, Debug)]
struct Bounds {
    low: OfBoxes,
    high: OfBoxes,
    /// Largest variances: of all scatter but the noise, and of the noise at the reference drive.
    beyond: OfBoxes,
    noise: OfBoxes,
    /// Derivatives of the mean of the block's first node, which stand for those of all its nodes.
    by_change: [OfBoxes; 2],
    by_baseline: [OfBoxes; 4],
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
        let blocks: Vec<&[Node]> = nodes.chunks(NODES).collect();
        let ln_determinants = nodes.iter().map(|node| node.ln_determinant);
        let ln_determinant = ln_determinants.fold(f64::NEG_INFINITY, f64::max);
        NodeColumns {
            boxes: blocks.chunks(BOXES).map(boxes).collect(),
            blocks: blocks.into_iter().map(|nodes| Block::of(nodes, ln_determinant)).collect(),
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

fn boxes(blocks: &[&[Node]]) -> Boxes {
    let variances: Vec<Vec<[Vector4<f64>; 2]>> =
        blocks.iter().map(|nodes| nodes.iter().map(Node::variances).collect()).collect();
    std::array::from_fn(|k| {
        let of_boxes = |none: f32, of: &dyn Fn(usize) -> f64| -> OfBoxes {
            std::array::from_fn(|b| if b < blocks.len() { of(b) as f32 } else { none })
        };
        let means = |b: usize| blocks[b].iter().map(move |node: &Node| node.mean[k]);
        let largest =
            |b: usize, of: usize| variances[b].iter().map(|v| v[of][k]).fold(0.0, f64::max);
        Bounds {
            low: of_boxes(f32::INFINITY, &|b| means(b).fold(f64::INFINITY, f64::min)),
            high: of_boxes(f32::NEG_INFINITY, &|b| means(b).fold(f64::NEG_INFINITY, f64::max)),
            beyond: of_boxes(0.0, &|b| largest(b, 0)),
            noise: of_boxes(0.0, &|b| largest(b, 1)),
            by_change: std::array::from_fn(|j| of_boxes(0.0, &|b| blocks[b][0].by_change[(k, j)])),
            by_baseline: std::array::from_fn(|j| {
                of_boxes(0.0, &|b| blocks[b][0].by_baseline[(k, j)])
            }),
        }
    })
}

/// Which boxes may hold a node that is not negligible, as one bit each. `OWN`: whether the curve
/// moves with a channel's baseline.
#[inline(always)] // compiled once per instruction set
fn near<const OWN: bool>(boxes: &Boxes, query: Query) -> u32 {
    let Query { changed, own, noise, .. } = query;
    let mut inside: [u32; BOXES] = std::array::from_fn(|b| 1 << b);
    for (bounds, x) in boxes.iter().zip(query.x) {
        let (x, [first, second]) = (x as f32, &bounds.by_change);
        for b in 0..BOXES {
            // instead of the nodes the signal is moved, the other way
            let mut at = x - first[b] * changed[0] - second[b] * changed[1];
            if OWN {
                for (by_baseline, own) in bounds.by_baseline.iter().zip(own) {
                    at -= by_baseline[b] * own;
                }
            }
            let (below, above) = (bounds.low[b] - at, at - bounds.high[b]);
            let most = if below > above { below } else { above };
            let outside = if most > 0.0 { most } else { 0.0 };
            // within sqrt(FAR) standard deviations, a little more for rounding
            let reach = 1.001 * FAR * (bounds.beyond[b] + noise * bounds.noise[b]);
            inside[b] = if outside * outside <= reach { inside[b] } else { 0 };
        }
    }
    inside.iter().fold(0, |all, bit| all | bit)
}

#[inline(always)] // compiled once per instruction set
fn each_of(mut bits: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let place = (bits != 0).then_some(bits.trailing_zeros() as usize);
        bits &= bits.wrapping_sub(1);
        place
    })
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
    for (boxes, (part, blocks)) in of.boxes.iter().zip(of.blocks.chunks(BOXES).enumerate()) {
        for b in each_of(near::<OWN>(boxes, query)) {
            let (square, height) = blocks[b].compare::<OWN>(query);
            let least = least(&square);
            // negligible beside the nearest node so far; a NaN is, too
            if least <= nearest + 2.0 * NEGLIGIBLE {
                nearest = if least < nearest { least } else { nearest };
                out.push(ComparedBlock { block: part * BOXES + b, square, height, least });
            }
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
