//! The cubic s^3 + p2 s^2 + p1 s + p0 of the observable poles: its decays, and its roots.
//!
//! In: p2, p1, p0, which one decay determines (the four rates it does not), and the output state y,
//! y', y'' at t_a. Out: the decay's samples, their derivatives, or the poles. The output obeys
//! y''' + p2 y'' + p1 y' + p0 y = 0, so with the companion matrix M of the cubic the state (y, y',
//! y'') at sample k is e^(M k dt) times the state at t_a, exactly. Numbers "per µs" have time in
//! microseconds: p2 in 1/µs, p1 in 1/µs², p0 in 1/µs³, y' in counts/µs, y'' in counts/µs².

use crate::model::ring_down::Poles;
use nalgebra::{DMatrix, Matrix3, MatrixXx3, Vector3};

/// The basis of all decays of a cubic: its columns are the outputs from unit y, y', y'' at t_a (per
/// µs), by exact discretisation of the cubic's companion form. `cubic`: p2, p1, p0 per µs.
pub(super) fn basis(cubic: [f64; 3], dt_us: f64, samples: usize) -> MatrixXx3<f64> {
    let step = (companion(cubic) * dt_us).exp();
    let mut basis = MatrixXx3::zeros(samples);
    let (of_y, rest) = basis.as_mut_slice().split_at_mut(samples);
    let (of_dy, of_ddy) = rest.split_at_mut(samples);

    // the first row of e^(M k dt) for sample k, which is what turns the state at t_a into y at
    // sample k
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
/// decay that leave it a decay. The first three are central differences, the others the basis
/// itself, since the decay is linear in the state. `cubic`, `state`: per µs.
pub(super) fn tangent(
    cubic: [f64; 3],
    state: Vector3<f64>,
    dt_us: f64,
    samples: usize,
) -> DMatrix<f64> {
    let mut columns = DMatrix::zeros(samples, 6);
    for k in 0..3 {
        let h = 1e-5 * cubic[k].abs().max(1e-9);
        let (mut up, mut down) = (cubic, cubic);
        up[k] += h;
        down[k] -= h;
        let slope = (basis(up, dt_us, samples) - basis(down, dt_us, samples)) * state / (2.0 * h);
        columns.set_column(k, &slope);
    }
    columns.view_mut((0, 3), (samples, 3)).copy_from(&basis(cubic, dt_us, samples));
    columns
}

/// Companion matrix of the cubic, for the state (y, y', y'').
fn companion([p2, p1, p0]: [f64; 3]) -> Matrix3<f64> {
    Matrix3::new(0.0, 1.0, 0.0, 0.0, 0.0, 1.0, -p0, -p1, -p2)
}

/// p2, p1, p0 per µs, from those in 1/s, 1/s², 1/s³.
pub(super) fn cubic_per_us([p2, p1, p0]: [f64; 3]) -> [f64; 3] {
    [p2 * 1e-6, p1 * 1e-12, p0 * 1e-18]
}

/// y, y', y'' per µs, from those per s.
pub(super) fn to_microseconds([y, dy, ddy]: [f64; 3]) -> [f64; 3] {
    [y, dy * 1e-6, ddy * 1e-12]
}

/// The damped pair and the real pole of a cubic, as the eigenvalues of its companion matrix.
/// `cubic`: p2, p1, p0 in 1/s, 1/s², 1/s³. `None`: all its roots are real, or a coefficient is
/// absurd.
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
