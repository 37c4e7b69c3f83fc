//! Fault curves: how one kind of fault moves a ring's features as its severity grows, predicted by
//! the physics alone. thesis (2-2), §2-2 1)-4). Nothing here is learned from faults.
//!
//! In, from [`super::fault_physics`]: a healthy channel's rates (a, b, g, d) and actuation, the
//! healthy ring that signals are compared with, the law of a fault, how healthy channels differ,
//! and how uncertain the rates are. Out: the [`Node`]s of a curve. A node is a Gaussian density of
//! the four features (ln amplitude, ln damping, ln frequency, phase in rad, all relative to the
//! healthy ring) at one severity. [`super::physics_density`] sums over the nodes of a class;
//! `node_columns.rs` does it fast.
//!
//! The steps of [`fault_curve`]:
//!
//! 1. At 65 severities from no fault to the largest: change the healthy rates by the law. The rates
//!    give the poles and, through B_u and the actuation, the state at t_a. Simulate the decay
//!    without noise, and fit a ring to it exactly as to a signal, so that the fit's own bias (it
//!    holds the healthy real pole) is part of the curve. ([`FaultSimulator::point`])
//! 2. Differentiate the fitted features by each channel's own changes of its rates and gain, and by
//!    errors of the parameters that all channels share (central differences).
//! 3. Covariance of the features at a severity: the channels' own changes through the first
//!    derivative, plus what is uncertain of the physics through the second (`Trust`), plus the
//!    noise of a fit.
//! 4. Place nodes along the curve, at equal distances in standard deviations of a signal, by
//!    interpolation between the 65 points (`nodes_along`).
//! 5. Rotate each node's covariance to axes in which noise and other scatter are both diagonal
//!    (`Node::scattered`), so that densities at any drive need no inversion.

use super::tuned;
use crate::model::faults::Law;
use crate::model::ring_down::{Poles, ring_down_into};
use crate::model::ring_fit::{Features, Products, RingFitter};
use crate::model::{Actuation, InkChannel};
use crate::numbers::tuned::guessed_rate;
use nalgebra::{Matrix2, Matrix4, Matrix4x2, SMatrix, SVector, SymmetricEigen, Vector2, Vector4};

/// Number of parameters in which a channel may differ from the mean channel: relative changes of its four
/// rates and of its gain, that is ln a, ln b, ln g, ln d, ln gain.
pub const CHANGES: usize = 5;
/// Jacobian of the features (ln amplitude, ln damping, ln frequency, phase) with respect to these changes.
pub type Slope = SMatrix<f64, 4, CHANGES>;

/// A covariance of a channel's own [`CHANGES`], or of the five parameters that all channels share:
/// ln a, ln b, ln g, ln d, ln pulse.
pub type Square = SMatrix<f64, CHANGES, CHANGES>;

/// The distribution of healthy features (fitted with the phase free), and what is uncertain of the
/// physics.
#[derive(Clone, Debug)]
pub struct HealthySpread {
    /// Jacobian of the healthy features with respect to a channel's own changes.
    pub slope: Slope,
    /// Covariance of a channel's own changes over channels.
    pub channels: Square,
    /// Covariance of the features that noise causes in a fit, at the reference drive.
    pub noise: Matrix4<f64>,
    /// Covariance of the errors of the parameters that all channels share: ln a, ln b, ln g, ln d, ln pulse.
    pub belief: Square,
    /// Derivative of [`Conditions::changed`] by (ln damping, ln frequency) of the healthy ring: it turns a
    /// measured change of the healthy ring into one of stiffness and viscosity.
    pub change: Matrix2<f64>,
}

/// A healthy channel's physical parameters, and how it is actuated.
#[derive(Clone, Copy, Debug)]
pub struct Healthy {
    pub channel: InkChannel,
    pub actuation: Actuation,
}

