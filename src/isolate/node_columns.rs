//! The nodes of a fault curve as a structure of arrays with bounding boxes: a signal is compared with
//! several nodes at once, and only with those near it.
//!
//! In: a curve's nodes. Out: for a signal's features the squared distance and peak density of every node
//! that is not negligible. Nodes are stored in blocks of [`NODES`] consecutive ones, each with its bounding
//! box in the features; where the features lie far outside the box in one coordinate, all of its nodes are
//! negligible. Boxes are tested before nodes, and groups of boxes before boxes.

use super::fault_curve::{Conditions, Node};
use crate::model::simd_math::exp;
use nalgebra::Vector4;
use std::f64::consts::{PI, TAU};

/// Nodes of a block.
pub const NODES: usize = 16;
pub type OfNodes = [f64; NODES];
/// Boxes that are tested together.
const BOXES: usize = 8;
type OfBoxes = [f64; BOXES];
/// Squared distance in one coordinate beyond which a node is negligible: e^-30 of its peak.
const FAR: f64 = 60.0;
/// Coordinates of the boxes, those first that exclude most; not the phase, which is periodic.
const COORDINATES: [usize; 3] = [FREQUENCY, 1, 0];
const FREQUENCY: usize = 2;

#[derive(Clone, Debug)]
pub struct NodeColumns {
    /// ln frequency of [`BOXES`] groups of boxes each.
    frequencies: Vec<Intervals>,
    boxes: Vec<Boxes>,
    blocks: Vec<Block>,
}

/// Bounding boxes of [`BOXES`] blocks, one [`Bounds`] for each of [`COORDINATES`]; beyond the last block they
/// are empty.
type Boxes = [Bounds; COORDINATES.len()];

/// Of [`BOXES`] blocks in one coordinate: the smallest and largest mean of their nodes.
#[derive(Clone, Copy, Debug)]
struct Bounds {
    low: OfBoxes,
    high: OfBoxes,
    /// Largest variances of their nodes: of all scatter but the noise, and of the noise at the reference drive.
    beyond: OfBoxes,
    noise: OfBoxes,
    /// Derivatives of the first node, which stand for the block's.
    by_change: [OfBoxes; 2],
    by_baseline: [OfBoxes; 4],
}

/// Intervals of ln frequency that hold all nodes of [`BOXES`] boxes, one interval per SIMD lane, so that most
/// of a curve is excluded by one comparison. Pairs are the least and the largest.
#[derive(Clone, Copy, Debug)]
struct Intervals {
    mean: [OfBoxes; 2],
    /// As [`Bounds`].
    by_change: [[OfBoxes; 2]; 2],
    beyond: OfBoxes,
    noise: OfBoxes,
}

/// [`NODES`] nodes, field by field ([`Node`]); where they are fewer, copies of the last with density 0.
#[derive(Clone, Debug)]
struct Block {
    severity: OfNodes,
    mean: [OfNodes; 4],
    by_change: [[OfNodes; 2]; 4],
    by_baseline: [[OfNodes; 4]; 4],
    to_axes: [[OfNodes; 4]; 4],
    spread: [OfNodes; 4],
    determinant: OfNodes,
}

/// Nodes that were compared with a signal: density at node i is `height` e^{-`square` / 2} / (2 pi)^2.
#[derive(Clone, Copy, Debug)]
pub struct Compared {
    pub block: usize,
    /// Squared Mahalanobis distance.
    pub square: OfNodes,
    pub height: OfNodes,
    /// The least of `square`.
    least: f64,
}

/// Densities of the features at a block's nodes, up to a factor that is common to the curve; 0 where they
/// are negligible.
#[derive(Clone, Copy, Debug)]
pub struct NodeDensities {
    pub block: usize,
    pub of: OfNodes,
}

