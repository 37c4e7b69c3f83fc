//! A fault curve's nodes in columns, so that a signal is compared with many at once.
//!
//! In: a curve's nodes. Out: for the features of a signal, of every node that may say anything about
//! them how far away it is and how high it peaks. Nodes go in stretches that lie in a box each; what is
//! far outside a box in one coordinate is far from all of its nodes, and most of a curve never is near.

use super::fault_curve::{Node, Seen};
use crate::model::lane_math::exp;
use nalgebra::Vector4;
use std::f64::consts::{PI, TAU};

/// Nodes of a stretch.
pub const NODES: usize = 16;
pub type Lanes = [f64; NODES];
/// Boxes that are looked at together.
const BOXES: usize = 8;
type OfBoxes = [f64; BOXES];
/// Squared distance in one coordinate from which on a node says nothing: e^-30 of its peak.
const FAR: f64 = 60.0;
/// Frequency, damping, amplitude, in the order in which they rule out most; a phase comes round again.
const COORDINATES: [usize; 3] = [FREQUENCY, 1, 0];
const FREQUENCY: usize = 2;

#[derive(Clone, Debug)]
pub struct NodeColumns {
    /// Of each of the boxes, as many together.
    frequencies: Vec<Intervals>,
    boxes: Vec<Boxes>,
    stretches: Vec<Stretch>,
}

/// Of the nodes of some stretches, in the order of [`COORDINATES`]; beyond the last nothing is near.
type Boxes = [Side; COORDINATES.len()];

/// In one coordinate.
#[derive(Clone, Copy, Debug)]
struct Side {
    low: OfBoxes,
    high: OfBoxes,
    /// Largest variances: beyond the noise, and of the noise at the reference drive.
    beyond: OfBoxes,
    noise: OfBoxes,
    /// Of the first node.
    moves: [OfBoxes; 2],
    follows: [OfBoxes; 4],
}

/// Of all nodes of some boxes in ln frequency, so that most are passed over at once; lane by lane, from
/// .. to. Beyond the last nothing is near.
#[derive(Clone, Copy, Debug)]
struct Intervals {
    mean: [OfBoxes; 2],
    /// As [`Side`].
    moves: [[OfBoxes; 2]; 2],
    beyond: OfBoxes,
    noise: OfBoxes,
}

/// Columns of [`Node`]; the last again and again, with no height, where they are fewer.
#[derive(Clone, Debug)]
struct Stretch {
    severity: Lanes,
    mean: [Lanes; 4],
    moves: [[Lanes; 2]; 4],
    follows: [[Lanes; 4]; 4],
    to_axes: [[Lanes; 4]; 4],
    spread: [Lanes; 4],
    determinant: Lanes,
}

/// Nodes that were compared with a signal: density at node i is `height` e^{-`square` / 2} / (2 pi)^2.
#[derive(Clone, Copy, Debug)]
pub struct Compared {
    pub stretch: usize,
    /// Squared distance in units of what scatters a signal.
    pub square: Lanes,
    pub height: Lanes,
    /// The least square.
    least: f64,
}

/// Densities of a stretch's nodes, all of a curve to one scale; 0 where they do not count.
#[derive(Clone, Copy, Debug)]
pub struct Terms {
    pub stretch: usize,
    pub of: Lanes,
}

impl NodeColumns {
    pub fn of(nodes: &[Node]) -> NodeColumns {
        let stretches: Vec<&[Node]> = nodes.chunks(NODES).collect();
        let boxes: Vec<Boxes> = stretches.chunks(BOXES).map(boxes).collect();
        NodeColumns {
            frequencies: boxes.chunks(BOXES).map(Intervals::of).collect(),
            boxes,
            stretches: stretches.into_iter().map(Stretch::of).collect(),
        }
    }

    /// Values of nodes in stretches; 0 beyond the last.
    pub fn in_stretches(of: &[f64]) -> Vec<Lanes> {
        let lane = |values: &[f64], i: usize| values.get(i).copied().unwrap_or(0.0);
        of.chunks(NODES).map(|values| std::array::from_fn(|i| lane(values, i))).collect()
    }

    /// Severities at the nodes of a stretch.
    pub fn severities(&self, stretch: usize) -> &Lanes {
        &self.stretches[stretch].severity
    }
}