/// The features that a fit finds in the simulated decay of the mean channel with a fault of one
/// severity, and their derivatives.
#[derive(Clone, Debug)]
pub struct Point {
    /// The fault's severity in the coordinate of [`Law::scale`] (the severity itself, or the ln of
    /// a factor).
    pub place: f64,
    /// The fitted features, relative to those of the healthy channel.
    pub mean: Vector4<f64>,
    /// Derivatives of the features with respect to one channel's own [`CHANGES`].
    pub slope: Slope,
    /// Derivatives of the features with respect to errors of the parameters that all channels share: ln a, ln
    /// b, ln g, ln d, ln pulse. The healthy features do not change with these errors, since they were
    /// measured.
    pub belief_slope: Slope,
    /// Covariance of the fit's noise at the reference drive.
    pub noise: Matrix4<f64>,
}

/// An actuation, and the features of the healthy channel after it, from which those of faults are counted.
#[derive(Clone, Copy, Debug)]
struct Reference {
    actuation: Actuation,
    origin: Vector4<f64>,
}

/// Simulates noise-free decays of the mean channel with faults, and fits them as signals are
/// fitted.
#[derive(Clone)]
pub struct FaultSimulator<'a> {
    fitter: &'a RingFitter,
    /// The healthy channel.
    channel: InkChannel,
    /// Standard deviation of one sample's noise, counts.
    noise: f64,
    /// The actuation with the nominal pulse, with a longer and with a shorter one, for the derivative by ln
    /// pulse.
    references: [Reference; 3],
    /// Derivatives of the healthy channel's features by its own changes, with the phase free.
    healthy_slope: Slope,
    healthy_poles: Poles,
    /// Buffers: the decay that is fitted, N, counts, and the fitter's own.
    decay: Vec<f64>,
    work: Products,
}

/// Step of ln rate and ln pulse for central differences.
const STEP: f64 = 0.01;

