//! The cubic s^3 + p2 s^2 + p1 s + p0 of the observable poles: its decays, and its roots.
//!
//! In: p2, p1, p0, which one decay determines (the four rates it does not), and the output state y,
//! y', y'' at t_a. Out: the decay's samples, their derivatives, or the poles. The output obeys
//! y''' + p2 y'' + p1 y' + p0 y = 0, so with the companion matrix M of the cubic the state at sample
//! k is e^(M k dt) times the state at t_a, exactly. "Per µs": time is in microseconds.

use crate::model::ring_down::Poles;
use nalgebra::{DMatrix, Matrix3, MatrixXx3, Vector3};

/// Factors that turn the rates a, b, g, d per s into those per µs.
pub(super) const RATES_PER_US: [f64; 4] = [1e-12, 1e-12, 1e-6, 1e-6];
/// Factors that turn p2, p1, p0 per µs into those per s.
pub(super) const PER_S: [f64; 3] = [1e6, 1e12, 1e18];

/// The outputs (columns) of a cubic's decays from unit y, y', y'' at t_a. All per µs.
pub(super) fn basis(cubic: [f64; 3], dt_us: f64, samples: usize) -> MatrixXx3<f64> {
    let step = (companion(cubic) * dt_us).exp();
    let mut basis = MatrixXx3::zeros(samples);
    let (of_y, rest) = basis.as_mut_slice().split_at_mut(samples);
    let (of_dy, of_ddy) = rest.split_at_mut(samples);

    // the first row of e^(M k dt) turns the state at t_a into y at sample k
    let mut row = [1.0, 0.0, 0.0];
    for ((y, dy), ddy) in of_y.iter_mut().zip(of_dy).zip(of_ddy) {
        [*y, *dy, *ddy] = row;
        row = std::array::from_fn(|j| {
            row[0] * step[(0, j)] + row[1] * step[(1, j)] + row[2] * step[(2, j)]
        });
    }
    basis
}

/// The derivatives dy/d(p2, p1, p0, y, y', y''), N x 6, per µs: they span all small changes of a
/// decay that leave it a decay.
pub(super) fn tangent(
    cubic: [f64; 3],
    state: Vector3<f64>,
    dt_us: f64,
    samples: usize,
) -> DMatrix<f64> {
    let mut columns = DMatrix::zeros(samples, 6);
    for k in 0..3 {
        let h = 1e-5 * cubic[k].abs().max(1e-9);
        let at =
            |by: f64| basis((Vector3::from(cubic) + Vector3::ith(k, by)).into(), dt_us, samples);
        let slope = (at(h) - at(-h)) * state / (2.0 * h);
        columns.set_column(k, &slope);
    }
    columns.view_mut((0, 3), (samples, 3)).copy_from(&basis(cubic, dt_us, samples));
    columns
}

fn companion([p2, p1, p0]: [f64; 3]) -> Matrix3<f64> {
    Matrix3::new(0.0, 1.0, 0.0, 0.0, 0.0, 1.0, -p0, -p1, -p2)
}

/// From 1/s, 1/s², 1/s³.
pub(super) fn cubic_per_us([p2, p1, p0]: [f64; 3]) -> [f64; 3] {
    [p2 * 1e-6, p1 * 1e-12, p0 * 1e-18]
}

/// From those per s.
pub(super) fn per_us([y, dy, ddy]: [f64; 3]) -> [f64; 3] {
    [y, dy * 1e-6, ddy * 1e-12]
}

/// The poles of a cubic, 1/s, 1/s², 1/s³. `None`: all its roots are real, or a number is absurd.
pub fn poles_of(cubic: [f64; 3]) -> Option<Poles> {
    let cubic = cubic_per_us(cubic);
    // larger coefficients belong to no rates, and with them the iteration for the roots may not end
    if !cubic.iter().all(|p| p.abs() < 1e60) {
        return None;
    }
    let roots = companion(cubic).complex_eigenvalues();
    let pair = roots.iter().find(|z| z.im > 1e-9 * z.norm())?;
    let real = roots.iter().min_by(|p, q| p.im.abs().total_cmp(&q.im.abs()))?;
    Some(Poles {
        damping_per_s: -pair.re * 1e6,
        frequency_hz: pair.im / (2.0 * std::f64::consts::PI) * 1e6,
        lambda_per_s: -real.re * 1e6,
    })
}