impl NodeColumns {
    pub fn of(nodes: &[Node]) -> NodeColumns {
        let blocks: Vec<&[Node]> = nodes.chunks(NODES).collect();
        let boxes: Vec<Boxes> = blocks.chunks(BOXES).map(boxes).collect();
        NodeColumns {
            frequencies: boxes.chunks(BOXES).map(Intervals::of).collect(),
            boxes,
            blocks: blocks.into_iter().map(Block::of).collect(),
        }
    }

    /// One value per node, in blocks; 0 beyond the last.
    pub fn in_blocks(of: &[f64]) -> Vec<OfNodes> {
        let lane = |values: &[f64], i: usize| values.get(i).copied().unwrap_or(0.0);
        of.chunks(NODES).map(|values| std::array::from_fn(|i| lane(values, i))).collect()
    }

    /// Severities at the nodes of a block.
    pub fn severities(&self, block: usize) -> &OfNodes {
        &self.blocks[block].severity
    }
}

fn boxes(blocks: &[&[Node]]) -> Boxes {
    let variances: Vec<Vec<[Vector4<f64>; 2]>> =
        blocks.iter().map(|nodes| nodes.iter().map(Node::variances).collect()).collect();
    COORDINATES.map(|k| {
        let of_boxes = |none: f64, of: &dyn Fn(usize) -> f64| -> OfBoxes {
            std::array::from_fn(|b| if b < blocks.len() { of(b) } else { none })
        };
        let means = |b: usize| blocks[b].iter().map(move |node: &Node| node.mean[k]);
        let largest =
            |b: usize, of: usize| variances[b].iter().map(|v| v[of][k]).fold(0.0, f64::max);
        Bounds {
            low: of_boxes(f64::INFINITY, &|b| means(b).fold(f64::INFINITY, f64::min)),
            high: of_boxes(f64::NEG_INFINITY, &|b| means(b).fold(f64::NEG_INFINITY, f64::max)),
            beyond: of_boxes(0.0, &|b| largest(b, 0)),
            noise: of_boxes(0.0, &|b| largest(b, 1)),
            by_change: std::array::from_fn(|j| of_boxes(0.0, &|b| blocks[b][0].by_change[(k, j)])),
            by_baseline: std::array::from_fn(|j| {
                of_boxes(0.0, &|b| blocks[b][0].by_baseline[(k, j)])
            }),
        }
    })
}

impl Intervals {
    fn of(boxes: &[Boxes]) -> Intervals {
        let bounds: Vec<&Bounds> = boxes.iter().map(|bounds| &bounds[0]).collect();
        // least and largest over the boxes that are not empty
        let span = |of: &dyn Fn(&Bounds) -> OfBoxes| -> [OfBoxes; 2] {
            let mut span = [[f64::INFINITY; BOXES], [f64::NEG_INFINITY; BOXES]];
            for (l, bound) in bounds.iter().enumerate() {
                for (v, _) in
                    of(bound).iter().zip(bound.low).filter(|(_, low)| *low < f64::INFINITY)
                {
                    span[0][l] = span[0][l].min(*v);
                    span[1][l] = span[1][l].max(*v);
                }
            }
            span
        };
        // empty boxes must not lead to infinity times zero
        let finite =
            |of: [OfBoxes; 2]| of.map(|of| of.map(|v| if v.is_finite() { v } else { 0.0 }));
        Intervals {
            mean: [span(&|bound| bound.low)[0], span(&|bound| bound.high)[1]],
            by_change: [
                finite(span(&|bound| bound.by_change[0])),
                finite(span(&|bound| bound.by_change[1])),
            ],
            beyond: finite(span(&|bound| bound.beyond))[1],
            noise: finite(span(&|bound| bound.noise))[1],
        }
    }