impl<'a> FaultSimulator<'a> {
    /// Prepares the three actuations and the healthy derivatives. `noise`: standard deviation of one sample's
    /// noise, counts. `None`: the healthy channel does not ring.
    pub fn new(fitter: &'a RingFitter, healthy: Healthy, noise: f64) -> Option<FaultSimulator<'a>> {
        let Healthy { channel, actuation } = healthy;
        let reference = Reference { actuation, origin: Vector4::zeros() };
        let mut simulator = FaultSimulator {
            fitter,
            channel,
            noise,
            references: [reference; 3],
            healthy_slope: Slope::zeros(),
            healthy_poles: channel.poles()?,
            decay: vec![0.0; fitter.samples],
            work: Products::default(),
        };
        // each pulse length needs a delay of its own to keep the measured healthy phase
        for (k, by) in [0.0, STEP, -STEP].into_iter().enumerate() {
            let pulse_s = actuation.pulse_s * by.exp();
            simulator.references[k] = simulator.reference(Actuation { pulse_s, ..actuation })?;
        }
        simulator.healthy_slope = simulator.slope(&Some)?.1;
        Some(simulator)
    }

    /// The actuation `set` with its delay adapted such that the simulated healthy phase is the
    /// measured one (a fitted phase of 0, since features are relative to the measured ring), and
    /// the healthy features then. The measured phase determines the delay far better than a setting
    /// does. Where that would need a negative delay or a shift of phase beyond 1.5 rad, the delay
    /// remains as set. `None`: the decay cannot be fitted.
    fn reference(&mut self, set: Actuation) -> Option<Reference> {
        const MOST_PHASE_RAD: f64 = 1.5;
        let omega = std::f64::consts::TAU * self.healthy_poles.frequency_hz;
        let channel = self.channel;
        let mut actuation = set;
        for _ in 0..4 {
            // a phase that is ahead of the measured one means that the acquisition begins too late
            let ahead = self.fit(&channel, &actuation, None)?[3];
            let delay_s = actuation.delay_s - ahead / omega;
            if ahead.abs() > MOST_PHASE_RAD || delay_s < 0.0 {
                actuation = set;
                break;
            }
            actuation.delay_s = delay_s;
        }
        // the healthy channel's features with this delay; its gain of 1 is arbitrary, so its ln amplitude is
        // not 0
        let origin = self.fit(&channel, &actuation, None)?;
        Some(Reference { actuation, origin })
    }

    /// Features fitted, with the phase free, to the simulated decay of a channel with gain 1. The
    /// fit starts from `near`, or else from a coarse search. `None`: no ring fits.
    fn fit(
        &mut self,
        channel: &InkChannel,
        actuation: &Actuation,
        near: Option<&Vector4<f64>>,
    ) -> Option<Vector4<f64>> {
        let x_a = actuation.acquisition_state(channel, 1.0);
        ring_down_into(channel, &x_a, self.fitter.dt_s, &mut self.decay);
        let fit = match near {
            Some(x) => self.fitter.fit_from(&self.decay, &Features::from(*x), true),
            None => self.fitter.fit(&self.decay, true, &mut self.work),
        };
        Some(fit?.features.coordinates())
    }

    /// Features of the channel after `fault` has changed its rates, and their derivatives by the
    /// channel's own [`CHANGES`], by central differences in the rates before the fault. The
    /// features are as fitted, not yet relative to those of the healthy channel. `None`: a channel
    /// does not ring or cannot be fitted.
    fn slope(
        &mut self,
        fault: &dyn Fn(InkChannel) -> Option<InkChannel>,
    ) -> Option<(Vector4<f64>, Slope)> {
        let (channel, actuation) = (self.channel, self.references[0].actuation);
        let found = self.fit(&fault(channel)?, &actuation, None)?;
        let mut slope = Slope::zeros();
        slope[(0, 4)] = 1.0; // ln gain adds to ln amplitude
        for j in 0..4 {
            let mut moved = |step: f64| {
                let mut by = [1.0; 4];
                by[j] = step.exp();
                self.fit(&fault(channel.times(by))?, &actuation, Some(&found))
            };
            let (up, down) = (moved(STEP)?, moved(-STEP)?);
            slope.set_column(j, &(turned(up - down) / (2.0 * STEP)));
        }
        Some((found, slope))
    }

    /// A channel's decay, N, counts, with the nominal actuation and with the gain that gives the
    /// healthy channel its measured amplitude. `None`: it is not finite.
    pub fn decay(&self, channel: &InkChannel) -> Option<Vec<f64>> {
        let Reference { actuation, origin } = self.references[0];
        let x_a = actuation.acquisition_state(channel, (-origin[0]).exp());
        let mut decay = vec![0.0; self.decay.len()];
        ring_down_into(channel, &x_a, self.fitter.dt_s, &mut decay);
        decay.iter().all(|y| y.is_finite()).then_some(decay)
    }

    /// Derivatives of the healthy features by a channel's own changes, with the phase free.
    pub fn healthy_slope(&self) -> &Slope {
        &self.healthy_slope
    }

    /// The features, and their derivatives, of a fault whose severity is given in the coordinate of
    /// [`Law::scale`]. `None`: a channel with that fault does not ring or cannot be fitted.
    pub fn point(&mut self, law: &Law, place: f64) -> Option<Point> {
        let severity = law.severity_at(place);
        let fault = |channel: InkChannel| law.apply(severity, &channel);
        let (found, slope) = self.slope(&fault)?;
        let faulty = fault(self.channel)?;

        // Derivative by ln pulse. Both features are taken relative to the healthy channel's with the same
        // pulse, since the healthy features were measured whatever the pulse is.
        let [believed, longer, shorter] = self.references;
        let mut moved =
            |to: Reference| Some(self.fit(&faulty, &to.actuation, Some(&found))? - to.origin);
        let of_pulse = turned(moved(longer)? - moved(shorter)?) / (2.0 * STEP);

        // A fault may also change the signal by a factor, which no rate does. The mean is relative
        // to the healthy features.
        let gain = Vector4::new(law.gain(severity).ln(), 0.0, 0.0, 0.0);
        let mean = turned(found + gain - believed.origin);

        // Derivatives by errors of the believed rates. Such an error changes faulty and healthy
        // features alike; but the healthy ones were measured and must stay, so only the difference
        // of the two derivatives counts. The healthy phase is kept by another delay, 1 / omega
        // times what the error would add to the phase. That delay turns and damps the faulty ring
        // otherwise than the healthy one, because its frequency and damping are others: hence the
        // corrections of phase and amplitude.
        let Poles { damping_per_s, frequency_hz, .. } = self.healthy_poles;
        let omega = std::f64::consts::TAU * frequency_hz;
        let mut belief_slope = slope - self.healthy_slope;
        for j in 0..4 {
            let phase = self.healthy_slope[(3, j)];
            belief_slope[(0, j)] += phase * damping_per_s * mean[1].exp_m1() / omega;
            belief_slope[(3, j)] = slope[(3, j)] - phase * mean[2].exp();
        }
        belief_slope.set_column(4, &of_pulse);
        let noise = self.fitter.noise_covariance(&Features::from(mean), self.noise)?;
        Some(Point { place, mean, slope, belief_slope, noise })
    }
}

/// Derivatives of the features by a change of ln stiffness, which a and b have in common, and by a
/// change of ln viscosity, which g and d have in common: sums of two columns of the Jacobian each.
pub fn of_change(slope: &Slope) -> Matrix4x2<f64> {
    let column = |i: usize, j: usize| slope.column(i) + slope.column(j);
    Matrix4x2::from_columns(&[column(0, 1), column(2, 3)])
}

/// The features with their phase brought to -pi .. pi by whole turns.
pub fn turned(mut x: Vector4<f64>) -> Vector4<f64> {
    if x[3].abs() <= std::f64::consts::PI {
        return x;
    }
    x[3] -= std::f64::consts::TAU * (x[3] / std::f64::consts::TAU).round();
    x
}

/// The conditions under which a signal was acquired.
#[derive(Clone, Copy, Debug)]
pub struct Conditions<'a> {
    /// The signal's drive voltage over the reference voltage, divided by the ratio of the present
    /// noise of a sample to the noise for which the curves were made. The features' noise variance
    /// is that at the reference drive over the square of this number.
    pub drive: f64,
    /// ln of the stiffness (a, b) and of the viscosity (g, d) of all channels, relative to those
    /// for which the curves were made. They differ with another ink temperature, window or
    /// printhead.
    pub changed: Vector2<f64>,
    /// The features of the channel's own healthy level; only with the curves of one channel
    /// ([`Node::of_one_channel`]).
    pub baseline: Option<&'a Vector4<f64>>,
}

