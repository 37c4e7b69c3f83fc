//! Fault curves: how one kind of fault moves a ring's features as its severity grows, predicted by
//! the physics alone. thesis (2-2), §2-2 1)-4). Nothing here is learned from faults.
//!
//! In: a healthy channel's rates (a, b, g, d) and actuation, the healthy ring, the law of a fault,
//! how healthy channels differ, and how uncertain the rates are. Out: the [`Node`]s of a curve. A
//! node is a Gaussian density of the four features (ln amplitude, ln damping, ln frequency, phase
//! in rad, relative to the healthy ring) at one severity. The steps of [`fault_curve`]:
//!
//! 1. At 65 severities from no fault to the largest, change the rates by the law, simulate the
//!    decay without noise, and fit a ring to it as to a signal ([`super::fault_simulator`]).
//! 2. Differentiate the features by each channel's own changes of its rates and gain, and by errors
//!    of the parameters that all channels share (central differences).
//! 3. Covariance of the features at a severity: the channels' own changes through the first
//!    derivative, what is uncertain of the physics ([`super::discrepancy`]), and a fit's noise.
//! 4. Place nodes along the curve, equally far apart in standard deviations of a signal.
//! 5. Rotate each node's covariance to axes in which noise and other scatter are both diagonal
//!    (`Node::scattered`), so that densities at any drive need no inversion.

use super::discrepancy::Discrepancy;
use super::fault_simulator::{CHANGES, FaultSimulator, Point, Slope, Square, of_change, wrapped};
use crate::model::faults::Law;
use nalgebra::{Matrix2, Matrix4, Matrix4x2, SMatrix, SymmetricEigen, Vector2, Vector4};

/// How healthy features are distributed (the phase free), and what is uncertain of the physics.
#[derive(Clone, Debug)]
pub struct HealthySpread {
    pub slope: Slope,
    pub channels: Square,
    /// Variance of the phase by what no rate changes.
    pub phase: f64,
    /// Covariance of the features due to noise, at the reference drive.
    pub noise: Matrix4<f64>,
    /// Covariance of the errors of the shared parameters.
    pub belief: Square,
    /// Derivative of [`Conditions::changed`] by (ln damping, ln frequency) of the healthy ring.
    pub change: Matrix2<f64>,
}

#[derive(Clone, Copy, Debug)]
pub struct Conditions<'a> {
    /// Drive over the reference, divided by the present noise over that for which the curves were
    /// made: the features' noise variance is that at the reference drive over its square.
    pub drive: f64,
    /// ln of the stiffness (a, b) and of the viscosity (g, d) of all channels, relative to when the
    /// curves were made: another ink temperature, window or printhead.
    pub changed: Vector2<f64>,
    /// The channel's own healthy level; only with [`Node::of_one_channel`].
    pub baseline: Option<&'a Vector4<f64>>,
}

impl Conditions<'_> {
    pub fn as_made() -> Conditions<'static> {
        Conditions { drive: 1.0, changed: Vector2::zeros(), baseline: None }
    }
}

/// A Gaussian density of the features at one severity, or of an alternative, without severity.
#[derive(Clone, Debug, Default)]
pub struct Node {
    pub severity: f64,
    /// Severity in the coordinate of [`Law::scale`], and the length of the node's interval there.
    pub place: f64,
    pub length: f64,
    /// Probability of the assumption on which `belief` rests ([`fault_curve`]).
    pub weight: f64,
    /// Mean of the features under the conditions for which the curve was made.
    pub mean: Vector4<f64>,
    slope: Slope,
    /// Covariance of the mean: how far the physics may be wrong.
    belief: Matrix4<f64>,
    noise: Matrix4<f64>,
    pub(super) by_change: Matrix4x2<f64>,
    /// Derivative of the mean by [`Conditions::baseline`]; 0 but in one channel's curves.
    pub(super) by_baseline: Matrix4<f64>,
    /// In u = to_axes (x - mean) the noise at the reference drive has unit covariance and all other
    /// scatter the diagonal covariance `spread`.
    pub(super) to_axes: Matrix4<f64>,
    pub(super) spread: Vector4<f64>,
    pub(super) ln_determinant: f64,
}

