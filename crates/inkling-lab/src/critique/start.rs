//! Start of a fit: the best single ring of the average signal, each channel's ring about it, and the nearest
//! ring of each signal.
//!
//! In: signals. Out: a [`Model`] with nothing else fitted, or `None` where nothing rings.

use super::matrices::{Matrix5, Vector5};
use super::model::{Additions, LAMBDA_OVER_SIGMA, Linear, Model, free_products};
use super::observations::Observations;
use super::waves::power_at;
use inkling_core::model::descent::{Damping, descend};
use inkling_core::model::free_decay::{ALL, FREE, Tangent, Theta};
use inkling_core::model::inner_product::dot;
use inkling_core::model::median::median;
use inkling_core::numbers::tuned::little;
use nalgebra::{DMatrix, DVector, Matrix3};

/// Ratio of ring to noise with which a fit starts, in whatever unit.
const START_OVER_NOISE: f64 = 300.0;
/// Largest distance of a signal's own frequency from its channel's that is searched, relative.
const MOST_DRIFT: f64 = 0.1;

impl Model {
    /// Starts from the average signal, then moves to each channel's own. `None`: nothing rings in the
    /// signals.
    pub fn start(data: &Observations, real: bool) -> Option<Model> {
        // average of the signals per unit drive, by least squares
        let n = data.samples;
        let mut average = vec![0.0; n];
        let mut weight = 0.0;
        for i in 0..data.len() {
            let s = data.beside.drive[i];
            weight += s * s;
            average.iter_mut().zip(data.signal(i)).for_each(|(a, &y)| *a += s * f64::from(y));
        }
        average.iter_mut().for_each(|a| *a /= weight);
        let mut mean = first_guess(&average, real)?;
        mean[5] = LAMBDA_OVER_SIGMA.ln();
        let amplitude = mean[2].hypot(mean[3]).max(f64::MIN_POSITIVE);
        // a first guess of the scatter, wide enough for channels to move freely
        let wide = Matrix5::from_diagonal(&Vector5::from([
            0.5 * 0.5,
            0.1 * 0.1,
            amplitude * amplitude,
            amplitude * amplitude,
            (0.3 * amplitude).powi(2),
        ]));
        let mut model = Model {
            real,
            mean,
            between: wide,
            within: wide * 1e-6,
            estimated: false,
            // until it is estimated, in proportion to the ring, since the unit of the signals is unknown
            noise_var: (amplitude / START_OVER_NOISE).powi(2),
            added: Additions::none(n),
            units: vec![mean; data.units],
            each: vec![Theta::zeros(); data.len()],
            rails: Vec::new(),
            lattice: None,
        };

        // each channel moves to its own ring; then each signal to the nearest ring, where channels were heard
        // repeatedly
        model.fit_units(data, 12);
        model.recentre();
        if data.len() > data.units {
            model.each = model.by_halves(data.len(), |model, i| model.nearest(i, data));
        }
        Some(model)
    }

    /// Signal i's own deviation from which a descent starts: none, or, if a ring of another frequency leaves
    /// less than half as much, that one. A descent does not find back over a radian by which a ring of high
    /// quality has drifted while it lasts.
    fn nearest(&mut self, i: usize, data: &Observations) -> Theta {
        // step of the frequency that turns the phase by half a radian while the ring lasts, or the signal
        let step = 0.5 * self.mean[0].exp().max(1.0) / self.mean[1].exp();
        let steps = (MOST_DRIFT / step).min(8.0) as i32;
        let scale = self.scale();
        // what a frequency leaves once the three amplitudes are fitted, and these amplitudes
        let mut linear = Linear::default();
        let mut left = |model: &mut Model, own: Theta| {
            model.each[i] = own;
            model.linearise(i, data, &mut linear);
            let (gram, product) = free_products(&linear, &scale);
            // the block of the amplitudes alone
            let gram = gram.fixed_view::<3, 3>(2, 2).into_owned();
            let gram = gram + Matrix3::identity() * (1e-9 * gram.trace());
            let product = product.fixed_rows::<3>(2).into_owned();
            let moved = gram.cholesky().map(|c| c.solve(&product)).unwrap_or_default();
            let square = dot(&linear.residual, &linear.residual) - product.dot(&moved);
            let mut theta = own;
            (0..3).for_each(|j| theta[j + 2] += moved[j] * scale[j + 2]);
            (square, theta)
        };
        let there = left(self, Theta::zeros()).0;
        let mut best = (0.5 * there, Theta::zeros());
        for k in (-steps..=steps).filter(|k| *k != 0) {
            let mut own = Theta::zeros();
            own[1] = step * f64::from(k);
            let (square, theta) = left(self, own);
            if square < best.0 {
                best = (square, theta);
            }
        }
        self.each[i] = Theta::zeros();
        best.1
    }

