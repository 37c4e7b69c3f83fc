//! What the curvature of the decay adds to what a signal is expected to be, as its own parameters are known no better
//! than its noise lets them be.
//!
//! In: a signal's parameters, the tangent there, and their posterior covariance. Out: E[f] - f over that posterior, to
//! second order. The score of the marginal likelihood is that of y - E[f] (Fisher's identity), not of y - f at the
//! likeliest parameters: the difference falls with the drive where the ring grows with it, so left out it looks
//! like damping that grows with the amplitude, the more surely the more signals there are.

use super::matrices::{Matrix5, Vector5};
use super::model::{Linear, dot};
use crate::model::free_decay::{FREE, Theta};

/// Second derivatives of the decay by ln damping, ln frequency and the two amplitudes, sample by sample; the rest
/// are 0.
struct Second {
    of: Vec<[[f64; 4]; 4]>,
}

impl Second {
    fn of(theta: &Theta, drive: f64, counts: &[f64]) -> Second {
        let n = counts.len() as f64;
        let (sigma, omega) = (theta[0].exp(), theta[1].exp());
        let at = |(k, count): (usize, &f64)| {
            let t = k as f64 / n;
            let (x, w) = (sigma * t, omega * t);
            let size = count * drive * (-x).exp();
            let (s, c) = (size * w.sin(), size * w.cos());
            let (p, q) = (theta[2] * c + theta[3] * s, theta[3] * c - theta[2] * s);
            [
                [(x * x - x) * p, -x * w * q, -x * c, -x * s],
                [-x * w * q, w * q - w * w * p, -w * s, w * c],
                [-x * c, -w * s, 0.0, 0.0],
                [-x * s, w * c, 0.0, 0.0],
            ]
        };
        Second { of: counts.iter().enumerate().map(at).collect() }
    }
}

/// What a signal's posterior is beyond its likeliest parameters.
pub struct Beyond {
    /// What is expected, sample by sample: E[f] - f.
    pub expected: Vec<f64>,
    /// The slope by which the posterior's mean is off: it is off by covariance times this.
    pub slope: Vector5,
}

/// `posterior`: covariance of the signal's own parameters.
pub fn beyond_the_likeliest(
    theta: &Theta,
    linear: &Linear,
    drive: f64,
    posterior: &Matrix5,
    noise_var: f64,
) -> Beyond {
    let second = Second::of(theta, drive, &linear.counts);
    let columns = &linear.tangent.columns;
    let curved = |h: &[[f64; 4]; 4]| -> f64 {
        (0..4).map(|j| (0..4).map(|k| posterior[(j, k)] * h[j][k]).sum::<f64>()).sum()
    };
    let mut expected: Vec<f64> = second.of.iter().map(curved).collect();
    // the posterior's mean is not where it is largest: by half of its third derivatives over the same covariance
    let mut third = Vector5::from_fn(|m, _| dot(&columns[m], &expected));
    for (at, h) in second.of.iter().enumerate() {
        for k in 0..4 {
            let by: f64 = (0..FREE).map(|j| columns[j][at] * posterior[(j, k)]).sum();
            (0..4).for_each(|m| third[m] += 2.0 * by * h[m][k]);
        }
    }
    let slope = third * (-0.5 / noise_var);
    let shift = posterior * slope;
    for (at, expected) in expected.iter_mut().enumerate() {
        let moved: f64 = (0..FREE).map(|j| columns[j][at] * shift[j]).sum();
        *expected = 0.5 * *expected + moved;
    }
    Beyond { expected, slope }
}