/// Number of steps of severity at which decays are simulated; between, interpolation is linear.
const POINTS: usize = 64;
/// Distance of neighbouring nodes, in standard deviations of a signal of any channel. A sum over
/// Gaussians that lie h apart differs from their integral by 2 exp(-2 pi²/h²) of it (Poisson's
/// summation formula): nothing here, but up to 2 % about a channel's own level, where signals
/// scatter less, down to a third.
const NODE_DISTANCE: f64 = 0.7;
/// Largest number of nodes between two neighbouring points.
const MOST_BETWEEN: f64 = 48.0;

/// From no fault to the `largest` severity, once as if the law held and once as it was found to be
/// wrong, each as probable as [`Discrepancy`] says. `law`: of any class of the kind. `None`: at some
/// severity the channel does not ring or cannot be fitted.
pub fn fault_curve(
    simulator: &mut FaultSimulator,
    law: &Law,
    largest: f64,
    (healthy, discrepancy): (&HealthySpread, &Discrepancy),
) -> Option<Vec<Node>> {
    let none = law.scale(law.none());
    let most = law.scale(largest);
    let points: Vec<Point> = (0..=POINTS)
        .map(|i| simulator.point(law, none + (most - none) * i as f64 / POINTS as f64))
        .collect::<Option<_>>()?;

    let held = points.iter().map(|point| {
        let belief = point.belief_slope * healthy.belief * point.belief_slope.transpose();
        Some(Believed { belief, point: point.clone() })
    });
    let learned = discrepancy.learned();
    let wrong = points.iter().map(|point| {
        let (off, belief) = learned.at(law, largest, point);
        let mean = wrapped(point.mean + off);
        let noise = simulator.noise_at(mean)?;
        Some(Believed { belief, point: Point { mean, noise, ..point.clone() } })
    });
    let [held, wrong] = [held.collect::<Option<Vec<_>>>()?, wrong.collect::<Option<Vec<_>>>()?];
    let mut nodes = Vec::new();
    let holds = discrepancy.holds().unwrap_or(0.0);
    for (points, weight) in [(held, holds), (wrong, 1.0 - holds)] {
        if weight > LEAST_WEIGHT {
            nodes.extend(nodes_along(&points, law, weight, healthy)?);
        }
    }
    // features are relative to the healthy ones, which a common change moves as well
    let own = |node: &Node| of_change(&(node.slope - healthy.slope));
    nodes.iter_mut().for_each(|node| node.by_change = own(node));
    Some(nodes)
}

/// An assumption that is less probable is left out.
const LEAST_WEIGHT: f64 = 1e-3;

struct Believed {
    point: Point,
    /// Covariance of the point's mean: how far the physics may be wrong.
    belief: Matrix4<f64>,
}

