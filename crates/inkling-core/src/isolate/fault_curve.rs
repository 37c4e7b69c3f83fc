//! How one kind of fault moves a ring's features as its severity grows, predicted by the physics alone.
//!
//! In: a healthy channel's rates and actuation, the ring that signals are compared with, how healthy
//! channels differ. Out: [`FaultCurve`]: as a function of severity the mean of a fitted ring's features
//! and their covariance. thesis (2-2), §2-2 1)-4). Learns nothing from faults.
//!
//! A fault changes the rates; these change the poles and, through B_u, the state at t_a. The resulting
//! decay is simulated and fitted exactly as a signal is, so that the fit's own bias (it holds the healthy
//! real pole) is part of the curve. Channels differ by small relative changes of their rates and gain; the
//! fit's derivatives by these, at each severity, turn the channels' covariance into one of features.

use super::tuned;
use crate::model::faults::Law;
use crate::model::ring_down::{Poles, ring_down_into};
use crate::model::ring_fit::{Features, Products, RingFitter};
use crate::model::{Actuation, InkChannel};
use nalgebra::{Matrix2, Matrix4, Matrix4x2, SMatrix, SVector, SymmetricEigen, Vector2, Vector4};

/// Number of relative changes by which a channel may differ: ln a, ln b, ln g, ln d, ln gain.
pub const CHANGES: usize = 5;
/// Jacobian of the features (ln amplitude, ln damping, ln frequency, phase) by these.
pub type Slope = SMatrix<f64, 4, CHANGES>;

/// The distribution of healthy features (the phase free): their Jacobian by a channel's own changes, the
/// covariance of these over channels, the covariance of a fit's noise at the reference drive.
#[derive(Clone, Debug)]
pub struct HealthySpread {
    pub slope: Slope,
    pub channels: SMatrix<f64, CHANGES, CHANGES>,
    pub noise: Matrix4<f64>,
    /// d [`Conditions::changed`] / d(ln damping, ln frequency) of the healthy ring.
    pub change: Matrix2<f64>,
}

/// A healthy channel's physical parameters.
#[derive(Clone, Copy, Debug)]
pub struct Healthy {
    pub channel: InkChannel,
    pub actuation: Actuation,
}

/// The features that a fit finds of one faulty channel, and their derivatives.
#[derive(Clone, Debug)]
pub struct Point {
    /// Severity in the coordinate of [`Law::scale`].
    pub place: f64,
    /// Features, relative to the healthy channel's.
    pub mean: Vector4<f64>,
    /// Their derivatives by one channel's own changes.
    pub slope: Slope,
    /// Their derivatives by errors of the parameters that all channels share: ln a, ln b, ln g, ln d, ln pulse.
    /// The healthy features do not change with these, since they were measured.
    pub belief_slope: Slope,
    /// Covariance of the fit's noise at the reference drive.
    pub noise: Matrix4<f64>,
}

/// An actuation, and the features of the healthy channel after it.
#[derive(Clone, Copy, Debug)]
struct Reference {
    actuation: Actuation,
    origin: Vector4<f64>,
}

/// Fits noise-free decays of faulty channels.
#[derive(Clone)]
pub struct FaultSimulator<'a> {
    fitter: &'a RingFitter,
    channel: InkChannel,
    /// Standard deviation of one sample's noise, counts.
    noise: f64,
    dt_s: f64,
    /// With the nominal pulse, a longer and a shorter one.
    references: [Reference; 3],
    /// Derivatives of the healthy channel's features, with the phase free.
    healthy_slope: Slope,
    healthy_poles: Poles,
    decay: Vec<f64>,
    work: Products,
}

/// Step of ln rate and ln pulse for central differences.
const STEP: f64 = 0.01;