impl Conditions<'_> {
    /// The conditions for which the curves were made.
    pub fn as_made() -> Conditions<'static> {
        Conditions { drive: 1.0, changed: Vector2::zeros(), baseline: None }
    }
}

/// A point of a fault curve: a Gaussian density of the features at one severity, ready to be compared with a
/// signal.
#[derive(Clone, Debug)]
pub struct Node {
    /// Severity in the law's unit.
    pub severity: f64,
    /// Severity in the coordinate of [`Law::scale`], and, in the same coordinate, the length of the
    /// interval of severities that the node stands for.
    pub place: f64,
    pub length: f64,
    /// Prior probability of the assumption on which `belief` rests, of how far the physics may be wrong. Over
    /// the nodes of one severity, which differ in that assumption, the weights sum to 1.
    pub weight: f64,
    /// Mean of the features under the conditions for which the curve was made.
    pub mean: Vector4<f64>,
    /// Derivatives of the mean by a channel's own changes.
    slope: Slope,
    /// Covariance of the mean: how far the physics may be wrong.
    belief: Matrix4<f64>,
    /// Covariance of the fit's noise at the reference drive.
    noise: Matrix4<f64>,
    /// Derivative of the mean by [`Conditions::changed`].
    pub(super) by_change: Matrix4x2<f64>,
    /// Derivative of the mean by [`Conditions::baseline`]; 0 but in one channel's curves.
    pub(super) by_baseline: Matrix4<f64>,
    /// u = to_axes (x - mean) are coordinates in which the noise at the reference drive has unit covariance
    /// and all other scatter has the diagonal covariance `spread` (simultaneous diagonalisation). So the
    /// density at any drive needs no inversion.
    pub(super) to_axes: Matrix4<f64>,
    /// Variances along the axes of all scatter but the noise, in units of the noise's at the
    /// reference drive.
    pub(super) spread: Vector4<f64>,
    /// ln |det `to_axes`|.
    pub(super) ln_determinant: f64,
}