/// Each node is for an interval of severities of `NODE_DISTANCE` at most (but for `MOST_BETWEEN`).
/// `points`: at equal steps of their place. `None`: a covariance is singular.
fn nodes_along(
    points: &[Believed],
    law: &Law,
    weight: f64,
    healthy: &HealthySpread,
) -> Option<Vec<Node>> {
    // distance of each point from the first along the curve, in standard deviations of a signal
    let mut distances = vec![0.0];
    for pair in points.windows(2) {
        let [Believed { point: from, belief }, Believed { point: to, .. }] = pair else { continue };
        let step = wrapped(to.mean - from.mean);
        let mut own = from.slope * healthy.channels * from.slope.transpose() + from.noise + belief;
        own[(3, 3)] += healthy.phase;
        let distance = step.dot(&(own.try_inverse()? * step)).sqrt();
        distances.push(distances[distances.len() - 1] + distance.min(MOST_BETWEEN * NODE_DISTANCE));
    }

    let total = distances[points.len() - 1];
    let n = (total / NODE_DISTANCE).ceil().max(1.0);
    // the inverse of `distances`: how many steps from the first point a distance lies
    let steps_at = |distance: f64| {
        let k = distances.partition_point(|d| *d < distance).clamp(1, points.len() - 1);
        let (before, step) = (distances[k - 1], distances[k] - distances[k - 1]);
        (k - 1) as f64 + if step > 0.0 { ((distance - before) / step).min(1.0) } else { 0.5 }
    };

    // Node i stands for the i-th of n parts of the curve, equally long, and has the features at the
    // middle of its severities. `begins`, `ends`, `steps` count steps from the first point.
    let end = |i: f64| if i < n { steps_at(total * i / n) } else { (points.len() - 1) as f64 };
    let node = |i: usize| {
        let (begins, ends) = (end(i as f64), end(i as f64 + 1.0));
        let steps = 0.5 * (begins + ends);
        let share = steps.fract();
        let [before, after] =
            [steps as usize, (steps as usize + 1).min(points.len() - 1)].map(|i| &points[i]);
        let (from, to) = (&before.point, &after.point);
        let place = from.place + share * (to.place - from.place);
        let mean = wrapped(from.mean + wrapped(to.mean - from.mean) * share);
        let node = Node {
            severity: law.severity_at(place),
            place,
            length: (ends - begins) * (points[1].point.place - points[0].point.place).abs(),
            weight,
            belief: before.belief * (1.0 - share) + after.belief * share,
            noise: from.noise * (1.0 - share) + to.noise * share,
            mean,
            slope: from.slope * (1.0 - share) + to.slope * share,
            ..Node::default()
        };
        node.among(healthy)
    };
    (0..n as usize).map(node).collect()
}

impl Node {
    /// For an alternative: signals of healthy channels, displaced to `mean` with the additional
    /// covariance `belief`. `noise`: of a fit there. `None`: a covariance is singular.
    pub fn displaced(
        mean: Vector4<f64>,
        belief: Matrix4<f64>,
        noise: Matrix4<f64>,
        healthy: &HealthySpread,
    ) -> Option<Node> {
        let node = Node { mean, slope: healthy.slope, belief, noise, ..Node::default() };
        node.among(healthy)
    }

    /// The node for signals of any channel.
    fn among(self, healthy: &HealthySpread) -> Option<Node> {
        let mut beyond = self.slope * healthy.channels * self.slope.transpose() + self.belief;
        beyond[(3, 3)] += healthy.phase;
        self.scattered(&beyond)
    }

    /// `beyond`: covariance of all scatter but the noise. `None`: a covariance is singular.
    fn scattered(self, beyond: &Matrix4<f64>) -> Option<Node> {
        // With noise = L L^T, L^-1 whitens the noise; the eigenvectors of the scatter after that
        // make the scatter diagonal, too, and leave the noise white.
        let inverse = self.noise.cholesky()?.l().try_inverse()?;
        let whitened = inverse * beyond * inverse.transpose();
        let SymmetricEigen { eigenvalues, eigenvectors } = SymmetricEigen::new(whitened);
        let to_axes = eigenvectors.transpose() * inverse;
        let ln_determinant = to_axes.determinant().abs().ln();
        let spread = eigenvalues.map(|v| v.max(0.0));
        let finite = ln_determinant.is_finite() && spread.iter().all(|v| v.is_finite());
        finite.then_some(Node { to_axes, spread, ln_determinant, ..self })
    }