impl<'a> FaultSimulator<'a> {
    /// `None`: the healthy channel does not ring.
    pub fn new(
        fitter: &'a RingFitter,
        healthy: Healthy,
        noise: f64,
        dt_s: f64,
        samples: usize,
    ) -> Option<FaultSimulator<'a>> {
        let Healthy { channel, actuation } = healthy;
        let reference = Reference { actuation, origin: Vector4::zeros() };
        let mut simulator = FaultSimulator {
            fitter,
            channel,
            noise,
            dt_s,
            references: [reference; 3],
            healthy_slope: Slope::zeros(),
            healthy_poles: channel.poles()?,
            decay: vec![0.0; samples],
            work: Products::default(),
        };
        for (k, by) in [0.0, STEP, -STEP].into_iter().enumerate() {
            let pulse_s = actuation.pulse_s * by.exp();
            simulator.references[k] = simulator.reference(Actuation { pulse_s, ..actuation })?;
        }
        simulator.healthy_slope = simulator.slope(&Some)?.1;
        Some(simulator)
    }

    /// Chooses the delay such that the simulated healthy phase is the measured one, which determines the
    /// delay far better than a setting does.
    fn reference(&mut self, set: Actuation) -> Option<Reference> {
        const MOST_PHASE_RAD: f64 = 1.5;
        let omega = std::f64::consts::TAU * self.healthy_poles.frequency_hz;
        let channel = self.channel;
        let mut actuation = set;
        for _ in 0..4 {
            let ahead = self.fit(&channel, &actuation, None)?[3];
            let delay_s = actuation.delay_s - ahead / omega;
            if ahead.abs() > MOST_PHASE_RAD || delay_s < 0.0 {
                actuation = set;
                break;
            }
            actuation.delay_s = delay_s;
        }
        let origin = self.fit(&channel, &actuation, None)?;
        Some(Reference { actuation, origin })
    }

    /// Features of a channel's decay; the fit starts from `near`, or from a coarse search.
    fn fit(
        &mut self,
        channel: &InkChannel,
        actuation: &Actuation,
        near: Option<&Vector4<f64>>,
    ) -> Option<Vector4<f64>> {
        let x_a = actuation.acquisition_state(channel, 1.0);
        ring_down_into(channel, &x_a, self.dt_s, &mut self.decay);
        let fit = match near {
            Some(x) => self.fitter.fit_from(&self.decay, &features(x), true),
            None => self.fitter.fit(&self.decay, true, &mut self.work),
        };
        Some(Vector4::from(fit?.features.coordinates()))
    }

    /// Features of `fault`(channel), not relative to the healthy ones, and their derivatives by [`CHANGES`].
    fn slope(
        &mut self,
        fault: &dyn Fn(InkChannel) -> Option<InkChannel>,
    ) -> Option<(Vector4<f64>, Slope)> {
        let (channel, actuation) = (self.channel, self.references[0].actuation);
        let found = self.fit(&fault(channel)?, &actuation, None)?;
        let mut slope = Slope::zeros();
        slope[(0, 4)] = 1.0; // ln gain adds to ln amplitude
        for j in 0..4 {
            let mut moved = |sign: f64| {
                let mut c = channel;
                let rates = [&mut c.a_per_s2, &mut c.b_per_s2, &mut c.g_per_s, &mut c.d_per_s];
                *rates.into_iter().nth(j)? *= (sign * STEP).exp();
                self.fit(&fault(c)?, &actuation, Some(&found))
            };
            let (up, down) = (moved(1.0)?, moved(-1.0)?);
            slope.set_column(j, &(turned(up - down) / (2.0 * STEP)));
        }
        Some((found, slope))
    }

    /// A channel's decay with the nominal actuation and gain, N, counts.
    pub fn decay(&self, channel: &InkChannel) -> Option<Vec<f64>> {
        let Reference { actuation, origin } = self.references[0];
        let x_a = actuation.acquisition_state(channel, (-origin[0]).exp());
        let mut decay = vec![0.0; self.decay.len()];
        ring_down_into(channel, &x_a, self.dt_s, &mut decay);
        decay.iter().all(|y| y.is_finite()).then_some(decay)
    }

    /// Derivatives of the healthy features by a channel's own changes, the phase free.
    pub fn healthy_slope(&self) -> &Slope {
        &self.healthy_slope
    }

    /// A fault at a severity given in the coordinate of [`Law::scale`].
    pub fn point(&mut self, law: &Law, place: f64) -> Option<Point> {
        let severity = law.severity_at(place);
        let fault = |channel: InkChannel| law.apply(severity, &channel);
        let (found, slope) = self.slope(&fault)?;
        let faulty = fault(self.channel)?;
        let [believed, longer, shorter] = self.references;
        let mut moved =
            |to: Reference| Some(self.fit(&faulty, &to.actuation, Some(&found))? - to.origin);
        let of_pulse = turned(moved(longer)? - moved(shorter)?) / (2.0 * STEP);
        let gain = Vector4::new(law.gain(severity).ln(), 0.0, 0.0, 0.0);
        let mean = turned(found + gain - believed.origin);

        // An error of the rates would change the healthy features too. These were measured, so the delay
        // is adapted to keep the healthy phase, and with the delay change phase and amplitude of a faulty
        // ring, whose frequency and damping are others.
        let Poles { damping_per_s, frequency_hz, .. } = self.healthy_poles;
        let omega = std::f64::consts::TAU * frequency_hz;
        let mut belief_slope = slope - self.healthy_slope;
        for j in 0..4 {
            let phase = self.healthy_slope[(3, j)];
            belief_slope[(0, j)] += phase * damping_per_s * mean[1].exp_m1() / omega;
            belief_slope[(3, j)] = slope[(3, j)] - phase * mean[2].exp();
        }
        belief_slope.set_column(4, &of_pulse);
        let noise = noise_of_fit(self.fitter, &features(&mean), self.noise)?;
        Some(Point { place, mean, slope, belief_slope, noise })
    }
}

