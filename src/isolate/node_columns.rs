//! A fault curve's nodes in columns, so that a signal is compared with many at once.
//!
//! In: a curve's nodes. Out: for the features of a signal, of every node that may say anything about
//! them how far away it is and how high it peaks. Nodes go in stretches that lie in a box each; what is
//! far outside a box in one coordinate is far from all of its nodes, and most of a curve never is near.

use super::fault_curve::{Node, Seen};
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
    /// Of each of the boxes.
    frequencies: Vec<Interval>,
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

/// Of all nodes of some boxes in ln frequency, so that most are passed over at once. From .. to.
#[derive(Clone, Copy, Debug)]
struct Interval {
    mean: [f64; 2],
    /// As [`Side`].
    moves: [[f64; 2]; 2],
    beyond: f64,
    noise: f64,
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
            frequencies: boxes.iter().map(|sides| Interval::of(&sides[0])).collect(),
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

    /// Compares features with the nodes that are not far from them.
    pub fn compare(&self, x: &Vector4<f64>, seen: Seen, out: &mut Vec<Compared>) {
        #[cfg(target_arch = "x86_64")]
        {
            // SAFETY: the processor was found to have what is asked of it
            if std::is_x86_feature_detected!("avx512f") {
                return unsafe { x86::compare_avx512(self, x, seen, out) };
            }
            // SAFETY: as above
            if std::is_x86_feature_detected!("avx2") {
                return unsafe { x86::compare_avx2(self, x, seen, out) };
            }
        }
        compare(self, x, seen, out);
    }

    /// The middle node of every stretch.
    pub fn middles(&self, nodes: usize) -> impl Iterator<Item = usize> {
        (0..nodes).step_by(NODES).map(move |first| first.midpoint(nodes.min(first + NODES)))
    }
}

