//! Scatter along a shift in time, `trigger_jitter`, told from the healthy scatter of the signals.
//!
//! In: signals about a fitted model. Out: [`Found`]. Each signal's own phase, gain, ln sigma and ln omega
//! about its channel are drawn from a sum of variances: noise (known), gain, the acquisition state
//! (each of V, q_r, q_n by the same share of its own, thesis (2-2)), frequency and damping with whatever
//! correlation, and a shift in time. The state's components scatter amplitude and phase in known ratios
//! and with a known correlation, so three moments tell gain, state and shift apart. Maximum likelihood by
//! Fisher scoring; the likelihood ratio is divided by the excess of the scores' own spread.

use super::candidates::surprise;
use super::covariates::{COVARIATES, Covariates, DRIVE};
use super::engine::{Found, found};
use super::model::{Linear, Model, RATIO_OF_RATES};
use super::observations::Observations;
use crate::model::terms::{Interior, Seen};
use nalgebra::{DMatrix, DVector, Matrix2, Matrix3, Matrix4, SMatrix, Vector2, Vector3, Vector4};

/// Variance components: 3 of (sigma, omega), 4 cross, gain, state, shift.
const TERMS: usize = 10;
const GAIN: usize = 7;
const SHIFT: usize = 9;
type Info = SMatrix<f64, TERMS, TERMS>;
type Terms = SMatrix<f64, TERMS, 1>;
/// Signals that are looked at, at most.
const MOST: usize = 4096;
const STEPS: usize = 40;

/// One signal: phase, gain, ln sigma, ln omega about its channel, and the noise of these.
pub struct Scatter {
    pub x: Vector4<f64>,
    pub noise: Matrix4<f64>,
}

/// How V, q_r and q_n alone would ring: the pair's (a, b) of each; of an oscillator its own two.
fn components(model: &Model) -> Vec<Vector2<f64>> {
    let t = &model.mean;
    let (sigma, omega, lambda) = (t[0].exp(), t[1].exp(), t[5].exp());
    let seen =
        Seen { sigma, omega, lambda, a: t[2], b: t[3], c: if model.real { t[4] } else { 0.0 } };
    let interior = if model.real { Interior::ink(&seen, RATIO_OF_RATES) } else { None };
    let Some(Interior::Ink { channel, state: [v, q_r, q_n] }) = interior else {
        return vec![Vector2::new(t[2], 0.0), Vector2::new(0.0, t[3])];
    };
    let (a, b, g, d) = (channel.a_per_s2, channel.b_per_s2, channel.g_per_s, channel.d_per_s);
    let m = Matrix3::new(
        1.0,
        0.0,
        1.0, //
        -sigma,
        omega,
        -lambda, //
        sigma * sigma - omega * omega,
        -2.0 * sigma * omega,
        lambda * lambda,
    );
    let lu = m.lu();
    [[v, 0.0, 0.0], [0.0, q_r, 0.0], [0.0, 0.0, q_n]]
        .iter()
        .filter_map(|[v, q_r, q_n]| {
            let y = q_r + q_n;
            let (dr, dn) = (-a * v - g * q_r, -b * v - d * q_n);
            let x = lu.solve(&Vector3::new(y, dr + dn, -(a + b) * y - g * dr - d * dn))?;
            Some(Vector2::new(x[0], x[1]))
        })
        .collect()
}

/// Columns: (a, b) turned by a radian of shift, and (a, b) itself.
fn polar(a: f64, b: f64, sigma: f64, omega: f64) -> Matrix2<f64> {
    let r = sigma / omega;
    Matrix2::new(b - r * a, a, -(a + r * b), b)
}

/// Covariance, per unit of each variance component.
fn shapes(state: &Matrix2<f64>) -> [Matrix4<f64>; TERMS] {
    let one = |i: usize, j: usize| {
        let mut m = Matrix4::zeros();
        (m[(i, j)], m[(j, i)]) = (1.0, 1.0);
        m
    };
    let mut of_state = Matrix4::zeros();
    of_state.fixed_view_mut::<2, 2>(0, 0).copy_from(state);
    [
        one(2, 2),
        one(3, 3),
        one(2, 3),
        one(0, 2),
        one(0, 3),
        one(1, 2),
        one(1, 3),
        one(1, 1),
        of_state,
        one(0, 0),
    ]
}