    /// For one channel whose baseline is known: its own changes have the mean `gain` times that,
    /// and the covariance `left` ([`super::physics_density::FaultCurves::of_one_channel`]). `shot`:
    /// covariance of its signals beyond the noise. `None`: a covariance is singular.
    pub fn of_one_channel(
        &self,
        gain: &SMatrix<f64, CHANGES, 4>,
        left: &Square,
        shot: &Matrix4<f64>,
    ) -> Option<Node> {
        let beyond = self.slope * left * self.slope.transpose() + shot + self.belief;
        let own = Node { by_baseline: self.slope * gain, ..self.clone() };
        own.scattered(&beyond)
    }
}

impl Node {
    /// Of the features: of all scatter but the noise, and of the noise at the reference drive.
    pub fn variances(&self) -> [Vector4<f64>; 2] {
        let back = self.to_axes.try_inverse().unwrap_or_else(Matrix4::identity);
        let along = |u: &Vector4<f64>| back * Matrix4::from_diagonal(u) * back.transpose();
        [along(&self.spread).diagonal(), along(&Vector4::repeat(1.0)).diagonal()]
    }
}

#[cfg(test)]
impl Node {
    /// Features in the node's axes, as distances from its mean under these conditions.
    fn along_axes(&self, x: &Vector4<f64>, conditions: Conditions) -> Vector4<f64> {
        let changed = self.by_change * conditions.changed;
        let moved = conditions.baseline.map_or(changed, |own| changed + self.by_baseline * own);
        self.to_axes * wrapped(x - (self.mean + moved))
    }

    /// ln of the density of features under these conditions, given the node's severity: what
    /// [`super::node_columns`] computes for many nodes at once.
    pub fn ln_density(&self, x: &Vector4<f64>, conditions: Conditions) -> f64 {
        let u = self.along_axes(x, conditions);
        let noise = 1.0 / (conditions.drive * conditions.drive);
        let (mut square, mut product) = (0.0, 1.0);
        for j in 0..4 {
            let variance = self.spread[j] + noise;
            square += u[j] * u[j] / variance;
            product *= variance;
        }
        self.ln_determinant - 0.5 * (square + product.ln()) - super::physics_density::LN_TAU_SQUARED
    }

    /// Random nodes along a curve, for tests.
    pub fn drawn(n: usize, rng: &mut impl rand::RngExt) -> Vec<Node> {
        let mut within = |bound: f64| rng.random_range(-bound..bound);
        let node = |i: usize| {
            let t = i as f64 / n as f64;
            let factor =
                Matrix4::from_fn(|_, _| within(0.01)) + Matrix4::from_diagonal_element(0.02);
            let spread = Matrix4::from_fn(|_, _| within(0.02));
            let node = Node {
                severity: t,
                place: t,
                length: 1.0 / n as f64,
                noise: factor * factor.transpose(),
                by_change: Matrix4x2::from_fn(|_, _| within(0.5)),
                by_baseline: Matrix4::from_fn(|_, _| within(0.5)),
                mean: Vector4::new(-t, 2.0 * t, -0.1 * t, 7.0 * t - 3.0),
                weight: 1.0,
                ..Node::default()
            };
            node.scattered(&(spread * spread.transpose()))
        };
        (0..n).filter_map(node).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_density_at_a_node_is_that_of_its_scatter_and_the_noise() {
        use rand::SeedableRng;
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(7);
        for node in Node::drawn(20, &mut rng) {
            let [other, noise] = node.variances();
            assert!(other.iter().chain(&noise).all(|v| *v >= 0.0));
            // ln of a Gaussian at its mean: -1/2 ln det (2 pi covariance)
            let back = node.to_axes.try_inverse().unwrap();
            let variance = node.spread + Vector4::repeat(1.0);
            let covariance = back * Matrix4::from_diagonal(&variance) * back.transpose();
            let turns = std::f64::consts::TAU.powi(4);
            let want = -0.5 * (turns * covariance.determinant()).ln();
            let found = node.ln_density(&node.mean, Conditions::as_made());
            assert!((found - want).abs() < 1e-9, "{found}, not {want}");
            assert!((covariance.diagonal() - other - noise).amax() < 1e-12);
        }
    }
}