impl Node {
    /// Variances of the four features themselves (not along the axes): first those of all scatter
    /// but the noise, then those of the noise at the reference drive.
    pub fn variances(&self) -> [Vector4<f64>; 2] {
        // x = to_axes^-1 u, where the noise is unit
        let back = self.to_axes.try_inverse().unwrap_or_else(Matrix4::identity);
        let along = |u: &Vector4<f64>| back * Matrix4::from_diagonal(u) * back.transpose();
        [along(&self.spread).diagonal(), along(&Vector4::repeat(1.0)).diagonal()]
    }

    /// By how much the node's mean differs from `mean` under these conditions.
    pub fn moved(&self, conditions: Conditions) -> Vector4<f64> {
        let changed = self.by_change * conditions.changed;
        conditions.baseline.map_or(changed, |own| changed + self.by_baseline * own)
    }
}

/// An assumption about how far the physics may be wrong about a class. Every curve is made once
/// under each assumption, and the two are mixed (docs/names.md). The two assumptions and their even
/// weights are heuristic.
#[derive(Clone, Copy, Debug)]
enum Trust {
    /// The law of the fault is right, and the rates are wrong as much as their posterior covariance says.
    InRates,
    /// The rates are no better than guesses (`guessed_rate`), and the law of the fault holds only
    /// roughly: of each feature it may miss `of_law`, or `share_of_law` of the change, whichever is
    /// more.
    InDirection,
}

impl Trust {
    /// The prior probabilities of the two assumptions.
    const ALL: [(Trust, f64); 2] = [(Trust::InRates, 0.5), (Trust::InDirection, 0.5)];

    /// Covariance of a node's mean under this assumption. `believed`: derivatives of the features by the
    /// shared parameters ([`Point::belief_slope`]); `mean`: the node's mean; `belief`: covariance of the errors
    /// of these parameters.
    fn covariance(self, believed: &Slope, mean: &Vector4<f64>, belief: &Square) -> Matrix4<f64> {
        match self {
            Trust::InRates => believed * belief * believed.transpose(),
            Trust::InDirection => {
                let (rate, pulse) = (guessed_rate(), tuned::pulse_sd());
                let guessed = SVector::from([rate, rate, rate, rate, pulse]).map(|sd| sd * sd);
                let law = Vector4::from_fn(|j, _| {
                    tuned::of_law()[j].powi(2).max((tuned::share_of_law() * mean[j]).powi(2))
                });
                let rates = SMatrix::from_diagonal(&guessed);
                believed * rates * believed.transpose() + Matrix4::from_diagonal(&law)
            }
        }
    }
}

/// Number of steps of severity between the points at which decays are simulated and fitted; between
/// two points the curve is interpolated linearly.
const POINTS: usize = 64;
/// Distance of neighbouring nodes, in standard deviations of a signal of any channel. A sum over Gaussians
/// that lie h apart differs from their integral by 2 exp(-2 pi²/h²) of it (Poisson's summation formula),
/// which is nothing here. About a channel's own level signals scatter less, down to a third, so that the
/// distance becomes .7 to 2.1 and the difference up to 2 %. With a distance of 1.2 where the physics is
/// trusted least, certainties move by .013 at most and severities by .04, because of how a class's range is
/// shared out to its nodes.
const NODE_DISTANCE: f64 = 0.7;
/// Largest number of nodes between two neighbouring points; where the curve would need more, nodes
/// are farther apart than `NODE_DISTANCE`.
const MOST_BETWEEN: f64 = 48.0;