/// Which components are variances, not covariances.
const VARIANCE: [bool; TERMS] = [true, true, false, false, false, false, false, true, true, true];

struct Fitted {
    terms: Terms,
    /// -2 ln likelihood.
    deviance: f64,
    covariance: Info,
    /// Spread of the signals' scores along the shift over what the likelihood expects.
    excess: f64,
}

fn covariance(of: &Scatter, terms: &Terms, u: &[Matrix4<f64>; TERMS]) -> Matrix4<f64> {
    let mut m = of.noise;
    for (k, u) in u.iter().enumerate() {
        m += u * terms[k];
    }
    m
}

fn deviance(all: &[Scatter], terms: &Terms, u: &[Matrix4<f64>; TERMS]) -> f64 {
    all.iter()
        .map(|one| match covariance(one, terms, u).cholesky() {
            Some(c) => 2.0 * c.l().diagonal().map(f64::ln).sum() + one.x.dot(&c.solve(&one.x)),
            None => f64::INFINITY,
        })
        .sum()
}

fn fit(all: &[Scatter], u: &[Matrix4<f64>; TERMS], start: Terms, shifts: bool) -> Option<Fitted> {
    let mut terms = start;
    if !shifts {
        terms[SHIFT] = 0.0;
    }
    let mut now = deviance(all, &terms, u);
    let mut last = None;
    for _ in 0..STEPS {
        let mut info = Info::zeros();
        let mut score = Terms::zeros();
        let mut squares = Info::zeros();
        for one in all {
            let inverse = covariance(one, &terms, u).try_inverse()?;
            let w: [Matrix4<f64>; TERMS] = std::array::from_fn(|k| inverse * u[k]);
            let z = inverse * one.x;
            let own = Terms::from_fn(|k, _| 0.5 * (z.dot(&(u[k] * z)) - w[k].trace()));
            score += own;
            squares += own * own.transpose();
            for k in 0..TERMS {
                for l in 0..=k {
                    let product = 0.5 * w[k].component_mul(&w[l].transpose()).sum();
                    info[(k, l)] += product;
                    if l < k {
                        info[(l, k)] += product;
                    }
                }
            }
        }
        // what lies at its bound and would go below stays there
        let held: [bool; TERMS] = std::array::from_fn(|k| {
            VARIANCE[k] && terms[k] <= 0.0 && score[k] <= 0.0 || k == SHIFT && !shifts
        });
        let mut free = info;
        for k in (0..TERMS).filter(|k| held[*k]) {
            for l in 0..TERMS {
                (free[(k, l)], free[(l, k)]) = (0.0, 0.0);
            }
            free[(k, k)] = 1.0;
            score[k] = 0.0;
        }
        let scale = Terms::from_fn(|k, _| free[(k, k)].max(1e-300).sqrt());
        let unit = Info::from_fn(|k, l| {
            free[(k, l)] / (scale[k] * scale[l]) + if k == l { 1e-9 } else { 0.0 }
        });
        let inverse = unit.try_inverse()?;
        let inverse = Info::from_fn(|k, l| inverse[(k, l)] / (scale[k] * scale[l]));
        let step = inverse * score;
        let spread = inverse * squares * inverse;
        let excess = spread[(SHIFT, SHIFT)] / inverse[(SHIFT, SHIFT)].max(1e-300);
        last = Some(Fitted { terms, deviance: now, covariance: inverse, excess });
        let mut share = 1.0;
        let mut moved = false;
        for _ in 0..12 {
            let mut trial = terms + step * share;
            for k in (0..TERMS).filter(|k| VARIANCE[*k]) {
                trial[k] = trial[k].max(0.0);
            }
            let value = deviance(all, &trial, u);
            if value < now {
                moved = now - value > 1e-7;
                (terms, now) = (trial, value);
                break;
            }
            share *= 0.4;
        }
        if !moved {
            break;
        }
    }
    last.map(|l| Fitted { terms, deviance: now, ..l })
}

