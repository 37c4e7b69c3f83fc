//! What the curvature of the decay adds to the expected signal, given that a signal's own parameters are
//! known no better than its noise allows.
//!
//! In: a signal's likeliest parameters theta, the tangent J of its decay f there, and the posterior
//! covariance P of the parameters. Out: E[f] - f over that posterior, to second order (Laplace's method):
//!
//! E[f] - f = 1/2 sum_jk P_jk H_jk + J shift, with H the second derivatives of f, and shift = P slope the
//! distance of the posterior's mean from theta.
//!
//! Why: the score of the marginal likelihood is that of y - E[f] (Fisher's identity), not of y - f. The noise
//! leaves the parameters of a small ring less certain, so the difference looks like damping that grows with
//! the amplitude, the more surely the more signals there are.

use super::matrices::{Matrix5, Vector5};
use super::model::Linear;
use inkling_core::model::free_decay::{FREE, Theta};
use inkling_core::model::inner_product::dot;
use nalgebra::{Matrix4, matrix};

/// Second derivatives H of the decay by ln damping, ln frequency and the two amplitudes of the pair, one 4 x
/// 4 matrix per sample, counts; all others are 0, or as small as the real pole's part. `counts`: 1 for each
/// sample that counts, else 0.
fn second(theta: &Theta, drive: f64, counts: &[f64]) -> Vec<Matrix4<f64>> {
    let n = counts.len() as f64;
    let (sigma, omega) = (theta[0].exp(), theta[1].exp());
    let at = |(k, count): (usize, &f64)| {
        let t = k as f64 / n;
        let (x, w) = (sigma * t, omega * t);
        let size = count * drive * (-x).exp();
        let (s, c) = (size * w.sin(), size * w.cos());
        let (p, q) = (theta[2] * c + theta[3] * s, theta[3] * c - theta[2] * s);
        matrix![
            (x * x - x) * p, -x * w * q, -x * c, -x * s;
            -x * w * q, w * q - w * w * p, -w * s, w * c;
            -x * c, -w * s, 0.0, 0.0;
            -x * s, w * c, 0.0, 0.0
        ]
    };
    counts.iter().enumerate().map(at).collect()
}

pub struct PosteriorMean {
    pub expected: Vec<f64>,
    /// The posterior's mean less the likeliest parameters is the posterior covariance times this.
    pub slope: Vector5,
}

/// `theta`: the signal's likeliest parameters, about which `linear` is linearised; `posterior`: covariance P,
/// in the parameters' own units; `noise_var`: counts².
pub fn posterior_mean(
    theta: &Theta,
    linear: &Linear,
    drive: f64,
    posterior: &Matrix5,
    noise_var: f64,
) -> PosteriorMean {
    let second = second(theta, drive, &linear.counts);
    let columns = &linear.tangent.columns;
    let of_curved = posterior.fixed_view::<4, 4>(0, 0).into_owned();
    let mut expected: Vec<f64> = second.iter().map(|h| of_curved.dot(h)).collect();

    // The shift is minus half of P times the third derivatives of U = |y - f|²/(2 noise_var), contracted with
    // P: U_mjk = (J_m H_jk + J_j H_mk + J_k H_mj) / noise_var, where the last two give the same.
    let mut third = Vector5::from_fn(|m, _| dot(&columns[m], &expected));
    for (at, h) in second.iter().enumerate() {
        let by = posterior.tr_mul(&Vector5::from_fn(|j, _| columns[j][at]));
        let mut curved = third.fixed_rows_mut::<4>(0);
        curved += h * by.fixed_rows::<4>(0) * 2.0;
    }

    let slope = third * (-0.5 / noise_var);
    let shift = posterior * slope;
    for (at, expected) in expected.iter_mut().enumerate() {
        let moved: f64 = (0..FREE).map(|j| columns[j][at] * shift[j]).sum();
        *expected = 0.5 * *expected + moved;
    }
    PosteriorMean { expected, slope }
}

#[cfg(test)]
mod tests {
    use super::super::matrices::inverse;
    use super::super::model::free_products;
    use super::*;
    use inkling_core::model::free_decay::add;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::StandardNormal;

    /// A signal whose noise leaves its phase uncertain by a tenth of a radian, against the mean of draws from
    /// its posterior.
    #[test]
    fn what_is_expected_is_the_mean_over_the_posterior() {
        const N: usize = 64;
        let theta = Theta::from([2_f64.ln(), 20_f64.ln(), 60.0, -40.0, 0.0, 3_f64.ln()]);
        let within =
            Matrix5::from_diagonal(&Vector5::from([0.1, 0.02, 5.0, 5.0, 1e-4]).map(|s| s * s));
        let noise_var = 200.0;
        let mut linear =
            Linear { counts: vec![1.0; N], residual: vec![0.0; N], ..Linear::default() };
        linear.tangent.at(&theta, 0.0, N);
        let (gram, _) = free_products(&linear, &Vector5::repeat(1.0));
        let posterior = inverse(&(gram / noise_var + within.try_inverse().unwrap()));
        let beyond = posterior_mean(&theta, &linear, 1.0, &posterior, noise_var);
        let root = posterior.cholesky().unwrap().l();
        let decay = |theta: &Theta| {
            let mut y = vec![0.0; N];
            add(theta, 0.0, 1.0, &mut y);
            y
        };
        let (at, mut rng) = (decay(&theta), ChaCha8Rng::seed_from_u64(5));
        let (mut sum, mut weights) = (vec![0.0; N], 0.0);
        for _ in 0..100_000 {
            let z = Vector5::from_fn(|_, _| rng.sample(StandardNormal));
            for by in [root * z, -root * z] {
                let mut drawn = theta;
                (0..FREE).for_each(|j| drawn[j] += by[j]);
                let off: Vec<f64> = decay(&drawn).iter().zip(&at).map(|(y, at)| y - at).collect();
                let likely = dot(&off, &off) / noise_var - by.dot(&(gram * by)) / noise_var;
                let weight = (-0.5 * likely).exp();
                weights += weight;
                sum.iter_mut().zip(&off).for_each(|(sum, off)| *sum += weight * off);
            }
        }
        let found: Vec<f64> = sum.iter().map(|sum| sum / weights).collect();
        let off: Vec<f64> = found.iter().zip(&beyond.expected).map(|(x, y)| x - y).collect();
        assert!(dot(&off, &off) < 0.03 * dot(&found, &found), "{found:?}\n{:?}", beyond.expected);
    }
}
