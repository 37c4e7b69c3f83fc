//! What one kind of fault does to a ring's features as it grows, from the physics alone.
//!
//! In: a healthy channel's rates and actuation, the ring that signals are compared with, how healthy
//! channels differ. Out: [`FaultCurve`]: along the severity, where the features of a fitted ring lie
//! and how they scatter. thesis (2-2), §2-2 1)-4). Learns nothing from faults.
//!
//! A fault changes the rates, the rates the poles and, through B_u, the state at t_a. The decay that
//! follows is fitted by the same fit as a signal, so that what the fit makes of it (it holds the
//! healthy real pole) is in the curve. Channels differ by small relative changes of their rates and
//! gain; what these do at each severity is the slope of the same fit.

use super::class_density::TOLERANCE;
use crate::model::ring_down::{Poles, ring_down_into};
use crate::model::ring_fit::{Features, Products, RingFitter};
use crate::model::{Actuation, InkChannel, faults};
use nalgebra::{Matrix4, Matrix4x2, SMatrix, SymmetricEigen, Vector2, Vector4};

/// Relative changes of a channel: ln a, ln b, ln g, ln d, ln gain.
pub const CHANGES: usize = 5;
pub type Slope = SMatrix<f64, 4, CHANGES>;

/// A healthy channel as the physics sees it.
#[derive(Clone, Copy, Debug)]
pub struct Healthy {
    pub channel: InkChannel,
    pub actuation: Actuation,
}

/// What the fit makes of one faulty channel.
#[derive(Clone, Debug)]
pub struct Point {
    pub place: f64,
    /// Features, relative to the healthy channel's.
    pub mean: Vector4<f64>,
    /// How one channel's own changes move them.
    pub slope: Slope,
    /// How the curve moves where what is believed of all channels is off: ln a, ln b, ln g, ln d and
    /// ln pulse. The healthy features stay: they were measured.
    pub off: Slope,
    /// Noise of the fit at the reference drive.
    pub noise: Matrix4<f64>,
}

/// An actuation, and the features of the healthy channel that it leaves.
#[derive(Clone, Copy, Debug)]
struct Reference {
    actuation: Actuation,
    origin: Vector4<f64>,
}

/// Fits noise-free decays of faulty channels.
pub struct Bench<'a> {
    fitter: &'a RingFitter,
    channel: InkChannel,
    /// Of one sample, counts.
    noise: f64,
    dt_s: f64,
    /// As believed, with a longer pulse, with a shorter one.
    references: [Reference; 3],
    /// Of the healthy channel, with the phase free.
    healthy_slope: Slope,
    healthy_poles: Poles,
    decay: Vec<f64>,
    work: Products,
}

/// Relative change of a rate by which slopes are measured.
const STEP: f64 = 0.01;

impl<'a> Bench<'a> {
    /// `None`: the healthy channel does not ring.
    pub fn new(
        fitter: &'a RingFitter,
        healthy: Healthy,
        noise: f64,
        dt_s: f64,
        samples: usize,
    ) -> Option<Bench<'a>> {
        let Healthy { channel, actuation } = healthy;
        let reference = Reference { actuation, origin: Vector4::zeros() };
        let mut bench = Bench {
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
            bench.references[k] = bench.reference(Actuation { pulse_s, ..actuation })?;
        }
        bench.healthy_slope = bench.slope(&Some)?.1;
        Some(bench)
    }

    /// Moves the delay until the healthy phase is the measured one: the phase tells the delay far
    /// better than a setting does.
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

    /// Features of a channel's decay; searched from `near`, or everywhere.
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

    /// Features of `fault`(channel), not yet relative, and their slope along [`CHANGES`].
    fn slope(
        &mut self,
        fault: &dyn Fn(InkChannel) -> Option<InkChannel>,
    ) -> Option<(Vector4<f64>, Slope)> {
        let (channel, actuation) = (self.channel, self.references[0].actuation);
        let found = self.fit(&fault(channel)?, &actuation, None)?;
        let mut slope = Slope::zeros();
        slope[(0, 4)] = 1.0; // the gain is the amplitude's
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

    /// A channel's decay as the believed actuation and gain leave it, counts.
    pub fn decay(&self, channel: &InkChannel) -> Option<Vec<f64>> {
        let Reference { actuation, origin } = self.references[0];
        let x_a = actuation.acquisition_state(channel, (-origin[0]).exp());
        let mut decay = vec![0.0; self.decay.len()];
        ring_down_into(channel, &x_a, self.dt_s, &mut decay);
        decay.iter().all(|y| y.is_finite()).then_some(decay)
    }

    /// How healthy features move with a channel's own changes, the phase free.
    pub fn healthy_slope(&self) -> &Slope {
        &self.healthy_slope
    }

    /// A fault of the kind of `class` at a place of [`faults::scale`].
    pub fn point(&mut self, class: &str, place: f64) -> Option<Point> {
        let severity = faults::severity_at(class, place)?;
        let fault = |channel: InkChannel| faults::apply(class, severity, &channel);
        let (found, slope) = self.slope(&fault)?;
        let faulty = fault(self.channel)?;
        let [believed, longer, shorter] = self.references;
        let mut moved =
            |to: Reference| Some(self.fit(&faulty, &to.actuation, Some(&found))? - to.origin);
        let of_pulse = turned(moved(longer)? - moved(shorter)?) / (2.0 * STEP);
        let mean = turned(found - believed.origin);

        // Rates that are off move the healthy features, too, and those were measured: their phase moves
        // the delay, and so the phase and amplitude of what rings at another frequency and damping.
        let Poles { damping_per_s, frequency_hz, .. } = self.healthy_poles;
        let omega = std::f64::consts::TAU * frequency_hz;
        let mut off = slope - self.healthy_slope;
        for j in 0..4 {
            let phase = self.healthy_slope[(3, j)];
            off[(0, j)] += phase * damping_per_s * mean[1].exp_m1() / omega;
            off[(3, j)] = slope[(3, j)] - phase * mean[2].exp();
        }
        off.set_column(4, &of_pulse);
        let noise = noise_of_fit(self.fitter, &features(&mean), self.noise)?;
        Some(Point { place, mean, slope, off, noise })
    }
}