/// The nodes of one kind of fault, from no fault to the `largest` severity, once for each
/// assumption about the physics. `law`: of any class of that kind. `None`: at one of the severities
/// the channel does not ring or cannot be fitted.
pub fn fault_curve(
    simulator: &mut FaultSimulator,
    law: &Law,
    largest: f64,
    healthy: &HealthySpread,
) -> Option<Vec<Node>> {
    // simulate and fit at equal steps of the severity's coordinate
    let none = law.scale(law.none());
    let most = law.scale(largest);
    let points: Vec<Point> = (0..=POINTS)
        .map(|i| simulator.point(law, none + (most - none) * i as f64 / POINTS as f64))
        .collect::<Option<_>>()?;
    // the same curve under each assumption: mixing the nodes mixes the densities
    let mut nodes = Vec::new();
    for (trust, weight) in Trust::ALL {
        let some = nodes_along(&points, law, trust, healthy)?;
        nodes.extend(some.into_iter().map(|node| Node { weight, ..node }));
    }
    // Features are relative to the healthy ones, which a common change of stiffness or viscosity
    // moves as well. So a node moves by the difference of the two derivatives.
    let own = |node: &Node| of_change(&(node.slope - healthy.slope));
    nodes.iter_mut().for_each(|node| node.by_change = own(node));
    Some(nodes)
}

/// The nodes of a curve under one assumption about the physics. Each stands for an interval of
/// severities that is `NODE_DISTANCE` long at most, measured along the curve in standard deviations
/// of a signal (apart from the bound `MOST_BETWEEN`). `points`: at equal steps of their place.
/// `None`: a covariance is singular.
fn nodes_along(
    points: &[Point],
    law: &Law,
    trust: Trust,
    healthy: &HealthySpread,
) -> Option<Vec<Node>> {
    // of each point its distance from the first along the curve, in standard deviations of a signal
    let mut distances = vec![0.0];
    for pair in points.windows(2) {
        let (from, step) = (&pair[0], turned(pair[1].mean - pair[0].mean));
        let own = from.slope * healthy.channels * from.slope.transpose()
            + from.noise
            + trust.covariance(&from.belief_slope, &from.mean, &healthy.belief);
        let distance = step.dot(&(own.try_inverse()? * step)).sqrt();
        distances.push(distances[distances.len() - 1] + distance.min(MOST_BETWEEN * NODE_DISTANCE));
    }

    // how many nodes: the curve's length over the node distance, rounded up
    let total = distances[points.len() - 1];
    let n = (total / NODE_DISTANCE).ceil().max(1.0);
    // The inverse of `distances`, by linear interpolation: how many steps from the first point a distance
    // lies.
    let steps_at = |distance: f64| {
        let k = distances.partition_point(|d| *d < distance).clamp(1, points.len() - 1);
        let (before, step) = (distances[k - 1], distances[k] - distances[k - 1]);
        (k - 1) as f64 + if step > 0.0 { ((distance - before) / step).min(1.0) } else { 0.5 }
    };

    // Node i stands for the i-th of n parts of the curve, equally long. It has the features at the
    // middle of its severities, interpolated between the two points beside it. `begins`, `ends`,
    // `steps` count steps from the first point.
    let end = |i: f64| if i < n { steps_at(total * i / n) } else { (points.len() - 1) as f64 };
    let node = |i: usize| {
        let (begins, ends) = (end(i as f64), end(i as f64 + 1.0));
        let steps = 0.5 * (begins + ends);
        let (from, share) = (&points[steps as usize], steps.fract());
        let to = &points[(steps as usize + 1).min(points.len() - 1)];
        let place = from.place + share * (to.place - from.place);
        let mean = turned(from.mean + turned(to.mean - from.mean) * share);
        let believed = from.belief_slope * (1.0 - share) + to.belief_slope * share;
        let node = Node {
            severity: law.severity_at(place),
            place,
            length: (ends - begins) * (points[1].place - points[0].place).abs(),
            belief: trust.covariance(&believed, &mean, &healthy.belief),
            noise: from.noise * (1.0 - share) + to.noise * share,
            ..Node::at(mean, from.slope * (1.0 - share) + to.slope * share)
        };
        node.among(&healthy.channels)
    };
    (0..n as usize).map(node).collect()
}