    /// Which groups of boxes may hold a node that is not negligible; not for a channel's own curves.
    #[inline(always)] // compiled once per instruction set
    fn near(&self, Query { x, changed, noise, .. }: Query) -> u8 {
        let x = x[FREQUENCY];
        let ([low, high], [first, second]) = (&self.mean, &self.by_change);
        // which end of an interval is the least once it is moved is a matter of the change's sign
        let ends = |by: f64| if by < 0.0 { [1, 0] } else { [0, 1] };
        let ([p, q], [r, s]) = (ends(changed[0]), ends(changed[1]));
        let (mut outside, mut reach) = ([0.0; BOXES], [0.0; BOXES]);
        for b in 0..BOXES {
            let below = low[b] + (first[p][b] * changed[0] + second[r][b] * changed[1]) - x;
            let above = x - high[b] - (first[q][b] * changed[0] + second[s][b] * changed[1]);
            let most = if below > above { below } else { above };
            outside[b] = if most > 0.0 { most } else { 0.0 };
            // a little wider, for rounding
            reach[b] = 1.001 * FAR * (self.beyond[b] + noise * self.noise[b]);
        }
        within(&outside, &reach)
    }
}

impl Bounds {
    #[inline(always)] // compiled once per instruction set
    fn near<const OWN: bool>(&self, x: f64, query: Query) -> u8 {
        let Query { changed, own, noise, .. } = query;
        let ([first, second], mut at) = (&self.by_change, [0.0; BOXES]);
        for b in 0..BOXES {
            at[b] = x - first[b] * changed[0] - second[b] * changed[1];
        }
        if OWN {
            for (by_baseline, own) in self.by_baseline.iter().zip(own) {
                for b in 0..BOXES {
                    at[b] -= by_baseline[b] * own;
                }
            }
        }
        let (mut outside, mut reach) = ([0.0; BOXES], [0.0; BOXES]);
        for b in 0..BOXES {
            let (below, above) = (self.low[b] - at[b], at[b] - self.high[b]);
            let most = if below > above { below } else { above };
            outside[b] = if most > 0.0 { most } else { 0.0 };
            reach[b] = FAR * (self.beyond[b] + noise * self.noise[b]);
        }
        within(&outside, &reach)
    }
}

/// Of which boxes the distance squared is within reach, a bit each.
#[inline(always)] // compiled once per instruction set
fn within(distance: &OfBoxes, reach: &OfBoxes) -> u8 {
    let mut bits = 0;
    for b in 0..BOXES {
        bits |= u8::from(distance[b] * distance[b] <= reach[b]) << b;
    }
    bits
}

/// The places of the bits that are set.
#[inline(always)] // compiled once per instruction set
fn each_of(mut bits: u8) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let place = (bits != 0).then_some(bits.trailing_zeros() as usize);
        bits &= bits.wrapping_sub(1);
        place
    })
}

impl Block {
    fn of(nodes: &[Node]) -> Block {
        let of_nodes = |of: &dyn Fn(&Node) -> f64| -> OfNodes {
            std::array::from_fn(|i| of(&nodes[i.min(nodes.len() - 1)]))
        };
        let mut determinant = of_nodes(&|node| node.ln_determinant.exp());
        determinant[nodes.len().min(NODES)..].fill(0.0);
        Block {
            severity: of_nodes(&|node| node.severity),
            mean: std::array::from_fn(|k| of_nodes(&|node| node.mean[k])),
            by_change: std::array::from_fn(|k| {
                std::array::from_fn(|j| of_nodes(&|node| node.by_change[(k, j)]))
            }),
            by_baseline: std::array::from_fn(|k| {
                std::array::from_fn(|j| of_nodes(&|node| node.by_baseline[(k, j)]))
            }),
            to_axes: std::array::from_fn(|k| {
                std::array::from_fn(|j| of_nodes(&|node| node.to_axes[(k, j)]))
            }),
            spread: std::array::from_fn(|k| of_nodes(&|node| node.spread[k])),
            determinant,
        }
    }
}

/// A signal's features and conditions; by value, so that they stay in registers.
#[derive(Clone, Copy)]
struct Query {
    x: [f64; 4],
    changed: [f64; 2],
    /// The channel's own baseline.
    own: [f64; 4],
    /// Variance of the noise over that at the reference drive.
    noise: f64,
}