fn boxes(stretches: &[&[Node]]) -> Boxes {
    let variances: Vec<Vec<[Vector4<f64>; 2]>> =
        stretches.iter().map(|nodes| nodes.iter().map(Node::variances).collect()).collect();
    COORDINATES.map(|k| {
        let lanes = |none: f64, of: &dyn Fn(usize) -> f64| -> OfBoxes {
            std::array::from_fn(|b| if b < stretches.len() { of(b) } else { none })
        };
        let means = |b: usize| stretches[b].iter().map(move |node: &Node| node.mean[k]);
        let largest =
            |b: usize, of: usize| variances[b].iter().map(|v| v[of][k]).fold(0.0, f64::max);
        Side {
            low: lanes(f64::INFINITY, &|b| means(b).fold(f64::INFINITY, f64::min)),
            high: lanes(f64::NEG_INFINITY, &|b| means(b).fold(f64::NEG_INFINITY, f64::max)),
            beyond: lanes(0.0, &|b| largest(b, 0)),
            noise: lanes(0.0, &|b| largest(b, 1)),
            moves: std::array::from_fn(|j| lanes(0.0, &|b| stretches[b][0].moves[(k, j)])),
            follows: std::array::from_fn(|j| lanes(0.0, &|b| stretches[b][0].follows[(k, j)])),
        }
    })
}

impl Intervals {
    fn of(boxes: &[Boxes]) -> Intervals {
        let sides: Vec<&Side> = boxes.iter().map(|sides| &sides[0]).collect();
        // from .. to of what the boxes have that are there
        let span = |of: &dyn Fn(&Side) -> OfBoxes| -> [OfBoxes; 2] {
            let mut span = [[f64::INFINITY; BOXES], [f64::NEG_INFINITY; BOXES]];
            for (l, side) in sides.iter().enumerate() {
                for (v, _) in of(side).iter().zip(side.low).filter(|(_, low)| *low < f64::INFINITY)
                {
                    span[0][l] = span[0][l].min(*v);
                    span[1][l] = span[1][l].max(*v);
                }
            }
            span
        };
        // what is not there must not make infinity times zero
        let finite =
            |of: [OfBoxes; 2]| of.map(|of| of.map(|v| if v.is_finite() { v } else { 0.0 }));
        Intervals {
            mean: [span(&|side| side.low)[0], span(&|side| side.high)[1]],
            moves: [finite(span(&|side| side.moves[0])), finite(span(&|side| side.moves[1]))],
            beyond: finite(span(&|side| side.beyond))[1],
            noise: finite(span(&|side| side.noise))[1],
        }
    }

    /// Whether a box of them may be near; not for a channel's own curves.
    #[inline(always)] // compiled once per instruction set
    fn near(&self, At { x, changed, noise, .. }: At) -> [bool; BOXES] {
        let x = x[FREQUENCY];
        let mut near = [false; BOXES];
        let ([low, high], [first, second]) = (&self.mean, &self.moves);
        for b in 0..BOXES {
            let moved = |of: &[OfBoxes; 2], by: f64| {
                let (p, q) = (of[0][b] * by, of[1][b] * by);
                if p < q { (p, q) } else { (q, p) }
            };
            let (by_first, by_second) = (moved(first, changed[0]), moved(second, changed[1]));
            let below = low[b] + (by_first.0 + by_second.0) - x;
            let above = x - high[b] - (by_first.1 + by_second.1);
            let outside = if below > above { below } else { above };
            let outside = if outside > 0.0 { outside } else { 0.0 };
            // a little wider, for rounding
            near[b] = outside * outside <= 1.001 * FAR * (self.beyond[b] + noise * self.noise[b]);
        }
        near
    }
}

impl Side {
    #[inline(always)] // compiled once per instruction set
    fn near<const OWN: bool>(&self, x: f64, seen: At) -> [bool; BOXES] {
        let At { changed, own, noise, .. } = seen;
        let ([first, second], mut at) = (&self.moves, [0.0; BOXES]);
        for b in 0..BOXES {
            at[b] = x - first[b] * changed[0] - second[b] * changed[1];
        }
        if OWN {
            for (follows, own) in self.follows.iter().zip(own) {
                for b in 0..BOXES {
                    at[b] -= follows[b] * own;
                }
            }
        }
        let mut near = [false; BOXES];
        for b in 0..BOXES {
            let (below, above) = (self.low[b] - at[b], at[b] - self.high[b]);
            let outside = if below > above { below } else { above };
            let outside = if outside > 0.0 { outside } else { 0.0 };
            near[b] = outside * outside <= FAR * (self.beyond[b] + noise * self.noise[b]);
        }
        near
    }
}

