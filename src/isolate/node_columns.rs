//! A fault curve's nodes in columns, so that a signal is compared with many at once.
//!
//! In: a curve's nodes. Out: for the features of a signal, of every node that may say anything about
//! them how far away it is and how high it peaks. Nodes go in stretches that lie in a box each; what is
//! far outside a box in one coordinate is far from all of its nodes, and most of a curve never is near.

use super::fault_curve::{Node, Seen};
use nalgebra::Vector4;
use std::f64::consts::{PI, TAU};

/// Nodes of a stretch.
const NODES: usize = 16;
type Lanes = [f64; NODES];
/// Squared distance in one coordinate from which on a node says nothing: e^-30 of its peak.
const FAR: f64 = 60.0;
/// Frequency, damping, amplitude, in the order in which they rule out most; a phase comes round again.
const COORDINATES: [usize; 3] = [2, 1, 0];

#[derive(Clone, Debug)]
pub struct NodeColumns {
    boxes: Vec<Bounds>,
    stretches: Vec<Stretch>,
}

/// Of the nodes of a stretch, in one coordinate.
#[derive(Clone, Copy, Debug)]
struct Side {
    low: f64,
    high: f64,
    /// Largest variances: beyond the noise, and of the noise at the reference drive.
    beyond: f64,
    noise: f64,
    /// Of the first node.
    moves: [f64; 2],
    follows: [f64; 4],
}

/// In the order of [`COORDINATES`].
type Bounds = [Side; COORDINATES.len()];

/// Columns of [`Node`]; the last again and again, with no height, where they are fewer.
#[derive(Clone, Debug)]
struct Stretch {
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
    /// Number of the first node.
    pub first: usize,
    /// Squared distance in units of what scatters a signal.
    pub square: Lanes,
    pub height: Lanes,
}

impl NodeColumns {
    pub fn of(nodes: &[Node]) -> NodeColumns {
        let stretches = nodes.chunks(NODES);
        NodeColumns {
            boxes: stretches.clone().map(bounds).collect(),
            stretches: stretches.map(Stretch::of).collect(),
        }
    }

    /// Compares features with the nodes that are not far from them.
    pub fn compare(&self, x: &Vector4<f64>, seen: Seen, out: &mut Vec<Compared>) {
        out.clear();
        let noise = 1.0 / (seen.drive * seen.drive);
        for (s, bounds) in self.boxes.iter().enumerate() {
            if bounds.iter().zip(COORDINATES).all(|(side, k)| side.is_near(x[k], seen, noise)) {
                let (square, height) = self.stretches[s].compare(x, seen, noise);
                out.push(Compared { first: s * NODES, square, height });
            }
        }
    }

    /// The middle node of every stretch.
    pub fn middles(&self, nodes: usize) -> impl Iterator<Item = usize> {
        (0..nodes).step_by(NODES).map(move |first| first.midpoint(nodes.min(first + NODES)))
    }
}

fn bounds(nodes: &[Node]) -> Bounds {
    let variances: Vec<[Vector4<f64>; 2]> = nodes.iter().map(Node::variances).collect();
    COORDINATES.map(|k| {
        let means = || nodes.iter().map(|node| node.mean[k]);
        let largest = |of: usize| variances.iter().map(|v| v[of][k]).fold(0.0, f64::max);
        let first = &nodes[0];
        Side {
            low: means().fold(f64::INFINITY, f64::min),
            high: means().fold(f64::NEG_INFINITY, f64::max),
            beyond: largest(0),
            noise: largest(1),
            moves: std::array::from_fn(|j| first.moves[(k, j)]),
            follows: std::array::from_fn(|j| first.follows[(k, j)]),
        }
    })
}

impl Side {
    fn is_near(&self, x: f64, seen: Seen, noise: f64) -> bool {
        let mut x = x - self.moves[0] * seen.changed[0] - self.moves[1] * seen.changed[1];
        if let Some(own) = seen.baseline {
            x -= self.follows.iter().zip(own.iter()).map(|(f, own)| f * own).sum::<f64>();
        }
        let outside = (self.low - x).max(x - self.high).max(0.0);
        outside * outside <= FAR * (self.beyond + noise * self.noise)
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

    fn compare(&self, x: &Vector4<f64>, seen: Seen, noise: f64) -> (Lanes, Lanes) {
        #[cfg(target_arch = "x86_64")]
        {
            // SAFETY: the processor was found to have what is asked of it
            if std::is_x86_feature_detected!("avx512f") {
                return unsafe { x86::with_avx512(self, x, seen, noise) };
            }
            // SAFETY: as above
            if std::is_x86_feature_detected!("avx2") {
                return unsafe { x86::with_avx2(self, x, seen, noise) };
            }
        }
        portable(self, x, seen, noise)
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::{Lanes, Seen, Stretch, Vector4, portable};

    #[target_feature(enable = "avx512f")]
    pub fn with_avx512(of: &Stretch, x: &Vector4<f64>, seen: Seen, noise: f64) -> (Lanes, Lanes) {
        portable(of, x, seen, noise)
    }

    #[target_feature(enable = "avx2")]
    pub fn with_avx2(of: &Stretch, x: &Vector4<f64>, seen: Seen, noise: f64) -> (Lanes, Lanes) {
        portable(of, x, seen, noise)
    }
}

#[inline(always)] // compiled once per instruction set
fn portable(of: &Stretch, x: &Vector4<f64>, seen: Seen, noise: f64) -> (Lanes, Lanes) {
    let mut d = [[0.0; NODES]; 4];
    for k in 0..4 {
        let (moves, mean) = (&of.moves[k], &of.mean[k]);
        for i in 0..NODES {
            let moved = moves[0][i] * seen.changed[0] + moves[1][i] * seen.changed[1];
            d[k][i] = x[k] - mean[i] - moved;
        }
        for (follows, own) in
            of.follows[k].iter().zip(seen.baseline.iter().flat_map(|own| own.iter()))
        {
            for i in 0..NODES {
                d[k][i] -= follows[i] * own;
            }
        }
    }
    for phase in &mut d[3] {
        // a phase beyond one turn is no phase of a fit
        let turn = if *phase > PI { TAU } else { 0.0 } - if *phase < -PI { TAU } else { 0.0 };
        *phase -= turn;
    }
    let (mut square, mut product) = ([0.0; NODES], [1.0; NODES]);
    for k in 0..4 {
        let to_axes = &of.to_axes[k];
        for i in 0..NODES {
            let along = to_axes[0][i] * d[0][i]
                + to_axes[1][i] * d[1][i]
                + to_axes[2][i] * d[2][i]
                + to_axes[3][i] * d[3][i];
            let variance = of.spread[k][i] + noise;
            square[i] += along * along / variance;
            product[i] *= variance;
        }
    }
    (square, std::array::from_fn(|i| of.determinant[i] / product[i].sqrt()))
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
            columns.compare(&x, seen, &mut compared);
            let mut total = 0.0;
            for of in &compared {
                for (i, node) in nodes[of.first..].iter().take(NODES).enumerate() {
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
        for of in compared.iter().filter(|of| of.first == 32) {
            padded += of.height[last..].iter().filter(|h| **h == 0.0).count();
        }
        assert!(compared.iter().all(|of| of.first != 32) || padded == NODES - last);
    }
}
