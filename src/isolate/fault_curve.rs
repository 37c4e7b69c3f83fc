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

use crate::model::ring_down::ring_down_into;
use crate::model::ring_fit::{Columns, Features, RingFitter};
use crate::model::{Actuation, InkChannel, faults};
use nalgebra::{DMatrix, Matrix4, SMatrix, SymmetricEigen, Vector4};

/// Relative changes of a channel: ln a, ln b, ln g, ln d, ln gain.
pub const CHANGES: usize = 5;
pub type Slope = SMatrix<f64, 4, CHANGES>;

/// A healthy channel as the physics sees it.
#[derive(Clone, Copy, Debug)]
pub struct Healthy {
    pub channel: InkChannel,
    pub actuation: Actuation,
}

/// What the fit makes of one faulty channel: features, their slope along [`CHANGES`], noise of the
/// fit at the reference drive.
#[derive(Clone, Debug)]
pub struct Point {
    pub place: f64,
    pub mean: Vector4<f64>,
    pub slope: Slope,
    pub noise: Matrix4<f64>,
}

/// Fits noise-free decays of faulty channels.
pub struct Bench<'a> {
    fitter: &'a RingFitter,
    healthy: Healthy,
    /// Whether the phase is a feature.
    phase: bool,
    /// Of one sample, counts.
    noise: f64,
    dt_s: f64,
    /// Features of the healthy channel itself: the curves are relative to it.
    origin: Vector4<f64>,
    decay: Vec<f64>,
    work: Columns,
}

/// Relative change of a rate by which slopes are measured.
const STEP: f64 = 0.01;

impl<'a> Bench<'a> {
    /// `None`: the healthy channel does not ring. The delay of the actuation is moved until the
    /// healthy phase is the measured one: the phase tells the delay far better than a setting.
    pub fn new(
        fitter: &'a RingFitter,
        healthy: Healthy,
        phase: bool,
        noise: f64,
        dt_s: f64,
        samples: usize,
    ) -> Option<Bench<'a>> {
        const MOST_PHASE_RAD: f64 = 1.5;
        let (decay, work) = (vec![0.0; samples], Columns::default());
        let origin = Vector4::zeros();
        let mut bench = Bench { fitter, healthy, phase, noise, dt_s, origin, decay, work };
        let omega = std::f64::consts::TAU * healthy.channel.poles()?.frequency_hz;
        for _ in 0..4 {
            let ahead = bench.fit(&healthy.channel, None, true)?[3];
            let delay_s = bench.healthy.actuation.delay_s - ahead / omega;
            if ahead.abs() > MOST_PHASE_RAD || delay_s < 0.0 {
                bench.healthy.actuation = healthy.actuation;
                break;
            }
            bench.healthy.actuation.delay_s = delay_s;
        }
        bench.origin = bench.fit(&healthy.channel, None, phase)?;
        Some(bench)
    }

    /// Features of a channel's decay; searched from `near`, or everywhere.
    fn fit(
        &mut self,
        channel: &InkChannel,
        near: Option<&Vector4<f64>>,
        phase: bool,
    ) -> Option<Vector4<f64>> {
        let x_a = self.healthy.actuation.acquisition_state(channel, 1.0);
        ring_down_into(channel, &x_a, self.dt_s, &mut self.decay);
        let fit = match near {
            Some(x) => self.fitter.fit_from(&self.decay, &features(x), phase, &mut self.work),
            None => self.fitter.fit(&self.decay, phase, &mut self.work),
        };
        Some(Vector4::from(fit?.features.coordinates()))
    }

    /// A fault of the kind of `class` at a place of [`faults::scale`].
    pub fn point(&mut self, class: &str, place: f64) -> Option<Point> {
        let severity = faults::severity_at(class, place)?;
        let at = |channel: &InkChannel| faults::apply(class, severity, channel);
        let channel = self.healthy.channel;
        let found = self.fit(&at(&channel)?, None, self.phase)?;
        let mut slope = Slope::zeros();
        slope[(0, 4)] = 1.0; // the gain is the amplitude's
        for j in 0..4 {
            let mut moved = |sign: f64| {
                let mut c = channel;
                let rate = [&mut c.a_per_s2, &mut c.b_per_s2, &mut c.g_per_s, &mut c.d_per_s];
                *rate.into_iter().nth(j)? *= (sign * STEP).exp();
                self.fit(&at(&c)?, Some(&found), self.phase)
            };
            let (up, down) = (moved(1.0)?, moved(-1.0)?);
            slope.set_column(j, &(turned(up - down) / (2.0 * STEP)));
        }
        let mut mean = found - self.origin;
        if !self.phase {
            mean[3] = 0.0;
            slope.row_mut(3).fill(0.0);
        }
        let covariance = self.fitter.noise_covariance(&features(&mean), self.phase, self.noise)?;
        Some(Point { place, mean: turned(mean), slope, noise: padded(&covariance) })
    }
}