/// Compares features with the nodes that are not negligible.
#[inline(always)] // compiled once per instruction set
pub(super) fn compare(
    of: &NodeColumns,
    x: &Vector4<f64>,
    conditions: Conditions,
    out: &mut Vec<Compared>,
) {
    let noise = 1.0 / (conditions.drive * conditions.drive);
    let own = conditions.baseline.copied().unwrap_or_default();
    let query =
        Query { x: (*x).into(), changed: conditions.changed.into(), own: own.into(), noise };
    match conditions.baseline {
        None => compare_at::<false>(of, query, out),
        Some(_) => compare_at::<true>(of, query, out),
    }
}

/// `OWN`: the curve by_baseline a channel's own baseline.
#[inline(always)] // compiled once per instruction set
fn compare_at<const OWN: bool>(of: &NodeColumns, query: Query, out: &mut Vec<Compared>) {
    out.clear();
    let mut nearest = f64::INFINITY;
    for (part, (groups, frequencies)) in of.boxes.chunks(BOXES).zip(&of.frequencies).enumerate() {
        let in_reach = if OWN { u8::MAX } else { frequencies.near(query) };
        for g in each_of(in_reach) {
            let Some(bounds) = groups.get(g) else { break };
            let mut near = u8::MAX;
            for (bound, k) in bounds.iter().zip(COORDINATES) {
                near &= bound.near::<OWN>(query.x[k], query);
                if near == 0 {
                    break;
                }
            }
            for b in each_of(near) {
                let block = (part * BOXES + g) * BOXES + b;
                let Some(nodes) = of.blocks.get(block) else { break };
                let (square, inverse) = nodes.compare::<OWN>(query);
                let least = least(&square);
                // negligible beside the nearest so far
                if least <= nearest + 2.0 * NEGLIGIBLE {
                    nearest = if least < nearest { least } else { nearest };
                    let mut height = [0.0; NODES];
                    for i in 0..NODES {
                        height[i] = nodes.determinant[i] * inverse[i].sqrt();
                    }
                    out.push(Compared { block, square, height, least });
                }
            }
        }
    }
}

/// Nodes whose arithmetic is interleaved: as many as fit into registers.
const TOGETHER: usize = 8;