    /// Moves the mean to the median over the channels, which is robust against a few that differ.
    fn recentre(&mut self) {
        for j in 0..FREE {
            let mut values: Vec<f64> = self.units.iter().map(|u| u[j]).collect();
            self.mean[j] = median(&mut values);
        }
    }
}

/// The best single ring of one signal: a grid over frequency and damping, with amplitudes (and an offset,
/// which is then left out) in closed form, then a refinement. `None`: the ring explains too little.
fn first_guess(y: &[f64], real: bool) -> Option<Theta> {
    let n = y.len();
    let mut best: Option<(f64, Theta)> = None;
    let most = std::f64::consts::PI * n as f64 * 0.9;
    let yv = DVector::from_column_slice(y);
    let mean = yv.mean();
    let total = yv.map(|v| v - mean).norm_squared();
    if !(total > 0.0 && total.is_finite()) {
        return None;
    }
    // frequencies are tried in the order of their power
    let moved: Vec<f64> = y.iter().map(|v| v - mean).collect();
    let omegas = (0..).map(|k| 2.0 + 0.9 * f64::from(k)).take_while(|omega| *omega < most);
    let power = |omega: f64| (power_at(omega / n as f64, &moved), omega);
    let mut powers: Vec<(f64, f64)> = omegas.map(power).collect();
    powers.sort_by(|p, q| q.0.total_cmp(&p.0));
    for &(_, omega) in powers.iter().take(12) {
        for ln_sigma in [-4.0_f64, -2.5, -1.5, -0.5, 0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.2] {
            let sigma = ln_sigma.exp();
            let columns = DMatrix::from_fn(n, 4, |k, j| {
                let t = k as f64 / n as f64;
                match j {
                    0 => (-sigma * t).exp() * (omega * t).cos(),
                    1 => (-sigma * t).exp() * (omega * t).sin(),
                    2 => 1.0,
                    _ if real => (-LAMBDA_OVER_SIGMA * sigma * t).exp(),
                    _ => 0.0,
                }
            });
            let gram = columns.tr_mul(&columns) + DMatrix::identity(4, 4) * 1e-6;
            let Some(x) = gram.cholesky().map(|c| c.solve(&columns.tr_mul(&yv))) else { continue };
            let left = (&yv - &columns * &x).norm_squared();
            if best.as_ref().is_none_or(|(cost, _)| left < *cost) && x[0].hypot(x[1]) > 0.0 {
                let lambda = (LAMBDA_OVER_SIGMA * sigma).ln();
                best = Some((left, Theta::from([ln_sigma, omega.ln(), x[0], x[1], x[3], lambda])));
            }
        }
    }
    let (cost, theta) = best?;
    let theta = refine(&theta, y, real);
    (cost < (1.0 - little()) * total && theta.iter().all(|v| v.is_finite())).then_some(theta)
}

/// Moves one ring (and an offset) to the nearest least squares on one signal; lambda stays at its ratio to the
/// damping.
fn refine(theta: &Theta, y: &[f64], real: bool) -> Theta {
    let n = y.len();
    let cost = |(theta, offset): &(Theta, f64)| {
        let mut tangent = Tangent::default();
        tangent.at(theta, theta[4], real, n);
        let left = DVector::from_fn(n, |k, _| y[k] - tangent.y[k] - offset);
        (left.norm_squared(), (tangent, left))
    };
    let slope = |_: &_, (Tangent { columns, .. }, left): (Tangent, DVector<f64>)| {
        let jacobian = DMatrix::from_fn(n, 6, |k, j| if j < FREE { columns[j][k] } else { 1.0 });
        Some((jacobian.tr_mul(&jacobian), jacobian.tr_mul(&left)))
    };
    let step = |(theta, offset): &(Theta, f64),
                (gram, product): &(DMatrix<f64>, DVector<f64>),
                damping| {
        let mut damped = gram.clone();
        (0..6).for_each(|j| damped[(j, j)] += damping * gram[(j, j)] + 1e-12);
        let step = damped.cholesky()?.solve(product);
        let mut trial = *theta;
        for j in 0..FREE {
            let most = if j < 2 { 0.3 } else { f64::INFINITY };
            trial[j] += step[j].clamp(-most, most);
        }
        trial[ALL - 1] = trial[0] + LAMBDA_OVER_SIGMA.ln();
        Some((trial, offset + step[5]))
    };
    let rests = |gained: f64, left: f64| gained < 1e-12 * (left + gained);
    let damping = Damping { first: 1e-3, down: 0.3, least: 1e-12, up: 10.0, most: 1e12 };
    descend((*theta, 0.0), damping, 60, cost, slope, step, rests).0.0
}