/// (likelihood ratio, variance of the phase's shift, its standard error), rad².
pub fn test(all: &[Scatter], state: &Matrix2<f64>) -> Option<(f64, f64, f64)> {
    let u = shapes(state);
    let n = all.len() as f64;
    let mut moments = Matrix4::zeros();
    for one in all {
        moments += (one.x * one.x.transpose() - one.noise) / n;
    }
    let least = all.iter().map(|one| one.noise).sum::<Matrix4<f64>>() / n;
    let mut start = Terms::zeros();
    start[0] = moments[(2, 2)].max(0.1 * least[(2, 2)]);
    start[1] = moments[(3, 3)].max(0.1 * least[(3, 3)]);
    start[GAIN] = (0.5 * moments[(1, 1)]).max(0.1 * least[(1, 1)]);
    start[GAIN + 1] = 0.5 * start[GAIN] / state[(1, 1)].max(1e-6);
    start[SHIFT] = (0.3 * moments[(0, 0)]).max(0.1 * least[(0, 0)]);
    let without = fit(all, &u, start, false)?;
    let mut with = fit(all, &u, start, true)?;
    let mut near = without.terms;
    near[SHIFT] = start[SHIFT];
    if let Some(other) = fit(all, &u, near, true)
        && other.deviance < with.deviance
    {
        with = other;
    }
    let ratio = (without.deviance - with.deviance).max(0.0) / with.excess.max(1.0);
    Some((ratio, with.terms[SHIFT], with.covariance[(SHIFT, SHIFT)].max(0.0).sqrt()))
}

pub fn jitter(model: &Model, data: &Observations, beside: &Covariates) -> Found {
    let lack = |why| found("trigger_jitter", 0.0, 0.0, f64::NAN, f64::NAN, Some(why));
    if data.len() < data.units + 24 {
        return lack("several bursts of a channel");
    }
    let (sigma, omega) = (model.mean[0].exp(), model.mean[1].exp());
    let Some(to_polar) = polar(model.mean[2], model.mean[3], sigma, omega).try_inverse() else {
        return lack("signals that ring");
    };
    let mut state = Matrix2::zeros();
    for one in components(model) {
        let u = to_polar * one;
        state += u * u.transpose();
    }
    let stride = data.len().div_ceil(MOST);
    let rows: Vec<usize> =
        (0..data.len()).filter(|&i| data.rows[i].unit.is_multiple_of(stride)).collect();
    let mut linear = Linear::default();
    let mut each = Vec::with_capacity(rows.len());
    for &i in &rows {
        model.linearise(i, data, beside, &mut linear);
        let theta = model.theta(i, data, beside);
        let turn = polar(theta[2], theta[3], theta[0].exp(), theta[1].exp());
        let c = &linear.tangent.columns;
        let columns = DMatrix::from_fn(data.samples, 4, |k, j| match j {
            0 | 1 => turn[(0, j)] * c[2][k] + turn[(1, j)] * c[3][k],
            _ => c[j - 2][k],
        });
        let r = DVector::from_column_slice(&linear.residual);
        let (Some(inverse), Some(back)) =
            (columns.tr_mul(&columns).try_inverse(), turn.try_inverse())
        else {
            return lack("signals that ring");
        };
        let x = &inverse * columns.tr_mul(&r);
        // what the linearisation has taken already
        let own = model.each[i];
        let taken = back * Vector2::new(own[2], own[3]);
        let x = Vector4::new(x[0] + taken[0], x[1] + taken[1], x[2] + own[0], x[3] + own[1]);
        let noise = Matrix4::from_fn(|a, b| inverse[(a, b)] * model.noise_var);
        each.push(Scatter { x, noise });
    }
    let units: Vec<usize> = rows.iter().map(|&i| data.rows[i].unit).collect();
    about_channels(&mut each, &units, |i| {
        let z = &beside.z[rows[i]];
        let mut all = [0.0; COVARIATES];
        all[1..].copy_from_slice(&z[1..]);
        all[0] = z[DRIVE] * z[DRIVE];
        all
    });
    uncorrelate(&mut each);
    let Some((ratio, var, se)) = test(&each, &state) else { return lack("signals that ring") };
    let length_s = data.dt_s * data.samples as f64;
    let sd = var.max(1e-12).sqrt();
    let to_s = length_s / omega;
    let s = surprise(ratio, 1, 1.0, f64::INFINITY);
    found("trigger_jitter", s, ratio, sd * to_s, se / (2.0 * sd) * to_s, None)
}