/// What stiffness and viscosity of all channels do, of their rates' slopes.
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

/// Covariance of the noise of a fit with the phase free.
pub fn noise_of_fit(fitter: &RingFitter, at: &Features, noise: f64) -> Option<Matrix4<f64>> {
    let covariance = fitter.noise_covariance(at, true, noise)?;
    Some(Matrix4::from_fn(|i, j| covariance[(i, j)]))
}

/// Under what a signal is seen.
#[derive(Clone, Copy, Debug)]
pub struct Seen<'a> {
    /// Drive voltage over the reference.
    pub drive: f64,
    /// ln of how much stiffer (a, b) and more viscous (g, d) all channels are than the curves': the
    /// ink's temperature, another window, another printhead.
    pub changed: Vector2<f64>,
    /// The channel's own, with curves of one channel.
    pub baseline: Option<&'a Vector4<f64>>,
}

impl Seen<'_> {
    /// At the reference drive, and as the curves were made.
    pub fn as_made() -> Seen<'static> {
        Seen { drive: 1.0, changed: Vector2::zeros(), baseline: None }
    }
}

/// A place on the curve, ready to be compared with a signal.
#[derive(Clone, Debug)]
pub struct Node {
    pub severity: f64,
    /// On the scale on which severities are equally likely.
    pub place: f64,
    /// Length of its part of that scale.
    pub length: f64,
    pub mean: Vector4<f64>,
    slope: Slope,
    /// Covariance of what is believed of all channels.
    belief: Matrix4<f64>,
    noise: Matrix4<f64>,
    /// How the mean moves with [`Seen::changed`].
    pub(super) moves: Matrix4x2<f64>,
    /// Of one channel: how the mean follows its baseline.
    pub(super) follows: Matrix4<f64>,
    /// u = to_axes (x - mean): the noise at the reference drive is unit, the spread diagonal.
    pub(super) to_axes: Matrix4<f64>,
    pub(super) spread: Vector4<f64>,
    pub(super) ln_determinant: f64,
}

impl Node {
    /// Of each coordinate: beyond the noise, and of the noise at the reference drive.
    pub fn variances(&self) -> [Vector4<f64>; 2] {
        // x = to_axes^-1 u, where the noise is unit
        let back = self.to_axes.try_inverse().unwrap_or_else(Matrix4::identity);
        let along = |u: &Vector4<f64>| back * Matrix4::from_diagonal(u) * back.transpose();
        [along(&self.spread).diagonal(), along(&Vector4::repeat(1.0)).diagonal()]
    }

    /// How far the mean has moved from where the curve was made.
    pub fn moved(&self, seen: Seen) -> Vector4<f64> {
        let changed = self.moves * seen.changed;
        seen.baseline.map_or(changed, |own| changed + self.follows * own)
    }

    fn along_axes(&self, x: &Vector4<f64>, seen: Seen) -> Vector4<f64> {
        let mean = self.mean + self.moved(seen);
        self.to_axes * turned(x - mean)
    }

    /// Squared distance of features from here, in units of what scatters them and of the tolerance
    /// of classes.
    pub fn distance(&self, x: &Vector4<f64>, seen: Seen) -> f64 {
        let u = self.along_axes(x, seen);
        let elsewhere = |j: usize| -> f64 {
            (0..4).map(|k| (self.to_axes[(j, k)] * TOLERANCE[k]).powi(2)).sum()
        };
        let noise = 1.0 / (seen.drive * seen.drive);
        (0..4).map(|j| u[j] * u[j] / (self.spread[j] + noise + elsewhere(j))).sum()
    }
}