impl Block {
    /// Squared distances of the nodes, and the inverse determinants of their covariances (in their axes).
    #[inline(always)] // compiled once per instruction set
    fn compare<const OWN: bool>(&self, query: Query) -> (OfNodes, OfNodes) {
        let Query { x, changed, own, noise } = query;
        let (mut square, mut inverse) = ([0.0; NODES], [0.0; NODES]);
        for from in (0..NODES).step_by(TOGETHER) {
            for i in from..from + TOGETHER {
                let away = |k: usize| {
                    let (by_change, by_baseline) = (&self.by_change[k], &self.by_baseline[k]);
                    let mut moved = by_change[0][i] * changed[0] + by_change[1][i] * changed[1];
                    if OWN {
                        moved += (by_baseline[0][i] * own[0] + by_baseline[1][i] * own[1])
                            + (by_baseline[2][i] * own[2] + by_baseline[3][i] * own[3]);
                    }
                    x[k] - self.mean[k][i] - moved
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
                // sum of u_k / v_k with a single division
                let (v01, v23) = (v[0] * v[1], v[2] * v[3]);
                let sum = (u[0] * v[1] + u[1] * v[0]) * v23 + (u[2] * v[3] + u[3] * v[2]) * v01;
                inverse[i] = 1.0 / (v01 * v23);
                square[i] = sum * inverse[i];
            }
        }
        (square, inverse)
    }
}

/// The least of them; NaN is ignored.
#[inline(always)] // compiled once per instruction set
fn least(of: &OfNodes) -> f64 {
    let less = |p: f64, q: f64| if q < p { q } else { p };
    let eight: [f64; 8] = std::array::from_fn(|i| less(less(f64::INFINITY, of[i]), of[i + 8]));
    let four: [f64; 4] = std::array::from_fn(|i| less(eight[i], eight[i + 4]));
    less(less(four[0], four[1]), less(four[2], four[3]))
}

/// Their sum, in a fixed order.
#[inline(always)] // compiled once per instruction set
pub(super) fn sum(of: &OfNodes) -> f64 {
    let eight: [f64; 8] = std::array::from_fn(|i| of[i] + of[i + 8]);
    let four: [f64; 4] = std::array::from_fn(|i| eight[i] + eight[i + 4]);
    (four[0] + four[1]) + (four[2] + four[3])
}

/// A node whose ln density is lower than the largest by more than this is negligible.
const NEGLIGIBLE: f64 = 30.0;

/// Densities at the nodes that are not negligible. Returns ln of the factor that is left out of them.
#[inline(always)] // compiled once per instruction set
pub(super) fn densities(compared: &[Compared], out: &mut Vec<NodeDensities>) -> f64 {
    out.clear();
    let nearest = compared.iter().fold(f64::INFINITY, |m, of| m.min(of.least));
    for Compared { block, square, height, least } in compared {
        // NaN is never below
        let near = *least < nearest + 2.0 * NEGLIGIBLE;
        if !near {
            continue;
        }
        let mut densities = [0.0; NODES];
        for i in 0..NODES {
            let less = 0.5 * (nearest - square[i]);
            let counts = less > -NEGLIGIBLE;
            let exp = exp(if counts { less } else { 0.0 });
            densities[i] = if counts { height[i] * exp } else { 0.0 };
        }
        out.push(NodeDensities { block: *block, of: densities });
    }
    -0.5 * nearest
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn columns_say_what_nodes_say_one_by_one() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        let nodes = Node::drawn(37, &mut rng);
        let columns = NodeColumns::of(&nodes);
        let own = Vector4::new(0.01, -0.02, 0.001, 0.03);
        let mut compared = Vec::new();
        let mut near = 0;
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
                    let density = of.height[i].ln() - 0.5 * of.square[i];
                    let want = node.ln_density(&x, conditions) + 2.0 * TAU.ln();
                    assert!(
                        (density - want).abs() < 1e-9 * want.abs().max(1.0),
                        "{density} {want}"
                    );
                    total += node.ln_density(&x, conditions).exp();
                    near += 1;
                }
            }
            // what was not compared is negligible
            let all: f64 = nodes.iter().map(|node| node.ln_density(&x, conditions).exp()).sum();
            assert!(all - total <= 1e-9 * all.max(1e-300), "{all} {total}");
        }
        assert!(near > 1000);
        let (mut padded, last) = (0, nodes.len() - 32);
        for of in compared.iter().filter(|of| of.block == 2) {
            padded += of.height[last..].iter().filter(|h| **h == 0.0).count();
        }
        assert!(compared.iter().all(|of| of.block != 2) || padded == NODES - last);
    }

    #[test]
    fn densities_are_those_of_the_nodes_up_to_the_factor_returned() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(4);
        let nodes = Node::drawn(300, &mut rng);
        let columns = NodeColumns::of(&nodes);
        let (mut compared, mut densities) = (Vec::new(), Vec::new());
        for at in nodes.iter().step_by(7) {
            let x = at.mean + Vector4::from_fn(|_, _| rng.random_range(-0.02..0.02));
            compare(&columns, &x, Conditions::as_made(), &mut compared);
            let scale = super::densities(&compared, &mut densities);
            let sum: f64 = densities.iter().flat_map(|of| of.of).sum();
            let all: f64 =
                nodes.iter().map(|node| node.ln_density(&x, Conditions::as_made()).exp()).sum();
            let found = scale + sum.ln() - 2.0 * TAU.ln();
            assert!((found - all.ln()).abs() < 1e-9, "{found} {}", all.ln());
        }
    }
}