impl Stretch {
    fn of(nodes: &[Node]) -> Stretch {
        let lanes = |of: &dyn Fn(&Node) -> f64| -> Lanes {
            std::array::from_fn(|i| of(&nodes[i.min(nodes.len() - 1)]))
        };
        let mut determinant = lanes(&|node| node.ln_determinant.exp());
        determinant[nodes.len().min(NODES)..].fill(0.0);
        Stretch {
            severity: lanes(&|node| node.severity),
            mean: std::array::from_fn(|k| lanes(&|node| node.mean[k])),
            moves: std::array::from_fn(|k| {
                std::array::from_fn(|j| lanes(&|node| node.moves[(k, j)]))
            }),
            follows: std::array::from_fn(|k| {
                std::array::from_fn(|j| lanes(&|node| node.follows[(k, j)]))
            }),
            to_axes: std::array::from_fn(|k| {
                std::array::from_fn(|j| lanes(&|node| node.to_axes[(k, j)]))
            }),
            spread: std::array::from_fn(|k| lanes(&|node| node.spread[k])),
            determinant,
        }
    }
}

/// Features, and under what they were seen; by value, so that they stay in registers.
#[derive(Clone, Copy)]
struct At {
    x: [f64; 4],
    changed: [f64; 2],
    /// Of the channel's own baseline.
    own: [f64; 4],
    noise: f64,
}

/// Compares features with the nodes that are not far from them.
#[inline(always)] // compiled once per instruction set
pub(super) fn compare(of: &NodeColumns, x: &Vector4<f64>, seen: Seen, out: &mut Vec<Compared>) {
    let noise = 1.0 / (seen.drive * seen.drive);
    let own = seen.baseline.copied().unwrap_or_default();
    let at = At { x: (*x).into(), changed: seen.changed.into(), own: own.into(), noise };
    match seen.baseline {
        None => compare_at::<false>(of, at, out),
        Some(_) => compare_at::<true>(of, at, out),
    }
}

/// `OWN`: the curve follows a channel's own baseline.
#[inline(always)] // compiled once per instruction set
fn compare_at<const OWN: bool>(of: &NodeColumns, at: At, out: &mut Vec<Compared>) {
    out.clear();
    let mut nearest = f64::INFINITY;
    for (part, (groups, frequencies)) in of.boxes.chunks(BOXES).zip(&of.frequencies).enumerate() {
        let in_reach = if OWN { [true; BOXES] } else { frequencies.near(at) };
        for (g, sides) in groups.iter().enumerate() {
            if !in_reach[g] {
                continue;
            }
            let mut near = [true; BOXES];
            for (side, k) in sides.iter().zip(COORDINATES) {
                let also = side.near::<OWN>(at.x[k], at);
                for b in 0..BOXES {
                    near[b] &= also[b];
                }
                if near == [false; BOXES] {
                    break;
                }
            }
            for (b, near) in near.into_iter().enumerate() {
                if near {
                    let stretch = (part * BOXES + g) * BOXES + b;
                    let Some(nodes) = of.stretches.get(stretch) else { continue };
                    let (square, inverse) = nodes.compare::<OWN>(at);
                    let least = least(&square);
                    // what says nothing beside the nearest so far is left out
                    if least <= nearest + 2.0 * NEGLIGIBLE {
                        nearest = if least < nearest { least } else { nearest };
                        let mut height = [0.0; NODES];
                        for i in 0..NODES {
                            height[i] = nodes.determinant[i] * inverse[i].sqrt();
                        }
                        out.push(Compared { stretch, square, height, least });
                    }
                }
            }
        }
    }
}

/// Nodes whose arithmetic goes together: as many as stay in registers.
const TOGETHER: usize = 8;

impl Stretch {
    /// Squared distances of the nodes, and the inverses of their variances' products.
    #[inline(always)] // compiled once per instruction set
    fn compare<const OWN: bool>(&self, at: At) -> (Lanes, Lanes) {
        let At { x, changed, own, noise } = at;
        let (mut square, mut inverse) = ([0.0; NODES], [0.0; NODES]);
        for from in (0..NODES).step_by(TOGETHER) {
            for i in from..from + TOGETHER {
                let away = |k: usize| {
                    let (moves, follows) = (&self.moves[k], &self.follows[k]);
                    let mut moved = moves[0][i] * changed[0] + moves[1][i] * changed[1];
                    if OWN {
                        moved += (follows[0][i] * own[0] + follows[1][i] * own[1])
                            + (follows[2][i] * own[2] + follows[3][i] * own[3]);
                    }
                    x[k] - self.mean[k][i] - moved
                };
                let mut d = [away(0), away(1), away(2), away(3)];
                // a phase beyond one turn is no phase of a fit
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
                // sum of u / v with one division
                let (v01, v23) = (v[0] * v[1], v[2] * v[3]);
                let sum = (u[0] * v[1] + u[1] * v[0]) * v23 + (u[2] * v[3] + u[3] * v[2]) * v01;
                inverse[i] = 1.0 / (v01 * v23);
                square[i] = sum * inverse[i];
            }
        }
        (square, inverse)
    }
}