fn features(x: &Vector4<f64>) -> Features {
    Features { ln_amplitude: x[0], ln_damping: x[1], ln_frequency: x[2], phase_rad: x[3] }
}

/// The same with its phase in -pi .. pi.
pub fn turned(mut x: Vector4<f64>) -> Vector4<f64> {
    x[3] -= std::f64::consts::TAU * (x[3] / std::f64::consts::TAU).round();
    x
}

/// 4 x 4, with ones where the phase is held.
pub fn padded(covariance: &DMatrix<f64>) -> Matrix4<f64> {
    let n = covariance.nrows();
    Matrix4::from_fn(|i, j| match (i < n && j < n, i == j) {
        (true, _) => covariance[(i, j)],
        (false, true) => 1.0,
        (false, false) => 0.0,
    })
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
    /// Features are moved so by a channel's own relative changes.
    pub slope: Slope,
    /// u = to_axes (x - mean): the noise at the reference drive is unit, the spread diagonal.
    to_axes: Matrix4<f64>,
    spread: Vector4<f64>,
    ln_determinant: f64,
}

impl Node {
    /// ln of the density of features at a drive, given this severity; without 2 pi.
    pub fn ln_density(&self, x: &Vector4<f64>, drive: f64) -> f64 {
        let u = self.to_axes * turned(x - self.mean);
        let noise = 1.0 / (drive * drive);
        let (mut square, mut product) = (0.0, 1.0);
        for j in 0..4 {
            let variance = self.spread[j] + noise;
            square += u[j] * u[j] / variance;
            product *= variance;
        }
        self.ln_determinant - 0.5 * (square + product.ln())
    }
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
    /// `spread`: covariance of the channels' [`CHANGES`]. `None`: it does not ring over its range.
    pub fn new(
        bench: &mut Bench,
        class: &str,
        largest: f64,
        spread: &SMatrix<f64, CHANGES, CHANGES>,
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
            let scatter = from.slope * spread * from.slope.transpose() + from.noise;
            let distance = step.dot(&(scatter.try_inverse()? * step)).sqrt();
            let n = ((distance / NODE_DISTANCE).ceil() as usize).clamp(1, MOST_BETWEEN);
            for i in 0..n {
                let share = (i as f64 + 0.5) / n as f64;
                let place = from.place + share * (to.place - from.place);
                let mean = turned(from.mean + step * share);
                let slope = from.slope * (1.0 - share) + to.slope * share;
                let noise = from.noise * (1.0 - share) + to.noise * share;
                let length = (to.place - from.place) / n as f64;
                let severity = faults::severity_at(class, place)?;
                nodes.push(Node::new(severity, place, length, (mean, slope, noise), spread)?);
            }
        }
        Some(FaultCurve { nodes })
    }
}

impl Node {
    fn new(
        severity: f64,
        place: f64,
        length: f64,
        (mean, slope, noise): (Vector4<f64>, Slope, Matrix4<f64>),
        spread: &SMatrix<f64, CHANGES, CHANGES>,
    ) -> Option<Node> {
        let inverse = noise.cholesky()?.l().try_inverse()?;
        let whitened = inverse * slope * spread * slope.transpose() * inverse.transpose();
        let SymmetricEigen { eigenvalues, eigenvectors } = SymmetricEigen::new(whitened);
        let to_axes = eigenvectors.transpose() * inverse;
        let ln_determinant = to_axes.determinant().abs().ln();
        let spread = eigenvalues.map(|v| v.max(0.0));
        let finite = ln_determinant.is_finite() && spread.iter().all(|v| v.is_finite());
        finite.then_some(Node {
            severity,
            place,
            length,
            mean,
            slope,
            to_axes,
            spread,
            ln_determinant,
        })
    }
}