/// What scatters features besides the noise.
#[derive(Clone, Copy, Debug)]
pub struct Scatter {
    /// Covariance of [`CHANGES`] from channel to channel.
    pub channels: SMatrix<f64, CHANGES, CHANGES>,
    /// Covariance of what is believed of all: ln a, ln b, ln g, ln d, ln pulse.
    pub belief: SMatrix<f64, CHANGES, CHANGES>,
}

/// A kind of fault from none to its largest.
#[derive(Clone, Debug)]
pub struct FaultCurve {
    pub nodes: Vec<Node>,
}

/// Places at which decays are fitted; between them the curve is straight.
const POINTS: usize = 64;
/// Distance of nodes, in units of a signal's own scatter: sums over nodes are then as good as integrals.
const NODE_DISTANCE: f64 = 0.7;
/// Nodes between two points, at most.
const MOST_BETWEEN: usize = 48;

impl FaultCurve {
    /// The kind of `class`, over the severities of `classes` (all of that kind) and down to none.
    /// `None`: it does not ring over its range.
    pub fn new(
        bench: &mut Bench,
        class: &str,
        largest: f64,
        scatter: &Scatter,
    ) -> Option<FaultCurve> {
        let none = faults::scale(class, faults::no_fault_severity(class)?)?;
        let most = faults::scale(class, largest)?;
        let points: Vec<Point> = (0..=POINTS)
            .map(|i| bench.point(class, none + (most - none) * i as f64 / POINTS as f64))
            .collect::<Option<_>>()?;
        let mut nodes = Vec::new();
        for pair in points.windows(2) {
            let (from, to) = (&pair[0], &pair[1]);
            let step = turned(to.mean - from.mean);
            let own = from.slope * scatter.channels * from.slope.transpose() + from.noise;
            let distance = step.dot(&(own.try_inverse()? * step)).sqrt();
            let n = ((distance / NODE_DISTANCE).ceil() as usize).clamp(1, MOST_BETWEEN);
            for i in 0..n {
                let share = (i as f64 + 0.5) / n as f64;
                let place = from.place + share * (to.place - from.place);
                let mean = turned(from.mean + step * share);
                let slope = from.slope * (1.0 - share) + to.slope * share;
                let off = from.off * (1.0 - share) + to.off * share;
                let noise = from.noise * (1.0 - share) + to.noise * share;
                let length = (to.place - from.place) / n as f64;
                let severity = faults::severity_at(class, place)?;
                let spread = slope * scatter.channels * slope.transpose();
                let belief = off * scatter.belief * off.transpose();
                let node = Node {
                    severity,
                    place,
                    length,
                    mean,
                    slope,
                    belief,
                    noise,
                    moves: of_change(&(slope - bench.healthy_slope)),
                    follows: Matrix4::zeros(),
                    to_axes: Matrix4::identity(),
                    spread: Vector4::zeros(),
                    ln_determinant: 0.0,
                };
                nodes.push(node.scattered(&(spread + belief))?);
            }
        }
        Some(FaultCurve { nodes })
    }
}

impl Node {
    /// With that covariance beyond the noise.
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

    /// Of one channel, whose changes a baseline tells by `gain` and leaves `left` of.
    pub fn of_one_channel(
        &self,
        gain: &SMatrix<f64, CHANGES, 4>,
        left: &SMatrix<f64, CHANGES, CHANGES>,
        shot: &Matrix4<f64>,
    ) -> Option<Node> {
        let beyond = self.slope * left * self.slope.transpose() + shot + self.belief;
        let own = Node { follows: self.slope * gain, ..self.clone() };
        own.scattered(&beyond)
    }
}

#[cfg(test)]
impl Node {
    /// ln of the density of features at a drive, given this severity.
    pub fn ln_density(&self, x: &Vector4<f64>, seen: Seen) -> f64 {
        let u = self.along_axes(x, seen);
        let noise = 1.0 / (seen.drive * seen.drive);
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
                mean: Vector4::new(-t, 2.0 * t, -0.1 * t, 7.0 * t - 3.0),
                slope: Slope::zeros(),
                belief: Matrix4::zeros(),
                noise: factor * factor.transpose(),
                moves: Matrix4x2::from_fn(|_, _| within(0.5)),
                follows: Matrix4::from_fn(|_, _| within(0.5)),
                to_axes: Matrix4::identity(),
                spread: Vector4::zeros(),
                ln_determinant: 0.0,
            };
            node.scattered(&(spread * spread.transpose()))
        };
        (0..n).filter_map(node).collect()
    }
}