/// Derivatives by a common ln stiffness (a and b) and a common ln viscosity (g and d).
pub fn of_change(slope: &Slope) -> Matrix4x2<f64> {
    let column = |i: usize, j: usize| slope.column(i) + slope.column(j);
    Matrix4x2::from_columns(&[column(0, 1), column(2, 3)])
}

fn features(x: &Vector4<f64>) -> Features {
    Features { ln_amplitude: x[0], ln_damping: x[1], ln_frequency: x[2], phase_rad: x[3] }
}

/// The same with its phase in -pi .. pi.
pub fn turned(mut x: Vector4<f64>) -> Vector4<f64> {
    if x[3].abs() <= std::f64::consts::PI {
        return x;
    }
    x[3] -= std::f64::consts::TAU * (x[3] / std::f64::consts::TAU).round();
    x
}

/// Covariance of a fit's features due to noise, with the phase free. `noise`: of one sample, counts.
pub fn noise_of_fit(fitter: &RingFitter, at: &Features, noise: f64) -> Option<Matrix4<f64>> {
    let covariance = fitter.noise_covariance(at, true, noise)?;
    Some(Matrix4::from_fn(|i, j| covariance[(i, j)]))
}

/// The conditions under which a signal was acquired.
#[derive(Clone, Copy, Debug)]
pub struct Conditions<'a> {
    /// Drive voltage over the reference, and over the noise of a sample relative to what the curves were made for.
    pub drive: f64,
    /// ln of the stiffness (a, b) and viscosity (g, d) of all channels over those that the curves were made
    /// for: another ink temperature, window or printhead.
    pub changed: Vector2<f64>,
    /// The channel's own baseline; only with curves of one channel.
    pub baseline: Option<&'a Vector4<f64>>,
}

impl Conditions<'_> {
    /// The conditions that the curves were made for.
    pub fn as_made() -> Conditions<'static> {
        Conditions { drive: 1.0, changed: Vector2::zeros(), baseline: None }
    }
}

/// A point of a fault curve, a Gaussian in the features, ready to be compared with a signal.
#[derive(Clone, Debug)]
pub struct Node {
    pub severity: f64,
    /// Severity in the coordinate of [`Law::scale`], and the length of the interval that the node stands for.
    pub place: f64,
    pub length: f64,
    /// Probability that the curve is wrong as much as `belief` says: of one severity the nodes' sum to 1.
    pub weight: f64,
    pub mean: Vector4<f64>,
    slope: Slope,
    /// Covariance of the mean: how far the physics may be wrong.
    belief: Matrix4<f64>,
    noise: Matrix4<f64>,
    /// d mean / d [`Conditions::changed`].
    pub(super) by_change: Matrix4x2<f64>,
    /// d mean / d [`Conditions::baseline`], of one channel's curves.
    pub(super) by_baseline: Matrix4<f64>,
    /// u = to_axes (x - mean), in which the noise at the reference drive has unit covariance and all other
    /// scatter the diagonal covariance `spread` (simultaneous diagonalisation).
    pub(super) to_axes: Matrix4<f64>,
    pub(super) spread: Vector4<f64>,
    pub(super) ln_determinant: f64,
}

impl Node {
    /// Variance of each feature: of all scatter but the noise, and of the noise at the reference drive.
    pub fn variances(&self) -> [Vector4<f64>; 2] {
        // x = to_axes^-1 u, where the noise is unit
        let back = self.to_axes.try_inverse().unwrap_or_else(Matrix4::identity);
        let along = |u: &Vector4<f64>| back * Matrix4::from_diagonal(u) * back.transpose();
        [along(&self.spread).diagonal(), along(&Vector4::repeat(1.0)).diagonal()]
    }

    /// Shift of the mean under these conditions.
    pub fn moved(&self, conditions: Conditions) -> Vector4<f64> {
        let changed = self.by_change * conditions.changed;
        conditions.baseline.map_or(changed, |own| changed + self.by_baseline * own)
    }
}

