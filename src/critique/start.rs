//! Where a fit starts: the best single ring of an average signal.
//!
//! In: a signal. Out: its parameters ([`Theta`]), or none where nothing rings.

use super::tuned::FEW;
use crate::model::free_decay::{ALL, FREE, Tangent, Theta};
use nalgebra::{DMatrix, DVector};

/// The real pole against the damping: the ratio follows from the cross-sections and the ratio of inertances,
/// thesis (2-3), (2-4).
pub const LAMBDA_OVER_SIGMA: f64 = 1.27;

/// The best single ring of one signal: a grid over frequency and damping, amplitudes (and an offset,
/// which is then left out) in closed form.
pub fn first_guess(y: &[f64], real: bool) -> Option<Theta> {
    let n = y.len();
    let mut best: Option<(f64, Theta)> = None;
    let most = std::f64::consts::PI * n as f64 * 0.9;
    let yv = DVector::from_column_slice(y);
    let mean = yv.mean();
    let total = yv.map(|v| v - mean).norm_squared();
    if !(total > 0.0 && total.is_finite()) {
        return None;
    }
    // the frequencies with most power, and their neighbours
    let mut powers: Vec<(f64, f64)> = Vec::new();
    let mut omega: f64 = 2.0;
    while omega < most {
        let (sin, cos) = (omega / n as f64).sin_cos();
        let (mut c, mut s, mut re, mut im) = (1.0, 0.0, 0.0, 0.0);
        for v in y {
            re += (v - mean) * c;
            im += (v - mean) * s;
            (c, s) = (c * cos - s * sin, s * cos + c * sin);
        }
        powers.push((re * re + im * im, omega));
        omega += 0.9;
    }
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
    let (cost, mut theta) = best?;
    refine(&mut theta, y, real);
    (cost < (1.0 - FEW) * total && theta.iter().all(|v| v.is_finite())).then_some(theta)
}

/// Levenberg-Marquardt of one ring (and an offset) on one signal; lambda stays at its ratio.
fn refine(theta: &mut Theta, y: &[f64], real: bool) {
    let n = y.len();
    let mut damping = 1e-3;
    let mut tangent = Tangent::default();
    let mut offset = 0.0;
    let residual = |theta: &Theta, offset: f64, tangent: &mut Tangent| {
        tangent.at(theta, theta[4], real, n);
        DVector::from_fn(n, |k, _| y[k] - tangent.y[k] - offset)
    };
    let mut r = residual(theta, offset, &mut tangent);
    for _ in 0..60 {
        let jacobian =
            DMatrix::from_fn(n, 6, |k, j| if j < FREE { tangent.columns[j][k] } else { 1.0 });
        let mut gram = jacobian.tr_mul(&jacobian);
        for j in 0..6 {
            gram[(j, j)] += damping * gram[(j, j)] + 1e-12;
        }
        let Some(step) = gram.cholesky().map(|c| c.solve(&jacobian.tr_mul(&r))) else { break };
        let mut trial = *theta;
        for j in 0..FREE {
            let most = if j < 2 { 0.3 } else { f64::INFINITY };
            trial[j] += step[j].clamp(-most, most);
        }
        trial[ALL - 1] = trial[0] + LAMBDA_OVER_SIGMA.ln();
        let next = residual(&trial, offset + step[5], &mut tangent);
        if next.norm_squared() < r.norm_squared() {
            let gain = 1.0 - next.norm_squared() / r.norm_squared();
            (*theta, offset, r) = (trial, offset + step[5], next);
            damping = (damping * 0.3).max(1e-12);
            if gain < 1e-12 {
                break;
            }
        } else {
            damping *= 10.0;
            if damping > 1e12 {
                break;
            }
            tangent.at(theta, theta[4], real, n);
        }
    }
}
