//! Identifiability: the covariance of an identified model, and what one decay does not determine.
//!
//! In: the fit of thesis (3-1), from `grey_box`. Out: standard deviations of the poles and of the
//! cubic's coefficients, and in words the directions in which rates and state can move without
//! changing the decay.
//!
//! One decay carries six numbers: p2, p1, p0 of the cubic and y, y', y'' at t_a. With their
//! Jacobian J (N x 6) their covariance is noise² (J'J)^-1, propagated to the poles. What was held or
//! has a prior in the fit adds nothing.

use super::cubic::{PER_S, cubic_per_us, poles_of, tangent};
use super::identification::Uncertainty;
use nalgebra::{DVector, Matrix3, SMatrix, Vector3};

/// The uncertainty of a fit. `state`: y, y', y'' per µs; `noise`: standard deviation of one sample
/// of the fitted signal, counts; 0: estimated from `misfit` (N, counts). Infinite where the decay
/// does not determine the six numbers, or the cubic has no damped pair.
pub fn uncertainty(
    cubic: [f64; 3],
    state: &Vector3<f64>,
    dt_s: f64,
    samples: usize,
    noise: f64,
    misfit: &DVector<f64>,
) -> Uncertainty {
    let jacobian = tangent(cubic_per_us(cubic), *state, dt_s * 1e6, samples);

    let from_misfit = misfit.norm() / ((samples.max(7) - 6) as f64).sqrt();
    let noise = if noise > 0.0 { noise } else { from_misfit };

    let scales: Vec<f64> =
        jacobian.column_iter().map(|col| col.norm().max(f64::MIN_POSITIVE)).collect();
    let normal = SMatrix::<f64, 6, 6>::from_fn(|i, j| {
        jacobian.column(i).dot(&jacobian.column(j)) / (scales[i] * scales[j])
    });
    let (Some(inverse), Some(slopes)) = (normal.try_inverse(), pole_slopes(cubic)) else {
        return Uncertainty {
            damping_sd_per_s: f64::INFINITY,
            frequency_sd_hz: f64::INFINITY,
            lambda_sd_per_s: f64::INFINITY,
            cubic_sd: [f64::INFINITY; 3],
            noise,
            ..Uncertainty::default()
        };
    };

    let covariance =
        Matrix3::from_fn(|i, j| noise * noise * inverse[(i, j)] / (scales[i] * scales[j]));
    let of_poles = slopes * covariance * slopes.transpose();
    Uncertainty {
        damping_sd_per_s: of_poles[(0, 0)].sqrt(),
        frequency_sd_hz: of_poles[(1, 1)].sqrt(),
        lambda_sd_per_s: of_poles[(2, 2)].sqrt(),
        cubic_sd: std::array::from_fn(|k| covariance[(k, k)].sqrt() * PER_S[k]),
        cubic_covariance_us: std::array::from_fn(|i| std::array::from_fn(|j| covariance[(i, j)])),
        noise,
    }
}

/// d(damping, frequency Hz, lambda)/d(p2, p1, p0 per µs). `None`: there is no damped pair near it.
fn pole_slopes(cubic: [f64; 3]) -> Option<Matrix3<f64>> {
    let mut slopes = Matrix3::zeros();
    for k in 0..3 {
        let h = 1e-6 * cubic[k].abs();
        let at = |by: f64| poles_of((Vector3::from(cubic) + Vector3::ith(k, by)).into());
        let (up, down) = (at(h)?, at(-h)?);
        let per_us = 2.0 * h / PER_S[k];
        slopes[(0, k)] = (up.damping_per_s - down.damping_per_s) / per_us;
        slopes[(1, k)] = (up.frequency_hz - down.frequency_hz) / per_us;
        slopes[(2, k)] = (up.lambda_per_s - down.lambda_per_s) / per_us;
    }
    Some(slopes)
}

pub fn in_words() -> Vec<String> {
    let words = [
        "rates: a, b, g, d move together along one curve that leaves p2, p1, p0 as they are \
         (g + d, g d + a + b, a d + b g); restrictor and nozzle may also swap",
        "state: displaced volume that moves from restrictor to nozzle, V_r + V_n constant, \
         is invisible (eigenvector (1, -1, 0, 0) of the pole at 0)",
        "I_r, I_n, R_r, R_n, B_t one by one: only a = 1/(I_r B_t), b = 1/(I_n B_t), g = R_r/I_r, \
         d = R_n/I_n appear",
    ];
    words.map(str::to_owned).to_vec()
}