/// Covariances behind the scatter of features, besides the noise.
#[derive(Clone, Copy, Debug)]
pub struct Scatter {
    /// Of [`CHANGES`] from channel to channel.
    pub channels: SMatrix<f64, CHANGES, CHANGES>,
    /// Of the errors of what all channels share: ln a, ln b, ln g, ln d, ln pulse.
    pub belief: SMatrix<f64, CHANGES, CHANGES>,
}

/// How far the physics may be wrong about a class.
#[derive(Clone, Copy, Debug)]
enum Trust {
    /// As the belief in its rates says.
    InRates,
    /// Its rates are guesses, and the law of the fault holds roughly.
    InDirection,
}

impl Trust {
    /// What is thought of the physics a priori.
    const ALL: [(Trust, f64); 2] = [(Trust::InRates, 0.5), (Trust::InDirection, 0.5)];

    /// Covariance of a node's mean.
    fn covariance(self, believed: &Slope, mean: &Vector4<f64>, scatter: &Scatter) -> Matrix4<f64> {
        match self {
            Trust::InRates => believed * scatter.belief * believed.transpose(),
            Trust::InDirection => {
                let (rate, pulse) = (tuned::guessed_rate(), tuned::guessed_pulse());
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

/// A kind of fault from severity none to its largest.
#[derive(Clone, Debug)]
pub struct FaultCurve {
    pub nodes: Vec<Node>,
}

/// Severities at which decays are simulated and fitted; between them the curve is interpolated linearly.
const POINTS: usize = 64;
/// Distance of neighbouring nodes in standard deviations of a signal of any channel. A sum over Gaussians that lie h apart
/// differs from their integral by 2 exp(-2 pi²/h²) of it (Poisson's summation formula): nothing. About a channel's own level
/// signals scatter less, to a third, which makes .7 to 2.1 and the difference 2 %. With 1.2 where the physics is trusted least,
/// certainties move by .013 at most and severities by .04, by how a class's range is shared out to its nodes.
const NODE_DISTANCE: f64 = 0.7;
/// Nodes between two points, at most.
const MOST_BETWEEN: f64 = 48.0;

impl FaultCurve {
    /// From no fault to the `largest`.
    /// `None`: it does not ring over its range.
    pub fn new(
        simulator: &mut FaultSimulator,
        law: &Law,
        largest: f64,
        scatter: &Scatter,
    ) -> Option<FaultCurve> {
        let none = law.scale(law.none());
        let most = law.scale(largest);
        let points: Vec<Point> = (0..=POINTS)
            .map(|i| simulator.point(law, none + (most - none) * i as f64 / POINTS as f64))
            .collect::<Option<_>>()?;
        let mut nodes = Vec::new();
        for (trust, weight) in Trust::ALL {
            let some = nodes_along(&points, law, trust, scatter)?;
            nodes.extend(some.into_iter().map(|node| Node { weight, ..node }));
        }
        let healthy = simulator.healthy_slope;
        nodes.iter_mut().for_each(|node| node.by_change = of_change(&(node.slope - healthy)));
        Some(FaultCurve { nodes })
    }
}

/// The nodes of a curve, each for an interval of severities that is [`NODE_DISTANCE`] long at most. `points`: in equal
/// steps of their place.
fn nodes_along(points: &[Point], law: &Law, trust: Trust, scatter: &Scatter) -> Option<Vec<Node>> {
    // of each point the distance from the first along the curve, in standard deviations of a signal
    let mut distances = vec![0.0];
    for pair in points.windows(2) {
        let (from, step) = (&pair[0], turned(pair[1].mean - pair[0].mean));
        let own = from.slope * scatter.channels * from.slope.transpose()
            + from.noise
            + trust.covariance(&from.belief_slope, &from.mean, scatter);
        let distance = step.dot(&(own.try_inverse()? * step)).sqrt();
        distances.push(distances[distances.len() - 1] + distance.min(MOST_BETWEEN * NODE_DISTANCE));
    }
    let total = distances[points.len() - 1];
    let n = (total / NODE_DISTANCE).ceil().max(1.0);
    // how many steps from the first point a distance lies
    let steps_at = |distance: f64| {
        let k = distances.partition_point(|d| *d < distance).clamp(1, points.len() - 1);
        let (before, step) = (distances[k - 1], distances[k] - distances[k - 1]);
        (k - 1) as f64 + if step > 0.0 { ((distance - before) / step).min(1.0) } else { 0.5 }
    };
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
            belief: trust.covariance(&believed, &mean, scatter),
            noise: from.noise * (1.0 - share) + to.noise * share,
            ..Node::at(mean, from.slope * (1.0 - share) + to.slope * share)
        };
        node.among(&scatter.channels)
    };
    (0..n as usize).map(node).collect()
}

impl Node {
    /// Of any severity, not yet scattered.
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

    /// What is no matter of severity: signals of healthy channels, by [`HealthySpread::slope`], displaced to `mean` with the
    /// covariance `belief`. `noise`: of a fit there.
    pub fn displaced(
        mean: Vector4<f64>,
        belief: Matrix4<f64>,
        noise: Matrix4<f64>,
        healthy: &HealthySpread,
    ) -> Option<Node> {
        Node { belief, noise, ..Node::at(mean, healthy.slope) }.among(&healthy.channels)
    }

    /// The node of any channel.
    fn among(self, channels: &SMatrix<f64, CHANGES, CHANGES>) -> Option<Node> {
        let spread = self.slope * channels * self.slope.transpose();
        let beyond = spread + self.belief;
        self.scattered(&beyond)
    }

    /// The node with `beyond` as the covariance of all scatter but the noise.
    fn scattered(self, beyond: &Matrix4<f64>) -> Option<Node> {
        let inverse = self.noise.cholesky()?.l().try_inverse()?;
        let whitened = inverse * beyond * inverse.transpose();
        let SymmetricEigen { eigenvalues, eigenvectors } = SymmetricEigen::new(whitened);
        let to_axes = eigenvectors.transpose() * inverse;
        let ln_determinant = to_axes.determinant().abs().ln();
        let spread = eigenvalues.map(|v| v.max(0.0));
        let finite = ln_determinant.is_finite() && spread.iter().all(|v| v.is_finite());
        finite.then_some(Node { to_axes, spread, ln_determinant, ..self })
    }

    /// The node of one channel: its baseline determines the channel's changes as `gain` times the baseline,
    /// with the remaining covariance `left`. `shot`: covariance of one channel's signals beyond the noise.
    pub fn of_one_channel(
        &self,
        gain: &SMatrix<f64, CHANGES, 4>,
        left: &SMatrix<f64, CHANGES, CHANGES>,
        shot: &Matrix4<f64>,
    ) -> Option<Node> {
        let beyond = self.slope * left * self.slope.transpose() + shot + self.belief;
        let own = Node { by_baseline: self.slope * gain, ..self.clone() };
        own.scattered(&beyond)
    }
}

#[cfg(test)]
impl Node {
    fn along_axes(&self, x: &Vector4<f64>, conditions: Conditions) -> Vector4<f64> {
        let mean = self.mean + self.moved(conditions);
        self.to_axes * turned(x - mean)
    }

    /// ln of the density of features at a drive, given this severity.
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

    /// Nodes somewhere along a curve.
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

    /// Of the ring of the true channel, as it would be measured so long after the pulse.
    fn fitter(delay_s: f64) -> RingFitter {
        let InkChannel { a_per_s2: a, b_per_s2: b, g_per_s: g, d_per_s: d } = TRUE.channel;
        let actuation = Actuation { delay_s, ..TRUE.actuation };
        let x = actuation.acquisition_state(&TRUE.channel, 1.0);
        let volume = x[0] + x[1];
        let flows = [-a * volume - g * x[2], -b * volume - d * x[3]];
        let y = x[2] + x[3];
        let state = [y, flows[0] + flows[1], -(a + b) * y - g * flows[0] - d * flows[1]];
        let ring = Ring::new(TRUE.channel.poles().unwrap(), state).unwrap();
        RingFitter::new(ring, DT_S, SAMPLES)
    }

    /// The belief with one of its parameters (ln a, ln b, ln g, ln d, ln pulse) off by so much.
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
            let mut simulator =
                FaultSimulator::new(&fitter, believed, NOISE, DT_S, SAMPLES).unwrap();
            simulator.point(law, place).unwrap()
        };
        for class in crate::fault::CLASSES {
            let law = crate::model::faults::law(class).unwrap();
            let [low, high] = law.range();
            let place = law.scale(low + 0.1 * (high - low));
            let point = mean(TRUE, law, place);
            for j in 0..CHANGES {
                const BY: f64 = 0.004;
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
            let simulator = FaultSimulator::new(&fitter, believed, NOISE, DT_S, SAMPLES).unwrap();
            simulator.references[0].actuation.delay_s
        };
        for (measured_s, set_s) in [(5e-6, 4e-6), (5e-6, 6e-6), (1e-7, 1e-6)] {
            let error_s = found(measured_s, set_s) - measured_s;
            assert!(error_s.abs() < 1e-9, "{measured_s}, set {set_s}: {error_s} off");
        }
        // nothing is heard before the pulse, nor is more than a quarter of a period the delay's
        assert_eq!(found(-1e-6, 1e-7), 1e-7);
        assert_eq!(found(5e-6, 11e-6), 11e-6);
    }
}
