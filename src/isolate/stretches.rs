//! Which part of a fault curve is near some features: most of it never is.
//!
//! In: a curve's nodes. Out: for features the ranges of nodes that may say anything about them. The
//! nodes of a stretch lie in a box; what is far outside the box in one coordinate is far from all of
//! them.

use super::fault_curve::{Node, Seen};
use nalgebra::Vector4;
use std::ops::Range;

/// Nodes of a stretch.
const NODES: usize = 16;
/// Squared distance in one coordinate from which on a node says nothing: e^-30 of its peak.
const FAR: f64 = 60.0;
/// Amplitude, damping, frequency; a phase comes round again.
const COORDINATES: usize = 3;

#[derive(Clone, Debug)]
pub struct Stretches(Vec<Stretch>);

#[derive(Clone, Debug)]
struct Stretch {
    nodes: Range<usize>,
    low: Vector4<f64>,
    high: Vector4<f64>,
    /// Largest variances: beyond the noise, and of the noise at the reference drive.
    beyond: Vector4<f64>,
    noise: Vector4<f64>,
}

impl Stretches {
    pub fn of(nodes: &[Node]) -> Stretches {
        let stretch = |(i, nodes): (usize, &[Node])| {
            let mut new = Stretch {
                nodes: i * NODES..i * NODES + nodes.len(),
                low: nodes[0].mean,
                high: nodes[0].mean,
                beyond: Vector4::zeros(),
                noise: Vector4::zeros(),
            };
            for node in nodes {
                let [beyond, noise] = node.variances();
                new.low = new.low.inf(&node.mean);
                new.high = new.high.sup(&node.mean);
                new.beyond = new.beyond.sup(&beyond);
                new.noise = new.noise.sup(&noise);
            }
            new
        };
        Stretches(nodes.chunks(NODES).enumerate().map(stretch).collect())
    }

    /// Nodes that are not far from features. `nodes`: the curve's.
    pub fn near(
        &self,
        x: &Vector4<f64>,
        seen: Seen,
        nodes: &[Node],
    ) -> impl Iterator<Item = usize> {
        let noise = 1.0 / (seen.drive * seen.drive);
        let is_near = move |of: &&Stretch| {
            let x = x - nodes[of.nodes.start].moved(seen);
            (0..COORDINATES).all(|k| {
                let outside = (of.low[k] - x[k]).max(x[k] - of.high[k]).max(0.0);
                let variance = of.beyond[k] + noise * of.noise[k];
                outside * outside <= FAR * variance
            })
        };
        self.0.iter().filter(is_near).flat_map(|of| of.nodes.clone())
    }

    /// The middle of every stretch.
    pub fn middles(&self) -> impl Iterator<Item = usize> {
        self.0.iter().map(|of| of.nodes.start.midpoint(of.nodes.end))
    }
}