/// The least of them; NaN is passed over.
#[inline(always)] // compiled once per instruction set
fn least(of: &Lanes) -> f64 {
    let less = |p: f64, q: f64| if q < p { q } else { p };
    let eight: [f64; 8] = std::array::from_fn(|i| less(less(f64::INFINITY, of[i]), of[i + 8]));
    let four: [f64; 4] = std::array::from_fn(|i| less(eight[i], eight[i + 4]));
    less(less(four[0], four[1]), less(four[2], four[3]))
}

/// Their sum, in one order.
#[inline(always)] // compiled once per instruction set
pub(super) fn sum(of: &Lanes) -> f64 {
    let eight: [f64; 8] = std::array::from_fn(|i| of[i] + of[i + 8]);
    let four: [f64; 4] = std::array::from_fn(|i| eight[i] + eight[i + 4]);
    (four[0] + four[1]) + (four[2] + four[3])
}

/// A node by this much less likely, in ln, than the likeliest says nothing.
const NEGLIGIBLE: f64 = 30.0;

/// The terms of nodes that are not far. Returns ln of their scale.
#[inline(always)] // compiled once per instruction set
pub(super) fn terms(compared: &[Compared], out: &mut Vec<Terms>) -> f64 {
    out.clear();
    let nearest = compared.iter().fold(f64::INFINITY, |m, of| m.min(of.least));
    for Compared { stretch, square, height, least } in compared {
        // NaN is never below
        let near = *least < nearest + 2.0 * NEGLIGIBLE;
        if !near {
            continue;
        }
        let mut terms = [0.0; NODES];
        for i in 0..NODES {
            let less = 0.5 * (nearest - square[i]);
            let counts = less > -NEGLIGIBLE;
            let exp = exp(if counts { less } else { 0.0 });
            terms[i] = if counts { height[i] * exp } else { 0.0 };
        }
        out.push(Terms { stretch: *stretch, of: terms });
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
            let seen = Seen { drive: rng.random_range(0.5..1.2), changed, baseline };
            let x = at.mean + off;
            compare(&columns, &x, seen, &mut compared);
            let mut total = 0.0;
            for of in &compared {
                for (i, node) in nodes[of.stretch * NODES..].iter().take(NODES).enumerate() {
                    let density = of.height[i].ln() - 0.5 * of.square[i];
                    let want = node.ln_density(&x, seen) + 2.0 * TAU.ln();
                    assert!(
                        (density - want).abs() < 1e-9 * want.abs().max(1.0),
                        "{density} {want}"
                    );
                    total += node.ln_density(&x, seen).exp();
                    near += 1;
                }
            }
            // what was not compared says nothing
            let all: f64 = nodes.iter().map(|node| node.ln_density(&x, seen).exp()).sum();
            assert!(all - total <= 1e-9 * all.max(1e-300), "{all} {total}");
        }
        assert!(near > 1000);
        let (mut padded, last) = (0, nodes.len() - 32);
        for of in compared.iter().filter(|of| of.stretch == 2) {
            padded += of.height[last..].iter().filter(|h| **h == 0.0).count();
        }
        assert!(compared.iter().all(|of| of.stretch != 2) || padded == NODES - last);
    }

    #[test]
    fn terms_are_the_densities_of_nodes_to_one_scale() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(4);
        let nodes = Node::drawn(300, &mut rng);
        let columns = NodeColumns::of(&nodes);
        let (mut compared, mut terms) = (Vec::new(), Vec::new());
        for at in nodes.iter().step_by(7) {
            let x = at.mean + Vector4::from_fn(|_, _| rng.random_range(-0.02..0.02));
            compare(&columns, &x, Seen::as_made(), &mut compared);
            let scale = super::terms(&compared, &mut terms);
            let sum: f64 = terms.iter().flat_map(|of| of.of).sum();
            let all: f64 =
                nodes.iter().map(|node| node.ln_density(&x, Seen::as_made()).exp()).sum();
            let found = scale + sum.ln() - 2.0 * TAU.ln();
            assert!((found - all.ln()).abs() < 1e-9, "{found} {}", all.ln());
        }
    }
}