impl Node {
    /// A node with these features and derivatives. Severity, belief, noise and axes are
    /// placeholders, which the caller replaces.
    fn at(mean: Vector4<f64>, slope: Slope) -> Node {
        Node {
            severity: f64::NAN,
            place: 0.0,
            length: 1.0,
            weight: 1.0,
            mean,
            slope,
            belief: Matrix4::zeros(),
            noise: Matrix4::identity(),
            by_change: Matrix4x2::zeros(),
            by_baseline: Matrix4::zeros(),
            to_axes: Matrix4::identity(),
            spread: Vector4::zeros(),
            ln_determinant: 0.0,
        }
    }

    /// A node that stands for no severity, of an alternative to the classes: signals of healthy
    /// channels, which differ by [`HealthySpread::slope`], displaced to `mean` with the additional
    /// covariance `belief`. `noise`: covariance of a fit's noise there. `None`: a covariance is
    /// singular or not finite.
    pub fn displaced(
        mean: Vector4<f64>,
        belief: Matrix4<f64>,
        noise: Matrix4<f64>,
        healthy: &HealthySpread,
    ) -> Option<Node> {
        Node { belief, noise, ..Node::at(mean, healthy.slope) }.among(&healthy.channels)
    }

    /// The node for signals of any channel: the covariance is that of the channels' own changes,
    /// `channels`, through the slope, plus `belief`.
    fn among(self, channels: &Square) -> Option<Node> {
        let spread = self.slope * channels * self.slope.transpose();
        let beyond = spread + self.belief;
        self.scattered(&beyond)
    }

    /// The node with `beyond` as the covariance of all scatter but the noise. `None`: the noise's covariance
    /// is not positive definite, or a number is not finite.
    fn scattered(self, beyond: &Matrix4<f64>) -> Option<Node> {
        // noise = L L^T. L^-1 whitens the noise. The eigenvectors of the scatter after that make
        // the scatter diagonal, too, and leave the noise white, since they are orthonormal.
        let inverse = self.noise.cholesky()?.l().try_inverse()?;
        let whitened = inverse * beyond * inverse.transpose();
        let SymmetricEigen { eigenvalues, eigenvectors } = SymmetricEigen::new(whitened);
        let to_axes = eigenvectors.transpose() * inverse;
        let ln_determinant = to_axes.determinant().abs().ln();
        let spread = eigenvalues.map(|v| v.max(0.0));
        let finite = ln_determinant.is_finite() && spread.iter().all(|v| v.is_finite());
        finite.then_some(Node { to_axes, spread, ln_determinant, ..self })
    }

    /// The node for signals of one channel whose own healthy level (its baseline, in features) is
    /// known. The baseline determines the channel's own changes: their mean is `gain` times the
    /// baseline, and `left` is the covariance that remains
    /// ([`super::physics_density::FaultCurves::of_one_channel`] computes both). `shot`: covariance
    /// of one channel's signals beyond the noise. `None`: a covariance is singular.
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

#[cfg(test)]
impl Node {
    /// Features in the node's axes, as distances from its mean under these conditions.
    fn along_axes(&self, x: &Vector4<f64>, conditions: Conditions) -> Vector4<f64> {
        let mean = self.mean + self.moved(conditions);
        self.to_axes * turned(x - mean)
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
                ..Node::at(Vector4::new(-t, 2.0 * t, -0.1 * t, 7.0 * t - 3.0), Slope::zeros())
            };
            node.scattered(&(spread * spread.transpose()))
        };
        (0..n).filter_map(node).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::ring::Ring;