/// Takes each channel's mean out, and what follows a covariate within channels.
fn about_channels(
    each: &mut [Scatter],
    units: &[usize],
    covariates: impl Fn(usize) -> [f64; COVARIATES],
) {
    let count = units.iter().max().map_or(0, |m| m + 1);
    let mut sums = vec![(Vector4::zeros(), [0.0; COVARIATES], 0.0_f64); count];
    for (i, unit) in units.iter().enumerate() {
        let (x, z, n) = &mut sums[*unit];
        *x += each[i].x;
        z.iter_mut().zip(covariates(i)).for_each(|(s, z)| *s += z);
        *n += 1.0;
    }
    let mut gram = DMatrix::<f64>::identity(COVARIATES, COVARIATES) * 1e-6;
    let mut cross = DMatrix::<f64>::zeros(COVARIATES, 4);
    let mut centred = Vec::with_capacity(each.len());
    for (i, unit) in units.iter().enumerate() {
        let (x, z, n) = &sums[*unit];
        each[i].x -= x / *n;
        let own = covariates(i);
        let own = DVector::from_fn(COVARIATES, |j, _| own[j] - z[j] / *n);
        gram += &own * own.transpose();
        cross += &own * DVector::from_column_slice(each[i].x.as_slice()).transpose();
        centred.push(own);
    }
    let beta = gram.cholesky().map_or(DMatrix::zeros(COVARIATES, 4), |c| c.solve(&cross));
    for (i, unit) in units.iter().enumerate() {
        let shift = beta.tr_mul(&centred[i]);
        let n = sums[*unit].2;
        for j in 0..4 {
            each[i].x[j] -= shift[j];
        }
        each[i].x *= (n / (n - 1.0).max(1.0)).sqrt();
    }
    let kept: Vec<bool> = units.iter().map(|unit| sums[*unit].2 > 1.0).collect();
    for (one, kept) in each.iter_mut().zip(kept) {
        if !kept {
            one.x.fill(0.0);
            one.noise *= 1e6; // heard once: it says nothing
        }
    }
}

/// A signal that rings faster arrives at t_a with another phase: takes out what follows the frequency.
fn uncorrelate(each: &mut [Scatter]) {
    let n = each.len() as f64;
    let (mut seen, mut real) = (0.0, Vector4::zeros());
    for one in each.iter() {
        seen += one.x[3] * one.x[3] / n;
        real += (one.x * one.x[3] - one.noise.column(3)) / n;
    }
    let var = real[3].max(0.2 * seen).max(1e-300);
    let mut turn = Matrix4::identity();
    turn[(0, 3)] = -real[0] / var;
    turn[(1, 3)] = -real[1] / var;
    for one in each {
        one.x = turn * one.x;
        one.noise = turn * one.noise * turn.transpose();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    /// 192 signals with scatter of gain 1 %, state 1 %, frequency .2 %; shift in rad; noise by drive.
    fn drawn(shift: f64, seed: u64) -> (Vec<Scatter>, Matrix2<f64>) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let parts = [Vector2::new(0.45, 0.8), Vector2::new(-0.3, 0.15), Vector2::new(-0.15, 0.05)];
        let state = parts.iter().map(|p| p * p.transpose()).sum();
        let all = (0..192)
            .map(|i| {
                let drive = 0.67 + 0.165 * f64::from(i % 5);
                let sd = [0.006, 0.005, 0.02, 0.0006].map(|s| s / drive);
                let mut x = Vector4::new(shift * normal(), 0.01 * normal(), 0.0, 0.0);
                for p in parts {
                    let share = 0.01 * normal();
                    x[0] += share * p[0];
                    x[1] += share * p[1];
                }
                x[2] = 0.01 * normal();
                x[3] = 0.002 * normal();
                let noise = Matrix4::from_diagonal(&Vector4::from(sd).map(|s| s * s));
                for j in 0..4 {
                    x[j] += sd[j] * normal();
                }
                Scatter { x, noise }
            })
            .collect();
        (all, state)
    }

    #[test]
    fn a_shift_is_told_from_the_scatter_of_gain_and_state() {
        let mut found = 0;
        for seed in 0..40 {
            let (all, state) = drawn(0.0, seed);
            assert!(test(&all, &state).unwrap().0 < 13.0, "null, seed {seed}");
            let (all, state) = drawn(0.016, 100 + seed);
            let (ratio, var, se) = test(&all, &state).unwrap();
            found += usize::from(ratio > 13.4);
            assert!((var - 0.016_f64.powi(2)).abs() < 4.0 * se, "seed {seed}: {var} {se}");
        }
        assert!(found >= 36, "{found} of 40");
    }
}