/// The terms of nodes that are not far. Returns ln of their scale.
pub fn terms(compared: &[Compared], out: &mut Vec<Terms>) -> f64 {
    #[cfg(target_arch = "x86_64")]
    {
        // SAFETY: the processor was found to have what is asked of it
        if std::is_x86_feature_detected!("avx512f") {
            return unsafe { x86::terms_avx512(compared, out) };
        }
        // SAFETY: as above
        if std::is_x86_feature_detected!("avx2") {
            return unsafe { x86::terms_avx2(compared, out) };
        }
    }
    find_terms(compared, out)
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

impl Interval {
    fn of(side: &Side) -> Interval {
        let span = |of: &OfBoxes| {
            let there = || of.iter().zip(side.low).filter(|(_, low)| *low < f64::INFINITY);
            [
                there().fold(f64::INFINITY, |m, (v, _)| m.min(*v)),
                there().fold(f64::NEG_INFINITY, |m, (v, _)| m.max(*v)),
            ]
        };
        Interval {
            mean: [span(&side.low)[0], span(&side.high)[1]],
            moves: [span(&side.moves[0]), span(&side.moves[1])],
            beyond: span(&side.beyond)[1],
            noise: span(&side.noise)[1],
        }
    }

    /// Whether a box of them may be near.
    #[inline(always)] // compiled once per instruction set
    fn near(&self, x: f64, seen: Seen, noise: f64) -> bool {
        if seen.baseline.is_some() {
            return true;
        }
        let moved = |j: usize| {
            let (p, q) = (self.moves[j][0] * seen.changed[j], self.moves[j][1] * seen.changed[j]);
            if p < q { (p, q) } else { (q, p) }
        };
        let (by_first, by_second) = (moved(0), moved(1));
        let below = self.mean[0] + (by_first.0 + by_second.0) - x;
        let above = x - self.mean[1] - (by_first.1 + by_second.1);
        let outside = below.max(above).max(0.0);
        // a little wider, for rounding
        outside * outside <= 1.001 * FAR * (self.beyond + noise * self.noise)
    }
}

impl Side {
    #[inline(always)] // compiled once per instruction set
    fn near(&self, x: f64, seen: Seen, noise: f64) -> [bool; BOXES] {
        let ([first, second], mut at) = (&self.moves, [0.0; BOXES]);
        for b in 0..BOXES {
            at[b] = x - first[b] * seen.changed[0] - second[b] * seen.changed[1];
        }
        if let Some(own) = seen.baseline {
            for (follows, own) in self.follows.iter().zip(own.iter()) {
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

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::*;

    #[target_feature(enable = "avx512f")]
    pub fn compare_avx512(of: &NodeColumns, x: &Vector4<f64>, seen: Seen, out: &mut Vec<Compared>) {
        compare(of, x, seen, out);
    }

    #[target_feature(enable = "avx2")]
    pub fn compare_avx2(of: &NodeColumns, x: &Vector4<f64>, seen: Seen, out: &mut Vec<Compared>) {
        compare(of, x, seen, out);
    }

    #[target_feature(enable = "avx512f")]
    pub fn terms_avx512(compared: &[Compared], out: &mut Vec<Terms>) -> f64 {
        find_terms(compared, out)
    }

    #[target_feature(enable = "avx2")]
    pub fn terms_avx2(compared: &[Compared], out: &mut Vec<Terms>) -> f64 {
        find_terms(compared, out)
    }
}

#[inline(always)] // compiled once per instruction set
fn compare(of: &NodeColumns, x: &Vector4<f64>, seen: Seen, out: &mut Vec<Compared>) {
    out.clear();
    let noise = 1.0 / (seen.drive * seen.drive);
    for (group, (sides, frequencies)) in of.boxes.iter().zip(&of.frequencies).enumerate() {
        if !frequencies.near(x[FREQUENCY], seen, noise) {
            continue;
        }
        let mut near = [true; BOXES];
        for (side, k) in sides.iter().zip(COORDINATES) {
            let also = side.near(x[k], seen, noise);
            for b in 0..BOXES {
                near[b] &= also[b];
            }
            if near == [false; BOXES] {
                break;
            }
        }
        for (b, near) in near.into_iter().enumerate() {
            if near {
                let stretch = group * BOXES + b;
                let (square, height) = of.stretches[stretch].compare(x, seen, noise);
                out.push(Compared { stretch, square, height });
            }
        }
    }
}

impl Stretch {
    #[inline(always)] // compiled once per instruction set
    fn compare(&self, x: &Vector4<f64>, seen: Seen, noise: f64) -> (Lanes, Lanes) {
        let mut d = [[0.0; NODES]; 4];
        for k in 0..4 {
            let (moves, mean) = (&self.moves[k], &self.mean[k]);
            for i in 0..NODES {
                let moved = moves[0][i] * seen.changed[0] + moves[1][i] * seen.changed[1];
                d[k][i] = x[k] - mean[i] - moved;
            }
            for (follows, own) in
                self.follows[k].iter().zip(seen.baseline.iter().flat_map(|own| own.iter()))
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
        let (mut square, mut height) = ([0.0; NODES], [0.0; NODES]);
        for i in 0..NODES {
            let (mut u, mut v) = ([0.0; 4], [0.0; 4]);
            for k in 0..4 {
                let to_axes = &self.to_axes[k];
                let along = to_axes[0][i] * d[0][i]
                    + to_axes[1][i] * d[1][i]
                    + to_axes[2][i] * d[2][i]
                    + to_axes[3][i] * d[3][i];
                (u[k], v[k]) = (along * along, self.spread[k][i] + noise);
            }
            // sum of u / v with one division
            let (v01, v23) = (v[0] * v[1], v[2] * v[3]);
            let sum = (u[0] * v[1] + u[1] * v[0]) * v23 + (u[2] * v[3] + u[3] * v[2]) * v01;
            let inverse = 1.0 / (v01 * v23);
            square[i] = sum * inverse;
            height[i] = self.determinant[i] * inverse.sqrt();
        }
        (square, height)
    }
}

/// A node by this much less likely, in ln, than the likeliest says nothing.
const NEGLIGIBLE: f64 = 30.0;

#[inline(always)] // compiled once per instruction set
fn find_terms(compared: &[Compared], out: &mut Vec<Terms>) -> f64 {
    out.clear();
    let mut least = [f64::INFINITY; NODES];
    for of in compared {
        for (least, &square) in least.iter_mut().zip(&of.square) {
            *least = if square < *least { square } else { *least };
        }
    }
    let nearest = least.iter().fold(f64::INFINITY, |m, s| m.min(*s));
    for Compared { stretch, square, height } in compared {
        let mut terms = [0.0; NODES];
        for i in 0..NODES {
            let less = 0.5 * (nearest - square[i]);
            let counts = less > -NEGLIGIBLE;
            let exp = exp_of_negative(if counts { less } else { 0.0 });
            terms[i] = if counts { height[i] * exp } else { 0.0 };
        }
        if terms.iter().any(|t| *t > 0.0) {
            out.push(Terms { stretch: *stretch, of: terms });
        }
    }
    -0.5 * nearest
}

/// e^x for x in -700 .. 0 to a few units in the last place, the same on every processor: 2^k times the
/// Taylor series of what is left, |r| <= ln 2 / 2.
#[inline(always)] // compiled once per instruction set
fn exp_of_negative(x: f64) -> f64 {
    /// Added to a number below 2^51 it leaves the nearest integer in the last bits.
    const TO_INTEGER: f64 = 6_755_399_441_055_744.0;
    const LN_2: [f64; 2] = [0.693_147_180_369_123_8, 1.908_214_929_270_587_7e-10];
    const FACTORIALS: [f64; 14] = [
        1.0,
        1.0,
        2.0,
        6.0,
        24.0,
        120.0,
        720.0,
        5040.0,
        40_320.0,
        362_880.0,
        3_628_800.0,
        39_916_800.0,
        479_001_600.0,
        6_227_020_800.0,
    ];
    let shifted = x * std::f64::consts::LOG2_E + TO_INTEGER;
    let k = shifted - TO_INTEGER;
    let r = (x - k * LN_2[0]) - k * LN_2[1];
    let mut sum = 1.0 / FACTORIALS[13];
    for n in (0..13).rev() {
        sum = sum * r + 1.0 / FACTORIALS[n];
    }
    sum * f64::from_bits(shifted.to_bits().wrapping_add(1023) << 52)
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
    fn exponential_is_the_exponential() {
        for i in 0..700_000 {
            let x = -f64::from(i) / 1000.0;
            assert!((exp_of_negative(x) / x.exp() - 1.0).abs() < 1e-15, "{x}");
        }
        assert_eq!(exp_of_negative(0.0), 1.0);
    }

    #[test]
    fn terms_are_the_densities_of_nodes_to_one_scale() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(4);
        let nodes = Node::drawn(300, &mut rng);
        let columns = NodeColumns::of(&nodes);
        let (mut compared, mut terms) = (Vec::new(), Vec::new());
        for at in nodes.iter().step_by(7) {
            let x = at.mean + Vector4::from_fn(|_, _| rng.random_range(-0.02..0.02));
            columns.compare(&x, Seen::as_made(), &mut compared);
            let scale = super::terms(&compared, &mut terms);
            let sum: f64 = terms.iter().flat_map(|of| of.of).sum();
            let all: f64 =
                nodes.iter().map(|node| node.ln_density(&x, Seen::as_made()).exp()).sum();
            let found = scale + sum.ln() - 2.0 * TAU.ln();
            assert!((found - all.ln()).abs() < 1e-9, "{found} {}", all.ln());
        }
    }
}