    const DT_S: f64 = 0.8e-6;
    const SAMPLES: usize = 120;
    const NOISE: f64 = 12.0;
    const TRUE: Healthy = Healthy {
        channel: InkChannel { a_per_s2: 6.0e10, b_per_s2: 1.0e11, g_per_s: 1.7e4, d_per_s: 7.5e4 },
        actuation: Actuation::pulse(8.5e-6, 5e-6),
    };

    /// A fitter about the ring of the true channel, as it would be measured `delay_s` after the pulse.
    fn fitter(delay_s: f64) -> RingFitter {
        let actuation = Actuation { delay_s, ..TRUE.actuation };
        let x = actuation.acquisition_state(&TRUE.channel, 1.0);
        let state = TRUE.channel.output_state(x.into());
        let ring = Ring::new(TRUE.channel.poles().unwrap(), state).unwrap();
        RingFitter::new(ring, DT_S, SAMPLES)
    }

    /// The true channel and actuation, with parameter number `j` (ln a, ln b, ln g, ln d, ln pulse) off by
    /// `by`.
    fn off(j: usize, by: f64) -> Healthy {
        let mut believed = TRUE;
        let Healthy { channel: c, actuation } = &mut believed;
        let all = [
            &mut c.a_per_s2,
            &mut c.b_per_s2,
            &mut c.g_per_s,
            &mut c.d_per_s,
            &mut actuation.pulse_s,
        ];
        *all.into_iter().nth(j).unwrap() *= by.exp();
        believed
    }

    #[test]
    fn slopes_by_errors_of_belief_are_those_of_whoever_believes_otherwise() {
        let fitter = fitter(TRUE.actuation.delay_s);
        let mean = |believed: Healthy, law: &Law, place: f64| {
            let mut simulator = FaultSimulator::new(&fitter, believed, NOISE).unwrap();
            simulator.point(law, place).unwrap()
        };
        for class in crate::fault::CLASSES {
            let law = crate::model::faults::law(class).unwrap();
            let [low, high] = law.range;
            let place = law.scale(low + 0.1 * (high - low));
            let point = mean(TRUE, law, place);
            for j in 0..CHANGES {
                const BY: f64 = 0.004;
                // the derivative as somebody finds it who believes in other parameters
                let [up, down] = [BY, -BY].map(|by| mean(off(j, by), law, place).mean);
                let found = turned(up - down) / (2.0 * BY);
                let error = (found - point.belief_slope.column(j)).norm();
                assert!(error < 0.01, "{class} by {j}: {error}");
            }
        }
    }

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

    #[test]
    fn the_delay_is_as_measured_where_that_can_be_and_else_as_set() {
        let found = |measured_s: f64, set_s: f64| {
            let fitter = fitter(measured_s);
            let actuation = Actuation { delay_s: set_s, ..TRUE.actuation };
            let believed = Healthy { actuation, ..TRUE };
            let simulator = FaultSimulator::new(&fitter, believed, NOISE).unwrap();
            simulator.references[0].actuation.delay_s
        };
        for (measured_s, set_s) in [(5e-6, 4e-6), (5e-6, 6e-6), (1e-7, 1e-6)] {
            let error_s = found(measured_s, set_s) - measured_s;
            assert!(error_s.abs() < 1e-9, "{measured_s}, set {set_s}: {error_s} off");
        }
        // The delay remains as set where the measured phase would need a negative delay, and where it differs
        // by more than a quarter of a period.
        assert_eq!(found(-1e-6, 1e-7), 1e-7);
        assert_eq!(found(5e-6, 11e-6), 11e-6);
    }
}
